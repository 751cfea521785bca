"""The public names: each is listed once, in a stub, and loads on first use."""

import ast
import inspect
from importlib import import_module
from pathlib import Path

import pytest
from commands import run_python

PACKAGES = ("bayes_toe", "bayes_toe.plots", "bayes_toe.design", "bayes_toe.model")


def imports_of_stub(package_name):
    """The imports in the stub of a package, repeated imports included, such as `run as run`."""
    stub = Path(import_module(package_name).__file__).with_suffix(".pyi")
    for node in ast.walk(ast.parse(stub.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            yield from node.names


@pytest.mark.parametrize("package_name", PACKAGES)
def test_every_name_is_there_once_and_comes_unchanged_from_where_the_stub_says(package_name):
    package = import_module(package_name)
    # A stub has lines such as `from bayes_toe.analysis import run as run`.
    names = []
    for alias in imports_of_stub(package_name):
        assert alias.asname == alias.name
        names.append(alias.name)
    assert package.__all__ == dir(package) == sorted(names) == sorted(set(names))
    for name in package.__all__:
        value = getattr(package, name)
        # Three names of the package are modules. A figure such as plots.corner is a function,
        # although its file has the same name.
        is_part = package_name == "bayes_toe" and name in {"design", "model", "plots"}
        assert inspect.ismodule(value) == is_part, name
        if inspect.isfunction(value) or inspect.isclass(value):
            assert value.__name__ == name


def test_a_figure_keeps_its_name_where_its_file_has_the_same():
    # The second print shows that the first use has not put the module in the place of the function.
    code = "import bayes_toe.plots.corner, bayes_toe as bt\nfor _ in 'ab': print(bt.plots.corner)"
    assert run_python("-c", code).stdout.count("<function corner") == 2
