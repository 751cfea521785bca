"""The command line: parse, call, print. Our errors become one line per problem and exit code 2.

Exit codes: 0 done, 1 unexpected failure, 2 bad input or output,
3 done but some subject failed or its draws did not converge, or `calibrate` failed,
128 and its number after a signal.
"""

from __future__ import annotations

from typing import Annotated

import typer

from bayes_toe.cli import describe, draw, infer, planning, population, synthetic
from bayes_toe.cli.command import as_command
from bayes_toe.cli.stopping import main as main

#: By what they are for, in the order in which help lists them.
COMMANDS = {
    "A study, from answers to results": (
        describe.check,
        infer.run,
        infer.sample,
        infer.evidence,
        infer.compare,
        infer.sensitivity,
        population.population,
        describe.asymmetry,
        infer.fit,
    ),
    "Look at results, and publish them": (draw.explore, draw.corner, draw.figures, describe.predict, describe.methods),
    "Plan a study": (planning.power, planning.design, planning.trials),
    "Test the program": (synthetic.simulate, synthetic.calibrate),
}

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Bayesian inference for time-order effects in same/different judgements.\n\n"
    "[bold]Example[/bold]: bayes-toe run study.csv -o results",
)
for _purpose, _commands in COMMANDS.items():
    for _command in _commands:
        app.command(rich_help_panel=_purpose)(as_command(_command))


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    if version:
        from bayes_toe.version import __version__

        typer.echo(f"bayes-toe {__version__}")
        raise typer.Exit
