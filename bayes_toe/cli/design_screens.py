"""The screens of `power` and `design`.

`print_power` shows how often simulated observers get 'yes' or 'probably'. `print_design` shows the
expected errors of the optimised design and its rivals, then its power.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayes_toe.answers.order_effect import QUESTIONS
from bayes_toe.answers.words import Word
from bayes_toe.cli.terminal import Terminal
from bayes_toe.data.messages import capitalized
from bayes_toe.design.optimal_pairs import OPTIMISED
from bayes_toe.design.power import DETECTED

if TYPE_CHECKING:
    from bayes_toe.design.optimal_pairs import OptimalDesign
    from bayes_toe.design.power import PowerTable


def print_power(out: Terminal, table: PowerTable, selected: str = "") -> None:
    """Shares of 'yes' and 'probably' by observers: a table for each design, or the selected one."""
    headings = ["trials", "observers", *(name.replace("_", " ") for name in QUESTIONS)]
    for design in [selected] if selected else table.different("design"):
        rows = []
        for name, trials in table.designs:
            if name == design:
                rows += _power_rows(table, name, trials)
        title = f"{capitalized(design)}: observers with 'yes' or 'probably' [95 % interval]"
        out.table(headings, rows, title=title)
    out.line("In brackets: false positives, from observers without the effect.")


def _power_rows(table: PowerTable, design: str, trials: int) -> list[list[str]]:
    """A row for each kind of observers; the number of trials stands in the first."""
    rows = list[list[str]]()
    for kind in table.different("observers"):
        cells = [f"{trials:,}" if not rows else "", kind]
        for question in QUESTIONS:
            estimate = table[design, trials, kind, question, DETECTED]
            unknown = table[design, trials, kind, question, Word.CANNOT_BE_TOLD.value]
            if unknown.value == 1.0:
                cells.append("cannot be told")
            elif table.has_effect(kind, question):
                cells.append(estimate.percent)
            else:
                cells.append(f"({estimate.counts_text})")
        rows.append(cells)
    return rows


def print_design(out: Terminal, optimal: OptimalDesign) -> None:
    """The expected errors of the design and its rivals, then the power of the design."""
    candidates = optimal.candidates
    effects = list(candidates[OPTIMISED].sd)
    headings = ["design", *(f"SD of\n{name.replace('_', ' ')}" for name in effects)]
    rows = []
    for name, candidate in candidates.items():
        errors = candidate.errors(optimal.unit)
        rows.append([name, *(errors[effect] for effect in effects)])
    out.table(headings, rows, title="Expected posterior SD, smaller is better")
    print_power(out, optimal.power, OPTIMISED)
