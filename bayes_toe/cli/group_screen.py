"""The screen of a group: its table, fit, a new subject, and the sentences of its answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import expit

from bayes_toe.answers.order_effect import (
    Size,
    format_bayes_factor,
    format_decimals,
    format_number,
    format_percent,
    format_share,
    word_of_bayes_factor,
)
from bayes_toe.arrays import FloatArray
from bayes_toe.cli.terminal import Terminal
from bayes_toe.data.messages import capitalized, counted
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE, PEAK

if TYPE_CHECKING:
    from bayes_toe.groups.population import PopulationResult
    from bayes_toe.groups.population_table import PopulationRow
    from bayes_toe.groups.predictive_check import PredictiveCheck

_EFFECTS = (CONSTANT_ERROR.name, CONTRACTION.name)
_SHOWN = (*_EFFECTS, NOISE.name)
#: Parameters between 0 and 1, or -1 and 1; the others are in per cent of intensity.
_SHARES = (CONTRACTION.name, PEAK.name)
#: Names of the parameters of a group in sentences, as rows of its table, and of differences.
_LABELS = {CONSTANT_ERROR.name: "PSE shift", CONTRACTION.name: "contraction p", NOISE.name: "JND"}
_ROW_LABELS = {
    **_LABELS,
    CONSTANT_ERROR.name: "constant error",
    PEAK.name: "largest P('equal')",
}
_DIFFERENCE_LABELS = {**_LABELS, NOISE.name: "JND (ratio)", PEAK.name: "P(equal), logit"}


def print_group(out: Terminal, result: PopulationResult, check: PredictiveCheck) -> None:
    """The table of the group, its fit, a new subject, and what needs action."""
    rows = [_parameter_row(result, name) for name in _SHOWN]
    out.table(["", "mean", "SD between\nsubjects", "BF of mean\nnot 0", ""], rows)
    for title, headings, others in _comparison_tables(result):
        out.table(headings, others, title=title)
    out.line()
    new_subject = [
        f"{_LABELS[name]} {_new_subject(result, name)}"
        for name in _SHOWN
        if name in result.identified
    ]
    out.line(f"New subject (prediction): {', '.join(new_subject)}.")
    n_effective, r_hat = _convergence(result, result.names)
    fit = "poor" if check.warnings else "good"
    out.line(f"Fit of the group: {fit}. Draws: {n_effective} effective, R-hat {r_hat}.")
    out.notes(("", note, "") for note in result.regressors.notes)
    print_problems(out, result, check.warnings)


def print_problems(out: Terminal, result: PopulationResult, contradictions: Sequence[str]) -> None:
    """What to know before any number of the group is used."""
    texts = (*result.problems, *contradictions)
    out.notes(("", capitalized(text), "") for text in texts)


def group_answer(result: PopulationResult) -> list[str]:
    """Mean, SD between subjects and Bayes factor of both effects; differences of conditions."""
    badge = "" if result.is_reliable else "NOT RELIABLE: "
    parts = []
    for name in _EFFECTS:
        if name not in result.identified:
            parts.append(f"{_ROW_LABELS[name].removesuffix(' p')} cannot be told")
            continue
        mean, spread = _parameter_cells(result, name)
        factor = _describe_factor(result.effect(name).zero_mean.log_bf)
        sd = spread.partition(" [")[0]
        parts.append(f"mean {_LABELS[name]} {mean}, SD {sd}, differs from 0: {factor}")
    n_subjects = len(result.subjects)
    lines = [f"{badge}Group of {n_subjects}{_reference(result)}: {'; '.join(parts)}."]
    for levels in result.comparisons:
        level = " - ".join(levels)
        parts = []
        for row in result.table.select("difference"):
            if row.level == level and row.parameter in result.identified:
                label = _DIFFERENCE_LABELS[row.parameter]
                difference = _format_difference(result, row.parameter, row)
                factor = _describe_factor(row.ln_bf_zero)
                parts.append(f"{label} {difference}, differs from 0: {factor}")
        lines.append(f"{badge}Difference {level} in the group: {'; '.join(parts)}.")
    return lines


def _describe_factor(log_bf_zero: float | None) -> str:
    """The Bayes factor of a value that is not 0, with its word."""
    log_factor = -(log_bf_zero or 0.0)
    word = word_of_bayes_factor(log_factor).value
    return f"{word} (BF {format_bayes_factor(log_factor)})"


def _parameter_row(result: PopulationResult, name: str) -> list[str]:
    """Mean, SD between subjects, Bayes factor and word of a parameter."""
    if name not in result.identified:
        return [_ROW_LABELS[name], "cannot be told: no subject has pairs that can show it"]
    mean, spread = _parameter_cells(result, name)
    if name not in _EFFECTS:
        return [_ROW_LABELS[name], mean, spread, "-", ""]
    log_factor = -result.effect(name).zero_mean.log_bf
    word = word_of_bayes_factor(log_factor).value
    return [_ROW_LABELS[name], mean, spread, format_bayes_factor(log_factor), str(word)]


def _parameter_cells(result: PopulationResult, name: str) -> tuple[str, str]:
    """Mean and SD between subjects with their intervals; an SD that may be 0 as a bound."""
    j = result.index(name)
    mean, sd = result.draws.mean[..., j], result.draws.sd[..., j]
    # The SD is half the difference of subjects one SD above and one SD below the mean.
    above, below = _in_unit(result, name, mean + sd), _in_unit(result, name, mean - sd)
    with np.errstate(invalid="ignore"):
        spread = 0.5 * (above - below)
    mean_text = _format_quantity(name, *_quantiles(_in_unit(result, name, mean)))
    at_most = result.effect(name).sd_at_most if name in _EFFECTS else None
    if at_most is not None:
        bound = float(np.quantile(spread, 0.95))
        limit = format_decimals(bound) if name in _SHARES else f"{format_number(bound)} %"
        return mean_text, f"at most {limit}"
    return mean_text, _format_spread(name, *_quantiles(spread))


def _in_unit(result: PopulationResult, name: str, values: FloatArray) -> FloatArray:
    """Values of a parameter in the unit of the table: per cent, p, or a probability."""
    if name == CONSTANT_ERROR.name:
        return result.shift_percent(values)
    if name == NOISE.name:
        return result.jnd_percent(values)
    if name == PEAK.name:
        return np.asarray(expit(values))
    return values


def _new_subject(result: PopulationResult, name: str) -> str:
    """Median and 95 % interval of a further subject."""
    values = result.new_subject[..., result.index(name)]
    return _format_quantity(name, *_quantiles(_in_unit(result, name, values)))


def _quantiles(values: FloatArray) -> tuple[float, float, float]:
    low, median, high = np.quantile(values, [0.025, 0.5, 0.975]).tolist()
    return low, median, high


def _format_quantity(name: str, low: float, median: float, high: float) -> str:
    """A mean in its unit: PSE shifts have a sign."""
    size = Size(low, median, high)
    if name in _SHARES:
        return format_share(size)
    text = format_percent(size)
    return text if name == CONSTANT_ERROR.name else text.replace("+", "")


def _format_spread(name: str, low: float, median: float, high: float) -> str:
    """An SD between subjects in the unit of its parameter."""
    size = Size(low, median, high)
    return format_share(size) if name in _SHARES else format_percent(size).replace("+", "")


def _format_difference(result: PopulationResult, name: str, row: PopulationRow) -> str:
    """An effect on a mean: per cent of the PSE, p, or the ratio of JNDs."""
    values = np.array([row.q025, row.q50, row.q975])
    if name == CONTRACTION.name:
        return format_share(Size(*values.tolist()))
    if name == CONSTANT_ERROR.name:
        return format_percent(Size(*result.shift_percent(values).tolist()))
    if name == NOISE.name:
        low, median, high = np.exp(values).tolist()
        return f"{median:.2f} [{low:.2f}, {high:.2f}]"
    low, median, high = values.tolist()
    return f"{median:+.2f} [{low:+.2f}, {high:+.2f}]"


def _comparison_tables(
    result: PopulationResult,
) -> list[tuple[str, list[str], list[list[str]]]]:
    """Title, headings and rows of the effects of covariates and of conditions, if any."""
    tables = []
    for quantity, title, first in (
        ("difference", "Differences between conditions", "conditions"),
        ("effect", f"Effects of covariates ({_covariates(result)})", "covariate"),
    ):
        rows = []
        for row in result.table.select(quantity):
            if row.parameter not in result.identified:
                continue
            log_factor = -(row.ln_bf_zero or 0.0)
            effect = _format_difference(result, row.parameter, row)
            factor = format_bayes_factor(log_factor)
            word = str(word_of_bayes_factor(log_factor).value)
            rows.append([row.level, _DIFFERENCE_LABELS[row.parameter], effect, factor, word])
        if rows:
            tables.append((title, [first, "of the", "median [95 % interval]", "BF", ""], rows))
    return tables


def _covariates(result: PopulationResult) -> str:
    """What the covariates are."""
    return "; ".join(column.about for column in result.regressors.columns)


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
        cells.insert(3, _new_subject(result, name))
        rows.append([*cells, *_convergence(result, [name])])
    headings = ["", "group mean", "SD between subjects", "new subject", "BF of mean not 0", ""]
    headings += ["effective draws", "R-hat"]
    title = f"{counted(len(result.subjects), 'subject')}, median [95 % interval]"
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
    columns = result.regressors.columns
    levels = {column.covariate: column.reference or "mean" for column in columns}
    if not levels:
        return ""
    return f" ({', '.join(f'{name} {level}' for name, level in levels.items())})"
