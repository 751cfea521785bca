"""What becomes of the first stimulus in memory: the blocks of parameters of the predictive update and of a memory that decays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.special import expit, exprel, log_expit, ndtr, ndtri_exp

from bayes_toe.arrays import FloatArray
from bayes_toe.model.blocks import (
    WIDTH,
    GroupPull,
    Log,
    Logit,
    Mapped,
    Single,
    starting_offsets,
    with_offset,
)
from bayes_toe.model.closed_form import MAX_PULL, noise_ratio, pull, variance_ratio
from bayes_toe.model.coordinates import (
    Natural,
    inverse_pull,
    log_jacobian_of_pull,
    log_jacobian_slope_of_pull,
    log_noise_ratio,
    log_slope,
    logit_of_probit,
    probit_of_logit,
    reach,
    unconstrained,
)
from bayes_toe.model.distributions import Random
from bayes_toe.model.intervals import OF_EQUAL, CurveScale, log_lost, log_lost_slope
from bayes_toe.model.prior import (
    Prior,
    log_density_of_noise_ratio,
    prior_quantile,
    slope_of_noise_ratio,
)
from bayes_toe.model.target import Names


@dataclass(frozen=True)
class Update:
    """The predictive update's (mu1, sigma_p, gamma) in identified coordinates, with H1's prior; see :mod:`bayes_toe.model.coordinates`.

    The width is sigma_p G^power, as the task's curve has it.
    """

    curve: CurveScale = OF_EQUAL

    coordinates = ("offset", "logit_pull", "log_width")
    group = ("mu1", "gamma", "width")
    names = Names(
        ("mu1", "sigma_p", "sigma_l"),
        ("offset", "pull", "width"),
        derived=("gamma", "sigma1", "gain", "width"),
        monotone=("gain", "pull"),
    )

    def parameters(self, prior: Prior) -> tuple[str, ...]:
        """Whose distributions the prior is made of."""
        return ("mu1", prior.spread, "gamma")

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        return ", ".join(f"{name} ~ {prior.said(name)}" for name in self.parameters(prior))

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """H1's log density but for the part of q0; where the width has a prior, not sigma_p, |d(mu1, gamma)/d(c, a)| is the Jacobian."""
        a, b = x[:, 1], x[:, 2]
        of_mu1, of_spread, of_gamma = (prior.distribution(name) for name in self.parameters(prior))
        log_gain = np.log1p(-MAX_PULL * expit(a))
        seen = b if prior.spread == "width" else b + self.curve.power * log_gain
        with np.errstate(over="ignore"):  # mu1 beyond the largest float: the density is 0 there
            of_values = of_mu1.log_density(sbar + reach(x)) + Log().log_density(of_spread, seen)
        return np.asarray(
            of_values
            + log_density_of_noise_ratio(of_gamma, a)
            + log_jacobian_of_pull(a)
            - 1.5 * log_gain
        )

    def gradient(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Gradient of :meth:`log_prior`."""
        a, b, p, down = x[:, 1], x[:, 2], MAX_PULL * expit(x[:, 1]), expit(-x[:, 1])
        of_mu1, of_spread, of_gamma = (prior.distribution(name) for name in self.parameters(prior))
        narrowing = -p * down / (1.0 - p)  # d log K / da
        with np.errstate(
            over="ignore"
        ):  # 1/p is beyond the largest float where p < 1e-308: infinite is right there
            far = reach(x)
            score = of_mu1.slope(sbar + far)
            of_log_spread = Log().slope(
                of_spread, b if prior.spread == "width" else b + self.curve.power * np.log1p(-p)
            )
            of_pull = log_jacobian_slope_of_pull(a) - score * far * down - 1.5 * narrowing
            of_pull += (
                0.0 if prior.spread == "width" else self.curve.power * narrowing * of_log_spread
            )
            return np.stack(
                [
                    score * inverse_pull(a),
                    of_pull + slope_of_noise_ratio(of_gamma, a),
                    of_log_spread,
                ],
                axis=-1,
            )

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 3).

        With gamma = p/(1 - p)^2, p/(p_max - p) is gamma/(1 - gamma) times (1/p_max - p): finite where gamma itself rounds to an edge.
        """
        mu1, spread = (prior.distribution(name).sample(rng, size) for name in ("mu1", prior.spread))
        logit_gamma = Logit().sample(prior.distribution("gamma"), rng, size)
        gamma = expit(logit_gamma)
        p, w = (
            pull(gamma),
            spread
            if prior.spread == "width"
            else spread * variance_ratio(gamma) ** self.curve.power,
        )
        return np.stack(
            [p * (mu1 - sbar), logit_gamma + np.log(1.0 / MAX_PULL - p), np.log(w)], axis=-1
        )

    def named(self, x: FloatArray, prior: Prior, sbar: float) -> dict[str, FloatArray]:
        """Natural, derived and identified parameters."""
        p, w = MAX_PULL * expit(x[..., 1]), np.exp(x[..., 2])
        gain = 1.0 - p
        sigma_p = w * gain**self.curve.power
        found = {
            **{
                "mu1": sbar + reach(x),
                "sigma_p": sigma_p,
                "sigma_l": sigma_p * np.sqrt(p) / gain,
                "gamma": p / np.square(gain),
            },
            **{
                "sigma1": sigma_p / np.sqrt(gain),
                "gain": gain,
                "width": w,
                "offset": x[..., 0],
                "pull": p,
            },
        }
        return {
            name: found[name]
            for name in dict.fromkeys(
                (*self.names.natural, *self.names.derived, *self.names.identified)
            )
        }

    def coordinates_from(
        self, quantities: Mapping[str, FloatArray], prior: Prior, sbar: float
    ) -> FloatArray:
        """From the natural parameters."""
        mu1, sigma_p, sigma_l = (
            np.asarray(quantities[name], np.float64) for name in self.names.natural
        )
        x = unconstrained(Natural(mu1, sigma_p, sigma_l, np.asarray(0.5)), sbar)[..., :3]
        x[..., 2] = np.log(sigma_p) + self.curve.power * np.log(
            variance_ratio(noise_ratio(sigma_p, sigma_l))
        )
        return x

    def prior_quantile(
        self, name: str, probability: float, prior: Prior, sbar: float
    ) -> float | None:
        """Exact, but for the offset."""
        if name == "pull":
            return 1.0 - prior_quantile(prior, "gain", 1.0 - probability)
        return (
            None if name == "offset" else prior_quantile(prior, name, probability, self.curve.power)
        )

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Offsets and widths on the scale of the stimuli, a weak and a strong pull."""
        return (starting_offsets(scale), (-2.0, 2.0), *WIDTH.grid(scale, peak))

    def to_group(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Prior mean, probit of the noise ratio, log width: of these the data tell most, and normal tails do no harm."""
        log_gamma, log_rest = log_noise_ratio(x[:, 1])
        probit = np.where(log_gamma < log_rest, ndtri_exp(log_gamma), -ndtri_exp(log_rest))
        return np.stack([sbar + reach(x), probit, x[:, 2]], axis=-1)

    def from_group(self, eta: FloatArray, prior: Prior, sbar: float) -> Mapped:
        """With c = p (mu1 - sbar)."""
        return with_offset(eta, sbar, self.group_pull(eta[:, 1]))

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

    so the pull is p = 1 - rho K, and w = sigma1 (1 - g^2)/(K (1 - g rho)^(1/2)) with g = 1 - p; of another task's curve w is other powers
    of sigma_2^2 + sigma_l^2 = sigma1^2 (1 - g^2)/K and of sigma_2^2. One interval tells rho K, not rho and K. The coordinate that only the
    prior rules then splits the logs: rho = g^v, K = g^(1 - v), 0 < v < 1. With several intervals rho and everything that depends on it is
    that at the reference, and the split is told by the answers (:mod:`bayes_toe.model.intervals`).

    Priors: mu1 as in H1; the width as in the other models, or, where sigma_p has the prior, sigma1, the spread of expected intensities, its
    HalfNormal; gain and rho are Uniform(0, 1), which says nothing of how the pull comes about. Then v is Uniform(0, 1) and p has density
    -ln(1 - p), independent.
    """

    curve: CurveScale = OF_EQUAL

    coordinates = ("offset", "logit_pull", "log_width", "logit_split")
    group = ("mu1", "pull", "width", "split")
    names = Names(
        ("mu1", "sigma1", "sigma_l", "rho"),
        ("offset", "pull", "width", "rho"),
        ("gain", "width"),
        ("gain",),
    )

    def parameters(self, prior: Prior) -> tuple[str, ...]:
        """Whose distributions the prior is made of."""
        return ("mu1", prior.spread)

    def describe(self, prior: Prior) -> str:
        """The prior in words."""
        spread = "width" if prior.spread == "width" else "sigma1"
        gain = "sigma1^2/(sigma1^2 + sigma_l^2) ~ Uniform(0, 1), rho ~ Uniform(0, 1)"
        return f"mu1 ~ {prior.said('mu1')}, {spread} ~ {prior.said(prior.spread)}, {gain}"

    def log_prior(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Log density; d mu1/dc = 1/p cancels against dp/d(logit p) = p (1 - p)."""
        _, a, b, v = x.T
        with np.errstate(over="ignore"):  # mu1 beyond the largest float: its density is 0
            of_mu1 = prior.distribution("mu1").log_density(sbar + reach(x, 1.0))
        of_pull = log_lost(a) + log_expit(-a)
        of_split = log_expit(v) + log_expit(-v)
        stretch = 0.0 if prior.spread == "width" else self._log_stretch(x)
        return np.asarray(
            of_mu1
            + Log().log_density(prior.distribution(prior.spread), b - stretch)
            + of_pull
            + of_split
        )

    def gradient(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Gradient of :meth:`log_prior`."""
        _, a, b, v = x.T
        with np.errstate(over="ignore"):  # 1/p beyond the largest float: infinite is right there
            far = reach(x, 1.0)
            of_mu1 = prior.distribution("mu1").slope(sbar + far)
            of_offset, of_pull = of_mu1 * inverse_pull(a, 1.0), -of_mu1 * far * expit(-a)
        # sigma_1 = w / stretch: its prior sees (a, b, split) through b - log stretch.
        of_width = prior.spread == "width"
        of_spread = Log().slope(
            prior.distribution(prior.spread), b if of_width else b - self._log_stretch(x)
        )
        by_pull, by_split = (
            (np.zeros_like(a), np.zeros_like(a)) if of_width else self._stretch_slopes(a, v)
        )
        of_pull += log_lost_slope(a) - expit(a) - of_spread * by_pull
        return np.stack(
            [of_offset, of_pull, of_spread, -of_spread * by_split - np.tanh(0.5 * v)], axis=-1
        )

    def sample(self, rng: Random, size: int, prior: Prior, sbar: float) -> FloatArray:
        """Independent draws, shape (size, 4)."""
        mu1 = prior.distribution("mu1").sample(rng, size)
        log_spread = np.log(prior.distribution(prior.spread).sample(rng, size))
        log_rho, log_gain = (np.log1p(-rng.uniform(size=size)) for _ in range(2))
        x = self._point(mu1 - sbar, log_spread, log_rho, log_gain)
        if prior.spread == "width":
            x[:, 2] = log_spread
        return x

    def named(self, x: FloatArray, prior: Prior, sbar: float) -> dict[str, FloatArray]:
        """The natural parameters but q0, and the identified ones; gain is rho times that of the measurement, the weight of s1."""
        lost = np.logaddexp(0.0, x[..., 1])
        sigma1 = np.exp(x[..., 2] - self._log_stretch(x))
        rho, log_gain = np.exp(-expit(x[..., 3]) * lost), -expit(-x[..., 3]) * lost
        # sigma_l^2/sigma1^2 = 1/K - 1
        sigma_l = sigma1 * np.sqrt(np.expm1(-log_gain))
        found = {
            "mu1": sbar + reach(x, 1.0),
            "sigma1": sigma1,
            "sigma_l": sigma_l,
            "rho": rho,
            "gain": np.exp(-lost),
        }
        return {**found, "offset": x[..., 0], "pull": expit(x[..., 1]), "width": np.exp(x[..., 2])}

    def coordinates_from(
        self, quantities: Mapping[str, FloatArray], prior: Prior, sbar: float
    ) -> FloatArray:
        """From the natural parameters."""
        mu1, sigma1, sigma_l, rho = (
            np.asarray(quantities[name], np.float64) for name in self.names.natural
        )
        return self._point(
            mu1 - sbar, np.log(sigma1), np.log(rho), -np.log1p(np.square(sigma_l / sigma1))
        )

    def _point(
        self, reach: FloatArray, log_sigma1: FloatArray, log_rho: FloatArray, log_gain: FloatArray
    ) -> FloatArray:
        """Coordinates of mu1 - sbar, log sigma1, log rho and log of the measurement's gain."""
        lost = -(log_rho + log_gain)
        pull = -np.expm1(-lost)
        x = np.stack(
            [pull * reach, np.log(pull) + lost, np.zeros_like(lost), np.log(log_rho / log_gain)],
            axis=-1,
        )
        x[..., 2] = log_sigma1 + self._log_stretch(x)
        return x

    def prior_quantile(
        self, name: str, probability: float, prior: Prior, sbar: float
    ) -> float | None:
        """Exact where the prior names the quantity."""
        if name == "rho":
            return probability
        known = {"mu1": "mu1", "width" if prior.spread == "width" else "sigma1": prior.spread}
        return prior_quantile(prior, known[name], probability) if name in known else None

    def grid(self, scale: float, peak: float) -> Sequence[Sequence[float]]:
        """Those of the predictive update, half way between all gain and all memory."""
        return (*Update().grid(scale, peak), (0.0,))

    def to_group(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Prior mean, probit of the pull, log width, probit of the split."""
        return np.stack(
            [sbar + reach(x, 1.0), probit_of_logit(x[:, 1]), x[:, 2], probit_of_logit(x[:, 3])],
            axis=-1,
        )

    def from_group(self, eta: FloatArray, prior: Prior, sbar: float) -> Mapped:
        """The inverse, with c = p (mu1 - sbar)."""
        split, turn = Logit().from_group(eta[:, 3])
        first, jacobian = with_offset(eta[:, :3], sbar, self.group_pull(eta[:, 1]))
        whole = np.zeros((len(eta), 4, 4))
        whole[:, :3, :3], whole[:, 3, 3] = jacobian, turn
        return np.concatenate([first, split[:, None]], axis=1), whole

    @staticmethod
    def group_pull(probit: FloatArray) -> GroupPull:
        """From its own probit."""
        a, slope = Logit().from_group(probit)
        p = ndtr(probit)
        return GroupPull(a, slope, p, p * expit(-a) * slope)

    def _log_stretch(self, x: FloatArray) -> FloatArray:
        """Log of w/sigma1 with g = exp(-l), rho = exp(-l v), K = exp(-l (1 - v)), l = -ln(1 - p)."""
        lost, v = np.logaddexp(0.0, x[..., 1]), x[..., 3]
        total, own = (
            np.log(-np.expm1(-2.0 * lost)) + lost * expit(-v),
            np.log(-np.expm1(-lost * (1.0 + expit(v)))),
        )
        return np.asarray(self.curve.total * total - self.curve.own * own)

    def _stretch_slopes(self, a: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the log of w/sigma1 in the logits of pull and split, with d log(1 - e^-x)/d log x = x/(e^x - 1)."""
        lost, growth, split = np.logaddexp(0.0, a), log_lost_slope(a), expit(v)
        twice, mixed = (
            self.curve.total / exprel(2.0 * lost),
            self.curve.own / exprel(lost * (1.0 + split)),
        )
        turn = split * expit(-v)
        by_pull = growth * (twice - mixed) + self.curve.total * expit(a) * expit(-v)
        return by_pull, -turn * (self.curve.total * lost + mixed / (1.0 + split))


#: Some coordinates with a joint prior, independent of the other blocks'; methods get this block's columns of x, shape (points, k).
#:
#: `coordinates` that begin with logit_ are logits of a number in 0..1. `log_prior` is the log density with respect to x, (points,), with
#: `gradient`, (points, k); `parameters` are those of the prior whose distributions it is made of. `named` has the quantities that a reader
#: knows, (..., k) -> (...) each, and `coordinates_from` is its inverse. `prior_quantile` is None where it has no short form, and draws have
#: to tell it. `grid` has starting values of each coordinate, for stimuli `scale` apart and `peak`, a logit of the largest frequency of
#: 'equal'. Between the members of a group the quantities `group`, one for each coordinate, scatter, normal on their group scales:
#: `to_group` has them there, (points, k), `from_group` x and dx/d(eta), (points, k, k), triangular; where answers tell p (mu1 - sbar) of
#: the first one, mu1, `group_pull` has the pull from the second, else it is None.
Block: TypeAlias = Single | Update | Memory
