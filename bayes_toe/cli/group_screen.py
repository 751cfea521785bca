"""The screen of a group: its table, fit, a new subject, and the sentences of its answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

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
from bayes_toe.checks.identification import identify
from bayes_toe.cli.terminal import Terminal
from bayes_toe.data.messages import capitalized, counted
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE, PEAK

if TYPE_CHECKING:
    from bayes_toe.groups.population import PopulationResult
    from bayes_toe.groups.population_table import PopulationRow
    from bayes_toe.groups.predictive_check import PredictiveCheck

_SHOWN = (CONSTANT_ERROR.name, CONTRACTION.name, NOISE.name)
#: Names of the parameters of a group in sentences, as rows of its table, and of differences.
_LABELS = {CONSTANT_ERROR.name: "PSE shift", CONTRACTION.name: "contraction p", NOISE.name: "JND"}
_ROW_LABELS = {**_LABELS, CONSTANT_ERROR.name: "constant error"}
_DIFFERENCE_LABELS = {**_LABELS, NOISE.name: "JND (ratio)", PEAK.name: "P(equal), logit"}


def print_group(out: Terminal, result: PopulationResult, check: PredictiveCheck) -> None:
    """The table of the group, its fit, a new subject, and what needs action."""
    rows = [_parameter_row(result, name) for name in _SHOWN]
    out.table(["", "mean", "SD between\nsubjects", "BF of mean\nnot 0", ""], rows)
    for title, headings, others in _comparison_tables(result):
        out.table(headings, others, title=title)
    out.line()
    new_subject = [
        f"{_LABELS[name]} {_format_quantity(name, *_quantiles(values))}"
        for name, values in _new_subject(result).items()
    ]
    out.line(f"New subject (prediction): {', '.join(new_subject)}.")
    rows_of_group = [result.table.select(quantity, name) for quantity in ("mean", "sd") for name in result.names]  # fmt: skip
    n_effective = min(min(row.ess_bulk, row.ess_tail) for [row] in rows_of_group)
    r_hat = max(row.r_hat for [row] in rows_of_group)
    fit = "poor" if check.warnings else "good"
    out.line(f"Fit of the group: {fit}. Draws: {n_effective:,.0f} effective, R-hat {r_hat:.3f}.")
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
    for name in (CONSTANT_ERROR.name, CONTRACTION.name):
        if name == CONTRACTION.name and not _has_contraction(result):
            parts.append("contraction cannot be told")
            continue
        mean, spread = _parameter_cells(result, name)
        equals = "" if name == CONSTANT_ERROR.name else " ="
        factor = _describe_factor(result.effect(name).zero_mean.log_bf)
        parts.append(f"{_LABELS[name]}{equals} {mean}, SD {spread.partition(' [')[0]}, {factor}")
    n_subjects = len(result.subjects)
    lines = [f"{badge}Group of {n_subjects}{_reference(result)}: {'; '.join(parts)}."]
    for levels in result.comparisons:
        level = " - ".join(levels)
        parts = []
        for row in result.table.select("difference"):
            if row.level == level and row.parameter in _DIFFERENCE_LABELS:
                label = _DIFFERENCE_LABELS[row.parameter]
                difference = _format_difference(result, row.parameter, row)
                parts.append(f"{label} {difference}, {_describe_factor(row.ln_bf_zero)}")
        lines.append(f"{badge}{level}, group: {'; '.join(parts)}.")
    return lines


def _has_contraction(result: PopulationResult) -> bool:
    """Whether the pairs of any subject can show a contraction."""
    return any(identify(subject).contraction for subject in result.study)


def _describe_factor(log_bf_zero: float | None) -> str:
    """The Bayes factor of a value that is not 0, with its word."""
    log_factor = -(log_bf_zero or 0.0)
    return f"BF {format_bayes_factor(log_factor)} ({word_of_bayes_factor(log_factor).value})"


def _parameter_row(result: PopulationResult, name: str) -> list[str]:
    """Mean, SD between subjects, Bayes factor and word of a parameter."""
    if name == CONTRACTION.name and not _has_contraction(result):
        return [_ROW_LABELS[name], "cannot be told: no subject has pairs that can show it"]
    mean, spread = _parameter_cells(result, name)
    if name == NOISE.name:
        return [_ROW_LABELS[name], mean, spread, "-", ""]
    log_factor = -result.effect(name).zero_mean.log_bf
    word = word_of_bayes_factor(log_factor).value
    return [_ROW_LABELS[name], mean, spread, format_bayes_factor(log_factor), str(word)]


def _parameter_cells(result: PopulationResult, name: str) -> tuple[str, str]:
    """Mean and SD between subjects with their intervals; an SD that may be 0 as a bound."""
    j = result.index(name)
    mean, sd = result.draws.mean[..., j], result.draws.sd[..., j]
    if name != CONTRACTION.name:
        # Half the difference of subjects one SD above and one SD below the mean, in per cent.
        above, below = _percent(result, name, mean + sd), _percent(result, name, mean - sd)
        with np.errstate(invalid="ignore"):
            mean, sd = _percent(result, name, mean), 0.5 * (above - below)
    at_most = None if name == NOISE.name else result.effect(name).sd_at_most
    if at_most is not None:
        bound = float(np.quantile(sd, 0.95))
        limit = format_decimals(bound) if name == CONTRACTION.name else f"{format_number(bound)} %"
        return _format_quantity(name, *_quantiles(mean)), f"at most {limit}"
    return _format_quantity(name, *_quantiles(mean)), _format_spread(name, *_quantiles(sd))


def _percent(result: PopulationResult, name: str, values: FloatArray) -> FloatArray:
    """The PSE shift of constant errors, or the JND of log noises, in per cent."""
    is_error = name == CONSTANT_ERROR.name
    return result.shift_percent(values) if is_error else result.jnd_percent(values)


def _new_subject(result: PopulationResult) -> dict[str, FloatArray]:
    """Draws of a further subject, in the units of the table."""
    quantities = result.quantities(result.new_subject)
    values = {CONSTANT_ERROR.name: quantities["pse_shift_percent"]}
    if _has_contraction(result):
        values[CONTRACTION.name] = result.new_subject[..., result.index(CONTRACTION.name)]
    return {**values, NOISE.name: quantities["jnd_percent"]}


def _quantiles(values: FloatArray) -> tuple[float, float, float]:
    low, median, high = np.quantile(values, [0.025, 0.5, 0.975]).tolist()
    return low, median, high


def _format_quantity(name: str, low: float, median: float, high: float) -> str:
    """A mean in its unit: PSE shifts have a sign."""
    size = Size(low, median, high)
    if name == CONTRACTION.name:
        return format_share(size)
    text = format_percent(size)
    return text if name == CONSTANT_ERROR.name else text.replace("+", "")


def _format_spread(name: str, low: float, median: float, high: float) -> str:
    """An SD between subjects in the unit of its parameter."""
    size = Size(low, median, high)
    return format_share(size) if name == CONTRACTION.name else format_percent(size).replace("+", "")


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


def group_tables(result: PopulationResult) -> list[tuple[str, list[dict[str, str]]]]:
    """Titles and rows: parameters, what follows from them, covariates, conditions; none empty."""
    table, labels = result.table, result.labels
    parameters = []
    for name in result.names:
        [mean] = table.select("mean", name)
        [sd] = table.select("sd", name)
        [new_subject] = table.select("new_subject", name)
        n_effective = min(mean.ess_bulk, mean.ess_tail, sd.ess_bulk, sd.ess_tail)
        parameters.append(
            {
                "parameter": labels[name],
                "group mean": _row(mean),
                "SD between subjects": _row(sd),
                "new subject": _row(new_subject),
                "ln BF of 0": mean.zero_words,
                "draws": f"{n_effective:.0f}",
                "R-hat": f"{max(mean.r_hat, sd.r_hat):.3f}",
            }
        )
    effects = [
        {
            "covariate": row.level,
            "parameter": labels[row.parameter],
            "effect": _row(row),
            "ln BF of 0": row.zero_words,
        }
        for row in table.select("effect")
    ]
    spreads = {(row.level, row.parameter): row for row in table.select("difference_sd")}
    differences = [
        {
            "conditions": row.level,
            "parameter": labels[row.parameter],
            "mean difference": _row(row),
            "SD between subjects": _row(spreads[row.level, row.parameter]),
            "ln BF of 0": row.zero_words,
        }
        for row in table.select("difference")
    ]
    about = "; ".join(column.about for column in result.regressors.columns)
    named = [
        ("differences between conditions", differences),
        (f"effects of covariates ({about})", effects),
        (f"{counted(len(result.subjects), 'subject')}, median [95 % interval]", parameters),
    ]
    return [(title, rows) for title, rows in named if rows]


def _reference(result: PopulationResult) -> str:
    """The covariates for which the means hold."""
    columns = result.regressors.columns
    levels = {column.covariate: column.reference or "mean" for column in columns}
    if not levels:
        return ""
    return f" ({', '.join(f'{name} {level}' for name, level in levels.items())})"


def _row(row: PopulationRow) -> str:
    """Median and 95 % interval of a row."""
    return f"{_plain(row.q50)} [{_plain(row.q025)}, {_plain(row.q975)}]"


def _plain(value: float, digits: int = 3) -> str:
    """A number without the zero before its point, and never -0.

    Examples
    --------
    >>> _plain(-0.0471), _plain(-0.0001), _plain(2.94, 1)
    ('-.047', '.000', '2.9')
    """
    text = f"{round(value, digits) + 0.0:.{digits}f}"
    return text.replace("0.", ".", 1) if text.lstrip("-").startswith("0.") else text
