"""One observer in several conditions: gradient, prior of differences, scales, evidence."""

import numpy as np
import pytest
from numpy.random import default_rng
from scipy import stats
from scipy.special import logsumexp, ndtr

import bayes_toe as bt
from bayes_toe.answers.contrast import condition_evidences
from bayes_toe.data.conditions import Conditions
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.model.condition_model import DIFFERENCE_UNITS, ConditionPosterior
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE, task_parameters

S1, S2 = np.array([0.0, 0.3, 0.3, 0.9, 1.2]), np.array([0.3, 0.0, 0.7, 0.5, 1.2])
COUNTS = ((5, 2, 9, 1, 4), (9, 4, 10, 2, 7), (8, 3, 9, 4, 6))


def condition_posterior(
    differing, task=WHICH_STRONGER, *, n_levels=3, s1=S1, s2=S2, counts=COUNTS, n_trials=12
):
    levels = tuple("abc"[:n_levels])
    units = tuple(
        bt.Subject(f"S@{level}", s1, s2, n_yes, [n_trials] * len(s1), task=task, condition=level)
        for level, n_yes in zip(levels, counts, strict=False)
    )
    return ConditionPosterior(units, Conditions("c", levels).design(), differing)


@pytest.mark.parametrize("task", [WHICH_STRONGER, SAME_DIFFERENT])
def test_gradient_and_what_happens_where_nothing_differs(task):
    everything = tuple(DIFFERENCE_UNITS.keys() & set(task_parameters(task)))
    posterior = condition_posterior(everything, task)
    n, k = len(posterior.coordinates), len(task_parameters(task))
    assert n == k + 2 * len(everything)
    points = posterior.starts()[:4] + 0.3 * default_rng(1).standard_normal((4, n))
    value, gradient = posterior.gradient(points)
    np.testing.assert_allclose(value, posterior.log_density(points), rtol=1e-12)
    numeric = np.empty_like(gradient)
    for j, step in enumerate(1e-6 * np.eye(n)):
        ahead, backward = posterior.log_density(points + step), posterior.log_density(points - step)
        numeric[:, j] = (ahead - backward) / 2e-6
    np.testing.assert_allclose(gradient, numeric, rtol=1e-5, atol=1e-5)

    u = points[:, :k]
    identical = posterior.without_differences(u)
    pooled = bt.model.observer.OrderModel("both").posterior(posterior.subject)
    np.testing.assert_allclose(
        posterior.log_likelihood(identical), pooled.log_likelihood(u), rtol=1e-12
    )
    for in_condition in posterior.in_conditions(identical):
        np.testing.assert_array_equal(in_condition, u)


def test_any_two_levels_differ_by_half_a_unit_beforehand():
    posterior = condition_posterior((NOISE, CONSTANT_ERROR, CONTRACTION))
    draws = posterior.sample_prior(default_rng(1), 40_000)
    values = posterior.quantities(draws)
    n_trials = np.full(5, 12.0)
    unequal = S1 != S2
    step = np.sqrt(np.average(np.square(S2 - S1)[unequal], weights=n_trials[unequal]))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        for key, expected in (("constant_error", step / 4.0), ("contraction", 0.125)):
            assert (values[key][i] - values[key][j]).std() == pytest.approx(expected, rel=0.02)
        log_ratio = np.log(values["jnd"][i] / values["jnd"][j])
        assert log_ratio.std() == pytest.approx(0.5, rel=0.02)


def test_the_evidence_by_quadrature():
    """One pair in either order, so that few parameters matter, against a grid over all of them."""
    s1, s2 = np.array([-0.5, 0.5]), np.array([0.5, -0.5])
    posterior = condition_posterior(
        (), n_levels=2, s1=s1, s2=s2, counts=((15, 4), (19, 9)), n_trials=20
    )
    evidences, _ = condition_evidences(posterior, seed=1)
    (evidence,) = (row for row in evidences if row.differing == {CONSTANT_ERROR})

    # Stimuli about sbar = 0 in units of D = 1; R = 1/2; middle 0, so that no slope matters.
    u = np.linspace(-4.5, 4.5, 19)
    normal = stats.norm.logpdf(u) + np.log(u[1] - u[0])
    # c by quantiles of its prior, as the tails of Student's t are long.
    share = (np.arange(40) + 0.5) / 40
    c = 0.5 * stats.t(3).ppf(share)
    log_noise, lapse, p, a, shift = np.meshgrid(0.7 * u, u, 0.25 * u, u, c, indexing="ij")
    log_weight = sum(
        np.meshgrid(normal, normal, normal, normal, -np.log(40.0 + 0.0 * c), indexing="ij")
    )
    lapse_rate = 1.0 - ndtr(-lapse) ** (1.0 / 9.0)
    value = log_weight + np.where(np.abs(p) < 1.0, 0.0, -np.inf)
    for side, counts in ((-0.5, (15, 4)), (0.5, (19, 9))):
        c_here = shift + 0.5 * 0.5 * side * a
        for first, second, n_second in zip(s1, s2, counts, strict=True):
            z = (second - first - c_here + p * first) / np.exp(log_noise)
            p_second = 0.5 * lapse_rate + (1.0 - lapse_rate) * ndtr(z)
            value = value + n_second * np.log(p_second) + (20 - n_second) * np.log1p(-p_second)
    assert evidence.log_evidence == pytest.approx(logsumexp(value), abs=4.0 * evidence.se + 0.01)
