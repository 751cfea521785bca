"""Commands that analyse each subject: run, sample, evidence; and what they print."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import bayes_toe as bt
from bayes_toe.cli.options import ModelName, StudyFile, flag, rare, writes
from bayes_toe.cli.task import MODEL, Takes, Task
from bayes_toe.cli.terminal import (
    MOST_NAMES,
    OUTPUT,
    Terminal,
    allowed_in_order,
    chosen,
    number,
    once,
)

if TYPE_CHECKING:
    from bayes_toe.analysis import Analysis
    from bayes_toe.answers.evidence_table import EvidenceTable
    from bayes_toe.cli.report import Group

_SHOWN_QUANTILES = [0.05, 0.5, 0.95]
#: Columns of the paper's model, and of the four models of the observer.
_PAPER_SHOWN = ("mu1", "gain", "sigma_p", "sigma_l", "q0", "lapse_rate")
_ORDER_SHOWN = ("constant_error", "contraction", "jnd")
#: Quantities with their range beside the median.
_WITH_RANGE = ("mu1", "gain", *_ORDER_SHOWN)


def run(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("DIR", "Folder.")] = Path("bayes_toe_results"),
    figures: Annotated[
        str,
        rare("--figures", metavar="all|flagged|none", help="Subjects with figures."),
    ] = "all",
    explore: Annotated[bool, flag("--explore", help="Write explorer.html, too.")] = False,
    paper_figures: Annotated[
        bool, flag("--paper-figures", help="Write the paper's figures, too.")
    ] = False,
    task: Annotated[Task, Takes(*MODEL, "draws", "spreadsheet_safe", "resume")],
) -> None:
    """Estimate the order effects of every subject and of the group.

    [bold]Example[/bold]: bayes-toe run study.csv -o results --seed 1
    """
    from bayes_toe.cli.answers import say_answers
    from bayes_toe.cli.group_commands import say_contrast
    from bayes_toe.cli.results_folder import FIGURE_BYTES, PRODUCTS, FigureChoice, write_results
    from bayes_toe.data.study import refuse_intervals
    from bayes_toe.explorer.page import EXPLORER_BYTES, require_bokeh, require_few

    if explore:
        require_bokeh()
    study, task = task.ask(study)
    choice = FigureChoice(figures, study.truth(), explore, paper_figures)
    task.require_folder(output, PRODUCTS)
    keep = task.partial(output)
    read, prior = task.opened(study)
    if paper_figures:
        refuse_intervals(read, "--paper-figures")
    if explore:
        require_few(len(read), "subjects")
    _require_room(
        task,
        output / "posterior.nc",
        keep,
        read,
        prior,
        others=FIGURE_BYTES[figures] + EXPLORER_BYTES * explore,
    )
    analysis = task.work(
        "sampling", len(read), bt.run, read, draws=task.draws, prior=prior, keep=keep
    )
    say_answers(task.out, analysis.answers, read, "evidence.csv")
    say_failed(task.out, analysis.draws)
    if analysis.contrast is not None:
        say_contrast(task.out, analysis.contrast)
    group = _group(analysis, task)
    with task.out.progress("drawing", len(read)) as tick:
        write_results(
            analysis,
            output,
            figures=choice,
            workers=task.workers,
            progress=tick,
            group=group,
            **task.saving,
        )
    task.finish(keep, analysis.draws.failed)
    written = (name for name in PRODUCTS if (output / name).exists())
    missed = {**analysis.draws.not_converged, **analysis.draws.imprecise}
    if group is not None and not group.found.is_reliable:
        missed["group"] = group.found.draws.shortfall
    ending = f": {', '.join(written)}"
    task.done(
        "results in",
        output,
        seed=analysis.settings.seed,
        ending=ending,
        failed=analysis.draws.failed,
        missed=missed,
    )


def _group(analysis: Analysis, task: Task) -> Group | None:
    """The group of the interpretable subjects, printed; None where they are few."""
    from bayes_toe.cli.population import group_answer, print_problems
    from bayes_toe.cli.report import Group
    from bayes_toe.groups.predictive_check import predictive_check

    result = analysis.group
    if result is None:
        return None
    group = Group(result, predictive_check(result))
    task.out.answer(group_answer(result))
    print_problems(task.out, result, group.check.warnings)
    return group


def sample(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("FILE.nc", "Draws.")] = Path("posterior.nc"),
    model: ModelName = "paper",
    task: Annotated[Task, Takes(*MODEL, "draws", "resume")],
) -> None:
    """Sample the posterior of one model for every subject.

    [bold]Example[/bold]: bayes-toe sample study.csv -o posterior.nc --model both --seed 1
    """
    from bayes_toe.analysis import draw
    from bayes_toe.inference.draws_file import refuse_store
    from bayes_toe.model.models import describe_prior, require_model

    refuse_store(output)
    task.require_files(output)
    keep = task.partial(output)
    read, prior = task.read(study)
    record = require_model(model, read.task)
    _require_room(task, output, keep, read, prior, model)
    task.out.introduce(read, prior, f"prior: {describe_prior(record, prior, read.task)}")
    draws = task.work(
        "sampling", len(read), draw, read, model=model, draws=task.draws, prior=prior, keep=keep
    )
    draws.save(output, overwrite=task.overwrite)
    say_draws(task.out, draws)
    task.finish(keep, draws.failed)
    task.done(
        "draws in",
        output,
        seed=draws.seed,
        failed=draws.failed,
        missed={**draws.not_converged, **draws.imprecise},
    )


def _require_room(
    task: Task,
    file: Path,
    keep: Path,
    study: bt.Study,
    prior: bt.Prior,
    model: str = "paper",
    *,
    others: int = 0,
) -> None:
    """Refuse before the work draws that will not fit on the disk, with `others`: bytes a subject of what goes beside them.

    Two copies, since the draws of each subject are kept until all are in one file, of which some are there already.
    """
    from bayes_toe.data.whole_files import require_room
    from bayes_toe.inference.draws import stored_bytes
    from bayes_toe.inference.draws_file import require_fitting
    from bayes_toe.inference.sampling import SamplerSettings
    from bayes_toe.model.models import require_model

    record = require_model(model, study.task)
    draws = stored_bytes(study, prior, SamplerSettings(task.draws), record)
    require_fitting(draws)
    require_room(file, 2 * draws + others * (len(study) + 1), used=keep)


def evidence(
    *,
    study: StudyFile,
    output: Annotated[Path, writes("FILE.csv", "Table.")] = Path("evidence.csv"),
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe", "resume")],
) -> None:
    """Compute the model evidences of every subject, and the answer.

    [bold]Example[/bold]: bayes-toe evidence study.csv -o evidence.csv --seed 1
    """
    from bayes_toe.cli.answers import say_answers

    task.require_files(output)
    keep = task.partial(output)
    read, prior = task.opened(study)
    table = task.work("evidence", len(read), bt.evidence, read, prior=prior, keep=keep)
    table.save(output, **task.saving_of(read))
    task.finish(keep, table.failed)
    say_model_evidence(task.out, table)
    say_answers(task.out, table.answers, read, output.name)
    task.done("table in", output, seed=table.seed, failed=table.failed)


def say_draws(out: Terminal, draws: bt.Draws, file: str = OUTPUT) -> None:
    """Medians and convergence of every subject; of very many, of those first that did not converge."""
    import numpy as np

    from bayes_toe.inference.diagnostics import quantile_errors
    from bayes_toe.model.models import model_title

    stats, missed = draws.group("sample_stats"), draws.not_converged
    columns = _PAPER_SHOWN if "mu1" in draws.parameters else _ORDER_SHOWN
    shown = [key for key in columns if key in draws.parameters]
    rows, places = [], {name: i for i, name in enumerate(draws.names)}
    for name in chosen(places, {**missed, **draws.imprecise}):
        row, i = dict[Any, Any](subject=name), places[name]
        for key in shown:
            values = draws.values(name, key)
            # The smallest of all effective sizes: errors that are rather too large, and cost next to nothing.
            errors = quantile_errors(values, _SHOWN_QUANTILES, float(stats["min_ess"][i]))
            low, middle, high = allowed_in_order(
                np.quantile(values, _SHOWN_QUANTILES).tolist(), errors.tolist(), 2
            )
            row[key] = middle + (f" ({low}, {high})" if key in _WITH_RANGE else "")
        row |= {
            "min ESS": f"{float(stats['min_ess'][i]):.0f}",
            "max R-hat": f"{float(stats['max_r_hat'][i]):.3f}",
        }
        rows.append({**row, "converged": "NO" if name in missed else "yes"})
    out.table(
        f"{model_title(draws.model)}: medians (5 %, 95 %)", rows, total=len(places), file=file
    )
    say_failed(out, draws, file)


def say_failed(out: Terminal, draws: bt.Draws, file: str = OUTPUT) -> None:
    """Whose draws did not converge, or are too few."""
    for word, of in (
        ("not converged", draws.not_converged),
        ("not precise enough", draws.imprecise),
    ):
        out.notes((f"{name}: {why}" for name, why in of.items()), word, "red", file=file)


def say_model_evidence(out: Terminal, table: EvidenceTable) -> None:
    """Log evidences of the four models, and of the paper's model (H1) against H0."""
    from bayes_toe.answers.study_summary import APPENDIX_C

    rows = list[dict[Any, Any]]()
    for row in table:
        cells: dict[Any, Any] = {"subject": row.subject}
        if row.answer is not None:
            for model, value in row.answer.log_evidence.items():
                star = "*" if model == row.answer.best_model else ""
                cells[model.removesuffix(" error")] = f"{value:.2f}{star}"
        cells["H0"] = number(row.log_evidence_h0)
        cells["H1"] = number(row.log_evidence_h1)
        cells["ln BF H1:H0"] = number(row.log_bayes_factor, 1)
        rows.append(cells)
    out.table("log model evidence, natural logs", rows)
    out.footnote(f"* the largest of the four models of order. {APPENDIX_C}.")
    out.notes(once((row.subject, note) for row in table for note in row.notes))
    for line in once((row.subject, note) for row in table for note in row.footnotes)[:MOST_NAMES]:
        out.footnote(line)
