"""The screens of `contrast` and `history`.

`print_contrast` prints the differences between the conditions of each subject. `print_history`
prints how responses depend on the previous trial, and `history_lines` counts the conclusions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayes_toe.answers.order_effect import format_decimals
from bayes_toe.answers.study_summary import count_words
from bayes_toe.cli.terminal import MANY_SUBJECTS, OUTPUT, Terminal
from bayes_toe.data.messages import format_estimate, plural

if TYPE_CHECKING:
    from bayes_toe.answers.contrast import ContrastTable
    from bayes_toe.answers.serial_dependence import SerialDependence

# --- Conditions ----------------------------------------------------------------------------------


def print_contrast(out: Terminal, table: ContrastTable, file: str = OUTPUT) -> None:
    """A row for each subject, comparison and quantity; what is not compared."""
    if len(table.subjects) < MANY_SUBJECTS:
        out.table(*_contrast_table(table))
    else:
        out.line()
        out.line(f"All {len(table.subjects):,} subjects: {file}")
    if len({row.comparison for row in table}) > 1:
        out.line("BF and word refer to a difference between any two conditions.")
    if any(row.robust == "no" for row in table):
        out.line("? The word changes if the lapse rate may differ between conditions.")
    left_out = {name: why for name, why in table.left_out.items() if name not in table.failed}
    out.reasons("Not compared", left_out, "-", file=file)


def _contrast_table(table: ContrastTable) -> tuple[list[str], list[list[str]]]:
    """Headings and rows; a subject and a comparison are named in their first rows."""
    comparisons = {row.comparison for row in table}
    has_one_comparison = len(comparisons) == 1
    rows = []
    label_before = ("", "")
    for row in table:
        if row.quantity == "order effect":
            continue
        label = (row.subject, row.comparison)
        first_cells = ["", ""] if label == label_before else [*label]
        label_before = label
        word, size = row.short_word, "-"
        if row.short_word not in ("no", "probably not"):
            size = row.size(table.unit)
        if row.robust == "no":
            word += " ?"
        rows.append([*first_cells, row.quantity, size, row.factor, word])

    if has_one_comparison:
        (title,) = comparisons
        rows = [[name, *cells] for name, _, *cells in rows]
        return ["subject", "", f"{title} [95 % interval]", "BF", "differs"], rows
    return ["subject", "difference", "", "[95 % interval]", "BF", "differs"], rows


# --- Serial dependence ---------------------------------------------------------------------------


def print_history(out: Terminal, table: SerialDependence, file: str = OUTPUT) -> None:
    """Print both effects of every subject, and the meaning of their sizes."""
    rows, failed = [], {}
    for row in table:
        if row.has_result:
            carry_over, previous = row.word("carry_over"), row.word("previous_response")
            sizes = _size(carry_over, row.rho), _size(previous, row.kappa)
            rows.append([row.subject, carry_over, sizes[0], previous, sizes[1]])
        else:
            failed[row.subject] = row.note

    headings = ["subject", "carry-over", "rho [95 %]", "previous\nresponse", "kappa [95 %]"]
    if len(rows) >= MANY_SUBJECTS:
        out.line()
        out.line(f"All {len(rows):,} subjects: {file}")
    elif rows:
        out.table(headings, rows)
        out.line(
            "rho is the share of a stimulus that is carried over to the next trial. If kappa is "
            "above 0, a subject repeats responses. If kappa is below 0, a subject alternates."
        )
    out.reasons("No result", failed, file=file)


def _size(word: str, quantiles: tuple[float, ...]) -> str:
    """The size of an effect; '-' if there is probably none."""
    if word in ("no", "probably not") or not quantiles:
        return "-"
    return format_estimate(*map(format_decimals, quantiles))


def history_lines(table: SerialDependence) -> list[str]:
    """How many subjects have each word, for both effects."""
    rows = [row for row in table if row.has_result]
    if not rows:
        return []
    of_total = f" of {plural(len(rows), 'subject')}"
    carry_over = count_words([row.word("carry_over") for row in rows], of_total)
    previous = count_words([row.word("previous_response") for row in rows], of_total)
    return [f"Carry-over: {carry_over}.", f"Previous response: {previous}."]
