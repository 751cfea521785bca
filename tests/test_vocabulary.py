"""Words that must not come back: texts that users read speak the language of the field."""

import importlib
import inspect
import re
from pathlib import Path

import pytest
import typer.main

from bayes_toe.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
FORBIDDEN = re.compile(
    r"\bpull(s|ed)?\b|\b(told|tells?)\b|\bkept\b|\bpictures?\b|kind (is )?open|open kind|P\(none\)"
    r"|is said|has a say|not described|\brobust\b|\bverdicts?\b|free frequenc|both ways|one peak"
    r"|sloped|less H0|in the light of|(subjects?|fit) alone|\b(those|for|of) who\b|\b0\.00\b"
)
#: The word of the answer, code, and tables of numbers.
ALLOWED_WORDS = re.compile(r"cannot be told|`[^`]*`|\bpull\(|^\|.*\|$", re.MULTILINE)
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TEMPLATES = sorted((ROOT / "bayes_toe" / "cli").glob("*.html"))


def forbidden(text):
    """Forbidden words of a text, code aside."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    return [match.group() for match in FORBIDDEN.finditer(ALLOWED_WORDS.sub("", prose))]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_documents(path):
    assert forbidden(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.name)
def test_templates_of_the_report(path):
    text = re.sub(r"\{%.*?%\}|\{\{.*?\}\}", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert forbidden(text) == []


def test_help_of_every_command():
    for name, command in typer.main.get_command(app).commands.items():
        texts = [command.help or "", *(parameter.help or "" for parameter in command.params)]
        assert [words for text in texts if (words := forbidden(text))] == [], name


@pytest.mark.parametrize("face", ["", ".model", ".design", ".plots"])
def test_public_docstrings(face):
    module = importlib.import_module(f"bayes_toe{face}")
    observed = {}
    for name in module.__all__:
        words = forbidden(inspect.getdoc(getattr(module, name)) or "")
        if words:
            observed[name] = words
    assert observed == {}
