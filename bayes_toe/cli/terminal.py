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
    from bayes_toe.checks.answer_checks import Finding
    from bayes_toe.data.study import Study
    from bayes_toe.model.prior import Prior

#: Rows of a table, and lines of one kind, that are printed; names or notes likewise.
MOST_ROWS, MOST_NAMES = 50, 20
#: Where the others are, if nothing better is known.
OUTPUT = "the output"


# --- lines and tables ---------------------------------------------------------------------------------


class Terminal:
    """Where a command prints, or does not where it is `quiet`."""

    def __init__(self, quiet: bool = False) -> None:
        from rich.console import Console

        # Not a terminal: a width that keeps a table's row on one line, so that logs can be searched.
        self.console = Console(quiet=quiet, width=None if sys.stdout.isatty() else 140)

    @contextmanager
    def progress(self, what: str, total: int) -> Iterator[Callable[[str], None]]:
        """A progress bar on a terminal, nothing elsewhere; call what it gives once for each part that is done."""
        from rich.progress import Progress

        with Progress(
            console=self.console,
            disable=not self.console.is_terminal or self.console.quiet,
            transient=True,
        ) as bar:
            task = bar.add_task(what, total=total)
            yield lambda _: bar.advance(task)

    def line(self, line: str, style: str | None = None) -> None:
        """One line of any length, with its markup."""
        self.console.print(line, highlight=False, soft_wrap=True, style=style)

    def answer(self, lines: Iterable[str]) -> None:
        """Lines of an answer, each with what it is about, up to the first colon, in bold; texts are escaped."""
        for line in lines:
            about, colon, rest = safe(line).partition(": ")
            self.line(f"[bold]{about}[/bold]{colon}{rest}")

    def note(self, text: str, word: str = "note", colour: str = "yellow") -> None:
        """One line that begins with a coloured word; the text is escaped."""
        self.line(f"[{colour}]{word}[/{colour}] {safe(text)}")

    def footnote(self, text: str) -> None:
        """One dim line, for what a reader may pass over; the text is escaped."""
        self.line(safe(text), "dim")

    def table(
        self,
        title: str,
        rows: list[dict[Any, Any]],
        *,
        total: int | None = None,
        file: str = OUTPUT,
    ) -> None:
        """A table of rows with the same keys, which name its columns; texts are escaped.

        It ends after :data:`MOST_ROWS` with the number of those left out and the file that has them; where `total` is given, the rows are
        some of so many and are all shown.
        """
        from rich.table import Table

        shown = rows[:MOST_ROWS] if total is None else rows
        table = Table(title=safe(title), title_justify="left", title_style="bold")
        for index, key in enumerate(rows[0]):
            table.add_column(safe(key), justify="left" if index == 0 else "right", overflow="fold")
        for row in shown:
            table.add_row(*map(safe, row.values()))
        self.console.print(table)
        self.more((len(rows) if total is None else total) - len(shown), file)

    def notes(
        self,
        texts: Iterable[str],
        word: str = "note",
        colour: str = "yellow",
        *,
        file: str = OUTPUT,
    ) -> None:
        """Notes as :meth:`note` has them, at most :data:`MOST_NAMES`."""
        found = list(texts)
        for text in found[:MOST_NAMES]:
            self.note(text, word, colour)
        self.more(len(found) - MOST_NAMES, file)

    def more(self, left: int, file: str = OUTPUT) -> None:
        """How many are not shown, if any, and where they are."""
        if left > 0:
            self.line(f"... and {left:,} more in {safe(file)}")

    def introduce(self, study: Study, prior: Prior | None = None, said: str = "") -> None:
        """What everything below is about, a line `said`, by default the prior, and what is probably a mistake and stands behind it all."""
        from bayes_toe.checks.design_checks import urgent_findings

        self.study(study)
        if prior is not None and not said:
            said = f"prior: {prior.describe_orders(study.task)}"
        if said:
            self.line(f"  {safe(said)}")
        self.findings(urgent_findings(study, prior))

    def study(self, study: Study) -> None:
        """What was read, and what there is to say of it."""
        label = " (synthetic)" if study.synthetic and "synthetic" not in study.source else ""
        trials = sum(subject.total_trials for subject in study)
        self.line(
            f"[bold]{safe(study.source)}[/bold]{label}: {said_subjects(study)}, {trials} trials"
        )
        for note in study.notes:
            self.line(f"  {safe(note)}")

    def findings(self, findings: Iterable[Finding], word: str = "warning") -> None:
        """Each message once, with the subjects that it is about."""
        self.notes(once((finding.subject, finding.message) for finding in findings), word)


# --- words ---------------------------------------------------------------------------------------------


def safe(text: object) -> str:
    """Text from outside, kept from being read as markup or obeyed by the terminal."""
    from rich.markup import escape

    return escape(visible(str(text)))


def chosen(names: Iterable[str], first: Collection[str]) -> list[str]:
    """Whom a table shows: all, or of more than :data:`MOST_ROWS` so many, those of `first` before the others, each in their order.

    Examples
    --------
    >>> chosen(["S2", "S1"], {"S1"}), chosen(map(str, range(2000)), {"7", "1999"})[:4]
    (['S2', 'S1'], ['7', '1999', '0', '1'])
    """
    found = list(names)
    return (
        found
        if len(found) <= MOST_ROWS
        else sorted(found, key=lambda name: name not in first)[:MOST_ROWS]
    )


def once(notes: Iterable[tuple[str, str]]) -> list[str]:
    """Notes, each a subject and a text: each text once, with the subjects that it is about, the first of them if many; '' is no subject.

    Examples
    --------
    >>> once([("A", "few trials"), ("B", "few trials"), ("", "all raw")])
    ['A, B: few trials', 'all raw']
    >>> once((name, "no easy pair") for name in "ABCDEFG")
    ['A, B, C, D, E, ... and 2 more: no easy pair']
    """
    about: dict[str, list[str]] = {}
    for subject, text in notes:
        about.setdefault(text, []).extend([subject] if subject else [])
    return [f"{listed(names, 5)}: {text}" if names else text for text, names in about.items()]


def said_subjects(study: Study) -> str:
    """How many there are, and in how many conditions."""
    among = "" if study.conditions is None else f" in {len(study.conditions.levels)} conditions"
    return counted(len({subject.person for subject in study}), "subject") + among


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
    return (
        _rounded(value, min(most, _decimals(error)))
        if 0.0 < error < math.inf
        else f"{value:.{most}f}"
    )


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
