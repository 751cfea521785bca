"""How the command line prints: lines, notes, tables, a progress bar, numbers; what was read. On a terminal and, plainer, in a log."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from bayes_toe.data.messages import counted, listed, visible

if TYPE_CHECKING:
    from rich.console import Console

    from bayes_toe.data.findings import Finding
    from bayes_toe.data.study import Study
    from bayes_toe.model.prior import Prior

#: Rows of a table, and lines of one kind, that are printed; names or notes likewise.
MOST_ROWS, MOST_NAMES = 50, 20
#: Where the others are, if nothing better is known.
OUTPUT = "the output"


# --- lines and tables ---------------------------------------------------------------------------------


def new_console(quiet: bool) -> Console:
    """Where everything is printed; nothing is where `quiet`."""
    from rich.console import Console

    # Not a terminal: a width that keeps a table's row on one line, so that logs can be searched.
    return Console(quiet=quiet, width=None if sys.stdout.isatty() else 140)


@contextmanager
def progress_bar(console: Console, what: str, total: int) -> Iterator[Callable[[str], None]]:
    """A progress bar on a terminal, nothing elsewhere."""
    from rich.progress import Progress

    with Progress(console=console, disable=not console.is_terminal or console.quiet, transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda _: bar.advance(task)


def safe(text: object) -> str:
    """Text from outside, kept from being read as markup or obeyed by the terminal."""
    from rich.markup import escape

    return escape(visible(str(text)))


def say(console: Console, line: str, style: str | None = None) -> None:
    """One line of any length, with its markup."""
    console.print(line, highlight=False, soft_wrap=True, style=style)


def say_answer(console: Console, lines: Iterable[str]) -> None:
    """Lines of an answer, each with what it is about, up to the first colon, in bold; texts are escaped."""
    for line in lines:
        about, colon, rest = safe(line).partition(": ")
        say(console, f"[bold]{about}[/bold]{colon}{rest}")


def say_note(console: Console, text: str, word: str = "note", colour: str = "yellow") -> None:
    """One line that begins with a coloured word; the text is escaped."""
    say(console, f"[{colour}]{word}[/{colour}] {safe(text)}")


def say_footnote(console: Console, text: str) -> None:
    """One dim line, for what a reader may pass over; the text is escaped."""
    say(console, safe(text), "dim")


def say_table(console: Console, title: str, rows: list[dict[Any, Any]], *, total: int | None = None, file: str = OUTPUT) -> None:
    """A table of rows with the same keys, which name its columns; texts are escaped.

    It ends after :data:`MOST_ROWS` with the number of those left out and the file that has them; where `total` is given, the rows are some
    of so many and are all shown.
    """
    from rich.table import Table

    shown = rows[:MOST_ROWS] if total is None else rows
    table = Table(title=title, title_justify="left", title_style="bold")
    for index, key in enumerate(rows[0]):
        table.add_column(safe(key), justify="left" if index == 0 else "right", overflow="fold")
    for row in shown:
        table.add_row(*map(safe, row.values()))
    console.print(table)
    say_more(console, (len(rows) if total is None else total) - len(shown), file)


def chosen(names: Iterable[str], first: Collection[str]) -> list[str]:
    """Whom a table shows: all, or of more than :data:`MOST_ROWS` so many, those of `first` before the others, each in their order.

    Examples
    --------
    >>> chosen(["S2", "S1"], {"S1"}), chosen(map(str, range(2000)), {"7", "1999"})[:4]
    (['S2', 'S1'], ['7', '1999', '0', '1'])
    """
    found = list(names)
    return found if len(found) <= MOST_ROWS else sorted(found, key=lambda name: name not in first)[:MOST_ROWS]


def say_notes(console: Console, texts: Iterable[str], word: str = "note", colour: str = "yellow", *, file: str = OUTPUT) -> None:
    """Notes as :func:`say_note` has them, at most :data:`MOST_NAMES`."""
    found = list(texts)
    for text in found[:MOST_NAMES]:
        say_note(console, text, word, colour)
    say_more(console, len(found) - MOST_NAMES, file)


def say_more(console: Console, left: int, file: str = OUTPUT) -> None:
    """How many are not shown, if any, and where they are."""
    if left > 0:
        say(console, f"... and {left:,} more in {safe(file)}")


def once(notes: Iterable[tuple[str, str]]) -> list[str]:
    """Notes, each a subject and a text: each text once, with the subjects that it is about, the first of them if many; '' is no subject.

    Examples
    --------
    >>> once([("A", "few trials"), ("B", "few trials"), ("", "all raw")])
    ['A, B: few trials', 'all raw']
    """
    about: dict[str, list[str]] = {}
    for subject, text in notes:
        about.setdefault(text, []).extend([subject] if subject else [])
    return [f"{listed(subjects, MOST_NAMES)}: {text}" if subjects else text for text, subjects in about.items()]


# --- what was read ------------------------------------------------------------------------------------


def introduce(console: Console, study: Study, prior: Prior | None = None, said: str = "") -> None:
    """What everything below is about, a line `said`, by default the prior, and what is probably a mistake and would stand behind it all."""
    from bayes_toe.experiments.checks import doubts

    say_study(console, study)
    if prior is not None and not said:
        said = f"prior: {prior.describe_orders(study.task)}"
    if said:
        say(console, f"  {safe(said)}")
    say_findings(console, doubts(study, prior))


def say_study(console: Console, study: Study) -> None:
    """What was read, and what there is to say of it."""
    label = " (synthetic)" if study.synthetic and "synthetic" not in study.source else ""
    trials = sum(subject.total_trials for subject in study)
    say(console, f"[bold]{safe(study.source)}[/bold]{label}: {said_subjects(study)}, {trials} trials")
    for note in study.notes:
        say(console, f"  {safe(note)}")


def said_subjects(study: Study) -> str:
    """How many there are, and in how many conditions."""
    among = "" if study.conditions is None else f" in {len(study.conditions.levels)} conditions"
    return counted(len({subject.person for subject in study}), "subject") + among


def say_findings(console: Console, findings: Iterable[Finding], word: str = "warning") -> None:
    """Each message once, with the subjects that it is about."""
    say_notes(console, once((finding.subject, finding.message) for finding in findings), word)


def say_smaller_models(console: Console, study: Study) -> None:
    """Before sampling: designs that cannot tell all parameters, and the model that would be enough."""
    from bayes_toe.experiments.checks import check_study

    say_findings(console, (finding for finding in check_study(study) if finding.code == "design_rank"), "note")


# --- numbers, with no more digits than their Monte Carlo errors allow -----------------------------------


def number(value: float | None, digits: int = 2) -> str:
    """A number of a table; a dash where there is none."""
    return "-" if value is None or value != value else f"{value:.{digits}f}"


def allowed(value: float, error: float, most: int) -> str:
    """A number down to the decimal in which its standard error begins, and to no more than `most` decimals.

    Where the error is larger than 1, tens or hundreds are what is left. An error of 0 or NaN allows all.

    Examples
    --------
    >>> allowed(0.123456, 0.004, 5), allowed(0.123456, 0.04, 5), allowed(1234.5, 30.0, 2), allowed(0.123456, float("nan"), 2)
    ('0.123', '0.12', '1230', '0.12')
    """
    return _rounded(value, min(most, _decimals(error))) if 0.0 < error < math.inf else f"{value:.{most}f}"


def allowed_in_order(values: Sequence[float], errors: Sequence[float], most: int) -> list[str]:
    """Numbers that ascend, such as a median between its limits, each as :func:`allowed` has it; the order is still there to be seen.

    Where each by itself would hide it, because errors differ by orders of magnitude as they do before sampling has converged, all end where
    the largest error begins or, where they would be alike there, with the first decimal in which they differ.

    Examples
    --------
    >>> allowed_in_order([49.6, 40_213.0, 86_443.6], [20.0, 3e5, 0.004], 2), allowed_in_order([0.12, 0.51, 2.3], [0.01, 0.02, 0.2], 2)
    (['0', '40000', '90000'], ['0.12', '0.51', '2.3'])
    """
    shown = [allowed(value, error, most) for value, error in zip(values, errors, strict=True)]
    if all(float(low) < float(high) for low, high in itertools.pairwise(shown)):
        return shown
    decimals = min([most, *(_decimals(error) for error in errors if 0.0 < error < math.inf)])
    while decimals < most and len({round(value, decimals) for value in values}) < len(set(values)):
        decimals += 1
    return [_rounded(value, decimals) for value in values]


def allowed_quantiles(row: Mapping[Any, Any], most: int) -> list[str]:
    """The 5 % quantile, median and 95 % quantile of a row of a summary as :func:`allowed_in_order` has them."""
    keys = ("q05", "q50", "q95")
    return allowed_in_order([row[key] for key in keys], [row[f"mcse_{key}"] for key in keys], most)


def _decimals(error: float) -> int:
    # As it is printed with one digit: 0.0096 is 0.01 and begins in the second decimal.
    return -int(f"{error:.0e}".partition("e")[2])


def _rounded(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"  # - 0.0 becomes 0
