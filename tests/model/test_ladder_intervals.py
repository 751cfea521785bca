"""The ladder with inter-stimulus intervals: each model says of them what it says and no more."""

import numpy as np
import pandas as pd
import pytest
from commands import good
from reference.hard_cases import hard_cases
from scipy.special import logsumexp

import bayes_toe as bt
from bayes_toe.data.study import Subject
from bayes_toe.experiments.simulate import at_intervals, reference_design
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Wanted, infer
from bayes_toe.model.beliefs import Gaussian, comparison_distance
from bayes_toe.model.free_frequencies import frequency_evidence
from bayes_toe.model.ladder import MODELS, NAMES, model_named, posterior_of
from bayes_toe.model.record import Model

CASES = hard_cases()
MEAN_REVERTING = model_named("mean-reverting memory")
IGNORES_INTERVALS = "ignores the interval: a pair has the same P(equal) at every one"
RUNGS = [model for model in MODELS if isinstance(model, Model)]
IGNORING = [model for model in RUNGS if model.propagator is None]
WEAK = Subject("a", [0.0, 0.5, 0.0, 0.5, 0.4], [0.5, 0.0, 0.5, 0.1, 0.4], [3, 5, 4, 3, 6], [7, 7, 6, 7, 7], isi=[0.3, 0.3, 3.0, 3.0, 1.0])


# --- What each says ---------------------------------------------------------------------------------


@pytest.mark.parametrize("model", IGNORING, ids=lambda model: model.name)
def test_models_without_a_memory_pool_the_answers_over_intervals(model):
    design = at_intervals(reference_design(), (0.25, 1.0, 4.0))
    counts = np.random.default_rng(5).integers(0, 51, len(design.s1)), np.full(len(design.s1), 50)
    pooled = Subject.from_counts("a", design.s1, design.s2, *counts)
    assert pooled.n_pairs * 3 == len(design.s1)
    of_pooled, target = (posterior_of(one, model=model) for one in (pooled, Subject("a", design.s1, design.s2, *counts, design.isi)))
    x = of_pooled.sample_prior(np.random.default_rng(1), 500)
    assert target.log_density(x) == pytest.approx(of_pooled.log_density(x), rel=1e-12)
    assert model.of_intervals == IGNORES_INTERVALS


# --- Evidence ---------------------------------------------------------------------------------------


def test_evidence_of_the_mean_reverting_memory_is_the_prior_average_of_its_filter():
    rng, size, prior = np.random.default_rng(9), 1_000_000, bt.Prior(mu1_sd=1.0, reference_interval=1.0)
    mu1, sigma1 = rng.normal(size=size), np.abs(rng.normal(size=size))
    gain, rho, q0 = rng.uniform(size=(3, size))
    noise = sigma1 * np.sqrt(1 / gain - 1)
    logs = np.zeros(size)
    for s1, s2, k, n, isi in zip(WEAK.s1, WEAK.s2, WEAK.n_yes, WEAK.n_trials, WEAK.isi, strict=True):
        variance = sigma1**2 * (1 - rho ** (2 * isi) * gain)
        q = q0 * 2.0 ** -np.square(comparison_distance(Gaussian(mu1 + rho**isi * gain * (s1 - mu1), variance), s2, noise))
        with np.errstate(divide="ignore"):
            logs += k * np.log(q) + (n - k) * np.log1p(-q)
    average = logsumexp(logs) - np.log(size)
    spread = np.sqrt(np.exp(logsumexp(2 * logs) - 2 * logsumexp(logs)))
    found = importance_evidence(fit_proposal(posterior_of(WEAK, prior, model=MEAN_REVERTING), np.random.default_rng(1)))
    assert np.hypot(found.se, spread) < 0.01
    assert found.value == pytest.approx(average, abs=4.5 * np.hypot(found.se, spread))


def test_starts_find_the_maxima_of_intervals_far_from_one_second():
    # Offsets at one second are hundreds of times those at the intervals: with starts on the scale of the stimuli, one seed in five missed
    # the higher of two maxima, by 52 nats, and another had no two walkers apart.
    case = CASES["reversed answers"]
    isi = np.array([500.0, 200.0, 1000.0, 1000.0, 1000.0, 1000.0, 1000.0, 200.0, 200.0, 200.0, 1000.0, 1000.0, 1000.0])
    subject = Subject("far", case.s1, case.s2, case.n_yes, case.n_trials, isi)
    target = posterior_of(subject, model="no lapses")
    found = [infer(target, seed, Wanted(SamplerSettings(draws=300), EVIDENCE_DRAWS)) for seed in (1, 2, 3)]
    assert all(one.chains.converged for one in found)
    assert np.ptp([one.evidence.value for one in found]) < 6 * np.hypot(found[0].evidence.se, found[1].evidence.se)


# --- Table and command ------------------------------------------------------------------------------


def test_command(tmp_path):
    made = ("--subjects", "1", "--isi", "0.5,1,2", "--batches", "20", "--seed", "3")
    good("simulate", "-o", "study.csv", *made, cwd=tmp_path)
    said = good("compare", "study.csv", "-o", "out.csv", "--seed", "1", "--workers", "1", "--space", "ladder", cwd=tmp_path)
    assert "3 intervals in column isi: 0.5, 1, 2 s" in said
    assert f"note S01 (symmetric, constant bias, differencing, free weighting): {IGNORES_INTERVALS}" in said
    assert "note S01 (free frequencies): one frequency for each pair at each interval" in said
    frame, study = pd.read_csv(tmp_path / "out.csv").set_index("model"), bt.read_study(tmp_path / "study.csv")
    assert frame.index.tolist() == list(NAMES)
    assert frame[["log_evidence", "elpd_loo_trial"]].notna().all().all()
    assert set(frame.index[frame["note"].fillna("").str.startswith(IGNORES_INTERVALS)]) == {model.name for model in IGNORING}
    assert frame.loc["free frequencies", "parameters"] == 39
    assert frame.loc["free frequencies", "log_evidence"] == pytest.approx(frequency_evidence(study["S01"]), rel=1e-12)
    assert frame["log_evidence"].idxmax() == "predictive update"
    assert not any(row.notes for row in bt.compare(study.at_isi(1.0), ["symmetric", "predictive update"], seed=4, workers=1))
