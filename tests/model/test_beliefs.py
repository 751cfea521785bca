"""The filter against the model's closed form, the paper's unsimplified equations, and exact conditioning of one big Gaussian."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bayes_toe as bt
from bayes_toe.errors import InputError, NumericalError
from bayes_toe.model import closed_form as model
from bayes_toe.model.beliefs import Gaussian, evolve, sequence_view, steady_prior, trial_view, update

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
    assert float(view.evolved.mean) == pytest.approx(float(model.evolved_mean(s1, mu1, ratio)), rel=16 * EPS, abs=16 * EPS * 5)
    assert float(view.evolved.variance) == pytest.approx(float(view.prior.variance), rel=16 * EPS)  # self-consistent
    width = float(view.evolved.sd + sigma_l**2 / view.evolved.sd)
    assert width == pytest.approx(float(model.width(sigma_p, ratio)), rel=16 * EPS)
    z = float(model.normalised_distance(s1, s2, mu1, sigma_p, sigma_l))
    assert float(view.distance) == pytest.approx(z, rel=1e-12, abs=50 * EPS / sigma_p)
    shift = float(view.after_second.mean - view.evolved.mean) / float(view.evolved.sd)  # (mu_f - mu_2)/sigma_2
    assert shift == pytest.approx(z, rel=1e-9, abs=50 * EPS / sigma_p)


def test_the_unsimplified_equations_of_appendix_b():
    mu1, v1, vl, vp, s = 0.7, 0.5, 0.3, 0.9, -0.4  # any prior variance, not only the self-consistent one
    vx = 1 / (1 / v1 + 1 / vl + 1 / vp)
    v2 = vp * vp / (vp - vx)
    mu2 = v2 / vp * vx * (mu1 / v1 + s / vl)  # Eq. app:m2v2, first form
    belief = evolve(update(Gaussian(np.asarray(mu1), np.asarray(v1)), s, np.sqrt(vl)), np.sqrt(vp))
    assert [float(v) for v in belief] == pytest.approx([mu2, v2], rel=1e-13)


def test_a_sequence_is_the_conditional_of_one_big_gaussian():
    times, mu1, sigma_p, sigma_l = 6, 0.4, 0.5, 0.35
    pauses = np.array([1.0, 0.2, 3.0, 0.0, 1.0])
    s = np.array([0.1, 0.9, -0.3, 0.3, 0.2, 1.5])
    view = sequence_view(s, mu1, sigma_p, sigma_l, intervals=pauses)
    v1 = float(steady_prior(mu1, sigma_p, sigma_l).variance)
    walk = v1 + sigma_p**2 * np.concatenate([[0.0], np.cumsum(pauses)])
    state = np.minimum.outer(walk, walk)  # covariance of a random walk
    for t in range(times):
        seen = state[:t, :t] + sigma_l**2 * np.eye(t)
        pull = np.linalg.solve(seen, state[:t, t]) if t else np.zeros(0)
        assert view.before.mean[t] == pytest.approx(mu1 + pull @ (s[:t] - mu1), abs=1e-12)
        assert view.before.variance[t] == pytest.approx(state[t, t] - pull @ state[:t, t], rel=1e-12)


@pytest.mark.parametrize("bad", [{"intervals": [1.0, 1.0]}, {"intervals": [-1.0]}, {"intervals": [np.nan]}])
def test_bad_intervals_are_refused(bad):
    with pytest.raises(InputError, match="2 stimuli need 1 finite"):
        sequence_view([0.0, 0.3], 0.0, 0.3, 0.1, **bad)


def test_bad_sequences_and_parameters_are_refused():
    with pytest.raises(InputError, match="at least one"):
        sequence_view([], 0.0, 0.3, 0.1)
    with pytest.raises(NumericalError, match="sigma_p"):
        trial_view(0.0, 0.1, 0.0, 0.0, 0.1)


def test_a_stream_at_another_pace_is_the_papers_model_with_more_diffusion():
    mu1, sigma_p, sigma_l, q0, pause = 0.4, 0.3, 0.2, 0.93, 2.5
    slow = sigma_p * np.sqrt(pause)
    found = bt.model.noticed([0.1, 0.7], mu1, sigma_p, sigma_l, q0, intervals=[pause], prior=steady_prior(mu1, slow, sigma_l))
    assert found[0] == pytest.approx(1 - float(bt.model.equal_probability(0.1, 0.7, mu1, slow, sigma_l, q0)), abs=1e-13)


def test_noticed_along_a_sequence_by_densities_on_a_grid():
    # The literal route: multiply by the likelihood, smear by the propagator, read off means and sds, apply the decision rule to the shift.
    grid = np.linspace(-6, 6, 2401)
    mu1, sigma_p, sigma_l, q0 = 0.5, 0.4, 0.3, 0.9
    s, pauses = [-0.3, 0.2, 0.9, 0.9, -0.4], [1.0, 0.5, 2.0, 0.7]

    def normal(mean, sd):
        return np.exp(-0.5 * ((grid - mean) / sd) ** 2)

    def moments(density):
        mean = (grid * density).sum() / density.sum()
        return mean, np.sqrt((np.square(grid - mean) * density).sum() / density.sum())

    density = normal(mu1, float(steady_prior(mu1, sigma_p, sigma_l).sd)) * normal(s[0], sigma_l)
    expected = []
    for stimulus, pause in zip(s[1:], pauses, strict=True):
        density = np.convolve(density, normal(0.0, sigma_p * np.sqrt(pause)), "same")
        mean, sd = moments(density)
        density = density / density.sum() * normal(stimulus, sigma_l)
        expected.append(1 - q0 * 2 ** -(((moments(density)[0] - mean) / sd) ** 2))
    assert bt.model.noticed(s, mu1, sigma_p, sigma_l, q0, intervals=pauses) == pytest.approx(expected, abs=1e-9)


def test_noticed_takes_draws_and_their_own_sequences():
    rng = np.random.default_rng(6)
    mu1, sigma_p, sigma_l, q0 = rng.normal(size=50), rng.uniform(0.2, 0.5, 50), rng.uniform(0.1, 0.2, 50), rng.uniform(0.8, 1, 50)
    s = np.array([0.0, 0.3, -0.2, 0.5])
    found = bt.model.noticed(s, mu1, sigma_p, sigma_l, q0, intervals=[1, 2, 0.5])
    assert found.shape == (50, 3)
    one = bt.model.noticed(s, mu1[7], sigma_p[7], sigma_l[7], q0[7], intervals=[1, 2, 0.5])
    assert found[7] == pytest.approx(one, rel=1e-13)
    chains = bt.model.noticed(s, *(v.reshape(2, 25) for v in (mu1, sigma_p, sigma_l, q0)), intervals=[1, 2, 0.5])
    assert chains.reshape(50, 3) == pytest.approx(found, rel=1e-13)
    own = bt.model.noticed(np.tile(s, (50, 1)), mu1, sigma_p, sigma_l, q0, intervals=[1, 2, 0.5])
    assert own == pytest.approx(found, rel=1e-13)


def test_only_lapses_are_noticed_in_a_constant_stream_in_the_end_and_a_longer_pause_blurs():
    s = np.zeros(80)
    found = bt.model.noticed(s, 2.0, 0.3, 0.2, 0.9)
    assert np.all(np.diff(found) <= 1e-15)
    assert found[0] > 0.2
    assert found[-1] == pytest.approx(0.1, abs=1e-12)
    s[-1] = 0.4
    assert bt.model.noticed(s, 0.0, 0.3, 0.2, 0.9)[-1] > bt.model.noticed(s, 0.0, 0.3, 0.2, 0.9, intervals=[1] * 78 + [4])[-1]


def test_noticed_refuses_what_it_cannot_use():
    with pytest.raises(InputError, match="at least two stimuli"):
        bt.model.noticed([0.0], 0.0, 0.3, 0.1, 0.9)
    with pytest.raises(InputError, match="3 stimuli need 2 finite"):
        bt.model.noticed([0.0, 0.1, 0.2], 0.0, 0.3, 0.1, 0.9, intervals=[1.0])
    with pytest.raises(NumericalError, match="q0"):
        bt.model.noticed([0.0, 0.1], 0.0, 0.3, 0.1, 1.1)
