"""The Typer program of the command line: its commands, and the layout of the help.

Exit codes: 0 done, 1 unexpected failure, 2 bad input or output, 3 done but some subject failed or
its draws did not converge (see `run_context.py`), 128 + n after signal n (see `entry_point.py`).
"""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperCommand

import bayes_toe as bt
from bayes_toe.cli import (
    design_commands,
    group_commands,
    inference_commands,
    study_commands,
    view_commands,
)
from bayes_toe.cli.options import LAYOUT, complete_example
from bayes_toe.cli.run_context import as_command
from bayes_toe.cli.terminal import TYPED_WORDS

#: The commands by their purpose, in the order in which help lists them.
COMMANDS = {
    "One study": (
        study_commands.check,
        inference_commands.run,
        inference_commands.sample,
        inference_commands.evidence,
        view_commands.corner,
        view_commands.explore,
        study_commands.fit,
        view_commands.app,
    ),
    "Groups, conditions, trial order": (
        group_commands.population,
        group_commands.contrast,
        group_commands.history,
    ),
    "Before a study": (
        design_commands.design,
        design_commands.power,
        design_commands.simulate,
    ),
}


class Command(TyperCommand):
    """A command whose help is one screen: only `check` lists how to read files in other layouts."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Store the words in `TYPED_WORDS`, and read the options; `--example` may lack a value."""
        TYPED_WORDS[:] = [str(self.name), *args]
        return super().parse_args(ctx, complete_example(args))

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, without the options for other layouts unless it is that of `check`."""
        parameters: list[Any] = self.get_params(ctx)
        for parameter in parameters:
            if parameter.param_type_name == "argument" or parameter.name == "help":
                # Otherwise the help shows Python's type, `<list[Path]>`.
                parameter.display_type_rich = lambda ctx: ""
            # The other commands hide the options for other layouts, and name `check`.
            if self.name != "check" and getattr(parameter, "rich_help_panel", None) == LAYOUT:
                parameter.hidden = True
                self.epilog = "Files in another layout, other codes: bayes-toe check --help"
        super().format_help(ctx, formatter)


app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Bayesian inference for time-order effects in comparing two stimuli.\n\n"
    "[bold]Example[/bold]: bayes-toe run study.csv -o results",
)
for _purpose, _commands in COMMANDS.items():
    for _command in _commands:
        app.command(cls=Command, rich_help_panel=_purpose)(as_command(_command))


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        typer.echo(f"bayes-toe {bt.__version__}")
        raise typer.Exit
