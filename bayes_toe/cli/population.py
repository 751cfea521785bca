"""The command `population`: what a group has in common, and what is printed of it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import bayes_toe as bt
from bayes_toe.cli.options import StudyFile, rare, writes
from bayes_toe.cli.task import Takes, Task
from bayes_toe.cli.terminal import Terminal, safe
from bayes_toe.data.messages import counted

if TYPE_CHECKING:
    from bayes_toe.groups.population import GroupEffect, Interval, PopulationResult
    from bayes_toe.groups.population_table import PopulationRow

#: In words, because the module of the hyperprior loads SciPy.
_HYPERPRIOR = r"Prior of the group: \[constant_error], \[contraction], \[noise], \[q0]."
#: Why a Bayes factor needs the width of its prior beside it.
PRIOR_NOTE = (
    "ln Bayes factor of 0 against any other value; positive speaks for 0. It depends on how wide "
    "the prior is"
)


@dataclass(frozen=True, kw_only=True)
class GroupOptions:
    """What may move the means of a group, and its prior."""

    covariates: Annotated[
        Path | None,
        typer.Option(
            "--covariates",
            metavar="FILE.csv",
            help="Table of subject and covariates.",
        ),
    ] = None
    categorical: Annotated[
        list[str] | None,
        rare(
            "--categorical",
            metavar="NAME",
            help="Covariate whose numbers are names.",
        ),
    ] = None
    hyperprior: Annotated[
        Path | None, rare("--hyperprior", metavar="FILE.toml", help=_HYPERPRIOR)
    ] = None


def population(
    *,
    study: StudyFile,
    output: Annotated[
        Path,
        writes(
            "FILE.nc",
            "Draws; tables and figure beside them.",
        ),
    ] = Path("population.nc"),
    asked: GroupOptions,
    task: Annotated[Task, Takes("seed", "overwrite", "spreadsheet_safe", draws=3200)],
) -> None:
    """Estimate the group mean and the SD between subjects.

    [bold]Example[/bold]: bayes-toe population study.csv -o population.nc --seed 1
    """
    from bayes_toe.groups.predictive_check import predictive_check

    if output.suffix != ".nc":
        raise bt.InputError(
            f"{output}: the ending is {output.suffix!r}, allowed is .nc, for draws; "
            "tables and figure go beside it"
        )
    if asked.categorical and asked.covariates is None:
        name = asked.categorical[0]
        raise bt.InputError(f"--categorical {name}: allowed with --covariates FILE.csv")
    table, figure = output.with_suffix(".csv"), output.with_suffix(".png")
    subjects = output.with_name(f"{output.stem}_subjects.csv")
    task.require_files(output, table, subjects, figure)
    read, _ = task.read(study)
    task.out.introduce(read)
    with warnings.catch_warnings():
        # They are printed below.
        warnings.simplefilter("ignore", bt.ConvergenceWarning)
        result = bt.population(
            read,
            covariates=asked.covariates,
            categorical=tuple(asked.categorical or ()),
            draws=task.draws,
            seed=task.seed,
            hyperprior=asked.hyperprior,
        )
    check = predictive_check(result)
    files: dict[Path, Callable[[Path], object]] = {
        output: result.save,
        table: partial(result.table.save, **task.saving),
        subjects: partial(result.subject_table.save, **task.saving),
        figure: partial(bt.plots.save_figure, bt.plots.population_figure(result, check)),
    }
    task.write(files)
    print_group(task.out, result, check.warnings)
    missed = {} if result.is_reliable else {"group": result.draws.shortfall}
    task.done("written:", *files, seed=result.settings.seed, missed=missed)


def print_group(
    out: Terminal, result: PopulationResult, contradictions: Sequence[str] = ()
) -> None:
    """The answer, the tables, the prior, and what to know before any of it is believed."""
    out.answer(group_answer(result))
    for title, rows in group_tables(result):
        out.table(safe(title), rows)
    out.footnote(f"{PRIOR_NOTE}:")
    for line in result.settings.hyperprior.describe(result.study.task):
        out.footnote(line)
    out.notes(result.regressors.notes)
    print_problems(out, result, contradictions)


def print_problems(out: Terminal, result: PopulationResult, contradictions: Sequence[str]) -> None:
    """What to know before any of it is believed."""
    out.notes((*result.problems, *contradictions), "attention", "red")


def group_answer(result: PopulationResult) -> list[str]:
    """Mean, SD between subjects and Bayes factor of both effects; differences of conditions."""
    badge = "" if result.is_reliable else "NOT RELIABLE: "
    n_subjects = counted(len(result.subjects), "subject")
    constant_error = result.effect("constant_error")
    shift = constant_error.percent
    assert shift is not None  # the constant error has one
    mean = f"mean PSE shift {_interval(shift, 1)} % (c = {_interval(constant_error.mean)} D)"
    lines = [
        f"{badge}group of {n_subjects}{_reference(result)}, constant error: {mean}, "
        f"{_spread(constant_error, ' D')}"
    ]
    contraction = result.effect("contraction")
    mean = f"mean p = {_interval(contraction.mean)}"
    lines.append(f"{badge}contraction: {mean}, {_spread(contraction, '')}")
    for levels in result.comparisons:
        parts = []
        for row in result.table.select("difference"):
            if row.level == " - ".join(levels):
                label = result.labels[row.parameter]
                parts.append(f"{label} {_row(row)} (ln BF of no difference {row.zero_words})")
        lines.append(f"{badge}{' - '.join(levels)}, on average: {'; '.join(parts)}")
    return lines


def group_tables(result: PopulationResult) -> list[tuple[str, list[dict[str, str]]]]:
    """Titles and rows: parameters, what follows from them, covariates, conditions; none empty."""
    table, labels = result.table, result.labels
    parameters = []
    for name in result.names:
        [mean] = table.select("mean", name)
        [sd] = table.select("sd", name)
        [new_subject] = table.select("new_subject", name)
        n_effective = min(mean.ess_bulk, mean.ess_tail, sd.ess_bulk, sd.ess_tail)
        parameters.append(
            {
                "parameter": labels[name],
                "group mean": _row(mean),
                "SD between subjects": _row(sd),
                "new subject": _row(new_subject),
                "ln BF of 0": mean.zero_words,
                "draws": f"{n_effective:.0f}",
                "R-hat": f"{max(mean.r_hat, sd.r_hat):.3f}",
            }
        )
    effects = [
        {
            "covariate": row.level,
            "parameter": labels[row.parameter],
            "effect": _row(row),
            "ln BF of 0": row.zero_words,
        }
        for row in table.select("effect")
    ]
    spreads = {(row.level, row.parameter): row for row in table.select("difference_sd")}
    differences = [
        {
            "conditions": row.level,
            "parameter": labels[row.parameter],
            "mean difference": _row(row),
            "SD between subjects": _row(spreads[row.level, row.parameter]),
            "ln BF of 0": row.zero_words,
        }
        for row in table.select("difference")
    ]
    about = "; ".join(column.about for column in result.regressors.columns)
    named = [
        ("differences between conditions", differences),
        (f"effects of covariates ({about})", effects),
        (f"{counted(len(result.subjects), 'subject')}, median [95 % interval]", parameters),
    ]
    return [(title, rows) for title, rows in named if rows]


def _reference(result: PopulationResult) -> str:
    """The covariates for which the means hold."""
    columns = result.regressors.columns
    levels = {column.covariate: column.reference or "mean" for column in columns}
    if not levels:
        return ""
    return f" ({', '.join(f'{name} {level}' for name, level in levels.items())})"


def _spread(effect: GroupEffect, unit: str) -> str:
    """The SD between subjects and the Bayes factor of a zero mean."""
    spread = f"SD between subjects {_interval(effect.sd)}{unit}"
    if effect.sd_at_most is not None:
        spread = f"SD between subjects at most {_plain(effect.sd_at_most)}{unit}"
    return f"{spread}, ln Bayes factor of a zero mean {effect.zero_mean.words}"


def _interval(interval: Interval, digits: int = 3) -> str:
    """Median and 95 % interval."""
    low, median, high = (_plain(value, digits) for value in interval)
    return f"{median} [{low}, {high}]"


def _row(row: PopulationRow) -> str:
    """Median and 95 % interval of a row."""
    return f"{_plain(row.q50)} [{_plain(row.q025)}, {_plain(row.q975)}]"


def _plain(value: float, digits: int = 3) -> str:
    """A number without the zero before its point, and never -0.

    Examples
    --------
    >>> _plain(-0.0471), _plain(-0.0001), _plain(2.94, 1)
    ('-.047', '.000', '2.9')
    """
    text = f"{round(value, digits) + 0.0:.{digits}f}"
    return text.replace("0.", ".", 1) if text.lstrip("-").startswith("0.") else text
