"""The screens of `power` and `design`.

`print_power` shows how often simulated observers get 'yes' or 'probably', and `print_groups` what
studies of several subjects find.
"""

from __future__ import annotations

import numpy as np

from bayes_toe.answers.order_effect import QUESTIONS, SIZE_OF
from bayes_toe.answers.words import Word
from bayes_toe.cli.terminal import Terminal
from bayes_toe.data.messages import capitalized
from bayes_toe.data.stimulus_unit import StimulusUnit
from bayes_toe.design.power import DETECTED, GroupPower, GroupPowerTable, PowerTable
from bayes_toe.model.parameters import CONSTANT_ERROR


def print_power(out: Terminal, table: PowerTable) -> None:
    """Print the shares of 'yes' and 'probably' by observers, in a table for each design."""
    headings = ["trials", "observers", *(name.replace("_", " ") for name in QUESTIONS)]
    for design in table.different("design"):
        rows = []
        for name, trials in table.different("design", "trials"):
            if name == design:
                rows += _power_rows(table, design, trials)
        title = f"{capitalized(design)}: observers with 'yes' or 'probably' [95 % interval]"
        out.table(headings, rows, title=title)
    out.line("In brackets: false positives, from observers without the effect.")


def _power_rows(table: PowerTable, design: str, trials: int) -> list[list[str]]:
    """A row of the table for each kind of observers; only the first row has the number of trials.

    A share stands in brackets if the observers of this kind do not have the effect.
    """
    rows = []
    first_cell = f"{trials:,}"
    for kind in table.different("observers"):
        cells = [first_cell, kind]
        for question in QUESTIONS:
            share = table[design, trials, kind, question, DETECTED].percent
            if table.is_unknown(design, trials, question):
                share = "cannot be told"
            elif not table.has_effect(kind, question):
                share = f"({share})"
            cells.append(share)
        rows.append(cells)
        first_cell = ""
    return rows


def print_groups(
    out: Terminal, table: PowerTable, groups: GroupPowerTable, unit: StimulusUnit
) -> None:
    """Print what studies of several sizes detect: how many subjects, and how often group means.

    True means of the constant error are in `unit`.
    """
    for design, trials in table.different("design", "trials"):
        heading = f"{capitalized(design)}, {trials:,} trials"
        # Each kind of observers has a row for each size of a study.
        rows_by_kind = groups.select(design, trials, "order_effect")
        if not rows_by_kind:
            out.line(f"{heading}: an order effect {Word.CANNOT_BE_TOLD}.")
            continue

        cells = []
        for kind, rows in rows_by_kind.items():
            cells.append([kind, *(row.counts_text for row in rows)])
        # All kinds of observers have the same numbers of subjects: here those of the last kind.
        sizes = [f"{row.subjects} subjects" for row in rows]
        out.table(["observers", *sizes], cells, title=f"{heading}: subjects with an order effect")

        for question in SIZE_OF:
            name = question.replace("_", " ")
            if table.is_unknown(design, trials, question):
                out.line(f"{capitalized(name)}: {Word.CANNOT_BE_TOLD}.")
                continue
            cells = []
            for kind, rows in groups.select(design, trials, question).items():
                # The rows of a kind differ in the number of subjects, and have the same true mean.
                cells.append([kind, _true_mean(rows[0], unit), *(row.percent for row in rows)])
            title = f"{heading}: % of studies that detect the mean {name}"
            out.table(["observers", "mean (SD)", *sizes], cells, title=title)
    out.line()
    out.line(
        "Detected: 'yes' or 'probably', with 95 % intervals. SD: between subjects. In brackets: "
        "false positives, because the true mean is 0."
    )


def _true_mean(row: GroupPower, unit: StimulusUnit) -> str:
    """The true mean, and in brackets the standard deviation between subjects: '12 (4) %'.

    Constant errors are natural logs. In per cent, a standard deviation SD of constant errors is the
    size of a constant error of SD: 100 (exp(SD) - 1).
    """
    numbers = np.array([row.true_mean, row.true_sd])
    if row.question == CONSTANT_ERROR.name:
        numbers = unit.to_differences(numbers)
        unit_name = unit.difference_unit
    else:  # a contraction, which is a share
        numbers = 100.0 * numbers
        unit_name = "%"

    mean, sd = (float(f"{number:.2g}") for number in numbers)
    if not row.has_nonzero_mean:
        mean = 0.0  # The computed mean differs from 0 by an error of rounding.
    return f"{mean:g} ({sd:g}) {unit_name}"
