"""The public names: each is listed once, in a stub, and loads on first use."""

import ast
import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from conftest import text_table

import bayes_toe as bt

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
    assert package.__all__ == dir(package) == sorted(names) == sorted({*names})
    for name in package.__all__:
        value = getattr(package, name)
        is_part = face == "bayes_toe" and name in {"design", "model", "plots"}
        assert inspect.ismodule(value) == is_part, name
        if inspect.isfunction(value) or inspect.isclass(value):
            assert value.__name__ == name


def test_an_unknown_name_is_refused():
    for face in FACES:
        with pytest.raises(AttributeError, match="cornr"):
            import_module(face).cornr  # noqa: B018


def test_a_figure_keeps_its_name_where_its_file_has_the_same():
    code = "import bayes_toe.plots.corner, bayes_toe as bt\nfor _ in 'ab': print(bt.plots.corner)"
    words = [sys.executable, "-c", code]
    finished = subprocess.run(words, capture_output=True, text=True, check=True)
    assert finished.stdout.count("<function corner") == 2


def test_figures_and_equations_load_after_the_package_alone():
    libraries = ("numpy", "scipy", "pandas", "arviz", "emcee", "matplotlib", "typer")
    code = f"""
import sys
import bayes_toe as bt
seen = lambda: [one for one in {libraries!r} if one in sys.modules]
dir(bt), bt.plots, bt.model, dir(bt.plots), dir(bt.model)
print(seen())
bt.model.gain
print(seen())
bt.plots.corner
"""
    message = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert message == ["[]", "['numpy']"]


EQUATIONS = """
    evolved_mean | mod:update
    equal_probability | mod:q
    normalised_distance | mod:qdphi
    variance_ratio | axis1
    gain | axis2
    pull | axis2
"""


@pytest.mark.parametrize("name, label", text_table(EQUATIONS))
def test_an_equation_says_its_label_in_the_paper(name, label):
    assert re.search(rf"Source: Eqs?\. [^.]*\b{label}\b", getattr(bt.model, name).__doc__)
