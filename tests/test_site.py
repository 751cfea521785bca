"""The site without building it: every document is in its contents, every command, option and public name on its pages."""

import re
from importlib import import_module
from pathlib import Path

import pytest
import reference_pages
import typer.main

from bayes_toe.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


def contents():
    """The documents that the site's contents list, by their place in the checkout."""
    trees = re.findall(r"^```\{toctree\}\n(.*?)^```", (DOCS / "index.md").read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    words = [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]
    return [str((DOCS / word).resolve().relative_to(ROOT)) for word in words]


def test_every_document_is_reached_from_the_contents_and_no_other():
    listed = contents()
    assert len(listed) == len(set(listed))
    documents = {path for folder, ending in ((DOCS, "md"), (ROOT / "notebooks", "ipynb")) for path in folder.glob(f"*.{ending}")}
    others = {ROOT / name for name in ("CHANGELOG.md", "CONTRIBUTING.md", "tests/reference/README.md")}
    wanted = {str(path.relative_to(ROOT).with_suffix("")) for path in documents | others}
    assert set(listed) == wanted - {"docs/index"}


def test_every_page_that_is_made_has_its_place_in_one_document():
    texts = [path.read_text(encoding="utf-8") for path in DOCS.glob("*.md")]
    for place in reference_pages.MADE:
        assert sum(text.count(place) for text in texts) == 1, place


def test_every_command_and_option_is_in_the_reference():
    text = reference_pages.command_reference()
    sections = dict(zip(*[iter(re.split(r"^### (\S+)$", text, flags=re.MULTILINE)[1:])] * 2, strict=True))
    commands = typer.main.get_command(app).commands
    assert list(sections) == list(commands)
    for name, command in commands.items():
        assert f"bayes-toe {name}" in sections[name]  # the example
        for one in command.params:
            words = {*one.opts, *one.secondary_opts} if one.param_type_name == "option" else {one.metavar.replace("|", "\\|")}
            assert words & {"--help"} or all(word in sections[name] for word in words), (name, one.name)
        assert "[bold]" not in sections[name]


@pytest.mark.parametrize("face", reference_pages.FACES)
def test_every_public_name_has_its_entry_once(face):
    entries = re.findall(
        rf"^\.\. auto(?:function|class|data):: {re.escape(face)}::(\w+)$", reference_pages.name_reference(face), re.MULTILINE
    )
    assert sorted(entries) == [name for name in import_module(face).__all__ if name not in ("model", "planning", "plots")]


def test_every_figure_is_in_the_gallery():
    gallery = (DOCS / "gallery.md").read_text(encoding="utf-8")
    names = [name for name in import_module("bayes_toe.plots").__all__ if not name.endswith("_axes")]
    assert [name for name in names if f"bt.plots.{name}(" not in gallery] == ["write_figures"]  # which draws no other ones
