"""The prior: H1's numbers, and the prior of the four models of the observer.

The default takes location and scales from the stimuli of each subject, so that adding a constant to
all stimuli, or multiplying them, changes no probability. With M the mean of all stimuli, R their
standard deviation and D the root mean square of s2 - s1 over unequal pairs, H1 has
mu1 ~ Normal(M, 2.5 R), log w ~ Normal(log D, 1), gamma ~ Uniform(0, 1) and q0 ~ Beta(4, 1).

`Prior()` is the paper's in H1's four parameters, whatever the stimuli are: mu1 ~ Normal(0, 10),
sigma_p ~ HalfNormal(1), gamma and q0 uniform (V_1 = 10^2, 0 < sigma_l < sigma_p).

The numbers of H1 are declared in :mod:`bayes_toe.model.prior_fields`, those of the observer in
:class:`bayes_toe.model.parameters.ObserverPrior`; files are read by
:mod:`bayes_toe.model.prior_file`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any, ClassVar, Self

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit

from bayes_toe.arrays import FloatArray
from bayes_toe.data.conditions import Stimuli
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL, variance_ratio
from bayes_toe.model.coordinates import Natural, log_noise_ratio
from bayes_toe.model.distributions import (
    Beta,
    Distribution,
    HalfNormal,
    LogNormal,
    Normal,
    Random,
    share,
)
from bayes_toe.model.parameters import ObserverPrior
from bayes_toe.model.prior_fields import STIMULI, PriorFields

_NODES = 200  # of an integral over gamma


@dataclass(frozen=True)
class Prior(PriorFields):
    """Prior density of (mu1, sigma_p, gamma, q0), and the priors of what other models have; all log densities are normalised.

    Parameters
    ----------
    mu1_mean, mu1_sd : float or "stimuli"
        Mean and standard deviation of mu1, natural-log intensity; "stimuli" stands for a property of what the subject felt, here and below,
        and becomes a number where the prior meets the subject (:meth:`at`).
    sigma_p_scale : float or "stimuli"
        Scale of the half-normal of sigma_p, natural-log intensity, where the width has no prior of its own.
    width_median, width_sd : float or "stimuli"
        Median of a lognormal prior of the width w, natural-log intensity, in the place of sigma_p's; standard deviation of its logarithm.
    gamma_a, gamma_b, q0_a, q0_b : float
        Of the beta distributions of gamma and q0.
    offset_sd : float or "stimuli"
        Standard deviation of the normal of a constant error, natural-log intensity.
    noise_slope_sd, peak_slope_sd : float or "stimuli"
        Of the normals about 0 of the slopes of the noise (Weber's law) and of logit q0, per natural-log intensity.
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

    #: The prior of the four models of the observer.
    observer: ObserverPrior = field(default_factory=ObserverPrior)

    #: Family of every parameter, independent of the others; it takes the parameter's numbers in the order of their declaration.
    families: ClassVar[Mapping[str, Callable[..., Distribution]]] = {
        "mu1": Normal,
        "sigma_p": HalfNormal,
        "width": LogNormal,
        "gamma": share,
        "q0": share,
        "offset": partial(Normal, 0.0),
        "noise_slope": partial(Normal, 0.0),
        "peak_slope": partial(Normal, 0.0),
        "lapse_rate": share,
        "exponent": LogNormal,
        "icc": share,
    }

    def of_h1(self, task: Task = SAME_DIFFERENT) -> tuple[str, ...]:
        """The parameters of the predictive update (H1) that have a distribution: the width's, or in its place sigma_p's, among them."""
        return ("mu1", self.spread, "gamma", task.lapses)

    @property
    def spread(self) -> str:
        """Whose distribution rules the width of the curve: "width", or "sigma_p"."""
        return "sigma_p" if self.width_median is None else "width"

    def at(self, *subjects: Subject) -> Self:
        """This prior with numbers in the place of "stimuli", for a subject or for several together.

        Raises
        ------
        InputError
            If no pair has different stimuli and the prior of H1 asks for their scale.

        Examples
        --------
        >>> Prior(mu1_mean="stimuli").at(Subject("S", [0.0, 0.0], [0.0, 0.5], [9, 4], [10, 10])).mu1_mean
        0.125
        """
        named = {one.name: one for one in self.declared() if getattr(self, one.name) == STIMULI}
        if not named:
            return self
        found = Stimuli.of(*subjects)
        if (
            found is None
        ):  # what only rivals of H1 need may stay open: whoever asks for it is refused
            if any(one.parameter in self.of_h1() for one in named.values()):
                raise InputError(
                    f"subject {subjects[0].name!r}: the prior takes its scale from pairs of different stimuli, found none; allowed: the "
                    "prior 'paper' (--prior paper), or one of numbers"
                )
            return self
        numbers: dict[str, Any] = {name: found.number(one.stimuli) for name, one in named.items()}
        return replace(self, **numbers)

    def of_stimuli(self, parameter: str) -> bool:
        """Whether a number of a parameter's distribution is that of the stimuli, and so in their unit."""
        return STIMULI in self._numbers(parameter).values()

    def distribution(self, parameter: str) -> Distribution:
        """Distribution of one parameter.

        Raises
        ------
        InputError
            For a parameter that has none of its own, or whose numbers are still those of the stimuli.
        """
        if parameter in self._known:
            return self._known[parameter]
        if parameter not in self.families:
            raise InputError(
                f"prior: no distribution of {parameter!r}, allowed: {', '.join(self.families)}"
            )
        open_ones = ", ".join(
            name for name, value in self._numbers(parameter).items() if value in (STIMULI, None)
        )
        raise InputError(
            f"prior: {open_ones} is to come from pairs of different stimuli, and there are none; allowed: a number"
        )

    @cached_property
    def _known(self) -> Mapping[str, Distribution]:
        """The distributions of which all is known."""
        numbers = {parameter: [*self._numbers(parameter).values()] for parameter in self.families}
        return {
            name: self.families[name](*values)
            for name, values in numbers.items()
            if not {STIMULI, None} & set(values)
        }

    def _numbers(self, parameter: str) -> dict[str, Any]:
        return {
            one.name: getattr(self, one.name)
            for one in self.declared()
            if one.parameter == parameter
        }

    def said(self, parameter: str) -> str:
        """The distribution of a parameter in words, as in 'Normal(M, 2.5 R)' where its numbers are those of the stimuli."""
        numbers = self._numbers(parameter)
        stimuli = {one.name: one.stimuli for one in self.declared()}
        symbols = {name: stimuli[name] for name, value in numbers.items() if value == STIMULI}
        if not symbols:
            return self.distribution(parameter).describe()
        stand_in = self.families[parameter](
            *(1.0 if name in symbols else value for name, value in numbers.items())
        ).describe()
        family, own = stand_in.split("(")[0], stand_in[stand_in.index("(") + 1 : -1].split(", ")
        first = len(own) - len(numbers)  # a family may begin with a number that is fixed
        said = [
            *own[:first],
            *(symbols.get(name, word) for name, word in zip(numbers, own[first:], strict=True)),
        ]
        return f"{family}({', '.join(said)})"

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
            raise InputError(
                f"prior: found mu1 ~ {found.describe()}, allowed as a penalty: a normal"
            )
        return found

    def describe(self, task: Task = SAME_DIFFERENT) -> str:
        """H1's in one line for tables, files and Methods sections."""
        return ", ".join(f"{name} ~ {self.said(name)}" for name in self.of_h1(task)) + self.remark

    def describe_orders(self, task: Task = SAME_DIFFERENT) -> str:
        """That of the four models of the observer, and H1's, in one line."""
        return f"{self.observer.describe(task)}. The paper's model (H1): {self.describe(task)}"

    @property
    def remark(self) -> str:
        """What else to know of its numbers, to be put behind a description: what its symbols mean, and their unit of time."""
        symbols = any(map(self.of_stimuli, self.of_h1()))
        stimuli = "M mean and R sd of the stimuli, D rms step" if symbols else ""
        time = "" if self.reference_interval is None else f"over {self.reference_interval:g} s"
        return "".join(f"; {part}" for part in (stimuli, time) if part)

    def describe_penalty(self) -> str:
        """:attr:`penalty` in words."""
        return f"mu1 ~ {self.said('mu1')}" + (
            "; M mean and R sd of the stimuli" if self.of_stimuli("mu1") else ""
        )

    def log_density_variances(self, theta: Natural) -> FloatArray:
        """Log density with respect to the paper's coordinates (mu1, sigma_p^2, sigma_l^2, q0), edges included; -inf outside.

        d sigma_p / d sigma_p^2 = 1 / (2 sigma_p) and, at fixed sigma_p, d gamma / d sigma_l^2 = 1 / sigma_p^2. Source: Appendix C.
        """
        gamma, width_too = theta.gamma, self.spread == "width"
        inside = (
            (theta.sigma_p > 0) & (gamma >= 0) & (gamma <= 1) & (theta.q0 >= 0) & (theta.q0 <= 1)
        )
        stretch = (
            variance_ratio(gamma) ** 1.5 if width_too else np.asarray(1.0)
        )  # d width / d sigma_p
        values = (theta.mu1, theta.sigma_p * stretch, gamma, theta.q0)
        densities = [
            self.distribution(name).log_density(value)
            for name, value in zip(self.of_h1(), values, strict=True)
        ]
        volume = np.log(stretch) - np.log(2.0) - 3.0 * np.log(theta.sigma_p)
        return np.where(inside, sum(densities) + volume, -np.inf)

    def sample(self, rng: Random, size: int) -> Natural:
        """Independent draws, each array of shape (size,)."""
        mu1, spread, gamma, q0 = (
            self.distribution(name).sample(rng, size) for name in self.of_h1()
        )
        sigma_p = spread if self.spread == "sigma_p" else spread / variance_ratio(gamma) ** 1.5
        return Natural(mu1, sigma_p, sigma_p * np.sqrt(gamma), q0)


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
    if isinstance(
        distribution, Beta
    ):  # near an edge the slope of the density in gamma is huge, those of the logs are not
        return np.asarray(
            rise
            * (
                (distribution.a - 1.0) * down
                - (distribution.b - 1.0) * expit(a) / (1.0 / MAX_PULL - p)
            )
        )
    return np.asarray(distribution.slope(_noise_ratio(a)) * rise * p * down / np.square(1.0 - p))


def _noise_ratio(a: FloatArray) -> FloatArray:
    """Noise ratio gamma = p/(1 - p)^2 at a = logit(p/p_max); a rounding may not carry it beyond its limit, 1."""
    p = MAX_PULL * expit(a)
    return np.asarray(np.minimum(p / (1.0 - p) ** 2, 1.0))


def prior_quantile(prior: Prior, parameter: str, probability: float, power: float = 1.5) -> float:
    """Prior quantile of mu1, sigma_p, sigma_l, q0, gamma, sigma1, gain or width, where the width is sigma_p G^power.

    sigma_p, sigma_l, sigma1 and width are each other's multiples by powers of gamma and G, and one of them has a distribution of its own:
    another one's distribution function is the average over gamma of that one's at x / h(gamma), one smooth integral over the quantiles of
    gamma. The gain falls with gamma and takes its quantiles.

    Examples
    --------
    >>> [round(prior_quantile(Prior(), name, 0.95), 4) for name in ("mu1", "sigma_p", "gamma", "gain")]
    [16.4485, 1.96, 0.95, 0.9545]
    """
    if parameter in prior.of_h1():
        return float(prior.distribution(parameter).quantile(probability))
    of_gamma = prior.distribution("gamma")
    if parameter == "gain":
        return float(1.0 / variance_ratio(of_gamma.quantile(1.0 - probability)))
    return _product_quantile(
        prior.distribution(prior.spread), of_gamma, prior.spread, parameter, probability, power
    )


@cache
def _product_quantile(
    of_spread: Distribution,
    of_gamma: Distribution,
    spread: str,
    parameter: str,
    probability: float,
    power: float,
) -> float:
    """Quantile of the spread times h(gamma): between the smallest and the largest h times its own, so it is looked for in that unit."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    root = 0.5 * (
        nodes + 1.0
    )  # of gamma's distribution function u: sigma_l is smooth in it, du = 2 root d root
    gamma = of_gamma.quantile(np.square(root))
    ratio = variance_ratio(gamma)
    over_sigma_p = {
        "sigma_p": np.ones_like(gamma),
        "sigma_l": np.sqrt(gamma),
        "sigma1": np.sqrt(ratio),
        "width": ratio**power,
    }
    shape = over_sigma_p[parameter] / over_sigma_p[spread]
    unit = float(of_spread.quantile(probability))

    def excess(x: float) -> float:
        return float(weights @ (root * of_spread.cdf(x * unit / shape))) - probability

    return unit * float(brentq(excess, 0.999 * shape.min(), 1.001 * shape.max(), xtol=1e-12))


def stored_prior(values: Mapping[str, Any]) -> Prior:
    """The prior that a file of results holds; before the width could have one it was the paper's with what the file says."""
    unknown = sorted(
        values.keys() - {one.name for one in Prior.declared()} - {"origin", "observer"}
    )
    if unknown:
        raise InputError(
            f"draws made under a prior of your own, with {', '.join(unknown)}: only {Prior.__name__} itself can be told back"
        )
    before = (
        {}
        if "width_median" in values
        else {"offset_sd": 1.0, "noise_slope_sd": 1.0, "lapse_rate_b": 1.0}
    )
    observer = ObserverPrior(**values.get("observer", {}))
    return Prior(
        observer=observer,
        **{
            name: value
            for name, value in {**before, **values}.items()
            if value is not None and name not in ("origin", "observer")
        },
    )


#: What is used where nothing is said: every scale is that of the stimuli that a subject felt.
DEFAULT = Prior(mu1_mean=STIMULI, mu1_sd=STIMULI, width_median=STIMULI, q0_a=4.0)
