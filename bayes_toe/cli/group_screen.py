"""The screens of `population`, `contrast` and `history`.

`print_group` prints the result of `population`. `print_contrast` prints the differences between the
conditions of each subject. `print_history` prints how responses depend on the previous trial, and
`history_lines` counts the conclusions.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter

from bayes_toe.answers.contrast import ORDER_EFFECT, ContrastTable
from bayes_toe.answers.group_answer import (
    LABELS,
    comparison_tables,
    group_estimate,
    parameter_row,
)
from bayes_toe.answers.serial_dependence import EFFECT_MODELS, SerialDependence
from bayes_toe.answers.study_summary import count_words
from bayes_toe.cli.terminal import OUTPUT, Rows, Terminal
from bayes_toe.data.messages import capitalized, plural
from bayes_toe.groups.population import PopulationResult
from bayes_toe.inference.diagnostics import worst

# --- A group -------------------------------------------------------------------------------------


def print_group(out: Terminal, result: PopulationResult, contradictions: Sequence[str]) -> None:
    """Print the table of the group, a new subject, the fit of the group, and problems."""
    headings = ["", "mean", "SD between\nsubjects", "BF of mean\nnot 0", ""]
    out.table(headings, [parameter_row(result, name) for name in LABELS])
    for title, headings, comparisons in comparison_tables(result):
        out.table(headings, comparisons, title=title)

    predictions = []
    for name, label in LABELS.items():
        if name in result.identified:
            predictions.append(f"{label} {group_estimate(result, name, 'new_subject')}")
    out.line()
    out.line(f"New subject (prediction): {', '.join(predictions)}.")
    # The names of the worst parameters are not shown.
    (_, n_effective), (_, r_hat) = worst(result.draws.convergence)
    fit = "poor" if contradictions else "good"
    out.line(f"Fit of the group: {fit}. Draws: {n_effective:,.0f} effective, R-hat {r_hat:.3f}.")
    print_problems(out, result, contradictions)


def print_problems(out: Terminal, result: PopulationResult, contradictions: Sequence[str]) -> None:
    """Print the problems of the draws, and how the responses contradict the group model."""
    out.notes(("", capitalized(text), "") for text in (*result.problems, *contradictions))


# --- Conditions ----------------------------------------------------------------------------------


def print_contrast(out: Terminal, table: ContrastTable, file: str = OUTPUT) -> None:
    """Print a row for each subject, comparison and quantity, and the subjects without a row."""
    out.table_of_subjects(*_contrast_table(table), len(table.subjects), file)
    if len({row.comparison for row in table}) > 1:
        out.line("BF and word refer to a difference between any two conditions.")
    if any(row.robust == "no" for row in table):
        out.line("? The word changes if the lapse rate may differ between conditions.")
    # Failures are problems, which the command prints by itself.
    reasons = {key: text for key, text in table.left_out.items() if key not in table.failed}
    out.reasons("Not compared", reasons, mark="-", file=file)


def _contrast_table(table: ContrastTable) -> tuple[list[str], Rows]:
    """Headings and rows; a subject and a comparison are named in their first rows.

    A row has the quantity, the size of its difference, the Bayes factor and the word.
    """
    rows = []
    for labels, differences in groupby(table, attrgetter("subject", "comparison")):
        for difference in differences:
            if difference.quantity == ORDER_EFFECT:  # A sentence of the answer has it.
                continue
            word = str(difference.word)
            if word in ("no", "probably not"):  # A difference that is absent has no size.
                size = "-"
            else:
                size = difference.size(table.unit)
            if difference.robust == "no":
                word += " ?"
            rows.append([*labels, difference.quantity, size, difference.factor, word])
            labels = "", ""  # Further rows of this subject and comparison do not repeat them.

    headings = ["subject", "difference", "", "[95 % interval]", "BF", "differs"]
    comparisons = {row.comparison for row in table}  # such as 'left - right'
    # A single comparison has no column of its own (column 1). The heading of the sizes (column 3)
    # names it.
    if len(comparisons) == 1:
        headings[3] = f"{comparisons.pop()} [95 % interval]"
        for cells in [headings, *rows]:
            del cells[1]
    return headings, rows


# --- Serial dependence ---------------------------------------------------------------------------


def print_history(out: Terminal, table: SerialDependence, file: str) -> None:
    """Print word and size of both effects of every subject, and subjects without a result.

    There is a subject with a result: without one, the figure is refused before anything is printed.
    """
    rows = []
    failed = {}
    for row in table:
        if not row.has_result:
            failed[row.subject] = row.note
            continue
        cells = [row.subject]
        for effect in EFFECT_MODELS:
            word = row.word(effect)
            has_size = word not in ("no", "probably not")
            cells += [word, row.size(effect) if has_size else "-"]
        rows.append(cells)

    headings = ["subject", "carry-over", "rho [95 %]", "previous\nresponse", "kappa [95 %]"]
    out.table_of_subjects(headings, rows, len(rows), file)
    out.line(
        "rho is the share of a stimulus that is carried over to the next trial. If kappa is above "
        "0, a subject repeats responses. If kappa is below 0, a subject alternates."
    )
    out.reasons("No result", failed, file=file)


def history_lines(table: SerialDependence) -> list[str]:
    """Sentences on how many of the subjects with a result have each word, one for each effect."""
    rows = [row for row in table if row.has_result]
    of_total = f" of {plural(len(rows), 'subject')}"
    lines = []
    for label, effect in (("Carry-over", "carry_over"), ("Previous response", "previous_response")):
        counts = count_words([row.word(effect) for row in rows], of_total)
        lines.append(f"{label}: {counts}.")
    return lines
