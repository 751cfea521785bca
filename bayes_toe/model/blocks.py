"""Free parameters of the models: blocks of unconstrained coordinates with a proper, normalised prior.

A quantity that several models share has the same prior in all of them. What the user's :class:`bayes_toe.model.prior.Prior` says of a
parameter, it says for every model: that of the width for every width, or that of sigma_p for every width-like standard deviation; that of
mu1 for every prior mean.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.special import expit, log_expit, logit

from bayes_toe.arrays import FloatArray
from bayes_toe.model.coordinates import log_slope, logit_of_probit, probit_of_logit
from bayes_toe.model.distributions import Beta, Distribution, LogNormal, Random
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import Names

#: Coordinates, and their derivatives in what they come from.
Mapped = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class Scale:
    """A bijection between a quantity and its coordinate, of any shape; on this one the quantity is its own coordinate."""

    prefix: ClassVar[str] = ""

    def quantity(self, x: FloatArray) -> FloatArray:
        """The quantity at coordinates."""
        return x

    def coordinate(self, t: FloatArray) -> FloatArray:
        """The coordinate of quantities."""
        return np.asarray(t)

    def sample(self, distribution: Distribution, rng: Random, size: int) -> FloatArray:
        """Coordinates of independent draws of the quantity, shape (size,)."""
        return self.coordinate(distribution.sample(rng, size))

    def log_density(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """Log density with respect to the coordinate."""
        return distribution.log_density(x)

    def slope(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """Its derivative."""
        return distribution.slope(x)

    def to_group(self, x: FloatArray) -> FloatArray:
        """Coordinates on the scale on which a group's members scatter about their mean: as they are, or probits of a share."""
        return x

    def from_group(self, eta: FloatArray) -> Mapped:
        """The inverse: coordinates, and their derivative."""
        return eta, np.ones_like(eta)


class Log(Scale):
    """By the logarithm."""

    prefix: ClassVar[str] = "log_"

    def quantity(self, x: FloatArray) -> FloatArray:
        """Its exponential."""
        return np.exp(x)

    def coordinate(self, t: FloatArray) -> FloatArray:
        """Its logarithm."""
        return np.log(t)

    def log_density(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """With log dt/dx = x; of a lognormal by the logarithm itself."""
        if isinstance(distribution, LogNormal):
            return distribution.of_log.log_density(x)
        with np.errstate(over="ignore"):  # beyond the largest float: the density is 0
            return np.asarray(distribution.log_density(np.exp(x)) + x)

    def slope(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """T f' + 1."""
        if isinstance(distribution, LogNormal):
            return distribution.of_log.slope(x)
        with np.errstate(over="ignore"):
            t = np.exp(x)
            return np.asarray(t * distribution.slope(t) + 1.0)


@dataclass(frozen=True)
class Logit(Scale):
    """By the logit of the share of the top."""

    top: float = 1.0
    prefix: ClassVar[str] = "logit_"

    def quantity(self, x: FloatArray) -> FloatArray:
        """The share of the top."""
        return np.asarray(self.top * expit(x))

    def coordinate(self, t: FloatArray) -> FloatArray:
        """The logit."""
        return np.asarray(logit(t / self.top))

    def sample(self, distribution: Distribution, rng: Random, size: int) -> FloatArray:
        """Logits of draws, of a beta with a pole also of those that no float tells from an edge."""
        if isinstance(distribution, Beta) and min(distribution.a, distribution.b) < 1.0:
            return distribution.sample_logit(rng, size)
        return self.coordinate(distribution.sample(rng, size))

    def log_density(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """With dt/dx = top expit(x) expit(-x); of a beta by the logs of the share and of what it leaves."""
        up, down = log_expit(x), log_expit(-x)
        if isinstance(distribution, Beta) and self.top == 1.0:
            return np.asarray(distribution.log_density_of_logs(up, down) + up + down)
        return np.asarray(
            distribution.log_density(self.top * expit(x)) + np.log(self.top) + up + down
        )

    def slope(self, distribution: Distribution, x: FloatArray) -> FloatArray:
        """With d(log dt/dx)/dx = -tanh(x/2)."""
        up, down = expit(x), expit(-x)
        if isinstance(distribution, Beta) and self.top == 1.0:
            return np.asarray(distribution.a * down - distribution.b * up)
        return np.asarray(
            distribution.slope(self.top * up) * self.top * up * down - np.tanh(0.5 * x)
        )

    def to_group(self, x: FloatArray) -> FloatArray:
        """The probit of the share: uniform is standard normal, so that its edges are far away."""
        return probit_of_logit(x)

    def from_group(self, eta: FloatArray) -> Mapped:
        """The logit of the share."""
        return logit_of_probit(eta), np.exp(-log_slope(eta))


class GroupPull(NamedTuple):
    """What the group's quantity says of the pull: its coordinate, the pull itself, and how both rise with it; shape (points,) each."""

    logit: FloatArray
    slope: FloatArray
    pull: FloatArray
    rise: FloatArray


@dataclass(frozen=True)
class Single:
    """One quantity, by a coordinate on its scale.

    Maxima are looked for from the starts, values of the coordinate, or what makes them of the distance of stimuli; none: what the data
    suggest.
    """

    name: str
    scale: Scale
    parameter: str = ""  # whose distribution the prior has for it; by default its own name
    fixed: Distribution | None = None  # its distribution, where the prior has none to choose
    starts: tuple[float, ...] | Callable[[float], tuple[float, ...]] = ()

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Its coordinate."""
        return (self.scale.prefix + self.name,)

    @property
    def names(self) -> Names:
        """The quantity's."""
        return Names((self.name,), (self.name,))

    def distribution(self, prior: Prior) -> Distribution:
        """Its distribution."""
        return prior.distribution(self.parameter or self.name) if self.fixed is None else self.fixed

    def parameters(self, prior: Prior) -> tuple[str, ...]:
        """Whose distributions the prior is made of."""
        return (self.parameter or self.name,) if self.fixed is None else ()

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        said = (
            prior.said(self.parameter or self.name) if self.fixed is None else self.fixed.describe()
        )
        return f"{self.name} ~ {said}"

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Log density with respect to the coordinate."""
        return self.scale.log_density(self.distribution(prior), x[:, 0])

    def gradient(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Gradient of :meth:`log_prior`."""
        return self.scale.slope(self.distribution(prior), x[:, 0])[:, None]

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 1)."""
        return self.scale.sample(self.distribution(prior), rng, size)[:, None]

    def named(self, x: FloatArray, prior: Prior, sbar: float) -> dict[str, FloatArray]:
        """The quantity."""
        return {self.name: self.scale.quantity(x[..., 0])}

    def coordinates_from(
        self, quantities: Mapping[str, FloatArray], prior: Prior, sbar: float
    ) -> FloatArray:
        """Its coordinate; infinite where rounding has it at an end of its range."""
        return self.scale.coordinate(quantities[self.name])[..., None]

    def prior_quantile(
        self, name: str, probability: float, prior: Prior, sbar: float
    ) -> float | None:
        """Of its distribution."""
        return float(self.distribution(prior).quantile(probability))

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """The starts given; else a width about the scale of the stimuli, or the largest frequency of 'equal'."""
        if callable(self.starts):
            return (self.starts(scale),)
        about = (
            tuple((np.log(scale) + np.array([-1.0, 0.0, 1.0])).tolist())
            if isinstance(self.scale, Log)
            else (peak,)
        )
        return (self.starts if self.starts else about,)

    @property
    def group(self) -> tuple[str, ...]:
        """The quantity."""
        return (self.name,)

    def to_group(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """That of its scale."""
        return self.scale.to_group(x)

    def from_group(self, eta: FloatArray, prior: Prior, sbar: float) -> Mapped:
        """That of its scale."""
        x, slope = self.scale.from_group(eta)
        return x, slope[:, :, None]

    group_pull = None


class Width(Single):
    """Width w, natural-log intensity: at K = 1 it is sigma_p, and has the prior of that one where it has none of its own."""

    def distribution(self, prior: Prior) -> Distribution:
        """The width's, or sigma_p's."""
        return prior.distribution(prior.spread)

    def parameters(self, prior: Prior) -> tuple[str, ...]:
        """One of these two."""
        return (prior.spread,)

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        return f"{self.name} ~ {prior.said(prior.spread)}"


def starting_offsets(scale: float) -> tuple[float, ...]:
    """Offsets from which to look for maxima, for stimuli `scale` apart, off the round numbers at which a distance may be exactly 0."""
    return (-0.93 * scale, 0.07 * scale, 1.01 * scale)


def starting_slopes(scale: float) -> tuple[float, ...]:
    """A fall, hardly any slope, a rise, over a step between stimuli."""
    return (-0.5 / scale, 0.03 / scale, 0.5 / scale)


#: Constant error c, natural-log intensity: the offset at the mean first stimulus.
OFFSET = Single("offset", Scale(), starts=starting_offsets)
WIDTH = Width("width", Log())
#: Slopes of the log of the width and of logit q0 over intensity, per natural-log intensity.
NOISE_SLOPE, PEAK_SLOPE = (
    Single(name, Scale(), starts=starting_slopes) for name in ("noise_slope", "peak_slope")
)


def with_offset(eta: FloatArray, sbar: float, pulled: GroupPull) -> Mapped:
    """(c, a, log w) of (mu1, probit, log w), shape (points, 3)."""
    far, jacobian = eta[:, 0] - sbar, np.zeros((len(eta), 3, 3))
    jacobian[:, 0, 0], jacobian[:, 0, 1] = pulled.pull, far * pulled.rise
    jacobian[:, 1, 1], jacobian[:, 2, 2] = pulled.slope, 1.0
    return np.stack([pulled.pull * far, pulled.logit, eta[:, 2]], axis=-1), jacobian
