"""Value and gradient of the paper's model, against many digits and over all floats."""

import numpy as np
import pytest
from conftest import BOTH_TASKS, each_row, five_pairs, refused
from definitions import assert_agrees
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from reference.hard_cases import hard_cases

from bayes_toe.errors import NumericalError
from bayes_toe.model.paper_model import paper_posterior
from bayes_toe.model.prior import Prior

CASES = hard_cases()


@pytest.mark.parametrize("point, message", [([np.nan, 0, 0, 0], "NaN"), ([0.0, 0.0], "shape")])
def test_points_with_nan_or_without_four_coordinates_are_refused(point, message):
    with refused(message, NumericalError):
        paper_posterior(CASES["all equal"]).log_density([point])


def test_impossible_answers_have_a_density_of_0_and_sure_ones_are_not_nan():
    # The second coordinate makes a width of e^-400, so that z^2 of an unequal pair is beyond the
    # largest float: P(equal) is 0.
    x = [[0.1, -400.0, 0.0, 0.0]]
    assert paper_posterior(CASES["all equal"]).log_density(x)[0] == -np.inf
    # P(different) is 1: the log likelihood is exactly 0, not 0 times infinity.
    assert paper_posterior(CASES["all different"]).log_likelihood(x)[0] == 0.0


MU1_PRIOR = {"mu1_mean": 0.4, "mu1_sd": 2.0}
PRIORS = {
    "sigma_p": Prior(sigma_p_scale=0.7, **MU1_PRIOR),
    "width": Prior(width_median=0.3, width_sd=0.8, q0_a=4.0, **MU1_PRIOR),
}


@BOTH_TASKS
@settings(max_examples=12, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(
    # Ranges hold most of the prior. Subnormal floats have fewer digits.
    prior=st.sampled_from(list(PRIORS.values())),
    x=st.tuples(
        st.floats(-3, 3, allow_subnormal=False),
        st.floats(-3, 3, allow_subnormal=False),
        st.floats(-6, 6, allow_subnormal=False),
        st.floats(-5, 6, allow_subnormal=False),
    ),
)
def test_value_and_gradient_at_any_point(task, prior, x):
    target = paper_posterior(five_pairs(task), prior)
    u = np.array([[x]])
    z = target.rows.distance(u)[0, 0]  # of each pair, for the only subject and point
    # A distance z of a pair that is small by cancellation has lost digits. Points with such a pair
    # are left out, and all others are held to 1e-12.
    assume(((z == 0.0) | (np.abs(z) > 1e-2)).all())
    assert_agrees(target, x)


MIDDLE_POINT = (0.31, -0.3, 0.4, 1.1)
#: Prior, the index of a coordinate and its value; all other coordinates are in the middle. The last
#: column has the digits that the definition needs, which are most for a width of Phi(-25), 3e-138.
FAR_POINTS = """
    sigma_p | 1 | -25 | 700
    sigma_p | 1 | -19 | 300
    sigma_p | 1 | 12 | 150
    sigma_p | 2 | -30 | 150
    sigma_p | 2 | -9 | 150
    sigma_p | 2 | 7 | 150
    sigma_p | 3 | -9 | 150
    sigma_p | 3 | 12 | 150
    width | 1 | -25 | 150
    width | 1 | -19 | 150
    width | 1 | 12 | 150
"""


@BOTH_TASKS
@each_row("prior, coordinate, value, digits", FAR_POINTS)
def test_value_and_gradient_in_the_tails_of_a_coordinate(task, prior, coordinate, value, digits):
    """The prior of the width changes the second coordinate alone: only this coordinate is tested.

    Each pair has 50,000 trials.
    """
    x = list(MIDDLE_POINT)
    x[int(coordinate)] = float(value)
    posterior = paper_posterior(five_pairs(task, n_times=1000), PRIORS[prior])
    assert_agrees(posterior, x, int(digits))


@BOTH_TASKS
@pytest.mark.parametrize("prior", PRIORS)
def test_far_beyond_any_float_nothing_is_nan(task, prior):
    # e^-745 is about the smallest float, and Phi(-40) is 0.
    values = np.array([-1e4, -745.0, -40.0, 0.0, 40.0, 745.0, 1e4])
    x = np.stack(np.meshgrid([0.0, 1e-320, 0.5], values, values, values), axis=-1).reshape(-1, 4)
    posterior = paper_posterior(five_pairs(task), PRIORS[prior])
    assert not np.isnan(posterior.log_density(x)).any()
    # There is no warning, though slopes may be infinite.
    assert not np.isnan(posterior.array.likelihood.scoring(x[None])[0]).any()
