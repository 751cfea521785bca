"""A group on the screen, and its texts and tables for report.html and methods.md.

`print_group` prints the result of `population`. `group_answer` has the conclusions in sentences,
`group_tables` the tables of the report, and `group_estimate` one estimate with its interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.answers.order_effect import (
    Size,
    format_bayes_factor,
    format_difference,
    format_number,
    format_share,
    format_signed,
    word_of_bayes_factor,
)
from bayes_toe.answers.words import Word, claim
from bayes_toe.cli.terminal import Terminal
from bayes_toe.data.messages import capitalized, format_estimate, plural
from bayes_toe.inference.diagnostics import worst
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE, PEAK

if TYPE_CHECKING:
    from bayes_toe.data.stimulus_unit import StimulusUnit
    from bayes_toe.groups.population import PopulationResult
    from bayes_toe.groups.population_table import PopulationRow
    from bayes_toe.groups.predictive_check import PredictiveCheck

_EFFECTS = (CONSTANT_ERROR.name, CONTRACTION.name)
_QUANTITIES = (*_EFFECTS, NOISE.name)
#: Parameters between 0 and 1, or -1 and 1; the others are in the unit of differences.
_SHARES = (CONTRACTION.name, PEAK.name)
#: Names of the parameters of a group in sentences, as rows of its table, and of differences.
_LABELS = {CONSTANT_ERROR.name: "PSE shift", CONTRACTION.name: "contraction", NOISE.name: "JND"}
_ROW_LABELS = {
    **_LABELS,
    CONSTANT_ERROR.name: "constant error",
    PEAK.name: "largest P('equal')",
}
#: Rows of the group's table that have these parameters in the unit of screens.
_QUANTITY_OF = {
    CONSTANT_ERROR.name: "pse_shift_percent",
    NOISE.name: "jnd_percent",
    PEAK.name: "peak_probability",
}
_DIFFERENCE_LABELS = {**_LABELS, NOISE.name: "JND (ratio)", PEAK.name: "P(equal), logit"}


def print_group(out: Terminal, result: PopulationResult, check: PredictiveCheck) -> None:
    """The table of the group, its fit, a new subject, and what needs action."""
    rows = [_parameter_row(result, name) for name in _QUANTITIES]
    out.table(["", "mean", "SD between\nsubjects", "BF of mean\nnot 0", ""], rows)
    for title, headings, comparisons in _comparison_tables(result):
        out.table(headings, comparisons, title=title)
    out.line()
    new_subject = [
        f"{_LABELS[name]} {group_estimate(result, name, 'new_subject')}"
        for name in _QUANTITIES
        if name in result.identified
    ]
    out.line(f"New subject (prediction): {', '.join(new_subject)}.")
    (_, n_effective), (_, r_hat) = worst(result.draws.convergence)
    fit = "poor" if check.warnings else "good"
    out.line(f"Fit of the group: {fit}. Draws: {n_effective:,.0f} effective, R-hat {r_hat:.3f}.")
    print_problems(out, result, check.warnings)


def print_problems(out: Terminal, result: PopulationResult, contradictions: Sequence[str]) -> None:
    """Print what to know before any number of the group is used."""
    texts = (*result.problems, *contradictions)
    out.notes(("", capitalized(text), "") for text in texts)


def group_answer(result: PopulationResult) -> list[str]:
    """Mean, SD between subjects and Bayes factor of both effects; differences of conditions."""
    badge = "" if result.is_reliable else "NOT RELIABLE: "
    parts = []
    for name in _EFFECTS:
        if name not in result.identified:
            parts.append(f"the {_ROW_LABELS[name]} cannot be told.")
            continue
        estimate = f"the mean {_LABELS[name]} is {group_estimate(result, name)}"
        sd = _spread(result, name).partition(" [")[0]
        sizes = f"{estimate}, and the SD between subjects is {sd}."
        parts.append(f"{sizes} {_describe_mean(result, name)}")

    n_subjects = len(result.subjects)
    heading = f"In the group of {n_subjects}{_reference(result)}"
    first_effect, second_effect = parts
    lines = [f"{badge}{heading}, {first_effect} {capitalized(second_effect)}"]

    differences: dict[str, list[str]] = {}
    for level, label, difference, factor, word in _comparison_rows(result, "difference"):
        text = f"{label} {difference} ({word}, BF {factor})"
        differences.setdefault(level, []).append(text)
    for level, texts in differences.items():
        lines.append(f"{badge}Difference {level} in the group: {'; '.join(texts)}.")
    return lines


def good_fits_answer(group: PopulationResult, of_good_fits: PopulationResult | None) -> list[str]:
    """Words for the means that are others without the subjects whom the model does not fit."""
    changes = []
    for name in _EFFECTS:
        if of_good_fits is None or name not in group.identified:
            continue
        log_factor = log_factor_of_mean(of_good_fits, name)
        word = word_of_bayes_factor(log_factor)
        if word != word_of_bayes_factor(log_factor_of_mean(group, name)):
            changes.append(_differs_from_0(log_factor, f"the mean {_LABELS[name]}"))
    if not changes:
        return []
    return [f"Without the subjects whom the model does not fit, {' and '.join(changes)}."]


def _describe_mean(result: PopulationResult, name: str) -> str:
    """Whether a mean differs from 0; an interval that excludes 0 does not decide that."""
    [row] = result.table.select("mean", name)
    log_factor = _log_factor(row)
    text = f"{capitalized(_differs_from_0(log_factor, 'this mean'))}."
    if word_of_bayes_factor(log_factor) is Word.UNDECIDED and row.q025 * row.q975 > 0.0:
        text += " The interval assumes a nonzero mean."
    return text


def _differs_from_0(log_factor: float, noun: str) -> str:
    """Whether a mean differs from 0, with its Bayes factor."""
    text = claim(word_of_bayes_factor(log_factor), noun, "differ", "from 0")
    return f"{text} (BF {format_bayes_factor(log_factor)})"


def _parameter_row(result: PopulationResult, name: str) -> list[str]:
    """Mean, SD between subjects, Bayes factor and word of a parameter."""
    if name not in result.identified:
        return [_ROW_LABELS[name], "cannot be told: no subject has pairs that can show it"]
    cells = [_ROW_LABELS[name], group_estimate(result, name), _spread(result, name)]
    if name not in _EFFECTS:
        return [*cells, "-", ""]
    return [*cells, *_factor_and_word(log_factor_of_mean(result, name))]


def group_estimate(result: PopulationResult, name: str, quantity: str = "mean") -> str:
    """Median and 95 % interval of a mean, or of a new subject, in the unit of the table."""
    [row] = result.table.select(quantity, _QUANTITY_OF.get(name, name))
    size = Size(row.q025, row.q50, row.q975)
    if name in _SHARES:
        return format_share(size)
    text = format_difference(size, result.study.unit)
    return text if name == CONSTANT_ERROR.name else text.replace("+", "")


def log_factor_of_mean(result: PopulationResult, name: str) -> float:
    """The log Bayes factor of a mean that is not 0."""
    [row] = result.table.select("mean", name)
    return _log_factor(row)


def _log_factor(row: PopulationRow) -> float:
    return -(row.ln_bf_zero or 0.0)


def _factor_and_word(log_factor: float) -> tuple[str, str]:
    """The Bayes factor of a value that is not 0, and its word."""
    return format_bayes_factor(log_factor), str(word_of_bayes_factor(log_factor))


def _spread(result: PopulationResult, name: str) -> str:
    """The SD between subjects with its interval; one that may be 0 as a bound."""
    unit = result.study.unit
    quantiles = _spread_quantiles(result, name, unit)
    shown_unit = unit.for_percent(quantiles)
    if shown_unit != unit:
        quantiles = _spread_quantiles(result, name, shown_unit)
    low, median, high, bound = quantiles
    if name not in _EFFECTS or result.effect(name).sd_at_most is None:
        if name in _SHARES:
            return format_share(Size(low, median, high))
        text = format_signed(Size(low, median, high), shown_unit.of_differences)
        return text.replace("+", "")
    if name in _SHARES:
        return f"at most {100.0 * bound:.0f} %"
    return f"at most {format_number(bound)} {shown_unit.of_differences}"


def _spread_quantiles(result: PopulationResult, name: str, unit: StimulusUnit) -> list[float]:
    """The ends and the median of the SD between subjects, and its bound, in a unit."""
    j = result.index(name)
    mean, sd = result.draws.mean[..., j], result.draws.sd[..., j]
    # The SD is half the difference of subjects one SD above and one SD below the mean.
    above, below = (result.in_units(name, point, unit) for point in (mean + sd, mean - sd))
    with np.errstate(invalid="ignore"):
        spread = 0.5 * (above - below)
    return np.quantile(spread, [0.025, 0.5, 0.975, 0.95]).tolist()


def _format_difference(result: PopulationResult, row: PopulationRow) -> str:
    """An effect on a mean: a shift of the PSE, p, the ratio of JNDs, or a logit."""
    values = np.array([row.q025, row.q50, row.q975])
    if row.parameter == CONSTANT_ERROR.name:
        return format_difference(Size(*result.shift_percent(values).tolist()), result.study.unit)
    if row.parameter == CONTRACTION.name:
        return format_share(Size(*values.tolist()))
    sign = "+"
    if row.parameter == NOISE.name:
        values, sign = np.exp(values), ""
    return format_estimate(*map(f"{{:{sign}.2f}}".format, values))


def _comparison_tables(
    result: PopulationResult,
) -> list[tuple[str, list[str], list[list[str]]]]:
    """Title, headings and rows of the effects of covariates and of conditions, if any."""
    covariates = "; ".join(column.meaning for column in result.regressors.columns)
    tables = []
    for quantity, title, first in (
        ("difference", "Differences between conditions", "conditions"),
        ("effect", f"Effects of covariates ({covariates})", "covariate"),
    ):
        rows = _comparison_rows(result, quantity)
        if rows:
            tables.append((title, [first, "of the", "median [95 % interval]", "BF", ""], rows))
    return tables


def _comparison_rows(result: PopulationResult, quantity: str) -> list[list[str]]:
    """Rows with the comparison, the parameter, its difference, Bayes factor and word."""
    rows = []
    for row in result.table.select(quantity):
        if row.parameter in result.identified:
            difference = _format_difference(result, row)
            words = _factor_and_word(_log_factor(row))
            rows.append([row.level, _DIFFERENCE_LABELS[row.parameter], difference, *words])
    return rows


def group_tables(
    result: PopulationResult,
) -> list[tuple[str, list[str], list[list[str]]]]:
    """Title, headings and rows of the tables of the report, in the formats of the screen."""
    rows = []
    for name in result.names:
        cells = _parameter_row(result, name)
        if name not in result.identified:
            rows.append(cells)
            continue
        cells.insert(3, group_estimate(result, name, "new_subject"))
        rows.append([*cells, *_convergence(result, [name])])
    headings = ["", "group mean", "SD between subjects", "new subject", "BF of mean not 0", ""]
    headings += ["effective draws", "R-hat"]
    title = f"{plural(len(result.subjects), 'subject')}, median [95 % interval]"
    return [*_comparison_tables(result), (title, headings, rows)]


def _convergence(result: PopulationResult, names: Sequence[str]) -> tuple[str, str]:
    """The smallest number of effective draws of means and SDs, and the largest R-hat."""
    n_effective, r_hats = [], []
    for name in names:
        for row in (*result.table.select("mean", name), *result.table.select("sd", name)):
            n_effective += [row.ess_bulk, row.ess_tail]
            r_hats.append(row.r_hat)
    return f"{min(n_effective):,.0f}", f"{max(r_hats):.3f}"


def _reference(result: PopulationResult) -> str:
    """The covariates for which the means hold."""
    levels = {}
    for column in result.regressors.columns:
        levels[column.covariate] = f"{column.covariate} {column.reference or 'mean'}"
    return f" ({', '.join(levels.values())})" if levels else ""
