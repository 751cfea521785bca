"""The screens of `contrast` and `history`: what differs within subjects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING

from bayes_toe.answers.order_effect import Size, format_bayes_factor, format_percent, format_share
from bayes_toe.answers.study_summary import count_words
from bayes_toe.cli.terminal import MANY_SUBJECTS, OUTPUT, Terminal
from bayes_toe.data.messages import capitalized, counted

if TYPE_CHECKING:
    from bayes_toe.answers.contrast import ContrastTable, Difference
    from bayes_toe.answers.serial_dependence import SerialDependence, SubjectDependence

#: The words of files for differences, as screens have them.
DIFFERENCE_WORDS = {
    "differs": "yes",
    "probably differs": "probably",
    "undecided": "undecided",
    "probably no difference": "probably not",
    "no difference": "no",
}


# --- Conditions ----------------------------------------------------------------------------------


def print_contrast(out: Terminal, table: ContrastTable, file: str = OUTPUT) -> None:
    """A row for each subject, comparison and quantity; what is not compared."""
    if len(table.subjects) < MANY_SUBJECTS:
        out.table(*_contrast_table(table))
    else:
        out.line()
        out.line(f"All {len(table.subjects):,} subjects: {file}")
    if any(row.robust == "no" for row in table):
        out.line("? The word changes if the lapse rate may differ between conditions.")
    missing = [
        (name, f"Not compared: {reason}.", "")
        for name, reason in table.left_out.items()
        if name not in table.failed
    ]
    notes = []
    for subject in table.subjects:
        notes += [(subject.subject, note, "") for note in subject.notes]
    out.notes([*missing, *notes], "-", file=file)


def _contrast_table(table: ContrastTable) -> tuple[list[str], list[list[str]]]:
    """Headings and rows; the name of a subject, or of its comparison, stands in its first row."""
    comparisons = {row.comparison for row in table}
    rows = []
    label_before = ""
    for row in table:
        if row.quantity == "order effect":
            continue
        label = row.subject
        if len(comparisons) > 1:
            label = f"{row.subject} {row.comparison}"
        word = DIFFERENCE_WORDS.get(row.word, "-")
        if row.robust == "no":
            word += " ?"
        factor = row.log_bf_differs
        shown_factor = "-" if factor is None else format_bayes_factor(factor)
        shown_label = "" if label == label_before else label
        rows.append([shown_label, row.quantity, _difference(row), shown_factor, word])
        label_before = label
    title = "difference" if len(comparisons) > 1 else table.rows[0].comparison
    return ["subject", "", f"{title} [95 % interval]", "BF", "differs"], rows


def _difference(row: Difference) -> str:
    """A difference with its interval; '-' if there is probably none."""
    if DIFFERENCE_WORDS.get(row.word) in ("no", "probably not"):
        return "-"
    size = Size(*row.shown)
    return format_percent(size) if row.unit == "%" else format_share(size, "+")


def contrast_lines(table: ContrastTable) -> list[str]:
    """In how many subjects each quantity differs; each subject counts once."""
    column, _, levels = table.conditions.about.partition(": ")
    lines = [f"Condition {column}: {levels}."]
    for quantity in table.quantities:
        first = dict[str, str]()
        for row in table.select(quantity):
            first.setdefault(row.subject, DIFFERENCE_WORDS.get(row.word, "no Bayes factor"))
        lines.append(f"{capitalized(quantity)} differs: {_count(first.values())}.")
    return lines


def _count(words: Iterable[str]) -> str:
    """How often each word is given, with its directions: 'yes (repetition)' is a 'yes'."""
    plain = list[str]()
    directions: dict[str, Counter[str]] = {}
    for text in words:
        word, _, direction = text.removesuffix(")").partition(" (")
        plain.append(word)
        if direction:
            directions.setdefault(word, Counter())[direction] += 1
    named = {}
    for word, counts in directions.items():
        named[word] = ", ".join(f"{count} {direction}" for direction, count in counts.items())
    return count_words(plain, f" of {counted(len(plain), 'subject')}", named)


# --- Serial dependence ---------------------------------------------------------------------------


def print_histories(out: Terminal, table: SerialDependence, file: str = OUTPUT) -> None:
    """Both effects of every subject, and the meaning of their sizes."""
    known = [row for row in table if row.is_known]
    rows = [_history_row(row) for row in known] if len(known) < MANY_SUBJECTS else []
    headings = ["subject", "carry-over", "rho [95 %]", "previous\nresponse", "kappa [95 %]"]
    if rows:
        out.table(headings, rows)
        out.line("rho: share of a stimulus that is carried over to the next trial.")
        out.line("kappa: above 0 subjects repeat their response, below 0 they alternate.")
    elif known:
        out.line()
        out.line(f"All {len(known):,} subjects: {file}")
    out.notes(
        ((row.subject, f"No result: {row.note}.", "") for row in table if not row.is_known),
        file=file,
    )


def _history_row(row: SubjectDependence) -> list[str]:
    """Words and sizes of both effects; no size if there is probably no effect."""
    carry_over, previous = row.word("carry_over"), row.word("previous_response")
    return [
        row.subject,
        carry_over,
        _size(carry_over, row.rho),
        previous,
        _size(previous, row.kappa),
    ]


def _size(word: str, quantiles: tuple[float, ...]) -> str:
    if word in ("no", "probably not") or not quantiles:
        return "-"
    return format_share(Size(*quantiles))


def history_lines(table: SerialDependence) -> list[str]:
    """How many subjects have each word, for both effects."""
    known = [row for row in table if row.is_known]
    lines = []
    for effect, name in (("carry_over", "Carry-over"), ("previous_response", "Previous response")):
        if known:
            lines.append(f"{name}: {_count(row.word(effect) for row in known)}.")
    return lines
