"""Log evidence of one subject under one model, with a standard error, or with the reason why there is none."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.proposal import FittedProposal
from bayes_toe.model.target import Conjugate

#: Probability that a model without evidence may have at most, by the bound of it, where it is left out as having none.
NO_WEIGHT = 1e-4


@dataclass(frozen=True)
class Evidence:
    """Log evidence in nats, without binomial coefficients.

    Attributes
    ----------
    value, se : float or None
        None where withheld.
    efficiency, pareto_k : float or None
        Of the importance weights; None where the evidence is exact.
    why_not : str
        The reason where it is withheld, else empty.
    bound : float
        Where it is withheld, what it is at most: the highest log likelihood, since the evidence is its mean over the prior. Nats.
    """

    value: float | None
    se: float | None
    efficiency: float | None
    pareto_k: float | None
    why_not: str = ""
    bound: float = np.inf


def importance_evidence(fitted: FittedProposal) -> Evidence:
    """Log evidence and its standard error by importance sampling from the fitted proposal.

    The estimate is the log mean weight of independent draws; its standard error is that of the mean, relative to it.
    Withheld, with a reason, where the weights' Pareto k-hat says that neither can be trusted.

    Raises
    ------
    ValueError
        If the draws had a say in the choice of the proposal: the estimate would be biased.
    """
    if not fitted.independent:
        raise ValueError("these draws helped to choose the proposal: use bayes_toe.inference.adaptation.with_fresh_draws first")
    quality = fitted.efficiency, fitted.pareto_k
    if not fitted.trusted:
        reason = f"importance weights are unreliable (Pareto k-hat {fitted.pareto_k:.2f}, efficiency {fitted.efficiency:.3f})"
        return Evidence(None, None, *quality, f"evidence withheld: {reason}", _highest_log_likelihood(fitted))
    n = len(fitted.draws.log_weights)
    value = float(logsumexp(fitted.draws.log_weights) - np.log(n))
    return Evidence(value, float(np.sqrt((1.0 / fitted.efficiency - 1.0) / n)), *quality)


def _highest_log_likelihood(fitted: FittedProposal) -> float:
    """By climbing from the best of the draws."""
    target, draws = fitted.proposal.posterior, fitted.draws
    best = np.argmax(draws.log_posterior - draws.log_prior)
    return -float(minimize(lambda x: -float(target.log_likelihood(x[None])[0]), draws.x[best], method="Nelder-Mead").fun)


def weighed(values: Iterable[float | None], bounds: Iterable[float]) -> FloatArray:
    """Log evidences of rival models of one subject, shape (models,): -inf where a withheld one has no weight even by its bound, else NaN.

    No weight: all of them together have a probability below :data:`NO_WEIGHT`, at equal prior probabilities.

    Examples
    --------
    >>> weighed([-300.0, None], [np.inf, -500.0]).tolist(), weighed([-300.0, None], [np.inf, -299.0]).tolist()
    ([-300.0, -inf], [-300.0, nan])
    """
    found, most = np.array([*values], np.float64), np.array([*bounds], np.float64)  # None becomes NaN
    missing = np.isnan(found)
    if missing.any() and not missing.all():
        share = logsumexp(most[missing]) - logsumexp(found[~missing])
        found[missing] = -np.inf if share < np.log(NO_WEIGHT) else np.nan
    return found


def said_of_bound(bound: float, known: FloatArray) -> str:
    """What is said of a model without weight: its bound, and its probability by that against rivals of these log evidences."""
    digits = np.ceil((bound - logsumexp(known)) / np.log(10.0))
    return f"its log evidence is at most {bound:.1f}, the highest log likelihood, and so its probability 0 (at most 1e{digits:.0f})"


def exact_evidence(target: Conjugate) -> Evidence:
    """The evidence of a posterior in closed form."""
    return Evidence(target.log_evidence, 0.0, None, None)
