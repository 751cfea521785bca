"""Coordinates in which the posterior of the paper's model (H1) is nearly normal.

`NormalScores` maps the coordinates of H1 to them and back. The importance sampler needs this: in
the original coordinates the posterior of the offset c gets narrower as the pull p goes to 0.

m and V are the prior mean and variance of mu1. c_0 and kappa are the value and the precision of c
that the data give at the width w_0. Given pull p and width w, two things fix the offset c = p (mu1
- sbar): the prior, with mean p (m - sbar) and standard deviation p V^(1/2), and the data, about c_0
with a precision that goes as 1/w^2. For a normal likelihood the conditional of c is then normal
with

    s^-2 = 1 / (p^2 V) + kappa (w_0 / w)^2
    mean = share p (m - sbar) + (1 - share) c_0,    share = s^2 / (p^2 V).

The coordinates y replace c by (c - mean) / s: as p -> 0 the posterior in c narrows in proportion to
p, which no mixture with a fixed scale can follow; in y it keeps its width. Pull and q0 enter by
probit instead of logit: where the data leave them open their logits have exponential tails, their
probits normal ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erfcx, log_expit, log_ndtr, ndtri_exp

from bayes_toe.arrays import ArrayPair, FloatArray
from bayes_toe.model.derivatives import Gradient, hessian
from bayes_toe.model.distributions import Normal
from bayes_toe.model.paper_equations import MAX_PULL

#: Probits beyond which the logit stands for a pull or a lapse below the smallest float.
FARTHEST = 37.0
#: The coordinates that are logits, and a point (c, logit pull, log w, logit of the share) at which
#: the density is 0.
_LOGITS = (1, 3)
_NO_DENSITY = (0.0, 0.0, 400.0, 0.0)


@dataclass(frozen=True)
class Funnel:
    """Normal distribution of the offset c given pull and width.

    The first coordinates are c, logit(p/p_max), log w.
    """

    prior_mean: float  # m - sbar: prior mean of mu1 from the mean first stimulus, natural-log units
    log_prior_sd: float  # of mu1
    offset: float  # c_0, where the data put the offset
    log_precision: float  # of kappa, the data's precision of the offset at width w_0
    log_width: float  # of w_0
    # whether that precision goes as 1/w^2; where several modes leave c open it does not depend on w
    follows_width: bool

    @classmethod
    def from_modes(cls, modes: FloatArray, slope: Gradient, mu1: Normal, sbar: float) -> Funnel:
        """From what the data say of the offset at modes of the posterior, (modes, k), best first.

        `slope` is the gradient of the log likelihood, `mu1` the distribution of the prior mean,
        sbar that from which the offset counts.
        """
        best = modes[0]
        precision = -float(hessian(slope, best[None])[0, 0, 0])
        # Where the likelihood is not concave in c the data say little of it: one width stands in
        # for its spread.
        spread = np.exp(best[2]) if precision <= 0 else precision**-0.5
        # Several modes: the data leave c as open as the modes are apart.
        distance = float(modes[:, 0].std())
        log_precision = float(-2.0 * np.log(np.hypot(spread, distance)))
        believed = float(mu1.mean) - sbar, float(np.log(mu1.sd))
        return cls(
            *believed,
            float(modes[:, 0].mean()),
            log_precision,
            float(best[2]),
            bool(distance < spread),
        )

    def conditional(self, x: FloatArray) -> ArrayPair:
        """Mean and log standard deviation of c given the other coordinates, shape (points,) each.

        In logs, since p may be tiny.
        """
        log_pull = np.log(MAX_PULL) + log_expit(x[:, 1])
        log_prior_precision = -2.0 * (log_pull + self.log_prior_sd)
        log_data_precision: FloatArray | float = self.log_precision
        if self.follows_width:
            log_data_precision = self.log_precision - 2.0 * (x[:, 2] - self.log_width)
        log_sd = -0.5 * np.logaddexp(log_prior_precision, log_data_precision)
        prior_share = np.exp(2.0 * log_sd + log_prior_precision)
        mean = prior_share * np.exp(log_pull) * self.prior_mean + (1.0 - prior_share) * self.offset
        return mean, log_sd


@dataclass(frozen=True)
class NormalScores:
    """The bijection between coordinates x of H1, (points, 4), and nearly normal ones y."""

    funnel: Funnel

    def forward(self, x: FloatArray) -> ArrayPair:
        """Coordinates y of x, and log |dy/dx|, shape (points,)."""
        mean, log_spread = self.funnel.conditional(x)
        y = x.copy()
        y[:, 0] = (x[:, 0] - mean) * np.exp(-log_spread)
        y[:, _LOGITS] = probit_of_logit(x[:, _LOGITS])
        return y, log_slope(y[:, _LOGITS]).sum(axis=1) - log_spread

    def inverse(self, y: FloatArray) -> ArrayPair:
        """Coordinates x of y, and log |dy/dx| there, shape (points,).

        A probit beyond 37 (:data:`FARTHEST`) stands for a pull or a lapse below the smallest float;
        the posterior has no mass there to any digit. Such points go to where its density is 0, at a
        width of e^400: draws without weight, proposals that are refused.
        """
        x = y.copy()
        is_beyond = (np.abs(y[:, _LOGITS]) > FARTHEST).any(axis=1)
        x[:, _LOGITS] = logit_of_probit(y[:, _LOGITS])
        x[is_beyond] = _NO_DENSITY
        mean, log_spread = self.funnel.conditional(x)
        x[~is_beyond, 0] = (mean + y[:, 0] * np.exp(log_spread))[~is_beyond]
        return x, log_slope(y[:, _LOGITS]).sum(axis=1) - log_spread


def probit_of_logit(logit: FloatArray) -> FloatArray:
    """Standard normal quantile of expit(logit), shape (...)."""
    return np.sign(logit) * -ndtri_exp(log_expit(-np.abs(logit)))


def logit_of_probit(probit: FloatArray) -> FloatArray:
    """Inverse of :func:`probit_of_logit`."""
    return log_ndtr(probit) - log_ndtr(-probit)


def log_slope(probit: FloatArray) -> FloatArray:
    """Log d(probit)/d(logit) = log [Phi(y) Phi(-y) / phi(y)] at the probit y.

    By Mills' ratio nothing cancels far out.

    Examples
    --------
    >>> log_slope(np.array([0.0, 1e12])).round(3).tolist()
    [-0.467, -27.631]
    """
    far = np.abs(probit)
    return log_ndtr(far) + np.log(erfcx(far * np.sqrt(0.5))) + 0.5 * np.log(0.5 * np.pi)
