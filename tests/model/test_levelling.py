"""Levelled coordinates: a bijection with the stated volume, and the funnel gone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.hard_cases import hard_cases

from bayes_toe.inference.maxima import find_maxima
from bayes_toe.model.ladder import posterior_of

CASES = hard_cases()


@pytest.fixture(scope="module", params=["funnel", "all different"])
def levelling(request):
    posterior = posterior_of(CASES[request.param])
    return posterior.levelling(find_maxima(posterior).x)


@given(st.tuples(st.floats(-3, 3), st.floats(-30, 30), st.floats(-5, 3), st.floats(-30, 30)))
def test_there_and_back(levelling, y):
    x, log_volume = levelling.unlevel(np.array([[y[0], y[1] / 4, y[2], y[3] / 4]]))
    back, same_volume = levelling.level(x)
    assert back[0] == pytest.approx([y[0], y[1] / 4, y[2], y[3] / 4], rel=1e-9, abs=1e-9)
    assert log_volume == pytest.approx(same_volume, rel=1e-9, abs=1e-9)


@given(st.tuples(st.floats(-1, 1), st.floats(-12, 12), st.floats(-3, 1), st.floats(-12, 12)))
def test_volume_is_the_determinant_of_differences(levelling, x):
    point, h = np.array([x]), 1e-5
    columns = [(levelling.level(point + h * e)[0] - levelling.level(point - h * e)[0])[0] / (2 * h) for e in np.eye(4)]
    assert levelling.level(point)[1][0] == pytest.approx(np.linalg.slogdet(np.array(columns))[1], abs=1e-4)


def test_beyond_the_smallest_float_is_nowhere():
    posterior = posterior_of(CASES["funnel"])
    levelling = posterior.levelling(find_maxima(posterior).x)
    x, _ = levelling.unlevel(np.array([[0.3, -60.0, 0.0, 0.0], [0.3, 0.0, 0.0, 50.0], [0.3, 0.0, 0.0, 0.0]]))
    assert x[0, 2] == x[1, 2] == 400.0
    assert (posterior.log_density(x)[:2] < -1e4).all()  # no weight at all
    assert np.isfinite(posterior.log_density(x)[2])


def test_prior_draws_far_down_the_funnel_have_unit_spread():
    posterior = posterior_of(CASES["funnel"])
    modes = find_maxima(posterior).x
    levelling = posterior.levelling(modes)
    x = posterior.sample_prior(np.random.default_rng(0), 400_000)
    deep = x[(x[:, 1] < -8) & (x[:, 2] > modes[0, 2] - 1)]
    assert len(deep) > 40
    assert levelling.level(deep)[0][:, 0].std() == pytest.approx(1.0, abs=0.35)
