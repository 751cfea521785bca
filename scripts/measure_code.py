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
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HIGHEST_COMPLEXITY = 15
#: Highest allowed values of the package, its tests and the scripts. They may be lowered, never
#: raised: only the nodes of the package were, for what a stranger's file needs and three answers.
#: Goals: 115 files, 180,000 nodes in the package and 110,000 in the tests, of names 1 % filler, of
#: 1000 nodes 4 comprehensions and 2 conditional expressions, 20 nested comprehensions, no others.
LIMITS = {
    "bayes_toe": {
        "files": 136,
        "nodes": 207_600,
        "complex functions": 0,
        "comprehensions": 3.55,
        "nested comprehensions": 4,
        "conditional expressions": 1.45,
        "filler names": 0.50,
    },
    "tests": {
        "files": 102,
        "nodes": 115_000,
        "complex functions": 0,
        "comprehensions": 3.45,
        "nested comprehensions": 4,
        "conditional expressions": 0.25,
        "filler names": 0.0,
    },
    "scripts": {"nodes": 30_000},
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


def measure(folder: Path) -> tuple[dict[str, float], dict[str, list[str]]]:
    """The values of all measures in the units of their limits, and the places that each counts."""
    n_files, n_nodes, n_names = 0, 0, 0
    places = {measure: list[str]() for measure in LIMITS["bayes_toe"]}
    for file in sorted(folder.rglob("*.py")):
        n_files += 1
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            n_nodes += 1
            n_names += bound_name(node) is not None
            for measure, text in findings(node):
                places[measure].append(f"{file.relative_to(ROOT)}:{node.lineno}: {text}")
    values = {measure: len(places[measure]) for measure in places}
    values |= {"files": n_files, "nodes": n_nodes}
    for measure in ("comprehensions", "conditional expressions"):
        values[measure] *= 1000 / n_nodes
    values["filler names"] *= 100 / n_names
    return values, places


def findings(node: ast.AST) -> Iterator[tuple[str, str]]:
    """The measures that count a node, with a text for the list."""
    if isinstance(node, COMPREHENSIONS):
        yield "comprehensions", ""
        n_loops = sum(isinstance(inner, ast.comprehension) for inner in ast.walk(node))
        if n_loops > 1:
            yield "nested comprehensions", ""
    elif isinstance(node, ast.IfExp):
        yield "conditional expressions", ""
    elif isinstance(node, FUNCTIONS) and complexity(node) > HIGHEST_COMPLEXITY:
        yield "complex functions", f"{node.name} has {complexity(node)}"
    name = bound_name(node)
    if name is not None and is_filler(name):
        yield "filler names", name


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


def main() -> int:
    """Measure package, tests and scripts; 1 where a measure is over its limit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--list", choices=LIMITS["bayes_toe"], metavar="MEASURE")
    options = parser.parse_args()
    n_over = 0
    for name, limits in LIMITS.items():
        values, places = measure(ROOT / name)
        if options.list is not None:
            print(*places[options.list], sep="\n")
            continue
        print(f"{name:34}      value      limit")
        for measured, limit in limits.items():
            value = values[measured]
            n_over += value > limit
            print(f"  {measured:32}{value:11,.6g}{limit:11,.6g}{'  too high' * (value > limit)}")
    return int(n_over > 0)


if __name__ == "__main__":
    sys.exit(main())
