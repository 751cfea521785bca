"""The geometry of the plane: hundred-digit arithmetic for the axis, and every claimed symmetry tested on P(equal) itself."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bayes_toe as bt
from bayes_toe.model.paper_equations import axis

powers = st.one_of(st.floats(-300, 0).map(lambda e: 10.0**e), st.floats(1e-3, 1))
stimuli = st.floats(-3, 3)
SIGMA_P, Q0 = 0.7, 0.9


def q(pair, mu1, gamma):
    return float(bt.model.equal_probability(*pair, mu1, SIGMA_P, SIGMA_P * np.sqrt(gamma), Q0))


@settings(max_examples=60, deadline=None)
@given(powers)
def test_slope_and_prefactor_against_many_digits(gamma):
    with mpmath.workdps(700):  # (G - 1)/gamma as printed loses 300 digits
        g = mpmath.mpf(gamma)
        ratio = (1 + mpmath.sqrt(1 + 4 * g)) / 2
        slope, prefactor = (ratio - 1) / g, (ratio - 1) / ratio  # Eq. axis2
        corrected = (
            (1 - 1 / ratio) * ratio / g
        )  # Eq. axis0 with its factor put right: (1 - sigma_p^2/sigma^2) sigma^2/sigma_l^2
        expected = [float(v) for v in (ratio, slope, corrected, prefactor)]
    found = axis(1.0, gamma)
    assert float(bt.model.variance_ratio(gamma)) == pytest.approx(expected[0], rel=4e-16)
    assert float(found.slope) == pytest.approx(expected[1], rel=4e-16)
    assert float(found.slope) == pytest.approx(expected[2], rel=4e-16)
    assert float(found.intercept) == pytest.approx(expected[3], rel=8e-16)


def test_on_the_axis_the_probability_is_the_peak():
    line = axis(mu1=1.3, gamma=0.4)
    for s1 in (-2.0, 0.0, 5.0):
        assert q((s1, line.slope * s1 + line.intercept), 1.3, 0.4) == pytest.approx(Q0, rel=1e-14)
    assert float(line.slope * 1.3 + line.intercept) == pytest.approx(
        1.3, rel=1e-15
    )  # through (mu_1, mu_1)


@settings(max_examples=100, deadline=None)
@given(s1=stimuli, s2=stimuli, mu1=stimuli, gamma=powers, step=stimuli)
def test_the_probability_depends_on_the_size_of_the_displacement_alone(s1, s2, mu1, gamma, step):
    here, d = q((s1, s2), mu1, gamma), s2 - float(bt.model.evolved_mean(s1, mu1, gamma))
    for label in (d, -d):
        other = step, float(bt.model.evolved_mean(step, mu1, gamma)) + label
        assert q(other, mu1, gamma) == pytest.approx(here, rel=1e-9, abs=1e-12)
