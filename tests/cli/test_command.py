"""Functions become commands: records become options, in one order.

Errors become lines and exit codes; help loses nothing.
"""

import inspect
import re
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated

import pytest
import typer.main
from commands import inside, refused
from conftest import few_pairs, grouped_csv
from rich.text import Text
from typer.testing import CliRunner

import bayes_toe as bt
from bayes_toe.cli.app import COMMANDS, RETIRED_COMMANDS, app
from bayes_toe.cli.options import LAYOUT, StudyFile
from bayes_toe.cli.task import Task, as_command
from bayes_toe.errors import InputError

SHARED = [
    "seed",
    "draws",
    "processes",
    "dask",
    "prior",
    "spreadsheet_safe",
    "resume",
    "overwrite",
    "quiet",
]


of_every_command = pytest.mark.parametrize(
    "function", [*chain.from_iterable(COMMANDS.values())], ids=lambda function: function.__name__
)


@dataclass(frozen=True, kw_only=True)
class Recipe:
    sugar: Annotated[int, typer.Option("--sugar")] = 3
    bowl: Annotated[Path | None, typer.Option("--bowl")] = None


def program(function):
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(as_command(function))
    return lambda *args: CliRunner().invoke(app, [str(arg) for arg in args])


def names(function):
    return list(inspect.signature(as_command(function)).parameters)


def test_a_record_becomes_its_fields_a_task_those_that_are_taken_and_both_come_back_whole():
    received = []

    def bake(
        *,
        flour: Annotated[int, typer.Option("--flour")] = 1,
        recipe: Recipe,
        task: Annotated[Task, "seed"],
    ):
        received.append((flour, recipe, task))

    assert names(bake) == ["flour", "sugar", "bowl", "seed", "quiet"]
    assert program(bake)("--flour", 2, "--sugar", 5, "--bowl", "here", "-q").exit_code == 0
    assert received == [
        (2, Recipe(sugar=5, bowl=Path("here")), Task(quiet=True, inputs=(Path("here"),)))
    ]


def test_the_files_that_are_read_are_told():
    received = []

    def read(
        *,
        study: StudyFile,
        output: Annotated[Path, typer.Option("-o")],
        task: Task,
    ):
        received.append(task.inputs)

    assert program(read)("a.csv", "b.csv", "-o", "c.csv").exit_code == 0
    assert received == [(Path("a.csv"), Path("b.csv"))]


@pytest.mark.parametrize("command", ["run", "check", "sample", "evidence", "population", "fit"])
def test_without_a_file_a_command_says_what_to_type(command, tmp_path):
    done = inside(command, cwd=tmp_path)
    assert (done.returncode, done.stdout, [*tmp_path.iterdir()]) == (2, "", [])
    assert done.stderr.splitlines() == [
        "error: No file is named.",
        f"type:  bayes-toe {command} STUDY.csv",
        f"       bayes-toe {command} --example",
    ]


def test_the_example_takes_the_place_of_a_file(tmp_path):
    study = StudyFile(example=True)
    assert study.read().names == bt.example_study().names
    paper = StudyFile(example=True, question="same/different")
    assert paper.read().task.yes == "equal"
    assert (study.truth(), len(paper.truth())) == ({}, 16)
    said = refused("check", "a.csv", "--example", cwd=tmp_path)
    assert said == "error: --example and STUDY.csv exclude each other.\n"


@pytest.mark.parametrize(
    ("typed", "asked"),
    [
        ("", StudyFile(example=True)),
        ("  ", StudyFile(example=True)),
        ("'my study.csv' ", StudyFile(files=[Path("my study.csv")])),
    ],
)
def test_run_asks_in_a_terminal_which_file(monkeypatch, typed, asked):
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr("sys.stdout", SimpleNamespace(isatty=lambda: True))
    questions = []

    def answer(question, **_):
        questions.append(question)
        return typed

    monkeypatch.setattr("typer.prompt", answer)
    study, task = Task(inputs=(Path("prior.toml"),)).ask(StudyFile())
    assert study == asked
    assert task.inputs == (Path("prior.toml"), *(asked.files or ()))
    assert Task().ask(asked)[0] is asked
    assert len(questions) == 1


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [(InputError("row 2\nrow 5"), 2, "error: row 2\nerror: row 5\n"), (ZeroDivisionError(), 1, "")],
)
def test_problems_are_lines_and_a_code_and_a_bug_shows_itself(error, code, said):
    def fail(*, task: Task):
        raise error

    done = program(fail)()
    assert (done.exit_code, done.stderr) == (code, said)
    assert said or done.exception is error


@of_every_command
def test_every_command_lists_shared_options_last_in_one_order_and_its_help_has_every_word(function):
    found = names(function)
    own = {"population": ["draws"]}.get(function.__name__, [])  # with another default
    shared = [name for name in SHARED if name in found and name not in own]
    assert found[-len(shared) :] == shared
    assert shared[-1] == "quiet"
    done = inside(function.__name__, "--help")
    assert done.returncode == 0
    layouts = inside("check", "--help").stdout.partition(LAYOUT)[2]
    said = "".join((done.stdout + layouts).replace("│", " ").split())
    assert "<" not in done.stdout.replace("<=", "")  # Python's types
    assert f"Example:bayes-toe{function.__name__}" in said
    for one in typer.main.get_command(app).commands[function.__name__].params:
        assert "".join(Text.from_markup(one.help).plain.split()) in said, one.name
        assert not Text.from_markup(one.help).spans, one.name  # a bracket is a bracket


def test_there_are_fourteen_commands_and_rare_options_stand_apart():
    text = inside("--help").stdout
    listed = re.findall(r"^│ (\w+)  ", text.partition("One study")[2], re.MULTILINE)
    assert listed == [
        "check",
        "run",
        "sample",
        "evidence",
        "corner",
        "explore",
        "fit",
        "app",
        "population",
        "contrast",
        "history",
        "design",
        "power",
        "simulate",
    ]
    usual, rare = inside("run", "--help").stdout.split("Advanced")
    for name in ("--output", "--swap", "--exclude", "--prior", "--seed"):
        assert f"{name} " in usual
    for name in ("--workers", "--dask", "--spreadsheet-safe"):
        assert f"{name} " in rare


@of_every_command
def test_the_help_of_a_command_fits_on_a_screen_in_short_phrases(function, monkeypatch):
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 80)
    lines = inside(function.__name__, "--help").stdout.splitlines()
    assert not lines[0].strip()
    ends = [number for number, line in enumerate(lines) if line.startswith("╰")]
    options = next(number for number, line in enumerate(lines) if line.startswith("╭─ Options"))
    assert next(end for end in ends if end > options) <= 24, "\n".join(lines)
    assert len(lines) <= 42, "\n".join(lines)
    assert max(map(len, lines)) <= 80
    for one in typer.main.get_command(app).commands[function.__name__].params:
        assert len(one.help.split()) <= 12, one.name
    title = inspect.getdoc(function).partition("\n")[0]
    assert len(title) <= 64  # one line in the list of commands


@pytest.mark.parametrize(
    ("former", "present"), [("--turn", "--swap"), ("--leave-out", "--exclude")]
)
def test_a_former_name_of_an_option_still_works(tmp_path, former, present):
    grouped_csv(tmp_path / "study.csv", few_pairs("AB"))
    texts = [inside("check", "study.csv", f"{name}=A", cwd=tmp_path) for name in (former, present)]
    assert texts[0].stdout == texts[1].stdout
    assert [done.returncode for done in texts] == [0, 0]


@pytest.mark.parametrize(("name", "instead"), RETIRED_COMMANDS.items())
def test_a_retired_command_says_what_to_type_instead(tmp_path, name, instead):
    for word in ("study.csv", "--help"):
        assert refused(name, word, cwd=tmp_path) == f"error: `{name}` is retired: {instead}\n"
    present = {command.__name__ for command in chain.from_iterable(COMMANDS.values())}
    assert present.issuperset(re.findall(r"`bayes-toe (\w+)", instead))


@pytest.mark.parametrize(
    "words",
    [
        ("evidence", "study.csv", "--more-trials"),
        ("power", "--stop", "has"),
        ("run", "study.csv", "--store", "zarr"),
        ("power", "--carry-over", "0.5"),
    ],
    ids=lambda words: words[0],
)
def test_a_retired_option_is_answered_with_one_line(tmp_path, words):
    said = refused(*words, cwd=tmp_path)
    option = next(word for word in words if word.startswith("--")).partition("=")[0]
    assert said.startswith(f"error: `{option}` is retired: ")
