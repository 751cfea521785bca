"""A prior made numbers by a study: no unit of intensity, and no unit of time."""

import json
from dataclasses import replace

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.model.ladder import MODELS, model_named
from bayes_toe.model.posterior import Model
from bayes_toe.model.study_prior import Stimuli, preset_or_file, prior_for, read_prior


def subject(name="S", factor=1.0, shift=0.0, isi=None):
    s1, s2 = np.array([0.0, 0.0, 0.5, 0.25, 0.1]), np.array([0.0, 0.5, 0.0, 0.4, 0.75])
    return bt.Subject(name, factor * s1 + shift, factor * s2 + shift, [45, 20, 15, 30, 2], [50, 50, 50, 40, 50], isi)


def study(**how):
    return bt.Study([subject("A", **how), subject("B", **how)])


def test_the_stimuli_by_hand():
    found = Stimuli.of(bt.Study([bt.Subject("S", [0.0, 1.0, 1.0], [3.0, 0.0, 1.0], [1, 1, 5], [5, 15, 20])]))
    assert found == pytest.approx(((5 * 1.5 + 15 * 0.5 + 20) / 40, 35 / 40, 3.0, np.sqrt((5 * 9 + 15) / 20)))
    assert (found.inverse_range, found.log_step) == pytest.approx((1 / 3, np.log(3) / 2))
    with pytest.raises(bt.InputError, match="needs pairs of different stimuli"):
        prior_for(bt.Study([bt.Subject("S", [0.4], [0.4], [1], [2])]), "stimuli")


@pytest.mark.parametrize(("factor", "shift"), [(1.0, 6.0), (8.0, 0.0), (0.25, -3.0)])
@pytest.mark.parametrize("name", ["symmetric", "no lapses", "predictive update", "mean-reverting memory"])
def test_the_unit_of_intensity_changes_nothing(name, factor, shift):
    here, there = study(), study(factor=factor, shift=shift)
    first, second = (bt.posterior_of(one["A"], prior_for(one, "stimuli"), model=name) for one in (here, there))
    x = np.random.default_rng(5).normal(size=(30, len(first.coordinates))) * 0.5
    moved, volume = x.copy(), np.zeros(len(x))
    for i, coordinate in enumerate(first.coordinates):
        if coordinate == "log_width":
            moved[:, i] += np.log(factor)
        if coordinate == "offset":
            moved[:, i] *= factor
            volume += np.log(factor)
    assert second.log_density(moved) + volume == pytest.approx(first.log_density(x), rel=1e-9)
    assert prior_for(there, "stimuli").noise_slope_sd == pytest.approx(prior_for(here, "stimuli").noise_slope_sd / factor)


def test_presets_words_and_what_is_refused(tmp_path):
    plain = prior_for(study())
    assert plain == prior_for(study(), "paper") == prior_for(study(), bt.Prior()) == bt.Prior()
    found = prior_for(study(), bt.Prior(mu1_mean="stimuli", mu1_sd=3.0))
    assert (found.mu1_sd, found.sigma_p_scale) == (3.0, 1.0)
    assert found.describe().startswith(f"mu1 ~ Normal({found.mu1_mean:g}, 3), sigma_p")
    assert found.describe().endswith("q0 ~ Uniform(0, 1); mu1_mean from the stimuli")
    assert prior_for(study(), found) == found  # once
    assert prior_for(study(), found).origin == found.origin
    with pytest.raises(bt.InputError, match="prior 'flat': allowed: a Prior, or one of 'paper', 'stimuli'"):
        prior_for(study(), "flat")
    with pytest.raises(bt.InputError, match="mu1_mean is that of the stimuli"):
        bt.posterior_of(subject(), bt.Prior(mu1_mean="stimuli")).log_density([[0.0] * 4])
    with pytest.raises(bt.InputError, match=r"gamma_a=stimuli, allowed: a positive finite number$"):
        bt.Prior(gamma_a="stimuli")
    file = tmp_path / "stimuli"
    file.write_text('mu1_mean = "stimuli"\nsigma_p_scale = 0.5', encoding="utf-8")
    assert read_prior(file) == preset_or_file(str(file)) == bt.Prior(mu1_mean="stimuli", sigma_p_scale=0.5)
    assert preset_or_file("stimuli").mu1_sd == "stimuli"
    file.write_text('gamma_a = "stimuli"\nmu1_sd = "stimulus"', encoding="utf-8")
    with pytest.raises(bt.InputError) as caught:
        read_prior(file)
    assert [line.split("allowed: ")[1] for line in caught.value.problems] == [
        "a number from 0.05 to 1000",
        "a number from 1e-100 to 1e+100 or 'stimuli'",
    ]


def test_every_verb_makes_it_numbers_and_stores_them(tmp_path):
    one = bt.Study([subject()])
    expected = prior_for(one, "stimuli")
    draws = bt.sample(one, draws=300, seed=1, prior="stimuli", workers=1)
    again = bt.load(draws.save(tmp_path / "posterior.nc"))
    assert (
        again.prior
        == expected
        == prior_for(one, bt.Prior(**dict.fromkeys(("mu1_mean", "mu1_sd", "sigma_p_scale", "noise_slope_sd"), "stimuli")))
    )
    assert "from the stimuli" in again.attrs["prior"]
    assert again.prior.origin == expected.origin
    assert bt.evidence(one, prior="stimuli", seed=1, workers=1).prior == expected
    assert bt.compare(one, ["symmetric"], prior="stimuli", seed=1, workers=1).prior == expected
    assert bt.fit(one, replicates=2, prior="stimuli", seed=1, workers=1).prior == expected
    assert bt.sensitivity(one, prior="stimuli", steps=3, seed=1, workers=1).prior == expected


def test_draws_from_before_these_numbers_keep_their_prior():
    draws = bt.sample(study(isi=[0.5, 0.5, 2.0, 1.0, 1.0]), draws=300, seed=1, workers=1)
    assert draws.prior.reference_interval == pytest.approx(np.exp(np.average(np.log([0.5, 0.5, 2, 1, 1]), weights=[50, 50, 50, 40, 50])))
    settings = json.loads(draws.tree.attrs["settings"])
    settings["prior"] = {name: settings["prior"][name] for name in ("mu1_mean", "mu1_sd", "sigma_p_scale")}
    draws.tree.attrs["settings"] = json.dumps(settings)
    assert draws.prior == bt.Prior(offset_sd=1.0, reference_interval=1.0)


# --- the unit of time -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seconds", [0.05, 1.0, 3.0])
@pytest.mark.parametrize("name", [model.name for model in MODELS if isinstance(model, Model)])
def test_one_interval_is_none(name, seconds):
    timed, plain = bt.Study([subject(isi=np.full(5, seconds))]), bt.Study([subject()])
    first, second = (bt.posterior_of(one["S"], prior_for(one), model=name) for one in (timed, plain))
    x = np.random.default_rng(6).normal(size=(20, len(first.coordinates)))
    assert first.log_density(x).tolist() == second.log_density(x).tolist()
    for a, b in zip(first.gradient(x), second.gradient(x), strict=True):
        assert a == pytest.approx(b, rel=1e-12, abs=1e-12 * np.abs(b).max())  # sums in another order
    assert first.reference == seconds


def test_evidence_does_not_know_what_a_second_is():
    plain, timed = (bt.evidence(bt.Study([subject(isi=isi)]), seed=3, workers=1)["S"] for isi in (None, np.full(5, 0.05)))
    assert timed.log_evidence_h1 == pytest.approx(plain.log_evidence_h1, abs=1e-12)
    isi = np.array([0.5, 0.5, 2.0, 1.0, 4.0])
    seconds, minutes = (bt.posterior_of(one["S"], prior_for(one)) for one in (bt.Study([subject(isi=isi / k)]) for k in (1, 60)))
    x = np.random.default_rng(6).normal(size=(20, 4))
    assert seconds.log_density(x) == pytest.approx(minutes.log_density(x), rel=1e-12)
    assert seconds.gain(x, isi) == pytest.approx(minutes.gain(x, isi / 60), rel=1e-12)


def test_the_reference_can_be_said_and_is_kept():
    isi = np.array([0.5, 0.5, 2.0, 1.0, 4.0])
    timed = bt.Study([subject("A", isi=isi), subject("B", isi=2 * isi)])
    common = prior_for(timed).reference_interval
    assert common == pytest.approx(np.exp(np.average(np.log(np.r_[isi, 2 * isi]), weights=np.tile([50, 50, 50, 40, 50], 2))))
    said = prior_for(timed, bt.Prior(reference_interval=1.0))
    posterior = bt.posterior_of(timed["B"], said)
    assert posterior.reference == posterior.for_subject(timed["A"]).reference == 1.0
    assert bt.posterior_of(timed["B"]).for_subject(timed["A"]).reference == pytest.approx(common * np.sqrt(2))
    assert said.describe().endswith("; over 1 s")
    assert model_named("mean-reverting memory").describe(said).endswith("; over 1 s")
    assert prior_for(study(), said).reference_interval is None
    units = model_named("predictive update").units_at_intervals(0.5)
    assert (units["sigma_p"], units["gain"]) == ("ln intensity / (0.5 s)^(1/2)", "1, at 0.5 s")
    # the same observer in two units of time: gamma_t = gamma_1/t, sigma_p over t is sigma_p sqrt(t)
    x = np.array([[0.1, -0.4, -0.5, 2.0]])
    at_one = posterior.natural(x)
    other = bt.posterior_of(timed["B"], replace(said, reference_interval=4.0))
    y = other.points({**at_one._asdict(), "sigma_p": 2.0 * at_one.sigma_p})
    assert other.log_likelihood(y) == pytest.approx(posterior.log_likelihood(x), rel=1e-12)
