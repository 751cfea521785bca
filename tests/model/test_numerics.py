"""The log posterior and its gradient over the whole range of floats, against brute-force arithmetic with hundreds of digits."""

import numpy as np
import pytest
from definitions import assert_agrees
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.special import logit

from bayes_toe.data.study import Subject
from bayes_toe.model.closed_form import MAX_PULL, pull, variance_ratio
from bayes_toe.model.ladder import posterior_of

DIGITS = 650


def point(mu1, gamma, sigma_p, lapse, sbar):
    """Unconstrained coordinates of an observer; 1 - q0 may be far below machine precision."""
    p = float(pull(gamma))
    log_width = np.log(sigma_p) + 1.5 * np.log(float(variance_ratio(gamma)))
    return [p * (mu1 - sbar), float(logit(p / MAX_PULL)), log_width, float(np.log1p(-lapse) - np.log(lapse))]


powers = st.floats(-300, -1e-9).map(lambda e: 10.0**e)
counts = st.integers(0, 10**9)


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(
    gamma=powers,
    sigma_p=st.floats(-150, 150).map(lambda e: 10.0**e),
    lapse=st.one_of(powers, st.floats(0.01, 0.99)),
    z=st.one_of(st.just(0.0), st.floats(-160, 2).map(lambda e: 10.0**e), st.floats(2, 149).map(lambda e: 10.0**e)),
    mu1=st.floats(-20, 20),
    answers=st.tuples(counts, counts),
)
def test_one_pair_over_the_whole_range_of_floats(gamma, sigma_p, lapse, z, mu1, answers):
    equal, different = answers
    if equal + different == 0:
        equal = 1
    assume(different < 1e300 * lapse)  # beyond, the odds of these answers at z = 0 are no floats, though the derivatives may be
    width = sigma_p * float(variance_ratio(gamma)) ** 1.5
    # sbar is the pair's own first stimulus, so the displacement is s2 - s1 - c: the second stimulus is placed z widths away.
    step = z * width + float(pull(gamma)) * mu1
    subject = Subject("S", [0.0], [step], [equal], [equal + different])
    posterior = posterior_of(subject)
    x = point(mu1, gamma, sigma_p, lapse, 0.0)
    # Rounding the displacement itself costs what its cancellation costs: only well-conditioned displacements are held to 1e-12.
    if z == 0.0 or abs(x[0]) < 4 * abs(step - x[0]):
        x[0] = x[0] if z else step
        assert_agrees(posterior, x, digits=DIGITS)


@settings(max_examples=40, deadline=None, derandomize=True, database=None)
@given(
    gamma=st.floats(-12, -0.001).map(lambda e: 10.0**e),
    sigma_p=st.floats(0.1, 2),
    lapse=st.floats(-12, -0.1).map(lambda e: 10.0**e),
    mu1=st.floats(-3, 3),
    offset=st.sampled_from([0.0, 0.5, 1e6]),
    scale=st.sampled_from([1, 1000, 10**7]),
)
def test_many_pairs_wherever_the_stimuli_lie(gamma, sigma_p, lapse, mu1, offset, scale):
    # Multiples of 2^-6 stay exact when a million is added.
    grid = np.array([0, 9, 20, 28, 32]) / 64 + offset
    s1 = np.concatenate([grid, np.full(4, grid[0]), grid[1:]])
    s2 = np.concatenate([grid, grid[1:], np.full(4, grid[0])])
    equal = scale * np.array([45, 40, 42, 44, 46, 30, 20, 9, 3, 41, 35, 22, 12])
    posterior = posterior_of(Subject("S", s1, s2, equal, np.full(13, 50 * scale)))
    x = point(mu1 + posterior.sbar, gamma, sigma_p, lapse, posterior.sbar)
    z = posterior.distance(np.array([x]))[0]
    if np.abs(z).min() > 1e-3:
        assert_agrees(posterior, x, digits=DIGITS)


def test_ten_thousand_pairs_and_a_thousand_million_trials_each():
    rng = np.random.default_rng(0)
    s1, s2 = rng.uniform(0, 1, (2, 10_000))
    n = np.full(10_000, 10**9)
    posterior = posterior_of(Subject("S", s1, s2, (n * np.exp(-((s1 - s2) ** 2))).astype(int), n))
    x = np.array([0.05, 0.0, -0.2, 2.0])
    one_by_one = [posterior_of(Subject("S", s1[i : i + 1], s2[i : i + 1], posterior.subject.n_equal[:1], n[:1])) for i in range(2)]
    assert np.isfinite(posterior.log_density([x])[0])
    assert all(np.isfinite(part.log_density([x])[0]) for part in one_by_one)
    _, gradient = posterior.gradient([x])
    h = 1e-6
    for i, unit in enumerate(np.eye(4)):
        difference = (posterior.log_density([x + h * unit]) - posterior.log_density([x - h * unit]))[0] / (2 * h)
        assert gradient[0, i] == pytest.approx(difference, rel=1e-5, abs=1e-2 * 10_000)


@pytest.mark.parametrize("a", [-1e4, -745.0, 745.0, 1e4])
@pytest.mark.parametrize("top", [-1e4, -745.0, 745.0, 1e4])
def test_far_beyond_any_float_nothing_is_nan(a, top):
    s1, s2 = np.array([0.0, 0.0, 0.3]), np.array([0.0, 0.3, 0.0])
    posterior = posterior_of(Subject("S", s1, s2, [5, 2, 3], [10, 10, 10]))
    for c in (0.0, 1e-320, 0.5):
        assert not np.isnan(posterior.log_density([[c, a, 0.0, top]])[0])
