"""The command that infers a group: population."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayes_toe.cli import terminal
from bayes_toe.cli.options import DrawCount, StudyFileOrSaved, writes
from bayes_toe.cli.saved import belonging_draws
from bayes_toe.cli.task import KeepingTableTask, leave_unless_whole
from bayes_toe.errors import ConvergenceWarning, InputError
from bayes_toe.groups.hyperprior_fields import CORRELATIONS, GROUP_PARAMETERS, LKJ, NUMBERS

if TYPE_CHECKING:
    from bayes_toe.data.study import Study
    from bayes_toe.groups.population import Population
    from bayes_toe.groups.predictive_check import PredictiveCheck
    from bayes_toe.inference.draws import Draws
    from bayes_toe.model.prior import Prior

_HYPERPRIOR = (
    f"A file with sections [{'], ['.join(GROUP_PARAMETERS)}] of any of {', '.join(name for name, _, _ in NUMBERS)}, "
    f"and [{CORRELATIONS}] of {LKJ.name}; see docs/population.md."
)


@dataclass(frozen=True, kw_only=True)
class PopulationTask(KeepingTableTask):
    """Sampling, of the group and of every subject."""

    draws: DrawCount = 2000


def population(  # noqa: PLR0913  # each is a choice of its own, and has a default
    *,
    study: StudyFileOrSaved,
    output: Annotated[Path, writes("population.nc", "NetCDF file to write; NAME.csv, NAME_subjects.csv, NAME.png beside it.")] = Path(
        "population.nc"
    ),
    covariates: Annotated[
        Path | None, typer.Option("--covariates", metavar="FILE.csv", help="Columns subject and one per covariate: what may move subjects.")
    ] = None,
    categorical: Annotated[
        list[str] | None, typer.Option("--categorical", metavar="NAME", help="A covariate whose numbers name levels; repeat for more.")
    ] = None,
    model: Annotated[str, typer.Option("--model", help="A name or a composition: 'update + sloped + both ways'.")] = "predictive update",
    scatter: Annotated[
        str, typer.Option("--population", metavar="normal|t", help="How subjects scatter; t (4 d.f.) lets single ones be far away.")
    ] = "normal",
    method: Annotated[
        str, typer.Option("--method", metavar="joint|reweight", help="Sample all together, or weight draws of subjects alone.")
    ] = "joint",
    correlations: Annotated[
        bool | None,
        typer.Option(
            "--correlations/--no-correlations", help="May parameters be correlated between subjects? By default of 30 with 500 trials each."
        ),
    ] = None,
    posterior: Annotated[
        Path | None,
        typer.Option(
            "--posterior",
            metavar="RESULTS/posterior.nc",
            help="Draws that run or sample wrote, in the place of sampling subjects alone: their columns alone_, starts and scales of the "
            "group's chains, study, prior and, without --seed, seed. The group is sampled, to the same joint posterior.",
        ),
    ] = None,
    hyperprior: Annotated[Path | None, typer.Option("--hyperprior", metavar="FILE.toml", help=_HYPERPRIOR)] = None,
    task: PopulationTask,
) -> None:
    """What the subjects of a study have in common, how far they differ, what covariates do, and each subject in the light of the others.

    [bold]Example[/bold]: bayes-toe population study.csv -o population.nc --covariates people.csv --seed 1
    """
    from bayes_toe.cli.population_answer import say_population
    from bayes_toe.data.covariates import read_covariates
    from bayes_toe.groups.hyperprior import read_hyperprior
    from bayes_toe.groups.population import population as infer
    from bayes_toe.groups.predictive_check import predictive_check

    files = _beside(output)
    task.require_files(*files)
    keep = task.partial(output) if posterior is None else None
    given = None if hyperprior is None else read_hyperprior(hyperprior)
    people = None if covariates is None else read_covariates(covariates)
    if people is None and categorical:
        raise InputError(f"--categorical {categorical[0]}: allowed with --covariates FILE.csv")
    read, prior, stored = _study_and_prior(study, posterior, model, task)
    terminal.say_smaller_models(task.console, read)
    what = "subjects alone, then the group" if stored is None else "the group"
    with task.progress(what, len(read)) as tick, warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # said below
        found = infer(
            read, covariates=people, categorical=tuple(categorical or ()), model=model, draws=task.draws, seed=task.seed, prior=prior,
            posterior=stored, hyperprior=given, scatter=scatter, method=method, correlations=correlations, workers=task.workers,
            progress=tick, keep=keep,
        )  # fmt: skip
    check = predictive_check(found)
    _write(found, check, files, task)
    failed = {name: reason for name, reason in found.left_out.items() if name not in found.regressors.left_out}
    if keep is not None:
        task.say_taken(keep)
        task.finish(keep, failed)
    say_population(task.console, found, check.warnings)
    task.say_written("written:", *files, seed=found.settings.seed)
    leave_unless_whole(task, failed, {} if found.converged else {"group": found.chains.reason})


def _study_and_prior(
    study: StudyFileOrSaved, posterior: Path | None, model: str, task: PopulationTask
) -> tuple[Study, Prior, Draws | None]:
    """What is asked about, said, with the draws that are there already."""
    if posterior is not None and task.resume:
        raise InputError("--resume: allowed without --posterior, where subjects are sampled alone")
    stored = None if posterior is None else belonging_draws(posterior, study, task, model)
    read, prior = task.read(study) if stored is None else (stored.study, stored.prior)
    terminal.say_study(task.console, read)
    terminal.say_doubts(task.console, read)
    return read, prior, stored


def _write(found: Population, check: PredictiveCheck, files: tuple[Path, ...], task: PopulationTask) -> None:
    from bayes_toe.groups.member_table import member_table
    from bayes_toe.plots.figure_files import save_figure
    from bayes_toe.plots.population import population_figure

    with task.together(*files) as folder:
        draws, table, members, figure = (folder / path.name for path in files)
        found.save(draws, overwrite=task.overwrite)
        found.table.save(table, **task.saving)
        member_table(found).save(members, **task.saving)
        save_figure(population_figure(found, check), figure)


def _beside(output: Path) -> tuple[Path, ...]:
    """The draws, the table of the population, that of its subjects, the figure."""
    if output.suffix != ".nc":
        raise InputError(f"{output}: found the ending {output.suffix!r}, allowed: .nc, for draws; tables and figure go beside it")
    return output, output.with_suffix(".csv"), output.with_name(f"{output.stem}_subjects.csv"), output.with_suffix(".png")
