"""Monte Carlo standard errors: of known draws, of dependent ones, and by the short form against ArviZ."""

import arviz
import numpy as np
import pytest

from bayes_toe.inference.diagnostics import errors, quantile_errors


@pytest.fixture(scope="module")
def walk():
    """Skewed draws that hang together: exp of an AR(1) series of coefficient 0.6."""
    steps = np.random.default_rng(4).normal(size=(4, 3000))
    for i in range(1, steps.shape[1]):
        steps[:, i] += 0.6 * steps[:, i - 1]
    return np.exp(steps)


def test_independent_normal_draws_have_the_errors_of_the_textbook():
    found = errors(np.random.default_rng(1).normal(size=(4, 10_000)))
    assert found.mean == pytest.approx(1 / 200, rel=0.1)
    assert found.q50 == pytest.approx(np.sqrt(np.pi / 2) / 200, rel=0.15)
    # sqrt(p (1 - p)) over the density at the quantile
    assert [found.q05, found.q95] == pytest.approx([np.sqrt(0.0475) / 0.1031 / 200] * 2, rel=0.2)


def test_dependent_draws_have_larger_errors_and_constant_ones_none(walk):
    shuffled = np.random.default_rng(2).permutation(walk.ravel()).reshape(walk.shape)
    assert errors(walk).mean > 1.3 * errors(shuffled).mean
    assert errors(walk).q50 > 1.3 * errors(shuffled).q50
    assert np.isnan(errors(np.ones((4, 100)))).all()


def test_known_effective_sizes_give_the_errors_of_arviz(walk):
    for p, found in ((0.05, errors(walk).q05), (0.5, errors(walk).q50), (0.95, errors(walk).q95)):
        size = float(arviz.ess(walk, method="quantile", prob=p))
        assert quantile_errors(walk, [p], size)[0] == found
    assert np.isnan(quantile_errors(walk, [0.5], np.nan)).all()
