"""Free parameters of the models: blocks of unconstrained coordinates with a proper, normalised prior.

A quantity that several models share has the same prior in all of them. What the user's :class:`bayes_toe.model.prior.Prior` says of a
parameter, it says for every model: that of sigma_p holds for every width-like standard deviation, that of mu1 for every prior mean.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from scipy.special import expit, log_expit, ndtr, ndtri_exp

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import MAX_PULL, pull
from bayes_toe.model.contraction import prior_quantile
from bayes_toe.model.coordinates import Natural, derived, identified, log_noise_ratio, natural, reach, unconstrained
from bayes_toe.model.decay import Jet, expit_jet, log_lost_growth, small, softplus_jet
from bayes_toe.model.distributions import Distribution, Normal, Random
from bayes_toe.model.offset_prior import offset_prior
from bayes_toe.model.prior import Prior
from bayes_toe.model.probits import log_slope, logit_of_probit, probit_of_logit
from bayes_toe.model.scales import Log, Logit, Scale
from bayes_toe.model.target import Names

Derivatives = tuple[FloatArray, FloatArray]
#: The parameter of the prior whose distribution every width-like standard deviation has.
SPREAD = "sigma_p"
_STANDARD = Normal(0.0, 1.0)


class GroupPull(NamedTuple):
    """What the group's quantity says of the pull: its coordinate, the pull itself, and how both rise with it; shape (points,) each."""

    logit: FloatArray
    slope: FloatArray
    pull: FloatArray
    rise: FloatArray


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

    def parameters(self, prior: Prior) -> tuple[str, ...]:
        """Parameters of the prior whose distributions its own is made of."""
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

    def named(self, x: FloatArray, prior: Prior, sbar: float) -> dict[str, FloatArray]:
        """The quantities that a reader knows, (..., k) -> (...) each."""
        ...

    def coordinates_from(self, quantities: Mapping[str, FloatArray], prior: Prior, sbar: float) -> FloatArray:
        """The inverse of :meth:`named`: coordinates (..., k) from natural quantities (...)."""
        ...

    def prior_quantile(self, name: str, probability: float, prior: Prior, sbar: float) -> float | None:
        """Prior quantile of a named quantity; None where it has no short form, and draws have to tell it."""
        ...

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Starting values of each coordinate, for stimuli `scale` apart and a logit of the largest frequency of 'equal'."""
        ...

    @property
    def group(self) -> tuple[str, ...]:
        """Quantities that scatter between the members of a group, one for each coordinate, normal on their group scale."""
        ...

    def to_group(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """These on their group scales, (points, k) -> (points, k)."""
        ...

    def from_group(self, eta: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """The inverse: x, (points, k), and dx/d(eta), (points, k, k), triangular."""
        ...

    @property
    def group_pull(self) -> Callable[[FloatArray], GroupPull] | None:
        """Of a block whose answers tell p (mu1 - sbar) of its first quantity, mu1: the pull from the second one. Else None."""
        ...


@dataclass(frozen=True)
class Single:
    """One quantity, by a coordinate on its scale.

    Parameters
    ----------
    name : str
        Of the quantity.
    scale : Scale
        Where its coordinate lives.
    parameter : str
        Whose distribution the prior has for it; by default its own name.
    fixed : Distribution, optional
        Its distribution, where the prior has none to choose.
    starts : tuple of float
        Values of the coordinate from which to look for maxima; none: what the data suggest.
    """

    name: str
    scale: Scale
    parameter: str = ""
    fixed: Distribution | None = None
    starts: tuple[float, ...] = ()

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
        return f"{self.name} ~ {self.distribution(prior).describe()}"

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Log density with respect to the coordinate."""
        return self.scale.log_density(self.distribution(prior), x[:, 0])

    def derivatives(self, x: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Gradient and Hessian of :meth:`log_prior`."""
        slope, bend = self.scale.slopes(self.distribution(prior), x[:, 0])
        return np.asarray(slope)[:, None], np.asarray(bend)[:, None, None]

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 1)."""
        return self.scale.sample(self.distribution(prior), rng, size)[:, None]

    def named(self, x: FloatArray, prior: Prior, sbar: float) -> dict[str, FloatArray]:
        """The quantity."""
        return {self.name: self.scale.quantity(x[..., 0])}

    def coordinates_from(self, quantities: Mapping[str, FloatArray], prior: Prior, sbar: float) -> FloatArray:
        """Its coordinate; infinite where rounding has it at an end of its range."""
        return self.scale.coordinate(quantities[self.name])[..., None]

    def prior_quantile(self, name: str, probability: float, prior: Prior, sbar: float) -> float | None:
        """Of its distribution."""
        return float(self.distribution(prior).quantile(probability))

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """The starts given; else a width about the scale of the stimuli, or the largest frequency of 'equal'."""
        about = tuple((np.log(scale) + np.array([-1.0, 0.0, 1.0])).tolist()) if isinstance(self.scale, Log) else (peak,)
        return (self.starts if self.starts else about,)

    @property
    def group(self) -> tuple[str, ...]:
        """The quantity."""
        return (self.name,)

    def to_group(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """That of its scale."""
        return self.scale.to_group(x)

    def from_group(self, eta: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """That of its scale."""
        x, slope = self.scale.from_group(eta)
        return x, slope[:, :, None]

    group_pull = None


@dataclass(frozen=True)
class Offset:
    """Constant error c, natural-log intensity: the offset at the mean first stimulus, with the prior that the pull of H1 implies for it.

    The coordinate is standard normal under the prior; see :mod:`bayes_toe.model.offset_prior`.
    """

    coordinates: ClassVar[tuple[str, ...]] = ("offset_score",)
    names: ClassVar[Names] = Names(("offset",), ("offset",))

    def parameters(self, prior: Prior) -> tuple[str, ...]:
        """Whose distributions the prior is made of."""
        return ("mu1", "gamma") if prior.offset_sd is None else ("offset",)

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        return f"offset ~ {offset_prior(prior, 0.0).describe()}"

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Log density of a standard normal."""
        return _STANDARD.log_density(x[:, 0])

    def derivatives(self, x: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Gradient and Hessian of :meth:`log_prior`."""
        slope, bend = _STANDARD.derivatives(x[:, 0])
        return slope[:, None], bend[:, None, None]

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 1)."""
        return _STANDARD.sample(rng, size)[:, None]

    def named(self, x: FloatArray, prior: Prior, sbar: float) -> dict[str, FloatArray]:
        """The offset."""
        return {"offset": offset_prior(prior, sbar).offset(x[..., 0]).value}

    def coordinates_from(self, quantities: Mapping[str, FloatArray], prior: Prior, sbar: float) -> FloatArray:
        """Where the offset lies in its prior."""
        return offset_prior(prior, sbar).score(quantities["offset"])[..., None]

    def prior_quantile(self, name: str, probability: float, prior: Prior, sbar: float) -> float | None:
        """Of the implied prior."""
        return float(offset_prior(prior, sbar).quantile(probability))

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Three offsets, off the round numbers at which a distance may be exactly 0."""
        return (starting_offsets(scale),)

    group = ("offset",)

    def to_group(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """The offset itself."""
        return offset_prior(prior, sbar).offset(x).value

    def from_group(self, eta: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Where it lies in its prior."""
        implied = offset_prior(prior, sbar)
        x = implied.score(eta)
        return x, 1.0 / implied.offset(x).first[:, :, None]

    group_pull = None


#: Width w, natural-log intensity: at K = 1 the width is sigma_p and has its prior.
WIDTH = Single("width", Log(), SPREAD)


def starting_offsets(scale: float) -> tuple[float, ...]:
    """Offsets from which to look for maxima, for stimuli `scale` apart."""
    return (-0.93 * scale, 0.07 * scale, 1.01 * scale)


@dataclass(frozen=True)
class Update:
    """The predictive update's (mu1, sigma_p, gamma) in identified coordinates, with H1's prior; see :mod:`bayes_toe.model.coordinates`."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Offset, logit of pull over p_max, log width."""
        return ("offset", "logit_pull", "log_width")

    def parameters(self, prior: Prior) -> tuple[str, ...]:
        """Whose distributions the prior is made of."""
        return ("mu1", SPREAD, "gamma")

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        return ", ".join(f"{name} ~ {prior.distribution(name).describe()}" for name in ("mu1", SPREAD, "gamma"))

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """H1's log density without the part of q0."""
        return prior.log_density_of_update(x, sbar)

    def derivatives(self, x: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Gradient and Hessian of :meth:`log_prior`."""
        gradient, hessian = prior.derivatives(_with_half(x), sbar)
        return gradient[:, :3], hessian[:, :3, :3]

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 3)."""
        return prior.sample_unconstrained(rng, size, sbar)[:, :3]

    def named(self, x: FloatArray, prior: Prior, sbar: float) -> dict[str, FloatArray]:
        """Natural, derived and identified parameters."""
        theta = natural(_with_half(x), sbar)
        found = {**theta._asdict(), **derived(theta), "offset": x[..., 0], "pull": identified(_with_half(x)).pull}
        return {name: found[name] for name in dict.fromkeys((*self.names.natural, *self.names.derived, *self.names.identified))}

    names = Names(
        ("mu1", "sigma_p", "sigma_l"), ("offset", "pull", "width"), derived=("gamma", "sigma1", "gain", "width"), monotone=("gain", "pull")
    )

    def coordinates_from(self, quantities: Mapping[str, FloatArray], prior: Prior, sbar: float) -> FloatArray:
        """From the natural parameters."""
        mu1, sigma_p, sigma_l = (np.asarray(quantities[name], np.float64) for name in self.names.natural)
        return unconstrained(Natural(mu1, sigma_p, sigma_l, np.asarray(0.5)), sbar)[..., :3]

    def prior_quantile(self, name: str, probability: float, prior: Prior, sbar: float) -> float | None:
        """Exact, but for the offset."""
        if name == "pull":
            return 1.0 - prior_quantile(prior, "gain", 1.0 - probability)
        return None if name == "offset" else prior_quantile(prior, name, probability)

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Offsets and widths on the scale of the stimuli, a weak and a strong pull."""
        return (starting_offsets(scale), (-2.0, 2.0), *WIDTH.grid(scale, peak))

    group = ("mu1", "gamma", "width")

    def to_group(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Prior mean, probit of the noise ratio, log width: of these the data tell most, and normal tails do no harm."""
        log_gamma, log_rest = log_noise_ratio(x[:, 1])
        probit = np.where(log_gamma < log_rest, ndtri_exp(log_gamma), -ndtri_exp(log_rest))
        return np.stack([sbar + reach(x), probit, x[:, 2]], axis=-1)

    def from_group(self, eta: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """With c = p (mu1 - sbar)."""
        return _with_offset(eta, sbar, self.group_pull(eta[:, 1]))

    @staticmethod
    def group_pull(probit: FloatArray) -> GroupPull:
        """From the probit of gamma, with d(logit gamma)/da = (1 + p)/(1 - p) [expit(-a) + expit(a)/(1/p_max - p)]."""
        logit_gamma, p = logit_of_probit(probit), pull(ndtr(probit))
        far = 1.0 / MAX_PULL - p
        a = logit_gamma + np.log(far)
        down = expit(-a)
        slope = np.exp(-log_slope(probit)) * (1.0 - p) / ((1.0 + p) * (down + expit(a) / far))
        return GroupPull(a, slope, p, p * down * slope)


@dataclass(frozen=True)
class Memory:
    """Mean-reverting memory: (mu1, sigma1, sigma_l, rho) as (c, logit p, log w, logit v).

    A measurement with gain K = sigma1^2/(sigma1^2 + sigma_l^2) is followed by an Ornstein-Uhlenbeck propagator, rho = exp(-dt/tau), that
    draws mean and variance back to those of the prior:

        mu_2 = mu1 + rho K (s1 - mu1),    sigma_2^2 = sigma1^2 (1 - rho^2 K),    w = sigma_2 + sigma_l^2/sigma_2,

    so the pull is p = 1 - rho K, and w = sigma1 (1 - g^2)/(K (1 - g rho)^(1/2)) with g = 1 - p. One interval tells rho K, not rho and K.
    The coordinate that only the prior rules then splits the logs: rho = g^v, K = g^(1 - v), 0 < v < 1. With several intervals rho and
    everything that depends on it is that at the reference, and the split is told by the answers (:mod:`bayes_toe.model.propagators`).

    Priors: mu1 as in H1; sigma1, the spread of expected intensities, has the HalfNormal of the other widths; gain and rho are
    Uniform(0, 1), which says nothing of how the pull comes about. Then v is Uniform(0, 1) and p has density -ln(1 - p), independent.
    """

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Offset, logit of pull, log width, logit of v."""
        return ("offset", "logit_pull", "log_width", "logit_split")

    def parameters(self, prior: Prior) -> tuple[str, ...]:
        """Whose distributions the prior is made of."""
        return ("mu1", SPREAD)

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        return (
            f"mu1 ~ {prior.distribution('mu1').describe()}, sigma1 ~ {prior.distribution(SPREAD).describe()}, "
            "sigma1^2/(sigma1^2 + sigma_l^2) ~ Uniform(0, 1), rho ~ Uniform(0, 1)"
        )

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Log density; d mu1/dc = 1/p cancels against dp/d(logit p) = p (1 - p)."""
        c, a, b, v = x.T
        with np.errstate(over="ignore", invalid="ignore"):  # mu1 beyond the largest float: its density is 0
            far = np.where(c == 0.0, 0.0, c * _inverse_share(a))
            of_mu1 = prior.distribution("mu1").log_density(sbar + far)
        of_pull = _log_lost(a) + log_expit(-a)
        of_split = log_expit(v) + log_expit(-v)
        return np.asarray(of_mu1 + Log().log_density(prior.distribution(SPREAD), b - self._log_stretch(x)) + of_pull + of_split)

    def derivatives(self, x: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """Gradient and Hessian of :meth:`log_prior`."""
        c, a, b, _ = x.T
        stretch, stretch_bend = self._stretch_derivatives(x)
        gradient, hessian = np.zeros((len(x), 4)), np.zeros((len(x), 4, 4))
        with np.errstate(over="ignore"):  # 1/p beyond the largest float: infinite is right there
            inverse, fall = _inverse_share(a), expit(-a)
            far = c * inverse
            steep = np.stack([inverse, -far * fall], axis=-1)
            score, curve = prior.distribution("mu1").derivatives(sbar + far)
            gradient[:, :2] = score[:, None] * steep
            scaled = np.sqrt(np.abs(curve))[:, None] * steep  # a square of 1/p may be beyond the largest float, this is not
            hessian[:, :2, :2] = np.sign(curve)[:, None, None] * scaled[:, :, None] * scaled[:, None, :]
            hessian[:, 0, 1] += -score * fall * inverse
            hessian[:, 1, 0] = hessian[:, 0, 1]
            hessian[:, 1, 1] += score * far * fall
        # sigma_1 = w / stretch: its prior sees (a, b, split) through b - log stretch.
        first, second = Log().slopes(prior.distribution(SPREAD), b - self._log_stretch(x))
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
        mu1 = prior.distribution("mu1").sample(rng, size)
        log_sigma1 = np.log(prior.distribution(SPREAD).sample(rng, size))
        log_rho, log_gain = (np.log1p(-rng.uniform(size=size)) for _ in range(2))
        return self._point(mu1 - sbar, log_sigma1, log_rho, log_gain)

    names = Names(*(("mu1", "sigma1", "sigma_l", "rho"), ("offset", "pull", "width", "rho"), ("gain", "width")), monotone=("gain",))

    def named(self, x: FloatArray, prior: Prior, sbar: float) -> dict[str, FloatArray]:
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

    def coordinates_from(self, quantities: Mapping[str, FloatArray], prior: Prior, sbar: float) -> FloatArray:
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

    def prior_quantile(self, name: str, probability: float, prior: Prior, sbar: float) -> float | None:
        """Exact where the prior names the quantity."""
        if name == "rho":
            return probability
        known = {"mu1": "mu1", "sigma1": SPREAD}
        return prior_quantile(prior, known[name], probability) if name in known else None

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Those of the predictive update, half way between all gain and all memory."""
        return (*Update().grid(scale, peak), (0.0,))

    group = ("mu1", "pull", "width", "split")

    def to_group(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Prior mean, probit of the pull, log width, probit of the split."""
        return np.stack([sbar + x[:, 0] * _inverse_share(x[:, 1]), probit_of_logit(x[:, 1]), x[:, 2], probit_of_logit(x[:, 3])], axis=-1)

    def from_group(self, eta: FloatArray, prior: Prior, sbar: float) -> Derivatives:
        """The inverse, with c = p (mu1 - sbar)."""
        split, turn = Logit().from_group(eta[:, 3])
        first, jacobian = _with_offset(eta[:, :3], sbar, self.group_pull(eta[:, 1]))
        whole = np.zeros((len(eta), 4, 4))
        whole[:, :3, :3], whole[:, 3, 3] = jacobian, turn
        return np.concatenate([first, split[:, None]], axis=1), whole

    @staticmethod
    def group_pull(probit: FloatArray) -> GroupPull:
        """From its own probit."""
        a, slope = Logit().from_group(probit)
        p = ndtr(probit)
        return GroupPull(a, slope, p, p * expit(-a) * slope)

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


def _with_offset(eta: FloatArray, sbar: float, pulled: GroupPull) -> Derivatives:
    """(c, a, log w) of (mu1, probit, log w), shape (points, 3)."""
    far, jacobian = eta[:, 0] - sbar, np.zeros((len(eta), 3, 3))
    jacobian[:, 0, 0], jacobian[:, 0, 1] = pulled.pull, far * pulled.rise
    jacobian[:, 1, 1], jacobian[:, 2, 2] = pulled.slope, 1.0
    return np.stack([pulled.pull * far, pulled.logit, eta[:, 2]], axis=-1), jacobian


def _log_lost(a: FloatArray) -> FloatArray:
    """log(-log(1 - p)) at a = logit p."""
    return np.where(a < -30.0, a, np.log(np.logaddexp(0.0, np.maximum(a, -30.0))))


def _inverse_share(a: FloatArray) -> FloatArray:
    """1/expit(a)."""
    return np.asarray(1.0 + np.exp(-a))


def _with_half(x: FloatArray) -> FloatArray:
    """The coordinates with logit q0 = 0 after them."""
    return np.concatenate([x, np.zeros((*x.shape[:-1], 1))], axis=-1)
