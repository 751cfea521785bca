"""Commands that analyse each subject: run, sample, evidence; and what they print."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import bayes_toe as bt
from bayes_toe.arrays import Texts
from bayes_toe.cli.options import OutputFolder, OutputTable, StudyFile, flag, option, rare, writes
from bayes_toe.cli.run_context import MODEL, RunContext
from bayes_toe.cli.terminal import (
    Terminal,
    names_to_show,
    notes_of,
    number,
    without_zeros,
)
from bayes_toe.data.messages import capitalized

if TYPE_CHECKING:
    from bayes_toe.analysis import Analysis
    from bayes_toe.answers.evidence_table import EvidenceTable

_HEADINGS = {
    "constant_error": "constant\nerror, ln",
    "contraction": "contraction, %",
    "jnd": "JND, ln",
    "lapse_rate": "lapse\nrate",
}


def run(
    *,
    file: StudyFile,
    output: OutputFolder = Path("bayes_toe_results"),
    figures: Annotated[
        str, rare("--figures", "all|flagged|none", "Subjects that get figures.")
    ] = "all",
    explore: Annotated[bool, flag("--explore", "Write explorer.html, too.")] = False,
    context: Annotated[RunContext, *MODEL, "draws", "resume"],
) -> None:
    """Estimate the order effects of every subject and of the group.

    [bold]Example[/bold]: bayes-toe run study.csv -o results --seed 1
    """
    from bayes_toe.cli.answer_screen import print_subjects
    from bayes_toe.cli.group_screen import print_contrast, print_problems
    from bayes_toe.cli.results_folder import PRODUCTS, write_results
    from bayes_toe.explorer.page import require_bokeh, require_few
    from bayes_toe.groups.predictive_check import contradictions

    # Bad options and outputs are refused before the work, and so are too many subjects for a page.
    if explore:
        require_bokeh()
    if figures not in ("all", "flagged", "none"):
        raise bt.InputError(f"--figures is {figures!r}. It must be one of all, flagged, none.")
    context.require_folder(output, PRODUCTS)
    store = context.partial_folder(output)
    study, prior = context.read_and_describe(file)
    if explore:
        require_few(len(study), "subjects")

    analysis = context.work(
        "sampling", len(study), bt.run, study, draws=context.draws, prior=prior, keep=store
    )

    files = f"{output / 'report.html'} and {output / 'evidence.csv'}"
    print_subjects(context.out, analysis.answers, files)
    print_failed(context.out, analysis.draws)
    if analysis.contrast is not None:
        print_contrast(context.out, analysis.contrast)
    group_contradictions: Texts = ()
    if analysis.group is not None:
        group_contradictions = contradictions(analysis.group)
        print_problems(context.out, analysis.group, group_contradictions)

    write_results(
        analysis,
        output,
        context,
        group_contradictions,
        figures=figures,
        has_explorer=explore,
    )

    failed = analysis.draws.failed
    context.finish(store, failed)
    context.out.reasons("No result", failed)
    problems = {**failed, **analysis.draws.not_converged, **analysis.draws.imprecise}
    if analysis.group is not None and not analysis.group.is_reliable:
        problems["group"] = analysis.group.draws.shortfall
    _print_conclusion(context.out, analysis, problems, output)
    context.end_with_problems(problems)


def _print_conclusion(
    out: Terminal, analysis: Analysis, problems: Collection[str], folder: Path
) -> None:
    """Print the answer of the study and of the group, and the file with which to go on.

    `problems` has the subjects without a result, or without enough draws; `folder` the results.
    """
    from bayes_toe.answers.group_answer import group_answer
    from bayes_toe.cli.answer_screen import print_answer

    lines = []
    if analysis.group is not None:
        lines = group_answer(analysis.group)
    if analysis.contrast is not None:
        lines += analysis.contrast.sentences()
    closing = [f"Start with {folder / 'report.html'}.", f"Seed {analysis.settings.seed}."]
    print_answer(out, analysis.answers, analysis.study, problems, lines, closing)


def sample(
    *,
    file: StudyFile,
    output: Annotated[Path, writes("FILE.nc", "Output draws.")] = Path("posterior.nc"),
    model: Annotated[
        str, option("--model", "MODEL", "Model: none, constant-error, contraction, both or paper.")
    ] = "paper",
    context: Annotated[RunContext, *MODEL, "draws", "resume"],
) -> None:
    """Sample the posterior of one model for every subject.

    [bold]Example[/bold]: bayes-toe sample study.csv -o posterior.nc --model both --seed 1
    """
    from bayes_toe.checks.design_checks import identification_findings
    from bayes_toe.model.models import require_model

    require_model(model)
    context.require_files(output)
    store = context.partial_folder(output)
    study, prior = context.read_and_describe(file)
    context.out.findings(identification_findings(study), mark="-")

    draws = context.work(
        "sampling",
        len(study),
        bt.sample,
        study,
        model=model,
        draws=context.draws,
        prior=prior,
        keep=store,
    )
    draws.save(output, overwrite=context.overwrite)

    print_draws(context.out, draws)
    context.finish(store, draws.failed)
    context.out.reasons("No result", draws.failed)
    context.print_written(f"Draws in {output}", draws.seed)
    context.end_with_problems(draws.failed, draws.not_converged, draws.imprecise)


def evidence(
    *,
    file: StudyFile,
    output: OutputTable = Path("evidence.csv"),
    context: Annotated[RunContext, *MODEL, "resume"],
) -> None:
    """Compute model evidences and order effects of every subject.

    [bold]Example[/bold]: bayes-toe evidence study.csv -o evidence.csv --seed 1
    """
    from bayes_toe.cli.answer_screen import print_answer, print_subjects

    context.require_files(output)
    store = context.partial_folder(output)
    study, prior = context.read_and_describe(file)
    table = context.work("evidence", len(study), bt.evidence, study, prior=prior, keep=store)
    # In a study with conditions, each row of the table is a unit of a subject and a condition.
    table.save(output, overwrite=context.overwrite, units=study.conditions is not None)
    context.finish(store, table.failed)

    print_model_evidence(context.out, table, study, str(output))
    print_subjects(context.out, table.answers, str(output))
    context.out.reasons("No result", table.failed)
    closing = [f"Table: {output}.", f"Seed {table.seed}."]
    print_answer(context.out, table.answers, study, table.failed, closing=closing)
    context.end_with_problems(table.failed)


def print_draws(out: Terminal, draws: bt.Draws) -> None:
    """Print medians, intervals and convergence of every subject.

    If the subjects are many, only subjects with a problem have a row.
    """
    from bayes_toe.answers.order_effect import format_draws
    from bayes_toe.model.models import model_title
    from bayes_toe.model.parameters import QUANTITY_BY_NAME

    stats = draws.group("sample_stats")
    problems = draws.not_converged | draws.imprecise  # a reason by subject
    if "mu1" in draws.parameters:  # the paper's model
        columns = ["mu1", "gain", "sigma_p", "sigma_l", "q0", "lapse_rate"]
    else:
        columns = ["constant_error", "contraction", "jnd"]
    # The model may lack an effect, and the observers of some tasks lack some parameters.
    quantities = [name for name in columns if name in draws.parameters]

    rows = []
    for name in names_to_show(draws.names, problems):
        subject_stats = stats.sel(subject=name)
        # As many digits are shown as the effective number of draws makes certain. This is the
        # smallest number of all quantities, so that a quantity may have too few digits, and none
        # has too many.
        n_effective = float(subject_stats["min_ess"])
        row = [f"{name} !" if name in problems else name]
        for quantity in quantities:
            scale = QUANTITY_BY_NAME[quantity].scale
            decimals = 2 if scale == 1.0 else 0  # A scale of 100 makes per cent of a share.
            text = format_draws(scale * draws.values(name, quantity), n_effective, decimals)
            # The table has no room for all intervals: '.12 [.09, .15]' -> '.12'.
            if quantity in ("sigma_p", "sigma_l", "q0", "lapse_rate"):
                text, *_ = text.split()
            row.append(without_zeros(text))
        rows.append([*row, f"{n_effective:.0f}", f"{float(subject_stats['max_r_hat']):.3f}"])

    headings = ["subject", *(_HEADINGS.get(name, name) for name in quantities), "ESS", "R-hat"]
    if rows:
        title = f"{capitalized(model_title(draws.model))}: medians [95 % interval]"
        last_two = range(len(headings) - 2, len(headings))
        out.table(headings, rows, numeric=last_two, title=title)
    n_others = len(draws.names) - len(rows)
    if n_others:
        out.line(f"The draws of {n_others:,} other subjects converged.")
    print_failed(out, draws)


def print_failed(out: Terminal, draws: bt.Draws) -> None:
    """Print the subjects whose draws did not converge, or are too few, with the reasons."""
    out.reasons("The draws did not converge", draws.not_converged)
    out.reasons("The draws are not precise enough", draws.imprecise)


def print_model_evidence(out: Terminal, table: EvidenceTable, study: bt.Study, file: str) -> None:
    """Print log evidences of the four models, and of the paper's model (H1) against H0.

    `file` has the whole table.
    """
    from statistics import median

    from bayes_toe.answers.study_summary import APPENDIX_C, count_all

    rows = []
    log_factors = []  # of H1 against H0
    compared_answers = []  # the answers of the subjects with a log factor
    for row, answer in zip(table, table.answers, strict=True):
        cells = [row.subject]
        for model, value in answer.log_evidence.items():
            cells.append(f"{value:.2f}{'*' if model == answer.best_model else ' '}")
        cells += [f"{row.log_evidence_h0:.2f}", number(row.log_evidence_h1)]
        log_factor = row.log_bayes_factor
        if log_factor is None:
            cells.append("-")
        else:
            cells.append(f"{log_factor:+.1f}")
            log_factors.append(log_factor)
            compared_answers.append(answer)
        rows.append(cells)

    # A space stands in place of the star that marks the best model.
    headings = ["subject", "none ", "constant ", "contraction ", "both "]
    headings += ["H0", "paper's\nH1", "ln BF\nH1:H0"]
    title = "Log model evidence. * marks the largest of the four models."
    # All columns but the names are numeric.
    out.table_of_subjects(headings, rows, len(rows), file, numeric=range(1, 8), title=title)

    conclusion = f"{APPENDIX_C}."
    if log_factors:
        n_better = sum(log_factor > 0.0 for log_factor in log_factors)
        n_compared = count_all(compared_answers, "subject", study.conditions is not None)
        conclusion = (
            f"H1 predicts better than H0 for {n_better} of {n_compared} "
            f"(median ln BF {median(log_factors):.1f}). {conclusion}"
        )
    out.line()
    out.line(conclusion)
    out.notes(notes_of(table), file=file)
