"""What README and docs say: commands, options, names and files that they name are there, and README's programs run as they stand."""

import json
import re
import shlex
from contextlib import chdir
from functools import cache
from pathlib import Path

import pytest
import typer.main
from conftest import few_pairs, grouped_csv

import bayes_toe as bt
from bayes_toe.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
TEXTS = [README, *sorted((ROOT / "docs").glob("*.md"))]
OTHERS = [ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "tests" / "reference" / "README.md"]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
OURS = ("bayes_toe", "constraints", "docs", "notebooks", "scripts", "tests")


@cache
def options():
    """By command, the names of its options."""
    found = typer.main.get_command(app).commands
    return {name: {word for one in command.params for word in (*one.opts, *one.secondary_opts)} for name, command in found.items()}


def commands(text):
    """Words of every command in a text, in its blocks and between backticks."""
    blocks = re.findall(r"^```sh\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    lines += [" ".join(one.split()) for one in re.findall(r"(?<!`)`(bayes-toe [^`]+)`", text)]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("bayes-toe ")]


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_commands_and_options_are_there(path):
    for command, *words in commands(path.read_text(encoding="utf-8")):
        if command == "...":  # any
            continue
        known = options()[command]
        given = [word.split("=")[0] for word in words if re.match("--?[a-z]", word)]  # -0.75 is a number
        assert [word for word in given if word not in {*known, "-h", "--help"}] == [], command


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_public_names_are_there(path):
    for face, name in re.findall(r"\bbt\.(plots\.|model\.)?(\w+)", path.read_text(encoding="utf-8")):
        assert hasattr(getattr(bt, face[:-1]) if face else bt, name), face + name


def words(path):
    """The text of a document; of a notebook that of its cells in words."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".ipynb":
        return text
    return "\n\n".join("".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown")


@pytest.mark.parametrize("path", [*TEXTS, *OTHERS, *NOTEBOOKS], ids=lambda path: path.name)
def test_files_are_there(path):
    """Links, modules and places in the checkout; what a paragraph says of an earlier commit is that commit's."""
    files = [one.relative_to(ROOT).as_posix() for folder in OURS for one in (ROOT / folder).rglob("*.*")]
    text = words(path)
    links = [link for link in re.findall(r"\]\(([^)#\s]+)", text) if not re.match("[a-z]+:", link)]
    assert [link for link in links if not (path.parent / link).exists()] == []
    for paragraph in re.split(r"\n\s*\n", text):
        if not re.search(r"commit `?[0-9a-f]{7}", paragraph):
            named = re.findall(rf"(?<![\w/.-])(?:(?:{'|'.join(OURS)})/[\w./-]*\w|[\w/]+\.py\b)", paragraph)
            gone = [name for name in named if not (ROOT / name).exists() and not any(f"/{one}".endswith(f"/{name}") for one in files)]
            assert gone == [], paragraph


@pytest.mark.parametrize("path", [*TEXTS, *OTHERS], ids=lambda path: path.name)
def test_headings_that_links_lead_to_are_there(path):
    for file, heading in re.findall(r"\]\(([\w./-]*)#([\w-]+)\)", path.read_text(encoding="utf-8")):
        known = re.findall("^#+ (.+)$", (path.parent / file if file else path).read_text(encoding="utf-8"), flags=re.MULTILINE)
        assert heading in [re.sub(r"[^\w -]", "", one.lower()).replace(" ", "-") for one in known], file


def test_tables_and_pictures_of_the_docs_are_used():
    text = "".join(words(path) for path in [*TEXTS, *OTHERS, *NOTEBOOKS])
    kept = {one.name for ending in ("csv", "png") for one in (ROOT / "docs").glob(f"*.{ending}")}
    assert [name for name in sorted(kept) if name not in text] == []


def test_readme_is_short():
    lines = README.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 120
    assert [line for line in lines if len(line) > 140] == []


def test_programs_of_the_readme_run(tmp_path):
    grouped_csv(tmp_path / "study.csv", few_pairs(["S01"]))
    known = {}
    with chdir(tmp_path):
        for block in re.findall(r"^```python\n(.*?)^```", README.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL):
            # 12 models and the explorer cost too much here, and have tests of their own.
            exec("\n".join(line for line in block.splitlines() if "compare" not in line and "explore" not in line), known)
    assert (tmp_path / "S01.png").read_bytes().startswith(b"\x89PNG")
    assert known["draws"].names == ("S01",)
