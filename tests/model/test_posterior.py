"""Value and gradient of the paper's model: its definition, differences, and all floats."""

import numpy as np
import pytest
from definitions import paper_log_likelihood
from numpy.random import default_rng
from reference.hard_cases import hard_cases
from scipy.special import ndtr
from scipy.stats import beta, norm

from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.errors import NumericalError
from bayes_toe.inference.maxima import hessian
from bayes_toe.model.paper_model import paper_posterior
from bayes_toe.model.prior import Prior

CASES = hard_cases()


@pytest.mark.parametrize("point, message", [([np.nan, 0, 0, 0], "NaN"), ([0.0, 0.0], "shape")])
def test_points_that_are_refused(point, message):
    with pytest.raises(NumericalError, match=message):
        paper_posterior(CASES["all equal"]).log_density([point])


def test_impossible_is_minus_infinity():
    # Width e^-400, so that z^2 of an unequal pair is beyond the largest float: P(equal) is 0.
    x = [[0.1, -400.0, 0.0, 0.0]]
    assert paper_posterior(CASES["all equal"]).log_density(x)[0] == -np.inf
    # P(different) is 1: the log likelihood is exactly 0, not 0 times infinity.
    assert paper_posterior(CASES["all different"]).log_likelihood(x)[0] == 0.0


NUMBERS = {"mu1_mean": 0.4, "mu1_sd": 2.0}
PRIORS = {
    "sigma_p": Prior(sigma_p_scale=0.7, **NUMBERS),
    "width": Prior(width_median=0.3, width_sd=0.8, q0_a=4.0, **NUMBERS),
}
OF_ALL = pytest.mark.parametrize("task", [SAME_DIFFERENT, WHICH_STRONGER])


def subject(task):
    s1, s2 = np.array([0.0, 0.0, 0.5, 0.25, 0.125]), np.array([0.0, 0.5, 0.0, 0.375, 0.75])
    return Subject("S", s1, s2, [45, 20, 15, 30, 2], [50, 50, 50, 40, 50], task=task)


@OF_ALL
@pytest.mark.parametrize("prior", PRIORS.values(), ids=PRIORS)
def test_density_and_slopes_are_those_of_the_definition(task, prior):
    posterior = paper_posterior(subject(task), prior)
    x = 0.6 * default_rng(1).normal(size=(200, 4))
    values = posterior.quantities(x)
    natural = (values[name][:, None] for name in ("mu1", "sigma_p", "gamma", task.lapses))
    log_likelihood = paper_log_likelihood(posterior.subject, *natural)
    assert posterior.log_likelihood(x) == pytest.approx(log_likelihood, rel=1e-10)

    gamma, share = ndtr(x[:, 2:]).T
    a, b = (getattr(prior, f"{task.lapses}_{end}") for end in "ab")
    log_prior = norm.logpdf(x).sum(axis=1) + beta.logpdf(gamma, prior.gamma_a, prior.gamma_b)
    log_prior += beta.logpdf(share, a, b)
    density, slopes = posterior.gradient(x)
    assert density == pytest.approx(log_likelihood + log_prior, rel=1e-10)
    for slope, step in zip(slopes.T, 1e-6 * np.eye(4), strict=True):
        rise = posterior.log_density(x + step) - posterior.log_density(x - step)
        assert slope == pytest.approx(rise / 2e-6, rel=1e-5, abs=1e-4)


MIDDLE = (0.31, -0.3, 0.4, 1.1)


def test_a_hessian_by_differences():
    """Of minus the sum of cosh(A x), which is -A' diag(cosh(A x)) A."""
    factors = np.random.default_rng(1).normal(size=(6, 4))
    x = np.array([MIDDLE])
    exact = -factors.T @ np.diag(np.cosh(factors @ MIDDLE)) @ factors
    ahead = x + 1e-6 * np.eye(4)[:, None]
    slopes = -np.sinh(np.concatenate([x[None], ahead]) @ factors.T) @ factors
    observed = hessian(slopes[1:] - slopes[0], ahead - x)[0]
    assert np.abs(observed - exact).max() < 1e-5 * np.abs(exact).max()


@OF_ALL
@pytest.mark.parametrize("prior", PRIORS)
def test_far_beyond_any_float_nothing_is_nan(task, prior):
    far = np.array([-1e4, -745.0, -40.0, 0.0, 40.0, 745.0, 1e4])
    x = np.stack(np.meshgrid([0.0, 1e-320, 0.5], far, far, far), axis=-1).reshape(-1, 4)
    posterior = paper_posterior(subject(task), PRIORS[prior])
    assert not np.isnan(posterior.log_density(x)).any()
    # Without a warning, though slopes may be infinite.
    assert not np.isnan(posterior.array.likelihood.scoring(x[None])[0]).any()
