"""Re-weighted evidences and posteriors against fresh fits, closed forms and deterministic integration."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from legible import require_legible
from reference.hard_cases import hard_cases
from scipy.integrate import quad
from scipy.special import beta

import bayes_toe as bt
from bayes_toe.comparison.prior_sensitivity import (
    REWEIGHTED,
    SensitivityRow,
    SensitivityTable,
    sensitivity_columns,
    weighted_quantiles,
)
from bayes_toe.data.conditions import Stimuli
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.model.free_frequencies import frequency_evidence

HARD = bt.Study(
    [hard_cases()[name] for name in ("funnel", "perfect observer")]
)  # a single pair is known by hand, below


@pytest.fixture(scope="module")
def table(small_study):
    """Three ordinary subjects at the ends and in the middle of the default range."""
    return bt.sensitivity(small_study, steps=3, seed=5, prior="paper", workers=1)


@pytest.fixture(scope="module")
def hard():
    return bt.sensitivity(HARD, steps=3, seed=6, prior="paper", workers=1)


def z_score(row, subject):
    """Of its evidence against that of a proposal fitted under the row's own prior, from a stream of its own."""
    fresh = importance_evidence(
        fit_proposal(bt.model.posterior_of(subject, row.prior), np.random.default_rng(77))
    )
    assert not fresh.why_not
    return (row.log_bayes_factor + frequency_evidence(subject) - fresh.value) / np.hypot(
        row.se, fresh.se
    )


def test_evidence_is_that_of_fresh_fits(table, hard, small_study):
    """About 16 rows share five sets of draws; 4.5 standard errors: a false alarm in about 6,000 such tests."""
    ordinary = [
        row
        for row in table
        if row.value != getattr(bt.Prior(), row.varied) and row.method == REWEIGHTED
    ]
    difficult = [
        row
        for row in hard
        if row.value != getattr(bt.Prior(), row.varied) and row.log_bayes_factor is not None
    ]
    assert len(difficult) >= 25  # of 28
    rows = [(row, small_study[row.subject]) for row in ordinary[::4]] + [
        (row, HARD[row.subject]) for row in difficult[::5]
    ]
    assert len(rows) >= 12
    z = np.array([z_score(*one) for one in rows])
    assert np.abs(z).max() < 4.5, rows[int(np.abs(z).argmax())]
    assert np.sqrt(np.mean(z**2)) < 1.8


def test_rows_of_bad_weights_are_sampled_anew_or_withheld(table, hard):
    for row in (*table, *hard):
        assert (
            (row.log_bayes_factor is None)
            == (row.pareto_k > 0.7)
            == bool(np.isnan(row.quantiles).any())
        )


@pytest.mark.parametrize(("name", "varied", "at"), [("A", "mu1_sd", 0), ("B", "sigma_p_scale", -1)])
def test_quantiles_are_those_of_draws_under_that_prior(table, small_study, name, varied, at):
    """The share of draws below a quantile; 4,000 draws of each kind: a standard error below 0.012."""
    row = table.of(name, varied)[at]
    draws = bt.sample(small_study.select([name]), draws=4000, seed=3, prior=row.prior, workers=1)
    for parameter, limits in zip(
        ("mu1", "sigma_p", "sigma_l", "q0", "gain"), row.quantiles, strict=True
    ):
        shares = (draws.values(name, parameter).reshape(-1, 1) < limits).mean(axis=0)
        assert np.allclose(shares, [0.05, 0.5, 0.95], atol=0.05), (parameter, shares)


def test_the_middle_row_is_the_evidence_table(table, analysis):
    for row in analysis.evidence:
        for varied in table.varied:
            middle = table.of(row.subject, varied)[1]
            assert middle.value == getattr(bt.Prior(), varied)
            assert middle.log_bayes_factor == pytest.approx(
                row.log_bayes_factor, abs=2.0 * row.log_evidence_h1_se
            )


def exact_all_equal(prior, s, n):
    """Log evidence of n answers 'equal' to (s, s): q0 and mu1 by hand, gamma and sigma_p by quadrature.

    z = -p (mu1 - s)/w, so the likelihood is q0^n exp(-n ln2 (p/w)^2 (mu1 - s)^2).
    """

    def given(gamma, sigma_p):
        ratio = (1 + np.sqrt(1 + 4 * gamma)) / 2
        a = n * np.log(2) * (gamma / ratio**2 / (sigma_p * ratio**1.5)) ** 2
        spread = 1 + 2 * a * prior.mu1_sd**2
        of_q0 = beta(prior.q0_a + n, prior.q0_b) / beta(prior.q0_a, prior.q0_b)
        return np.exp(-a * (prior.mu1_mean - s) ** 2 / spread) / np.sqrt(spread) * of_q0

    def over_gamma(t):
        sigma_p = prior.sigma_p_scale * t
        a, b = prior.gamma_a, prior.gamma_b
        of_gamma = quad(given, 0, 1, (sigma_p,), epsabs=1e-12, weight="alg", wvar=(a - 1, b - 1))[
            0
        ] / beta(a, b)
        return of_gamma * np.sqrt(2 / np.pi) * np.exp(-(t**2) / 2)

    return np.log(quad(over_gamma, 0, 10, epsabs=1e-10, limit=200)[0])


def test_evidence_of_a_case_that_is_known_by_hand():
    subject = bt.Subject("S", [0.4], [0.4], [6], [6])
    table = bt.sensitivity(
        bt.Study([subject]), prior=bt.Prior(0.5, 2.0, 0.3), steps=3, seed=4, workers=1
    )
    rows = [
        table.default("S"),
        *(table.of("S", varied)[i % 2 * 2] for i, varied in enumerate(table.varied)),
    ]
    exact = np.array(
        [exact_all_equal(row.prior, 0.4, 6) - frequency_evidence(subject) for row in rows]
    )
    assert np.ptp(exact) > 1.0  # the prior matters here
    assert (
        np.abs([row.log_bayes_factor for row in rows] - exact)
        < 4.5 * np.array([row.se for row in rows])
    ).all()


def test_the_table_has_its_columns_and_is_written(table, tmp_path):
    frame = pd.read_csv(table.save(tmp_path / "sensitivity.csv"), dtype={"subject": str})
    assert tuple(frame.columns) == sensitivity_columns()
    varied = ("mu1_sd", "sigma_p_scale", "gamma_a", "gamma_b", "q0_a", "q0_b", "mu1_mean")
    assert frame[["subject", "varied"]].to_numpy().tolist() == [
        [name, key] for name in "ABC" for key in varied for _ in range(3)
    ]
    factors = [[np.nan] * 3 if key == "mu1_mean" else [0.25, 1.0, 4.0] for key in varied] * 3
    assert frame["factor"].to_numpy() == pytest.approx(np.ravel(factors), nan_ok=True)
    assert (frame.groupby(["subject", "varied"])["value"].diff().dropna() > 0).all()
    assert (frame["mu1_q05"] < frame["mu1_q50"]).all()
    assert frame["prior"].str.startswith("mu1 ~ Normal(").all()


def made(values, varied="mu1_sd"):
    rows = []
    for i, value in enumerate(values):
        prior = bt.Prior(**{varied: 1.0 + i if varied == "mu1_mean" else 2.0**i})
        error = None if value is None else 0.01
        rows.append(
            SensitivityRow(
                "S", varied, 2.0**i, prior, value, error, 0.1, REWEIGHTED, np.zeros((5, 3))
            )
        )
    return rows


@pytest.fixture
def turning():
    rows = [
        *made([2.0, 1.0, -1.0, -3.5]),
        *made([1.0, None, -1.0], "sigma_p_scale"),
        *made([-1.0, 3.0], "mu1_mean"),
    ]
    return SensitivityTable(tuple(rows), bt.Prior(mu1_sd=1.0), 1)


def test_turning_points_are_interpolated_and_gaps_are_not_bridged(turning):
    assert turning.turns("S", "mu1_sd") == pytest.approx([2.0**1.5])
    assert turning.turns("S", "mu1_sd", -3.0) == pytest.approx([2.0 ** (2 + 0.8)])
    assert turning.turns("S", "sigma_p_scale") == ()
    assert turning.turns("S", "mu1_mean") == pytest.approx([1.25])
    (line,) = turning.summary()
    assert "turns at mu1_sd = 2.83" in line
    assert "passes -3 nats at mu1_sd = 6.96" in line
    assert "no reliable value at sigma_p_scale = 2" in line
    assert line.endswith("does not turn within sigma_p_scale = 1..4")
    with pytest.raises(bt.InputError, match="no rows of subject 'T'"):
        turning.of("T", "mu1_sd")


def test_weighted_quantiles_are_those_of_repeated_values():
    rng = np.random.default_rng(2)
    values, repeats = rng.normal(size=400), rng.integers(1, 5, 400)
    found = weighted_quantiles(values, repeats.astype(float), [0.05, 0.5, 0.95])
    assert np.allclose(found, np.quantile(np.repeat(values, repeats), [0.05, 0.5, 0.95]), atol=0.03)


def test_same_seed_same_numbers_whatever_the_workers_and_the_company(table, small_study):
    again, frame = (
        bt.sensitivity(
            small_study.select(["C"]), steps=3, seed=5, prior="paper", workers=2
        ).frame(),
        table.frame(),
    )
    pd.testing.assert_frame_equal(again, frame[frame["subject"] == "C"].reset_index(drop=True))


@pytest.mark.parametrize(
    "bad",
    [
        {"reach": 1.0},
        {"reach": np.nan},
        {"reach": 1e7},
        {"steps": 4},
        {"steps": 1},
        {"steps": 1001},
    ],
)
def test_ranges_that_cannot_be_walked(small_study, bad):
    with pytest.raises(bt.InputError, match="allowed"):
        bt.sensitivity(small_study, **bad)


def test_figures_show_every_value_and_mark_the_turns(table, turning):
    crosses = [
        line
        for line in bt.plots.sensitivity_figure(turning).axes[0].lines
        if line.get_marker() == "x"
    ]
    # Across are factors; the mean, from 1 to 2 about 0, stands as far to the right as it is shifted, with 8 at the end.
    assert [
        np.ravel(line.get_xdata())[0] for line in crosses if np.size(line.get_xdata())
    ] == pytest.approx([2**1.5, 8 ** (1.25 / 2)])
    alone = SensitivityTable(
        tuple(row for row in table if row.subject == "A"), table.prior, table.seed
    )
    one = bt.plots.sensitivity_figure(alone, synthetic=True)
    require_legible(one)  # which draws it
    assert (
        one.axes[0].get_window_extent().height > 0.6 * one.bbox.height
    )  # the words do not take its place
    figure = bt.plots.sensitivity_figure(table)
    assert [ax.get_title() for ax in figure.axes] == ["A", "B", "C"]
    for ax in figure.axes:
        shown = np.concatenate(
            [line.get_ydata() for line in ax.lines if line.get_marker() in ("o", "s", "v")]
        )
        assert len(shown) == 9
        low, high = ax.get_ylim()
        assert ((shown > low) & (shown < high)).all()
        assert all(a < b for a, b in pairwise(ax.get_xticks()))
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words[:6] == [
        "sd of mu1",
        "scale of sigma_p",
        "a of gamma",
        "b of gamma",
        "a of q0",
        "b of q0",
    ]
    assert words[6] == "mean of mu1, from −10 to 10"
    assert "within 3 nats of 0: not strong" in words


def test_the_default_prior_is_varied_about_the_numbers_of_each_subject(small_study):
    here = small_study["B"]
    there = replace(here, name="C", s1=3.0 * here.s1 + 2.0, s2=3.0 * here.s2 + 2.0)
    table = bt.sensitivity(bt.Study([here, there]), steps=3, seed=5, workers=1)
    assert table.varied == (
        "mu1_sd",
        "width_median",
        "width_sd",
        "gamma_a",
        "gamma_b",
        "q0_a",
        "q0_b",
        "mu1_mean",
    )
    for one in (here, there):
        stimuli = Stimuli.of(one)
        assert [row.value for row in table.of(one.name, "mu1_sd")] == pytest.approx(
            [2.5 * stimuli.sd * k for k in (0.25, 1.0, 4.0)]
        )
        assert table.given(one.name, "mu1_mean") == stimuli.mean
    # What is the same in any unit: evidence, but for its noise, and values over those of the stimuli.
    for a, b in zip(table.of("B", "mu1_mean"), table.of("C", "mu1_mean"), strict=True):
        assert a.log_bayes_factor == pytest.approx(
            b.log_bayes_factor, abs=4.5 * np.hypot(a.se, b.se)
        )
    words = [text.get_text() for text in bt.plots.sensitivity_figure(table).legends[0].get_texts()]
    assert words[7:9] == ["mean of mu1, shifted by its sd", "the prior given"]
