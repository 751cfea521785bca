"""The options that commands share, each declared once, and the study that a command is given."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, fields, replace
from functools import partial
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bayes_toe.errors import InputError

if TYPE_CHECKING:
    from bayes_toe.data.options import ReadOptions
    from bayes_toe.data.read_study import Truth
    from bayes_toe.data.study import Study


#: A whole number as help shows it.
NUMBER = "N"
#: An option without a value; an option that few need, which help has in a panel of its own.
flag: Any = partial(typer.Option, metavar="")
rare: Any = partial(typer.Option, rich_help_panel="Advanced")
#: The panel of options that only the help of `check` lists.
LAYOUT = "Files in another layout"


Seed = Annotated[
    int | None,
    typer.Option("--seed", min=0, metavar=NUMBER, help="Random seed, printed and stored."),
]
DrawCount = Annotated[
    int,
    rare("--draws", min=1, max=10**6, metavar=NUMBER, help="Effective draws."),
]
Processes = Annotated[
    int | None,
    rare("--workers", min=1, metavar=NUMBER, help="Processes (default: all cores)."),
]
DaskAddress = Annotated[
    str | None,
    rare("--dask", metavar="tcp://HOST:PORT", help="Use a Dask cluster."),
]
PriorFile = Annotated[
    str | None,
    typer.Option("--prior", metavar="PRIOR", help="Prior: default, paper, or a TOML file."),
]
SpreadsheetSafe = Annotated[
    bool,
    rare("--spreadsheet-safe", metavar="", help="Put ' before texts like formulas."),
]
Resume = Annotated[bool, flag("--resume", help="Continue a stopped command.")]
Overwrite = Annotated[bool, flag("--overwrite", help="Replace existing output.")]
Quiet = Annotated[bool, flag("--quiet", "-q", help="Print problems only.")]

SavedDraws = Annotated[
    Path, typer.Argument(metavar="posterior.nc", help="Draws saved by run or sample.")
]
TrueValues = Annotated[
    Path | None,
    rare("--truth", metavar="truth.csv", help="True values to mark, as simulate writes them."),
]
Question = Annotated[
    str,
    typer.Option(
        "--task",
        metavar="TASK",
        help="same/different (default) or 2afc.",
        show_default=False,
    ),
]
ModelName = Annotated[
    str,
    typer.Option(
        "--model",
        metavar="MODEL",
        help="none, constant-error, contraction, both or paper.",
    ),
]


def writes(metavar: str, help_text: str) -> Any:
    """The option that names what is written."""
    return typer.Option("-o", "--output", metavar=metavar, help=help_text)


def _how_to_read(name: str, help_text: str, metavar: str | None = None) -> Any:
    return typer.Option(name, metavar=metavar, help=help_text, rich_help_panel=LAYOUT)


#: The error of a command without a file; :func:`~bayes_toe.cli.task.as_command` adds what to type.
NO_FILE = "No file is named."
#: What `run` asks in a terminal.
WHICH_FILE = (
    "Which file? Type a name, or press Enter for the bundled example (12 synthetic\n"
    "subjects, about a minute): "
)


@dataclass(frozen=True, kw_only=True)
class StudyFile:
    """The study of a command: files and how to read them, or a bundled example."""

    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="STUDY.csv...",
            help="Files with columns subject,s1,s2,response.",
            show_default=False,
        ),
    ] = None
    example: Annotated[bool, flag("--example", help="Analyse the synthetic example.")] = False
    swap: Annotated[
        list[str] | None,
        typer.Option("--swap", metavar="A08:2,4", help="Swap a subject's responses; repeatable."),
    ] = None
    exclude: Annotated[
        list[str] | None,
        typer.Option(
            "--exclude", metavar="A08:2,4", help="Exclude a subject or blocks; repeatable."
        ),
    ] = None
    intensity: Annotated[
        float | None,
        _how_to_read("--intensity", "Read i1,i2: s = ln(i / REF).", "REF"),
    ] = None
    equal_code: Annotated[
        str | None, _how_to_read("--equal-code", "The code that means 'equal'.", "CODE")
    ] = None
    different_code: Annotated[
        str | None, _how_to_read("--different-code", "The code that means 'different'.", "CODE")
    ] = None
    second_code: Annotated[
        str | None, _how_to_read("--second-code", "The code that means 'second'.", "CODE")
    ] = None
    first_code: Annotated[
        str | None, _how_to_read("--first-code", "The code that means 'first'.", "CODE")
    ] = None
    correct: Annotated[
        str | None,
        _how_to_read("--correct", "Column with correct or wrong.", "COLUMN"),
    ] = None
    ignore: Annotated[
        list[str] | None,
        _how_to_read("--ignore", "Column to ignore; repeatable.", "COLUMN"),
    ] = None
    question: Annotated[
        str | None,
        _how_to_read("--task", "same/different or 2afc.", "TASK"),
    ] = None
    where: Annotated[
        list[str] | None,
        _how_to_read("--where", "Rows with this text; repeatable.", "COLUMN=TEXT"),
    ] = None
    subject_from: Annotated[
        str | None,
        _how_to_read("--subject-from", "Subject in the name: 'sub-{}_*'.", "NAME"),
    ] = None
    columns: Annotated[
        str | None,
        _how_to_read("--columns", "Your column names: s1=first,...", "OURS=THEIRS"),
    ] = None
    standard_interval: Annotated[
        str | None,
        _how_to_read("--standard-interval", "Column: the standard's interval.", "COLUMN"),
    ] = None
    standard_first: Annotated[
        bool,
        _how_to_read("--standard-first", "The standard was always first.", ""),
    ] = False
    comparison_code: Annotated[
        str | None,
        _how_to_read("--comparison-code", "Code that means 'comparison'.", "CODE"),
    ] = None
    decimal: Annotated[
        str | None,
        _how_to_read("--decimal", "Decimal sign: . or ,", "SIGN"),
    ] = None
    sheet: Annotated[str | None, _how_to_read("--sheet", "Sheet of an Excel file.", "NAME")] = None
    encoding: Annotated[
        str | None, _how_to_read("--encoding", "Such as cp1252 or latin-1.", "NAME")
    ] = None
    condition: Annotated[
        str | None,
        _how_to_read("--condition", "Column of the condition.", "COLUMN"),
    ] = None
    reference: Annotated[
        str | None,
        _how_to_read("--reference", "Level to compare others with.", "LEVEL"),
    ] = None
    named_levels: Annotated[
        bool,
        _how_to_read("--categorical-condition", "Take numeric levels as names.", ""),
    ] = False

    def truth(self) -> Truth:
        """True parameters of the paper's model, by subject; only one of the examples has them."""
        from bayes_toe.data.read_study import example_truth
        from bayes_toe.data.tasks import SAME_DIFFERENT, task_of

        is_paper = self.question is not None and task_of(self.question) == SAME_DIFFERENT
        return example_truth(SAME_DIFFERENT) if is_paper and self.example else {}

    def ask(self) -> StudyFile:
        """Ask in a terminal which file to read, if neither a file nor the example is named."""
        if self.files or self.example or not (sys.stdin.isatty() and sys.stdout.isatty()):
            return self
        given = typer.prompt(WHICH_FILE, default="", show_default=False, prompt_suffix="")
        name = given.strip().strip("'\"")  # terminals quote a file that is dragged into them
        if not name:
            return replace(self, example=True)
        return replace(self, files=[Path(name).expanduser()])

    def read(self) -> Study:
        """The study; errors name file, row, column, what was found and what is allowed."""
        from bayes_toe.data.options import changed
        from bayes_toe.data.read_study import example_study, read_study
        from bayes_toe.data.tasks import WHICH_STRONGER, task_of

        if self.example and self.files:
            raise InputError("--example and STUDY.csv exclude each other.")
        if not self.example and not self.files:
            raise InputError(NO_FILE)
        asked = None if self.question is None else task_of(self.question)
        if self.example:
            study = example_study(asked or WHICH_STRONGER)
        else:
            study = read_study(self._paths(), self._read_options())
        if asked not in (None, study.task):
            raise InputError(
                f"--task is {self.question!r}, but the responses in {study.source} are of the task "
                f"{study.task.name!r}."
            )
        return changed(study, self.swap or (), self.exclude or ())

    def _paths(self) -> list[Path]:
        """The files; some shells leave a name with * to the program."""
        paths = []
        for file in self.files or ():
            matches = [] if os.path.exists(file) else sorted(map(Path, glob(str(file))))
            paths += matches or [file]
        return paths

    def _read_options(self) -> ReadOptions:
        """How to read the files."""
        from bayes_toe.data.options import ReadOptions, parse_columns, parse_where

        options: dict[str, Any] = {
            field.name: getattr(self, field.name)
            for field in fields(ReadOptions)
            if hasattr(self, field.name)
        }
        options["columns"] = {} if self.columns is None else parse_columns(self.columns)
        options["where"] = parse_where(self.where or ())
        options["ignore"] = self.ignore or ()
        return ReadOptions(**options, categorical=self.named_levels)
