"""The answer of a group in words: what screens, report.html, methods.md and the figure print.

`parameter_row` has the line of a parameter, and `group_answer` the conclusions in sentences.
`group_tables` has the tables of the report, and `group_estimate` one estimate with its interval.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, cast

import numpy as np

from bayes_toe.answers.order_effect import (
    format_bayes_factor,
    format_difference,
    format_number,
    format_share,
    format_signed,
    word_of_bayes_factor,
)
from bayes_toe.answers.words import Word, claim
from bayes_toe.data.messages import capitalized, format_estimate, plural
from bayes_toe.groups.population_table import COMPUTED, EFFECTS, QUANTILES
from bayes_toe.model.parameters import CONSTANT_ERROR, CONTRACTION, NOISE, PEAK

if TYPE_CHECKING:
    from bayes_toe.groups.population import PopulationResult
    from bayes_toe.groups.population_table import PopulationRow

#: Parameters between 0 and 1, or -1 and 1; other parameters are in the unit of differences.
_SHARES = (CONTRACTION.name, PEAK.name)
#: Names of the parameters of a group: in sentences, as rows of its table, and as rows of the tables
#: of differences.
LABELS = {CONSTANT_ERROR.name: "PSE shift", CONTRACTION.name: "contraction", NOISE.name: "JND"}
_ROW_LABELS = {
    **LABELS,
    CONSTANT_ERROR.name: "constant error",
    PEAK.name: "largest P('equal')",
}
_DIFFERENCE_LABELS = {**LABELS, NOISE.name: "JND (ratio)", PEAK.name: "P(equal), logit"}
#: An SD whose 2.5 % quantile is below this is given as 'at most' its 95 % quantile. Parameters that
#: are not here have no such limit.
_SMALL_SD = {CONSTANT_ERROR.name: 0.03, CONTRACTION.name: 0.015}
#: Title, headings and rows of a table.
TextTable = tuple[str, list[str], list[list[str]]]


def parameter_row(result: PopulationResult, name: str) -> list[str]:
    """Name, mean, SD between subjects, Bayes factor of a mean that is not 0, and its word.

    If the parameter cannot be told, there are only its name and the reason.
    """
    label = _ROW_LABELS[name]
    if name not in result.identified:
        return [label, "cannot be told: no subject has pairs that can show it"]
    factor, word = "-", ""  # a JND or a peak is never 0
    if name in EFFECTS:
        factor, word = _factor_and_word(result.table.row("mean", name))
    return [label, group_estimate(result, name), _spread(result, name), factor, word]


def group_estimate(result: PopulationResult, name: str, quantity: str = "mean") -> str:
    """Median and 95 % interval of a mean, or of a new subject, in the unit of the study."""
    # The row in the units of screens, if the table has such a row beside the row of the parameter.
    row = result.table.row(quantity, COMPUTED.get(name, name))
    if name in _SHARES:
        return format_share(row.interval)
    sign = "+" if name == CONSTANT_ERROR.name else ""
    return format_difference(row.interval, result.study.unit, sign)


def mean_word(result: PopulationResult, name: str) -> Word:
    """The word for whether the mean of an effect differs from 0."""
    _, word = _factor_and_word(result.table.row("mean", name))
    return word


def _factor_and_word(row: PopulationRow) -> tuple[str, Word]:
    """The Bayes factor of a value that is not 0 against the value 0, as text, and its word."""
    log_factor = -cast(float, row.ln_bf_zero)  # the row has the Bayes factor of 0
    return format_bayes_factor(log_factor), word_of_bayes_factor(log_factor)


def _spread(result: PopulationResult, name: str) -> str:
    """The SD between subjects with its interval; an SD that may be 0 is 'at most 4 %'."""
    unit = result.shown_unit(name)
    j = result.index(name)
    mean = result.draws.mean[..., j]  # (chains, draws)
    sd = result.draws.sd[..., j]
    # The unit may be no linear function of the parameter. So, in the unit, the SD is half the
    # difference between subjects one SD above and one SD below the mean.
    one_sd_above = result.in_units(name, mean + sd, unit)
    one_sd_below = result.in_units(name, mean - sd, unit)
    with np.errstate(invalid="ignore"):  # both may be infinite
        spread = 0.5 * (one_sd_above - one_sd_below)

    is_share = name in _SHARES
    if result.table.row("sd", name).q025 < _SMALL_SD.get(name, 0.0):
        upper_bound = np.quantile(spread, 0.95)
        if is_share:
            return f"at most {100.0 * upper_bound:.0f} %"
        return f"at most {format_number(upper_bound)} {unit.difference_unit}"

    interval = np.quantile(spread, QUANTILES)
    if is_share:
        return format_share(interval)
    return format_signed(interval, unit.difference_unit, sign="")


# --- Sentences ------------------------------------------------------------------------------------


def group_answer(result: PopulationResult) -> list[str]:
    """Sentences on the means of both effects, and on the differences between conditions."""
    badge = "" if result.is_reliable else "NOT RELIABLE: "
    constant_error, contraction = (_describe_effect(result, name) for name in EFFECTS)
    heading = f"In the group of {len(result.subjects)}"
    # The values of covariates for which the means hold, as in ' (age mean, sex f)'.
    references = {}  # by covariate: a covariate with several levels has several columns
    for column in result.regressors.columns:
        # A numeric covariate has no reference level.
        references[column.covariate] = f"{column.covariate} {column.reference or 'mean'}"
    if references:
        heading += f" ({', '.join(references.values())})"
    lines = [f"{badge}{heading}, {constant_error} {capitalized(contraction)}"]

    differences = defaultdict(list)  # by the two conditions
    for comparison, label, difference, factor, word in _comparison_rows(result, "difference"):
        text = f"{label} {difference} ({word}, BF {factor})"
        differences[comparison].append(text)
    for comparison, texts in differences.items():
        lines.append(f"{badge}Difference {comparison} in the group: {'; '.join(texts)}.")
    return lines


def _describe_effect(result: PopulationResult, name: str) -> str:
    """Sentences on mean and SD of an effect, and on whether the mean differs from 0."""
    if name not in result.identified:
        return f"the {_ROW_LABELS[name]} cannot be told."

    sd, *_ = _spread(result, name).partition(" [")  # '12 % [9, 15]' -> '12 %'
    text = (
        f"the mean {LABELS[name]} is {group_estimate(result, name)}, and the SD between subjects "
        f"is {sd}."
    )

    row = result.table.row("mean", name)
    factor, word = _factor_and_word(row)
    differs = capitalized(claim(word, "this mean", "differ", "from 0"))
    text += f" {differs} (BF {factor})."
    # An interval that excludes 0 does not decide whether the mean differs from 0.
    if word is Word.UNDECIDED and row.q025 * row.q975 > 0.0:
        text += " The interval assumes a nonzero mean."
    return text


# --- Tables ---------------------------------------------------------------------------------------


def comparison_tables(result: PopulationResult) -> list[TextTable]:
    """The tables of differences between conditions and of effects of covariates, if any."""
    covariates = "; ".join(column.meaning for column in result.regressors.columns)
    tables = []
    for quantity, title, heading in (
        ("difference", "Differences between conditions", "conditions"),
        ("effect", f"Effects of covariates ({covariates})", "covariate"),
    ):
        rows = _comparison_rows(result, quantity)
        if rows:
            tables.append((title, [heading, "of the", "median [95 % interval]", "BF", ""], rows))
    return tables


def _comparison_rows(result: PopulationResult, quantity: str) -> list[list[str]]:
    """A row for each 'difference' between conditions, or each 'effect' of a covariate.

    Its cells are the comparison, the parameter, the difference, its Bayes factor and word.
    """
    rows = []
    for row in result.table.select(quantity):
        if row.parameter in result.identified:
            label = _DIFFERENCE_LABELS[row.parameter]
            difference = _format_difference(result, row)
            rows.append([row.level, label, difference, *_factor_and_word(row)])
    return rows


def _format_difference(result: PopulationResult, row: PopulationRow) -> str:
    """A difference of means with its interval: in PSE, in p, a ratio of JNDs, or in logits."""
    values = row.interval
    if row.parameter == CONSTANT_ERROR.name:
        return format_difference(result.in_units(row.parameter, values), result.study.unit)
    if row.parameter == CONTRACTION.name:
        return format_share(values)
    if row.parameter == NOISE.name:  # a difference of logs is the log of a ratio
        return format_estimate(*map("{:.2f}".format, np.exp(values)))
    return format_estimate(*map("{:+.2f}".format, values))


def group_tables(result: PopulationResult) -> list[TextTable]:
    """The tables of the report, in the formats of the screen."""
    rows = []
    for name in result.names:
        cells = parameter_row(result, name)
        if name in result.identified:  # else the row ends with a reason
            cells.insert(3, group_estimate(result, name, "new_subject"))  # behind the SD
            mean_and_sd = result.table.row("mean", name), result.table.row("sd", name)
            n_effective = min(min(row.ess_bulk, row.ess_tail) for row in mean_and_sd)
            cells += [f"{n_effective:,.0f}", f"{max(row.r_hat for row in mean_and_sd):.3f}"]
        rows.append(cells)

    headings = [
        "",  # of the parameter
        "group mean",
        "SD between subjects",
        "new subject",
        "BF of mean not 0",
        "",  # of the word for the Bayes factor
        "effective draws",
        "R-hat",
    ]
    title = f"{plural(len(result.subjects), 'subject')}, median [95 % interval]"
    return [*comparison_tables(result), (title, headings, rows)]
