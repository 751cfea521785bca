"""What a file of draws keeps of one subject: plain arrays, numbers and texts, made where the chains are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TypeAlias

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.inference.diagnostics import Convergence, Errors, convergence_of, errors_of
from bayes_toe.inference.sampling import Chains
from bayes_toe.inference.subject import SubjectResult
from bayes_toe.model.intervals import reference_interval
from bayes_toe.model.target import Answering, contraction

QUANTILES = {"q05": 0.05, "q25": 0.25, "q50": 0.5, "q75": 0.75, "q95": 0.95}
_MCSE = tuple(f"mcse_{name}" for name in Errors._fields)
SUMMARY_COLUMNS = ("subject", "parameter", "mean", "sd", *QUANTILES, "ess_bulk", "ess_tail", "r_hat", "contraction", *_MCSE)
#: Where the goodness of fit is kept among the statistics.
FIT_COLUMNS = {
    "deviance": "deviance",
    "degrees_of_freedom": "degrees_of_freedom",
    "p_overall": "predictive_p",
    "p_overall_se": "predictive_p_se",
    "worst_p": "worst_pair_p",
    "worst_s1": "worst_pair_s1",
    "worst_s2": "worst_pair_s2",
    "worst_isi": "worst_pair_isi",
    "p_deviance": "deviance_p",
}
#: Names without a unit, with all that begin with q.
_WITHOUT_UNIT = ("gamma", "gain", "pull", "rho")

SummaryRow: TypeAlias = tuple[str | float, ...]


@dataclass(frozen=True, eq=False)
class SubjectDraws:
    """Draws of one subject under one model, and what is said of them.

    Attributes
    ----------
    subject : Subject
        The counts.
    quantities : mapping of str to array, shape (chains, draws)
        The natural ones, from which all others follow.
    units : mapping of str to str
    coordinates : tuple of str
        Of the unconstrained space in which `log_posterior` is a density.
    log_posterior : array, shape (chains, draws)
    acceptance : array, shape (chains,)
    statistics : mapping of str to number or str
        By column: convergence, effort, the proposal's quality and goodness of fit, as far as these are known.
    summary : tuple of tuple
        Rows with the columns of summary.csv; empty where not asked for.
    """

    subject: Subject
    quantities: Mapping[str, FloatArray]
    units: Mapping[str, str]
    coordinates: tuple[str, ...]
    log_posterior: FloatArray
    acceptance: FloatArray
    statistics: Mapping[str, float | int | str]
    summary: tuple[SummaryRow, ...]


def subject_draws(result: SubjectResult, *, summarised: bool = False) -> SubjectDraws:
    """What is kept of a result with chains, with or without rows of a summary.

    Raises
    ------
    InputError
        If it has none.
    """
    target, chains = result.target, chains_of(result)
    found = target.quantities(chains.x)
    natural = {name: found[name] for name in target.names.natural}
    return SubjectDraws(
        result.subject,
        natural,
        {name: unit(name, target) for name in natural},
        target.coordinates,
        chains.log_posterior,
        chains.acceptance,
        _statistics(result, chains),
        summary_rows(target, {name: found[name] for name in target.names.reported}, chains.diagnostics) if summarised else (),
    )


def chains_of(result: SubjectResult) -> Chains:
    """The chains of a result that must have them."""
    if result.chains is None:
        raise InputError(f"subject {result.subject.name!r} was analysed without sampling")
    return result.chains


def summary_rows(
    target: Answering, values: Mapping[str, FloatArray], known: Mapping[str, Convergence] | None = None
) -> tuple[SummaryRow, ...]:
    """Rows with the columns of summary.csv from values of shape (chains, draws), of some of which convergence is known."""
    judged = {} if known is None else dict(known)
    unknown = {name: draws for name, draws in values.items() if name not in judged}
    judged |= convergence_of(unknown) if unknown else {}
    uncertain, rows = errors_of(values), list[SummaryRow]()
    for name, draws in values.items():
        located = location(draws)
        narrowed = contraction(target, name, located[2], located[-1])
        rows.append((target.subject.name, name, *located, *judged[name], narrowed, *uncertain[name]))
    return tuple(rows)


def location(values: FloatArray) -> tuple[float, ...]:
    """Mean, sd and :data:`QUANTILES` of draws, shape (chains, draws)."""
    return (float(values.mean()), float(values.std(ddof=1)), *np.quantile(values, list(QUANTILES.values())).tolist())


def unit(name: str, target: Answering) -> str:
    """The unit of a quantity; at the reference interval where an interval acts on it."""
    plain = "1" if name in _WITHOUT_UNIT or name.startswith("q") else "ln intensity"
    reference = reference_interval(target.subject, target.prior.reference_interval)
    return plain if target.subject.isi is None else target.model.units_at_intervals(reference).get(name, plain)


def _statistics(result: SubjectResult, chains: Chains) -> dict[str, float | int | str]:
    fit = {} if result.fit is None else {FIT_COLUMNS[key]: value for key, value in asdict(result.fit).items() if key in FIT_COLUMNS}
    return {
        "converged": int(chains.converged),
        "shortfall": chains.reason,
        "imprecise": chains.imprecise,
        "min_ess": chains.least_ess,
        "max_r_hat": chains.largest_r_hat,
        "thin": chains.thin,
        "steps": chains.steps,
        "proposal_efficiency": result.efficiency,
        "pareto_k": result.pareto_k,
        **{column: value for column, value in fit.items() if value is not None},
    }
