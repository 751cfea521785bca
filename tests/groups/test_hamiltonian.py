"""The sampler of many chains in step, on densities that are known."""

import numpy as np
import pytest
from scipy import stats

from bayes_toe.groups.chains import Hamiltonian

COVARIANCE = np.array(
    [[4.0, 1.2, 0.0, 0.0], [1.2, 1.0, 0.0, 0.0], [0.0, 0.0, 0.01, 0.0], [0.0, 0.0, 0.0, 900.0]]
)
MEAN = np.array([1.0, -2.0, 5.0, 100.0])


def normal(x):
    slope = -(x - MEAN) @ np.linalg.inv(COVARIANCE)
    return 0.5 * ((x - MEAN) * slope).sum(axis=1), slope


def skewed(x):
    """Logs of exponential numbers, three of them, the second one's scale following from the first: skewed, and narrow in places."""
    a, b, c = x.T
    with np.errstate(over="ignore"):
        ea, eb, ec = np.exp(a), np.exp(b - a / 2.0), np.exp(c)
    slope = np.stack([1.0 - ea - 0.5 + 0.5 * eb, 1.0 - eb, 1.0 - ec], axis=1)
    return a - ea + (b - a / 2.0) - eb + c - ec, slope


def skewed_draws(rng, size):
    a, b, c = np.log(rng.exponential(size=(3, size)))
    return np.stack([a, b + a / 2.0, c], axis=1)


def uniforms(x):
    """Each column of which has a known distribution made uniform."""
    a, b, c = x.T
    return 1.0 - np.exp(-np.exp(np.stack([a, b - a / 2.0, c], axis=1)))


def sampler(density, start, seed, together=0, scale=None):
    return Hamiltonian(
        density,
        start,
        np.ones(start.shape[1]) if scale is None else scale,
        together,
        np.random.default_rng(seed),
    )


def test_a_normal_from_a_poor_start():
    """Means, variances and a correlation: 13 z scores from about independent draws; false alarms once in 10,000 runs."""
    chains = sampler(normal, np.random.default_rng(1).normal(0.0, 3.0, (16, 4)), 2, together=2)
    chains.warm_up()
    assert (
        chains.step > 0.4
    )  # in coordinates of one size; the narrowest has an sd of 0.1 beside one of 30
    trace = chains.advance(400)
    assert trace.accepted.mean() == pytest.approx(0.8, abs=0.12)
    x = trace.x.reshape(-1, 4) - MEAN
    products = x[:, :, None] * x[:, None, :]
    errors = np.sqrt(
        (np.outer(np.diag(COVARIANCE), np.diag(COVARIANCE)) + COVARIANCE**2) / (0.3 * len(x))
    )
    assert np.abs((products.mean(axis=0) - COVARIANCE) / errors).max() < 4.5
    assert np.abs(x.mean(axis=0) / np.sqrt(np.diag(COVARIANCE) / (0.3 * len(x)))).max() < 4.5


@pytest.mark.parametrize("step", [0.15, 0.6, 1.1])
def test_a_density_is_left_as_it_is(step):
    """2000 independent draws stay such draws, whatever the step: also where half of the proposals are refused."""
    rng = np.random.default_rng(4)
    chains = sampler(skewed, skewed_draws(rng, 2000), 5)
    chains.step = step
    trace = chains.advance(6)
    assert 0.05 < trace.accepted.mean() < 0.9999
    for u in uniforms(trace.x[-1]).T:
        assert stats.kstest(u, "uniform").pvalue > 1e-4

    def twisted(x):
        value, slope = skewed(x)
        return 1.5 * value, slope

    if step == 0.6:  # a wrong acceptance would be seen
        chains = sampler(twisted, skewed_draws(np.random.default_rng(4), 2000), 5)
        chains.step = step
        assert (
            min(stats.kstest(u, "uniform").pvalue for u in uniforms(chains.advance(6).x[-1]).T)
            < 1e-4
        )


def test_trajectories_over_a_cliff_are_refused_and_counted():
    def cliff(x):
        steep = 1e9 * np.where(np.abs(x) > 1.0, np.sign(x) * (np.abs(x) - 1.0), 0.0)
        return -0.5 * 1e9 * np.square(np.maximum(np.abs(x) - 1.0, 0.0)).sum(axis=1), -steep

    chains = sampler(cliff, np.zeros((16, 1)), 10)
    chains.step = 0.7
    trace = chains.advance(30)
    assert 0.1 < trace.divergent.mean() < 1.0
    assert (trace.accepted[trace.divergent] == 0.0).all()
    assert np.abs(trace.x).max() < 1.001
    again = trace.x[1:][trace.divergent[1:]] == trace.x[:-1][trace.divergent[1:]]
    assert again.all()


def test_a_density_that_is_nothing_somewhere_is_not_entered():
    """-inf is the value outside a support, and NaN that of a slope there."""

    def half(x):
        inside = x[:, 0] > 0.0
        return np.where(inside, -x[:, 0], -np.inf), np.where(inside[:, None], -1.0, np.nan)

    trace = sampler(half, np.ones((64, 1)), 11).advance(400)
    assert trace.divergent.any()
    assert trace.x.min() > 0.0
    assert stats.kstest(trace.x[40::40].ravel(), "expon").pvalue > 1e-4


def test_trajectories_are_longer_where_draws_are_alike():
    """A coordinate that twenty others follow closely, each alone: no scale of single coordinates helps."""

    def followed(x):
        first, apart = x[:, :1], (x[:, 1:] - x[:, :1]) / 0.1
        slope = np.concatenate(
            [-first + apart.sum(axis=1, keepdims=True) / 0.1, -apart / 0.1], axis=1
        )
        return -0.5 * (np.square(first[:, 0]) + np.square(apart).sum(axis=1)), slope

    slow = sampler(followed, np.random.default_rng(1).normal(0.0, 1.0, (16, 21)), 15, together=1)
    quick = sampler(normal, np.zeros((16, 4)) + MEAN, 15, together=2)
    lengths = []
    for chains in (slow, quick):
        chains.warm_up((40, 40, 40))
        before, x = chains.gradients, chains.advance(150).x
        lengths.append((chains.gradients - before) * chains.step)
        if chains is slow:
            assert (x[..., 0].mean(), x[..., 0].std()) == pytest.approx((0.0, 1.0), abs=0.3)
    assert lengths[0] / lengths[1] == pytest.approx(2.0, rel=0.2)
