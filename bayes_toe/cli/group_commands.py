"""Commands that compare conditions (contrast) and consecutive trials (history)."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import bayes_toe as bt
from bayes_toe.cli.options import StudyFile, writes
from bayes_toe.cli.task import MODEL, Takes, Task


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
    from bayes_toe.cli.within_screens import contrast_lines, print_contrast
    from bayes_toe.plots.figure_files import picture_beside

    files = [output, picture_beside(output)]
    task.require_files(*files)
    keep = task.partial(output)
    read, prior = task.opened(study)
    n_subjects = len({subject.person for subject in read})
    table = task.work("comparing conditions", n_subjects, bt.contrast, read, prior=prior, keep=keep)
    figure = bt.plots.contrast(table, synthetic=read.synthetic)
    task.write(
        {
            output: partial(table.save, **task.saving),
            picture_beside(output): partial(bt.plots.save_figure, figure),
        }
    )
    task.finish(keep, table.failed)
    print_contrast(task.out, table, output.name)
    task.print_uninterpretable(read)
    task.print_failed(table.failed)
    written = f"Written: {', '.join(map(str, files))}. Seed {table.seed}."
    task.out.answer([*contrast_lines(table), written])
    task.end(table.failed)


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
    from bayes_toe.cli.within_screens import history_lines, print_histories
    from bayes_toe.data.trial_sequence import require_order
    from bayes_toe.plots.figure_files import picture_beside

    figure_file = picture_beside(output)
    task.require_files(output, figure_file)
    read, prior = task.opened(study)
    for subject in read:
        require_order(subject)
    table = task.work("serial dependence", len(read), bt.serial_dependence, read, prior=prior)
    figure = bt.plots.serial(table)
    task.write(
        {
            output: partial(table.save, **task.saving_of(read)),
            figure_file: partial(bt.plots.save_figure, figure),
        }
    )
    print_histories(task.out, table, output.name)
    task.print_uninterpretable(read)
    task.out.answer(
        [*history_lines(table), f"Written: {output}, {figure_file}. Seed {table.seed}."]
    )
