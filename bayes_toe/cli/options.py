"""The command-line options that several commands share, each declared once.

`StudyFile` has the options that name the files of a study and say how to read them. It asks for a
file if none is given, and reads the study.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from glob import glob
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bayes_toe.errors import InputError

if TYPE_CHECKING:
    from bayes_toe.data.options import ReadOptions
    from bayes_toe.data.study import Study


#: Options that may be absent.
Text = str | None
Texts = list[str] | None
File = Path | None
Number = float | None
#: A number as help shows it.
NUMBER = "N"
#: The panel of options that only the help of `check` lists.
LAYOUT = "Files in another layout"


def option(name: str, metavar: str, help_text: str, panel: str | None = None, **limits: Any) -> Any:
    """An option with a value, in a panel of help."""
    return typer.Option(name, metavar=metavar, help=help_text, rich_help_panel=panel, **limits)


def flag(name: str, help_text: str) -> Any:
    """An option without a value."""
    return option(name, "", help_text)


#: An option in the panel of advanced options, which few users need.
rare = partial(option, panel="Advanced")

DrawCount = Annotated[int, rare("--draws", NUMBER, "Number of effective draws.", min=1, max=10**6)]
TrueValues = Annotated[
    File, rare("--truth", "truth.csv", "True values to mark, as simulate writes them.")
]
Question = Annotated[
    str,
    option(
        "--task",
        "TASK",
        "2afc (default), same/different, ternary",
        show_default=False,
    ),
]


def complete_example(words: list[str]) -> list[str]:
    """The words of a command, with the default task after an `--example` that has none.

    Examples
    --------
    >>> complete_example(["--example", "-o", "results"])
    ['--example', '2afc', '-o', 'results']
    """
    from bayes_toe.data.tasks import task_named

    if "--example" not in words:
        return words
    i = words.index("--example") + 1
    next_word = "".join(words[i : i + 1])  # '' after the last word
    if task_named(next_word) is None:
        return [*words[:i], FIRST_EXAMPLE, *words[i:]]
    return words


def writes(metavar: str, help_text: str) -> Any:
    """The option --output; `metavar` is 'DIR' for a folder, or a name such as 'FILE.csv'."""
    parser = folder_name if metavar == "DIR" else file_name
    return typer.Option("-o", "--output", metavar=metavar, help=help_text, parser=parser)


def folder_name(value: str | Path) -> Path:
    """Parse the name of a folder that is written. Typer gives a default as a path."""
    if str(value) == "-":
        raise typer.BadParameter("found '-', allowed: the name of a file or folder")
    return Path(value)


def file_name(value: str | Path) -> Path:
    """Parse the name of a file that is written; '.' is no name of a file."""
    if str(value).endswith(("/", os.sep)) or not Path(value).name:
        raise typer.BadParameter(f"found '{value}', allowed: the name of a file")
    return folder_name(value)


#: Outputs that several commands have.
OutputFolder = Annotated[Path, writes("DIR", "Output folder.")]
OutputTable = Annotated[Path, writes("FILE.csv", "Output table.")]
OutputTableAndFigure = Annotated[Path, writes("FILE.csv", "Output table. The figure is FILE.png.")]
#: The error of a command without a file; :func:`~bayes_toe.cli.run_context.as_command` adds what to
#: type.
NO_FILE = "No file is named."
#: The task of the bundled example that `--example` alone means.
FIRST_EXAMPLE = "2afc"
#: The options for files in another layout, each with the type, the sign and the help of its value.
LAYOUT_OPTIONS = {
    "intensity": (Number, "REF", "Intensities: s = ln(i / REF)."),
    "unit": (Text, "UNIT", "Unit: dB, cents, ln, g, Hz, ..."),
    "equal_code": (Text, "CODE", "The code for 'equal'."),
    "different_code": (Text, "CODE", "The code for 'different'."),
    "second_code": (Text, "CODE", "The code for 'second'."),
    "first_code": (Text, "CODE", "The code for 'first'."),
    "correct": (Text, "COLUMN", "Column with correct or wrong."),
    "missed": (Texts, "CODE", "The code of missed trials."),
    "ignore": (Texts, "COLUMN", "Column to ignore; repeatable."),
    "task": (Text, "TASK", "same/different, 2afc or ternary."),
    "where": (Texts, "COLUMN=TEXT", "Rows to read; repeatable."),
    "subject_from": (Text, "NAME", "Subject in the name: 'sub-{}_*'."),
    "columns": (Texts, "OURS=THEIRS", "Your column names: s1=first,..."),
    "standard_interval": (Text, "COLUMN", "Interval of the standard."),
    "comparison_interval": (Text, "COLUMN", "Interval of the comparison."),
    "standard_first_code": (Text, "CODE", "The code for 'standard first'."),
    "standard_first": (bool, "", "The standard was always first."),
    "comparison_code": (Text, "CODE", "The code for 'comparison'."),
    "wide": (Text, "PATTERN", "Pairs as '{first}_{second}'."),
    "decimal": (Text, "SIGN", "Decimal sign: . or ,"),
    "sheet": (Text, "NAME", "Excel sheet, or '{}' for all."),
    "encoding": (Text, "NAME", "Encoding, such as cp1252."),
    "condition": (Text, "COLUMN", "Column of the condition."),
    "reference": (Text, "LEVEL", "Level to compare others with."),
    "categorical_condition": (bool, "", "Take numeric levels as names."),
}


def layout_options() -> Iterator[Parameter]:
    """Yield a parameter of a command for each of :data:`LAYOUT_OPTIONS`."""
    for name, (kind, metavar, help_text) in LAYOUT_OPTIONS.items():
        layout_option = option(f"--{name.replace('_', '-')}", metavar, help_text, LAYOUT)
        yield Parameter(
            name,
            Parameter.KEYWORD_ONLY,
            default=False if kind is bool else None,
            annotation=Annotated[kind, layout_option],
        )


@dataclass(frozen=True)
class StudyFile:
    """The study of a command: files and how to read them, or a bundled example.

    `reading` has the values of :data:`LAYOUT_OPTIONS`.
    """

    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="STUDY.csv...",
            help="Files with columns subject,s1,s2,response.",
            show_default=False,
        ),
    ] = None
    example: Annotated[
        Text, option("--example", "TASK", "Example data: 2afc or same-different.")
    ] = None
    swap: Annotated[
        Texts, option("--swap", "A08:2,4", "Swap a subject's responses; repeatable.")
    ] = None
    exclude: Annotated[
        Texts, option("--exclude", "A08:2,4", "Exclude a subject or blocks; repeatable.")
    ] = None
    reading: Mapping[str, Any] = field(default_factory=dict)

    def read(self) -> Study:
        """The study; errors name file, row, column, what was found and what is allowed."""
        from bayes_toe.data.options import changed
        from bayes_toe.data.read_study import example_study, read_study
        from bayes_toe.data.tasks import task_of

        if self.example and self.files:
            raise InputError(
                "--example and STUDY.csv exclude each other. "
                "Allowed: --example 2afc, --example same-different."
            )
        # A wrong name of a task is refused before a file is read, which may take a while.
        typed_task = self.reading.get("task")  # None without --task
        task = None if typed_task is None else task_of(typed_task)

        if self.example:
            study = example_study(task_of(self.example, "--example"), self._read_options())
        elif self.files:
            study = read_study(self._paths(), self._read_options())
        else:
            raise InputError(NO_FILE)
        if task not in (None, study.task):
            raise InputError(
                f"--task is {typed_task!r}, but the responses in {study.source} are of the task "
                f"{study.task.name!r}."
            )
        return changed(study, self.swap or (), self.exclude or ())

    def data_files(self) -> tuple[Path, ...]:
        """The files that the command reads: a folder stands for the tables in it."""
        from bayes_toe.data.study_files import table_files

        return tuple(table_files(self._paths())[0])  # without the notes on folders

    def _paths(self) -> list[Path]:
        """The files. A name with *, which the shell has not replaced, means all matching files."""
        paths = []
        for file in self.files or ():
            # A file that exists is meant itself, even if its name has a '*'.
            matches = [] if os.path.exists(file) else sorted(map(Path, glob(str(file))))
            paths += matches or [file]  # Without a match, the reader says that there is no file.
        return paths

    def _read_options(self) -> ReadOptions:
        """The typed options of :data:`LAYOUT_OPTIONS` as the options of reading."""
        from bayes_toe.data.options import ReadOptions, parse_columns, parse_pairs

        options = {name: value for name, value in self.reading.items() if value is not None}
        options.pop("task", None)  # `read` compares it with the task of the responses.
        options["categorical"] = options.pop("categorical_condition", False)
        options["columns"] = parse_columns(",".join(options.get("columns", ())))
        options["where"] = parse_pairs(
            "--where", options.get("where", ()), "COLUMN=TEXT", may_be_empty=True
        )
        return ReadOptions(**options)
