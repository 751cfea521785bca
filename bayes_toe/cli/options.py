"""The options that commands share, each declared once, and the study that a command is given."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, fields, replace
from functools import partial
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from bayes_toe.errors import InputError

if TYPE_CHECKING:
    from bayes_toe.data.read_study import Truth
    from bayes_toe.data.study import Study


#: What may be given as a prior.
PRIOR_HELP = (
    "default (scales are those of the stimuli), paper (H1's as in the paper), "
    "or a file with sections such as noise, contraction and paper: docs/model.md."
)


#: An option that few need: help has it in a panel of its own.
rare: Any = partial(typer.Option, rich_help_panel="Advanced")


Seed = Annotated[
    int | None,
    typer.Option("--seed", min=0, help="Root seed; without it fresh entropy, printed and stored."),
]
DrawCount = Annotated[
    int, rare("--draws", min=1, max=10**6, help="Effective draws to reach for every parameter.")
]
Processes = Annotated[
    int | None,
    typer.Option(
        "--workers",
        min=1,
        help="Processes; default one per processor. The numbers do not depend on it.",
    ),
]
Engine = Annotated[
    Literal["local", "dask"],
    rare("--engine", help="Processes of this machine, or the workers of a Dask cluster."),
]
Scheduler = Annotated[
    str | None, rare("--scheduler", metavar="tcp://HOST:PORT", help="That of the Dask cluster.")
]
PriorFile = Annotated[
    str | None, typer.Option("--prior", metavar="default|paper|prior.toml", help=PRIOR_HELP)
]
SpreadsheetSafe = Annotated[
    bool,
    rare(
        "--spreadsheet-safe",
        help="An apostrophe before texts in tables that a spreadsheet would run (=, +, -, @).",
    ),
]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="Continue a stopped command from OUTPUT.partial.",
    ),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace outputs that exist.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print problems only.")]

SavedDraws = Annotated[
    Path, typer.Argument(metavar="posterior.nc", help="Draws written by run or sample.")
]
TrueValues = Annotated[
    Path | None,
    rare(
        "--truth",
        metavar="truth.csv",
        help="Known values to mark, as simulate writes them: columns subject, mu1, gain, ...",
    ),
]
Question = Annotated[
    str,
    typer.Option(
        "--task", metavar="same/different|2afc", help="What is asked; 2afc: which is stronger."
    ),
]
ModelName = Annotated[
    str,
    typer.Option(
        "--model",
        metavar="none|constant-error|contraction|both|paper",
        help="One of the four models of the observer, or the paper's (H1).",
    ),
]


def writes(metavar: str, help_text: str) -> Any:
    """The option that names what is written."""
    return typer.Option("-o", "--output", metavar=metavar, help=help_text)


def _how_to_read(name: str, help_text: str, metavar: str | None = None) -> Any:
    return typer.Option(
        name, metavar=metavar, help=help_text, rich_help_panel="Files in another layout"
    )


_WHOSE = "SUBJECT[:BLOCK,...]"
#: The error of a command without a file; :func:`~bayes_toe.cli.task.as_command` adds what to type.
NO_FILE = "No file is named."
#: What `run` asks in a terminal.
WHICH_FILE = (
    "Which file? Type a name, or press Enter for the bundled example (12 synthetic\n"
    "subjects, half a minute): "
)


@dataclass(frozen=True, kw_only=True)
class StudyFile:
    """The study of a command: files and how to read them, or a bundled example."""

    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="STUDY.csv...",
            help="Trials (subject,s1,s2,response) or counts "
            "(subject,s1,s2,n_equal|n_second,n_trials), CSV, .parquet or .mat, one or more.",
            show_default=False,
        ),
    ] = None
    example: Annotated[
        bool,
        typer.Option("--example", help="Analyse the bundled example, synthetic, and no file."),
    ] = False
    intensity: Annotated[
        float | None,
        _how_to_read("--intensity", "Columns i1,i2 hold raw amplitudes; s = ln(i / REF).", "REF"),
    ] = None
    equal_code: Annotated[
        str | None, _how_to_read("--equal-code", "The response that means 'equal'.")
    ] = None
    different_code: Annotated[
        str | None, _how_to_read("--different-code", "The response that means 'different'.")
    ] = None
    second_code: Annotated[
        str | None, _how_to_read("--second-code", "The response that means 'second'.")
    ] = None
    first_code: Annotated[
        str | None, _how_to_read("--first-code", "The response that means 'first'.")
    ] = None
    correct: Annotated[
        str | None,
        _how_to_read(
            "--correct",
            "A column that says right or wrong: second or first by the sign of s2 - s1.",
            "COLUMN",
        ),
    ] = None
    ignore: Annotated[
        list[str] | None,
        _how_to_read(
            "--ignore",
            "A column that is not read: isi pools pairs over it; repeatable.",
            "isi|block|trial|condition",
        ),
    ] = None
    question: Annotated[
        str | None,
        typer.Option(
            "--task",
            metavar="same/different|2afc",
            help="With --example: which one; else what the file must be.",
        ),
    ] = None
    where: Annotated[
        list[str] | None,
        _how_to_read("--where", "Only rows with TEXT in this column; repeatable.", "COLUMN=TEXT"),
    ] = None
    subject_from: Annotated[
        str | None,
        _how_to_read(
            "--subject-from",
            "The subject stands in the file's name, at {}, e.g. 'sub-{}_*.tsv'.",
            "NAME",
        ),
    ] = None
    columns: Annotated[
        str | None,
        _how_to_read(
            "--columns", "Other column names, e.g. subject=participant,s1=first.", "OURS=THEIRS,..."
        ),
    ] = None
    condition: Annotated[
        str | None,
        typer.Option(
            "--condition",
            metavar="COLUMN",
            help="A condition that differs within subjects; default: a column condition.",
        ),
    ] = None
    reference: Annotated[
        str | None,
        typer.Option(
            "--reference", metavar="LEVEL", help="The level with which others are compared."
        ),
    ] = None
    named_levels: Annotated[
        bool,
        rare(
            "--categorical-condition",
            help="Numbers of the condition are names of levels: no slope.",
        ),
    ] = False
    swap: Annotated[
        list[str] | None,
        typer.Option(
            "--swap", metavar=_WHOSE, help="Exchange the two responses, in these blocks or all."
        ),
    ] = None
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude", metavar=_WHOSE, help="Exclude a subject, or these blocks."),
    ] = None

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
        from bayes_toe.data.options import ReadOptions, changed, parse_columns, parse_where
        from bayes_toe.data.read_study import example_study, read_study
        from bayes_toe.data.tasks import WHICH_STRONGER, task_of

        asked = None if self.question is None else task_of(self.question)
        if self.example and self.files:
            raise InputError("--example: found with STUDY.csv, allowed: one of the two")
        if self.example:
            study = example_study(asked or WHICH_STRONGER)
            return changed(study, self.swap or (), self.exclude or ())
        if not self.files:
            raise InputError(NO_FILE)
        given: dict[str, Any] = {
            one.name: getattr(self, one.name, None) for one in fields(ReadOptions)
        }
        given |= {
            "columns": {} if self.columns is None else parse_columns(self.columns),
            "where": parse_where(self.where or ()),
        }
        options = ReadOptions(
            **given | {"ignore": self.ignore or (), "categorical": self.named_levels}
        )
        # Some shells leave a name with * to us.
        found = [
            [one] if os.path.exists(one) else sorted(map(Path, glob(str(one)))) or [one]
            for one in self.files
        ]
        study = read_study([path for paths in found for path in paths], options)
        if asked not in (None, study.task):
            raise InputError(
                f"--task: found {self.question!r}, allowed: {study.task.name!r}, which the answers in {study.source} are of"
            )
        return changed(study, self.swap or (), self.exclude or ())
