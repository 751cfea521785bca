"""The commands `population`, `contrast` and `history`.

`population` estimates a group, `contrast` compares the conditions of each subject, and `history`
estimates how a response depends on the previous trial.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import bayes_toe as bt
from bayes_toe.cli.options import File, StudyFile, Texts
from bayes_toe.cli.run_context import MODEL, RunContext


def population(
    *,
    study: StudyFile,
    output: Path = Path("population.nc"),
    covariates: File = None,
    categorical: Texts = None,
    hyperprior: File = None,
    draws: int = 3200,
    context: Annotated[RunContext, "seed", "overwrite"],
) -> None:
    """Estimate the group mean and the SD between subjects.

    [bold]Example[/bold]: bayes-toe population study.csv -o population.nc --seed 1
    """
    from bayes_toe.answers.group_answer import group_answer
    from bayes_toe.cli.group_screen import print_group
    from bayes_toe.data.tables import write_table
    from bayes_toe.groups.predictive_check import predictive_check

    if output.suffix != ".nc":
        raise bt.InputError(
            f"{output}: the ending is {output.suffix!r}. Draws need .nc; tables and figure have "
            "the same name with another ending."
        )
    if categorical and covariates is None:
        raise bt.InputError(f"--categorical {categorical[0]} needs --covariates FILE.csv.")

    table_file, figure_file = output.with_suffix(".csv"), output.with_suffix(".png")
    subjects_file = output.with_name(f"{output.stem}_subjects.csv")
    context.require_files(output, table_file, subjects_file, figure_file)

    read, _ = context.read_and_describe(study)
    result = bt.population(
        read,
        covariates=covariates,
        categorical=tuple(categorical or ()),
        draws=draws,
        seed=context.seed,
        hyperprior=hyperprior,
    )
    check = predictive_check(result)

    seed = result.settings.seed
    written = context.write(
        {
            output: result.save,
            table_file: result.table.save,
            subjects_file: partial(write_table, result.subject_table, seed=seed),
            figure_file: partial(bt.plots.save_figure, bt.plots.population(result, check)),
        },
        seed,
    )

    print_group(context.out, result, check)
    context.print_uninterpretable(read)
    context.out.answer([*group_answer(result), written])
    context.end(not result.is_reliable)


def contrast(
    *,
    study: StudyFile,
    output: Path = Path("contrast.csv"),
    context: Annotated[RunContext, *MODEL, "resume"],
) -> None:
    """Compare the conditions, or the tasks, of each subject.

    [bold]Example[/bold]: bayes-toe contrast study.csv --condition hand -o contrast.csv --seed 1
    """
    from bayes_toe.answers.study_summary import study_lines
    from bayes_toe.cli.group_screen import print_contrast, print_one_observer
    from bayes_toe.plots.figure_files import picture_beside

    figure_file = picture_beside(output)
    keep = context.prepare(output, figure_file)
    read, prior = context.read(study, several_tasks=True)
    context.introduce(read, prior)
    n_subjects = len({subject.subject_name for subject in read})
    answers_file = output.with_name(f"{output.stem}_one_observer{output.suffix}")
    has_tasks = len(read.by_task) > 1
    if has_tasks:
        context.require_files(answers_file)

    table = context.work(
        "comparing conditions", n_subjects, bt.contrast, read, prior=prior, keep=keep
    )
    figure = bt.plots.contrast(table, synthetic=read.synthetic)
    writers: dict[Path, Any] = {
        output: table.save,
        figure_file: partial(bt.plots.save_figure, figure),
    }
    if has_tasks:
        writers[answers_file] = table.save_answers
    written = context.write(writers, table.seed)
    context.finish(keep, table.failed)

    print_contrast(context.out, table, output.name)
    context.print_uninterpretable(read)
    context.out.reasons("No result", table.failed)
    lines = table.sentences()
    if has_tasks:
        print_one_observer(context.out, table, answers_file.name)
        lines.append("If one observer does all tasks of a subject:")
        lines += study_lines(table.answers, synthetic=read.synthetic)
    context.out.answer([*lines, written])
    context.end(table.failed)


def history(
    *,
    study: StudyFile,
    output: Path = Path("history.csv"),
    context: Annotated[RunContext, *MODEL],
) -> None:
    """Estimate serial dependence, the effect of the previous trial.

    [bold]Example[/bold]: bayes-toe history trials.csv -o history.csv --seed 1
    """
    from bayes_toe.cli.group_screen import history_lines, print_history
    from bayes_toe.model.trial_history import require_order
    from bayes_toe.plots.figure_files import picture_beside

    figure_file = picture_beside(output)
    context.require_files(output, figure_file)
    read, prior = context.read_and_describe(study)
    for subject in read:
        require_order(subject)

    table = context.work("serial dependence", len(read), bt.serial_dependence, read, prior=prior)
    written = context.write(
        {
            output: partial(table.save, units=read.conditions is not None),
            figure_file: partial(bt.plots.save_figure, bt.plots.serial(table)),
        },
        table.seed,
    )

    print_history(context.out, table, output.name)
    context.print_uninterpretable(read)
    context.out.answer([*history_lines(table), written])
