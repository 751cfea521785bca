"""population.csv, what is said of the population, a row for each quantity; population_subjects.csv, of every subject in the group."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from bayes_toe.arrays import FloatArray
from bayes_toe.data.tables import Table
from bayes_toe.groups.asymmetries import OVERALL
from bayes_toe.groups.chains import CORRELATION
from bayes_toe.groups.hyperprior import GROUP_PARAMETERS
from bayes_toe.groups.no_difference import Ratio, no_difference
from bayes_toe.inference.diagnostics import Convergence, convergence, convergence_of, errors_of
from bayes_toe.inference.subject import SUMMARY_COLUMNS, SummaryRow, location

if TYPE_CHECKING:
    from bayes_toe.groups.population import Population

_UNPOOLED = {"alone_q05": 0.05, "alone_q50": 0.5, "alone_q95": 0.95}
#: Those of summary.csv but the contraction, which is held against the prior of a single subject: that does not enter here.
SUBJECT_COLUMNS = (*(name for name in SUMMARY_COLUMNS if name != "contraction"), *_UNPOOLED)


class PopulationRow(NamedTuple):
    """One quantity of the population; the names are the columns of population.csv.

    Attributes
    ----------
    parameter : str
        A group parameter on its scale ('probit gamma'), two of them ('mu1, probit gamma'), a quantity of a subject, or a comparison.
    quantity : {"mean", "sd", "correlation", "effect", "asymmetry", "new_subject"}
    level : str
        The regressor of an effect, the part of the population of an asymmetry; empty for what has none.
    mean, sd, q05, q25, q50, q75, q95, ess_bulk, ess_tail, r_hat : float
    p_direction : float or None
        Probability that it has the sign that it probably has; of correlations, effects and asymmetries.
    bf_no_difference, bf_error, bf_below : float or None
        Of effects, see :class:`bayes_toe.groups.no_difference.Ratio`.
    """

    parameter: str
    quantity: str
    level: str
    mean: float
    sd: float
    q05: float
    q25: float
    q50: float
    q75: float
    q95: float
    ess_bulk: float
    ess_tail: float
    r_hat: float
    p_direction: float | None = None
    bf_no_difference: float | None = None
    bf_error: float | None = None
    bf_below: float | None = None


@dataclass(frozen=True, eq=False)
class PopulationTable(Table[PopulationRow]):
    """Everything that is said of a population."""

    def frame(self) -> pd.DataFrame:
        """One row per quantity, with the columns of population.csv."""
        return pd.DataFrame(self.rows, columns=list(PopulationRow._fields)).astype(dict.fromkeys(PopulationRow._fields[3:], float))

    def some(self, quantity: str, parameter: str | None = None) -> tuple[PopulationRow, ...]:
        """The rows of one kind, or of one kind and parameter."""
        return tuple(row for row in self.rows if row.quantity == quantity and parameter in (None, row.parameter))


def population_table(found: Population) -> PopulationTable:
    """All rows of a population."""
    kinds = (_means, _scatters, _correlations, _effects, _asymmetries, _further)
    return PopulationTable(tuple(row for rows in kinds for row in rows(found)))


def _means(found: Population) -> Iterator[PopulationRow]:
    """On the group scales, then natural quantities of a subject at the mean; what is its own scale is not said twice."""
    labels = _labels(found)
    for k, label in enumerate(labels):
        yield _row(label, "mean", "", found.chains.mean[..., k], found.chains.convergence["mean", -1, k])
    for name, values in found.quantities(found.chains.mean).items():
        if name not in labels:  # ranks of a group parameter are those of its quantity
            known = found.chains.convergence["mean", -1, found.names.index(name)] if name in found.names else None
            yield _row(name, "mean", "", values, known)


def _scatters(found: Population) -> Iterator[PopulationRow]:
    for k, label in enumerate(_labels(found)):
        yield _row(label, "sd", "", found.chains.scatter[..., k], found.chains.convergence["sd", -1, k])


def _correlations(found: Population) -> Iterator[PopulationRow]:
    """Between parameters of a subject, over subjects."""
    labels, correlation = _labels(found), found.chains.correlation
    for j, i in found.chains.correlated:
        values, judged = correlation[..., i, j], found.chains.convergence[CORRELATION, j, i]
        yield _directed(_row(f"{labels[j]}, {labels[i]}", CORRELATION, "", values, judged), values)


def _effects(found: Population) -> Iterator[PopulationRow]:
    ratios = no_difference(found) if found.regressors.columns else ()
    for i, column in enumerate(found.regressors.columns):
        for k, label in enumerate(_labels(found)):
            values, of_zero = found.chains.effects[..., i, k], ratios[i][k]
            yield _directed(_row(label, "effect", column.label, values, found.chains.convergence["effect", i, k]), values, of_zero)


def _asymmetries(found: Population) -> Iterator[PopulationRow]:
    every = found.asymmetries
    if every is None:
        return
    for j, comparison in enumerate(every.comparisons):
        for i, level in enumerate(every.levels):
            values = every.draws[:, :, i, j]
            yield _directed(_row(comparison, "asymmetry", level, values), values)


def _further(found: Population) -> Iterator[PopulationRow]:
    for name, values in found.quantities(found.new_subject()).items():
        yield _row(name, "new_subject", "", values)
    if found.asymmetries is not None:
        yield _row(OVERALL, "new_subject", "", found.asymmetries.new_subject)


def _row(parameter: str, quantity: str, level: str, values: FloatArray, known: Convergence | None = None) -> PopulationRow:
    diagnosed = convergence(values) if known is None else known
    mean, sd, q05, q25, q50, q75, q95 = location(values)
    return PopulationRow(parameter, quantity, level, mean, sd, q05, q25, q50, q75, q95, *diagnosed)


def _directed(row: PopulationRow, values: FloatArray, of_zero: Ratio | None = None) -> PopulationRow:
    p = max(float((values > 0.0).mean()), float((values < 0.0).mean()))
    value, error, below = (None, None, None) if of_zero is None else of_zero
    return row._replace(p_direction=p, bf_no_difference=value, bf_error=error, bf_below=below)


def _labels(found: Population) -> list[str]:
    return [GROUP_PARAMETERS[name].label for name in found.names]


# --- Subjects -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PooledSubjects(Table[SummaryRow]):
    """One row per subject and quantity, in the light of the others, with the quantiles of the same subject alone beside it."""

    def frame(self) -> pd.DataFrame:
        """With the columns of population_subjects.csv."""
        return pd.DataFrame(self.rows, columns=list(SUBJECT_COLUMNS))


def pooled_subjects(found: Population) -> PooledSubjects:
    """Of every subject in the group; who was left out is not in it."""
    return PooledSubjects(tuple(row for i in range(len(found.study)) for row in _subject_rows(found, i)))


def _subject_rows(found: Population, i: int) -> Iterator[SummaryRow]:
    name = found.study.names[i]
    pooled, unpooled = found.quantities(found.chains.eta[:, :, i]), found.quantities(found.unpooled[:, i])
    reported = {key: pooled[key] for key in found.posterior(name).names.reported}
    known = {key: Convergence(*row) for key, row in zip(found.names, found.chains.subject_convergence[i].tolist(), strict=True)}
    judged = known | convergence_of({key: values for key, values in reported.items() if key not in known})
    uncertain = errors_of(reported)
    for key, values in reported.items():
        own = np.quantile(unpooled[key], list(_UNPOOLED.values())).tolist()
        yield (name, key, *location(values), *judged[key], *uncertain[key], *own)
