"""The commands `population`, `contrast` and `history`.

`population` estimates a group, `contrast` compares the conditions of each subject, and `history`
estimates how a response depends on the previous trial.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import bayes_toe as bt
from bayes_toe.cli.options import (
    DrawCount,
    File,
    OutputTableAndFigure,
    StudyFile,
    Texts,
    option,
    rare,
    writes,
)
from bayes_toe.cli.run_context import MODEL, RunContext

#: The help of --hyperprior. It is written out here, so that help does not import SciPy.
_HYPERPRIOR = r"Prior file with \[group.PARAMETER] sections."


def population(
    *,
    file: StudyFile,
    output: Annotated[
        Path, writes("FILE.nc", "Output draws. Tables and figure are beside them.")
    ] = Path("population.nc"),
    covariates: Annotated[
        File, option("--covariates", "FILE.csv", "Table with subjects and covariates.")
    ] = None,
    categorical: Annotated[
        Texts, rare("--categorical", "NAME", "Covariate whose numbers are names; repeatable.")
    ] = None,
    hyperprior: Annotated[File, rare("--hyperprior", "FILE.toml", _HYPERPRIOR)] = None,
    draws: DrawCount = 3200,
    context: Annotated[RunContext, "seed", "overwrite"],
) -> None:
    """Estimate the group mean and the SD between subjects.

    [bold]Example[/bold]: bayes-toe population study.csv -o population.nc --seed 1
    """
    from bayes_toe.answers.group_answer import group_answer
    from bayes_toe.cli.group_screen import print_group
    from bayes_toe.data.tables import write_table
    from bayes_toe.groups.predictive_check import contradictions

    if output.suffix != ".nc":
        raise bt.InputError(
            f"{output}: the ending is {output.suffix!r}. Draws need .nc; tables and figure have "
            "the same name with another ending."
        )
    if categorical and covariates is None:
        raise bt.InputError(f"--categorical {categorical[0]} needs --covariates FILE.csv.")

    table_file = output.with_suffix(".csv")
    subjects_file = output.with_name(f"{output.stem}_subjects.csv")
    figure_file = output.with_suffix(".png")
    context.require_files(output, table_file, subjects_file, figure_file)
    study, _ = context.read_and_describe(file)
    result = bt.population(
        study,
        covariates=covariates,
        categorical=tuple(categorical or ()),
        draws=draws,
        seed=context.seed,
        hyperprior=hyperprior,
    )
    seed = result.settings.seed
    written = context.write(
        {
            output: result.save,
            table_file: result.table.save,
            subjects_file: partial(write_table, result.subject_table, seed=seed),
            figure_file: partial(bt.plots.save_figure, bt.plots.population(result)),
        },
        seed,
    )

    print_group(context.out, result, contradictions(result))
    context.print_uninterpretable(study)
    context.out.answer([*group_answer(result), written])
    context.end_with_problems(not result.is_reliable)


def contrast(
    *,
    file: StudyFile,
    output: OutputTableAndFigure = Path("contrast.csv"),
    context: Annotated[RunContext, *MODEL, "resume"],
) -> None:
    """Compare the conditions, or the tasks, of each subject.

    [bold]Example[/bold]: bayes-toe contrast study.csv --condition hand -o contrast.csv --seed 1
    """
    from bayes_toe.answers.study_summary import study_lines
    from bayes_toe.cli.answer_screen import print_subjects
    from bayes_toe.cli.group_screen import print_contrast

    figure_file = output.with_suffix(".png")
    context.require_files(output, figure_file)
    store = context.partial_folder(output)
    study, prior = context.read_and_describe(file, several_tasks=True)

    # A study has an entry for each subject in a condition: 'S01@left', 'S01@right'.
    n_subjects = len({subject.subject_name for subject in study})
    # With several tasks, a third file has the answers of one observer who does all of them.
    answers_file = output.with_name(f"{output.stem}_one_observer{output.suffix}")
    has_several_tasks = len(study.by_task) > 1
    if has_several_tasks:
        context.require_files(answers_file)

    table = context.work(
        "comparing conditions", n_subjects, bt.contrast, study, prior=prior, keep=store
    )
    figure = bt.plots.contrast(table, synthetic=study.synthetic)
    writers: dict[Path, Any] = {
        output: table.save,
        figure_file: partial(bt.plots.save_figure, figure),
    }
    if has_several_tasks:
        writers[answers_file] = table.save_answers
    written = context.write(writers, table.seed)
    context.finish(store, table.failed)

    print_contrast(context.out, table, str(output))
    context.print_uninterpretable(study)
    context.out.reasons("No result", table.failed)
    lines = table.sentences()
    if has_several_tasks:
        heading = "If one observer does all tasks of a subject:"
        context.out.line()
        context.out.line(heading)
        print_subjects(context.out, table.answers, answers_file.name)
        context.out.line(
            "This does not test whether one observer fits. 'evidence' tests the fit of each task."
        )
        lines.append(heading)
        lines += study_lines(table.answers, synthetic=study.synthetic)
    context.out.answer([*lines, written])
    context.end_with_problems(table.failed)


def history(
    *,
    file: StudyFile,
    output: OutputTableAndFigure = Path("history.csv"),
    context: Annotated[RunContext, *MODEL],
) -> None:
    """Estimate serial dependence, the effect of the previous trial.

    [bold]Example[/bold]: bayes-toe history trials.csv -o history.csv --seed 1
    """
    from bayes_toe.cli.group_screen import history_lines, print_history

    figure_file = output.with_suffix(".png")
    context.require_files(output, figure_file)
    study, prior = context.read_and_describe(file)
    table = context.work("serial dependence", len(study), bt.serial_dependence, study, prior=prior)
    written = context.write(
        {
            # With conditions a row is a unit, such as S01@left.
            output: partial(table.save, units=study.conditions is not None),
            figure_file: partial(bt.plots.save_figure, bt.plots.serial(table)),
        },
        table.seed,
    )

    print_history(context.out, table, str(output))
    context.print_uninterpretable(study)
    context.out.answer([*history_lines(table), written])
    context.end_with_problems(not all(row.has_result for row in table))
