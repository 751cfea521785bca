"""The filter against the model's closed form, the paper's unsimplified equations, and exact conditioning of one big Gaussian."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_toe.errors import NumericalError
from bayes_toe.model import closed_form as model
from bayes_toe.model.beliefs import Gaussian, evolve, steady_prior, trial_view, update

EPS = np.finfo(float).eps


@settings(max_examples=100, deadline=None)
@given(
    s1=st.floats(-2, 2), s2=st.floats(-2, 2), mu1=st.floats(-5, 5),
    sigma_p=st.floats(-100, 100).map(lambda e: 10.0**e), gamma=st.floats(-30, 0).map(lambda e: 10.0**e),
)  # fmt: skip
def test_two_stimuli_are_the_papers_model(s1, s2, mu1, sigma_p, gamma):
    sigma_l = sigma_p * np.sqrt(gamma)
    view = trial_view(s1, s2, mu1, sigma_p, sigma_l)
    ratio = model.noise_ratio(sigma_p, sigma_l)
    assert float(view.evolved.mean) == pytest.approx(
        float(model.evolved_mean(s1, mu1, ratio)), rel=16 * EPS, abs=16 * EPS * 5
    )
    assert float(view.evolved.variance) == pytest.approx(
        float(view.prior.variance), rel=16 * EPS
    )  # self-consistent
    width = float(view.evolved.sd + sigma_l**2 / view.evolved.sd)
    assert width == pytest.approx(float(model.width(sigma_p, ratio)), rel=16 * EPS)
    z = float(model.normalised_distance(s1, s2, mu1, sigma_p, sigma_l))
    assert float(view.distance) == pytest.approx(z, rel=1e-12, abs=50 * EPS / sigma_p)
    shift = float(view.after_second.mean - view.evolved.mean) / float(
        view.evolved.sd
    )  # (mu_f - mu_2)/sigma_2
    assert shift == pytest.approx(z, rel=1e-9, abs=50 * EPS / sigma_p)


def test_the_unsimplified_equations_of_appendix_b():
    mu1, v1, vl, vp, s = (
        0.7,
        0.5,
        0.3,
        0.9,
        -0.4,
    )  # any prior variance, not only the self-consistent one
    vx = 1 / (1 / v1 + 1 / vl + 1 / vp)
    v2 = vp * vp / (vp - vx)
    mu2 = v2 / vp * vx * (mu1 / v1 + s / vl)  # Eq. app:m2v2, first form
    belief = evolve(update(Gaussian(np.asarray(mu1), np.asarray(v1)), s, np.sqrt(vl)), np.sqrt(vp))
    assert [float(v) for v in belief] == pytest.approx([mu2, v2], rel=1e-13)


def test_a_sequence_is_the_conditional_of_one_big_gaussian():
    times, mu1, sigma_p, sigma_l = 6, 0.4, 0.5, 0.35
    pauses = np.array([1.0, 0.2, 3.0, 0.0, 1.0])
    s = np.array([0.1, 0.9, -0.3, 0.3, 0.2, 1.5])
    before = [steady_prior(mu1, sigma_p, sigma_l)]
    for stimulus, pause in zip(s[:-1], pauses, strict=True):
        before.append(evolve(update(before[-1], stimulus, sigma_l), sigma_p, pause))
    walk = float(before[0].variance) + sigma_p**2 * np.concatenate([[0.0], np.cumsum(pauses)])
    state = np.minimum.outer(walk, walk)  # covariance of a random walk
    for t in range(times):
        seen = state[:t, :t] + sigma_l**2 * np.eye(t)
        pull = np.linalg.solve(seen, state[:t, t]) if t else np.zeros(0)
        assert float(before[t].mean) == pytest.approx(mu1 + pull @ (s[:t] - mu1), abs=1e-12)
        assert float(before[t].variance) == pytest.approx(
            state[t, t] - pull @ state[:t, t], rel=1e-12
        )


def test_bad_parameters_are_refused():
    with pytest.raises(NumericalError, match="sigma_p"):
        trial_view(0.0, 0.1, 0.0, 0.0, 0.1)
