"""The geometry of the plane: hundred-digit arithmetic for the axis, and every claimed symmetry tested on P(equal) itself."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bayes_toe as bt
from bayes_toe.errors import InputError, NumericalError
from bayes_toe.model import geometry as geo
from bayes_toe.model.coordinates import Natural

powers = st.one_of(st.floats(-300, 0).map(lambda e: 10.0**e), st.floats(1e-3, 1))
stimuli = st.floats(-3, 3)
SIGMA_P, Q0 = 0.7, 0.9


def q(pair, mu1, gamma):
    return float(bt.model.equal_probability(*pair, mu1, SIGMA_P, SIGMA_P * np.sqrt(gamma), Q0))


@settings(max_examples=60, deadline=None)
@given(powers)
def test_slope_prefactor_and_angle_against_many_digits(gamma):
    with mpmath.workdps(700):  # (G - 1)/gamma as printed loses 300 digits
        g = mpmath.mpf(gamma)
        ratio = (1 + mpmath.sqrt(1 + 4 * g)) / 2
        slope, prefactor = (ratio - 1) / g, (ratio - 1) / ratio  # Eq. axis2
        corrected = (1 - 1 / ratio) * ratio / g  # Eq. axis0 with its factor put right: (1 - sigma_p^2/sigma^2) sigma^2/sigma_l^2
        angle = mpmath.pi / 4 - mpmath.atan(slope)
        expected = [float(v) for v in (ratio, slope, corrected, prefactor, angle)]
    found = geo.axis_properties(gamma)
    assert float(found.prior_uncertainty) == pytest.approx(expected[0], rel=4e-16)
    assert float(found.slope) == pytest.approx(expected[1], rel=4e-16)
    assert float(found.slope) == pytest.approx(expected[2], rel=4e-16)
    assert float(found.prefactor) == pytest.approx(expected[3], rel=8e-16)
    assert float(geo.rotation_angle(gamma)) == pytest.approx(expected[4], rel=8e-16)


def test_on_the_axis_the_probability_is_the_peak():
    line = geo.axis(mu1=1.3, gamma=0.4)
    for s1 in (-2.0, 0.0, 5.0):
        assert q((s1, line.slope * s1 + line.intercept), 1.3, 0.4) == pytest.approx(Q0, rel=1e-14)
    assert float(line.slope * 1.3 + line.intercept) == pytest.approx(1.3, rel=1e-15)  # through (mu_1, mu_1)


@settings(max_examples=100, deadline=None)
@given(s1=stimuli, s2=stimuli, mu1=stimuli, gamma=powers, step=stimuli)
def test_classes_reflection_and_inverted_order_keep_the_probability(s1, s2, mu1, gamma, step):
    here = q((s1, s2), mu1, gamma)
    d = float(geo.displacement(s1, s2, mu1, gamma))
    close = {"rel": 1e-9, "abs": 1e-12}
    along = geo.equivalent(s1, s2, step, gamma)
    assert q(along, mu1, gamma) == pytest.approx(here, **close)
    assert float(geo.displacement(*along, mu1, gamma)) == pytest.approx(d, abs=1e-13)
    for label in (d, -d):
        assert q((step, geo.class_line(step, label, mu1, gamma)), mu1, gamma) == pytest.approx(here, **close)
    mirrored = geo.reflection(s1, s2, mu1, gamma)
    assert q(mirrored, mu1, gamma) == pytest.approx(here, **close)
    assert float(geo.displacement(*mirrored, mu1, gamma)) == pytest.approx(-d, abs=1e-13)
    assert [float(v) for v in geo.reflection(*mirrored, mu1, gamma)] == pytest.approx([s1, s2], abs=1e-13)
    other = geo.inverted(s1, s2, mu1, gamma)
    assert float(other.first) == s2
    assert q(other, mu1, gamma) == pytest.approx(here, **close)
    assert float(geo.displacement(*other, mu1, gamma)) == pytest.approx(-d, abs=1e-13)


def test_without_noise_the_inverse_order_needs_no_adjustment():
    assert [float(v) for v in geo.inverted(0.1, 0.7, 5.0, 0.0)] == pytest.approx([0.7, 0.1], rel=1e-15)
    assert [float(v) for v in geo.reflection(0.1, 0.7, 5.0, 0.0)] == pytest.approx([0.7, 0.1], rel=1e-15)


@settings(max_examples=100, deadline=None)
@given(a=stimuli, b=stimuli, t=stimuli, mu1=stimuli, gamma=powers)
def test_symmetric_coordinates_are_symmetric(a, b, t, mu1, gamma):
    def tilde_q(a, b):
        return q(geo.from_symmetric(a, b, mu1, gamma), mu1, gamma)

    close = {"rel": 1e-9, "abs": 1e-12}
    assert tilde_q(a, b) == pytest.approx(tilde_q(b, a), **close)
    assert tilde_q(a + t, b + t) == pytest.approx(tilde_q(a, b), **close)
    width = float(geo.symmetric_width(SIGMA_P, gamma))
    assert tilde_q(a, b) == pytest.approx(Q0 * 2 ** -(((b - a) / width) ** 2), **close)


def test_it_is_a_rotation_about_the_prior_mean():
    rng = np.random.default_rng(0)
    s1, s2 = rng.normal(size=(2, 50))
    a, b = geo.to_symmetric(s1, s2, 0.8, 0.6)
    angle = float(geo.rotation_angle(0.6))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert np.stack([a, b]) == pytest.approx(turn @ np.stack([s1 - 0.8, s2 - 0.8]) + 0.8, abs=1e-14)
    assert np.stack(geo.from_symmetric(a, b, 0.8, 0.6)) == pytest.approx(np.stack([s1, s2]), abs=1e-14)
    assert [float(v) for v in geo.to_symmetric(0.8, 0.8, 0.8, 0.6)] == [0.8, 0.8]


def test_a_tiny_angle_far_away_costs_no_digits():
    gamma, mu1 = 1e-20, 1e9
    a, b = geo.to_symmetric(0.25, 0.5, mu1, gamma)
    with mpmath.workdps(60):
        p = mpmath.mpf(gamma)  # to 20 digits
        tangent = p / (2 - p)
        sine, cosine = tangent / mpmath.sqrt(1 + tangent**2), 1 / mpmath.sqrt(1 + tangent**2)
        dx, dy = mpmath.mpf(0.25) - mu1, mpmath.mpf(0.5) - mu1
        expected = float(mu1 + cosine * dx - sine * dy), float(mu1 + sine * dx + cosine * dy)
    assert (float(a), float(b)) == pytest.approx(expected, rel=1e-15)
    assert float(a) != 0.25


def test_bands_are_quantiles_of_the_lines():
    rng = np.random.default_rng(1)
    theta = Natural(rng.normal(0.3, 0.5, (4, 50)), np.full((4, 50), 0.3), rng.uniform(0.05, 0.29, (4, 50)), np.full((4, 50), 0.9))
    band = geo.axis_band(theta, [0.0, 0.5], levels=(0.1, 0.9))
    ratio = (1 + np.sqrt(1 + 4 * theta.gamma)) / 2
    lines = 1 / ratio[..., None] * np.array([0.0, 0.5]) + (1 - 1 / ratio[..., None]) * theta.mu1[..., None]
    assert band.s2 == pytest.approx(np.quantile(lines.reshape(-1, 2), [0.1, 0.9], axis=0), rel=1e-12)
    assert band.slope == pytest.approx(np.quantile(1 / ratio, [0.1, 0.9]))
    assert band.intercept == pytest.approx(np.quantile((1 - 1 / ratio) * theta.mu1, [0.1, 0.9]))


def test_the_plane_is_the_mean_over_draws(monkeypatch):
    rng = np.random.default_rng(2)
    theta = Natural(rng.normal(size=(2, 9)), rng.uniform(0.1, 1, (2, 9)), rng.uniform(0.01, 0.1, (2, 9)), rng.uniform(size=(2, 9)))
    s1, s2 = [0.0, 0.3, 0.7], [0.1, 0.2]
    whole = geo.plane(s1, s2, theta)
    for i, second in enumerate(s2):
        for j, first in enumerate(s1):
            assert whole.q[i, j] == pytest.approx(bt.model.equal_probability(first, second, *theta).mean(), rel=1e-12)
    monkeypatch.setattr(geo, "_BLOCK", 12)
    assert geo.plane(s1, s2, theta).q == pytest.approx(whole.q, rel=1e-14)


def test_bad_planes_are_refused():
    theta = Natural(*map(np.asarray, (0.0, 0.3, 0.1, 0.9)))
    with pytest.raises(InputError, match="grid"):
        geo.plane([], [0.0], theta)
    with pytest.raises(NumericalError, match="sigma_p"):
        geo.plane([0.0], [0.0], theta._replace(sigma_p=np.asarray(-1.0)))
