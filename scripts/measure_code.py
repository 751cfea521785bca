#!/usr/bin/env python3
"""Measure how readable the code is, and fail where a measure is over its limit.

    scripts/measure_code.py                        # every measure with its limit
    scripts/measure_code.py --list "filler names"  # the places that a measure counts

The complexity of a function is one and the number of its branches. A comprehension and each of its
conditions, a conditional expression, an `and` and an `or` are branches too: a branch that moves
into an expression counts as before. A filler name says nothing about the value that it names.
"""

from __future__ import annotations

import argparse
import ast
import sys
from collections import defaultdict
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LONGEST_LINE = 100
HIGHEST_COMPLEXITY = 15
#: Highest allowed values of the package, its tests and the scripts. They may be lowered, never
#: raised: only the nodes of the package were, for what a stranger's file needs and three answers.
#: Goals: 115 files, 180,000 nodes in the package and 110,000 in the tests, of names 1 % filler, of
#: 1000 nodes 4 comprehensions and 2 conditional expressions, 20 nested comprehensions, no others.
LIMITS = {
    "bayes_toe": {
        "files": 137,
        "nodes": 218_240,
        "long lines": 0,
        "complex functions": 0,
        "comprehensions": 3.62,
        "nested comprehensions": 10,
        "conditional expressions": 1.51,
        "filler names": 0.50,
        "import circles": 0,
    },
    "tests": {
        "files": 104,
        "nodes": 122_715,
        "long lines": 0,
        "complex functions": 0,
        "comprehensions": 3.70,
        "nested comprehensions": 4,
        "conditional expressions": 0.335,
        "filler names": 0.0,
        "import circles": 0,
    },
    "scripts": {"nodes": 34_500},
}

COMPREHENSIONS = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
BRANCHES = (
    ast.If | ast.IfExp | ast.For | ast.AsyncFor | ast.While
    | ast.ExceptHandler | ast.Assert | ast.Lambda | ast.match_case
)  # fmt: skip

GRAMMAR_WORDS = """
    about and apart as aside at away before beforehand behind beside between both by each enough for
    from here how in it its many may more most much nothing now of off on one ones only or others
    own past same so some such than that their them then there these they thing things this those
    thus to under upon what when where whether which who whole whom whose why with within without
"""
VERBS_WITHOUT_MEANING = """
    allowed asked begun came done found given gone got had has have is judged kept known laid lost
    made meant named needed placed put rest said seen shown sure taken tell tells told took tried
    used wanted wants was were
"""
FILLER_WORDS = frozenset((GRAMMAR_WORDS + VERBS_WITHOUT_MEANING + "place").split())


class Measurement:
    """The counts of a folder, and of each measure the places that it counts."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.files = sorted(folder.rglob("*.py"))
        self.places: dict[str, list[str]] = defaultdict(list)
        self.n_nodes = 0
        self.n_names = 0
        imports = {}
        for file in self.files:
            source = file.read_text(encoding="utf-8")
            tree = ast.parse(source)
            self._count_lines(file, source)
            for node in ast.walk(tree):
                self._count(file, node)
            imports[module_name(folder, file)] = set(imported_names(folder.name, tree))
        self.places["import circles"] = import_circles(imports)

    def _count_lines(self, file: Path, source: str) -> None:
        for number, line in enumerate(source.splitlines(), start=1):
            if len(line) > LONGEST_LINE:
                self._add("long lines", file, number, f"{len(line)} characters")

    def _count(self, file: Path, node: ast.AST) -> None:
        self.n_nodes += 1
        if isinstance(node, COMPREHENSIONS):
            self._add("comprehensions", file, node.lineno)
            if n_loops(node) > 1:
                self._add("nested comprehensions", file, node.lineno)
        elif isinstance(node, ast.IfExp):
            self._add("conditional expressions", file, node.lineno)
        elif isinstance(node, FUNCTIONS) and complexity(node) > HIGHEST_COMPLEXITY:
            text = f"{node.name} has {complexity(node)}"
            self._add("complex functions", file, node.lineno, text)
        name = bound_name(node)
        if name is not None:
            self.n_names += 1
            if is_filler(name):
                self._add("filler names", file, node.lineno, name)

    def _add(self, measure: str, file: Path, line: int, text: str = "") -> None:
        self.places[measure].append(f"{file.relative_to(ROOT)}:{line}: {text}")

    def value(self, measure: str) -> float:
        """The value of a measure, in the unit of its limit."""
        if measure == "files":
            return len(self.files)
        if measure == "nodes":
            return self.n_nodes
        count = len(self.places[measure])
        if measure in ("comprehensions", "conditional expressions"):
            return 1000 * count / self.n_nodes
        if measure == "filler names":
            return 100 * count / self.n_names
        return count


def complexity(function: ast.AST) -> int:
    """One and the number of branches, those of inner functions included."""
    result = 1
    for node in ast.walk(function):
        if isinstance(node, BRANCHES):
            result += 1
        elif isinstance(node, ast.BoolOp):
            result += len(node.values) - 1
        elif isinstance(node, ast.comprehension):
            result += 1 + len(node.ifs)
    return result


def n_loops(comprehension: ast.AST) -> int:
    """How many loops a comprehension has, those of inner comprehensions included."""
    return sum(isinstance(node, ast.comprehension) for node in ast.walk(comprehension))


def bound_name(node: ast.AST) -> str | None:
    """The name that a function, a parameter or a variable gets at a node."""
    if isinstance(node, FUNCTIONS):
        return node.name
    if isinstance(node, ast.arg) and node.arg not in ("self", "cls"):
        return node.arg
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        return node.id
    return None


def is_filler(name: str) -> bool:
    """Whether every word of a name is filler; a single letter may be a symbol of a formula."""
    words = name.lower().strip("_").split("_")
    is_symbol = len(name) == 1 or name.startswith("__") or words == [""]
    return not is_symbol and FILLER_WORDS.issuperset(words)


def module_name(folder: Path, file: Path) -> str:
    """The dotted name of a file inside its folder; that of an `__init__` is its folder's."""
    parts = file.relative_to(folder).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def imported_names(package: str, tree: ast.Module) -> Iterator[str]:
    """Dotted names, inside the package, that a file may import by `from ... import`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            module = (node.module or "").removeprefix(package).strip(".")
            yield module
            for alias in node.names:
                yield f"{module}.{alias.name}".strip(".")


def import_circles(imports: dict[str, set[str]]) -> list[str]:
    """A circle of modules that import each other; none where there is no circle."""
    graph = {}
    for module, names in imports.items():
        graph[module] = names.intersection(imports) - {module}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return [" <- ".join(error.args[1])]
    return []


def over_limits(measurement: Measurement, limits: dict[str, float]) -> list[str]:
    """Print every measure of a folder with its limit; return those that are over it."""
    print(f"{measurement.folder.name:34}      value      limit")
    over = []
    for measure, limit in limits.items():
        value = measurement.value(measure)
        is_over = value > limit
        print(f"  {measure:32}{value:11,.6g}{limit:11,.6g}{'  too high' * is_over}")
        if is_over:
            over.append(measure)
    return over


def main() -> int:
    """Measure package, tests and scripts; 1 where a measure is over its limit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--list", choices=LIMITS["bayes_toe"], metavar="MEASURE")
    options = parser.parse_args()
    over = []
    for name, limits in LIMITS.items():
        measurement = Measurement(ROOT / name)
        if options.list is None:
            over += over_limits(measurement, limits)
        else:
            print(*measurement.places[options.list], sep="\n")
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main())
