"""Commands that compare conditions (contrast) and consecutive trials (history)."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import bayes_toe as bt
from bayes_toe.cli.options import StudyFile, writes
from bayes_toe.cli.task import MODEL, Takes, Task
from bayes_toe.cli.terminal import Terminal, chosen, safe

if TYPE_CHECKING:
    from bayes_toe.answers.contrast import ContrastTable


def contrast(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("FILE.csv", "Table; the figure is FILE.png.")] = Path(
        "contrast.csv"
    ),
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe", "resume")],
) -> None:
    """Estimate differences between the conditions of each subject.

    [bold]Example[/bold]: bayes-toe contrast study.csv --condition hand -o contrast.csv --seed 1
    """
    from bayes_toe.plots.figure_files import picture_beside

    files = [output, picture_beside(output)]
    task.require_files(*files)
    keep = task.partial(output)
    read, prior = task.opened(study)
    people = len({one.person for one in read})
    table = task.work("contrasting", people, bt.contrast, read, prior=prior, keep=keep)
    figure = bt.plots.contrast_figure(table, synthetic=read.synthetic)
    task.write(
        {
            output: partial(table.save, **task.saving),
            picture_beside(output): partial(bt.plots.save_figure, figure),
        }
    )
    task.finish(keep, table.failed)
    say_contrast(task.out, table)
    task.done("written:", *files, seed=table.seed, failed=table.failed)


def say_contrast(out: Terminal, table: ContrastTable) -> None:
    """Of how many subjects each quantity differs, and every subject in a row for each comparison."""
    from bayes_toe.answers.contrast import LEGEND

    out.answer([f"between conditions: {table.conditions.about}"])
    for line in table.sentences():
        out.line(f"  {safe(line)}")
    decided = {row.subject for row in table if row.word.startswith("differs")}
    comparisons = {row.comparison for row in table}
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for row in table:
        cell = cells.setdefault((row.subject, row.comparison), {"subject": row.subject})
        if len(comparisons) > 1:
            cell["comparison"] = row.comparison
        cell[row.quantity] = f"{row.size} {row.factor}"
    names = chosen([subject.subject for subject in table.subjects], decided)
    rows = [cell for (name, _), cell in cells.items() if name in names]
    what = f"differences, {comparisons.pop()}" if len(comparisons) == 1 else "differences"
    out.table(
        f"{what}: medians (95 % interval) if they differ, and the Bayes factor",
        rows,
        total=len(rows),
    )
    out.footnote(f"{LEGEND}.")
    out.notes(
        (f"{name}: {why}" for name, why in table.left_out.items() if name not in table.failed),
        "left out",
    )
    out.notes(f"{one.subject}: {note}" for one in table.subjects for note in one.notes)


def history(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("FILE.csv", "Table; the figure is FILE.png.")] = Path(
        "history.csv"
    ),
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe")],
) -> None:
    """Estimate serial dependence: the effect of the previous trial.

    [bold]Example[/bold]: bayes-toe history trials.csv -o history.csv --seed 1
    """
    from bayes_toe.cli.answers import say_histories
    from bayes_toe.data.trial_sequence import require_order
    from bayes_toe.plots.figure_files import picture_beside

    picture = picture_beside(output)
    task.require_files(output, picture)
    read, prior = task.opened(study)
    for subject in read:
        require_order(subject)
    table = task.work("histories", len(read), bt.serial_dependence, read, prior=prior)
    figure = bt.plots.serial(table)
    task.write(
        {
            output: partial(table.save, **task.saving_of(read)),
            picture: partial(bt.plots.save_figure, figure),
        }
    )
    say_histories(task.out, table, output.name)
    task.done("written:", output, picture, seed=table.seed)
