"""The block of parameters of a memory that reverts to the prior mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, exprel, log_expit, ndtr

from bayes_toe.arrays import FloatArray
from bayes_toe.model.contraction import prior_quantile
from bayes_toe.model.distributions import Random
from bayes_toe.model.parameters import SPREAD, GroupPull, Mapped, with_offset
from bayes_toe.model.predictive_update import Update
from bayes_toe.model.prior import Prior
from bayes_toe.model.probits import probit_of_logit
from bayes_toe.model.propagators import log_lost, log_lost_slope
from bayes_toe.model.scales import Log, Logit
from bayes_toe.model.target import Names


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
        of_pull = log_lost(a) + log_expit(-a)
        of_split = log_expit(v) + log_expit(-v)
        return np.asarray(of_mu1 + Log().log_density(prior.distribution(SPREAD), b - self._log_stretch(x)) + of_pull + of_split)

    def gradient(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Gradient of :meth:`log_prior`."""
        c, a, b, v = x.T
        with np.errstate(over="ignore"):  # 1/p beyond the largest float: infinite is right there
            inverse = _inverse_share(a)
            far = np.where(c == 0.0, 0.0, c * inverse)
            of_mu1 = prior.distribution("mu1").slope(sbar + far)
            of_offset, of_pull = of_mu1 * inverse, -of_mu1 * far * expit(-a)
        # sigma_1 = w / stretch: its prior sees (a, b, split) through b - log stretch.
        of_spread = Log().slope(prior.distribution(SPREAD), b - self._log_stretch(x))
        by_pull, by_split = self._stretch_slopes(a, v)
        of_pull += log_lost_slope(a) - expit(a) - of_spread * by_pull
        return np.stack([of_offset, of_pull, of_spread, -of_spread * by_split - np.tanh(0.5 * v)], axis=-1)

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

    @staticmethod
    def _log_stretch(x: FloatArray) -> FloatArray:
        """Log of w/sigma1 = (1 - g^2)/(K (1 - g rho)^(1/2)) with g = exp(-l), rho = exp(-l v), K = exp(-l (1 - v)), l = -ln(1 - p)."""
        lost, v = np.logaddexp(0.0, x[..., 1]), x[..., 3]
        return np.asarray(np.log(-np.expm1(-2.0 * lost)) + lost * expit(-v) - 0.5 * np.log(-np.expm1(-lost * (1.0 + expit(v)))))

    @staticmethod
    def _stretch_slopes(a: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the log of w/sigma1 in the logits of pull and split, with d log(1 - e^-x)/d log x = x/(e^x - 1)."""
        lost, growth, split = np.logaddexp(0.0, a), log_lost_slope(a), expit(v)
        twice, mixed = 1.0 / exprel(2.0 * lost), 0.5 / exprel(lost * (1.0 + split))
        turn = split * expit(-v)
        return growth * (twice - mixed) + expit(a) * expit(-v), -turn * (lost + mixed / (1.0 + split))


def _inverse_share(a: FloatArray) -> FloatArray:
    """1/expit(a)."""
    return np.asarray(1.0 + np.exp(-a))
