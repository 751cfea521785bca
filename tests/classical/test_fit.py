"""The bootstrap: its resampling, its optima, what is made of them, and Appendix C's evidence."""

import numpy as np
import pytest
from random_starts import best_of_random_starts
from reference.hard_cases import hard_cases
from scipy.stats import norm

import bayes_toe as bt
from bayes_toe.classical.fit import Bootstrap, bootstrap_evidence, bootstrap_subject, resample
from bayes_toe.classical.maximum_likelihood import Fits
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.errors import InputError
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator

CASES = hard_cases()
SUBJECTS = {**CASES, **{subject.name: subject for subject in bt.example_study("same/different")}}


@pytest.fixture(scope="module")
def replicates():
    return bootstrap_subject(SUBJECTS["S01"], seed=3, prior=Prior(), replicates=400)


def made_up(parameters, fitted=(0.1, 0.3, 0.1, 0.9)):
    """A bootstrap with these parameters, (replicates, 4)."""
    rows = [np.asarray(fitted, float)[None], np.asarray(parameters, float)]

    def fits(p):
        n = len(p)
        return Fits(
            p,
            np.full(n, -5.0),
            np.full(n, -5.0),
            np.zeros((n, 7), bool),
            np.ones(n, bool),
            np.zeros((n, 4)),
            SUBJECTS["S01"],
        )

    return Bootstrap("x", fits(rows[0]), fits(rows[1]), 1)


def test_resampled_counts_are_beta_binomial():
    subject = Subject("x", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [50, 20, 0], [50, 50, 10])
    counts = resample(subject, np.random.default_rng(1), 20_000)
    a, b, n = subject.n_yes + 1.0, subject.n_trials - subject.n_yes + 1.0, subject.n_trials
    mean, variance = n * a / (a + b), n * a * b * (a + b + n) / ((a + b) ** 2 * (a + b + 1))
    assert np.abs((counts.mean(axis=0) - mean) / np.sqrt(variance / 20_000)).max() < 4
    assert counts.var(axis=0) == pytest.approx(variance, rel=0.06)
    assert ((counts >= 0) & (counts <= n)).all()


@pytest.mark.parametrize("name", ["S01", "S06", "S07", "S16", "funnel"])
def test_optima_are_those_of_a_loop_over_a_general_optimiser(name):
    subject, count = SUBJECTS[name], 3
    found = bootstrap_subject(subject, seed=1, prior=Prior(), replicates=count).fits
    counts = resample(subject, generator(1, name, "bootstrap"), count)
    for i, row in enumerate(counts):
        other = best_of_random_starts(
            Subject(name, subject.s1, subject.s2, row, subject.n_trials), 3
        )
        assert found.objective[i] >= other - 1e-8


def test_a_study_of_which_is_stronger_has_the_same_table_with_lapses():
    study = bt.example_study(WHICH_STRONGER).select(["S01", "S07"])
    table = bt.fit(study, replicates=100, seed=1, workers=1)
    frame = table.frame().set_index("subject")
    assert list(frame.columns[:6]) == [
        "mu1",
        "sigma_p",
        "sigma_l",
        "lapse_rate",
        "log_likelihood",
        "at_edge",
    ]
    assert (frame.lapse_rate_lower <= frame.lapse_rate).all()
    assert (frame.mu1 < frame.mu1_upper).all()
    low, high = table["S07"].bootstrap.bands(0.0, [-0.3, 0.3])
    assert low[0] < high[0] < 0.5 < low[1] < high[1]


def test_same_seed_same_numbers_whatever_the_workers_and_the_order(small_study):
    one = bt.fit(small_study, replicates=60, seed=5, workers=1)
    two = bt.fit(
        small_study.select(list(small_study.names)[::-1]), replicates=60, seed=5, workers=2
    )
    for row in one:
        assert np.array_equal(
            row.bootstrap.fits.parameters, two[row.subject].bootstrap.fits.parameters
        )
    other = bt.fit(small_study, replicates=60, seed=6, workers=1)
    assert not np.array_equal(
        one.rows[0].bootstrap.fits.parameters, other.rows[0].bootstrap.fits.parameters
    )


def test_intervals_bands_and_covariance_are_those_of_the_replicates(replicates):
    values = replicates.fits.parameters
    for i, (low, high) in enumerate(replicates.intervals(0.9)):
        assert ((values[:, i] >= low) & (values[:, i] <= high)).mean() == pytest.approx(
            0.9, abs=0.01
        )
    subject = SUBJECTS["S01"]
    q = np.array([bt.model.equal_probability(subject.s1, subject.s2, *theta) for theta in values])
    assert replicates.bands(subject.s1, subject.s2) == pytest.approx(
        np.quantile(q, [0.2, 0.8], axis=0), rel=1e-9
    )
    squares = np.column_stack([values[:, 0], values[:, 1] ** 2, values[:, 2] ** 2, values[:, 3]])
    assert replicates.covariance() == pytest.approx(np.cov(squares.T))


def test_evidence_by_appendix_c_is_the_formula():
    rng = np.random.default_rng(2)
    values = np.array([0.1, 0.3, 0.1, 0.9]) + rng.normal(size=(500, 4)) * [0.2, 0.02, 0.01, 0.02]
    made = made_up(values)
    value, note = bootstrap_evidence(made, Prior())
    mu1, v_p, v_l = 0.1, 0.09, 0.01
    squares = np.column_stack([values[:, 0], values[:, 1] ** 2, values[:, 2] ** 2, values[:, 3]])
    # The prior density in (mu1, v_p, v_l, q0) by finite differences of its distribution functions.
    h = 1e-6
    of_p = (norm.cdf(np.sqrt(v_p + h)) - norm.cdf(np.sqrt(v_p - h))) * 2 / (2 * h)
    of_l = ((v_l + h) / v_p - (v_l - h) / v_p) / (2 * h)
    expected = (
        -5.0
        + norm.logpdf(mu1, 0, 10)
        + np.log(of_p * of_l)
        + 0.5 * np.linalg.slogdet(2 * np.pi * np.cov(squares.T))[1]
    )
    assert (value, note) == (pytest.approx(expected, abs=1e-6), "")


def test_evidence_says_what_is_wrong_with_it():
    on_edge = bootstrap_subject(SUBJECTS["S02"], seed=1, prior=Prior(), replicates=200)
    value, note = bootstrap_evidence(on_edge, Prior())
    assert np.isfinite(value)
    assert "gamma=1" in note
    for name, word in (
        ("all equal", "sigma_p=inf"),
        ("single pair", "not unique"),
        ("one batch", "infinite"),
        ("perfect observer", "sigma_p=0"),
    ):
        value, note = bootstrap_evidence(
            bootstrap_subject(CASES[name], seed=1, prior=Prior(), replicates=200), Prior()
        )
        assert value is None
        assert word in note
    same = np.random.default_rng(1).normal(size=(50, 4)) * [1, 0, 0.1, 0.1] + [0, 0.3, 0.5, 0.5]
    value, note = bootstrap_evidence(made_up(same), Prior())
    assert value is None
    assert note.endswith("singular")


def test_posterior_and_bootstrap_side_by_side(analysis):
    table = bt.fit(analysis.study, replicates=200, level=0.8, seed=1, workers=1)
    frame = table.beside(analysis.draws)
    assert len(frame) == 4 * len(analysis.study)
    row = frame[(frame.subject == "A") & (frame.parameter == "q0")].iloc[0]
    assert row.posterior_lower < row.posterior_median < row.posterior_upper
    low, high = np.quantile(analysis.draws.values("A", "q0"), [0.1, 0.9])
    assert (row.posterior_lower, row.posterior_upper) == pytest.approx((low, high))
    assert (row.bootstrap_lower, row.bootstrap_upper) == pytest.approx(
        tuple(table["A"].bootstrap.intervals(0.8)[3])
    )
    with pytest.raises(InputError, match="same subjects"):
        bt.fit(analysis.study.select(["A"]), replicates=5, seed=1, workers=1).beside(analysis.draws)


def test_what_has_no_value_is_missing_and_said_and_wrong_options_raise(small_study):
    open_ = bootstrap_subject(CASES["single pair"], seed=1, prior=Prior(), replicates=50)
    assert np.isnan(open_.intervals()[1:]).all()
    assert open_.covariance() is None
    assert "do not determine a parameter" in open_.remarks()[0]
    blunt = bootstrap_subject(CASES["all equal"], seed=1, prior=Prior(), replicates=200)
    assert blunt.intervals()[1, 1] == np.inf
    assert any("infinite sigma_p" in text for text in blunt.remarks())
    for options in (
        {"replicates": 0},
        {"level": 1.0},
        {"level": float("nan")},
        {"seed": -1},
        {"workers": 0},
    ):
        with pytest.raises(InputError):
            bt.fit(small_study, **options)
