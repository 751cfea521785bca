"""Functions become commands: records of options become options, in one order; errors become lines and exit codes."""

import inspect
from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from bayes_toe.cli.app import COMMANDS
from bayes_toe.cli.command import as_command
from bayes_toe.cli.options import LAST_IN_HELP, Quiet, Seed, StudyFile
from bayes_toe.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Recipe:
    quiet: Quiet = False
    sugar: Annotated[int, typer.Option("--sugar")] = 3
    seed: Seed = None


def program(function):
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(as_command(function))
    return lambda *args: CliRunner().invoke(app, [str(arg) for arg in args])


def names(function):
    return list(inspect.signature(as_command(function)).parameters)


def test_a_record_becomes_its_fields_shared_options_last_and_comes_back_whole():
    received = []

    def bake(*, flour: Annotated[int, typer.Option("--flour")] = 1, recipe: Recipe):
        received.append((flour, recipe))

    assert names(bake) == ["flour", "sugar", "seed", "quiet"]
    assert program(bake)("--flour", 2, "--sugar", 5, "-q").exit_code == 0
    assert received == [(2, Recipe(quiet=True, sugar=5, seed=None))]


def test_a_field_without_a_default_is_required():
    def read(*, study: StudyFile):
        raise AssertionError

    assert "Missing argument" in program(read)().output


def test_problems_are_lines_and_a_code():
    def fail(*, recipe: Recipe):
        raise InputError("row 2\nrow 5")

    done = program(fail)()
    assert (done.exit_code, done.stderr) == (2, "error: row 2\nerror: row 5\n")


def test_a_bug_shows_itself():
    def fail(*, recipe: Recipe):
        raise ZeroDivisionError

    assert isinstance(program(fail)().exception, ZeroDivisionError)


@pytest.mark.parametrize("function", [one for commands in COMMANDS.values() for one in commands], ids=lambda function: function.__name__)
def test_every_command_lists_shared_options_in_one_order_and_has_an_example(function):
    shared = [name for name in names(function) if name in LAST_IN_HELP]
    assert shared == sorted(shared, key=LAST_IN_HELP.index)
    assert shared[-1] == "quiet"
    assert f"[bold]Example[/bold]: bayes-toe {function.__name__}" in inspect.getdoc(function)
