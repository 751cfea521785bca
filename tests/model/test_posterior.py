"""Value and gradient of the paper's model, against SciPy and over all floats."""

import definitions
import numpy as np
import pytest
from conftest import BOTH_TASKS, five_pairs
from numpy.random import default_rng
from reference.hard_cases import hard_cases
from scipy import stats
from scipy.special import ndtr

from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.errors import NumericalError
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


MU1_PRIOR = {"mu1_mean": 0.4, "mu1_sd": 2.0}
PRIORS = {
    "sigma_p": Prior(sigma_p_scale=0.7, **MU1_PRIOR),
    "width": Prior(width_median=0.3, width_sd=0.8, q0_a=4.0, **MU1_PRIOR),
}


def scipy_log_density(target, x):
    """Log likelihood and log prior by SciPy, from coordinates of shape (points, 4)."""
    prior, task = target.prior, target.subject.task
    gamma, share = ndtr(x[:, 2]), ndtr(x[:, 3])
    ratio = (1 + np.sqrt(1 + 4 * gamma)) / 2
    if prior.width_median is None:
        sigma_p = stats.halfnorm.ppf(ndtr(x[:, 1]), scale=prior.sigma_p_scale)
    else:
        power = 1.5 if task == SAME_DIFFERENT else 1.0  # the width is sigma_p G^power
        sigma_p = prior.width_median * np.exp(prior.width_sd * x[:, 1]) / ratio**power
    mu1 = prior.mu1_mean + prior.mu1_sd * x[:, 0]
    theta = (column[:, None] for column in (mu1, sigma_p, gamma, share))
    a, b = (getattr(prior, f"{task.lapses}_{end}") for end in "ab")
    log_prior = stats.norm.logpdf(x).sum(axis=1)  # of two scores, and of the probits of two shares
    log_prior += stats.beta.logpdf(gamma, prior.gamma_a, prior.gamma_b)
    log_prior += stats.beta.logpdf(share, a, b)
    return definitions.paper_log_likelihood(target.subject, *theta) + log_prior


@BOTH_TASKS
@pytest.mark.parametrize("prior", PRIORS)
def test_the_density_is_that_of_the_definition_and_has_its_slopes(task, prior):
    target = paper_posterior(five_pairs(task), PRIORS[prior])
    x = default_rng(1).uniform([-3.0, -1.0, -4.0, -4.0], 4.0, (200, 4))
    value, gradient = definitions.gradient(target, x)
    assert value == pytest.approx(scipy_log_density(target, x), rel=1e-10)
    slopes = definitions.slopes(target.log_density, x)
    assert gradient == pytest.approx(slopes, rel=1e-5, abs=1e-4)


@BOTH_TASKS
@pytest.mark.parametrize("prior", PRIORS)
def test_far_beyond_any_float_nothing_is_nan(task, prior):
    far = np.array([-1e4, -745.0, -40.0, 0.0, 40.0, 745.0, 1e4])
    x = np.stack(np.meshgrid([0.0, 1e-320, 0.5], far, far, far), axis=-1).reshape(-1, 4)
    posterior = paper_posterior(five_pairs(task), PRIORS[prior])
    assert not np.isnan(posterior.log_density(x)).any()
    # Without a warning, though slopes may be infinite.
    assert not np.isnan(posterior.array.likelihood.scoring(x[None])[0]).any()
