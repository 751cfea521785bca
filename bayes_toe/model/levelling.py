"""Levelled coordinates: the funnel of the posterior straightened out, so that ordinary mixtures fit it.

Given pull p and width w, two things fix the offset c = p (mu1 - sbar): the prior, with mean p (m - sbar) and standard deviation p V^(1/2),
and the data, about c_0 with a precision that goes as 1/w^2. For a normal likelihood the conditional of c is then normal with

    s^-2 = 1 / (p^2 V) + kappa (w_0 / w)^2,    mean = share p (m - sbar) + (1 - share) c_0,    share = s^2 / (p^2 V).

Levelled coordinates y replace c by (c - mean) / s: as p -> 0 the posterior in c narrows in proportion to p, which no mixture with a fixed
scale can follow; in y it keeps its width. Pull and q0 enter by probit instead of logit: where the data leave them open their logits have
exponential tails, their probits normal ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_expit

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.coordinates import log_slope, logit_of_probit, probit_of_logit
from bayes_toe.model.distributions import Distribution
from bayes_toe.model.target import Gradient, hessian

#: Probits beyond which the logit stands for a pull or a lapse below the smallest float.
FARTHEST = 37.0


@dataclass(frozen=True)
class Funnel:
    """Normal distribution of the offset c given pull and width; the first coordinates are c, logit(p/max_pull), log w."""

    prior_mean: float  # m - sbar: prior mean of mu1 from the mean first stimulus, natural-log units
    log_prior_sd: float  # of mu1
    offset: float  # c_0, where the data put the offset
    log_precision: float  # of kappa, the data's precision of the offset at width w_0
    log_width: float  # of w_0
    follows_width: bool  # whether that precision goes as 1/w^2; where several modes leave c open it does not depend on w
    max_pull: float = MAX_PULL

    @classmethod
    def at(
        cls,
        modes: FloatArray,
        slope: Gradient,
        mu1: Distribution,
        sbar: float,
        max_pull: float = MAX_PULL,
    ) -> Funnel:
        """From what the data say of the offset at modes of the posterior, shape (modes, k), best first.

        `slope` is the gradient of the log likelihood, `mu1` the distribution of the prior mean, sbar that from which the offset counts.
        """
        best = modes[0]
        precision = -float(hessian(slope, best[None])[0, 0, 0])
        # Where the likelihood is not concave in c the data say little of it: one width stands in for its spread.
        spread = np.exp(best[2]) if precision <= 0 else precision**-0.5
        # Several modes: the data leave c as open as the modes are apart.
        apart = float(modes[:, 0].std())
        log_precision = float(-2.0 * np.log(np.hypot(spread, apart)))
        believed = float(mu1.quantile(0.5)) - sbar, float(np.log(mu1.spread))
        return cls(
            *believed,
            float(modes[:, 0].mean()),
            log_precision,
            float(best[2]),
            bool(apart < spread),
            max_pull,
        )

    def conditional(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and log standard deviation of c given the other coordinates, shape (points,) each; in logs, since p may be tiny."""
        log_pull = np.log(self.max_pull) + log_expit(x[:, 1])
        of_prior = -2.0 * (log_pull + self.log_prior_sd)
        narrowing = 2.0 * (x[:, 2] - self.log_width) if self.follows_width else 0.0
        log_spread = -0.5 * np.logaddexp(of_prior, self.log_precision - narrowing)
        share = np.exp(2.0 * log_spread + of_prior)
        return share * np.exp(log_pull) * self.prior_mean + (1.0 - share) * self.offset, log_spread


@dataclass(frozen=True)
class Levelling:
    """The bijection between unconstrained coordinates x and levelled ones y, for one posterior."""

    logits: tuple[int, ...]  # which coordinates are logits
    log_width: int  # which one is the log of a width
    funnel: Funnel | None = (
        None  # by which the first coordinate is levelled; without one it stays as it is
    )

    def level(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Levelled coordinates y of x, shape (points, k), and log |dy/dx|, shape (points,)."""
        mean, log_spread = (0.0, 0.0) if self.funnel is None else self.funnel.conditional(x)
        y = x.copy()
        y[:, 0] = (x[:, 0] - mean) * np.exp(-log_spread)
        y[:, self.logits] = probit_of_logit(x[:, self.logits])
        return y, log_slope(y[:, self.logits]).sum(axis=1) - log_spread

    def unlevel(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unconstrained coordinates x of y, shape (points, k), and log |dy/dx| there, shape (points,).

        A probit beyond 37 (:data:`FARTHEST`) stands for a pull or a lapse below the smallest float; the posterior has no mass there to
        any digit. Such points go to where its density is 0, at a width of e^400: draws without weight, proposals that are refused.
        """
        x, beyond = y.copy(), (np.abs(y[:, self.logits]) > FARTHEST).any(axis=1)
        x[:, self.logits] = logit_of_probit(y[:, self.logits])
        x[beyond] = np.where(np.arange(y.shape[1]) == self.log_width, 400.0, 0.0)
        mean, log_spread = (0.0, 0.0) if self.funnel is None else self.funnel.conditional(x)
        x[~beyond, 0] = (mean + y[:, 0] * np.exp(log_spread))[~beyond]
        return x, log_slope(y[:, self.logits]).sum(axis=1) - log_spread
