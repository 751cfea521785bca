"""The quadrature against densities whose integral, moments and quantiles are known without it."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from reference import lattice
from reference.hard_cases import hard_cases
from reference.lattice_quantiles import LEVELS
from reference.paper_density import PaperDensity, natural
from reference.quadrature import TOLERANCE, integrate
from scipy import integrate as scipy_integrate
from scipy import stats
from scipy.special import expit

from bayes_toe.model.paper_equations import MAX_PULL
from bayes_toe.model.prior import Prior

STORED = json.loads((Path(__file__).with_name("reference.json")).read_text(encoding="utf-8"))[
    "cases"
]


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


def test_a_stored_case_is_reproduced():
    observed, stored = (
        integrate(PaperDensity(hard_cases()["stimuli offset by 100"], Prior()), tolerance=1e-3),
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
