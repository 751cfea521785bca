"""How a function becomes a command: records of options become options, our errors become lines and an exit code."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import Any, get_type_hints

import typer

from bayes_toe.cli.options import LAST_IN_HELP
from bayes_toe.data.messages import visible
from bayes_toe.data.unfinished import said_kept, under_way
from bayes_toe.errors import BayesToeError

BAD_INPUT = 2
#: The field of a task that holds the files that its command reads.
INPUTS = "inputs"


def as_command(function: Callable[..., None]) -> Callable[..., None]:
    """The function as the command line calls it.

    A parameter whose type is a dataclass becomes one option for each of its fields, and the function receives the record of them. Our
    errors become lines on standard error and an exit code.
    """
    signature = inspect.signature(function, eval_str=True)
    records: dict[str, Any] = {name: one.annotation for name, one in signature.parameters.items() if is_dataclass(one.annotation)}

    @wraps(function)
    def command(**given: Any) -> None:
        read = _read(given)
        made = {
            name: kind(**{one.name: read if _told(one) else given.pop(one.name) for one in fields(kind)}) for name, kind in records.items()
        }
        with _problems_as_lines():
            function(**given, **made)

    parameters = [option for one in signature.parameters.values() for option in _options(one)]
    command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {one.name: one.annotation for one in parameters}
    return command


def _options(parameter: inspect.Parameter) -> list[inspect.Parameter]:
    """The parameter itself, or one for each field where it is a record."""
    kind = parameter.annotation
    if not is_dataclass(kind):
        return [parameter]
    hints = get_type_hints(kind, include_extras=True)
    return [
        inspect.Parameter(one.name, parameter.KEYWORD_ONLY, default=_default(one), annotation=hints[one.name])
        for one in sorted(fields(kind), key=_place)
        if not _told(one)
    ]


def _told(field: Field[Any]) -> bool:
    """Whether a field is no option, but what the others say of the files that are read."""
    return field.name == INPUTS


def _read(given: Mapping[str, Any]) -> tuple[Path, ...]:
    """The files that a command was given to read: all but those whose parameter is called output."""
    values = (value if isinstance(value, list) else [value] for name, value in given.items() if not name.endswith("output"))
    return tuple(one for some in values for one in some if isinstance(one, Path))


def _place(field: Field[Any]) -> int:
    """Options that many commands have come last, in their own order; the others stay as they are."""
    return LAST_IN_HELP.index(field.name) if field.name in LAST_IN_HELP else -1


def _default(field: Field[Any]) -> Any:
    return inspect.Parameter.empty if field.default is MISSING else field.default


@contextmanager
def _problems_as_lines() -> Iterator[None]:
    """Our own errors as lines on standard error and exit code 2; anything else is a bug and shows its traceback."""
    under_way.clear()  # what an earlier call in this process has kept is not this command's
    try:
        yield
    except BayesToeError as error:
        kept = said_kept()
        for line in f"{error}; {kept}".split("\n") if kept else str(error).split("\n"):
            typer.echo(f"error: {visible(line)}", err=True)
        raise typer.Exit(BAD_INPUT) from error
