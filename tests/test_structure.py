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
#: The modules or subpackages that may import a library.
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


def module_names():
    """The dotted names of all modules in the package, such as data.study, but not of its own."""
    paths = (path.relative_to(PACKAGE).with_suffix("").parts for path in PACKAGE.rglob("*.py"))
    return sorted(".".join(parts) for parts in paths if parts not in {("__init__",), ("__main__",)})


@cache
def imported_names(name):
    """Dotted names of all that a module imports, such as bayes_toe.data.study.Study.

    Imports in functions count, too.
    """
    path = PACKAGE / f"{name.replace('.', '/')}.py"
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def rank_of(name):
    """The position of a module's subpackage in ORDER."""
    return ORDER.index(name.split(".")[0])


@pytest.mark.parametrize("name", module_names())
def test_every_file_is_in_a_subpackage_and_imports_point_one_way(name):
    assert name.count(".") <= 1, "one level of subpackages"
    for imported in imported_names(name):
        package, _, imported_name = imported.partition(".")  # 'bayes_toe', 'data.study.Study'
        if package == "bayes_toe" and imported_name.split(".")[0] in ORDER:
            assert rank_of(imported_name) <= rank_of(name), imported_name


def test_no_modules_import_each_other():
    graph = {}
    for name in module_names():
        imported = {other.removeprefix("bayes_toe.") for other in imported_names(name)}
        # `from bayes_toe.a.b import name` gives a.b.name, whose module is a.b.
        graph[name] = imported | {other.rpartition(".")[0] for other in imported}
    TopologicalSorter(graph).prepare()  # raises CycleError where modules import each other


@pytest.mark.parametrize("library", OWNERS)
def test_a_library_has_one_owner(library):
    importers = []
    for name in module_names():
        if any(other.split(".")[0] == library for other in imported_names(name)):
            importers.append(name)
            assert OWNERS[library] & {name, name.split(".")[0]}, name
    assert importers  # otherwise OWNERS has a library that nobody uses
