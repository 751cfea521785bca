"""README, docs and their site: what they name is there, every page and name has its place."""

import inspect
import json
import re
import shlex
from functools import cache
from importlib import import_module
from pathlib import Path

import count_words
import pytest
import reference_pages
import typer.main

import bayes_toe as bt
from bayes_toe.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
TEXTS = [README, *sorted((ROOT / "docs").glob("*.md"))]
OTHERS = [
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    ROOT / "tests" / "reference" / "README.md",
]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
OURS = ("bayes_toe", "constraints", "docs", "notebooks", "scripts", "tests")


@cache
def options():
    """By command, the names of its options."""
    found = typer.main.get_command(app).commands
    return {
        name: {word for one in command.params for word in (*one.opts, *one.secondary_opts)}
        for name, command in found.items()
    }


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
        given = [
            word.split("=")[0] for word in words if re.match("--?[a-z]", word)
        ]  # -0.75 is a number
        assert [word for word in given if word not in {*known, "-h", "--help"}] == [], command


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_public_names_are_there(path):
    text = path.read_text(encoding="utf-8")
    for face, name in re.findall(r"\bbt\.(plots\.|model\.)?(\w+)", text):
        assert hasattr(getattr(bt, face[:-1]) if face else bt, name), face + name


def words(path):
    """The text of a document; of a notebook that of its cells in words."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".ipynb":
        return text
    return "\n\n".join(
        "".join(cell["source"])
        for cell in json.loads(text)["cells"]
        if cell["cell_type"] == "markdown"
    )


@pytest.mark.parametrize("path", [*TEXTS, *OTHERS, *NOTEBOOKS], ids=lambda path: path.name)
def test_files_are_there(path):
    """Links, modules and places in the checkout; what a paragraph says of an earlier commit is that commit's."""
    files = [
        one.relative_to(ROOT).as_posix() for folder in OURS for one in (ROOT / folder).rglob("*.*")
    ]
    text = words(path)
    links = [link for link in re.findall(r"\]\(([^)#\s]+)", text) if not re.match("[a-z]+:", link)]
    assert [link for link in links if not (path.parent / link).exists()] == []
    assert path == README or README not in [
        (path.parent / link).resolve() for link in links
    ]  # it is no page of the site
    for paragraph in re.split(r"\n\s*\n", text):
        if not re.search(r"commit `?[0-9a-f]{7}", paragraph):
            named = re.findall(
                rf"(?<![\w/.-])(?:(?:{'|'.join(OURS)})/[\w./-]*\w|[\w/]+\.py\b)", paragraph
            )
            gone = [
                name
                for name in named
                if not (ROOT / name).exists()
                and not any(f"/{one}".endswith(f"/{name}") for one in files)
            ]
            assert gone == [], paragraph


@pytest.mark.parametrize("path", [*TEXTS, *OTHERS], ids=lambda path: path.name)
def test_headings_that_links_lead_to_are_there(path):
    for file, anchor in re.findall(r"\]\(([\w./-]*)#([\w-]+)\)", path.read_text(encoding="utf-8")):
        target = path.parent / file if file else path
        text = target.read_text(encoding="utf-8").lower()
        headings = re.findall("^#+ (.+)$", text, flags=re.MULTILINE)
        anchors = [re.sub(r"[^\w -]", "", heading).replace(" ", "-") for heading in headings]
        assert anchor in anchors, file


def test_tables_and_pictures_of_the_docs_are_used():
    text = "".join(words(path) for path in [*TEXTS, *OTHERS, *NOTEBOOKS])
    kept = {one.name for ending in ("csv", "png") for one in (ROOT / "docs").glob(f"*.{ending}")}
    assert [name for name in sorted(kept) if name not in text] == []


def test_documents_are_short():
    """Words of prose, code and tables that people write."""
    assert sum(count_words.count_by_entry().values()) <= count_words.MOST_WORDS
    counted = {name for files in count_words.ENTRIES.values() for name in files}
    documents = {path.relative_to(ROOT).as_posix() for path in (*TEXTS, *NOTEBOOKS)}
    assert counted == documents


@pytest.mark.parametrize(("path", "most"), [(README, 600), (ROOT / "docs" / "tutorial.md", 2000)])
def test_readme_and_tutorial_are_short(path, most):
    """Words of prose and code; printed text does not count."""
    text = path.read_text(encoding="utf-8")
    assert (
        len(re.sub(r"^```text\n.*?^```", "", text, flags=re.MULTILINE | re.DOTALL).split()) <= most
    )


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_no_block_is_cut_on_the_site(path):
    """A column of the site shows 92 characters at 1200 px."""
    text = path.read_text(encoding="utf-8")
    blocks = re.findall(r"^```.*?^```", text, flags=re.MULTILINE | re.DOTALL)
    assert [line for block in blocks for line in block.splitlines() if len(line) > 88] == []


DOCS = ROOT / "docs"


def contents():
    """The documents that the site's contents list, by their place in the checkout."""
    trees = re.findall(
        r"^```\{toctree\}\n(.*?)^```",
        (DOCS / "index.md").read_text(encoding="utf-8"),
        flags=re.MULTILINE | re.DOTALL,
    )
    words = [
        line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")
    ]
    return [str((DOCS / word).resolve().relative_to(ROOT)) for word in words]


def test_every_document_is_reached_from_the_contents_and_no_other():
    listed = contents()
    assert len(listed) == len(set(listed))
    documents = {
        path
        for folder, ending in ((DOCS, "md"), (ROOT / "notebooks", "ipynb"))
        for path in folder.glob(f"*.{ending}")
    }
    others = {
        ROOT / name for name in ("CHANGELOG.md", "CONTRIBUTING.md", "tests/reference/README.md")
    }
    wanted = {str(path.relative_to(ROOT).with_suffix("")) for path in documents | others}
    assert set(listed) == wanted - {"docs/index"}


def test_every_page_that_is_made_has_its_place_in_one_document():
    texts = [path.read_text(encoding="utf-8") for path in DOCS.glob("*.md")]
    for place in reference_pages.MADE:
        assert sum(text.count(place) for text in texts) == 1, place


def test_every_command_and_option_is_in_the_reference():
    text = reference_pages.command_reference()
    sections = dict(
        zip(*[iter(re.split(r"^### (\S+)$", text, flags=re.MULTILINE)[1:])] * 2, strict=True)
    )
    commands = typer.main.get_command(app).commands
    assert list(sections) == list(commands)
    for name, command in commands.items():
        assert f"bayes-toe {name}" in sections[name]  # the example
        for one in command.params:
            words = (
                {*one.opts, *one.secondary_opts}
                if one.param_type_name == "option"
                else {one.metavar.replace("|", "\\|")}
            )
            assert words & {"--help"} or all(word in sections[name] for word in words), (
                name,
                one.name,
            )
        assert "[bold]" not in sections[name]


@pytest.mark.parametrize("face", reference_pages.FACES)
def test_every_public_name_has_its_entry_once(face):
    entries = re.findall(
        rf"^\.\. auto(?:function|class|data):: {re.escape(face)}::(\w+)$",
        reference_pages.name_reference(face),
        re.MULTILINE,
    )
    package = import_module(face)
    names = [name for name in package.__all__ if not inspect.ismodule(getattr(package, name))]
    assert sorted(entries) == names


def test_every_figure_is_in_the_gallery():
    page = (DOCS / "report_it.md").read_text(encoding="utf-8")
    names = import_module("bayes_toe.plots").__all__
    assert [name for name in names if f"bt.plots.{name}(" not in page] == []
