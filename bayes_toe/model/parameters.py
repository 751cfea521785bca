"""Free parameters of the ladder's models: blocks of unconstrained coordinates with a proper, normalised prior.

A quantity that several models share has the same prior in all of them. What the user's :class:`bayes_toe.model.prior.Prior` sets, it sets
for every model: `sigma_p_scale` is the scale of every width-like standard deviation, `mu1_mean` and `mu1_sd` belong to every prior mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import expit, log_expit, logit, ndtri

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import LN2
from bayes_toe.model.contraction import prior_quantile
from bayes_toe.model.coordinates import Natural, derived, identified, natural, unconstrained
from bayes_toe.model.decay import Jet, expit_jet, log_lost_growth, small, softplus_jet
from bayes_toe.model.prior import LOG_2PI, Prior
from bayes_toe.model.target import Names, Random

Derivatives = tuple[FloatArray, FloatArray]


class Block(Protocol):
    """Some coordinates with a joint prior, independent of the other blocks'; x has this block's columns only."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the unconstrained coordinates; those that begin with logit_ are logits of a number in 0..1."""
        ...

    @property
    def names(self) -> Names:
        """What its quantities are called."""
        ...

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        ...

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Log density with respect to x, (points, k) -> (points,)."""
        ...

    def derivatives(self, x: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Gradient (points, k) and Hessian (points, k, k) of the log density with respect to x."""
        ...

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, k)."""
        ...

    def named(self, x: FloatArray, sbar: float) -> dict[str, FloatArray]:
        """The quantities that a reader knows, (..., k) -> (...) each."""
        ...

    def coordinates_from(self, quantities: Mapping[str, FloatArray], sbar: float) -> FloatArray:
        """The inverse of :meth:`named`: coordinates (..., k) from natural quantities (...)."""
        ...

    def prior_quantile(self, name: str, probability: float, prior: Prior) -> float | None:
        """Prior quantile of a named quantity; None where it has no short form, and draws have to tell it."""
        ...

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Starting values of each coordinate, for stimuli `scale` apart and a logit of the largest frequency of 'equal'."""
        ...


@dataclass(frozen=True)
class Shift:
    """Offset c ~ Normal(0, sd), natural-log intensity: the constant error at the mean first stimulus."""

    sd: float

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The offset itself."""
        return ("offset",)

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        return f"offset ~ Normal(0, {self.sd:g})"

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Log density with respect to the offset."""
        return np.asarray(-0.5 * (LOG_2PI + np.square(x[:, 0] / self.sd)) - np.log(self.sd))

    def derivatives(self, x: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Gradient and Hessian of :meth:`log_prior`."""
        return -x / self.sd**2, np.full((len(x), 1, 1), -1.0 / self.sd**2)

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 1)."""
        return np.asarray(rng.normal(0.0, self.sd, (size, 1)))

    names = Names(("offset",), ("offset",))

    def named(self, x: FloatArray, sbar: float) -> dict[str, FloatArray]:
        """The offset."""
        return {"offset": x[..., 0]}

    def coordinates_from(self, quantities: Mapping[str, FloatArray], sbar: float) -> FloatArray:
        """The offset itself."""
        return quantities["offset"][..., None]

    def prior_quantile(self, name: str, probability: float, prior: Prior) -> float | None:
        """Of a normal."""
        return float(self.sd * ndtri(probability))

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Three, off the round numbers at which a distance may be exactly 0."""
        return ((-0.93 * scale, 0.07 * scale, 1.01 * scale),)


@dataclass(frozen=True)
class Width:
    """Width w ~ HalfNormal(sigma_p_scale), natural-log intensity: at K = 1 the width is sigma_p and has its prior."""

    names = Names(("width",), ("width",))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The log of the width."""
        return ("log_width",)

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        return f"width ~ HalfNormal({prior.sigma_p_scale:g})"

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Log density with respect to log w."""
        return log_half_normal(x[:, 0], prior.sigma_p_scale)

    def derivatives(self, x: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Gradient and Hessian of :meth:`log_prior`."""
        first, second = half_normal_slopes(x[:, 0], prior.sigma_p_scale)
        return first[:, None], second[:, None, None]

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 1)."""
        return np.asarray(np.log(np.abs(rng.normal(0.0, prior.sigma_p_scale, (size, 1)))))

    def named(self, x: FloatArray, sbar: float) -> dict[str, FloatArray]:
        """The width."""
        return {"width": np.exp(x[..., 0])}

    def coordinates_from(self, quantities: Mapping[str, FloatArray], sbar: float) -> FloatArray:
        """Its log."""
        return np.log(quantities["width"])[..., None]

    def prior_quantile(self, name: str, probability: float, prior: Prior) -> float | None:
        """Of a half-normal."""
        return prior_quantile(prior, "sigma_p", probability)

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Three about the scale of the stimuli."""
        return (tuple((np.log(scale) + np.array([-1.0, 0.0, 1.0])).tolist()),)


@dataclass(frozen=True)
class Share:
    """A quantity with prior Uniform(0, top), by its logit."""

    name: str
    top: float = 1.0
    starts: tuple[float, ...] = ()  # logits; none means the largest frequency of 'equal'

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The logit of the quantity over its top."""
        return (f"logit_{self.name}",)

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        return f"{self.name} ~ Uniform(0, {self.top:g})"

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Log density with respect to the logit; the top cancels."""
        return np.asarray(log_expit(x[:, 0]) + log_expit(-x[:, 0]))

    def derivatives(self, x: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Gradient and Hessian of :meth:`log_prior`."""
        return -np.tanh(0.5 * x), (-2.0 * expit(x) * expit(-x))[:, :, None]

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 1)."""
        return np.asarray(logit(rng.uniform(size=(size, 1))))

    def named(self, x: FloatArray, sbar: float) -> dict[str, FloatArray]:
        """The quantity."""
        return {self.name: self.top * expit(x[..., 0])}

    @property
    def names(self) -> Names:
        """The quantity's."""
        return Names((self.name,), (self.name,))

    def coordinates_from(self, quantities: Mapping[str, FloatArray], sbar: float) -> FloatArray:
        """The logit of its share of the top; infinite where rounding has it at an end."""
        return np.asarray(logit(quantities[self.name] / self.top))[..., None]

    def prior_quantile(self, name: str, probability: float, prior: Prior) -> float | None:
        """Of a uniform."""
        return self.top * probability

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """The starts given, or the largest frequency."""
        return (self.starts if self.starts else (peak,),)


@dataclass(frozen=True)
class Update:
    """The predictive update's (mu1, sigma_p, gamma) in identified coordinates, with H1's prior; see :mod:`bayes_toe.model.coordinates`."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Offset, logit of pull over p_max, log width."""
        return ("offset", "logit_pull", "log_width")

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        return prior.describe().removesuffix(", q0 ~ Uniform(0, 1)")

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """H1's log density without the part of q0, which is ln(1/4) at q0 = 1/2."""
        return np.asarray(prior.log_density_unconstrained(_with_half(x), sbar) + 2.0 * LN2)

    def derivatives(self, x: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Gradient and Hessian of :meth:`log_prior`."""
        gradient, hessian = prior.derivatives(_with_half(x), sbar)
        return gradient[:, :3], hessian[:, :3, :3]

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 3)."""
        return prior.sample_unconstrained(rng, size, sbar)[:, :3]

    def named(self, x: FloatArray, sbar: float) -> dict[str, FloatArray]:
        """Natural, derived and identified parameters."""
        theta = natural(_with_half(x), sbar)
        found = {**theta._asdict(), **derived(theta), "offset": x[..., 0], "pull": identified(_with_half(x)).pull}
        return {name: found[name] for name in dict.fromkeys((*self.names.natural, *self.names.derived, *self.names.identified))}

    names = Names(
        ("mu1", "sigma_p", "sigma_l"), ("offset", "pull", "width"), derived=("gamma", "sigma1", "gain", "width"), monotone=("gain", "pull")
    )

    def coordinates_from(self, quantities: Mapping[str, FloatArray], sbar: float) -> FloatArray:
        """From the natural parameters."""
        mu1, sigma_p, sigma_l = (np.asarray(quantities[name], np.float64) for name in self.names.natural)
        return unconstrained(Natural(mu1, sigma_p, sigma_l, np.asarray(0.5)), sbar)[..., :3]

    def prior_quantile(self, name: str, probability: float, prior: Prior) -> float | None:
        """Exact, but for the offset."""
        if name == "pull":
            return 1.0 - prior_quantile(prior, "gain", 1.0 - probability)
        return None if name == "offset" else prior_quantile(prior, name, probability)

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Offsets and widths on the scale of the stimuli, a weak and a strong pull."""
        return (*Shift(1.0).grid(scale, peak), (-2.0, 2.0), *Width().grid(scale, peak))


@dataclass(frozen=True)
class Memory:
    """Mean-reverting memory: (mu1, sigma1, sigma_l, rho) as (c, logit p, log w, logit v).

    A measurement with gain K = sigma1^2/(sigma1^2 + sigma_l^2) is followed by an Ornstein-Uhlenbeck propagator, rho = exp(-dt/tau), that
    draws mean and variance back to those of the prior:

        mu_2 = mu1 + rho K (s1 - mu1),    sigma_2^2 = sigma1^2 (1 - rho^2 K),    w = sigma_2 + sigma_l^2/sigma_2,

    so the pull is p = 1 - rho K, and w = sigma1 (1 - g^2)/(K (1 - g rho)^(1/2)) with g = 1 - p. One interval tells rho K, not rho and K.
    The coordinate that only the prior rules then splits the logs: rho = g^v, K = g^(1 - v), 0 < v < 1. With several intervals rho and
    everything that depends on it is that at one second, and the split is told by the answers (:mod:`bayes_toe.model.propagators`).

    Priors: mu1 as in H1; sigma1, the spread of expected intensities, has the HalfNormal of the other widths; gain and rho are
    Uniform(0, 1), which says nothing of how the pull comes about. Then v is Uniform(0, 1) and p has density -ln(1 - p), independent.
    """

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Offset, logit of pull, log width, logit of v."""
        return ("offset", "logit_pull", "log_width", "logit_split")

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        return (
            f"mu1 ~ Normal({prior.mu1_mean:g}, {prior.mu1_sd:g}), sigma1 ~ HalfNormal({prior.sigma_p_scale:g}), "
            "sigma1^2/(sigma1^2 + sigma_l^2) ~ Uniform(0, 1), rho ~ Uniform(0, 1)"
        )

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Log density; d mu1/dc = 1/p cancels against dp/d(logit p) = p (1 - p)."""
        c, a, b, v = x.T
        with np.errstate(over="ignore", invalid="ignore"):  # mu1 beyond the largest float: its density is 0
            far = np.where(c == 0.0, 0.0, c * _inverse_share(a))
            of_mu1 = -0.5 * (LOG_2PI + np.square((sbar + far - prior.mu1_mean) / prior.mu1_sd)) - np.log(prior.mu1_sd)
        of_pull = _log_lost(a) + log_expit(-a)
        of_split = log_expit(v) + log_expit(-v)
        return np.asarray(of_mu1 + log_half_normal(b - self._log_stretch(x), prior.sigma_p_scale) + of_pull + of_split)

    def derivatives(self, x: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Gradient and Hessian of :meth:`log_prior`."""
        c, a, b, _ = x.T
        stretch, stretch_bend = self._stretch_derivatives(x)
        gradient, hessian = np.zeros((len(x), 4)), np.zeros((len(x), 4, 4))
        with np.errstate(over="ignore"):  # 1/p beyond the largest float: infinite is right there
            inverse, fall = _inverse_share(a), expit(-a)
            far = c * inverse
            steep = np.stack([inverse, -far * fall], axis=-1)
            score = -(sbar + far - prior.mu1_mean) / prior.mu1_sd**2
            gradient[:, :2] = score[:, None] * steep
            scaled = steep / prior.mu1_sd
            hessian[:, :2, :2] = -scaled[:, :, None] * scaled[:, None, :]
            hessian[:, 0, 1] += -score * fall * inverse
            hessian[:, 1, 0] = hessian[:, 0, 1]
            hessian[:, 1, 1] += score * far * fall
        # sigma_1 = w / stretch: its half-normal sees (a, b, split) through b - log stretch.
        first, second = half_normal_slopes(b - self._log_stretch(x), prior.sigma_p_scale)
        towards = np.stack([np.zeros_like(b), -stretch[0], np.ones_like(b), -stretch[1]], axis=-1)
        gradient += first[:, None] * towards
        hessian += second[:, None, None] * towards[:, :, None] * towards[:, None, :]
        hessian[:, 1::2, 1::2] -= first[:, None, None] * np.moveaxis(stretch_bend, -1, 0)
        ratio = np.exp(log_expit(a) - _log_lost(a))  # l_a/l
        gradient[:, 1] += ratio - expit(a)
        hessian[:, 1, 1] += ratio * (fall - ratio) - expit(a) * fall
        gradient[:, 3] -= np.tanh(0.5 * x[:, 3])
        hessian[:, 3, 3] -= 2.0 * expit(x[:, 3]) * expit(-x[:, 3])
        return gradient, hessian

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 4)."""
        mu1 = rng.normal(prior.mu1_mean, prior.mu1_sd, size)
        log_sigma1 = np.log(np.abs(rng.normal(0.0, prior.sigma_p_scale, size)))
        log_rho, log_gain = (np.log1p(-rng.uniform(size=size)) for _ in range(2))
        return self._point(mu1 - sbar, log_sigma1, log_rho, log_gain)

    names = Names(*(("mu1", "sigma1", "sigma_l", "rho"), ("offset", "pull", "width", "rho"), ("gain", "width")), monotone=("gain",))

    def named(self, x: FloatArray, sbar: float) -> dict[str, FloatArray]:
        """The natural parameters but q0, and the identified ones; gain is rho times that of the measurement, the weight of s1."""
        lost = np.logaddexp(0.0, x[..., 1])
        sigma1 = np.exp(x[..., 2] - self._log_stretch(x))
        rho, log_gain = np.exp(-expit(x[..., 3]) * lost), -expit(-x[..., 3]) * lost
        with np.errstate(over="ignore", invalid="ignore"):
            mu1 = sbar + np.where(x[..., 0] == 0.0, 0.0, x[..., 0] * _inverse_share(x[..., 1]))
        # sigma_l^2/sigma1^2 = 1/K - 1
        sigma_l = sigma1 * np.sqrt(np.expm1(-log_gain))
        found = {"mu1": mu1, "sigma1": sigma1, "sigma_l": sigma_l, "rho": rho, "gain": np.exp(-lost)}
        return {**found, "offset": x[..., 0], "pull": expit(x[..., 1]), "width": np.exp(x[..., 2])}

    def coordinates_from(self, quantities: Mapping[str, FloatArray], sbar: float) -> FloatArray:
        """From the natural parameters."""
        mu1, sigma1, sigma_l, rho = (np.asarray(quantities[name], np.float64) for name in self.names.natural)
        return self._point(mu1 - sbar, np.log(sigma1), np.log(rho), -np.log1p(np.square(sigma_l / sigma1)))

    def _point(self, reach: FloatArray, log_sigma1: FloatArray, log_rho: FloatArray, log_gain: FloatArray) -> FloatArray:
        """Coordinates of mu1 - sbar, log sigma1, log rho and log of the measurement's gain."""
        lost = -(log_rho + log_gain)
        pull = -np.expm1(-lost)
        x = np.stack([pull * reach, np.log(pull) + lost, np.zeros_like(lost), np.log(log_rho / log_gain)], axis=-1)
        x[..., 2] = log_sigma1 + self._log_stretch(x)
        return x

    def prior_quantile(self, name: str, probability: float, prior: Prior) -> float | None:
        """Exact where the prior names the quantity."""
        if name == "rho":
            return probability
        return prior_quantile(prior, {"sigma1": "sigma_p"}.get(name, name), probability) if name in ("mu1", "sigma1") else None

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Those of the predictive update, half way between all gain and all memory."""
        return (*Update().grid(scale, peak), (0.0,))

    @staticmethod
    def _log_stretch(x: FloatArray) -> FloatArray:
        """Log of w/sigma1 = (1 - g^2)/(K (1 - g rho)^(1/2)) with g = exp(-l), rho = exp(-l v), K = exp(-l (1 - v)), l = -ln(1 - p)."""
        lost, v = np.logaddexp(0.0, x[..., 1]), x[..., 3]
        return np.asarray(np.log(-np.expm1(-2.0 * lost)) + lost * expit(-v) - 0.5 * np.log(-np.expm1(-lost * (1.0 + expit(v)))))

    @staticmethod
    def _stretch_derivatives(x: FloatArray) -> Derivatives:
        """First and second derivatives of the log of w/sigma1 in (logit pull, logit split), (2, points) and (2, 2, points)."""
        lost, split, fall = softplus_jet(x[:, 1]), expit_jet(x[:, 3]), expit(-x[:, 3])
        one = Jet(np.ones_like(fall), np.zeros_like(fall), np.zeros_like(fall))
        twice, mixed = log_lost_growth(lost, one, 2.0), log_lost_growth(lost, split._replace(value=1.0 + split.value), 1.0)
        first, second = (a - 0.5 * b for a, b in zip(twice, mixed, strict=True))
        # Where l is small both leave out log l, one of them by half; and log stretch has l expit(-split).
        ratio = np.where(small(lost), np.exp(log_expit(x[:, 1]) - _log_lost(x[:, 1])), 0.0)
        first[0] += 0.5 * ratio + lost.first * fall
        second[0, 0] += 0.5 * ratio * (expit(-x[:, 1]) - ratio) + lost.second * fall
        first[1] -= lost.value * split.first
        second[0, 1] -= lost.first * split.first
        second[1, 0] -= lost.first * split.first
        second[1, 1] -= lost.value * split.second
        return first, second


def _log_lost(a: FloatArray) -> FloatArray:
    """log(-log(1 - p)) at a = logit p."""
    return np.where(a < -30.0, a, np.log(np.logaddexp(0.0, np.maximum(a, -30.0))))


def log_half_normal(b: FloatArray, scale: float) -> FloatArray:
    """Log density of b = log of a HalfNormal(scale) quantity."""
    with np.errstate(over="ignore"):  # beyond the largest float: the density is 0
        return np.asarray(-0.5 * (np.log(np.pi / 2.0) + np.square(np.exp(b - np.log(scale)))) - np.log(scale) + b)


def half_normal_slopes(b: FloatArray, scale: float) -> Derivatives:
    """First and second derivative of :func:`log_half_normal` in b."""
    with np.errstate(over="ignore"):
        y = np.square(np.exp(b - np.log(scale)))
    return 1.0 - y, -2.0 * y


def _inverse_share(a: FloatArray) -> FloatArray:
    """1/expit(a)."""
    return np.asarray(1.0 + np.exp(-a))


def _with_half(x: FloatArray) -> FloatArray:
    """The coordinates with logit q0 = 0 after them."""
    return np.concatenate([x, np.zeros((*x.shape[:-1], 1))], axis=-1)
