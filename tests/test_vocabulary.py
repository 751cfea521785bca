"""Words that must not come back, because texts that users read have the words of the field."""

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


def texts_of_users():
    """The texts that users read, by name: documents, the report, help and public docstrings."""
    text_by_name = {}
    for path in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        text_by_name[path.name] = path.read_text(encoding="utf-8")
    for path in (ROOT / "bayes_toe" / "cli").glob("*.html"):
        template = path.read_text(encoding="utf-8")
        text_by_name[path.name] = re.sub(r"\{%.*?%\}|\{\{.*?\}\}", "", template, flags=re.DOTALL)
    for command in typer.main.get_command(app).commands.values():
        help_texts = [command.help, *(parameter.help for parameter in command.params)]
        text_by_name[f"bayes-toe {command.name}"] = "\n".join(filter(None, help_texts))
    for package in ("bayes_toe", "bayes_toe.model", "bayes_toe.design", "bayes_toe.plots"):
        module = importlib.import_module(package)
        for name in module.__all__:
            text_by_name[f"{package}.{name}"] = inspect.getdoc(getattr(module, name)) or ""
    return text_by_name


TEXTS = texts_of_users()


@pytest.mark.parametrize("name", TEXTS)
def test_no_forbidden_word(name):
    # Code in blocks, code between backticks and tables of numbers are no prose.
    prose = re.sub(r"^```.*?^```", "", TEXTS[name], flags=re.MULTILINE | re.DOTALL)
    prose = ALLOWED_WORDS.sub("", prose)
    assert [match.group() for match in FORBIDDEN.finditer(prose)] == []
