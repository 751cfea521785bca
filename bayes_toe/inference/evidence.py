"""Log evidence of one subject under one model, by importance sampling."""

from __future__ import annotations

from dataclasses import dataclass

from bayes_toe.inference.diagnostics import pareto_k
from bayes_toe.inference.fitted import is_trusted
from bayes_toe.inference.mixture import WeightedDraws


@dataclass(frozen=True)
class Evidence:
    """Log evidence in nats, without binomial coefficients.

    Value and standard error are None where it is withheld.
    """

    value: float | None
    se: float | None
    # Of the importance weights.
    efficiency: float
    pareto_k: float
    why_not: str = ""  # the reason where it is withheld


def importance_evidence(draws: WeightedDraws) -> Evidence:
    """Log evidence and its standard error from draws that chose no mixture.

    The estimate is the log mean weight; its standard error is that of the mean, relative to it.
    Withheld, with a reason, where the weights' Pareto k says that neither can be trusted.
    """
    k, efficiency = pareto_k(draws.log_weights), draws.efficiency
    if not is_trusted(k, efficiency):
        reason = (
            "evidence withheld: importance weights are unreliable "
            f"(Pareto k-hat {k:.2f}, efficiency {efficiency:.3f})"
        )
        return Evidence(None, None, efficiency, k, reason)
    return Evidence(draws.log_evidence, draws.standard_error, efficiency, k)
