"""Prior quantiles against samples of the prior; contraction where it is known."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.model.coordinates import quantities
from bayes_toe.model.prior import prior_quantile
from bayes_toe.model.target import contraction

PRIOR = bt.Prior(0.4, 2.5, 0.3)
TARGET = bt.posterior_of(bt.Subject("S", [0.0, 0.0], [0.0, 0.3], [9, 4], [10, 10]), PRIOR)
PARAMETERS = TARGET.names.reported


@pytest.fixture(scope="module")
def sampled():
    return quantities(PRIOR.sample(np.random.default_rng(3), 400_000), 0.0)


@pytest.mark.parametrize("parameter", PARAMETERS)
@pytest.mark.parametrize("probability", [0.05, 0.5, 0.95])
def test_quantiles_are_those_of_prior_draws(sampled, parameter, probability):
    below = (sampled[parameter] < prior_quantile(PRIOR, parameter, probability)).mean()
    # 4.5 standard errors of a share: 24 comparisons, a false alarm in about 6,000 such tests
    assert below == pytest.approx(probability, abs=4.5 * np.sqrt(probability * (1 - probability) / 400_000))


@pytest.mark.parametrize("parameter", PARAMETERS)
def test_prior_draws_have_no_contraction(sampled, parameter):
    assert contraction(TARGET, parameter, *np.quantile(sampled[parameter], [0.05, 0.95])) == pytest.approx(0.0, abs=0.02)


def test_for_normal_densities_it_is_one_minus_the_ratio_of_variances():
    half_width = 1.6448536269514722 * 0.5
    assert contraction(TARGET, "mu1", 1.0 - half_width, 1.0 + half_width) == pytest.approx(1.0 - 0.5**2 / 2.5**2, rel=1e-12)


def test_a_point_is_all_contraction_and_a_wider_range_is_negative():
    assert contraction(TARGET, "q0", 0.7, 0.7) == 1.0
    assert contraction(TARGET, "gamma", 0.01, 0.99) < 0.0


def test_the_summary_says_what_the_prior_rules(small_study):
    # one trial a pair tells nearly nothing of gamma; fifty thousand tell everything
    s1, s2 = small_study["A"].s1, small_study["A"].s2
    few = bt.Subject("few", s1, s2, np.ones(len(s1), int), np.ones(len(s1), int))
    many = bt.Subject("many", s1, s2, 1000 * small_study["A"].n_equal, 1000 * small_study["A"].n_trials)
    summary = bt.sample(bt.Study([few, many]), draws=500, seed=1, workers=1).summary()
    assert "contraction" in summary.columns
    of = summary.set_index(["subject", "parameter"])["contraction"]
    assert (of["many"] > 0.99).all()
    assert of["few"]["gamma"] < 0.3
    assert (of["few"] < of["many"]).all()
