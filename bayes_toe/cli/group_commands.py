"""Commands about a group, conditions within subjects, and consecutive trials."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import bayes_toe as bt
from bayes_toe.cli.options import DrawCount, File, StudyFile, Texts, option, rare, writes
from bayes_toe.cli.task import MODEL, Task

#: In words, because the module of the hyperprior loads SciPy.
_HYPERPRIOR = r"Prior of the group: \[constant_error], \[contraction], \[noise], \[q0]."


def population(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("FILE.nc", "Draws; tables and figure beside them.")] = Path(
        "population.nc"
    ),
    covariates: Annotated[
        File, option("--covariates", "FILE.csv", "Table of subject and covariates.")
    ] = None,
    categorical: Annotated[
        Texts, rare("--categorical", "NAME", "Covariate whose numbers are names; repeatable.")
    ] = None,
    hyperprior: Annotated[File, rare("--hyperprior", "FILE.toml", _HYPERPRIOR)] = None,
    draws: DrawCount = 3200,
    task: Annotated[Task, "seed", "overwrite"],
) -> None:
    """Estimate the group mean and the SD between subjects.

    [bold]Example[/bold]: bayes-toe population study.csv -o population.nc --seed 1
    """
    from bayes_toe.cli.group_screen import group_answer, print_group
    from bayes_toe.groups.predictive_check import predictive_check

    if output.suffix != ".nc":
        raise bt.InputError(
            f"{output}: the ending is {output.suffix!r}. Draws need .nc; tables and figure have "
            "the same name with another ending."
        )
    if categorical and covariates is None:
        raise bt.InputError(f"--categorical {categorical[0]} needs --covariates FILE.csv.")
    table, figure = output.with_suffix(".csv"), output.with_suffix(".png")
    subjects = output.with_name(f"{output.stem}_subjects.csv")
    task.require_files(output, table, subjects, figure)
    read, _ = task.opened(study)
    result = bt.population(
        read,
        covariates=covariates,
        categorical=tuple(categorical or ()),
        draws=draws,
        seed=task.seed,
        hyperprior=hyperprior,
    )
    check = predictive_check(result)
    written = task.write(
        {
            output: result.save,
            table: partial(result.table.save, overwrite=task.overwrite),
            subjects: partial(result.subject_table.save, overwrite=task.overwrite),
            figure: partial(bt.plots.save_figure, bt.plots.population(result, check)),
        }
    )
    print_group(task.out, result, check)
    task.print_uninterpretable(read)
    task.out.answer([*group_answer(result), f"{written} Seed {result.settings.seed}."])
    task.end({} if result.is_reliable else {"group": result.draws.shortfall})


def contrast(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("FILE.csv", "Table; the figure is FILE.png.")] = Path(
        "contrast.csv"
    ),
    task: Annotated[Task, *MODEL, "resume"],
) -> None:
    """Estimate differences between the conditions of each subject.

    [bold]Example[/bold]: bayes-toe contrast study.csv --condition hand -o contrast.csv --seed 1
    """
    from bayes_toe.cli.within_screens import print_contrast
    from bayes_toe.plots.figure_files import picture_beside

    figure_file = picture_beside(output)
    task.require_files(output, figure_file)
    keep = task.partial(output)
    read, prior = task.opened(study)
    n_subjects = len({subject.subject_name for subject in read})
    table = task.work("comparing conditions", n_subjects, bt.contrast, read, prior=prior, keep=keep)
    figure = bt.plots.contrast(table, synthetic=read.synthetic)
    written = task.write(
        {
            output: partial(table.save, overwrite=task.overwrite),
            figure_file: partial(bt.plots.save_figure, figure),
        }
    )
    task.finish(keep, table.failed)
    print_contrast(task.out, table, output.name)
    task.print_uninterpretable(read)
    task.print_failed(table.failed)
    task.out.answer([*table.sentences(), f"{written} Seed {table.seed}."])
    task.end(table.failed)


def history(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("FILE.csv", "Table; the figure is FILE.png.")] = Path(
        "history.csv"
    ),
    task: Annotated[Task, *MODEL],
) -> None:
    """Estimate serial dependence: the effect of the previous trial.

    [bold]Example[/bold]: bayes-toe history trials.csv -o history.csv --seed 1
    """
    from bayes_toe.cli.within_screens import history_lines, print_histories
    from bayes_toe.model.trial_history import require_order
    from bayes_toe.plots.figure_files import picture_beside

    figure_file = picture_beside(output)
    task.require_files(output, figure_file)
    read, prior = task.opened(study)
    for subject in read:
        require_order(subject)
    table = task.work("serial dependence", len(read), bt.serial_dependence, read, prior=prior)
    figure = bt.plots.serial(table)
    written = task.write(
        {
            output: partial(table.save, **task.saving_of(read)),
            figure_file: partial(bt.plots.save_figure, figure),
        }
    )
    print_histories(task.out, table, output.name)
    task.print_uninterpretable(read)
    task.out.answer([*history_lines(table), f"{written} Seed {table.seed}."])
