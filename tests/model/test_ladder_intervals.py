"""The ladder with inter-stimulus intervals: each model says of them what it says and no more."""

import numpy as np
import pandas as pd
import pytest
from reference.hard_cases import hard_cases
from scipy.special import logsumexp
from typer.testing import CliRunner

import bayes_toe as bt
from bayes_toe.cli.app import app
from bayes_toe.comparison.leave_one_out import leave_one_pair_out, log_evidence_without
from bayes_toe.data.study import Subject
from bayes_toe.experiments.simulate import at_intervals, reference_design
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Wanted, infer
from bayes_toe.model.beliefs import Gaussian, comparison_distance, update
from bayes_toe.model.free_frequencies import frequency_evidence
from bayes_toe.model.ladder import MODELS, NAMES, PREDICTIVE_UPDATE, model_named, posterior_of
from bayes_toe.model.record import Model

CASES = hard_cases()
MEAN_REVERTING = model_named("mean-reverting memory")
IGNORES_INTERVALS = "ignores the interval: a pair has the same P(equal) at every one"
RUNGS = [model for model in MODELS if isinstance(model, Model)]
IGNORING = [model for model in RUNGS if model.propagator is None]
WEAK = Subject("a", [0.0, 0.5, 0.0, 0.5, 0.4], [0.5, 0.0, 0.5, 0.1, 0.4], [3, 5, 4, 3, 6], [7, 7, 6, 7, 7], isi=[0.3, 0.3, 3.0, 3.0, 1.0])


def made_by(model, x, intervals=(0.25, 1.0, 4.0), trials=50, seed=5):
    """A subject in the paper's pairs at these intervals, answering by a model."""
    design = at_intervals(reference_design(), intervals)
    n = np.full(len(design.s1), trials)
    empty = Subject(f"made by {model.name}", design.s1, design.s2, np.zeros_like(n), n, design.isi)
    q = np.exp(posterior_of(empty, model=model).log_answers([x])[0][0])
    return Subject(empty.name, empty.s1, empty.s2, np.random.default_rng(seed).binomial(n, q), n, empty.isi)


OF_MEMORY = made_by(MEAN_REVERTING, [-0.14, 0.5, np.log(0.28), 0.0, 2.0])
SECOND = bt.Prior(reference_interval=1.0)
OF_WALK = made_by(PREDICTIVE_UPDATE, [-0.14, 1.5, np.log(0.28), 1.5])


def inferred(subject, model, draws, seed):
    return infer(posterior_of(subject, model=model), seed, Wanted(SamplerSettings(draws=draws), EVIDENCE_DRAWS))


def evidence_of(subject, model, prior=None):
    estimate = importance_evidence(fit_proposal(posterior_of(subject, prior, model=model), np.random.default_rng(1)))
    return estimate.value, estimate.se


# --- What each says ---------------------------------------------------------------------------------


@pytest.mark.parametrize("model", IGNORING, ids=lambda model: model.name)
def test_models_without_a_memory_pool_the_answers_over_intervals(model):
    pooled = Subject.from_counts("a", OF_WALK.s1, OF_WALK.s2, OF_WALK.n_yes, OF_WALK.n_trials)
    assert pooled.n_pairs * 3 == OF_WALK.n_pairs
    x = posterior_of(pooled, model=model).sample_prior(np.random.default_rng(1), 500)
    assert posterior_of(OF_WALK, model=model).log_density(x) == pytest.approx(posterior_of(pooled, model=model).log_density(x), rel=1e-12)
    assert model.of_intervals == IGNORES_INTERVALS


def test_mean_reverting_memory_is_its_filter_at_each_interval():
    target = posterior_of(OF_MEMORY, SECOND, model=MEAN_REVERTING)
    x = target.sample_prior(np.random.default_rng(3), 500)
    x = x[np.abs(x[:, 1]) < 12]
    named = target.judged(x)
    mu1, sigma1, sigma_l, rho = (named[key][:, None] for key in ("mu1", "sigma1", "sigma_l", "rho"))
    after = update(Gaussian(mu1, sigma1**2), OF_MEMORY.s1, sigma_l)
    kept = np.exp(OF_MEMORY.isi * np.log(rho))
    evolved = Gaussian(mu1 + kept * (after.mean - mu1), kept**2 * after.variance + (1 - kept**2) * sigma1**2)
    z = comparison_distance(evolved, OF_MEMORY.s2, sigma_l)
    # Differences of large terms: the literal route loses digits, the closed form does not.
    room = 1e-11 * (np.abs(mu1) + 1) / (evolved.sd + sigma_l**2 / evolved.sd)
    assert (np.abs(target.distance(x) - z) < 1e-8 * np.abs(z) + room).all()


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
    value, error = evidence_of(WEAK, MEAN_REVERTING, prior)
    assert np.hypot(error, spread) < 0.01
    assert value == pytest.approx(average, abs=4.5 * np.hypot(error, spread))


def test_starts_find_the_maxima_of_intervals_far_from_one_second():
    # Offsets at one second are hundreds of times those at the intervals: with starts on the scale of the stimuli, one seed in five missed
    # the higher of two maxima, by 52 nats, and another had no two walkers apart.
    case = CASES["reversed answers"]
    isi = np.array([500.0, 200.0, 1000.0, 1000.0, 1000.0, 1000.0, 1000.0, 200.0, 200.0, 200.0, 1000.0, 1000.0, 1000.0])
    subject = Subject("far", case.s1, case.s2, case.n_yes, case.n_trials, isi)
    found = [inferred(subject, "no lapses", 300, seed) for seed in (1, 2, 3)]
    assert all(one.chains.converged for one in found)
    assert np.ptp([one.evidence.value for one in found]) < 6 * np.hypot(found[0].evidence.se, found[1].evidence.se)


def test_a_left_out_pair_at_its_interval_by_evidence_and_by_smoothed_weights():
    target, made = posterior_of(OF_MEMORY, model=MEAN_REVERTING), inferred(OF_MEMORY, MEAN_REVERTING, 4000, 3)
    found = leave_one_pair_out(target.pair_log_likelihood(made.chains.x.reshape(-1, 5)), OF_MEMORY.n_trials)
    pair = int(np.argmin(found.pareto_k[0]))
    rest = log_evidence_without(target, pair, np.random.default_rng(1))
    assert made.evidence.value - rest == pytest.approx(found.values[0, pair], abs=0.03)


# --- Table and command ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def timed_csv(tmp_path_factory):
    path = tmp_path_factory.mktemp("timed") / "study.csv"
    call = ["simulate", "-o", str(path), "--subjects", "1", "--isi", "0.5,1,2", "--batches", "20", "--seed", "3"]
    assert CliRunner().invoke(app, call).exit_code == 0
    return path


def test_command(timed_csv, tmp_path):
    done = CliRunner().invoke(
        app, ["compare", str(timed_csv), "-o", str(tmp_path / "out.csv"), "--seed", "1", "--workers", "1", "--space", "ladder"]
    )
    assert done.exit_code == 0, done.output
    assert "3 intervals in column isi: 0.5, 1, 2 s" in done.output
    ignoring = "symmetric, constant bias, differencing, free weighting"
    assert f"note S01 ({ignoring}): {IGNORES_INTERVALS}" in done.output
    assert "note S01 (free frequencies): one frequency for each pair at each interval" in done.output
    frame = pd.read_csv(tmp_path / "out.csv")
    assert frame["model"].tolist() == list(NAMES)
    assert frame["log_evidence"].notna().all()
    assert frame["elpd_loo_trial"].notna().all()
    noted = frame[frame["note"].fillna("").str.startswith(IGNORES_INTERVALS)]
    assert set(noted["model"]) == {model.name for model in IGNORING}
    assert len(noted) == len(IGNORING)
    study, h0 = bt.read_study(timed_csv), frame[frame["model"] == "free frequencies"]
    assert h0["parameters"].tolist() == [39]
    assert h0["log_evidence"].to_numpy() == pytest.approx([frequency_evidence(subject) for subject in study], rel=1e-12)
    assert frame.groupby("model")["log_evidence"].sum().idxmax() == "predictive update"


def test_one_interval_has_no_notes(timed_csv):
    study = bt.read_study(timed_csv).at_isi(1.0)
    assert not any(row.notes for row in bt.compare(study, ["symmetric", "predictive update"], seed=4, workers=1))
