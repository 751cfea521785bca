"""Exceedance probabilities against Monte Carlo of the Dirichlet and adaptive quadrature."""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from bayes_toe.comparison.exceedance import exceedance_probabilities


@pytest.mark.parametrize("alpha", [[1.3, 4.0], [0.4, 2.0, 7.5], [3.0, 3.5, 2.0, 12.0, 9.0], [120.0, 110.0, 1.0], [40.0] * 12])
def test_exceedance_by_drawing(alpha):
    draws = np.random.default_rng(5).dirichlet(alpha, 400_000).argmax(axis=1)
    found, error = exceedance_probabilities(alpha)
    share = np.bincount(draws, minlength=len(alpha)) / len(draws)
    assert found == pytest.approx(share, abs=4.5 * 0.5 / np.sqrt(len(draws)))
    assert error < 1e-11


@pytest.mark.parametrize("alpha", [[2.0, 3.0, 2.5], [0.2, 0.3, 1.0], [40.0, 1.0, 38.0, 45.0]])
def test_exceedance_by_adaptive_quadrature(alpha):
    gammas = [stats.gamma(a) for a in alpha]
    for k, value in enumerate(exceedance_probabilities(alpha)[0]):
        others = [g for j, g in enumerate(gammas) if j != k]
        direct = quad(lambda u, k=k, others=others: np.prod([g.cdf(gammas[k].ppf(u)) for g in others]), 0, 1, epsabs=1e-11, limit=400)[0]
        assert value == pytest.approx(direct, abs=1e-9)


@pytest.mark.parametrize("alpha", [[0.01, 0.01, 0.01], [0.01, 1e6, 1e6], [1e6, 1e6, 1e6, 1e6]])
def test_exceedance_at_the_ends(alpha):
    found, error = exceedance_probabilities(alpha)
    top = np.asarray(alpha) == max(alpha)
    assert found == pytest.approx(np.where(top, 1 / top.sum(), 0.0), abs=1e-8)
    assert error < 1e-8
