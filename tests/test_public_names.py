"""The public names: each is listed once, in a stub, and loads on first use."""

import ast
import inspect
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

FACES = ("bayes_toe", "bayes_toe.plots", "bayes_toe.design", "bayes_toe.model")


def _imported(face):
    """What the stub of a package imports, as often as it stands there."""
    stub = Path(import_module(face).__file__).with_suffix(".pyi")
    for node in ast.walk(ast.parse(stub.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            yield from node.names


@pytest.mark.parametrize("face", FACES)
def test_every_name_is_there_once_and_comes_unchanged_from_where_the_stub_says(face):
    package = import_module(face)
    names = []
    for alias in _imported(face):
        assert alias.asname == alias.name
        names.append(alias.name)
    assert package.__all__ == dir(package) == sorted(names) == sorted(set(names))
    for name in package.__all__:
        value = getattr(package, name)
        is_part = face == "bayes_toe" and name in {"design", "model", "plots"}
        assert inspect.ismodule(value) == is_part, name
        if inspect.isfunction(value) or inspect.isclass(value):
            assert value.__name__ == name


def test_a_figure_keeps_its_name_where_its_file_has_the_same():
    code = "import bayes_toe.plots.corner, bayes_toe as bt\nfor _ in 'ab': print(bt.plots.corner)"
    words = [sys.executable, "-c", code]
    finished = subprocess.run(words, capture_output=True, text=True, check=True)
    assert finished.stdout.count("<function corner") == 2
