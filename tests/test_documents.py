"""README, docs and their site: all that they name exists, and every page is in the contents."""

import json
import re
import shlex
import tomllib
from functools import cache
from importlib import import_module
from itertools import chain
from pathlib import Path

import count_words
import pytest
import reference_pages
import typer.main

import bayes_toe as bt
from bayes_toe.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
DOCS = ROOT / "docs"
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
TEXTS = [README, *sorted(DOCS.glob("*.md"))]
OTHER_PAGES = [
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    ROOT / "tests" / "reference" / "README.md",
]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
#: Folders of the checkout that documents name.
CHECKOUT_FOLDERS = ("bayes_toe", "constraints", "docs", "notebooks", "scripts", "tests")


IN_SDIST = [
    ROOT / name for name in SETTINGS["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
]
EACH_PAGE = pytest.mark.parametrize(
    "path", [*TEXTS, *OTHER_PAGES, *NOTEBOOKS], ids=lambda path: path.name
)
EACH_TEXT = pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)


@cache
def options_by_command():
    """The names of the options of each command, such as {'run': {'-o', '--output', ...}}."""
    names = {}
    for name, command in typer.main.get_command(app).commands.items():
        spellings = [[*option.opts, *option.secondary_opts] for option in command.params]
        names[name] = {"-h", "--help", *chain.from_iterable(spellings)}
    return names


def blocks_in(text, language):
    """The contents of the blocks of a language in a text: of ```sh, those of the shell."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def command_words(text):
    """The words of every command in a text, without `bayes-toe`, such as ['run', '-o', 'out'].

    They are in blocks of the shell, and between backticks. A line that ends with a backslash goes
    on in the next line.
    """
    lines = "".join(blocks_in(text, "sh")).replace("\\\n", " ").splitlines()
    lines += [" ".join(line.split()) for line in re.findall(r"(?<!`)`(bayes-toe [^`]+)`", text)]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("bayes-toe ")]


@EACH_TEXT
def test_commands_and_options_are_there(path):
    for command, *words in command_words(path.read_text(encoding="utf-8")):
        if command != "...":  # which stands for any command
            options_used = {word.split("=")[0] for word in words if re.match("--?[a-z]", word)}
            assert options_used - options_by_command()[command] == set(), command


@EACH_TEXT
def test_public_names_are_there(path):
    text = path.read_text(encoding="utf-8")
    # Such as ('plots', 'corner') of bt.plots.corner, and ('', 'run') of bt.run.
    for part, name in re.findall(r"\bbt\.(?:(plots|model)\.)?(\w+)", text):
        module = getattr(bt, part) if part else bt
        assert hasattr(module, name), name


def text_of(path):
    """The text of a document, or of the cells of a notebook that are no code."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".ipynb":
        return text
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown"]
    return "\n\n".join("".join(cell["source"]) for cell in cells)


def anchors_of(path):
    """The anchors of the headings of a page: '## Check the data' has check-the-data."""
    headings = re.findall("^#+ (.+)$", text_of(path).lower(), flags=re.MULTILINE)
    return [re.sub(r"[^\w -]", "", heading).replace(" ", "-") for heading in headings]


@EACH_PAGE
def test_links_lead_to_files_of_the_sdist_and_to_headings(path):
    # The target of a link such as [text](file.md#anchor). Targets outside begin with https: or
    # similar.
    for link in re.findall(r"\]\(([^)\s]+)", text_of(path)):
        if not re.match("[a-z]+:", link):
            file, _, anchor = link.partition("#")
            target = (path.parent / file).resolve() if file else path
            assert target.exists(), link
            assert any(target.is_relative_to(included) for included in IN_SDIST), link
            assert not anchor or anchor in anchors_of(target), link
            assert target != README or path == README, "the README is no page of the site"


@EACH_PAGE
def test_modules_and_places_in_the_checkout_are_there(path):
    """A paragraph that names a commit is about the files of that commit, and is not checked."""
    # Such as docs/index.md or test_documents.py.
    file_name = rf"(?<![\w/.-])(?:(?:{'|'.join(CHECKOUT_FOLDERS)})/[\w./-]*\w|[\w/]+\.py\b)"
    for paragraph in re.split(r"\n\s*\n", text_of(path)):
        if not re.search(r"commit `?[0-9a-f]{7}", paragraph):
            for name in re.findall(file_name, paragraph):
                assert (ROOT / name).exists() or f"/{name}\n" in names_of_files(), paragraph


@cache
def names_of_files():
    """The files of the checkout, a line each."""
    paths = chain.from_iterable((ROOT / folder).rglob("*.*") for folder in CHECKOUT_FOLDERS)
    return "".join(f"/{path.relative_to(ROOT).as_posix()}\n" for path in paths)


def test_documents_are_short():
    """The limits are for words that people write, without and with the data dictionary."""
    total = sum(map(count_words.count_words, count_words.DOCUMENTS))
    assert total <= count_words.MOST_WORDS
    total_with_dictionary = total + count_words.count_dictionary_tables()
    assert total_with_dictionary <= count_words.MOST_WORDS_WITH_DICTIONARY


@pytest.mark.parametrize("path, limit", [(README, 600), (DOCS / "tutorial.md", 2000)])
def test_readme_and_tutorial_are_short(path, limit):
    """The limit counts words of prose and code, and no printed text."""
    text = path.read_text(encoding="utf-8")
    prose = re.sub(r"^```text\n.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    assert len(prose.split()) <= limit


def pages_in_contents():
    """The documents in the contents of the site, by their paths in the checkout without suffix."""
    trees = blocks_in((DOCS / "index.md").read_text(encoding="utf-8"), r"\{toctree\}")
    # A toctree has options such as `:hidden:` and then a document in each line.
    lines = [line for line in "".join(trees).splitlines() if line and not line.startswith(":")]
    return [(DOCS / line).resolve().relative_to(ROOT).as_posix() for line in lines]


def test_the_contents_have_every_document_once_and_no_other():
    # The page index.md has the contents.
    documents = {*DOCS.glob("*.md"), *NOTEBOOKS, *OTHER_PAGES} - {DOCS / "index.md"}
    names = [path.relative_to(ROOT).with_suffix("").as_posix() for path in documents]
    assert sorted(pages_in_contents()) == sorted(names)


@pytest.mark.parametrize("name", reference_pages.PAGES)
def test_reference_pages_are_as_the_code_has_them(name):
    """If a page is not, run python scripts/reference_pages.py."""
    text = (DOCS / name).read_text(encoding="utf-8")
    assert reference_pages.updated(name, text) == text


def test_every_figure_is_in_the_gallery():
    # Each function of bt.plots is called on the page Report it.
    page = (DOCS / "report_it.md").read_text(encoding="utf-8")
    names = import_module("bayes_toe.plots").__all__
    assert [name for name in names if f"bt.plots.{name}(" not in page] == []
