"""The command line: parse, call, print. Our errors become one line per problem and exit code 2.

Exit codes: 0 done, 1 unexpected failure, 2 bad input or output,
3 done but some subject failed or its draws did not converge,
128 and its number after a signal.
"""

from __future__ import annotations

from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

import bayes_toe as bt
from bayes_toe.cli import (
    describe,
    design_commands,
    group_commands,
    infer,
    look,
)
from bayes_toe.cli.options import LAYOUT
from bayes_toe.cli.task import BAD_INPUT, as_command, print_labelled
from bayes_toe.cli.terminal import TYPED

#: In the order in which help lists them.
COMMANDS = {
    "One study": (
        describe.check,
        infer.run,
        infer.sample,
        infer.evidence,
        look.corner,
        look.explore,
        describe.fit,
        look.app,
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

#: Names of commands that are gone, with what to type instead.
RETIRED_COMMANDS = {
    "asymmetry": "`bayes-toe fit STUDY.csv --asymmetry asymmetry.csv`",
    "compare": "`bayes-toe evidence` compares the models of the order effect, "
    "`bayes-toe history` those of serial dependence",
    "figures": "`bayes-toe run STUDY.csv --paper-figures` writes the paper's figures",
    "methods": "`bayes-toe run` writes methods.md",
    "predict": "`bt.predict` in Python",
    "sensitivity": "`bayes-toe evidence --prior prior.toml` gives the answers under another prior",
}
#: Options that are gone, by their command, with what to type instead.
RETIRED_OPTIONS = {
    "contrast": {
        "--model": "omit it, because every condition has a constant error and a contraction"
    },
    "evidence": {
        "--more-trials": "`bayes-toe power design.csv --trials 650,1300` estimates what more trials show",
    },
    "explore": {
        "--population": "`bayes-toe population` draws the subjects of a group in population.png",
    },
    "design": {
        "--isi": "omit it, because a design is for one interval between the stimuli",
    },
    "population": {
        "--correlations": "omit it, because parameters are independent between subjects",
        "--no-correlations": "omit it, because parameters are independent between subjects",
        "--model": "omit it, because a group is analysed by the observer with both effects",
        "--population": "omit it, because subjects are normally distributed",
        "--posterior": "omit it, because the group does not need draws of its subjects",
        "--prior": "`--hyperprior FILE.toml` changes the prior of a group",
        "--resume": "omit it, because a group takes less than a minute",
    },
    "power": {
        "--carry-over": "omit it, because `bayes-toe power` plans for the order effect alone",
        "--differ": "`bayes-toe simulate --conditions a,b --differ contraction=0.2`, then "
        "`bayes-toe contrast`",
        "--look": "omit it, because `bayes-toe power` simulates fixed numbers of trials",
        "--population": "`bayes-toe simulate --population both`, then `bayes-toe population`",
        "--resume": "omit it, because `bayes-toe power` takes minutes",
        "--stop": "omit it, because `bayes-toe power` simulates fixed numbers of trials",
        "--studies": "`bayes-toe simulate --population both`, then `bayes-toe population`",
        "--subjects": "omit it, because `bayes-toe power` is about single subjects",
    },
    "simulate": {
        "--prior": "omit it, because `--population prior` is the default prior of the four models",
    },
    "run": {
        "--population": "omit it, because run fits the group from six interpretable subjects on",
        "--store": "omit it, because draws are written to posterior.nc",
    },
}
#: Options of every command that are gone.
RETIRED_EVERYWHERE = dict.fromkeys(("--engine", "--scheduler"), "`--dask tcp://HOST:PORT`")
#: Former names of options, which still work, with their names today.
FORMER_OPTIONS = {"--turn": "--swap", "--leave-out": "--exclude", "--pictures": "--figures"}


class Commands(TyperGroup):
    """The commands; a retired name or option gets one line that says what to type instead."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that the first argument names."""
        command, *given = args
        words = [_present_name(word) for word in given]
        TYPED[:] = [command, *words]
        if command in RETIRED_COMMANDS:
            refuse_retired(command, RETIRED_COMMANDS[command])
        retired = RETIRED_OPTIONS.get(command, {}) | RETIRED_EVERYWHERE
        for word in words:
            option = word.partition("=")[0]
            if option in retired:
                refuse_retired(option, retired[option])
        return super().resolve_command(ctx, [command, *words])


class Command(TyperCommand):
    """A command whose help is one screen: only `check` lists how to read files in other layouts."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help."""
        parameters: list[Any] = self.get_params(ctx)
        for parameter in parameters:
            if parameter.param_type_name == "argument" or parameter.name == "help":
                # Otherwise the help shows Python's type, `<list[Path]>`.
                parameter.display_type_rich = lambda ctx: ""
            if self.name != "check" and getattr(parameter, "rich_help_panel", None) == LAYOUT:
                parameter.hidden = True
                self.epilog = "Files in another layout, other codes: bayes-toe check --help"
        super().format_help(ctx, formatter)


def _present_name(word: str) -> str:
    """A word of the command line, with the present name of an option in place of a former one."""
    option, equals, value = word.partition("=")
    return f"{FORMER_OPTIONS.get(option, option)}{equals}{value}"


def refuse_retired(name: str, instead: str) -> NoReturn:
    """Say that a name is gone and what to type instead, and end with the exit code of bad input."""
    print_labelled("error:", f"`{name}` is retired: {instead}")
    raise typer.Exit(BAD_INPUT)


app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Bayesian inference for time-order effects in comparing two stimuli.\n\n[bold]Example[/bold]: bayes-toe run study.csv -o results",
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
