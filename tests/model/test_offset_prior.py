"""The constant error's prior against direct integration, a population of observers, and its own inverse."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL, pull
from bayes_toe.model.distributions import Beta, HalfNormal, Normal, Uniform, share
from bayes_toe.model.offset_prior import NormalOffset, OffsetPrior, offset_prior
from bayes_toe.model.prior import Prior

X = np.concatenate([np.linspace(-34, 34, 4001), np.random.default_rng(2).normal(size=2000)])
CASES = [
    *((mean, sd, a, b) for mean, sd in ((0.0, 10.0), (0.4, 0.1), (1.0, 30.0)) for a, b in ((1.0, 1.0), (2.0, 3.0), (0.7, 1.0))),
    (5.0, 1.0, 1.0, 1.0),  # hardly ever below 0
    (0.0, 1.0, 200.0, 300.0),
    (0.3, 2.0, 0.2, 0.3),
]


@pytest.fixture(scope="module", params=CASES, ids=str)
def case(request):
    mean, sd, a, b = request.param
    return request.param, OffsetPrior(Normal(mean, sd), share(a, b), 0.0)


def integrated(function, c, mean, sd, a, b):
    """Over the log of gamma, by parts between the layers, where c/p comes within some sd of the mean."""
    edges = {-45.0 / min(a, 1.0), -20.0, -5.0, -1.0, -1e-3, 0.0, float(np.log(a / (a + b)))}
    edges |= {float(np.log(abs(c) / (abs(mean) + k * sd))) for k in (0.5, 1, 2, 4, 8, 16)} | {float(np.log(abs(c) / max(mean, sd)))}
    if a > 50:
        edges |= {float(np.log(a / (a + b) + k * 0.022)) for k in (-12, -4, -1, 1, 4, 12)}
    edges = sorted(edge for edge in edges if -45.0 / min(a, 1.0) <= edge <= 0.0)
    of_gamma = stats.beta(a, b)

    def integrand(log_gamma):
        gamma = np.exp(log_gamma)
        density = of_gamma.logpdf(gamma) + log_gamma
        return float(np.exp(density) * function(float(pull(gamma))))

    parts = pairwise(edges)
    return sum(quad(integrand, low, high, epsabs=0, epsrel=1e-11, limit=200)[0] for low, high in parts if high > low)


@pytest.mark.filterwarnings("ignore::scipy.integrate.IntegrationWarning")  # where the integrand is no float
@pytest.mark.parametrize("c", [-7.0, -0.1, -1e-6, 1e-5, 0.02, 0.3, 2.0, 40.0])
def test_the_density_is_the_marginal(case, c):
    (mean, sd, a, b), found = case
    if b < 1 and abs(c) > 0.1:
        return  # quad does not see the singularity at gamma = 1; the next test does
    exact = integrated(lambda p: stats.norm.pdf((c / p - mean) / sd) / sd / p, c, mean, sd, a, b)
    x = found.score(c)
    if exact < 1e-200 or abs(x) > 8:
        return  # beyond any observer
    assert np.exp(found.log_density(c)) == pytest.approx(exact, rel=1e-9)
    assert stats.norm.pdf(x) / found.offset(x)[1] == pytest.approx(exact, rel=1e-8)


def test_the_distribution_is_that_of_a_population(case):
    (mean, sd, a, b), found = case
    rng = np.random.default_rng(7)
    c = pull(rng.beta(a, b, 20_000)) * rng.normal(mean, sd, 20_000)
    # 12 such tests at 1e-4 each: a false alarm in 800
    assert stats.kstest(found.score(c), "norm").pvalue > 1e-4
    assert np.std(c) == pytest.approx(found.spread, rel=0.1)


def test_the_image_of_a_normal_is_smooth_rising_and_has_an_inverse(case):
    _, found = case
    table = found._table[0]
    x = np.sort(np.concatenate([X, table, 0.5 * (table[1:] + table[:-1])]))
    c = found.offset(x)
    assert (c[1] > 0).all()
    assert (np.diff(c[0]) >= 0).all()
    mass = -0.5 * X**2 - 0.5 * np.log(2 * np.pi) - np.log(found.offset(X)[1])
    some = (np.abs(X) < 8) & (np.abs(found.offset(X)[0]) > 1e-6)
    assert mass[some] == pytest.approx(found.log_density(found.offset(X[some])[0]), abs=1e-7)
    assert found.score(found.offset(X)[0]) == pytest.approx(X, rel=1e-9, abs=1e-9)
    step = 1e-6 * (1 + np.abs(X))
    near = [found.offset(X + k * step)[0] for k in (-1, 1)]
    inside = (np.abs(X) < 20) & (np.abs(X[:, None] - table).min(axis=1) > 2e-5)  # no knot within the step
    slope, size = (near[1] - near[0]) / (2 * step), np.abs(near[0]) + np.abs(near[1])
    assert found.offset(X)[1][inside] == pytest.approx(slope[inside], rel=1e-4, abs=1e-6 * size.max() + 1e-7)


def test_it_stays_away_from_nothing_and_ends_with_mu1():
    far = OffsetPrior(Normal(0.0, 10.0), Uniform(), 0.0)
    # the tail is that of the largest pull; the straight end keeps an order
    assert far.offset(np.array([30.0]))[0] == pytest.approx(MAX_PULL * 300.0, rel=0.02)
    ends = far.offset(np.array([-50.0, -40.0, 40.0, 50.0]))[0]
    assert (np.diff(ends) > 0).all()
    assert far.log_density([1e3, 0.0]).tolist() == [pytest.approx(-34280, rel=0.001), pytest.approx(np.log(1.7), abs=0.3)]
    above = OffsetPrior(HalfNormal(3.0), Uniform(), 0.0)  # never below 0: any family with a density will do
    assert above.quantile([1e-3, 0.5]) == pytest.approx(pushed_up(3.0, [1e-3, 0.5]), rel=0.03)


def pushed_up(scale, p):
    rng = np.random.default_rng(3)
    return np.quantile(pull(rng.uniform(size=4_000_000)) * np.abs(rng.normal(size=4_000_000)) * scale, p)


def test_a_normal_takes_its_place_and_the_density_is_the_known_one():
    found, implied = offset_prior(Prior(offset_sd=0.7), 0.3), offset_prior(Prior(), 0.0)
    assert found == NormalOffset(0.7)
    assert (found.describe(), found.spread) == ("Normal(0, 0.7)", 0.7)
    value, slope = found.offset(np.array([[1.0], [-2.0]]))
    assert (value.ravel().tolist(), slope.tolist()) == ([0.7, -1.4], [[0.7], [0.7]])
    assert found.score(value).ravel().tolist() == [1.0, -2.0]
    assert found.log_density(0.1) == pytest.approx(stats.norm.logpdf(0.1, 0, 0.7))
    assert implied is offset_prior(Prior(sigma_p_scale=3.0), 0.0)  # made once
    assert np.exp(implied.log_density([0.01, 0.1, 0.2, 1.0])) == pytest.approx([0.35, 0.25, 0.22, 0.14], abs=0.005)
    assert "mu1 ~ Normal(0, 10), gamma ~ Uniform(0, 1)" in implied.describe()
    assert implied.quantile(0.975) == pytest.approx(-implied.quantile(0.025), rel=1e-9)
    assert OffsetPrior(Normal(3.0, 1.0), Beta(2.0, 2.0), 1.0).quantile(0.3) == pytest.approx(
        OffsetPrior(Normal(2.0, 1.0), Beta(2.0, 2.0), 0.0).quantile(0.3), rel=1e-10
    )
    with pytest.raises(InputError, match="offset_sd=-1"):
        Prior(offset_sd=-1.0)
