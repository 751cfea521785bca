"""The command line: parse, call, print. Our errors become one line per problem and exit code 2.

Exit codes: 0 done, 1 unexpected failure, 2 bad input or output,
3 done but some subject failed or its draws did not converge,
128 and its number after a signal.
"""

from __future__ import annotations

from typing import Annotated

import typer

import bayes_toe as bt
from bayes_toe.cli import compare, describe, infer, look, planning, population, synthetic
from bayes_toe.cli.stopping import main as main
from bayes_toe.cli.task import as_command

#: In the order in which help lists them: the way from answers to a paper, then all others.
COMMANDS = {
    "From answers to a paper": (
        describe.check,
        infer.run,
        compare.compare,
        look.explore,
        look.methods,
    ),
    "More": (
        infer.sample,
        infer.evidence,
        compare.contrast,
        compare.sensitivity,
        population.population,
        describe.asymmetry,
        describe.fit,
        look.corner,
        look.figures,
        look.predict,
        planning.power,
        planning.design,
        synthetic.simulate,
    ),
}

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Bayesian inference for time-order effects in comparing two stimuli.\n\n[bold]Example[/bold]: bayes-toe run study.csv -o results",
)
for _purpose, _commands in COMMANDS.items():
    for _command in _commands:
        app.command(rich_help_panel=_purpose)(as_command(_command))


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        typer.echo(f"bayes-toe {bt.__version__}")
        raise typer.Exit
