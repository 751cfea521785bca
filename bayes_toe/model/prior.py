"""The prior over one observer's parameters: proper, stated, replaceable. The evidence depends on it.

mu1 ~ Normal(mu1_mean, mu1_sd), sigma_p ~ HalfNormal(sigma_p_scale), gamma ~ Beta(gamma_a, gamma_b), q0 ~ Uniform(0, 1), independent.
The defaults are the paper's V_1 = 10^2 for mu1 and its constraint 0 < sigma_l < sigma_p, gamma uniform; q0 has the prior that each
frequency has under H0. Parameters that H1 does not have (noise slope, lapse rate, exponent, intra-class correlation) have theirs here too;
the constant error's is in :mod:`bayes_toe.model.offset_prior`.

The numbers are declared in :mod:`bayes_toe.model.prior_fields`, the families in :attr:`Prior.families`; nothing else names them. Another
prior is a subclass that declares its number, or its family, in one place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.special import expit

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL, pull, width
from bayes_toe.model.coordinates import Natural, inverse_pull, log_jacobian_of_pull, log_noise_ratio, reach
from bayes_toe.model.distributions import LOG_2PI as LOG_2PI
from bayes_toe.model.distributions import (
    Beta,
    Distribution,
    HalfNormal,
    LogNormal,
    Normal,
    Random,
    Uniform,
    log_density_of_logit,
    sample_logit,
    share,
    slope_of_logit,
)
from bayes_toe.model.prior_fields import OF_H1, STIMULI, PriorFields


@dataclass(frozen=True)
class Prior(PriorFields):
    """Prior density of (mu1, sigma_p, gamma, q0), and the priors of what other models have; all log densities are normalised.

    Parameters
    ----------
    mu1_mean, mu1_sd : float or "stimuli"
        Mean and standard deviation of mu1, natural-log intensity; "stimuli" stands for mean and range of the stimuli presented, here and
        below, and becomes a number where the prior meets a study (:func:`bayes_toe.model.study_prior.prior_for`).
    sigma_p_scale : float or "stimuli"
        Scale of the half-normal of sigma_p, natural-log intensity; the root mean square step between different stimuli.
    gamma_a, gamma_b : float
        Of the beta distribution of gamma.
    offset_sd : float, optional
        Standard deviation of a normal constant error, natural-log intensity, in the place of the prior that mu1 and gamma imply.
    noise_slope_sd : float or "stimuli"
        Of the normal about Weber's law, per natural-log intensity; one over the range.
    lapse_rate_a, lapse_rate_b, icc_a, icc_b : float
        Of the beta distributions of the share of answers given without regard to the stimuli and of the intra-class correlation.
    exponent_median, exponent_sd : float
        Of the lognormal of the curve's exponent; the standard deviation is that of its logarithm.
    reference_interval : float, optional
        Seconds over which sigma_p, gamma and rho have their prior, in a study with intervals.

    Raises
    ------
    InputError
        If a value is not finite or a scale is not positive.

    Examples
    --------
    >>> Prior().describe()
    'mu1 ~ Normal(0, 10), sigma_p ~ HalfNormal(1), gamma ~ Uniform(0, 1), q0 ~ Uniform(0, 1)'
    """

    #: Family of every parameter, independent of the others; it takes the parameter's numbers in the order of their declaration.
    families: ClassVar[Mapping[str, Callable[..., Distribution]]] = {
        "mu1": Normal,
        "sigma_p": HalfNormal,
        "gamma": share,
        "q0": Uniform,
        "noise_slope": partial(Normal, 0.0),
        "lapse_rate": share,
        "exponent": LogNormal,
        "icc": share,
    }

    @cached_property
    def distributions(self) -> Mapping[str, Distribution]:
        """Distribution of every parameter that has one of its own: mu1, sigma_p, gamma and q0 first, in this order."""
        numbers: dict[str, list[float]] = {one.parameter: [] for one in self.declared()}
        for one in self.declared():
            value = getattr(self, one.name)
            if value == STIMULI:
                raise InputError(f"prior: {one.name} is that of the stimuli; bt.prior_for(study, prior) puts in the number")
            numbers[one.parameter].append(value)
        return {name: family(*numbers.get(name, ())) for name, family in self.families.items()}

    def distribution(self, parameter: str) -> Distribution:
        """Distribution of one parameter.

        Raises
        ------
        InputError
            For a parameter that has none of its own.

        Examples
        --------
        >>> Prior(mu1_sd=2.0).distribution("mu1")
        Normal(mean=0.0, sd=2.0)
        """
        if parameter not in self.distributions:
            raise InputError(f"prior: no distribution of {parameter!r}, allowed: {', '.join(self.distributions)}")
        return self.distributions[parameter]

    @property
    def penalty(self) -> Normal:
        """The normal of mu1, which is the penalty of a maximum-likelihood fit.

        Raises
        ------
        InputError
            If this prior's mu1 is not normal.
        """
        found = self.distribution("mu1")
        if not isinstance(found, Normal):
            raise InputError(f"prior: found mu1 ~ {found.describe()}, allowed as a penalty: a normal")
        return found

    def describe(self) -> str:
        """H1's in one line for tables, files and Methods sections."""
        return self._described() + self.remark

    def describe_orders(self) -> str:
        """The same where H1 is weighed against a constant error, whose own prior is said where it has one: its evidence depends on it.

        Examples
        --------
        >>> Prior(offset_sd=0.5).describe_orders().partition("q0")[2]
        ' ~ Uniform(0, 1), offset of a constant error ~ Normal(0, 0.5)'
        """
        error = "" if self.offset_sd is None else f", offset of a constant error ~ {Normal(0.0, self.offset_sd).describe()}"
        return self._described() + error + self.remark

    def _described(self) -> str:
        return ", ".join(f"{name} ~ {self.distributions[name].describe()}" for name in OF_H1)

    @property
    def remark(self) -> str:
        """What else to know of its numbers, to be put behind a description: where they came from, and their unit of time."""
        time = "" if self.reference_interval is None else f"over {self.reference_interval:g} s"
        return "".join(f"; {part}" for part in (self.origin, time) if part)

    def describe_penalty(self) -> str:
        """:attr:`penalty` in words."""
        return f"mu1 ~ {self.penalty.describe()}"

    def log_density(self, theta: Natural) -> FloatArray:
        """Log density with respect to (mu1, sigma_p, gamma, q0); -inf outside the support."""
        inside = (theta.sigma_p > 0) & (theta.gamma > 0) & (theta.gamma < 1) & (theta.q0 > 0) & (theta.q0 < 1)
        return np.where(inside, self._log_densities(theta, theta.gamma), -np.inf)

    def log_density_variances(self, theta: Natural) -> FloatArray:
        """Log density with respect to the paper's coordinates (mu1, sigma_p^2, sigma_l^2, q0), edges included; -inf outside.

        d sigma_p / d sigma_p^2 = 1 / (2 sigma_p) and, at fixed sigma_p, d gamma / d sigma_l^2 = 1 / sigma_p^2. Source: Appendix C.
        """
        inside = (theta.sigma_p > 0) & (theta.gamma >= 0) & (theta.gamma <= 1) & (theta.q0 >= 0) & (theta.q0 <= 1)
        volume = -np.log(2.0) - 3.0 * np.log(theta.sigma_p)
        return np.where(inside, self._log_densities(theta, theta.gamma) + volume, -np.inf)

    def log_density_unconstrained(self, x: npt.ArrayLike, sbar: float) -> FloatArray:
        """Log density with respect to the unconstrained coordinates x, shape (..., 4) -> (...)."""
        points = np.asarray(x, np.float64)
        return self.log_density_of_update(points, sbar) + log_density_of_logit(self.distributions["q0"], points[..., 3])

    def log_density_of_update(self, x: FloatArray, sbar: float) -> FloatArray:
        """The part of (mu1, sigma_p, gamma), with respect to (c, logit(p/p_max), log w), of x[..., :3], (..., k) -> (...)."""
        a, b = x[..., 1], x[..., 2]
        p = MAX_PULL * expit(a)
        with np.errstate(over="ignore"):  # mu1 beyond the largest float: the density is 0 there
            values = {"mu1": sbar + reach(x), "sigma_p": np.exp(b) * (1.0 - p) ** 1.5}
            of_values = sum(self.distributions[name].log_density(value) for name, value in values.items())
            return np.asarray(of_values + log_density_of_noise_ratio(self.distributions["gamma"], a) + log_jacobian_of_pull(a) + b)

    def _log_densities(self, theta: Natural, gamma: FloatArray) -> FloatArray:
        values = {"mu1": theta.mu1, "sigma_p": theta.sigma_p, "gamma": gamma, "q0": theta.q0}
        return np.asarray(sum(self.distributions[name].log_density(value) for name, value in values.items()))

    def gradient(self, x: npt.ArrayLike, sbar: float) -> FloatArray:
        """Gradient of :meth:`log_density_unconstrained`, shape (..., 4)."""
        points = np.asarray(x, np.float64)
        found, (a, b, p) = log_jacobian_gradient(points), (points[..., 1], points[..., 2], MAX_PULL * expit(points[..., 1]))
        down, slope = expit(-a), {name: of.slope for name, of in self.distributions.items()}
        with np.errstate(over="ignore"):  # 1/p is beyond the largest float where p < 1e-308: infinite is right there
            far = reach(points)
            of_mu1, sigma_p = slope["mu1"](sbar + far), np.exp(b) * (1.0 - p) ** 1.5
            of_sigma_p = slope["sigma_p"](sigma_p) * sigma_p
            found[..., 0] += of_mu1 * inverse_pull(a)
            found[..., 1] += -of_mu1 * far * down - 1.5 * p * down / (1.0 - p) * of_sigma_p
            found[..., 2] += of_sigma_p
        # log gamma has the slope expit(-a) (1 + p)/(1 - p), log(1 - gamma) the slope -expit(a) (1 + p)/((1 - p) (1/p_max - p)).
        gamma, rise = self.distributions["gamma"], (1.0 + p) / (1.0 - p)
        if isinstance(gamma, Beta):  # near an edge the slope of the density in gamma is huge, those of the logs are not
            found[..., 1] += rise * ((gamma.a - 1.0) * down - (gamma.b - 1.0) * expit(a) / (1.0 / MAX_PULL - p))
        else:
            found[..., 1] += gamma.slope(_noise_ratio(a)) * rise * p * down / np.square(1.0 - p)
        found[..., 3] = slope_of_logit(self.distributions["q0"], points[..., 3])
        return found

    def sample(self, rng: Random, size: int) -> Natural:
        """Independent draws, each array of shape (size,).

        Examples
        --------
        >>> Prior().sample(np.random.default_rng(1), 3).q0.shape
        (3,)
        """
        drawn = {name: self.distributions[name].sample(rng, size) for name in OF_H1}
        return Natural(drawn["mu1"], drawn["sigma_p"], drawn["sigma_p"] * np.sqrt(drawn["gamma"]), drawn["q0"])

    def sample_unconstrained(self, rng: Random, size: int, sbar: float) -> FloatArray:
        """Independent draws in unconstrained coordinates, shape (size, 4).

        With gamma = p/(1 - p)^2, p/(p_max - p) is gamma/(1 - gamma) times (1/p_max - p): finite where gamma itself rounds to an edge.
        """
        mu1, sigma_p = (self.distributions[name].sample(rng, size) for name in ("mu1", "sigma_p"))
        logit_gamma, logit_q0 = (sample_logit(self.distributions[name], rng, size) for name in ("gamma", "q0"))
        gamma = expit(logit_gamma)
        p = pull(gamma)
        columns = (p * (mu1 - sbar), logit_gamma + np.log(1.0 / MAX_PULL - p), np.log(width(sigma_p, gamma)), logit_q0)
        return np.stack(columns, axis=-1)


def _noise_ratio(a: FloatArray) -> FloatArray:
    """Noise ratio gamma = p/(1 - p)^2 at a = logit(p/p_max); a rounding may not carry it beyond its limit, 1."""
    p = MAX_PULL * expit(a)
    return np.asarray(np.minimum(p / (1.0 - p) ** 2, 1.0))


def log_density_of_noise_ratio(distribution: Distribution, a: FloatArray) -> FloatArray:
    """Log density of gamma, with respect to gamma, at a = logit(p/p_max), shape (...)."""
    return (
        distribution.log_density_of_logs(*log_noise_ratio(a))
        if isinstance(distribution, Beta)
        else distribution.log_density(_noise_ratio(a))
    )


def log_jacobian_gradient(x: FloatArray) -> FloatArray:
    """Gradient of :func:`bayes_toe.model.coordinates.log_jacobian`, (..., 4) -> (..., 4)."""
    p, fall = MAX_PULL * expit(x[..., 1]), expit(-x[..., 1])
    of_pull = p * fall / (1.0 + p) + 1.5 * p * fall / (1.0 - p) - expit(x[..., 1])
    return np.stack([np.zeros_like(p), of_pull, np.ones_like(p), -np.tanh(0.5 * x[..., 3])], axis=-1)
