"""The options of the command line: what help says about them, and the options of a study.

`StudyFile` has the options that name the files of a study and say how to read them. It asks for a
file if none is given, and reads the study.
"""

from __future__ import annotations

import os
import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from glob import glob
from importlib.resources import files
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
#: The panel of options that only the help of `check` lists.
LAYOUT = "Files in another layout"
#: What help says about each option, by the function or the record that has the option.
HELP: dict[str, dict[str, Any]] = tomllib.loads(
    (files("bayes_toe.cli") / "options.toml").read_text(encoding="utf-8")
)
#: The options for files in another layout that are no texts.
_LAYOUT_KINDS: dict[str, Any] = {
    "intensity": Number,
    "missed": Texts,
    "ignore": Texts,
    "where": Texts,
    "columns": Texts,
    "standard_first": bool,
    "categorical_condition": bool,
}


def help_of(owner: str, name: str) -> dict[str, Any]:
    """What help says about an option of a function or a record."""
    return HELP["shared"].get(name, {}) | HELP.get(owner, {}).get(name, {})


def typed_option(
    parameter: Parameter,
    *,
    names: str = "",
    panel: str | None = None,
    writes: str = "",
    argument: bool = False,
    **settings: Any,
) -> Parameter:
    """A parameter as Typer makes an option, or an argument, of it; `settings` are Typer's."""
    if writes:
        settings["parser"] = {"file": file_name, "folder": folder_name}[writes]
    if argument:
        declaration = typer.Argument(**settings)
    else:
        option = names or f"--{parameter.name.replace('_', '-')}"
        declaration = typer.Option(*option.split(), rich_help_panel=panel, **settings)
    return parameter.replace(
        kind=Parameter.KEYWORD_ONLY, annotation=Annotated[parameter.annotation, declaration]
    )


def layout_options(command: str) -> Iterator[Parameter]:
    """The parameters that say how to read files in another layout; the help of `check` has them."""
    for name, settings in HELP["layout"].items():
        kind = _LAYOUT_KINDS.get(name, Text)
        default = False if kind is bool else None
        parameter = Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        yield typed_option(parameter, panel=LAYOUT, hidden=command != "check", **settings)


def complete_example(words: list[str]) -> list[str]:
    """The words of a command, in which `--example` without a task gets its default.

    Examples
    --------
    >>> complete_example(["--example", "-o", "results"])
    ['--example', '2afc', '-o', 'results']
    """
    if "--example" in words:
        from bayes_toe.data.tasks import task_named

        after = words.index("--example") + 1
        if task_named("".join(words[after : after + 1])) is None:
            words = [*words[:after], FIRST_EXAMPLE, *words[after:]]
    return words


def folder_name(value: str | Path) -> Path:
    """The name of a folder that is written; a default is a path already."""
    if str(value) == "-":
        raise typer.BadParameter("found '-', allowed: the name of a file or folder")
    return Path(value)


def file_name(value: str | Path) -> Path:
    """The name of a file that is written."""
    if str(value).endswith(("/", os.sep)):
        raise typer.BadParameter(f"found '{value}', allowed: the name of a file")
    return folder_name(value)


#: The error of a command without a file; :func:`~bayes_toe.cli.run_context.as_command` adds what to
#: type.
NO_FILE = "No file is named."
#: The task of the bundled example that `--example` alone means.
FIRST_EXAMPLE = "2afc"


@dataclass(frozen=True)
class StudyFile:
    """The study of a command: files and how to read them, or a bundled example.

    `reading` has the values of :func:`layout_options`.
    """

    files: list[Path] | None = None
    example: Text = None
    swap: Texts = None
    exclude: Texts = None
    reading: Mapping[str, Any] = field(default_factory=dict)

    def ask(self) -> StudyFile:
        """Ask in a terminal which file to read, if neither a file nor the example is named."""
        if self.files or self.example or not (sys.stdin.isatty() and sys.stdout.isatty()):
            return self
        typed = typer.prompt(
            "Which file? Type a name, or press Enter for the bundled example (12 synthetic\n"
            "subjects, about a minute): ",
            default="",
            show_default=False,
            prompt_suffix="",
        )
        name = typed.strip().strip("'\"")  # terminals quote a file that is dragged into them
        if not name:
            return replace(self, example=FIRST_EXAMPLE)
        return replace(self, files=[Path(name).expanduser()])

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

        question = self.reading.get("task")
        task = None if question is None else task_of(question)
        if self.example:
            study = example_study(task_of(self.example, "--example"))
        elif self.files:
            study = read_study(self._paths(), self._read_options())
        else:
            raise InputError(NO_FILE)

        if task not in (None, study.task):
            raise InputError(
                f"--task is {question!r}, but the responses in {study.source} are of the task "
                f"{study.task.name!r}."
            )
        return changed(study, self.swap or (), self.exclude or ())

    def data_files(self) -> tuple[Path, ...]:
        """The files of the study, with the tables of a folder in place of the folder."""
        from bayes_toe.data.study_files import table_files

        return tuple(table_files(self.files or ())[0])

    def _paths(self) -> list[Path]:
        """The files; some shells leave a name with * to the program."""
        paths = []
        for file in self.files or ():
            matches = [] if os.path.exists(file) else sorted(map(Path, glob(str(file))))
            paths += matches or [file]
        return paths

    def _read_options(self) -> ReadOptions:
        """The options of reading."""
        from bayes_toe.data.options import ReadOptions, parse_pairs

        options = {name: value for name, value in self.reading.items() if value is not None}
        options.pop("task", None)
        columns = ",".join(options.get("columns", ()))
        options["columns"] = parse_pairs("--columns", filter(None, columns.split(",")), "OURS=NAME")
        options["where"] = parse_pairs("--where", options.get("where", ()), "COLUMN=TEXT")
        categorical = options.pop("categorical_condition", False)
        return ReadOptions(**options, categorical=categorical)
