"""The hierarchical model of H1 in its plainest form, for samplers that other people wrote; independent of the package's own formulas.

    eta_i = (mu1, probit gamma, log w, probit q0) of subject i,   eta_ik ~ Normal(m_k, tau_k^2)
    m ~ Normal((s_ref, 0, log scale, 1), (2, 1, 1, 1)^2),         tau ~ HalfNormal(2, 1, 0.7, 1)

with gamma = sigma_l^2/sigma_p^2, G = (1 + sqrt(1 + 4 gamma))/2, p = gamma/G^2, z = (s2 - s1 + p (s1 - mu1))/w, P(equal) = q0 2^(-z^2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import log_ndtr, ndtr

import bayes_toe as bt

NAMES = ("mu1", "probit_gamma", "log_width", "probit_q0")
PRIOR_SD = np.array([2.0, 1.0, 1.0, 1.0])
TAU_SCALE = np.array([2.0, 1.0, 0.7, 1.0])


@dataclass(frozen=True, eq=False)
class Counts:
    """Counts of a study, each (subjects, most pairs); a pair that a subject never met has no answers, and so no weight.

    Attributes
    ----------
    prior_mean : array, shape (4,)
        Of m. s_ref is the mean s1, scale the root mean square of the s2 - s1 that are not zero, both over all trials.
    """

    study: bt.Study
    s1: np.ndarray
    s2: np.ndarray
    equal: np.ndarray
    different: np.ndarray
    prior_mean: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Of the subjects."""
        return self.study.names


def counts_of(study: bt.Study) -> Counts:
    """What the models need of a study without intervals."""
    shape = (len(study), max(one.n_pairs for one in study))
    s1, s2, equal, trials = np.zeros((4, *shape))
    for row, one in enumerate(study):
        for to, values in zip((s1, s2, equal, trials), (one.s1, one.s2, one.n_equal, one.n_trials), strict=True):
            to[row, : one.n_pairs] = values
    apart = trials * (s1 != s2)
    scale = np.sqrt(np.sum(apart * (s2 - s1) ** 2) / apart.sum())
    prior_mean = np.array([np.sum(trials * s1) / trials.sum(), 0.0, np.log(scale), 1.0])
    return Counts(study, s1, s2, equal, trials - equal, prior_mean)


def jax_terms(counts: Counts) -> Callable[[Any, Any, Any], tuple[Any, Any, Any]]:
    """(m, tau, eta) to the log likelihood, the log population and the log hyperprior, in JAX.

    The likelihood has no binomial coefficients; the two others are normalised, and a density in tau (not in log tau).
    """
    from jax import numpy as jnp
    from jax.scipy.stats import norm

    def terms(m: Any, tau: Any, eta: Any) -> tuple[Any, Any, Any]:
        population = norm.logpdf(eta, m, tau).sum()
        hyperprior = norm.logpdf(m, counts.prior_mean, PRIOR_SD).sum() + (jnp.log(2.0) + norm.logpdf(tau, 0.0, TAU_SCALE)).sum()
        return jax_log_likelihood(counts, eta), population, hyperprior

    return terms


def jax_log_likelihood(counts: Counts, eta: Any) -> Any:
    """Of all subjects, without binomial coefficients, in JAX."""
    from jax import numpy as jnp
    from jax.scipy import special

    mu1, probit_gamma, log_w, probit_q0 = (eta[:, k, None] for k in range(4))
    gamma = special.ndtr(probit_gamma)
    ratio = 0.5 * (1.0 + jnp.sqrt(1.0 + 4.0 * gamma))
    z = (counts.s2 - counts.s1 + gamma / ratio**2 * (counts.s1 - mu1)) * jnp.exp(-log_w)
    fall = jnp.log(2.0) * z**2
    q0 = special.ndtr(probit_q0)  # its logarithm costs less than JAX's log_ndtr, and is as good above -37
    log_different = jnp.log(special.ndtr(-probit_q0) - q0 * jnp.expm1(-fall))
    return jnp.sum(counts.equal * (jnp.log(q0) - fall) + counts.different * log_different)


def log_likelihood(counts: Counts, eta: np.ndarray) -> tuple[float, np.ndarray]:
    """The same in NumPy, with its gradient (subjects, 4) by hand."""
    mu1, probit_gamma, log_w, probit_q0 = (eta[:, k, None] for k in range(4))
    gamma, inverse_w = ndtr(probit_gamma), np.exp(-log_w)
    root = np.sqrt(1.0 + 4.0 * gamma)
    ratio = 0.5 * (1.0 + root)
    pull = gamma / ratio**2
    z = (counts.s2 - counts.s1 + pull * (counts.s1 - mu1)) * inverse_w
    fall = np.log(2.0) * z**2
    log_q0, q = log_ndtr(probit_q0), ndtr(probit_q0) * np.exp(-fall)
    different = ndtr(-probit_q0) - ndtr(probit_q0) * np.expm1(-fall)
    value = np.sum(counts.equal * (log_q0 - fall) + counts.different * np.log(different))
    odds = counts.different * q / different
    by_log_q = counts.equal - odds  # slope in log q0 and in -fall
    by_z = -2.0 * np.log(2.0) * z * by_log_q
    slope_gamma = _density(probit_gamma) / (root * ratio**2)
    hazard = np.exp(-0.5 * probit_q0**2 - log_q0) / np.sqrt(2.0 * np.pi)
    slopes = (-by_z * pull * inverse_w, by_z * (counts.s1 - mu1) * inverse_w * slope_gamma, -by_z * z, by_log_q * hazard)
    return float(value), np.stack([slope.sum(axis=1) for slope in slopes], axis=1)


def _density(x: np.ndarray) -> np.ndarray:
    return np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi)


def golden(counts: Counts, seed: int) -> dict[str, np.ndarray]:
    """Two hundred points with their log joint density and its gradient by automatic differentiation in double precision.

    Every fourth block of fifty: near what studies show, as the hyperprior has it, wide, and tau from 1e-3 to 20 with eta far from m.

    Returns
    -------
    dict
        m, tau (200, 4), eta (200, subjects, 4); log_likelihood, log_population, log_hyperprior and their sum log_density (200,);
        d_m, d_log_tau (200, 4), d_eta (200, subjects, 4) of log_density, without a Jacobian of log tau; the counts and prior_mean.
    """
    import jax
    from jax import numpy as jnp

    jax.config.update("jax_enable_x64", True)
    terms = jax_terms(counts)

    def density(m: Any, log_tau: Any, eta: Any) -> Any:
        each = terms(m, jnp.exp(log_tau), eta)
        return sum(each), each

    (values, each), slopes = jax.vmap(jax.value_and_grad(density, argnums=(0, 1, 2), has_aux=True))(*_points(counts, seed))
    m, log_tau, eta = _points(counts, seed)
    found = dict(zip(("log_likelihood", "log_population", "log_hyperprior"), each, strict=True)) | {"log_density": values}
    found |= dict(zip(("d_m", "d_log_tau", "d_eta"), slopes, strict=True))
    data = {key: getattr(counts, key) for key in ("names", "s1", "s2", "equal", "different", "prior_mean")}
    return {key: np.asarray(value) for key, value in {"m": m, "tau": np.exp(log_tau), "eta": eta, **found, **data}.items()}


def _points(counts: Counts, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """m, log tau, eta of the golden points."""
    rng = np.random.default_rng(seed)
    shape = (50, 4)
    seen = np.array([counts.prior_mean[0], -0.5, counts.prior_mean[2], 1.4])
    sd = np.array([0.6, 0.5, 0.2, 0.3])
    near = seen + 0.3 * sd * rng.standard_normal(shape), np.log(sd) + 0.3 * rng.standard_normal(shape)
    drawn = counts.prior_mean + PRIOR_SD * rng.standard_normal(shape), np.log(TAU_SCALE * abs(rng.standard_normal(shape)))
    wide = counts.prior_mean + 2.0 * PRIOR_SD * rng.standard_normal(shape), np.log(2.0 * TAU_SCALE) + 0.2 * rng.standard_normal(shape)
    far = counts.prior_mean + PRIOR_SD * rng.standard_normal(shape), rng.uniform(np.log(1e-3), np.log(20.0), shape)
    m, log_tau = (np.concatenate(part) for part in zip(near, drawn, wide, far, strict=True))
    spread = np.exp(log_tau)
    spread[150:] = [4.0, 2.5, 1.5, 2.5]  # not as tau has it
    return m, log_tau, m[:, None] + spread[:, None] * rng.standard_normal((200, len(counts.names), 4))
