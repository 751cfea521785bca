"""population.csv, what is said of the population, a row for each quantity; population_subjects.csv, of every subject in the group."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtr, ndtri

from bayes_toe.arrays import FloatArray
from bayes_toe.data.tables import Table
from bayes_toe.groups.chains import CORRELATION
from bayes_toe.groups.hyperprior import GROUP_PARAMETERS
from bayes_toe.groups.joint import scatter_named
from bayes_toe.groups.savage_dickey import ORDER_EFFECTS, AtZero, Ratio, Ratios, savage_dickey
from bayes_toe.inference.diagnostics import Convergence, convergence, convergence_of, errors_of
from bayes_toe.inference.prediction import effect_size
from bayes_toe.inference.subject import SUMMARY_COLUMNS, SummaryRow, location
from bayes_toe.model.contrasted import OF_ORDER, QUANTITIES
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    from bayes_toe.groups.chains import GroupChains
    from bayes_toe.groups.differences import Differences
    from bayes_toe.groups.population import Population

_UNPOOLED = {"alone_q05": 0.05, "alone_q50": 0.5, "alone_q95": 0.95}
#: Those of summary.csv but the contraction, which is held against the prior of a single subject: that does not enter here.
SUBJECT_COLUMNS = (*(name for name in SUMMARY_COLUMNS if name != "contraction"), *_UNPOOLED)


#: What the rows of the Bayes factor of both means together are of.
ORDER_EFFECT = "order effect"
_SCORES = 64


class PopulationRow(NamedTuple):
    """One quantity of the population; the names are the columns of population.csv.

    Attributes
    ----------
    parameter : str
        A group parameter on its scale ('probit gamma'), two of them ('mu1, probit gamma'), a quantity of a subject, a comparison, or
        'order effect', of which the mean is the size at the mean of the population, the sd that of one sd of pull and constant error
        from there, in just noticeable differences.
    quantity : {"mean", "sd", "correlation", "effect", "condition_effect", "condition_sd", "new_subject"}
    level : str
        The regressor of an effect, the comparison of conditions; empty for what has none.
    mean, sd, q05, q25, q50, q75, q95, ess_bulk, ess_tail, r_hat : float
    p_direction : float or None
        Probability that it has the sign that it probably has; of correlations and effects.
    bf_zero : float or None
        Of means that may be none, of pull and constant error each and of both together: Bayes factor of none against any. The order
        effect has none where the model's pull cannot be none.
    bf_no_difference : float or None
        Of effects, and of what differs by condition: of no difference, of conditions between any levels, against a difference.
    bf_error, bf_below : float or None
        Of either, see :class:`bayes_toe.groups.savage_dickey.Ratio`.
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
    bf_zero: float | None = None
    bf_no_difference: float | None = None
    bf_error: float | None = None
    bf_below: float | None = None

    @property
    def log_bf_differs(self) -> float | None:
        """Natural log of the Bayes factor of a difference against none; where only a bound is known, the least that it can be."""
        if (self.bf_no_difference, self.bf_below) == (None, None):
            return None
        none = (
            min(self.bf_below or 0.0, 1.0)
            if self.bf_no_difference is None
            else self.bf_no_difference
        )
        return -math.log(none) if none > 0.0 else math.inf

    @property
    def of_none(self) -> str:
        """The Bayes factor of 0, of a mean or an effect, or a bound that says something, in words; else a dash."""
        value = self.bf_no_difference if self.bf_zero is None else self.bf_zero
        if value is not None:
            return f"{value:.2g}"
        return "-" if self.bf_below is None or self.bf_below >= 1.0 else f"< {self.bf_below:.2g}"


@dataclass(frozen=True, eq=False)
class PopulationTable(Table[PopulationRow]):
    """Everything that is said of a population."""

    def frame(self) -> pd.DataFrame:
        """One row per quantity, with the columns of population.csv."""
        return pd.DataFrame(self.rows, columns=list(PopulationRow._fields)).astype(
            dict.fromkeys(PopulationRow._fields[3:], float)
        )

    def some(self, quantity: str, parameter: str | None = None) -> tuple[PopulationRow, ...]:
        """The rows of one kind, or of one kind and parameter."""
        return tuple(
            row
            for row in self.rows
            if row.quantity == quantity and parameter in (None, row.parameter)
        )


def population_table(found: Population) -> PopulationTable:
    """All rows of a population."""
    rows = [*_hyperparameters(found)]
    rows += [
        _row(name, "new_subject", values)
        for name, values in found.quantities(found.new_subject()).items()
    ]
    return PopulationTable(tuple(rows))


def _hyperparameters(found: Population) -> Iterator[PopulationRow]:
    """Means, scatters, correlations, effects; some with a Bayes factor."""
    labels, own, ratios = (
        [GROUP_PARAMETERS[name].label for name in found.names],
        found.chains,
        savage_dickey(found),
    )
    yield from _means(found, labels, ratios)
    for k, label in enumerate(labels):
        yield _row(label, "sd", own.scatter[..., k], own.convergence["sd", -1, k])
    if "gain" in found.names:
        yield from _scatters(found)
    for j, i in own.correlated:
        known = own.convergence[CORRELATION, j, i]
        yield _row(
            f"{labels[j]}, {labels[i]}",
            CORRELATION,
            own.correlation[..., i, j],
            known,
            directed=True,
        )
    for i, column in enumerate(found.regressors.columns):
        for k, label in enumerate(labels):
            values, known = own.effects[..., i, k], own.convergence["effect", i, k]
            yield _row(
                label,
                "effect",
                values,
                known,
                level=column.label,
                directed=True,
                ratio=ratios.effects[i][k],
            )
    if found.differences is not None:
        yield from _by_condition(found, found.differences)


def _means(found: Population, labels: Sequence[str], ratios: Ratios) -> Iterator[PopulationRow]:
    """On the group scales, and natural quantities of a subject at these; those that may be none have a Bayes factor."""
    own = found.chains
    if ratios.means:
        yield _row(ORDER_EFFECT, "mean", _sizes(found, own.mean), ratio=ratios.joint)
    natural = found.quantities(own.mean)
    same = [
        name for name in found.names if GROUP_PARAMETERS[name].scale == "identity"
    ]  # what is its own scale is not said twice
    values = dict(zip(labels, np.moveaxis(own.mean, -1, 0), strict=True)) | {
        key: natural[key] for key in natural if key not in same
    }
    judged = {
        key: own.convergence["mean", -1, k]
        for k, pair in enumerate(zip(labels, found.names, strict=True))
        for key in pair
    }
    of_zero = {ORDER_EFFECTS[name]: ratio for name, ratio in ratios.means.items()}
    for name, drawn in values.items():  # ranks of a group parameter are those of its quantity
        yield _row(
            name, "mean", drawn, judged.get(name), directed=name in of_zero, ratio=of_zero.get(name)
        )


def _by_condition(found: Population, apart: Differences) -> Iterator[PopulationRow]:
    """Of every comparison: means of differences on the group scales, of natural quantities over the subjects, and scatters."""
    own, given = (
        apart.drawn,
        apart.numbers(found.settings.hyperprior.numbers(()), found.settings.prior.at(*found.study)),
    )
    rng = generator(found.settings.seed, "population", "no difference between conditions")
    at_zero = AtZero(own, given, np.empty((len(found.study), 0)), found.settings.scatter, rng)
    ratios, means = {name: at_zero(some) for name, some in apart.places.items()}, apart.on_average()
    order = [
        i
        for name, some in apart.places.items()
        if any(name in QUANTITIES[key] for key in OF_ORDER)
        for i in some
    ]
    of_order = at_zero(order) if order else None
    for i, pair in enumerate(apart.conditions.comparisons):
        effect, between = (
            partial(_row, quantity="condition_effect", level=" - ".join(pair)),
            apart.between(*pair),
        )
        steps = [apart.at(one, found.names) for one in pair]
        if of_order is not None:
            yield effect(ORDER_EFFECT, values=_order_change(found, own, steps), ratio=of_order)
        natural = [found.quantities(found.chains.eta + own.eta @ step) for step in steps]
        for name, some in apart.places.items():
            label = GROUP_PARAMETERS[name].label
            yield effect(label, values=means[name][..., i], directed=True, ratio=ratios[name])
            if GROUP_PARAMETERS[name].scale != "identity":
                key = {"gain": "pull", "gamma": "pull"}.get(name, name)
                yield effect(
                    key, values=(natural[0][key] - natural[1][key]).mean(axis=-1), directed=True
                )
            yield _row(
                label,
                "condition_sd",
                np.sqrt(np.square(own.scatter[..., some]) @ np.square(between[some])),
                level=" - ".join(pair),
            )


def _order_change(found: Population, own: GroupChains, at: Sequence[FloatArray]) -> FloatArray:
    """Root mean square, over the first stimuli shown, of how the shift of a typical subject changes, in just noticeable differences."""
    one, other = (found.quantities(found.chains.mean + own.mean @ step) for step in at)
    shown = found.typical.subject
    spread = np.average(np.square(shown.s1 - found.centre), weights=shown.n_trials)
    offset, pull = (
        one[key] - other[key] if key in one else np.zeros(1) for key in ("offset", "pull")
    )
    return np.asarray(
        np.sqrt(np.square(offset) + np.square(pull) * spread)
        / found.quantities(found.chains.mean)["jnd"]
    )


def _sizes(found: Population, eta: FloatArray) -> FloatArray:
    """Of the order effect of subjects with parameters eta, (..., k) -> (...), in just noticeable differences."""
    x, _ = found.typical.from_group(eta.reshape(-1, eta.shape[-1]))
    return effect_size(found.typical, x).reshape(eta.shape[:-1])


def _scatters(found: Population) -> Iterator[PopulationRow]:
    """Of the pull 1 - gain = 1 - 2 Phi(m + tau u), over midpoints of the quantiles u of the scatter, and the size of what is not shared."""
    own, scatter = found.chains, scatter_named(found.settings.scatter)
    u = scatter.quantile((np.arange(_SCORES) + 0.5) / _SCORES)
    place, offset, away = found.names.index("gain"), found.names.index("offset"), own.mean.copy()
    pull = 2.0 * ndtr(own.mean[..., place, None] + own.scatter[..., place, None] * u).std(axis=-1)
    yield _row(ORDER_EFFECTS["gain"], "sd", pull)
    away[..., place], away[..., offset] = (
        ndtri(0.5 - 0.5 * pull),
        scatter.sd * own.scatter[..., offset],
    )
    yield _row(ORDER_EFFECT, "sd", _sizes(found, away))


def _row(
    parameter: str,
    quantity: str,
    values: FloatArray,
    known: Convergence | None = None,
    *,
    level: str = "",
    directed: bool = False,
    ratio: Ratio | None = None,
) -> PopulationRow:
    """Of draws, (chains, draws); a mean's ratio is that of none, any other's that of no difference."""
    mean, sd, q05, q25, q50, q75, q95 = location(values)
    judged = convergence(values) if known is None else known
    row = PopulationRow(parameter, quantity, level, mean, sd, q05, q25, q50, q75, q95, *judged)
    if directed:
        row = row._replace(
            p_direction=max(float((values > 0.0).mean()), float((values < 0.0).mean()))
        )
    if ratio is None:
        return row
    row = row._replace(bf_error=ratio.error, bf_below=ratio.below)
    return (
        row._replace(bf_zero=ratio.value)
        if quantity == "mean"
        else row._replace(bf_no_difference=ratio.value)
    )


# --- Subjects -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PooledSubjects(Table[SummaryRow]):
    """One row per subject and quantity, in the light of the others, with the quantiles of the same subject alone beside it."""

    def frame(self) -> pd.DataFrame:
        """With the columns of population_subjects.csv."""
        return pd.DataFrame(self.rows, columns=list(SUBJECT_COLUMNS))


def pooled_subjects(found: Population) -> PooledSubjects:
    """Of every subject in the group; who was left out is not in it."""
    return PooledSubjects(
        tuple(row for i in range(len(found.study)) for row in _subject_rows(found, i))
    )


def _subject_rows(found: Population, i: int) -> Iterator[SummaryRow]:
    name = found.study.names[i]
    pooled, unpooled = (
        found.quantities(found.chains.eta[:, :, i]),
        found.quantities(found.unpooled[:, i]),
    )
    reported = {key: pooled[key] for key in found.posterior(name).names.reported}
    known = {
        key: Convergence(*row)
        for key, row in zip(found.names, found.chains.subject_convergence[i].tolist(), strict=True)
    }
    judged = known | convergence_of(
        {key: values for key, values in reported.items() if key not in known}
    )
    uncertain = errors_of(reported)
    for key, values in reported.items():
        own = np.quantile(unpooled[key], list(_UNPOOLED.values())).tolist()
        yield (name, key, *location(values), *judged[key], *uncertain[key], *own)
