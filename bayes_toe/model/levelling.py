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
from scipy.special import log_expit

from bayes_toe.arrays import FloatArray
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.prior import Prior
from bayes_toe.model.probits import log_slope, logit_of_probit, probit_of_logit
from bayes_toe.model.target import hessian

#: Probits beyond which the logit stands for a pull or a lapse below the smallest float.
FARTHEST = 37.0


def nowhere(size: int, log_width: int) -> FloatArray:
    """A point of density 0 with this many coordinates: its width is e^400."""
    return np.where(np.arange(size) == log_width, 400.0, 0.0)


class Funnel(Protocol):
    """What the levelling needs of a posterior whose offset c = p (mu1 - sbar) depends on the pull through mu1's prior."""

    @property
    def prior(self) -> Prior:
        """The prior."""
        ...

    @property
    def sbar(self) -> float:
        """Mean first stimulus, from which the offset counts; natural-log intensity."""
        ...

    def likelihood_gradient(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log likelihood, (points,), and its gradient, (points, k)."""
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
    max_pull: float = MAX_PULL
    logits: tuple[int, ...] = (1, 3)

    @classmethod
    def at(
        cls,
        posterior: Funnel,
        modes: FloatArray,
        logits: tuple[int, ...] = (1, 3),
        *,
        centre: str = "mu1",
        max_pull: float = MAX_PULL,
    ) -> Levelling:
        """Levelling from what the data say of the offset at modes of the posterior, shape (modes, k), best first.

        The first coordinates are c, logit(p/max_pull), log w; `logits` has the places of all that are logits. k is 4 for H1.
        """
        believed, best = posterior.prior.distribution(centre), modes[0]
        precision = -float(hessian(lambda x: posterior.likelihood_gradient(x)[1], best[None])[0, 0, 0])
        # Where the likelihood is not concave in c the data say little of it: one width stands in for its spread.
        spread = np.exp(best[2]) if precision <= 0 else precision**-0.5
        # Several modes: the data leave c as open as the modes are apart.
        apart = float(modes[:, 0].std())
        return cls(
            prior_mean=float(believed.quantile(0.5)) - posterior.sbar,
            log_prior_sd=float(np.log(believed.spread)),
            offset=float(modes[:, 0].mean()),
            log_precision=float(-2.0 * np.log(np.hypot(spread, apart))),
            log_width=float(best[2]),
            follows_width=bool(apart < spread),
            max_pull=max_pull,
            logits=logits,
        )

    def level(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Levelled coordinates y of x, shape (points, k), and log |dy/dx|, shape (points,)."""
        mean, log_spread = self._conditional(x)
        y = x.copy()
        y[:, 0] = (x[:, 0] - mean) * np.exp(-log_spread)
        y[:, self.logits] = probit_of_logit(x[:, self.logits])
        return y, self._log_volume(y) - log_spread

    def unlevel(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unconstrained coordinates x of y, shape (points, k), and log |dy/dx| there, shape (points,).

        A probit beyond 37 (:data:`FARTHEST`) stands for a pull or a lapse below the smallest float; the posterior has no mass there to
        any digit. Such points become :func:`nowhere`, where its density is 0: draws without weight, proposals that are refused.
        """
        x = y.copy()
        x[:, self.logits] = logit_of_probit(y[:, self.logits])
        x[np.abs(y[:, self.logits]).max(axis=1) > FARTHEST] = nowhere(y.shape[1], 2)
        mean, log_spread = self._conditional(x)
        x[:, 0] = mean + y[:, 0] * np.exp(log_spread)
        return x, self._log_volume(y) - log_spread

    def _log_volume(self, y: FloatArray) -> FloatArray:
        return np.asarray(log_slope(y[:, self.logits]).sum(axis=1))

    def _conditional(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and log standard deviation of c given the other coordinates, shape (points,) each; in logs, since p may be tiny."""
        log_pull = np.log(self.max_pull) + log_expit(x[:, 1])
        of_prior = -2.0 * (log_pull + self.log_prior_sd)
        narrowing = 2.0 * (x[:, 2] - self.log_width) if self.follows_width else 0.0
        log_spread = -0.5 * np.logaddexp(of_prior, self.log_precision - narrowing)
        share = np.exp(2.0 * log_spread + of_prior)
        return share * np.exp(log_pull) * self.prior_mean + (1.0 - share) * self.offset, log_spread


@dataclass(frozen=True)
class Probits:
    """Levelled coordinates of a posterior without a funnel: probits in the place of logits, the rest as it is.

    Attributes
    ----------
    logits : tuple of int
        Which coordinates are logits.
    log_width : int
        Which one is the log of a width.
    """

    logits: tuple[int, ...]
    log_width: int

    def level(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Levelled coordinates y of x, shape (points, k), and log |dy/dx|, shape (points,)."""
        y = x.copy()
        y[:, self.logits] = probit_of_logit(x[:, self.logits])
        return y, self._log_volume(y)

    def unlevel(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unconstrained coordinates x of y, shape (points, k), and log |dy/dx| there; points beyond :data:`FARTHEST` are nowhere."""
        x = y.copy()
        x[:, self.logits] = logit_of_probit(y[:, self.logits])
        x[(np.abs(y[:, self.logits]) > FARTHEST).any(axis=1)] = nowhere(y.shape[1], self.log_width)
        return x, self._log_volume(y)

    def _log_volume(self, y: FloatArray) -> FloatArray:
        return np.asarray(log_slope(y[:, self.logits]).sum(axis=1))
