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
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL, variance_ratio
from bayes_toe.model.coordinates import Natural, log_noise_ratio
from bayes_toe.model.distributions import Beta, Distribution, HalfNormal, LogNormal, Normal, Random, Uniform, share
from bayes_toe.model.prior_fields import OF_H1, STIMULI, PriorFields, number_problems, real, toml_table

AnyPrior = TypeVar("AnyPrior", bound="Prior")
_NODES = 200  # of an integral over gamma


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

    def _log_densities(self, theta: Natural, gamma: FloatArray) -> FloatArray:
        values = {"mu1": theta.mu1, "sigma_p": theta.sigma_p, "gamma": gamma, "q0": theta.q0}
        return np.asarray(sum(self.distributions[name].log_density(value) for name, value in values.items()))

    def sample(self, rng: Random, size: int) -> Natural:
        """Independent draws, each array of shape (size,).

        Examples
        --------
        >>> Prior().sample(np.random.default_rng(1), 3).q0.shape
        (3,)
        """
        drawn = {name: self.distributions[name].sample(rng, size) for name in OF_H1}
        return Natural(drawn["mu1"], drawn["sigma_p"], drawn["sigma_p"] * np.sqrt(drawn["gamma"]), drawn["q0"])


def log_density_of_noise_ratio(distribution: Distribution, a: FloatArray) -> FloatArray:
    """Log density of gamma, with respect to gamma, at a = logit(p/p_max), shape (...)."""
    if isinstance(distribution, Beta):
        return distribution.log_density_of_logs(*log_noise_ratio(a))
    return distribution.log_density(_noise_ratio(a))


def slope_of_noise_ratio(distribution: Distribution, a: FloatArray) -> FloatArray:
    """Derivative of :func:`log_density_of_noise_ratio` in a.

    log gamma has the slope expit(-a) (1 + p)/(1 - p), log(1 - gamma) the slope -expit(a) (1 + p)/((1 - p) (1/p_max - p)).
    """
    p, down = MAX_PULL * expit(a), expit(-a)
    rise = (1.0 + p) / (1.0 - p)
    if isinstance(distribution, Beta):  # near an edge the slope of the density in gamma is huge, those of the logs are not
        return np.asarray(rise * ((distribution.a - 1.0) * down - (distribution.b - 1.0) * expit(a) / (1.0 / MAX_PULL - p)))
    return np.asarray(distribution.slope(_noise_ratio(a)) * rise * p * down / np.square(1.0 - p))


def _noise_ratio(a: FloatArray) -> FloatArray:
    """Noise ratio gamma = p/(1 - p)^2 at a = logit(p/p_max); a rounding may not carry it beyond its limit, 1."""
    p = MAX_PULL * expit(a)
    return np.asarray(np.minimum(p / (1.0 - p) ** 2, 1.0))


def prior_quantile(prior: Prior, parameter: str, probability: float) -> float:
    """Prior quantile of mu1, sigma_p, sigma_l, q0, gamma, sigma1, gain or width.

    sigma_l, sigma1 and width are sigma_p h(gamma), so their distribution function is the average over gamma of sigma_p's at x / h(gamma),
    one smooth integral over the quantiles of gamma; the gain falls with gamma and takes its quantiles.

    Examples
    --------
    >>> [round(prior_quantile(Prior(), name, 0.95), 4) for name in ("mu1", "sigma_p", "gamma", "gain")]
    [16.4485, 1.96, 0.95, 0.9545]
    """
    if parameter in prior.distributions:
        return float(prior.distribution(parameter).quantile(probability))
    of_sigma_p, of_gamma = prior.distribution("sigma_p"), prior.distribution("gamma")
    if parameter == "gain":
        return float(1.0 / variance_ratio(of_gamma.quantile(1.0 - probability)))
    return _product_quantile(of_sigma_p, of_gamma, parameter, probability)


_SHAPES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "sigma_l": np.sqrt,
    "sigma1": lambda gamma: np.sqrt(variance_ratio(gamma)),
    "width": lambda gamma: variance_ratio(gamma) ** 1.5,
}


@cache
def _product_quantile(of_sigma_p: Distribution, of_gamma: Distribution, parameter: str, probability: float) -> float:
    """Quantile of sigma_p h(gamma): between the smallest and the largest h times sigma_p's own, so it is looked for in that unit."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    root = 0.5 * (nodes + 1.0)  # of gamma's distribution function u: sigma_l is smooth in it, du = 2 root d root
    shape = _SHAPES[parameter](of_gamma.quantile(np.square(root)))
    unit = float(of_sigma_p.quantile(probability))

    def excess(x: float) -> float:
        return float(weights @ (root * of_sigma_p.cdf(x * unit / shape))) - probability

    return unit * float(brentq(excess, 0.999 * shape.min(), 1.001 * shape.max(), xtol=1e-12))


def read_prior(path: str | Path, kind: type[AnyPrior] = Prior) -> AnyPrior:  # type: ignore[assignment]
    """The prior in a TOML file with some of the numbers that it declares, by name; :func:`example_file` has all, with their units.

    Parameters
    ----------
    path : str or Path
        UTF-8; a key that is absent keeps its default.
    kind : type
        Of prior; its declaration says which keys there are and which numbers are allowed.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or holds an unknown key, something that is not a number or a number out of range: one
        line per problem.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "prior.toml")
    ...     _ = file.write_text("mu1_sd = 2.5  # prior sd of mu1", encoding="utf-8")
    ...     read_prior(file) == Prior(mu1_sd=2.5)
    True
    """
    keys = {one.name: one for one in kind.declared()}
    found = toml_table(path, f"NAME = NUMBER, as in {next(iter(keys))} = 0")
    problems = [f"{path}: {line}" for key, value in found.items() for line in number_problems(keys, key, value)]
    if problems:
        raise InputError(problems)
    numbers: dict[str, Any] = {key: value if value == STIMULI else real(value) for key, value in found.items()}
    return kind(**numbers)


def example_file(kind: type[Prior] = Prior) -> str:
    """A complete prior file with the defaults and what they mean; what has none is a comment.

    Examples
    --------
    >>> print(example_file().splitlines()[0])
    mu1_mean = 0.0              # mean of the normal prior of mu1, natural-log intensity; or "stimuli", their mean
    """
    lines = {f"# {one.name} = 1.0" if one.default is None else f"{one.name} = {one.default!r}": one.about for one in kind.declared()}
    width = max(map(len, lines))
    return "".join(f"{line:<{width}}  # {about}\n" for line, about in lines.items())
