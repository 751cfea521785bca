"""The bootstrap: its resampling, its optima, and what is made of them."""

from itertools import product

import numpy as np
import pytest
from conftest import made_subject
from numpy.random import default_rng
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.classical.fit import SubjectFit, resample, subject_fit
from bayes_toe.classical.maximum_likelihood import MaximumLikelihoodFits
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.errors import InputError
from bayes_toe.model.prior import Prior

CASES = hard_cases()
SUBJECTS = {**CASES, **{subject.name: subject for subject in bt.example_study("same/different")}}


@pytest.fixture(scope="module")
def replicates():
    return subject_fit(SUBJECTS["S01"], Prior(), seed=3, replicates=400)


def make_bootstrap(replicates, fitted=(0.1, 0.3, 0.1, 0.9)):
    """A bootstrap with these parameters, (replicates, 4)."""

    def fits(parameters):
        n = len(parameters)
        value, edges, arrived = np.full(n, -5.0), {"q0=1": np.zeros(n, bool)}, np.ones(n, bool)
        points = np.zeros((n, 4))
        subject = SUBJECTS["S01"]
        return MaximumLikelihoodFits(parameters, value, value, edges, arrived, points, subject)

    return SubjectFit("x", fits(np.array([fitted])), fits(replicates))


def test_resampled_counts_are_beta_binomial():
    subject = made_subject("0 0 50 50, 0 0.3 20 50, 0.3 0 0 10")
    counts = resample(subject, default_rng(1), 20_000)
    a, b, n = subject.n_yes + 1.0, subject.n_trials - subject.n_yes + 1.0, subject.n_trials
    mean, variance = n * a / (a + b), n * a * b * (a + b + n) / ((a + b) ** 2 * (a + b + 1))
    assert np.abs((counts.mean(axis=0) - mean) / np.sqrt(variance / 20_000)).max() < 4
    assert counts.var(axis=0) == pytest.approx(variance, rel=0.06)
    assert ((counts >= 0) & (counts <= n)).all()


def test_a_study_of_which_is_stronger_has_the_same_table_with_lapses():
    study = bt.example_study(WHICH_STRONGER).select(["S01", "S08"])
    table = bt.fit(study, replicates=100, seed=1, workers=1)
    frame = table.frame(full=True).set_index("subject")
    natural = ["mu1", "sigma_p", "sigma_l", "lapse_rate"]
    assert list(frame.columns[:6]) == [*natural, "log_likelihood", "at_edge"]
    assert frame.loc["S08", natural].tolist() == table["S08"].parameters.tolist()
    limits = [f"{name}_{end}" for name, end in product(natural, ("lower", "upper"))]
    intervals = table["S08"].intervals(0.95)
    assert frame.loc["S08", limits].tolist() == intervals.ravel().tolist()
    low, high = table["S08"].bands(0.0, [-0.3, 0.3])
    assert low[0] < high[0] < 0.5 < low[1] < high[1]


def test_same_seed_same_numbers_whatever_the_workers_and_the_order(small_study):
    reverse = small_study.select(list(small_study.names)[::-1])
    plain = bt.fit(small_study, replicates=60, seed=5, workers=1).frame(full=True)
    other_order = bt.fit(reverse, replicates=60, seed=5, workers=2).frame(full=True)
    assert other_order[::-1].reset_index(drop=True).equals(plain)
    assert not bt.fit(small_study, replicates=60, seed=6, workers=1).frame(full=True).equals(plain)


def test_intervals_and_bands_are_those_of_the_replicates(replicates):
    values = replicates.fits.parameters
    low, high = replicates.intervals(0.9).T
    is_inside = (values >= low) & (values <= high)
    assert is_inside.mean(axis=0) == pytest.approx(np.full(4, 0.9), abs=0.01)
    subject = SUBJECTS["S01"]
    q = np.array([bt.model.equal_probability(subject.s1, subject.s2, *theta) for theta in values])
    bands = replicates.bands(subject.s1, subject.s2)
    assert bands == pytest.approx(np.quantile(q, [0.2, 0.8], axis=0), rel=1e-9)


@pytest.mark.parametrize("mu1", [-9.0, 9.0])
def test_a_fit_outside_its_interval_is_said_to_be_so(mu1):
    values = np.array([0.1, 0.3, 0.1, 0.9]) + default_rng(2).normal(size=(50, 4)) / 10
    (remark,) = make_bootstrap(values, (mu1, 0.3, 0.1, 0.9)).notes
    assert remark.startswith("outside the 95 % interval: mu1, because")


def test_posterior_and_bootstrap_side_by_side(analysis):
    table = bt.fit(analysis.study, replicates=200, level=0.8, seed=1, workers=1)
    frame = table.compare_with(analysis.draws).set_index(["subject", "parameter"])
    assert len(frame) == 4 * len(analysis.study)
    row = frame.loc["A", "q0"].drop("at_edge").astype(float)
    quantiles = np.quantile(analysis.draws.values("A", "q0"), [0.5, 0.1, 0.9])
    fit = table["A"]
    expected = [*quantiles, fit.parameters[3], *fit.intervals(0.8)[3]]
    assert row.tolist() == pytest.approx(expected)
    fits = bt.fit(analysis.study.select(["A"]), replicates=5, seed=1, workers=1)
    with pytest.raises(InputError, match="same subjects"):
        fits.compare_with(analysis.draws)


def test_what_has_no_value_is_missing_and_said_and_wrong_options_raise(small_study):
    open_ = subject_fit(CASES["single pair"], Prior(), seed=1, replicates=50)
    assert np.isnan(open_.intervals()[1:]).all()
    assert open_.notes[0] == "not determined by these answers: sigma_p, sigma_l, q0"
    assert open_.notes[1] == "no bootstrap replicate determines every parameter"
    blunt = subject_fit(CASES["all equal"], Prior(), seed=1, replicates=200)
    assert blunt.intervals()[1, 1] == np.inf
    assert any("infinite sigma_p" in text for text in blunt.notes)
    for options in ({"replicates": 0}, {"level": 1.0}, {"seed": -1}, {"workers": 0}):
        with pytest.raises(InputError):
            bt.fit(small_study, **options)
