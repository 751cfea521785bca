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
from bayes_toe.comparison.prior_sensitivity import REWEIGHTED, SensitivityRow, SensitivityTable, sensitivity_columns, weighted_quantiles
from bayes_toe.data.conditions import Stimuli
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.model.free_frequencies import frequency_evidence

CASES = hard_cases()
HARD = ["funnel", "perfect observer"]  # a single pair is known by hand, below


@pytest.fixture(scope="module")
def table(small_study):
    """Three ordinary subjects over the default range."""
    return bt.sensitivity(small_study, steps=5, seed=5, prior="paper", workers=1)


def distinct(rows):
    """Rows without the repeats of the prior itself."""
    return [row for row in rows if row.varied == "mu1_sd" or row.prior != bt.Prior()]


@pytest.fixture(scope="module")
def hard():
    """Hard cases over the default range."""
    return bt.sensitivity(bt.Study([CASES[name] for name in HARD]), steps=3, seed=6, prior="paper", workers=1)


def fresh(subject, row):
    """Evidence and draws of a proposal fitted under the row's own prior, from a stream of its own."""
    fitted = fit_proposal(bt.model.posterior_of(subject, row.prior), np.random.default_rng(77))
    estimate = importance_evidence(fitted)
    value, error, why_not = estimate.value, estimate.se, estimate.why_not
    assert not why_not
    return fitted, value - frequency_evidence(subject), error


def z_scores(rows, subject_of):
    found = []
    for row in rows:
        _, value, error = fresh(subject_of(row.subject), row)
        found.append((row.log_bayes_factor - value) / np.hypot(row.se, error))
    return np.array(found)


def test_reweighted_evidence_is_that_of_fresh_fits(table, small_study):
    rows = [row for row in distinct(table) if row.method == REWEIGHTED and row.factor not in (0.5, 2.0)][::3]
    assert len(rows) >= 8
    z = z_scores(rows, lambda name: small_study[name])
    # about 8 rows share three sets of draws; 4.5 standard errors: a false alarm in about 6,000 such tests
    assert np.abs(z).max() < 4.5
    assert np.sqrt(np.mean(z**2)) < 1.8


def test_hard_cases_agree_with_fresh_fits(hard):
    rows = [row for row in distinct(hard) if row.log_bayes_factor is not None]
    assert len(rows) >= 0.9 * len(distinct(hard))
    rows = [row for row in rows if row.prior != bt.Prior()][::5]  # of both, at both ends
    z = z_scores(rows, lambda name: CASES[name])
    worst = rows[int(np.abs(z).argmax())]
    assert np.abs(z).max() < 5.0, (worst.subject, worst.varied, worst.value, worst.method, z)


def test_rows_of_bad_weights_are_sampled_anew_or_withheld(table, hard):
    for row in (*table, *hard):
        assert (row.log_bayes_factor is None) == (row.pareto_k > 0.7) == bool(np.isnan(row.quantiles).any())


def test_medians_are_those_of_draws_under_that_prior(table, small_study):
    for name, varied, at in (("A", "mu1_sd", 0), ("B", "sigma_p_scale", -1), ("C", "mu1_sd", -1)):
        row = table.of(name, varied)[at]
        draws = bt.sample(small_study.select([name]), draws=4000, seed=3, prior=row.prior, workers=1)
        for i, parameter in enumerate(("mu1", "sigma_p", "sigma_l", "q0", "gain")):
            values = draws.values(name, parameter).ravel()
            low, middle, high = row.quantiles[i]
            # the share of draws below a quantile; 4,000 draws of each kind: a standard error below 0.012
            shares = [(values < limit).mean() for limit in (low, middle, high)]
            assert np.allclose(shares, [0.05, 0.5, 0.95], atol=0.05), (name, varied, parameter, shares)


def test_the_middle_row_is_the_evidence_table(table, analysis):
    for row in analysis.evidence:
        for varied in table.varied:
            middle = next(found for found in table.of(row.subject, varied) if getattr(found.prior, varied) == getattr(bt.Prior(), varied))
            assert middle.log_bayes_factor == pytest.approx(row.log_bayes_factor, abs=2.0 * row.log_evidence_h1_se)


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
        of_gamma = quad(given, 0, 1, (sigma_p,), epsabs=1e-12, weight="alg", wvar=(a - 1, b - 1))[0] / beta(a, b)
        return of_gamma * np.sqrt(2 / np.pi) * np.exp(-(t**2) / 2)

    return np.log(quad(over_gamma, 0, 10, epsabs=1e-10, limit=200)[0])


def test_evidence_of_a_case_that_is_known_by_hand():
    subject = bt.Subject("S", [0.4], [0.4], [6], [6])
    table = bt.sensitivity(bt.Study([subject]), prior=bt.Prior(0.5, 2.0, 0.3), steps=3, seed=4, workers=1)
    known = {prior: exact_all_equal(prior, 0.4, 6) - frequency_evidence(subject) for prior in {row.prior for row in table}}
    exact = np.array([known[row.prior] for row in table])
    found = np.array([row.log_bayes_factor for row in table])
    error = np.array([row.se for row in table])
    assert np.ptp(exact) > 1.0  # the prior matters here
    assert np.all(np.abs(found - exact) < 4.5 * error)


def test_the_table_has_its_columns_and_is_written(table, tmp_path):
    frame = pd.read_csv(table.save(tmp_path / "sensitivity.csv"), dtype={"subject": str})
    assert tuple(frame.columns) == sensitivity_columns()
    assert len(frame) == 3 * 7 * 5
    assert set(frame["varied"]) == {*table.varied} == {"mu1_sd", "sigma_p_scale", "gamma_a", "gamma_b", "q0_a", "q0_b", "mu1_mean"}
    assert frame["factor"][frame["varied"] == "mu1_mean"].isna().all()
    scales = frame[frame["varied"].isin(table.scales)]
    assert np.allclose(sorted(set(scales["factor"].round(9))), [0.25, 0.5, 1.0, 2.0, 4.0])
    for name, group in frame.groupby("subject"):
        assert all(np.diff(values["value"]).min() > 0 for _, values in group.groupby("varied")), name
    assert (frame["mu1_q05"] < frame["mu1_q50"]).all()
    assert frame["prior"].str.startswith("mu1 ~ Normal(").all()


def made(values, varied="mu1_sd", start=1.0):
    rows = []
    for i, value in enumerate(values):
        prior = bt.Prior(**{varied: start * 2.0**i}) if varied != "mu1_mean" else bt.Prior(mu1_mean=start + i)
        error = None if value is None else 0.01
        rows.append(SensitivityRow("S", varied, 2.0**i, prior, value, error, 0.1, REWEIGHTED, np.zeros((5, 3))))
    return rows


def test_turning_points_are_interpolated_and_gaps_are_not_bridged():
    rows = [*made([2.0, 1.0, -1.0, -3.5]), *made([1.0, None, -1.0], "sigma_p_scale"), *made([-1.0, 3.0], "mu1_mean")]
    table = SensitivityTable(tuple(rows), bt.Prior(mu1_sd=1.0), 1)
    assert table.turns("S", "mu1_sd") == pytest.approx([2.0**1.5])
    assert table.turns("S", "mu1_sd", -3.0) == pytest.approx([2.0 ** (2 + 0.8)])
    assert table.turns("S", "sigma_p_scale") == ()
    assert table.turns("S", "mu1_mean") == pytest.approx([1.25])
    (line,) = table.summary()
    assert "turns at mu1_sd = 2.83" in line
    assert "passes -3 nats at mu1_sd = 6.96" in line
    assert "no reliable value at sigma_p_scale = 2" in line
    assert line.endswith("does not turn within sigma_p_scale = 1..4")
    with pytest.raises(bt.InputError, match="no rows of subject 'T'"):
        table.of("T", "mu1_sd")


def test_weighted_quantiles_are_those_of_repeated_values():
    rng = np.random.default_rng(2)
    values, repeats = rng.normal(size=400), rng.integers(1, 5, 400)
    found = weighted_quantiles(values, repeats.astype(float), [0.05, 0.5, 0.95])
    assert np.allclose(found, np.quantile(np.repeat(values, repeats), [0.05, 0.5, 0.95]), atol=0.03)


def test_same_seed_same_numbers_whatever_the_workers_and_the_company(table, small_study):
    again, frame = bt.sensitivity(small_study.select(["C"]), steps=5, seed=5, prior="paper", workers=2).frame(), table.frame()
    pd.testing.assert_frame_equal(again, frame[frame["subject"] == "C"].reset_index(drop=True))


@pytest.mark.parametrize("bad", [{"reach": 1.0}, {"reach": np.nan}, {"reach": 1e7}, {"steps": 4}, {"steps": 1}, {"steps": 1001}])
def test_ranges_that_cannot_be_walked(small_study, bad):
    with pytest.raises(bt.InputError, match="allowed"):
        bt.sensitivity(small_study, **bad)


def test_figures_show_every_value_and_mark_the_turns(table):
    rows = [*made([2.0, 1.0, -1.0, -3.5]), *made([1.0, None, -1.0], "sigma_p_scale"), *made([-1.0, 3.0], "mu1_mean")]
    turning = SensitivityTable(tuple(rows), bt.Prior(mu1_sd=1.0), 1)
    ax = bt.plots.sensitivity_figure(turning).axes[0]
    crosses = [line for line in ax.lines if line.get_marker() == "x"]
    # Across are factors; the mean, from 1 to 2 about 0, stands as far to the right as it is shifted, with 8 at the end.
    assert [np.ravel(line.get_xdata())[0] for line in crosses if np.size(line.get_xdata())] == pytest.approx([2**1.5, 8 ** (1.25 / 2)])
    alone = SensitivityTable(tuple(row for row in table if row.subject == "A"), table.prior, table.seed)
    require_legible(bt.plots.sensitivity_figure(alone, synthetic=True))
    figure = bt.plots.sensitivity_figure(table)
    assert [ax.get_title() for ax in figure.axes] == ["A", "B", "C"]
    for ax, name in zip(figure.axes, "ABC", strict=True):
        shown = np.concatenate([line.get_ydata() for line in ax.lines if line.get_marker() in ("o", "s", "v")])
        assert len(shown) == 15
        low, high = ax.get_ylim()
        assert np.all((shown > low) & (shown < high)), name
        assert all(a < b for a, b in pairwise(ax.get_xticks()))
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words[:7] == [
        *("sd of mu1", "scale of sigma_p", "a of gamma", "b of gamma", "a of q0", "b of q0"),
        "mean of mu1, from −10 to 10",
    ]
    assert "within 3 nats of 0: not strong" in words


def test_the_default_prior_is_varied_about_the_numbers_of_each_subject(small_study):
    here = small_study["B"]
    there = replace(here, name="C", s1=3.0 * here.s1 + 2.0, s2=3.0 * here.s2 + 2.0)
    table = bt.sensitivity(bt.Study([here, there]), steps=3, seed=5, workers=1)
    assert table.varied == ("mu1_sd", "width_median", "width_sd", "gamma_a", "gamma_b", "q0_a", "q0_b", "mu1_mean")
    for one in (here, there):
        stimuli = Stimuli.of(one)
        assert [row.value for row in table.of(one.name, "mu1_sd")] == pytest.approx([2.5 * stimuli.sd * k for k in (0.25, 1.0, 4.0)])
        assert table.given(one.name, "mu1_mean") == stimuli.mean
    # What is the same in any unit: evidence, but for its noise, and values over those of the stimuli.
    for a, b in zip(table.of("B", "mu1_mean"), table.of("C", "mu1_mean"), strict=True):
        assert a.log_bayes_factor == pytest.approx(b.log_bayes_factor, abs=4.5 * np.hypot(a.se, b.se))
    words = [text.get_text() for text in bt.plots.sensitivity_figure(table).legends[0].get_texts()]
    assert words[7:9] == ["mean of mu1, shifted by its sd", "the prior given"]
