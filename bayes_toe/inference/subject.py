"""The analysis of one subject under one model.

`fit_subject` fits a mixture. From it `model_evidence` computes the evidence, and `subject_draws`
samples chains and makes the arrays that a file stores.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from bayes_toe.arrays import FloatArray, NamedArrays
from bayes_toe.inference.diagnostics import (
    Convergence,
    Errors,
    errors_of,
    worst,
)
from bayes_toe.inference.engine import SHARP
from bayes_toe.inference.fitted import (
    Evidence,
    Fitted,
    fit_posterior,
    importance_evidence,
)
from bayes_toe.inference.goodness_of_fit import GoodnessOfFit, summarise_fit
from bayes_toe.inference.sampling import SamplerSettings, sample_chains
from bayes_toe.model.posterior import SubjectPosterior, posterior_contraction
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.seeds import generator, require_seed

#: Independent draws behind the evidence of H1, unless more are asked for.
EVIDENCE_DRAWS = 4000
QUANTILES = {"q05": 0.05, "q25": 0.25, "q50": 0.5, "q75": 0.75, "q95": 0.95}
SUMMARY_COLUMNS = (
    "subject",
    "parameter",
    "mean",
    "sd",
    *QUANTILES,
    "ess_bulk",
    "ess_tail",
    "r_hat",
    "posterior_contraction",
    *map("mcse_{}".format, Errors._fields),
)
#: Numbers of the goodness of fit among the statistics.
FIT_COLUMNS = ("deviance", "degrees_of_freedom", "fit_p")

SummaryRow: TypeAlias = tuple[str | float, ...]


@dataclass(frozen=True)
class Settings:
    """Everything that decides the numbers, stored with the results.

    Random streams depend on the seed, the subject's name and the model's name.
    """

    seed: int
    prior: Prior = DEFAULT
    sampler: SamplerSettings = field(default_factory=SamplerSettings)
    model: str = ""

    def __post_init__(self) -> None:
        require_seed(self.seed)


def fit_subject(target: SubjectPosterior, seed: int, *, has_chains: bool = False) -> Fitted:
    """The mixture of one posterior; more draws judge it if chains follow, which begin with them."""
    rng = generator(seed, target.subject.name, target.model_name, "proposal")
    return fit_posterior(target, rng, judging_draws=SHARP.most_draws if has_chains else 4000)


def model_evidence(fitted: Fitted, seed: int, size: int) -> Evidence:
    """The evidence by `size` draws that chose no mixture.

    Where their weights cannot be trusted, up to two further mixtures are fitted, with more draws.
    """
    key = seed, fitted.target.subject.name, fitted.target.model_name
    evidence = importance_evidence(fitted.fresh(generator(*key, "evidence"), size))
    for attempt in range(2):
        if evidence.value is not None:  # it is not withheld
            break
        rng = generator(*key, f"further mixture {attempt}")
        fitted = fit_posterior(fitted.target, rng, judging_draws=20_000)
        evidence = importance_evidence(fitted.fresh(rng, max(20_000, size)))
    return evidence


# --- Draws for a file, and rows for a table -------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SubjectDraws:
    """Draws of one subject under one model, and the statistics of their quality.

    Attributes
    ----------
    quantities : dict of ndarray, shape (chains, draws)
        The natural quantities, from which all others follow, and "lp", the log posterior density of
        the unconstrained coordinates.
    acceptance : ndarray, shape (chains,)
    statistics : mapping
        Numbers by column: convergence, effort, quality of the proposal and of the fit.
    fit : GoodnessOfFit
    summary : tuple of tuple
        Rows with the columns of summary.csv; empty if no summary is asked for.
    """

    quantities: NamedArrays
    acceptance: FloatArray
    statistics: Mapping[str, float | int | str]
    fit: GoodnessOfFit
    summary: tuple[SummaryRow, ...]


def subject_draws(
    fitted: Fitted, settings: SamplerSettings, seed: int, *, summarised: bool = False
) -> SubjectDraws:
    """Chains from a fitted mixture, with or without rows of a summary."""
    target = fitted.target
    chains = sample_chains(fitted, settings, seed)
    fit = summarise_fit(target, chains.x.reshape(-1, chains.x.shape[-1]), fitted.maximum)
    quantities = target.quantities(chains.x)

    (_, ess), (_, r_hat) = worst(chains.diagnostics)
    statistics: dict[str, float | int | str] = {
        "converged": int(chains.converged),
        "shortfall": chains.reason,
        "imprecise": chains.imprecise,
        "min_ess": ess,
        "max_r_hat": r_hat,
        "thin": chains.thin,
        "steps": chains.steps,
        "proposal_efficiency": fitted.draws.efficiency,
        "pareto_k": fitted.pareto_k,
        **{column: getattr(fit, column) for column in FIT_COLUMNS},
    }

    if summarised:
        summary = summary_rows(target, quantities, chains.diagnostics)
    else:
        summary = ()

    stored = {name: quantities[name] for name in target.names.natural}
    stored["lp"] = chains.log_posterior
    return SubjectDraws(stored, chains.acceptance, statistics, fit, summary)


def summary_rows(
    target: SubjectPosterior, quantities: NamedArrays, diagnostics: Mapping[str, Convergence]
) -> tuple[SummaryRow, ...]:
    """Rows with the columns of summary.csv, from draws of each quantity, (chains, draws)."""
    reported = {name: quantities[name] for name in target.names.reported}
    errors = errors_of(reported)
    rows = []
    for name, draws in reported.items():
        quantiles = np.quantile(draws, list(QUANTILES.values())).tolist()
        # QUANTILES begin with that of 5 % and end with that of 95 %.
        contraction = posterior_contraction(target, name, low=quantiles[0], high=quantiles[-1])
        row = (  # in the order of SUMMARY_COLUMNS
            target.subject.name,
            name,
            draws.mean(),
            draws.std(ddof=1),
            *quantiles,
            *diagnostics[name],
            contraction,
            *errors[name],
        )
        rows.append(row)
    return tuple(rows)
