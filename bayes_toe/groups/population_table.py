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
    return PopulationTable((*_hyperparameters(found), *_asymmetries(found), *_further(found)))


def _hyperparameters(found: Population) -> Iterator[PopulationRow]:
    """Means on the group scales and natural quantities of a subject at them; scatters; correlations; effects, each with a Bayes factor."""
    labels, own = [GROUP_PARAMETERS[name].label for name in found.names], found.chains
    for k, label in enumerate(labels):
        yield _row(label, "mean", "", own.mean[..., k], own.convergence["mean", -1, k])
    for name, values in found.quantities(own.mean).items():
        if name not in labels:  # what is its own scale is not said twice; ranks of a group parameter are those of its quantity
            yield _row(name, "mean", "", values, own.convergence["mean", -1, found.names.index(name)] if name in found.names else None)
    for k, label in enumerate(labels):
        yield _row(label, "sd", "", own.scatter[..., k], own.convergence["sd", -1, k])
    for j, i in own.correlated:
        values, judged = own.correlation[..., i, j], own.convergence[CORRELATION, j, i]
        yield _directed(_row(f"{labels[j]}, {labels[i]}", CORRELATION, "", values, judged), values)
    ratios = no_difference(found) if found.regressors.columns else ()
    for i, column in enumerate(found.regressors.columns):
        for k, label in enumerate(labels):
            values, judged = own.effects[..., i, k], own.convergence["effect", i, k]
            yield _directed(_row(label, "effect", column.label, values, judged), values, ratios[i][k])


def _asymmetries(found: Population) -> Iterator[PopulationRow]:
    every = found.asymmetries
    if every is not None:
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
    mean, sd, q05, q25, q50, q75, q95 = location(values)
    judged = convergence(values) if known is None else known
    return PopulationRow(parameter, quantity, level, mean, sd, q05, q25, q50, q75, q95, *judged)


def _directed(row: PopulationRow, values: FloatArray, of_zero: Ratio | None = None) -> PopulationRow:
    p = max(float((values > 0.0).mean()), float((values < 0.0).mean()))
    row = row._replace(p_direction=p)
    return row if of_zero is None else row._replace(bf_no_difference=of_zero.value, bf_error=of_zero.error, bf_below=of_zero.below)


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
