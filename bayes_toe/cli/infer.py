"""Commands that infer: run, sample, evidence, compare, sensitivity, fit."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayes_toe.cli import summaries, terminal
from bayes_toe.cli.options import DrawCount, InTheirPlace, Store, StudyFile, StudyFileOrExample, StudyFileOrSaved, writes
from bayes_toe.cli.saved import saved_draws
from bayes_toe.cli.task import KeepingTableTask, KeepingTask, ModelTableTask, SamplingTask, TableTask, leave_unless_whole
from bayes_toe.errors import ConvergenceWarning, InputError

if TYPE_CHECKING:
    from bayes_toe.analysis import Analysis
    from bayes_toe.cli.group_section import Group
    from bayes_toe.comparison.parts_sensitivity import PartsSensitivity
    from bayes_toe.data.study import Study
    from bayes_toe.model.prior import Prior


@dataclass(frozen=True, kw_only=True)
class KeepingSamplingTask(SamplingTask, KeepingTask):
    """Sampling that goes on where it was."""


@dataclass(frozen=True, kw_only=True)
class RunningTask(TableTask, KeepingSamplingTask):
    """The same with tables."""


def run(
    *,
    study: StudyFileOrExample,
    output: Annotated[Path, writes("DIR", "Results folder.")] = Path("bayes_toe_results"),
    pictures: Annotated[str, typer.Option("--pictures", help="Of subjects: all, flagged (who must be looked at) or none.")] = "all",
    population: Annotated[bool, typer.Option("--population", help="What the subjects have in common, too: the joint posterior.")] = False,
    explore: Annotated[bool, typer.Option("--explore", help="explorer.html, too: posteriors to drag over, in a browser.")] = False,
    store: Store = "nc",
    task: RunningTask,
) -> None:
    """Posterior, summary, evidence table, corner plots and report of a study, in one folder.

    [bold]Example[/bold]: bayes-toe run study.csv -o results --seed 1
    """
    from bayes_toe.analysis import run as analyse
    from bayes_toe.cli.headline import in_short, scale_first
    from bayes_toe.cli.results_folder import PICTURE_BYTES, PRODUCTS, Drawn, draws_in, write_results
    from bayes_toe.comparison.presets import say_presets
    from bayes_toe.data.read_study import example_truth
    from bayes_toe.explorer.page import EXPLORER_BYTES, require_bokeh, require_few

    if explore:
        require_bokeh()
    drawn = Drawn(pictures, {} if study.files else example_truth(), explorer=explore)
    copies = task.copies_for(draws_in(output, store))
    task.require_folder(output, PRODUCTS)
    keep = task.partial(output)
    read, prior = task.opened(study)
    if population and len(read) < 2:
        raise InputError(f"--population: found {len(read)} subject, allowed: 2 and more")
    if explore:
        require_few(len(read), "subjects")
    task.require_room(output, read, prior, others=PICTURE_BYTES[pictures] + EXPLORER_BYTES * explore, copies=copies)
    terminal.say_smaller_models(task.console, read)
    with task.progress("sampling", len(read)) as tick:
        analysis = analyse(read, draws=task.draws, seed=task.seed, prior=prior, workers=task.workers, progress=tick, keep=keep)
    task.say_taken(keep)
    first = scale_first(read, prior)
    summaries.say_evidence(task.console, analysis.evidence, "evidence.csv", first)
    terminal.say_lines(task.console, ((line, None) for line in say_presets(analysis.presets)), "the report")
    summaries.say_draws(task.console, analysis.draws, "summary.csv")
    group = _group(analysis, task) if population else None
    with task.progress("drawing", len(read)) as tick:
        write_results(analysis, output, store=store, pictures=drawn, workers=task.workers, progress=tick, group=group, **task.saving)
    task.finish(keep, analysis.draws.failed)
    written = (name for name in PRODUCTS if (output / name).exists())
    task.say_written("results in", output, seed=analysis.settings.seed, ending=f": {', '.join(written)}")
    short = in_short(analysis.evidence, synthetic=read.synthetic, presets=analysis.presets)
    terminal.say(task.console, f"[bold]in short[/bold]: {first}{short}")
    missed = {} if group is None or group.found.converged else {"group": group.found.chains.reason}
    leave_unless_whole(task, analysis.draws.failed, {**analysis.draws.not_converged, **missed})


def _group(analysis: Analysis, task: RunningTask) -> Group:
    """What the subjects have in common, computed and said."""
    from bayes_toe.cli.group_section import Group
    from bayes_toe.cli.population_answer import answer, say_attention
    from bayes_toe.groups.population import population
    from bayes_toe.groups.predictive_check import predictive_check

    study, draws = analysis.study, analysis.draws
    with task.progress("the group", len(study)) as tick, warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # said below
        found = population(study, posterior=draws, workers=task.workers, progress=tick)
    group = Group(found, predictive_check(found))
    for line in answer(found):
        terminal.say(task.console, line)
    say_attention(task.console, found, group.check.warnings)
    return group


def sample(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("posterior.nc", "NetCDF file to write; NAME.zarr: a Zarr store, a folder.")] = Path("posterior.nc"),
    model: Annotated[
        str, typer.Option("--model", help="A model by name or composition: 'update + sloped + both ways'.")
    ] = "predictive update",
    task: KeepingSamplingTask,
) -> None:
    """Posterior draws of every subject under a model, as NetCDF that ArviZ opens.

    [bold]Example[/bold]: bayes-toe sample study.csv -o posterior.nc --draws 10000 --seed 1
    """
    from bayes_toe.analysis import draw
    from bayes_toe.model.ladder import model_named

    record = model_named(model)
    copies = task.copies_for(output)
    task.require_files(output)
    keep = task.partial(output)
    read, prior = task.read(study)
    task.require_room(output, read, prior, model, copies=copies)
    terminal.say_study(task.console, read)
    terminal.say_prior(task.console, record.describe(prior))
    terminal.say_doubts(task.console, read, prior)
    terminal.say_smaller_models(task.console, read)
    with task.progress("sampling", len(read)) as tick:
        draws = draw(read, model=model, draws=task.draws, seed=task.seed, prior=prior, workers=task.workers, progress=tick, keep=keep)
    draws.save(output, overwrite=task.overwrite)
    task.say_taken(keep)
    task.finish(keep, draws.failed)
    summaries.say_draws(task.console, draws)
    task.say_written("draws in", output, seed=draws.seed)
    leave_unless_whole(task, draws.failed, draws.not_converged)


def evidence(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("evidence.csv", "Table to write.")] = Path("evidence.csv"),
    task: KeepingTableTask,
) -> None:
    """Which order effect every subject has, whether the model (H1) describes the answers, and H1 against free frequencies (H0).

    [bold]Example[/bold]: bayes-toe evidence study.csv -o evidence.csv --seed 1
    """
    from bayes_toe.analysis import evidence as compute
    from bayes_toe.cli.headline import scale_first

    task.require_files(output)
    keep = task.partial(output)
    read, prior = task.opened(study)
    with task.progress("evidence", len(read)) as tick:
        table = compute(read, seed=task.seed, prior=prior, workers=task.workers, progress=tick, keep=keep)
    table.save(output, **task.saving)
    task.say_taken(keep)
    task.finish(keep, table.failed)
    summaries.say_evidence(task.console, table, first=scale_first(read, prior))
    task.say_written("table in", output, seed=table.seed)
    leave_unless_whole(task, table.failed, {})


@dataclass(frozen=True, kw_only=True)
class ComparingTask(RunningTask):
    """Sampling, of more models and therefore with fewer draws each."""

    draws: DrawCount = 1000


def compare(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("compare.csv", "Table to write; NAME_parts.csv, _models.csv, .png beside it.")] = Path("compare.csv"),
    model: Annotated[list[str] | None, typer.Option("--model", help="Only this model; repeat for more. Default: the whole space.")] = None,
    space: Annotated[str, typer.Option("--space", help="parts: order x noise x lapses; ladder: models that have a name.")] = "parts",
    task: ComparingTask,
) -> None:
    """Which order effect, noise and lapses, and how sure: probabilities of parts, over a space of models, for every subject and the study.

    Besides, of every model: evidence, leave-one-out, predictive checks, model probabilities, and model frequencies over subjects.

    [bold]Example[/bold]: bayes-toe compare study.csv -o compare.csv --seed 1
    """
    from bayes_toe.comparison.ladder_table import beside
    from bayes_toe.comparison.ladder_table import compare as compute
    from bayes_toe.model.ladder import require_models
    from bayes_toe.plots.comparison import save_comparison
    from bayes_toe.plots.figure_files import picture_beside

    asked, picture = model or space, picture_beside(output)
    models = require_models(asked)
    task.require_files(output, *beside(output), picture)
    keep = task.partial(output)
    read, prior = task.opened(study)
    with task.progress("comparing", len(read) * len(models)) as tick:
        table = compute(read, asked, prior=prior, draws=task.draws, seed=task.seed, workers=task.workers, progress=tick, keep=keep)
    with task.together(output, *beside(output), picture) as folder:
        table.save(folder / output.name, **task.saving)
        save_comparison(table, folder / picture.name, synthetic=read.synthetic)
    failed = {f"{row.subject} ({row.model})": "; ".join(row.notes) for row in table if row.failed}
    task.say_taken(keep)
    task.finish(keep, failed)
    summaries.say_comparison(task.console, table)
    task.say_written("written:", output, *beside(output), picture, seed=table.seed)
    leave_unless_whole(task, failed, {})


def sensitivity(
    *,
    study: StudyFileOrSaved,
    output: Annotated[Path, writes("sensitivity.csv", "Table to write; the figure goes to NAME.png.")] = Path("sensitivity.csv"),
    reach: Annotated[float, typer.Option("--reach", help="Scales of the prior are multiplied by factors from 1/REACH to REACH.")] = 4.0,
    steps: Annotated[int, typer.Option("--steps", help="Values of each, an odd number.")] = 9,
    compare: Annotated[bool, typer.Option("--compare", help="Of the parts' probabilities too: NAME_parts.csv and NAME_parts.png.")] = False,
    posterior: InTheirPlace = None,
    task: ModelTableTask,
) -> None:
    """At which prior a conclusion would turn: evidence and posteriors over a range of prior scales.

    [bold]Example[/bold]: bayes-toe sensitivity study.csv -o sensitivity.csv --seed 1
    """
    from bayes_toe.comparison.prior_sensitivity import require_range
    from bayes_toe.comparison.prior_sensitivity import sensitivity as compute
    from bayes_toe.plots.figure_files import picture_beside
    from bayes_toe.plots.parts_sensitivity import save_parts_sensitivity
    from bayes_toe.plots.sensitivity import save_sensitivity

    picture, parts = picture_beside(output), output.with_name(f"{output.stem}_parts{output.suffix}")
    files = [output, picture, *((parts, picture_beside(parts)) if compare else ())]
    require_range(reach, steps)
    task.require_files(*files)
    read, prior, seed = _study_and_prior(study, posterior, task)
    with task.progress("re-weighting", len(read)) as tick:
        table = compute(read, prior=prior, reach=reach, steps=steps, seed=seed, workers=task.workers, progress=tick)
    summaries.say_sensitivity(task.console, table)
    of_parts = _parts_sensitivity(read, prior, reach, table.seed, task) if compare else None
    with task.together(*files) as folder:
        table.save(folder / output.name, **task.saving)
        save_sensitivity(table, folder / picture.name, synthetic=read.synthetic)
        if of_parts is not None:
            of_parts.save(folder / parts.name, **task.saving)
            save_parts_sensitivity(of_parts, picture_beside(folder / parts.name), synthetic=read.synthetic)
    task.say_written("written:", *files, seed=table.seed)


def _study_and_prior(study: StudyFileOrSaved, posterior: Path | None, task: ModelTableTask) -> tuple[Study, Prior, int | None]:
    """What is asked about, and the seed; those of saved draws where there are some."""
    if posterior is not None:
        draws = saved_draws(posterior, study, task)
        return draws.study, draws.prior, draws.seed
    return (*task.opened(study), task.seed)


def _parts_sensitivity(study: Study, prior: Prior, reach: float, seed: int, task: ModelTableTask) -> PartsSensitivity:
    """How the probabilities of parts move with the prior, in five steps, and a line a subject."""
    from bayes_toe.comparison.parts_sensitivity import parts_sensitivity

    factors = tuple(reach**power for power in (-1.0, -0.5, 0.0, 0.5, 1.0))
    with task.progress("re-weighting every model", len(study)) as tick:
        table = parts_sensitivity(study, prior=prior, factors=factors, seed=seed, workers=task.workers, progress=tick)
    summaries.say_parts_sensitivity(task.console, table)
    return table


def fit(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("fit.csv", "Table to write.")] = Path("fit.csv"),
    replicates: Annotated[int, typer.Option("--replicates", min=1, max=10**6, help="Bootstrap replicates a subject.")] = 1000,
    level: Annotated[float, typer.Option("--level", help="Level of the bootstrap intervals, between 0 and 1.")] = 0.95,
    task: ModelTableTask,
) -> None:
    """Maximum-likelihood fit of every subject, as in the paper, with percentile bootstrap intervals.

    [bold]Example[/bold]: bayes-toe fit study.csv -o fit.csv --seed 1
    """
    from bayes_toe.classical.bootstrap import require_level
    from bayes_toe.classical.fit_table import fit as compute

    require_level(level)
    task.require_files(output)
    read, prior = task.read(study)
    terminal.say_study(task.console, read)
    terminal.say_penalty(task.console, prior)
    terminal.say_doubts(task.console, read)
    with task.progress("fitting", len(read)) as tick:
        table = compute(read, replicates=replicates, level=level, seed=task.seed, prior=prior, workers=task.workers, progress=tick)
    table.save(output, **task.saving)
    summaries.say_fits(task.console, table)
    task.say_written("table in", output, seed=table.seed)
