"""The model at several intervals.

The filter step by step, scales exactly 1 at one second, and the equations of their moments.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kalman import evolve, settled, shift, update

from bayes_toe.errors import InputError
from bayes_toe.model.intervals import at_interval, random_walk_scales
from bayes_toe.model.paper_equations import MAX_PULL, Natural, equal_probability, gain, pull, width

OBSERVER = Natural(*map(np.asarray, (-0.6, 0.21, 0.14, 0.93)))


@pytest.mark.parametrize("isi", [0.05, 0.3, 1.0, 4.0, 60.0])
def test_filter_equations_give_the_closed_form(isi):
    prior = settled(OBSERVER.mu1, OBSERVER.sigma_p, OBSERVER.sigma_l, isi)
    for s1, s2 in [(0.0, 0.0), (0.4, 0.1), (-0.2, 0.5)]:
        evolved = evolve(update(prior, s1, OBSERVER.sigma_l), OBSERVER.sigma_p, isi)
        literal = OBSERVER.q0 * 2.0 ** -np.square(shift(evolved, s2, OBSERVER.sigma_l))
        assert equal_probability(s1, s2, *at_interval(OBSERVER, isi)) == pytest.approx(
            float(literal), rel=1e-12
        )
    weight = prior.variance / (prior.variance + OBSERVER.sigma_l**2)
    assert gain(at_interval(OBSERVER, isi).gamma) == pytest.approx(float(weight), rel=1e-12)


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
    there = at_interval(theta, t)
    ratio = float(width(there.sigma_p, there.gamma) / width(1.0, theta.gamma))
    assert scales_of(a, t) == pytest.approx([float(pull(there.gamma) / p), ratio], rel=1e-12)
