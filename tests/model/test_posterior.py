"""Value and gradient of the paper's model, against many digits and over all floats."""

import numpy as np
import pytest
from definitions import assert_agrees
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from reference.hard_cases import hard_cases

from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.errors import NumericalError
from bayes_toe.inference.maxima import hessian
from bayes_toe.model.paper_model import paper_posterior
from bayes_toe.model.prior import Prior

CASES = hard_cases()


def test_points_in_blocks_are_points_one_by_one():
    posterior = paper_posterior(CASES["400 pairs with 3 trials"])
    x = np.random.default_rng(0).normal(size=(500, 4))
    single_points = np.concatenate([posterior.log_density(point) for point in x])
    assert posterior.log_density(x) == pytest.approx(single_points, rel=1e-13)


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


def subject(task, scale=1, shift=0.0):
    s1, s2 = np.array([0.0, 0.0, 0.5, 0.25, 0.125]), np.array([0.0, 0.5, 0.0, 0.375, 0.75])
    n_yes, n_trials = scale * np.array([[45, 20, 15, 30, 2], [50, 50, 50, 40, 50]])
    return Subject("S", s1 + shift, s2 + shift, n_yes, n_trials, task=task)


@OF_ALL
@settings(max_examples=12, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(
    prior=st.sampled_from([*PRIORS.values()]),
    x=st.tuples(
        st.floats(-3, 3, allow_subnormal=False),
        st.floats(-3, 3, allow_subnormal=False),
        st.floats(-6, 6, allow_subnormal=False),
        st.floats(-5, 6, allow_subnormal=False),
    ),
)
def test_value_and_gradient_at_any_point(task, prior, x):
    target = paper_posterior(subject(task), prior)
    z = target.rows.distance(np.array([[x]]))[0, 0]
    # Rounding a distance costs what its cancellation costs: only pairs off the axis are held to
    # 1e-12.
    assume(((z == 0.0) | (np.abs(z) > 1e-2)).all())
    assert_agrees(target, x)


MIDDLE = (0.31, -0.3, 0.4, 1.1)
FAR = [(1, -25.0), (1, -19.0), (1, 12.0), (2, -30.0), (2, -9.0), (2, 7.0), (3, -9.0), (3, 12.0)]
#: Prior, coordinate and its value; all other coordinates are in the middle.
FAR_POINTS = [("sigma_p", *far) for far in FAR] + [("width", *far) for far in FAR[:3]]


@OF_ALL
@pytest.mark.parametrize("prior, coordinate, value", FAR_POINTS)
def test_value_and_gradient_in_the_tails_of_a_coordinate(task, prior, coordinate, value):
    """With a prior of the width, only the second coordinate is another one: only it is tested."""
    x = [*MIDDLE]
    x[coordinate] = value
    posterior = paper_posterior(subject(task, scale=1000), PRIORS[prior])
    assert_agrees(posterior, x, digits=700)


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
