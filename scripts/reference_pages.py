"""Reference pages of the site that are made from the code: the command line, and the public names.

Text only; Sphinx is not needed.
"""

import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import typer.main

from bayes_toe.cli.app import COMMANDS, app

FACES = ("bayes_toe", "bayes_toe.plots", "bayes_toe.design", "bayes_toe.model")
HELP = "--help"


def command_reference() -> str:
    """Every command with its arguments and options, by what they are for, as Markdown."""
    commands = typer.main.get_command(app).commands
    purposes = {
        purpose: [function.__name__ for function in functions]
        for purpose, functions in COMMANDS.items()
    }
    return "\n\n".join(
        block
        for purpose, names in purposes.items()
        for block in (
            f"## {purpose}",
            *(part for name in names for part in _command(name, commands[name])),
        )
    )


def _command(name: str, command: Any) -> Iterator[str]:
    about, _, example = command.help.partition("[bold]Example[/bold]:")
    arguments = [one for one in command.params if one.param_type_name == "argument"]
    yield f"### {name}"
    yield " ".join(about.split())
    yield f"```sh\n{' '.join(example.split())}\n```"
    panels: dict[str, list[Any]] = {"Arguments": arguments, "Options": []}
    for one in command.params:
        if one not in arguments and HELP not in one.opts:
            panels.setdefault(getattr(one, "rich_help_panel", None) or "Options", []).append(one)
    for panel, rows in panels.items():
        if rows:
            yield "\n".join(
                [
                    f"| {panel} | |",
                    "|---|---|",
                    *(f"| {_spelt(one)} | {_said(one)} |" for one in rows),
                ]
            )


def _spelt(one: Any) -> str:
    """The option as it is typed, with what it takes."""
    words = one.metavar
    if one.param_type_name == "option":
        takes = "" if one.is_flag else f" {one.metavar or one.name.split('_')[-1].upper()}"
        words = " / ".join([", ".join(sorted(one.opts, key=len)), *one.secondary_opts]) + takes
    return f"`{words}`".replace("|", "\\|")


def _said(one: Any) -> str:
    known = (
        one.default is not None
        and one.default != ()
        and not callable(one.default)
        and not one.is_flag
    )
    default = f" Default: `{one.default}`." if known and one.param_type_name == "option" else ""
    text = " ".join((one.help or "").split()).replace("*", "\\*").replace("<", "\\<")
    text = re.sub(r"(?<![\w-])--[a-z][a-z-]*", r"`\g<0>`", text)
    return f"{text}{default}".replace("|", "\\|")


def name_reference(face: str) -> str:
    """All public names of a package: tables, then docstrings, as reStructuredText in Markdown."""
    package = import_module(face)
    kinds: dict[str, list[str]] = {
        "Functions": [],
        "Records": [],
        "Errors and warnings": [],
        "Values": [],
    }
    for name in package.__all__:
        value = getattr(package, name)
        if not inspect.ismodule(value):
            kinds[_kind(value)].append(name)
    return "\n\n".join(
        block for kind, names in kinds.items() if names for block in _names(face, kind, names)
    )


def _kind(value: Any) -> str:
    if inspect.isclass(value):
        return "Errors and warnings" if issubclass(value, Exception) else "Records"
    return "Functions" if callable(value) else "Values"


def _names(face: str, kind: str, names: list[str]) -> Iterator[str]:
    yield f"## {kind}"
    lines = [".. autosummary::", "   :nosignatures:", "", *(f"   ~{face}.{name}" for name in names)]
    directive = {"Functions": "autofunction", "Values": "autodata"}.get(kind, "autoclass")
    for name in names:
        lines += [
            "",
            f".. {directive}:: {face}::{name}",
            *(["   :members:"] if directive == "autoclass" else []),
        ]
    yield "\n".join(["```{eval-rst}", *lines, "```"])


def citation() -> str:
    """The file that is meant for programs, as it stands."""
    citation = Path(__file__).resolve().parents[1] / "CITATION.cff"
    return f"```yaml\n{citation.read_text(encoding='utf-8')}```"


#: What stands in a document for each page, and what it becomes.
MADE = {
    "<!-- the command line -->": command_reference,
    "<!-- CITATION.cff -->": citation,
    **{f"<!-- the names of {face} -->": (lambda face=face: name_reference(face)) for face in FACES},
}
