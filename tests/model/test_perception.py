"""Appendix A numerically: closed form, conservation of mass, detailed balance, and adaptive integration of a skewed case."""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from bayes_toe.errors import InputError, NumericalError
from bayes_toe.model.perception import gaussian_perception, induced_prior, perceive


def normal(x, mean, sd):
    return -0.5 * ((x - mean) / sd) ** 2 - np.log(sd * np.sqrt(2 * np.pi))


def skewed_prior(s):
    """Gumbel: a long tail to the right."""
    return -(s + np.exp(-s))


def skewed_noise(phi, s):
    """Noise that grows with the stimulus, with a logistic shape."""
    scale = 0.15 * np.exp(0.3 * s)
    u = (phi - s) / scale
    return -np.abs(u) - 2 * np.log1p(np.exp(-np.abs(u))) - np.log(scale)


WIDE = {"s_range": (-4.0, 8.0), "phi_range": (-6.0, 20.0)}


def test_the_gaussian_case_is_its_closed_form():
    s_star = np.array([-0.7, 0.0, 0.9])
    seen = perceive(s_star, lambda phi, s: normal(phi, s, 0.2), lambda s: normal(s, 0.1, 0.3), s_range=(-4, 4), phi_range=(-4, 4))
    mean, variance = gaussian_perception(s_star, 0.1, 0.3**2, 0.2**2)
    expected = np.exp(normal(seen.s, mean[:, None], np.sqrt(variance)))
    assert np.abs(seen.density - expected).max() < 1e-10
    near = expected > 1e-30  # and relative, far into the tails
    assert np.abs(seen.density[near] / expected[near] - 1).max() < 1e-10
    assert seen.mean == pytest.approx(mean, abs=1e-13)
    assert seen.variance == pytest.approx(np.broadcast_to(variance, 3), rel=1e-12)
    assert seen.error.max() < 1e-12


def test_the_closed_form_by_simulation():
    rng = np.random.default_rng(5)
    m, v, n, s_star = 0.4, 0.5, 0.2, 1.1
    phi = s_star + np.sqrt(n) * rng.standard_normal(400_000)
    k = v / (v + n)
    inferred = m + k * (phi - m) + np.sqrt(k * n) * rng.standard_normal(400_000)  # a draw from p(s | phi)
    mean, variance = gaussian_perception(s_star, m, v, n)
    assert inferred.mean() == pytest.approx(float(mean), abs=5 * np.sqrt(float(variance) / 400_000))
    assert inferred.var() == pytest.approx(float(variance), rel=5 * np.sqrt(2 / 400_000))


def test_mass_is_conserved_whatever_the_densities():
    seen = perceive([-0.5, 0.5, 2.0], skewed_noise, skewed_prior, nodes=1025, **WIDE)
    assert seen.mass == pytest.approx(np.ones(3), abs=1e-6)
    assert np.exp(seen.log_prior).sum() * (seen.s[1] - seen.s[0]) == pytest.approx(1.0, abs=1e-3)


def test_a_grid_too_narrow_shows_in_the_mass():
    seen = perceive([0.0], lambda phi, s: normal(phi, s, 0.5), lambda s: normal(s, 0.0, 1.0), s_range=(-6, 6), phi_range=(0.0, 6.0))
    assert float(seen.mass[0]) == pytest.approx(0.5, abs=0.01)


def test_a_skewed_case_by_adaptive_integration():
    seen = perceive([0.5], skewed_noise, skewed_prior, nodes=1025, **WIDE)

    def evidence(phi):
        return quad(lambda s: np.exp(skewed_noise(phi, s) + skewed_prior(s)), -4, 8, points=[phi] if -4 < phi < 8 else None, limit=200)[0]

    for i in (340, 380, 430):
        s = seen.s[i]

        def integrand(phi, s=s):
            return np.exp(skewed_noise(phi, s) + skewed_prior(s) + skewed_noise(phi, 0.5)) / evidence(phi)

        expected = quad(integrand, -3, 8, points=[0.5, s], limit=200)[0]
        assert seen.density[0, i] == pytest.approx(expected, rel=1e-4)
        assert abs(seen.density[0, i] - expected) < max(float(seen.error[0]), 1e-6) * seen.density.max()


def test_inference_and_stimulation_are_in_detailed_balance():
    # p_post(s | s*) p(s*) is symmetric: both are integrals of p(phi | s) p(s) p(phi | s*) p(s*) / p(phi).
    grid = np.linspace(-1.0, 2.0, 7)
    seen = perceive(grid, skewed_noise, skewed_prior, nodes=769, **WIDE)
    at = np.rint((grid - seen.s[0]) / (seen.s[1] - seen.s[0])).astype(int)
    assert seen.s[at] == pytest.approx(grid, abs=1e-12)  # the stimuli are nodes
    joint = seen.log_density[:, at] + skewed_prior(grid)[:, None]
    assert joint == pytest.approx(joint.T, abs=1e-10)


def test_an_observer_whose_prior_is_right_gets_it_back():
    s_star = np.linspace(-4.0, 8.0, 193)
    seen = perceive(s_star, skewed_noise, skewed_prior, nodes=385, **WIDE)
    back = induced_prior(seen, skewed_prior(s_star))
    assert back == pytest.approx(np.exp(seen.log_prior), abs=2e-4)


def test_the_likelihood_is_the_posterior_over_the_prior():
    seen = perceive([0.3], lambda phi, s: normal(phi, s, 0.2), lambda s: normal(s, 0.0, 0.3), s_range=(-4, 4), phi_range=(-4, 4))
    found = np.exp(seen.log_likelihood(-1.0))[0]
    k, n = 0.09 / 0.13, 0.04
    expected = np.exp(normal(seen.s, k * 0.3, np.sqrt(k * n * (1 + k))) - 1.0 - normal(seen.s, 0.0, 0.3))
    assert found == pytest.approx(expected, rel=1e-9)


def test_the_stated_error_covers_the_true_one():
    for nodes in (33, 49, 65, 97):
        seen = perceive(
            [0.5], lambda phi, s: normal(phi, s, 0.2), lambda s: normal(s, 0.0, 0.3), s_range=(-4, 4), phi_range=(-4, 4), nodes=nodes
        )
        mean, variance = gaussian_perception(0.5, 0.0, 0.09, 0.04)
        expected = np.exp(normal(seen.s, mean, np.sqrt(variance)))
        assert np.abs(seen.density - expected).max() <= float(seen.error[0]) * seen.density.max() + 1e-14


def test_a_prior_with_edges_leaves_nothing_outside():
    seen = perceive(
        [0.2],
        lambda phi, s: normal(phi, s, 0.1),
        lambda s: np.where(np.abs(s) <= 0.5, 0.0, -np.inf),
        s_range=(-1, 1),
        phi_range=(-1.2, 1.2),
    )
    outside = np.abs(seen.s) > 0.5
    assert (seen.density[0, outside] == 0).all()
    assert (seen.log_likelihood(0.0)[0, outside] == -np.inf).all()
    assert float(seen.mass[0]) == pytest.approx(1.0, abs=1e-10)


def test_any_unit_of_the_activity_gives_the_same_posterior():
    # phi = exp(s) with noise in its logarithm: a change of variable that inference does not see.
    here = perceive([0.3], lambda phi, s: normal(phi, s, 0.2), lambda s: normal(s, 0.0, 0.3), s_range=(-3, 3), phi_range=(-3, 3))
    other = perceive(
        [0.3],
        lambda phi, s: stats.lognorm.logpdf(phi, 0.2, scale=np.exp(s)),
        lambda s: normal(s, 0.0, 0.3),
        s_range=(-3, 3),
        phi_range=(1e-3, 12.0),
        nodes=1025,
    )
    assert other.density[0, ::2] == pytest.approx(here.density[0], abs=1e-8)


def test_densities_that_end_with_the_grid_keep_their_ends():
    seen = perceive([0.4], lambda phi, s: normal(phi, s, 0.3), lambda s: np.full(s.shape, 7.0), s_range=(0, 1), phi_range=(-3, 4))
    assert seen.log_prior == pytest.approx(np.zeros(513), abs=1e-12)  # uniform on 0..1, whatever constant came in
    assert float(seen.mass[0]) == pytest.approx(1.0, abs=1e-10)


@pytest.mark.parametrize("options", [{"nodes": 64}, {"nodes": 3}, {"s_range": (1, 1)}, {"phi_range": (0, np.inf)}])
def test_bad_grids_are_refused(options):
    grid = {"s_range": (-4, 4), "phi_range": (-4, 4)} | options
    with pytest.raises(InputError):
        perceive([0.0], lambda phi, s: normal(phi, s, 1.0), lambda s: normal(s, 0.0, 1.0), **grid)


def test_impossible_densities_are_refused():
    grid = {"s_range": (-4, 4), "phi_range": (-4, 4)}
    with pytest.raises(NumericalError, match="log_prior returned NaN"):
        perceive([0.0], lambda phi, s: normal(phi, s, 1.0), lambda s: s * np.nan, **grid)
    near = perceive([0.3], lambda phi, s: np.where(np.abs(phi - s) < 0.5, 0.0, -np.inf), lambda s: np.where(s > 0, -s, -np.inf), **grid)
    assert np.isfinite(near.mass).all()
    with pytest.raises(NumericalError, match="no posterior exists"):
        perceive([-2.0], lambda phi, s: np.where(np.abs(phi - s) < 0.5, 0.0, -np.inf), lambda s: np.where(s > 0, -s, -np.inf), **grid)
    with pytest.raises(InputError, match="even, rising grid"):
        induced_prior(perceive([0.0, 1.0, 1.5], lambda phi, s: normal(phi, s, 1.0), lambda s: normal(s, 0.0, 1.0), **grid), 0.0)
