"""Every file is in a subpackage, imports point one way, and a library has one owner.

libraries errors arrays seeds cluster workers < data < result_store < model
< inference < checks < groups < classical < answers < analysis < design < plots < explorer
< app < cli
"""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import bayes_toe

PACKAGE = Path(bayes_toe.__file__).parent
#: An import leads to something further left, or stays in its subpackage.
ORDER = __doc__.partition("\n\n")[2].replace("<", " ").split()
OWNERS = {
    "arviz_stats": {"inference.diagnostics"},
    "emcee": {"inference", "groups"},
    "arviz": {"inference.draws_file"},
    "xarray": {
        "inference.draws",
        "inference.draws_file",
        "groups.population",
    },
    "matplotlib": {"plots"},
    "corner": {"plots.corner"},
    "bokeh": {"explorer"},
    "joblib": {"workers", "result_store"},
    "distributed": {"cluster", "workers"},
    "tornado": {"app"},
    "typer": {"cli"},
    "rich": {"cli"},
    "jinja2": {"cli"},
}


def _modules():
    """Every module but the package's own face, as its dotted name inside the package."""
    observed = (path.relative_to(PACKAGE).with_suffix("").parts for path in PACKAGE.rglob("*.py"))
    return sorted(
        ".".join(parts) for parts in observed if parts not in {("__init__",), ("__main__",)}
    )


@cache
def _imported(name):
    """Dotted names of everything that a module imports, also inside functions."""
    path = PACKAGE / f"{name.replace('.', '/')}.py"
    imported = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            imported += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            imported += [f"{node.module}.{alias.name}" for alias in node.names]
    return imported


def _rank(name):
    return ORDER.index(name.split(".")[0])


@pytest.mark.parametrize("name", _modules())
def test_every_file_is_in_a_subpackage_and_imports_point_one_way(name):
    assert name.count(".") <= 1, "one level of subpackages"
    for imported in _imported(name):
        package, _, other = imported.partition(".")
        if package == "bayes_toe" and other.split(".")[0] in ORDER:
            assert _rank(other) <= _rank(name), other


def test_no_modules_import_each_other():
    graph = {}
    for name in _modules():
        imported = {other.removeprefix("bayes_toe.") for other in _imported(name)}
        # `from bayes_toe.a.b import name` gives a.b.name, whose module is a.b.
        graph[name] = imported | {other.rpartition(".")[0] for other in imported}
    TopologicalSorter(graph).prepare()  # raises CycleError where modules import each other


@pytest.mark.parametrize("library", OWNERS)
def test_a_library_has_one_owner(library):
    importers = []
    for name in _modules():
        if any(other.split(".")[0] == library for other in _imported(name)):
            importers.append(name)
            assert OWNERS[library] & {name, name.split(".")[0]}, name
    assert importers
