"""The prior of a group: scores of its half-normal densities, and its files."""

import numpy as np
import pytest
from scipy import stats

import bayes_toe as bt
from bayes_toe.model.densities import from_half_normal_score, half_normal_score
from bayes_toe.model.prior import Hyperprior, ParameterHyperprior
from bayes_toe.model.prior_file import hyperprior_from


def test_a_difference_is_half_as_wide_as_a_mean():
    # Both scales of q0 are 1. A difference is 0 on average.
    assert Hyperprior().q0.difference == ParameterHyperprior(0.0, 0.5, 0.5)


def test_scores_of_a_half_normal_reach_far_into_both_tails():
    """The probability of a half-normal value below u is Phi(score): 2 Phi(u) - 1 = Phi(score)."""
    low, high = np.array([-30.0, -8.0]), np.array([8.0, 30.0])
    middle = np.array([-1.0, 0.0, 1e-9, 3.0])
    # Phi(u) - 1/2 = Phi(score) / 2 is u / sqrt(2 pi) near 0.
    expected = np.sqrt(0.5 * np.pi) * stats.norm.cdf(low)
    assert from_half_normal_score(low) == pytest.approx(expected, rel=1e-12)
    expected = stats.halfnorm.ppf(stats.norm.cdf(middle))
    assert from_half_normal_score(middle) == pytest.approx(expected, rel=1e-12)
    # Far above, 2 (1 - Phi(u)) = 1 - Phi(score).
    u = from_half_normal_score(high)
    assert stats.norm.logsf(u) + np.log(2.0) == pytest.approx(stats.norm.logsf(high))
    for score in (middle, high):
        assert half_normal_score(from_half_normal_score(score)) == pytest.approx(score, abs=1e-8)


@pytest.mark.parametrize("prefix", ["", "group."])
def test_a_file_changes_what_it_names(tmp_path, prefix):
    """All other numbers of the hyperprior keep their defaults."""
    path = tmp_path / "wide.toml"
    text = f"[{prefix}contraction]\nmean_scale = 0.6\n[{prefix}q0]\nmean = 2\n"
    path.write_text(text)
    contraction = ParameterHyperprior(0.0, 0.6, 0.15)
    q0 = ParameterHyperprior(2.0, 1.0, 1.0)
    assert hyperprior_from(path) == bt.Hyperprior(contraction=contraction, q0=q0)
