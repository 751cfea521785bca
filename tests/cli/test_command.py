"""Functions become commands: records become options, in one order.

Errors become lines and exit codes; help loses nothing.
"""

import inspect
import re
from dataclasses import fields
from itertools import chain

import pytest
import typer.main
from commands import run_command
from conftest import each_row
from rich.text import Text

import bayes_toe as bt
from bayes_toe.cli.app import COMMANDS, app
from bayes_toe.cli.options import LAYOUT, StudyFile
from bayes_toe.cli.run_context import RunContext, as_command

SHARED_OPTIONS = [field.name for field in fields(RunContext) if field.name != "inputs"]
FUNCTIONS = {function.__name__: function for function in chain.from_iterable(COMMANDS.values())}
of_every_command = pytest.mark.parametrize("name", FUNCTIONS)


def parameters_of(function):
    """The names of the parameters of the command that a function becomes, in their order."""
    return list(inspect.signature(as_command(function)).parameters)


COMMANDS_WITH_STUDY = [name for name in FUNCTIONS if "example" in parameters_of(FUNCTIONS[name])]


@pytest.mark.parametrize("command", COMMANDS_WITH_STUDY)
def test_without_a_file_a_command_says_what_to_type(command, tmp_path):
    result = run_command(command, cwd=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr.splitlines() == [
        "error: No file is named.",
        f"type:  bayes-toe {command} STUDY.csv",
        f"       bayes-toe {command} --example",
    ]


#: Words that are typed after a command, and the task of the example that is read.
EXAMPLES = """
    --example | 2afc
    --example -q | 2afc
    -q --example 2afc | 2afc
    --example same-different -q | same-different
    --example=same/different | same/different
"""


@each_row("words, example", EXAMPLES)
def test_commands_that_read_a_study_have_both_examples(monkeypatch, tmp_path, words, example):
    def read(study):
        # Instead of reading, the command ends with an error that says which example was chosen.
        raise bt.InputError(study.example)

    monkeypatch.setattr(StudyFile, "read", read)
    for command in COMMANDS_WITH_STUDY:
        result = run_command(f"{command} {words}", cwd=tmp_path)
        assert result.stderr == f"error: {example}\n", command


def test_an_error_of_the_program_itself_keeps_its_traceback(monkeypatch):
    # Only expected errors become a line: an error of the program keeps its traceback.
    monkeypatch.setattr("bayes_toe.check", lambda *_: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        run_command("check --example")


@of_every_command
def test_every_command_lists_shared_options_last_in_one_order(name):
    options = parameters_of(FUNCTIONS[name])
    # The draws of a population have another default, and stand among its own options.
    own_options = {"population": ["draws"]}.get(name, [])
    expected = [
        option for option in SHARED_OPTIONS if option in options and option not in own_options
    ]
    assert options[-len(expected) :] == expected
    assert expected[-1] == "quiet"


@of_every_command
def test_the_help_of_every_command_has_the_text_of_every_option(name):
    screen = run_command(f"{name} --help").stdout
    # Options for layouts of files stand in the help of `check` alone.
    _, _, layouts = run_command("check --help").stdout.partition(LAYOUT)
    # Lines may end anywhere in a text, and have frames: spaces and frames do not count.
    text = "".join((screen + layouts).replace("│", " ").split())
    assert "<" not in screen.replace("<=", "")  # a type of Python, such as <class 'str'>
    assert f"Example:bayes-toe{name}" in text
    for option in typer.main.get_command(app).commands[name].params:
        help_text = Text.from_markup(option.help)
        assert "".join(help_text.plain.split()) in text, option.name
        assert not help_text.spans, option.name  # a bracket is no markup for rich
        assert len(help_text.plain.split()) <= 12, option.name  # words


def test_commands_are_listed_in_an_order_and_rare_options_stand_apart():
    _, _, lines = run_command("--help").stdout.partition("One study")
    names = " ".join(re.findall(r"^│ (\w+)  ", lines, re.MULTILINE))  # '│ check  Look at ...'
    assert names == (
        "check run sample evidence corner explore fit app population contrast history "
        "design power simulate"
    )
    usual_options, rare_options = run_command("run --help").stdout.split("Advanced")
    for option in ("--output", "--swap", "--exclude", "--seed"):
        assert f"{option} " in usual_options
    for option in ("--workers", "--dask"):
        assert f"{option} " in rare_options


@of_every_command
def test_the_help_of_a_command_fits_on_a_screen(name, monkeypatch):
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 80)
    text = run_command(f"{name} --help").stdout
    # A terminal of 24 lines shows all down to the end of the first frame of options at once.
    start_of_options = text.index("╭─ Options")
    end_of_options = text.index("╰", start_of_options)
    assert text[:end_of_options].count("\n") <= 24
    assert text.count("\n") <= 46  # with the rare options
    assert max(map(len, text.splitlines())) <= 80
    title = inspect.getdoc(FUNCTIONS[name]).partition("\n")[0]
    assert len(title) <= 64  # one line in the list of commands
