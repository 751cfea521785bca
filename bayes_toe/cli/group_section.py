"""The group in a results folder: its tables and figure, and what the report's section says of it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bayes_toe.cli.population_answer import CORRELATED, answer, correlations, effect, naturals, reference, scales
from bayes_toe.groups.population import Population
from bayes_toe.groups.predictive_check import PredictiveCheck

#: What of it is in a results folder.
GROUP_PRODUCTS = ("population.csv", "population_subjects.csv", "population.png", "population.nc")

_MINUS = re.compile(r"(?<![\w.])-(?=\d)")  # of a number; not the hyphen of a word, a range or an exponent


@dataclass(frozen=True, eq=False)
class Group:
    """What the subjects have in common, and whether a population of this form can be believed."""

    found: Population
    check: PredictiveCheck


def write_group(group: Group, folder: Path, *, spreadsheet_safe: bool = False) -> None:
    """Write :data:`GROUP_PRODUCTS`."""
    from bayes_toe.groups.member_table import member_table
    from bayes_toe.plots.figure_files import png
    from bayes_toe.plots.population import population_figure

    table, members, picture, draws = (folder / name for name in GROUP_PRODUCTS)
    group.found.table.save(table, spreadsheet_safe=spreadsheet_safe)
    member_table(group.found).save(members, spreadsheet_safe=spreadsheet_safe)
    picture.write_bytes(png(population_figure(group.found, group.check)))
    group.found.save(draws)


def group_section(group: Group, folder: Path) -> dict[str, Any]:
    """What the template asks for: warnings first, then the answer, the figure, tables."""
    from rich.text import Text

    found = group.found
    tables: list[tuple[str, Sequence[dict[Any, Any]]]] = [
        ("mean (5 %, 95 %)", scales(found)),
        (CORRELATED, correlations(found)),
        (f"medians (5 %, 95 %){Text.from_markup(reference(found)).plain}", naturals(found)),
        ("effects of covariates", [effect(row) for row in found.table.some("effect")]),
    ]
    return {
        "problems": [*found.problems, *group.check.warnings],
        "converged": found.converged,
        "answer": [_typeset(Text.from_markup(line).plain) for line in answer(found)],
        "picture": folder / GROUP_PRODUCTS[2],
        "tables": [(title, [{key: _typeset(str(value)) for key, value in row.items()} for row in rows]) for title, rows in tables if rows],
        "hyperprior": found.settings.hyperprior.describe(found.names, correlations=found.settings.correlations),
        "scatter": found.settings.scatter,
        "subjects": len(found.study),
    }


def _typeset(words: str) -> str:
    """What a terminal shows, with minus signs as the rest of the report has them."""
    return _MINUS.sub("−", words)
