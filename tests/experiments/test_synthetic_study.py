"""Simulated studies from Python: those that the command writes, and observers of one's own."""

import numpy as np
import pytest

import bayes_toe as bt

ONE = {"mu1": -0.7, "sigma_p": 0.2, "sigma_l": 0.1, "q0": 0.95}


def test_the_bundled_study_comes_again():
    study, truth = bt.simulate(16, seed=2604)
    bundled = bt.example_study()
    assert all(np.array_equal(study[name].n_equal, bundled[name].n_equal) for name in bundled.names)
    assert all(truth[name] == pytest.approx(dict(bt.example_truth()[name])) for name in bundled.names)
    assert study.synthetic


def test_observers_of_ones_own():
    study, truth = bt.simulate({"A": ONE, "B": {**ONE, "mu1": 0.9}}, design="full", amplitudes=(1.0, 1.5), batches=4000, seed=1)
    assert truth["B"]["mu1"] == 0.9
    for one in study:
        q = bt.model.equal_probability(one.s1, one.s2, **truth[one.name])
        assert np.all(np.abs(one.n_equal / one.n_trials - q) < 5.0 * np.sqrt(q * (1.0 - q) / 4000) + 1e-9)
    assert bt.simulate({"A": ONE}, isi=(0.5, 2.0), batches=2, seed=1).study.intervals == (0.5, 2.0)


def test_observers_of_the_prior_are_those_that_an_analysis_of_their_study_expects():
    of_prior = {"population": "prior", "batches": 1, "seed": 1}
    own, there = (bt.simulate(9, **of_prior).truth, bt.simulate(9, **of_prior, isi=(2.0, 8.0)).truth)
    at_two = bt.simulate(9, **of_prior, isi=(2.0, 8.0), prior=bt.Prior(reference_interval=2.0)).truth
    for name in own:  # the prior is about sigma_p over 4 s, the geometric mean, or over 2 s where it says so
        for truth, seconds in ((there, 4.0), (at_two, 2.0)):
            assert truth[name] == pytest.approx({**own[name], "sigma_p": own[name]["sigma_p"] / seconds**0.5}, rel=1e-14)
    found = bt.simulate(9, **of_prior, prior="stimuli")
    numbers = bt.prior_for(found.study, "stimuli")
    for name, values in found.truth.items():  # the paper's prior has mu1 ~ Normal(0, 10) and sigma_p ~ HalfNormal(1)
        assert values["mu1"] == pytest.approx(numbers.mu1_mean + numbers.mu1_sd * own[name]["mu1"] / 10.0, rel=1e-12)
        assert values["sigma_p"] == pytest.approx(numbers.sigma_p_scale * own[name]["sigma_p"], rel=1e-12)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"observers": {"A": {"mu1": 0.0}}}, "observer 'A': found mu1, allowed: mu1, sigma_p, sigma_l, q0, all four"),
        ({"observers": {"A": {**ONE, "q0": 1.5}}}, "observers: q0 must lie in 0..1"),
        ({"observers": {}}, "found none"),
        ({"observers": 0}, "allowed: a whole number from 1"),
        ({"population": "mine"}, "allowed: paper, prior; parameters of your own"),
        ({"design": "mine"}, "--design|design"),
        ({"batches": 0}, "batches=0 must be at least 1"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_what_cannot_be_simulated_is_refused(given, said):
    with pytest.raises(bt.InputError, match=said):
        bt.simulate(**given)
