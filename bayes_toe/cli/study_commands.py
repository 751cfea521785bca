"""The commands `check` and `fit`, and what they print.

`check` shows how a study was read and what its design can show. `fit` fits the paper's model by
maximum likelihood with bootstrap intervals, and tests the asymmetry of both orders.
"""

from __future__ import annotations

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import bayes_toe as bt
from bayes_toe.cli.options import (
    NUMBER,
    File,
    OutputTable,
    StudyFile,
    file_name,
    option,
    rare,
)
from bayes_toe.cli.run_context import MODEL, RunContext
from bayes_toe.cli.terminal import Terminal, notes_of, number, without_zeros
from bayes_toe.data.messages import format_p_value

if TYPE_CHECKING:
    from bayes_toe.classical.asymmetry import AsymmetryTable
    from bayes_toe.classical.fit import FitTable


def check(
    *,
    file: StudyFile,
    context: Annotated[RunContext, "prior"],
) -> None:
    """Check the data, the design and the responses of a study.

    [bold]Example[/bold]: bayes-toe check study.csv
    """
    from bayes_toe.cli.check_screen import print_check
    from bayes_toe.model.prior_file import preset_or_file

    prior = None if context.prior is None else preset_or_file(context.prior)
    # No validation here, because `check` also reports studies that cannot be analysed.
    print_check(context.out, file.read(), prior)


def fit(
    *,
    file: StudyFile,
    output: OutputTable = Path("fit.csv"),
    replicates: Annotated[
        int, rare("--replicates", NUMBER, "Bootstrap replicates.", min=1, max=10**6)
    ] = 400,
    asymmetry_output: Annotated[
        File,
        option("--asymmetry", "FILE.csv", "Write the test of each pair, too.", parser=file_name),
    ] = None,
    context: Annotated[RunContext, *MODEL],
) -> None:
    """Fit the paper's model, and test each pair for an order effect.

    [bold]Example[/bold]: bayes-toe fit study.csv -o fit.csv --seed 1
    """
    outputs = [output] if asymmetry_output is None else [output, asymmetry_output]
    context.require_files(*outputs)
    study, prior = context.read_and_describe(file)

    # A study without pairs in both orders cannot be tested, but its model can be fitted.
    asymmetries = None
    try:
        asymmetries = bt.asymmetry(study)
    except bt.InputError as error:
        if asymmetry_output is not None:
            raise
        context.out.remarks([f"No test of asymmetry: {error}."])

    table = context.work("fitting", len(study), bt.fit, study, replicates=replicates, prior=prior)
    save_options = {"overwrite": context.overwrite, "units": study.conditions is not None}
    table.save(output, **save_options)
    print_fits(context.out, table)
    if asymmetries is not None:
        print_asymmetry(context.out, asymmetries)
        if asymmetry_output is not None:
            asymmetries.save(asymmetry_output, **save_options)
    context.print_written(f"Table in {', '.join(map(str, outputs))}", table.seed)


def print_asymmetry(out: Terminal, table: AsymmetryTable) -> None:
    """Print the largest asymmetry of each subject, and the counts over subjects."""
    rows = []
    for row in table:
        cells = [row.subject, str(len(row.comparisons))]
        largest = row.maximal  # None if no pair came in both orders
        if largest is None:
            cells.append("no pair in both orders")
        else:
            pair = (largest.s_weak, largest.s_strong)
            cells += [
                without_zeros(f"{largest.asymmetry:+.2f} ± {largest.asymmetry_se:.2f}"),
                ", ".join(map(table.unit.describe, pair)),
                format_p_value(largest.p_value),
                format_p_value(largest.p_adjusted),
            ]
        rows.append(cells)

    headings = ["subject", "pairs", "largest q(c, r) - q(r, c)", "r, c", "p", "p (Holm)"]
    out.table(headings, rows, numeric=(1,), title="Asymmetry of the orders, without a model")
    out.line(table.describe())
    out.line(
        f"q is the share of {table.share_of} responses, r the weaker and c the stronger stimulus."
    )


def print_fits(out: Terminal, table: FitTable) -> None:
    """Print the fit of each subject: estimates [bootstrap interval], likelihood and problems."""
    rows = []
    for row in table:
        cells = [row.subject]
        intervals = row.intervals().tolist()  # low and high end for each parameter
        for value, (low, high) in zip(row.parameters.tolist(), intervals, strict=True):
            text = number(value)
            if not isnan(value) and not isnan(low):  # The parameter has a fit and replicates.
                text += f" [{low:.2f}, {high:.2f}]"
            cells.append(without_zeros(text))
        rows.append([*cells, f"{row.log_likelihood:.2f}", row.at_edge])

    title = f"Maximum likelihood [95 % interval of {table.replicates} bootstrap replicates]"
    out.table(["subject", *table.rows[0].names, "log likelihood", "at edge"], rows, title=title)
    out.notes(notes_of(table), mark="-")
