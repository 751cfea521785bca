"""The penalised likelihood of many count vectors against the log posterior's own likelihood and against finite differences."""

import numpy as np
import pytest
from reference.hard_cases import hard_cases
from scipy.special import log_expit

from bayes_toe.classical.penalised_likelihood import Design, PenalisedLikelihood
from bayes_toe.model.distributions import Normal
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.target import hessian as hessian_of

CASES = hard_cases()


def objective(subject, mean=0.0, sd=10.0):
    sbar = float(np.average(subject.s1, weights=subject.n_trials))
    equal, different = subject.n_yes[:, None] + 0.0, (subject.n_trials - subject.n_yes)[:, None] + 0.0
    return PenalisedLikelihood(Design(subject.s1, subject.s2, sbar, Normal(mean, sd)), equal, different, np.zeros(1000, int))


def points(n=30, seed=3):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 4)) * [0.3, 2.0, 0.7, 2.0] + [0.0, 0.0, -1.0, 2.0]
    return x, np.stack([x[:, 0], log_expit(x[:, 1]), x[:, 2], log_expit(x[:, 3])])


@pytest.mark.parametrize("name", ["funnel", "all equal", "reversed answers", "stimuli offset by 100", "400 pairs with 3 trials"])
def test_value_is_the_likelihood_minus_the_penalty(name):
    subject = CASES[name]
    posterior, (x, y) = posterior_of(subject), points()
    value = objective(subject, mean=0.5, sd=3.0).value(y, np.arange(y.shape[1]))
    expected = posterior.log_likelihood(x) - 0.5 * ((posterior.natural(x).mu1 - 0.5) / 3.0) ** 2
    assert value == pytest.approx(expected, rel=1e-11, abs=1e-9)


@pytest.mark.parametrize("name", ["funnel", "perfect observer", "400 pairs with 3 trials"])
def test_derivatives_are_those_of_the_likelihood_by_the_chain_rule(name):
    subject = CASES[name]
    posterior, (x, y) = posterior_of(subject), points()
    gradient, hessian = objective(subject, sd=1e9).derivatives(y, np.arange(y.shape[1]))
    # d log(p/p_max) / da = expit(-a) and its derivative -expit(a) expit(-a); the same for log q0.
    back, bend = np.ones_like(x), np.zeros_like(x)
    for i in (1, 3):
        back[:, i] = 1 / (1 + np.exp(x[:, i]))
        bend[:, i] = -back[:, i] * (1 - back[:, i])
    first, second = posterior.likelihood_gradient(x)[1], hessian_of(lambda x: posterior.likelihood_gradient(x)[1], x)
    assert (gradient.T * back) == pytest.approx(first, rel=1e-8, abs=1e-7 * np.abs(first).max())
    chained = np.moveaxis(hessian, -1, 0) * back[:, :, None] * back[:, None, :]
    chained[:, np.arange(4), np.arange(4)] += gradient.T * bend
    size = np.abs(second).max(axis=(1, 2), keepdims=True)
    assert chained / size == pytest.approx(second / size, abs=1e-6)


@pytest.mark.parametrize("edge", [(1, 0.0), (3, 0.0), (1, -np.inf)])
def test_derivatives_on_the_edges_agree_with_finite_differences(edge):
    subject = CASES["maximum on gamma = 1"]
    y = np.array([[0.08], [-0.7], [-1.0], [-0.1]])
    y[edge[0]] = edge[1]
    if edge[1] < 0:
        y[0] = 0.0  # gamma = 0: no offset
    target, at = objective(subject), np.zeros(1, int)
    gradient, hessian = target.derivatives(y, at)
    for i in range(4):
        if edge[1] < 0 and i < 2:
            continue
        step = np.zeros((4, 1))
        step[i] = 1e-6
        # One-sided where the other side is outside the model.
        low = y if i == edge[0] else y - step
        width = 1e-6 if i == edge[0] else 2e-6
        sign = -1.0 if i == edge[0] else 1.0
        high = y + sign * step
        slope = sign * (target.value(high, at) - target.value(low, at)) / width
        assert gradient[i] == pytest.approx(slope, rel=1e-3, abs=1e-3 * np.abs(gradient).max())
        column = sign * (target.derivatives(high, at)[0] - target.derivatives(low, at)[0]) / width
        assert hessian[:, i] == pytest.approx(column, rel=1e-3, abs=1e-3 * np.abs(hessian).max())
