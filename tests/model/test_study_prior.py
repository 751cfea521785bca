"""The default prior: scales from the stimuli, densities, independence of units."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import made_subject
from numpy.random import default_rng

import bayes_toe as bt
from bayes_toe.data.study import common_scales
from bayes_toe.data.tasks import SAME_DIFFERENT, TASKS
from bayes_toe.model.intervals import interval_units
from bayes_toe.model.models import MODEL_NAMES, model_posterior, require_model
from bayes_toe.model.prior import DEFAULT
from bayes_toe.model.prior_file import preset_or_file, prior_for

N_TRIALS = [50, 50, 50, 40, 50]


def make_subject(name="S", factor=1.0, shift=0.0, isi=None, task=SAME_DIFFERENT):
    s1, s2 = np.array([0.0, 0.0, 0.5, 0.25, 0.1]), np.array([0.0, 0.5, 0.0, 0.4, 0.75])
    s1, s2 = factor * s1 + shift, factor * s2 + shift
    return bt.Subject(name, s1, s2, [45, 20, 15, 30, 2], N_TRIALS, isi, task=task)


STUDY = bt.Study([make_subject("A"), make_subject("B")])


def test_the_stimuli_by_hand():
    subject = made_subject("0 3 1 5, 1 0 1 15, 1 1 5 20")
    values = np.repeat([0.0, 3.0, 1.0, 0.0, 1.0, 1.0], [5, 5, 15, 15, 20, 20])
    expected = values.mean(), values.std(), np.sqrt((5 * 9 + 15) / 20)
    for subjects in ((subject,), (subject, subject)):
        scales = common_scales(*subjects)
        assert (scales.mean, scales.spread, scales.step) == pytest.approx(expected)


def test_a_subject_without_different_stimuli_has_no_default_prior():
    study = bt.Study([make_subject(), made_subject("0.4 0.4 1 2", "L")])
    message = "^subject 'L': the prior takes its scale from pairs of different stimuli, found none"
    with pytest.raises(bt.InputError, match=f"{message}; .*--prior p"):
        prior_for(study)
    paper = bt.model.paper_posterior(study["L"], prior_for(study, "paper"))
    assert np.isfinite(paper.log_density([[0.1, 0.0, 0.0, 0.0]])).all()
    message = "subject 'L': no pair has two different stimuli, so no order effect can be seen"
    with pytest.raises(bt.InputError, match=message):
        bt.model.observer_posterior(study["L"], model="constant-error").log_density(
            np.zeros((1, 6))
        )


@pytest.mark.parametrize("factor, shift", [(3.0, 2.0), (1.0, 6.0), (0.25, -3.0)])
@pytest.mark.parametrize("task", TASKS)
def test_the_unit_of_intensity_changes_nothing(task, factor, shift):
    plain = bt.model.paper_posterior(make_subject(task=task))
    moved = bt.model.paper_posterior(make_subject(factor=factor, shift=shift, task=task))
    x = default_rng(5).normal(size=(30, 4)) * 0.5
    log_factor = np.log(factor)
    y = x * [factor, 1.0, 1.0, 1.0] + [0.0, 0.0, log_factor, 0.0]
    assert moved.log_likelihood(y) == pytest.approx(plain.log_likelihood(x), rel=1e-9)
    # Of an evidence every point counts.
    assert moved.log_density(y) + log_factor == pytest.approx(plain.log_density(x), rel=1e-9)


def test_subjects_with_different_stimuli_in_one_study_have_each_their_own():
    study = bt.Study([make_subject("A"), make_subject("B", factor=3.0, shift=2.0)])
    sds = []
    for subject in study:
        alone = bt.model.paper_posterior(subject, prior_for(bt.Study([subject])))
        together = bt.model.paper_posterior(subject, prior_for(study))
        assert together.log_density(np.zeros((1, 4))) == alone.log_density(np.zeros((1, 4)))
        sds.append(together.prior.mu1_sd)
    assert sds[1] == pytest.approx(3.0 * sds[0])


def test_presets_words_and_what_is_refused(tmp_path):
    for preset in (None, "default"):
        assert preset_or_file(preset) == prior_for(STUDY, preset) == DEFAULT
    assert prior_for(STUDY, "paper") == prior_for(STUDY, bt.Prior()) == bt.Prior()
    prior = prior_for(STUDY, bt.Prior(mu1_mean="stimuli", mu1_sd=3.0))
    assert prior.describe() == (
        "mu1 ~ Normal(M, 3), sigma_p ~ HalfNormal(1), gamma ~ Uniform(0, 1), q0 ~ Uniform(0, 1); M "
        "mean and R sd of the stimuli, D rms step"
    )
    message = "prior 'flat': no such preset or file, allowed: 'default', 'paper', a TOML file"
    with pytest.raises(bt.InputError, match=message):
        prior_for(STUDY, "flat")
    path = tmp_path / "default"
    path.write_text("[paper]\nsigma_p_scale = 0.5", encoding="utf-8")
    assert preset_or_file(str(path)) == bt.Prior(sigma_p_scale=0.5)


# --- the unit of time -----------------------------------------------------------------------------

ISI = np.array([0.5, 0.5, 2.0, 1.0, 4.0])


@pytest.mark.parametrize("seconds", [0.05, 3.0])
@pytest.mark.parametrize("name", MODEL_NAMES)
def test_one_interval_is_none(name, seconds):
    posteriors = []
    for isi in (np.full(5, seconds), None):
        study = bt.Study([make_subject(isi=isi)])
        model = require_model(name, study.task)
        posteriors.append(model_posterior(model, study["S"], prior_for(study)))
    timed, plain = posteriors
    x = default_rng(6).normal(size=(20, len(timed.coordinates)))
    assert timed.log_density(x).tolist() == plain.log_density(x).tolist()
    expected = plain.gradient(x)[1]
    sums_in_another_order = 1e-12 * np.abs(expected).max()
    assert timed.gradient(x)[1] == pytest.approx(expected, rel=1e-12, abs=sums_in_another_order)
    if name == "paper":
        assert timed.reference == seconds


def test_the_reference_interval_is_the_geometric_mean_of_the_trials():
    study = bt.Study([make_subject("A", isi=ISI), make_subject("B", isi=2 * ISI)])
    intervals = np.repeat([*ISI, *(2 * ISI)], 2 * N_TRIALS)
    mean = np.exp(np.log(intervals).mean())
    assert prior_for(study).reference_interval == pytest.approx(mean)
    draws = bt.sample(study, draws=300, seed=1, prior="paper", workers=1)
    assert draws.prior.reference_interval == pytest.approx(mean)
    of_b = bt.model.paper_posterior(study["B"])
    assert of_b.for_subject(study["A"]).reference == pytest.approx(mean * np.sqrt(2))


def test_another_reference_interval_changes_units_and_no_likelihood():
    study = bt.Study([make_subject("A", isi=ISI), make_subject("B", isi=2 * ISI)])
    prior = prior_for(study, bt.Prior(reference_interval=1.0))
    posterior = bt.model.paper_posterior(study["B"], prior)
    assert posterior.reference == posterior.for_subject(study["A"]).reference == 1.0
    assert prior.describe().endswith("; over 1 s")
    assert prior_for(STUDY, prior).reference_interval is None
    units = interval_units(0.5)
    assert (units["sigma_p"], units["gain"]) == ("ln intensity / (0.5 s)^(1/2)", "1, at 0.5 s")
    # The same observer: gamma_t = gamma_1/t, sigma_p over t is sigma_p sqrt(t).
    x = np.array([[0.1, -0.4, -0.5, 2.0]])
    natural = posterior.natural(x)
    other = bt.model.paper_posterior(study["B"], replace(prior, reference_interval=4.0))
    y = other.points({**natural._asdict(), "sigma_p": 2.0 * natural.sigma_p})
    assert other.log_likelihood(y) == pytest.approx(posterior.log_likelihood(x), rel=1e-12)
