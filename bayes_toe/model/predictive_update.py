"""The predictive update's block of parameters: H1 but for its peak."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, ndtr, ndtri_exp

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import MAX_PULL, pull
from bayes_toe.model.contraction import prior_quantile
from bayes_toe.model.coordinates import Natural, derived, identified, log_noise_ratio, natural, reach, unconstrained
from bayes_toe.model.distributions import Random
from bayes_toe.model.parameters import SPREAD, WIDTH, GroupPull, Mapped, starting_offsets, with_offset
from bayes_toe.model.prior import Prior
from bayes_toe.model.probits import log_slope, logit_of_probit
from bayes_toe.model.target import Names


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

    def gradient(self, x: FloatArray, prior: Prior, sbar: float) -> FloatArray:
        """Gradient of :meth:`log_prior`."""
        return prior.gradient(_with_half(x), sbar)[:, :3]

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


def _with_half(x: FloatArray) -> FloatArray:
    """The coordinates with logit q0 = 0 after them."""
    return np.concatenate([x, np.zeros((*x.shape[:-1], 1))], axis=-1)
