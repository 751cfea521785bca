"""The screens of `power` and `design`: how often a design detects the effects of observers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayes_toe.answers.order_effect import QUESTIONS
from bayes_toe.answers.words import Word
from bayes_toe.cli.terminal import Terminal
from bayes_toe.data.messages import capitalized
from bayes_toe.design.optimal_pairs import OPTIMISED
from bayes_toe.design.power import FOUND

if TYPE_CHECKING:
    from bayes_toe.design.optimal_pairs import OptimalDesign
    from bayes_toe.design.power import PowerTable


def print_power(out: Terminal, table: PowerTable, only: str = "") -> None:
    """Shares of 'yes' and 'probably' by observers, a table for each design; of one with `only`."""
    for design in table.different("design"):
        if only not in ("", design):
            continue
        rows = []
        for name, trials in table.designs:
            if name == design:
                rows += _power_rows(table, name, trials)
        headings = ["trials", "observers", *(name.replace("_", " ") for name in QUESTIONS)]
        title = f"{capitalized(design)}: observers with 'yes' or 'probably' [95 % interval]"
        out.table(headings, rows, title=title)
    out.line("In brackets: false positives, from observers without the effect.")


def _power_rows(table: PowerTable, design: str, trials: int) -> list[list[str]]:
    """A row for each kind of observers; the number of trials stands in the first."""
    rows = list[list[str]]()
    for kind in table.different("observers"):
        cells = [f"{trials:,}" if not rows else "", kind]
        for question in QUESTIONS:
            estimate = table[design, trials, kind, question, FOUND]
            unknown = table[design, trials, kind, question, Word.CANNOT_BE_TOLD.value]
            if unknown.value == 1.0:
                cells.append("cannot be told")
            elif table.has_effect(kind, question):
                cells.append(estimate.percent)
            else:
                cells.append(f"({estimate.hits})")
        rows.append(cells)
    return rows


def power_lines(table: PowerTable, only: str = "") -> list[str]:
    """How often each effect is detected if it is there, a sentence for each design."""
    lines = []
    for design, trials in table.designs:
        if only not in ("", design):
            continue
        parts = []
        for question in QUESTIONS:
            name = question.replace("_", " ")
            if not _is_known(table, design, trials, question):
                parts.append(f"{name} cannot be told")
                continue
            detected = table.found(design, trials, question, has_effect=True)
            wrong = table.found(design, trials, question, has_effect=False)
            text = name if detected is None else f"{name} {100.0 * detected[0]:.0f} %"
            parts.append(text if wrong is None else f"{text} ({100.0 * wrong[0]:.0f} %)")
        lines.append(f"{capitalized(design)}, {trials:,} trials: {', '.join(parts)}.")
    return ["Effects detected (false positives in brackets):", *lines]


def _is_known(table: PowerTable, design: str, trials: int, question: str) -> bool:
    """Whether the pairs of a design can show an effect."""
    unknown = [
        table[design, trials, kind, question, Word.CANNOT_BE_TOLD.value].value
        for kind in table.different("observers")
    ]
    return min(unknown) < 1.0


def print_design(out: Terminal, found: OptimalDesign) -> None:
    """The expected errors of the design and its rivals, then the power of the design."""
    candidates = found.candidates
    effects = list(candidates[OPTIMISED].sd)
    headings = ["design", *(f"SD of\n{name.replace('_', ' ')}" for name in effects)]
    rows = []
    for name, candidate in candidates.items():
        rows.append([name, *(f"{candidate.sd[effect]:.2g}" for effect in effects)])
    out.table(headings, rows, title="Expected posterior SD, smaller is better")
    print_power(out, found.power, OPTIMISED)
