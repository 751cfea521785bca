"""Log evidence of one subject under one model, with a standard error, or with the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayes_toe.inference.proposal import FittedProposal
from bayes_toe.model.target import Conjugate


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
    """

    value: float | None
    se: float | None
    efficiency: float | None
    pareto_k: float | None
    why_not: str = ""


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
        return Evidence(None, None, *quality, f"evidence withheld: {reason}")
    n = len(fitted.draws.log_weights)
    value = float(logsumexp(fitted.draws.log_weights) - np.log(n))
    return Evidence(value, float(np.sqrt((1.0 / fitted.efficiency - 1.0) / n)), *quality)


def exact_evidence(target: Conjugate) -> Evidence:
    """The evidence of a posterior in closed form."""
    return Evidence(target.log_evidence, 0.0, None, None)
