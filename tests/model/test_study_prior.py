"""The default prior: its scales from what each subject felt, its densities, no unit of intensity, and no unit of time."""

from dataclasses import replace

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.data.conditions import Stimuli
from bayes_toe.data.study import stimuli_of
from bayes_toe.data.tasks import TASKS
from bayes_toe.model.intervals import interval_units
from bayes_toe.model.models import MODEL_NAMES, model_posterior, require_model
from bayes_toe.model.prior import DEFAULT
from bayes_toe.model.prior_fields import OF_STIMULI
from bayes_toe.model.prior_file import preset_or_file, prior_for


def subject(name="S", factor=1.0, shift=0.0, isi=None):
    s1, s2 = np.array([0.0, 0.0, 0.5, 0.25, 0.1]), np.array([0.0, 0.5, 0.0, 0.4, 0.75])
    return bt.Subject(
        name,
        factor * s1 + shift,
        factor * s2 + shift,
        [45, 20, 15, 30, 2],
        [50, 50, 50, 40, 50],
        isi,
    )


def study(**how):
    return bt.Study([subject("A", **how), subject("B", **how)])


def test_the_stimuli_by_hand():
    one = bt.Subject("S", [0.0, 1.0, 1.0], [3.0, 0.0, 1.0], [1, 1, 5], [5, 15, 20])
    values, n = np.array([0.0, 3.0, 1.0, 0.0, 1.0, 1.0]), np.array([5, 5, 15, 15, 20, 20])
    mean = values @ n / 80
    assert stimuli_of(one)[:3] == pytest.approx(
        (mean, np.sqrt((values - mean) ** 2 @ n / 80), np.sqrt((5 * 9 + 15) / 20))
    )
    assert stimuli_of(one, one) == pytest.approx(stimuli_of(one))
    numbers = [Stimuli(2.0, 4.0, 1.0, 0.0).number(key) for key in OF_STIMULI]
    assert numbers == [2.0, 10.0, 1.0]
    lone = bt.Study([subject(), bt.Subject("L", [0.4], [0.4], [1], [2])])
    with pytest.raises(
        bt.InputError,
        match=r"^subject 'L': the prior takes its scale from pairs of different stimuli, found none; .*--prior p",
    ):
        prior_for(lone)
    assert np.isfinite(
        bt.model.paper_posterior(lone["L"], prior_for(lone, "paper")).log_density(
            [[0.1, 0.0, 0.0, 0.0]]
        )
    ).all()
    with pytest.raises(
        bt.InputError,
        match="subject 'L': no pair has two different stimuli, so no order effect can be seen",
    ):
        bt.model.observer_posterior(lone["L"], model="constant-error").log_density(np.zeros((1, 6)))


@pytest.mark.parametrize(("factor", "shift"), [(3.0, 2.0), (1.0, 6.0), (0.25, -3.0)])
@pytest.mark.parametrize("task", TASKS)
def test_the_unit_of_intensity_changes_nothing(task, factor, shift):
    first, second = (
        bt.model.paper_posterior(replace(one, task=task))
        for one in (subject(), subject(factor=factor, shift=shift))
    )
    x = np.random.default_rng(5).normal(size=(30, 4)) * 0.5
    log_factor = np.log(factor)
    moved = x * [factor, 1.0, 1.0, 1.0] + [0.0, 0.0, log_factor, 0.0]
    assert second.log_likelihood(moved) == pytest.approx(first.log_likelihood(x), rel=1e-9)
    # Of an evidence every point counts.
    assert second.log_density(moved) + log_factor == pytest.approx(first.log_density(x), rel=1e-9)


def test_subjects_with_different_stimuli_in_one_study_have_each_their_own():
    here, there = subject("A"), subject("B", factor=3.0, shift=2.0)
    both, x = bt.Study([here, there]), np.zeros((1, 4))
    for one in (here, there):
        alone = bt.model.paper_posterior(one, prior_for(bt.Study([one])))
        assert bt.model.paper_posterior(one, prior_for(both)).log_density(x) == alone.log_density(x)
    assert bt.model.paper_posterior(there).prior.mu1_sd == pytest.approx(
        3.0 * bt.model.paper_posterior(here).prior.mu1_sd
    )


def test_presets_words_and_what_is_refused(tmp_path):
    assert (
        prior_for(study())
        == prior_for(study(), "default")
        == preset_or_file(None)
        == preset_or_file("default")
        == DEFAULT
    )
    assert prior_for(study(), "paper") == prior_for(study(), bt.Prior()) == bt.Prior()
    found = prior_for(study(), bt.Prior(mu1_mean="stimuli", mu1_sd=3.0))
    assert found.describe() == (
        "mu1 ~ Normal(M, 3), sigma_p ~ HalfNormal(1), gamma ~ Uniform(0, 1), q0 ~ Uniform(0, 1); M "
        "mean and R sd of the stimuli, D rms step"
    )
    with pytest.raises(
        bt.InputError,
        match="prior 'flat': no such preset or file, allowed: 'default', 'paper', a TOML file",
    ):
        prior_for(study(), "flat")
    file = tmp_path / "default"
    file.write_text("[paper]\nsigma_p_scale = 0.5", encoding="utf-8")
    assert preset_or_file(str(file)) == bt.Prior(sigma_p_scale=0.5)


def test_every_verb_stores_it_as_it_was_said(tmp_path):
    one = bt.Study([subject()])
    draws = bt.sample(one, draws=300, seed=1, workers=1)
    again = bt.load(draws.save(tmp_path / "posterior.nc"))
    assert again.prior == DEFAULT
    assert "mu1 ~ Normal(M, 2.5 R), width ~ LogNormal(D, 1)" in again.attrs["prior"]
    assert again.posterior("S").prior.mu1_mean == stimuli_of(one["S"]).mean
    assert bt.evidence(one, seed=1, workers=1).prior == DEFAULT
    assert bt.fit(one, replicates=2, seed=1, workers=1).prior == DEFAULT


def test_the_reference_interval_of_draws_is_the_mean_of_the_trials():
    draws = bt.sample(
        study(isi=[0.5, 0.5, 2.0, 1.0, 1.0]), draws=300, seed=1, prior="paper", workers=1
    )
    assert draws.prior.reference_interval == pytest.approx(
        np.exp(np.average(np.log([0.5, 0.5, 2, 1, 1]), weights=[50, 50, 50, 40, 50]))
    )


# --- the unit of time -----------------------------------------------------------------------------


@pytest.mark.parametrize("seconds", [0.05, 3.0])
@pytest.mark.parametrize("name", MODEL_NAMES)
def test_one_interval_is_none(name, seconds):
    timed, plain = bt.Study([subject(isi=np.full(5, seconds))]), bt.Study([subject()])
    first, second = (
        model_posterior(require_model(name, one.task), one["S"], prior_for(one))
        for one in (timed, plain)
    )
    x = np.random.default_rng(6).normal(size=(20, len(first.coordinates)))
    assert first.log_density(x).tolist() == second.log_density(x).tolist()
    for a, b in zip(first.gradient(x), second.gradient(x), strict=True):
        assert a == pytest.approx(
            b, rel=1e-12, abs=1e-12 * np.abs(b).max()
        )  # sums in another order
    if name == "paper":
        assert first.reference == seconds


def test_the_unit_of_time_changes_nothing():
    isi = np.array([0.5, 0.5, 2.0, 1.0, 4.0])
    seconds, minutes = (
        bt.model.paper_posterior(one["S"], prior_for(one))
        for one in (bt.Study([subject(isi=isi / k)]) for k in (1, 60))
    )
    x = np.random.default_rng(6).normal(size=(20, 4))
    assert seconds.log_density(x) == pytest.approx(minutes.log_density(x), rel=1e-12)
    assert seconds.gain(x, isi) == pytest.approx(minutes.gain(x, isi / 60), rel=1e-12)


def test_the_reference_can_be_said_and_is_kept():
    isi = np.array([0.5, 0.5, 2.0, 1.0, 4.0])
    timed = bt.Study([subject("A", isi=isi), subject("B", isi=2 * isi)])
    common = prior_for(timed).reference_interval
    assert common == pytest.approx(
        np.exp(np.average(np.log(np.r_[isi, 2 * isi]), weights=np.tile([50, 50, 50, 40, 50], 2)))
    )
    said = prior_for(timed, bt.Prior(reference_interval=1.0))
    posterior = bt.model.paper_posterior(timed["B"], said)
    assert posterior.reference == posterior.for_subject(timed["A"]).reference == 1.0
    assert bt.model.paper_posterior(timed["B"]).for_subject(timed["A"]).reference == pytest.approx(
        common * np.sqrt(2)
    )
    assert said.describe().endswith("; over 1 s")
    assert prior_for(study(), said).reference_interval is None
    units = interval_units(0.5)
    assert (units["sigma_p"], units["gain"]) == ("ln intensity / (0.5 s)^(1/2)", "1, at 0.5 s")
    # the same observer in two units of time: gamma_t = gamma_1/t, sigma_p over t is sigma_p sqrt(t)
    x = np.array([[0.1, -0.4, -0.5, 2.0]])
    at_one = posterior.natural(x)
    other = bt.model.paper_posterior(timed["B"], replace(said, reference_interval=4.0))
    y = other.points({**at_one._asdict(), "sigma_p": 2.0 * at_one.sigma_p})
    assert other.log_likelihood(y) == pytest.approx(posterior.log_likelihood(x), rel=1e-12)
