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
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.special import log_expit, log_ndtr, ndtri_exp

from bayes_toe.model import MAX_PULL
from bayes_toe.prior import LOG_2PI, Prior

FloatArray = npt.NDArray[np.float64]

#: A point of density 0: its width is e^400.
NOWHERE = np.array([0.0, 0.0, 400.0, 0.0])


class Funnel(Protocol):
    """What the levelling needs of a posterior."""

    @property
    def prior(self) -> Prior:
        """The prior."""
        ...

    @property
    def sbar(self) -> float:
        """Mean first stimulus, from which the offset counts; natural-log intensity."""
        ...

    def likelihood_derivatives(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (points, 4) and Hessian (points, 4, 4) of the log likelihood."""
        ...


@dataclass(frozen=True)
class Levelling:
    """The bijection between unconstrained coordinates x and levelled ones y, for one posterior.

    Attributes
    ----------
    prior_mean : float
        m - sbar: prior mean of mu1 from the mean first stimulus, natural-log units.
    log_prior_sd : float
        Log of the prior standard deviation of mu1.
    offset : float
        c_0, where the data put the offset.
    log_precision : float
        Log of kappa, the data's precision of the offset at width w_0.
    log_width : float
        Log of w_0.
    follows_width : bool
        Whether the data's precision goes as 1/w^2. Where several modes leave c open it does not depend on w.
    """

    prior_mean: float
    log_prior_sd: float
    offset: float
    log_precision: float
    log_width: float
    follows_width: bool

    @classmethod
    def at(cls, posterior: Funnel, modes: FloatArray) -> Levelling:
        """Levelling from what the data say of the offset at modes of the posterior, shape (modes, 4), best first."""
        prior, best = posterior.prior, modes[0]
        precision = -float(posterior.likelihood_derivatives(best[None])[1][0, 0, 0])
        # Where the likelihood is not concave in c the data say little of it: one width stands in for its spread.
        spread = np.exp(best[2]) if precision <= 0 else precision**-0.5
        # Several modes: the data leave c as open as the modes are apart.
        apart = float(modes[:, 0].std())
        return cls(
            prior_mean=prior.mu1_mean - posterior.sbar,
            log_prior_sd=float(np.log(prior.mu1_sd)),
            offset=float(modes[:, 0].mean()),
            log_precision=float(-2.0 * np.log(np.hypot(spread, apart))),
            log_width=float(best[2]),
            follows_width=bool(apart < spread),
        )

    def level(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Levelled coordinates y of x, shape (points, 4), and log |dy/dx|, shape (points,)."""
        mean, log_spread = self._conditional(x)
        y = np.stack([(x[:, 0] - mean) * np.exp(-log_spread), _probit(x[:, 1]), x[:, 2], _probit(x[:, 3])], axis=1)
        return y, _log_volume(x, y, log_spread)

    def unlevel(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unconstrained coordinates x of y, shape (points, 4), and log |dy/dx| there, shape (points,).

        A probit beyond 37 stands for a pull or a lapse below the smallest float; the posterior has no mass there to any digit. Such points
        become :data:`NOWHERE`, where its density is 0: draws without weight, proposals that are refused.
        """
        x = np.stack([y[:, 0], _logit(y[:, 1]), y[:, 2], _logit(y[:, 3])], axis=1)
        x[np.abs(y[:, [1, 3]]).max(axis=1) > 37.0] = NOWHERE
        mean, log_spread = self._conditional(x)
        x[:, 0] = mean + y[:, 0] * np.exp(log_spread)
        return x, _log_volume(x, y, log_spread)

    def _conditional(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and log standard deviation of c given the other coordinates, shape (points,) each; in logs, since p may be tiny."""
        log_pull = np.log(MAX_PULL) + log_expit(x[:, 1])
        of_prior = -2.0 * (log_pull + self.log_prior_sd)
        narrowing = 2.0 * (x[:, 2] - self.log_width) if self.follows_width else 0.0
        log_spread = -0.5 * np.logaddexp(of_prior, self.log_precision - narrowing)
        share = np.exp(2.0 * log_spread + of_prior)
        return share * np.exp(log_pull) * self.prior_mean + (1.0 - share) * self.offset, log_spread


def _probit(logit: FloatArray) -> FloatArray:
    """Standard normal quantile of expit(logit), accurate in both tails."""
    return np.asarray(np.sign(logit) * -ndtri_exp(log_expit(-np.abs(logit))))


def _logit(probit: FloatArray) -> FloatArray:
    """Inverse of :func:`_probit`."""
    return np.asarray(log_ndtr(probit) - log_ndtr(-probit))


def _log_volume(x: FloatArray, y: FloatArray, log_spread: FloatArray) -> FloatArray:
    return np.asarray(_log_slope(x[:, 1], y[:, 1]) + _log_slope(x[:, 3], y[:, 3]) - log_spread)


def _log_slope(logit: FloatArray, probit: FloatArray) -> FloatArray:
    """Log d(probit)/d(logit) = log [expit(logit) expit(-logit) / phi(probit)]."""
    return np.asarray(log_expit(logit) + log_expit(-logit) + 0.5 * (np.square(probit) + LOG_2PI))
