"""The quadrature against densities whose integral, moments and quantiles are known without it."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from definitions import natural
from reference import lattice
from reference.hard_cases import hard_cases
from reference.lattice_quantiles import LEVELS
from reference.quadrature import QUANTITIES, TOLERANCE, integrate
from scipy import integrate as scipy_integrate
from scipy import optimize, stats
from scipy.special import expit, log_expit, logit

from bayes_toe.errors import NumericalError
from bayes_toe.model.paper_equations import MAX_PULL
from bayes_toe.model.paper_model import paper_posterior
from bayes_toe.model.prior import Prior

STORED = json.loads((Path(__file__).with_name("reference.json")).read_text(encoding="utf-8"))[
    "cases"
]


def log_normal(x, mean, sd):
    return -0.5 * ((x - mean) / sd) ** 2 - np.log(sd * np.sqrt(2.0 * np.pi))


class Normal:
    """exp(5) times a correlated normal density of x.

    The evidence is 5, q0 is logit-normal, the gain a function of a normal a.
    """

    sbar = -0.4
    mean = np.array([0.2, -0.5, -1.2, 1.5])
    factor = np.array(
        [[0.05, 0, 0, 0], [0.6, 0.5, 0, 0], [-0.1, 0.15, 0.1, 0], [0.3, -0.4, 0.2, 0.5]]
    )

    def log_density(self, x):
        whitened = np.linalg.solve(self.factor, (x - self.mean).T)
        return (
            5.0
            - 0.5 * (whitened**2).sum(axis=0)
            - np.log(np.diag(self.factor)).sum()
            - 2.0 * np.log(2.0 * np.pi)
        )

    def natural(self, x):
        return natural(x, self.sbar)


class Funnel(Normal):
    """Independent a, b, l with exponential tails, and two humps in mu1 that do not depend on them.

    c = p (mu1 - sbar) is a funnel.
    """

    sbar = 0.0
    humps = ((0.3, -2.0, 0.4), (0.7, 3.0, 0.8))  # weight, mean, standard deviation of mu1

    def log_density(self, x):
        c, a, b, top = x.T
        p = MAX_PULL * expit(a)
        mu1 = np.logaddexp.reduce([np.log(w) + log_normal(c / p, m, s) for w, m, s in self.humps])
        tails = (
            log_expit(a) + log_expit(-a) + log_expit(2 * top) + log_expit(-2 * top) + np.log(2.0)
        )
        return mu1 - np.log(p) + tails + log_normal(b, -1.0, 0.4)


class Nowhere(Normal):
    def log_density(self, x):
        return np.full(len(x), -np.inf)


def quick(density, **options):
    """The integration with 2 climbs of its 24, enough for one or two humps.

    The stored case below makes them all.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lattice, "_peaks", partial(lattice._peaks, climbs=2))
        return integrate(density, **options)


@pytest.fixture(scope="module")
def normal():
    return quick(Normal())


@pytest.fixture(scope="module")
def funnel():
    return quick(Funnel(), tolerance=1e-3)


def test_evidence_of_a_normal_density_and_quantiles_of_functions_of_two_coordinates(normal):
    """P(sigma < q) and P(mu1 < q) at the reported q, by an integral of an exact probability."""
    assert normal.log_evidence == pytest.approx(5.0, abs=normal.log_evidence_error)
    assert normal.log_evidence_error < TOLERANCE
    covariance = Normal.factor @ Normal.factor.T
    mean_a, sd_a = Normal.mean[1], np.sqrt(covariance[1, 1])

    def below(i, threshold):
        slope = covariance[i, 1] / covariance[1, 1]
        remainder = np.sqrt(covariance[i, i] - slope * covariance[i, 1])
        return scipy_integrate.quad(
            lambda a: (
                stats.norm.cdf((threshold(a) - Normal.mean[i] - slope * (a - mean_a)) / remainder)
                * stats.norm.pdf(a, mean_a, sd_a)
            ),
            mean_a - 9 * sd_a,
            mean_a + 9 * sd_a,
            limit=400,
        )[0]

    def thresholds(q):
        def pull(a):
            return MAX_PULL * expit(a)

        yield 0, lambda a: pull(a) * (q[0] - Normal.sbar)
        yield 2, lambda a: np.log(q[1]) - 1.5 * np.log1p(-pull(a))
        yield 2, lambda a: np.log(q[2]) - 0.5 * np.log1p(-pull(a)) - 0.5 * np.log(pull(a))

    for column, level in enumerate(LEVELS):
        for i, threshold in thresholds(normal.quantiles[:3, column]):
            assert below(i, threshold) == pytest.approx(level, abs=3e-4)


def test_a_funnel_with_two_humps_and_exponential_tails(funnel):
    """mu1 is a mixture of two normals, the pull uniform on (0, p_max), 2 logit q0 logistic."""
    assert funnel.log_evidence == pytest.approx(0.0, abs=funnel.log_evidence_error)
    weights, means, sds = np.array(Funnel.humps).T
    levels, mean = np.array(LEVELS), weights @ means
    of_mu1 = [
        optimize.brentq(
            lambda t, level=level: weights @ stats.norm.cdf(t, means, sds) - level, -9, 9
        )
        for level in LEVELS
    ]
    of_q0 = expit(0.5 * logit(levels))
    for name, exact_mean, exact_sd, exact in (
        ("mu1", mean, np.sqrt(weights @ (sds**2 + means**2) - mean**2), of_mu1),
        ("gain", 1.0 - MAX_PULL / 2, MAX_PULL / np.sqrt(12.0), 1.0 - MAX_PULL * (1.0 - levels)),
        (
            "q0",
            0.5,
            scipy_integrate.quad(lambda u: (expit(0.5 * logit(u)) - 0.5) ** 2, 0, 1)[0] ** 0.5,
            of_q0,
        ),
    ):
        i = QUANTITIES.index(name)
        assert funnel.means[i] == pytest.approx(exact_mean, abs=1e-3 * exact_sd)
        assert funnel.sds[i] == pytest.approx(exact_sd, rel=1e-3)
        assert funnel.quantiles[i] == pytest.approx(exact, abs=2e-3 * exact_sd)


def test_a_density_that_is_zero_is_refused():
    with pytest.raises(NumericalError, match="0 wherever"):
        integrate(Nowhere())


def test_a_stored_case_is_reproduced():
    observed, stored = (
        integrate(paper_posterior(hard_cases()["stimuli offset by 100"], Prior()), tolerance=1e-3),
        STORED["stimuli offset by 100"],
    )
    assert (
        abs(observed.log_evidence - stored["log_evidence"])
        <= observed.log_evidence_error + stored["log_evidence_error"]
    )
    assert np.all(
        np.abs(observed.means - stored["means"])
        <= observed.means_error + np.array(stored["means_error"])
    )
