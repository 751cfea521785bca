"""The screens of `power` and `design`.

`print_power` shows how often simulated observers get 'yes' or 'probably', and `print_groups` what
studies of several subjects find.
"""

from __future__ import annotations

from itertools import groupby
from operator import itemgetter

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
    for design, sizes in groupby(table.different("design", "trials"), itemgetter(0)):
        rows = []
        for _, trials in sizes:
            rows += _power_rows(table, design, trials)
        title = f"{capitalized(design)}: observers with 'yes' or 'probably' [95 % interval]"
        out.table(headings, rows, title=title)
    out.line("In brackets: false positives, from observers without the effect.")


def _power_rows(table: PowerTable, design: str, trials: int) -> list[list[str]]:
    """A row of the table for each kind of observers; only the first row has the number of trials.

    A share stands in brackets if the observers of this kind do not have the effect.
    """
    rows: list[list[str]] = []
    for kind in table.different("observers"):
        cells = [f"{trials:,}" if not rows else "", kind]
        for question in QUESTIONS:
            estimate = table[design, trials, kind, question, DETECTED]
            if table.is_unknown(design, trials, question):
                cells.append("cannot be told")
            elif table.has_effect(kind, question):
                cells.append(estimate.percent)
            else:
                cells.append(f"({estimate.percent})")
        rows.append(cells)
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
        # All kinds of observers have the same numbers of subjects: those of the first kind.
        sizes = [f"{row.subjects} subjects" for row in next(iter(rows_by_kind.values()))]
        rows = []
        for kind, kind_rows in rows_by_kind.items():
            rows.append([kind, *(row.counts_text for row in kind_rows)])
        out.table(["observers", *sizes], rows, title=f"{heading}: subjects with an order effect")
        for question in SIZE_OF:
            name = question.replace("_", " ")
            if table.is_unknown(design, trials, question):
                out.line(f"{capitalized(name)}: {Word.CANNOT_BE_TOLD}.")
                continue
            rows = []
            for kind, kind_rows in groups.select(design, trials, question).items():
                # The rows of a kind differ in the number of subjects, and have the same true mean.
                rows.append(
                    [kind, _true_mean(kind_rows[0], unit), *(row.percent for row in kind_rows)]
                )
            title = f"{heading}: % of studies that detect the mean {name}"
            out.table(["observers", "mean (SD)", *sizes], rows, title=title)
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
    if row.question == CONSTANT_ERROR.name:
        values = unit.to_differences([row.true_mean, row.true_sd])
        unit_name = unit.difference_unit
    else:  # a contraction, which is a share
        values = 100.0 * np.array([row.true_mean, row.true_sd])
        unit_name = "%"

    mean, sd = (float(f"{value:.2g}") for value in values)
    if not row.has_nonzero_mean:
        mean = 0.0  # The computed mean differs from 0 by an error of rounding.
    return f"{mean:g} ({sd:g}) {unit_name}"
