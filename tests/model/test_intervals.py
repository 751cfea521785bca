"""The model at several intervals: its scales, exactly 1 at one second."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_toe.errors import InputError
from bayes_toe.model.intervals import at_interval, random_walk_scales
from bayes_toe.model.paper_equations import MAX_PULL, Natural, pull, width

OBSERVER = Natural(*map(np.asarray, (-0.6, 0.21, 0.14, 0.93)))


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_an_interval_is_positive(bad):
    with pytest.raises(InputError, match="positive finite"):
        at_interval(OBSERVER, [1.0, bad])


def scales_of(a, t):
    return np.ravel(random_walk_scales(np.array([a]), np.array([t]))).tolist()


@given(a=st.floats(-700.0, 700.0))
def test_one_second_is_exactly_one(a):
    assert scales_of(a, 1.0) == [1.0, 1.0]


@given(a=st.floats(-600, 30), t=st.floats(1e-3, 1e3))
def test_random_walk_is_the_closed_form_of_its_interval(a, t):
    p = MAX_PULL / (1 + np.exp(-a))
    theta = Natural(np.array(0.0), np.array(1.0), np.array(np.sqrt(p) / (1 - p)), np.array(0.9))
    theta_at_t = at_interval(theta, t)
    ratio = float(width(theta_at_t.sigma_p, theta_at_t.gamma) / width(1.0, theta.gamma))
    assert scales_of(a, t) == pytest.approx([float(pull(theta_at_t.gamma) / p), ratio], rel=1e-12)
