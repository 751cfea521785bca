"""What the command line prints: `Terminal`, and the functions that format its texts.

`Terminal` prints lines, tables, notes and a progress bar. A line has at most 80 columns.
"""

from __future__ import annotations

import itertools
import re
import shlex
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import isnan
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from bayes_toe.data.messages import Texts, join_names, join_words, plural, visible

if TYPE_CHECKING:
    from bayes_toe.checks.answer_checks import Finding
    from bayes_toe.data.study import Study

#: The rows of a table.
Rows = Sequence[Texts]
#: The subject of a note ('' if it is on no single subject), its text, and an option to type.
Note = tuple[str, str, str]
#: Largest number of columns of a line or table, whatever the width of the terminal.
WIDTH = 80
#: Number of subjects from which on tables show only subjects that need action.
MANY_SUBJECTS = 20
#: Largest number of notes that are printed at once.
MOST_NOTES = 20
#: The name of the file with all further notes, if no other name is known.
OUTPUT = "the output"
#: The words that were typed after `bayes-toe`.
TYPED_WORDS: list[str] = []
#: Between words that stay on one line: an estimate with its unit and interval, or an option with
#: its value.
_GLUE = "\ufffe"
#: 'p = .12 [.05, .19]', '+12 % [8, 16]' or a number alone.
_ESTIMATE = re.compile(r"(p = )?[-+.\d]+( %)?( \[[^\]]*\])?")
#: '--swap ' before a value, with the space, but not before a further option, as in '--even --keep'.
_OPTION = re.compile(r"(?<=\s)(--?\w[\w-]*) (?!-)")


# --- lines and tables ----------------------------------------------------------------------------


class Terminal:
    """The output of a command: lines, tables, notes, a progress bar; if it is `quiet`, nothing."""

    def __init__(self, quiet: bool = False) -> None:
        from rich.console import Console

        # On a terminal, None stands for its own width, which the progress bar takes.
        self.console = Console(quiet=quiet, width=None if sys.stdout.isatty() else WIDTH)

    @contextmanager
    def progress(self, label: str, total: int) -> Iterator[Callable[[str], None]]:
        """Show a progress bar of `total` parts on a terminal; yield a function that advances it.

        The function is called with the name of a finished part, which the bar does not show.
        """
        from rich.progress import Progress

        with Progress(
            console=self.console,
            disable=not self.console.is_terminal or self.console.quiet,
            transient=True,  # The bar disappears at the end.
        ) as bar:
            task = bar.add_task(label, total=total)
            yield lambda _: bar.advance(task)

    def line(self, text: str = "", indent: int = 0) -> None:
        """Print a text in lines of at most :data:`WIDTH` columns, the second and later indented."""
        self.lines(wrap_line(text, indent))

    def lines(self, lines: Iterable[str], style: str = "") -> None:
        """Print lines as they are."""
        from rich.text import Text

        for line in lines:
            self.console.print(Text(visible(line), style), soft_wrap=True)

    def table(
        self,
        headings: Texts,
        rows: Rows,
        numeric: Collection[int] = (),
        title: str = "",
    ) -> None:
        """Print a table after an empty line, as :func:`format_table` has it."""
        self.lines(["", title] if title else [""], "bold")
        lines = format_table(headings, rows, numeric)
        n_heading_lines = len(_heading_rows(headings))
        self.lines(lines[:n_heading_lines], "bold")
        self.lines(lines[n_heading_lines:])

    def table_of_subjects(
        self,
        headings: Texts,
        rows: Rows,
        n_subjects: int,
        file: str,
        **options: Any,
    ) -> None:
        """Print a table of subjects, or the file that has it if the subjects are many."""
        if n_subjects < MANY_SUBJECTS:
            self.table(headings, rows, **options)
        else:
            self.lines(["", f"All {n_subjects:,} subjects: {file}"])

    def notes(self, notes: Iterable[Note], mark: str = "!", *, file: str = OUTPUT) -> None:
        """Print notes after an empty line.

        Notes with the same text and option become one. `file` has the notes that are not printed.
        """
        merged_notes = merge_notes(notes)
        if merged_notes:
            self.line()
        for subjects, text, option in merged_notes[:MOST_NOTES]:
            self.lines(note_lines(mark, subjects, text, option))
        n_more = len(merged_notes) - MOST_NOTES
        if n_more > 0:
            self.line(f"... and {n_more:,} more in {file}")

    def reasons(
        self, text: str, reasons: Mapping[str, str], mark: str = "!", *, file: str = OUTPUT
    ) -> None:
        """Print a note for each subject: the same words, a colon and its reason."""
        notes = [(name, f"{text}: {reason}.", "") for name, reason in reasons.items()]
        self.notes(notes, mark, file=file)

    def answer(self, lines: Iterable[str]) -> None:
        """Print the lines of the answer after an empty line and a heading."""
        self.lines(["", "Answer"], "bold")
        for line in lines:
            self.line(line)

    def findings(self, findings: Iterable[Finding], mark: str = "!") -> None:
        """Print each message once, with its subjects and the option to type."""
        self.notes(((item.subject, item.message, item.option) for item in findings), mark)

    def remarks(self, texts: Iterable[str]) -> None:
        """Print notes that name no subject."""
        self.notes((("", text, "") for text in texts), mark="-")


def wrap_line(text: str, indent: int = 0) -> list[str]:
    """A text in lines of at most :data:`WIDTH` columns.

    Examples
    --------
    >>> wrap_line("word " * 17, indent=2)[1]
    '  word'
    """
    # An estimate stays on one line with its unit and its interval.
    glued_text = _ESTIMATE.sub(lambda match: match[0].replace(" ", _GLUE), visible(text))
    return _wrap_glued(glued_text, WIDTH, subsequent_indent=" " * indent) or [""]


def _wrap_glued(text: str, width: int, **options: Any) -> list[str]:
    """A text in lines that do not end where :data:`_GLUE` stands; it becomes a space."""
    lines = wrap(text, width, break_on_hyphens=False, **options)
    return [line.replace(_GLUE, " ") for line in lines]


def note_lines(mark: str, subjects: Texts, text: str, option: str) -> list[str]:
    """A note with its mark and subjects, and under it what to type.

    Examples
    --------
    >>> note_lines("!", ["A08"], "Responses look swapped in block 2.", "--swap A08:2")
    ['! A08  Responses look swapped in block 2.', '       type: --swap A08:2']
    """
    label = f"{mark} "
    if subjects:
        label += f"{join_names([*map(visible, subjects)], max_items=5)}  "
    # Further lines stand under the text; under a long label they begin at the eighth column.
    indent = len(label) if len(label) <= 12 else 7
    lines = wrap_line(label + text, indent)
    if option:
        lines += command_lines(option, " " * indent + "type: ")
    return lines


def command_lines(command: str, start: str) -> list[str]:
    r"""A command in lines that a shell joins: each but the last ends in a backslash.

    Examples
    --------
    >>> command_lines("bayes-toe run study.csv", "  ")
    ['  bayes-toe run study.csv']
    >>> command_lines("bayes-toe check a_study_with_a_long_name.csv " + 36 * "x", "")
    ['bayes-toe check a_study_with_a_long_name.csv \\', '  xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx']
    """
    # A word stays on one line, and an option with its value.
    words = [shlex.quote(word).replace(" ", _GLUE) for word in shlex.split(visible(command))]
    glued_command = _OPTION.sub(rf"\1{_GLUE}", " ".join(words))
    lines = _wrap_glued(
        glued_command,
        WIDTH - 2,  # for the backslash
        initial_indent=start,
        subsequent_indent=" " * (len(start) + 2),
        break_long_words=False,
    )
    return [f"{line} \\" for line in lines[:-1]] + lines[-1:]


def typed_command(name: str) -> str:
    """The options that were typed, with another command, such as 'bayes-toe run study.csv'."""
    return shlex.join(["bayes-toe", name, *TYPED_WORDS[1:]])


def repeated_command() -> str:
    """The command line that was typed, to be typed again with further options.

    The repeated command replaces the outputs of the typed one. It does not resume, because the
    results that are stored were computed without the further options.
    """
    words = [word for word in TYPED_WORDS if word != "--resume"]
    if "--overwrite" not in words:
        words.append("--overwrite")
    return shlex.join(["bayes-toe", *words])


def with_options(command: str, options: Iterable[str]) -> str:
    """A command line with further options, each of which swaps or excludes a subject or its blocks.

    If an option excludes a subject, it replaces typed options that exclude blocks of this subject.

    If an option swaps what a typed option swaps, the typed option is removed, and no option is
    added: the responses look swapped only after the typed swap.

    Examples
    --------
    >>> with_options("bayes-toe run study.csv --swap A:3", ["--swap A:3"])
    'bayes-toe run study.csv'
    >>> with_options("bayes-toe run study.csv --swap A:3", ["--swap A"])
    'bayes-toe run study.csv --swap A:3 --swap A'
    >>> with_options("bayes-toe run study.csv --exclude 'B 1:3'", ["--exclude 'B 1'"])
    "bayes-toe run study.csv --exclude 'B 1'"
    """
    # NUL stands between words, because no word has this character, but words have spaces.
    line = "\0".join(shlex.split(command))
    for option in options:
        words = "\0" + "\0".join(shlex.split(option))
        is_exclusion = option.startswith("--exclude")
        # '--exclude B' removes a typed '--exclude B' or '--exclude B:3', but not '--exclude B2'.
        blocks = r"(:[^\0]+)?" if is_exclusion else ""
        line, n_removed = re.subn(rf"{re.escape(words)}{blocks}(?![^\0])", "", line)
        if is_exclusion or n_removed == 0:
            line += words
    return shlex.join(line.split("\0"))


def format_table(headings: Texts, rows: Rows, numeric: Collection[int] = ()) -> list[str]:
    r"""Lines of a table of at most :data:`WIDTH` columns.

    The first column is cut if the table is too wide. If that does not help, the last columns
    follow below, with the first column again.

    Parameters
    ----------
    headings : sequence of str
        A line break begins another line of the heading.
    rows : sequence of sequences of str
        The last cell of a row with fewer cells goes across the other columns.
    numeric : collection of int
        Columns that are aligned at their right end.

    Examples
    --------
    >>> format_table(["subject", "order\neffect"], [["A01", "yes"], ["A02", "no"]])
    ['         order', 'subject  effect', 'A01      yes', 'A02      no']
    """
    # The first column has the names, which may be cut. The last columns are moved below until all
    # other columns fit beside cut names. One column always stays beside the names, because names
    # alone show nothing.
    n_fitting = len(headings)
    while n_fitting > 2 and not is_narrow(headings[:n_fitting], [row[:n_fitting] for row in rows]):
        n_fitting -= 1

    fitting_rows = [row[:n_fitting] for row in (*_heading_rows(headings[:n_fitting]), *rows)]
    widths, gap = _column_widths(fitting_rows)
    # The first column gives up what the table is too wide.
    widths[0] -= max(0, _total_width(widths, gap) - WIDTH)
    table = [_table_line(row, widths, gap, numeric) for row in fitting_rows]

    if n_fitting < len(headings):
        headings_below = [headings[0], *headings[n_fitting:]]
        rows_below = [[row[0], *row[n_fitting:]] for row in rows]
        n_moved = n_fitting - 1  # columns by which those below move to the left
        numeric_below = [i - n_moved for i in numeric if i >= n_fitting]
        table += ["", *format_table(headings_below, rows_below, numeric_below)]
    return table


def _total_width(widths: Sequence[int], gap: int) -> int:
    """The width of a table, with the gaps between its columns."""
    return sum(widths) + gap * (len(widths) - 1)


def is_narrow(headings: Texts, rows: Rows, first_width: int = 8) -> bool:
    """Whether a table fits into :data:`WIDTH` once its first column is cut to `first_width`."""
    (width, *other_widths), gap = _column_widths([*_heading_rows(headings), *rows])
    return _total_width([min(width, first_width), *other_widths], gap) <= WIDTH


def _heading_rows(headings: Texts) -> Rows:
    r"""The lines of headings as rows of cells, aligned at the last line.

    ['subject', 'order\neffect'] -> [('', 'order'), ('subject', 'effect')]
    """
    # From the last line upwards, so that a shorter heading is filled at its top.
    upward_lines = [heading.split("\n")[::-1] for heading in headings]
    upward_rows = list(itertools.zip_longest(*upward_lines, fillvalue=""))
    return upward_rows[::-1]


def _column_widths(rows: Rows) -> tuple[list[int], int]:
    """The width that each column needs, and the gap between columns: 2, or 1 in a wide table."""
    n_columns = len(rows[0])
    widths = [0] * n_columns
    for row in rows:
        # The last cell of a short row goes across the other columns.
        cells = row if len(row) == n_columns else row[:-1]
        for i, cell in enumerate(cells):
            widths[i] = max(widths[i], cell_width(cell))
    return widths, 2 if _total_width(widths, gap=2) <= WIDTH else 1


def _table_line(row: Texts, widths: Sequence[int], gap: int, numeric: Collection[int]) -> str:
    """A row of a table; the last cell of a short row goes across the other columns."""
    line = ""
    for i, cell in enumerate(row):
        is_spanning = i == len(row) - 1 and len(row) < len(widths)
        width = WIDTH - cell_width(line) if is_spanning else widths[i]
        text = shorten(cell, width)
        padding = " " * (width - cell_width(text))
        if i in numeric and not is_spanning:
            text = padding + text
        else:
            text += padding
        line += text + " " * gap
    return line.rstrip()


def shorten(text: str, width: int) -> str:
    """A text of at most some columns, cut in its middle, since names often differ at their end.

    Examples
    --------
    >>> shorten("SubA_Bimodal_l2", 10), shorten("A08 !", 8), shorten("A08", 0)
    ('SubA_...l2', 'A08 !', '...')
    """
    if cell_width(text) <= width:
        return text
    # The most characters that fit beside the three dots; some characters take two columns.
    for n_characters in range(width - 3, 0, -1):
        n_last = n_characters // 3  # a third of the characters are from the end
        short_text = f"{text[: n_characters - n_last]}...{text[len(text) - n_last :]}"
        if cell_width(short_text) <= width:
            return short_text
    return "..."


def cell_width(text: str) -> int:
    """The number of columns that a text takes on a terminal."""
    from rich.cells import cell_len

    return cell_len(text)


# --- words ---------------------------------------------------------------------------------------


def names_to_show(names: Texts, urgent: Collection[str]) -> Texts:
    """Subjects that a table shows: all, or only the `urgent` ones if there are many.

    Examples
    --------
    >>> names_to_show(["S2", "S1"], {"S1"}), names_to_show([*"abcdefghijklmnopqrstuvwxyz"], {"h"})
    (['S2', 'S1'], ['h'])
    """
    if len(names) < MANY_SUBJECTS:
        return names
    return [name for name in names if name in urgent]


def notes_of(rows: Iterable[Any]) -> list[Note]:
    """A note for each text in `row.notes` of the rows, as in ('A08', 'few trials.', '')."""
    notes = []
    for row in rows:
        notes += [(row.subject, f"{note}.", "") for note in row.notes]
    return notes


def merge_notes(notes: Iterable[Note]) -> list[tuple[list[str], str, str]]:
    """Notes with all their subjects. Notes with the same text and option become one.

    Examples
    --------
    >>> merge_notes([("A", "few trials", ""), ("B", "few trials", "")])
    [(['A', 'B'], 'few trials', '')]
    """
    # By text and option. Subjects are the keys of a dict, which has each once, in their order.
    subjects_by_note: dict[tuple[str, str], dict[str, None]] = {}
    for subject, text, option in notes:
        subjects = subjects_by_note.setdefault((text, option), {})
        if subject:  # '' is the subject of a note on all subjects
            subjects[subject] = None
    return [(list(subjects), *note) for note, subjects in subjects_by_note.items()]


def describe_study(study: Study) -> str:
    """The file of a study, and its amounts in the words of :func:`describe_amount`."""
    label = " (synthetic)" if study.synthetic and "synthetic" not in study.source else ""
    return f"{study.source}{label}: {describe_amount(study)}"


def describe_amount(study: Study) -> str:
    """Amounts of a study: '2 subjects, 1,300 trials, which was stronger (2AFC), 13 pairs'."""
    subjects = plural(len({subject.subject_name for subject in study}), "subject")
    if study.conditions is not None:
        subjects += f" in {len(study.conditions.levels)} conditions"
    trials = plural(sum(subject.total_trials for subject in study), "trial")
    tasks = join_words([part.task.title for part in study.by_task])
    pair_counts = {subject.n_pairs for subject in study}
    pairs = plural(max(pair_counts), "pair")
    if len(pair_counts) > 1:
        pairs = f"{min(pair_counts):,} to {pairs}"
    return f"{subjects}, {trials}, {tasks}, {pairs}"


# --- numbers --------------------------------------------------------------------------------------


def number(value: float | None) -> str:
    """A number of a table with two decimals; a dash for None and NaN."""
    return "-" if value is None or isnan(value) else f"{value:.2f}"


def without_zeros(text: str) -> str:
    """A text whose numbers between -1 and 1 have no zero before their point, and none is -0.

    Examples
    --------
    >>> without_zeros("-0.38 [-0.71, -0.00]"), without_zeros("10.5"), without_zeros("0")
    ('-.38 [-.71, .00]', '10.5', '0')
    """
    # Remove the sign of '-0.00', and the 0 of '0.38' but not that of '10.38'.
    return re.sub(r"-(?=0\.0+\b)|(?<![\d.])0(?=\.\d)", "", text)
