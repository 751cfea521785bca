"""Fisher information against many-digit derivatives of q and against the log likelihood's own Hessian; spectra and dimensions."""

import mpmath
import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.errors import NumericalError
from bayes_toe.experiments.simulate import reference_design
from bayes_toe.experiments.sloppiness import (
    Spectrum,
    contraction,
    effective_dimension,
    fisher_information,
    fisher_spectrum,
    log_covariance,
    prior_covariance,
    sloppiness,
)
from bayes_toe.model.coordinates import Natural, unconstrained
from bayes_toe.model.target import hessian


def observer(mu1, sigma_p, sigma_l, q0):
    return Natural(*map(np.asarray, (mu1, sigma_p, sigma_l, q0)))


def design(n=50):
    d = reference_design()
    return bt.Subject("S", d.s1, d.s2, np.full(13, n // 2), np.full(13, n))


def information_in_many_digits(subject, theta):
    """Sum of n q_i q_j/(q (1 - q)) with q_i by differences of the unsimplified model."""
    with mpmath.workdps(300):
        q0, step = mpmath.mpf(float(theta.q0)), mpmath.mpf(10) ** -100
        x = [mpmath.mpf(float(theta.mu1)), mpmath.log(float(theta.sigma_p)), mpmath.log(float(theta.sigma_l)), mpmath.log(q0 / (1 - q0))]

        def probability(s1, s2, *at):
            mu1, vp, vl = at[0], mpmath.exp(2 * at[1]), mpmath.exp(2 * at[2])
            v = vp * (1 + mpmath.sqrt(1 + 4 * vl / vp)) / 2
            z = (float(s2) - (v * float(s1) + vl * mu1) / (v + vl)) / (mpmath.sqrt(v) + vl / mpmath.sqrt(v))
            return mpmath.power(2, -z * z) / (1 + mpmath.exp(-at[3]))

        total = mpmath.matrix(4, 4)
        for s1, s2, n in zip(subject.s1, subject.s2, subject.n_trials, strict=True):
            moved = [[probability(s1, s2, *(v + sign * step * (i == j) for j, v in enumerate(x))) for sign in (1, -1)] for i in range(4)]
            q, slope = probability(s1, s2, *x), mpmath.matrix([(high - low) / (2 * step) for high, low in moved])
            total += int(n) * (slope * slope.T) / (q * (1 - q))
        return np.array([[float(total[i, j]) for j in range(4)] for i in range(4)])


@pytest.mark.parametrize(
    "theta",
    [
        observer(-0.5, 0.25, 0.14, 0.9),
        observer(0.9, 0.3, 0.29, 0.97),
        observer(-0.6, 0.2, 1e-6, 0.9),  # hardly any order effect
        observer(0.2, 0.01, 0.005, 0.9),  # q is as small as 2^-2500
        observer(0.2, 0.3, 0.1, 1 - 1e-12),  # q near 1
        observer(-0.2, 40.0, 10.0, 0.5),
    ],
)
def test_information_against_many_digits(theta):
    expected = information_in_many_digits(design(), theta)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.abs(fisher_information(design(), theta) - expected) <= 1e-10 * scale).all()


def test_it_is_the_curvature_of_the_log_likelihood_where_data_are_the_models_own():
    theta, n = observer(-0.5, 0.25, 0.14, 0.9), 10**11
    d = reference_design()
    q = bt.model.equal_probability(d.s1, d.s2, *theta)
    posterior = bt.posterior_of(bt.Subject("S", d.s1, d.s2, np.rint(n * q).astype(np.int64), np.full(13, n)))
    sbar = posterior.sbar

    def x_of(phi):
        mu1, log_p, log_l, top = phi
        return unconstrained(observer(mu1, np.exp(log_p), np.exp(log_l), 1 / (1 + np.exp(-top))), sbar)

    phi = np.array([-0.5, np.log(0.25), np.log(0.14), np.log(9.0)])
    step = 1e-5
    jacobian = np.column_stack([(x_of(phi + step * e) - x_of(phi - step * e)) / (2 * step) for e in np.eye(4)])
    bend = hessian(lambda x: posterior.gradient(x)[1], x_of(phi)[None])[0]  # with 10^11 trials the prior's part is far below the tolerance
    expected = -jacobian.T @ bend @ jacobian / n
    found = fisher_information(posterior.subject, theta) / n
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-5 * np.abs(expected).max())


def test_the_spectrum_is_that_of_the_matrix_and_keeps_small_values():
    theta = observer(-0.5, 0.25, 0.14, 0.9)
    found, matrix = fisher_spectrum(design(), theta), fisher_information(design(), theta)
    assert found.values[::-1] == pytest.approx(np.linalg.eigvalsh(matrix), rel=1e-8)
    assert found.vectors @ np.diag(found.values) @ found.vectors.T == pytest.approx(matrix, rel=1e-10, abs=1e-10 * matrix.max())
    sloppy = fisher_spectrum(design(), observer(-0.5, 0.25, 1e-7, 0.9))
    with mpmath.workdps(60):
        exact = mpmath.eigsy(
            mpmath.matrix(information_in_many_digits(design(), observer(-0.5, 0.25, 1e-7, 0.9)).tolist()), eigvals_only=True
        )
    assert sloppy.values[:2] == pytest.approx([float(v) for v in sorted(exact, reverse=True)[:2]], rel=1e-9)
    assert sloppy.values[2] < 1e-20 * sloppy.values[0]  # mu_1 and sigma_l act together only


def test_few_pairs_leave_directions_without_information():
    one = bt.Subject("S", [0.0], [0.3], [20], [50])
    found = fisher_spectrum(one, observer(-0.5, 0.25, 0.14, 0.9))
    assert found.values[0] > 0
    assert found.values[1:] == pytest.approx(np.zeros(3), abs=1e-12 * found.values[0])
    assert found.participation_ratio == pytest.approx(1.0)
    assert Spectrum(np.ones(4), np.eye(4)).participation_ratio == pytest.approx(4.0)


@pytest.mark.parametrize("numbers", [{"sigma_p_scale": 0.2}, {"gamma_a": 3.0, "gamma_b": 0.5}, {"gamma_a": 0.3, "gamma_b": 20.0}])
def test_the_prior_covariance_is_that_of_prior_draws(numbers):
    prior = bt.Prior(mu1_mean=1.0, mu1_sd=3.0, **numbers)
    draws = prior.sample(np.random.default_rng(3), 400_000)
    found, expected = log_covariance(draws), prior_covariance(prior)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    # Kurtosis of these distributions is below 7: sd of a covariance below sqrt(7/n) of the scale; 5 of them.
    assert (np.abs(found - expected) < 5 * np.sqrt(7 / 400_000) * scale).all()


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (0.05, 1000.0), (2.5, 0.05), (1000.0, 1000.0)])
def test_the_prior_covariance_of_a_beta_is_the_closed_form(a, b):
    found = prior_covariance(bt.Prior(gamma_a=a, gamma_b=b))
    of_gamma = float(mpmath.psi(1, a) - mpmath.psi(1, a + b))  # variance of the logarithm of a beta variate
    assert 4.0 * (found[2, 2] - found[1, 1]) == pytest.approx(of_gamma, rel=1e-10, abs=1e-14)


def test_the_dimension_is_mackays_for_a_gaussian_posterior():
    theta, prior = observer(-0.5, 0.25, 0.14, 0.9), prior_covariance(bt.Prior())
    information = fisher_information(design(), theta)
    posterior = np.linalg.inv(information + np.linalg.inv(prior))
    found = effective_dimension(design(), theta, prior)
    assert found == pytest.approx(np.trace(information @ posterior), rel=1e-9)  # k - alpha trace(A^-1)
    ratios = contraction(posterior, prior)
    assert found == pytest.approx(np.sum(1 - ratios.ratios), rel=1e-9)  # the contraction, where everything is Gaussian
    assert np.diag(ratios.directions.T @ prior @ ratios.directions) == pytest.approx(np.ones(4))
    assert np.diag(ratios.directions.T @ posterior @ ratios.directions) == pytest.approx(ratios.ratios, rel=1e-6)


def test_contraction_does_not_depend_on_linear_coordinates():
    rng = np.random.default_rng(4)
    prior, turn = np.diag([2.0, 0.5, 1.0, 3.0]) + 0.1, rng.normal(size=(4, 4))
    posterior = np.linalg.inv(np.diag([1e4, 30.0, 1.0, 1e-3]) + np.linalg.inv(prior))
    once, again = contraction(posterior, prior), contraction(turn @ posterior @ turn.T, turn @ prior @ turn.T)
    assert again.ratios == pytest.approx(once.ratios, rel=1e-6)
    assert once.well_determined == 3


def test_more_trials_determine_more_and_none_nothing():
    theta, prior = observer(-0.5, 0.25, 0.14, 0.9), prior_covariance(bt.Prior())
    sizes = [effective_dimension(design(n), theta, prior) for n in (2, 50, 10**4, 10**9)]
    assert sizes == sorted(sizes)
    assert sizes[0] > 1.0
    assert sizes[-1] == pytest.approx(4.0, abs=1e-4)
    blind = observer(-0.5, 1e4, 1.0, 0.5)  # a width of 10^4: only q0 is seen
    assert effective_dimension(design(10**9), blind, prior) == pytest.approx(1.0, abs=1e-3)


def test_prior_draws_show_no_contraction():
    prior = bt.Prior()
    draws = prior.sample(np.random.default_rng(5), 200_000)
    found = contraction(log_covariance(draws), prior_covariance(prior))
    assert found.ratios == pytest.approx(np.ones(4), abs=0.03)
    assert found.well_determined == 0


def test_one_subject_with_its_draws(analysis):
    for name in analysis.draws.names:
        found = sloppiness(analysis.study[name], analysis.draws.natural(name))
        assert 2.5 < found.effective_dimension < 4.0
        assert found.contraction.well_determined in (3, 4)
        assert found.covariance.values[0] > 10 * found.covariance.values[-1]
        assert found.information.values[0] > 100 * found.information.values[-1]


@pytest.mark.parametrize("edge", [{"sigma_l": 0.0}, {"q0": 1.0}, {"q0": 0.0}, {"sigma_p": np.nan}])
def test_edges_have_no_logarithm(edge):
    theta = observer(**({"mu1": 0.0, "sigma_p": 0.3, "sigma_l": 0.1, "q0": 0.9} | edge))
    with pytest.raises(NumericalError):
        fisher_information(design(), theta)
