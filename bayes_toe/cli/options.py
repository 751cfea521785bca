"""What the commands have in common: options that many of them take, how a study is named and read, problems as lines."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bayes_toe.errors import BayesToeError
from bayes_toe.model.prior_fields import PriorFields

if TYPE_CHECKING:
    from bayes_toe.data.study import Study

Command = Callable[..., None]

Seed = Annotated[int | None, typer.Option("--seed", min=0, help="Root seed; without it fresh entropy, printed and stored.")]
DrawCount = Annotated[int, typer.Option("--draws", min=1, max=10**6, help="Effective draws to reach for every parameter.")]
Workers = Annotated[
    int | None, typer.Option("--workers", min=1, help="Processes; default one per processor. The numbers do not depend on it.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace outputs that exist.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print problems only.")]


def prior_help(kind: type[PriorFields] = PriorFields) -> str:
    """What a prior file may hold, for the help text of --prior.

    Examples
    --------
    >>> prior_help()
    'Prior: any of mu1_mean, mu1_sd, sigma_p_scale; see check --prior.'
    """
    return f"Prior: any of {', '.join(one.name for one in kind.declared())}; see check --prior."


PriorFile = Annotated[Path | None, typer.Option("--prior", metavar="prior.toml", help=prior_help())]


@dataclass(frozen=True)
class StudyFile:
    """The study that a command was given, with the options of reading it; path None is the bundled example."""

    path: Path | None
    intensity: float | None
    equal_code: str | None
    different_code: str | None
    columns: str | None

    def read(self) -> Study:
        """The study; errors name file, row, column, what was found and what is allowed."""
        if self.path is None:
            from bayes_toe.data.example import example_study

            return example_study()
        from bayes_toe.data.read_options import ReadOptions, parse_columns
        from bayes_toe.data.read_study import read_study

        columns = {} if self.columns is None else parse_columns(self.columns)
        options = ReadOptions(intensity=self.intensity, equal_code=self.equal_code, different_code=self.different_code, columns=columns)
        return read_study(self.path, options)


class StudyFileOrExample(StudyFile):
    """The same where no file may be named."""


_FILE = Annotated[
    Path, typer.Argument(metavar="STUDY.csv", help="Trials (subject,s1,s2,response) or counts (subject,s1,s2,n_equal,n_trials).")
]
_FILE_OR_EXAMPLE = Annotated[Path | None, typer.Argument(metavar="[STUDY.csv]", help="Trials or counts; none means the bundled example.")]


def _how_to_read(name: str, help_text: str, metavar: str | None = None) -> Any:
    return typer.Option(name, metavar=metavar, help=help_text, rich_help_panel="Files in another layout")


_READING: dict[str, Any] = {
    "intensity": Annotated[float | None, _how_to_read("--intensity", "Columns i1,i2 hold raw amplitudes; s = ln(i / REF).", "REF")],
    "equal_code": Annotated[str | None, _how_to_read("--equal-code", "The response that means 'equal'.")],
    "different_code": Annotated[str | None, _how_to_read("--different-code", "The response that means 'different'.")],
    "columns": Annotated[
        str | None, _how_to_read("--columns", "Other column names, e.g. subject=participant,s1=first.", "OURS=THEIRS,...")
    ],
}


def as_command(function: Command) -> Command:
    """The function as the command line calls it.

    A parameter `study` of type :class:`StudyFile` or :class:`StudyFileOrExample` becomes the file and the options of reading it, and
    our errors become lines on standard error and an exit code.
    """
    signature = inspect.signature(function, eval_str=True)
    kind = signature.parameters["study"].annotation if "study" in signature.parameters else None

    @wraps(function)
    def command(**given: Any) -> None:
        if kind is not None:
            given["study"] = kind(given["study"], **{name: given.pop(name) for name in _READING})
        with _problems_as_lines():
            function(**given)

    parameters = list(signature.parameters.values()) if kind is None else _with_reading(signature, kind)
    command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {one.name: one.annotation for one in parameters}
    return command


def _with_reading(signature: inspect.Signature, kind: type[StudyFile]) -> list[inspect.Parameter]:
    """The parameters with `study` as a path, optional or not, and the options of reading it."""
    optional = kind is StudyFileOrExample
    study = signature.parameters["study"].replace(
        annotation=_FILE_OR_EXAMPLE if optional else _FILE, default=None if optional else inspect.Parameter.empty
    )
    others = [one for one in signature.parameters.values() if one.name != "study"]
    style = inspect.Parameter.KEYWORD_ONLY
    reading = [inspect.Parameter(name, style, default=None, annotation=option) for name, option in _READING.items()]
    return [study, *others, *reading]


@contextmanager
def _problems_as_lines() -> Iterator[None]:
    """Our own errors as lines on standard error and exit code 2; anything else is a bug and shows its traceback."""
    try:
        yield
    except BayesToeError as error:
        for line in str(error).splitlines():
            typer.echo(f"error: {line}", err=True)
        raise typer.Exit(2) from error
    except KeyboardInterrupt:
        typer.echo("interrupted: nothing was written", err=True)
        raise typer.Exit(130) from None
