"""Commands that ask how conclusions depend on the model and on the prior: compare, sensitivity; and what they say."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

import bayes_toe as bt
from bayes_toe.cli.options import InTheirPlace, StudyFile, StudyFileOrSaved, rare, writes
from bayes_toe.cli.task import MODEL, Takes, Task
from bayes_toe.cli.terminal import MOST_NAMES, Terminal, chosen, number, safe
from bayes_toe.data.messages import listed

if TYPE_CHECKING:
    from bayes_toe.comparison.contrast import ContrastTable
    from bayes_toe.comparison.model_comparison import ModelComparison
    from bayes_toe.comparison.model_row import ModelRow
    from bayes_toe.comparison.prior_sensitivity import SensitivityTable

_MOST_COLUMNS = (
    8  # models whose evidences stand side by side; the file and the figure have them all
)


def compare(
    *,
    study: StudyFile,
    output: Annotated[
        Path, writes("compare.csv", "Table to write; NAME_parts.csv, _models.csv, .png beside it.")
    ] = Path("compare.csv"),
    model: Annotated[
        list[str] | None,
        typer.Option("--model", help="Only this model; repeat for more. Default: the whole space."),
    ] = None,
    history: Annotated[
        bool,
        typer.Option(
            "--history", help="What a trial leaves to the next, too: NAME_history.csv and .png."
        ),
    ] = False,
    space: Annotated[
        str,
        rare(
            "--space", help="parts: those over which verdicts average; ladder: those with a name."
        ),
    ] = "parts",
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe", "resume", draws=1000)],
) -> None:
    """Which order effect, and which noise, lapses, curve and peak: probabilities of parts over all models, for every subject and the study.

    There are 48 models of same or different, 12 of which is stronger.

    Besides, of every model: evidence; of those that matter: leave-one-out and predictive checks.

    [bold]Example[/bold]: bayes-toe compare study.csv -o compare.csv --seed 1
    """
    from bayes_toe.cli.answers import say_histories, say_verdicts
    from bayes_toe.comparison.model_comparison import beside
    from bayes_toe.model.history import require_order
    from bayes_toe.model.ladder import require_models
    from bayes_toe.plots.figure_files import picture_beside

    asked, of_history = model or space, output.with_name(f"{output.stem}_history{output.suffix}")
    files = [
        output,
        *beside(output),
        picture_beside(output),
        *([of_history, picture_beside(of_history)] if history else []),
    ]
    task.require_files(*files)
    keep = task.partial(output)
    read, prior = task.opened(study)
    models = require_models(asked, read.task)
    for subject in read if history else ():
        require_order(subject)
    total = len(read) * (len(models) if asked != "parts" else 1)
    table = task.work(
        "comparing", total, bt.compare, read, asked, prior=prior, draws=task.draws, keep=keep
    )
    histories = (
        task.work("histories", len(read), bt.compare_history, read, prior=prior, seed=table.seed)
        if history
        else None
    )
    saving, save_figure = task.saving_of(read), bt.plots.save_figure
    figure = partial(save_figure, bt.plots.comparison_figure(table, synthetic=read.synthetic))
    made: dict[Path, Callable[[Path], object]] = {
        output: partial(table.save, **saving),
        picture_beside(output): figure,
    }
    if histories is not None:
        made |= {of_history: partial(histories.save, **saving)}
        made |= {picture_beside(of_history): partial(save_figure, bt.plots.history(histories))}
    task.write(made, *beside(output))
    failed = {f"{row.subject} ({row.model})": "; ".join(row.notes) for row in table if row.failed}
    task.finish(keep, failed)
    say_verdicts(task.out, table.verdicts, table.seed, read, followed=histories is None)
    say_comparison(task.out, table)
    if histories is not None:
        say_histories(task.out, histories, of_history.name)
    task.done("written:", *files, seed=table.seed, failed=failed)


def contrast(
    *,
    study: StudyFile,
    output: Annotated[
        Path, writes("contrast.csv", "Table to write; the figure goes to NAME.png.")
    ] = Path("contrast.csv"),
    model: Annotated[
        str | None,
        typer.Option("--model", help="Of every condition; default: a constant error and a pull."),
    ] = None,
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe", "resume")],
) -> None:
    """What differs between conditions within every subject: constant error, pull, width; by how much, with Bayes factors.

    [bold]Example[/bold]: bayes-toe contrast study.csv --condition hand -o contrast.csv --seed 1
    """
    from bayes_toe.plots.figure_files import picture_beside

    files = [output, picture_beside(output)]
    task.require_files(*files)
    keep = task.partial(output)
    read, prior = task.opened(study)
    people = len({one.person for one in read})
    table = task.work("contrasting", people, bt.contrast, read, model=model, prior=prior, keep=keep)
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
    from bayes_toe.comparison.contrast import LEGEND

    out.answer([f"between conditions: {table.conditions.about}"])
    for line in table.sentences():
        out.line(f"  {safe(line)}")
    decided = {row.subject for row in table if row.word.startswith("differs")}
    rows, comparisons = [], {row.comparison for row in table}
    for name in chosen([one.subject for one in table.subjects], decided):
        for comparison in dict.fromkeys(row.comparison for row in table if row.subject == name):
            own = {
                row.quantity: row
                for row in table
                if (row.subject, row.comparison) == (name, comparison)
            }
            shown = {key: f"{row.size} {row.factor}" for key, row in own.items()}
            rows.append(
                {"subject": name}
                | ({"comparison": comparison} if len(comparisons) > 1 else {})
                | shown
            )
    what = f"differences, {comparisons.pop()}" if len(comparisons) == 1 else "differences"
    out.table(
        f"{what}: medians (5 %, 95 %) if they differ, and the Bayes factor", rows, total=len(rows)
    )
    out.footnote(f"{LEGEND}.")
    out.notes(
        (f"{name}: {why}" for name, why in table.left_out.items() if name not in table.failed),
        "left out",
    )
    out.notes(f"{one.subject}: {note}" for one in table.subjects for note in one.notes)


def sensitivity(
    *,
    study: StudyFileOrSaved,
    output: Annotated[
        Path, writes("sensitivity.csv", "Table to write; the figure goes to NAME.png.")
    ] = Path("sensitivity.csv"),
    reach: Annotated[
        float,
        rare(
            "--reach", help="Scales of the prior are multiplied by factors from 1/REACH to REACH."
        ),
    ] = 4.0,
    steps: Annotated[int, rare("--steps", help="Values of each, an odd number.")] = 9,
    posterior: InTheirPlace = None,
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe")],
) -> None:
    """At which prior a conclusion would turn: evidence and posteriors over a range of prior scales.

    [bold]Example[/bold]: bayes-toe sensitivity study.csv -o sensitivity.csv --seed 1
    """
    from bayes_toe.comparison.prior_sensitivity import require_range
    from bayes_toe.plots.figure_files import picture_beside

    files = [output, picture_beside(output)]
    require_range(reach, steps)
    task.require_files(*files)
    if posterior is None:
        read, prior, seed = (*task.opened(study), task.seed)
    else:
        draws = task.saved(posterior, study, seed=task.seed)
        read, prior, seed = draws.study, draws.prior, draws.seed
        task.out.introduce(read, prior)
    table = task.work(
        "re-weighting",
        len(read),
        bt.sensitivity,
        read,
        prior=prior,
        reach=reach,
        steps=steps,
        seed=seed,
    )
    say_sensitivity(task.out, table)
    figure = bt.plots.sensitivity_figure(table, synthetic=read.synthetic)
    task.write(
        {
            output: partial(table.save, **task.saving_of(read)),
            picture_beside(output): partial(bt.plots.save_figure, figure),
        }
    )
    task.done("written:", *files, seed=table.seed)


def say_sensitivity(out: Terminal, table: SensitivityTable) -> None:
    """One line a subject, the subjects whose conclusion turns marked, and how many they are."""
    from bayes_toe.comparison.prior_sensitivity import RESAMPLED
    from bayes_toe.comparison.words import STATED

    turning = [
        name for name in table.names if any(table.turns(name, varied) for varied in table.varied)
    ]
    lines = dict(zip(table.names, table.summary(), strict=True))
    shown = chosen(lines, turning)
    for name in shown:
        out.line(safe(lines[name]), "yellow" if name in turning else None)
    out.more(len(lines) - len(shown))
    anew = sum(row.method == RESAMPLED for row in table)
    tally = f"[bold]{len(turning)} of {len(table.names)}[/bold] conclusions turn within this range"
    out.line(f"{tally}; {anew} of {len(table.rows)} rows sampled anew, the others re-weighted")
    out.footnote(f"{STATED}.")


def say_comparison(out: Terminal, table: ModelComparison) -> None:
    """First the parts of models; of models that were named, log evidence below the best and their sums; then each note once."""
    from bayes_toe.comparison.model_row import FAR

    _say_parts(out, table)
    if not table.verdicts:
        if len(table.models) <= _MOST_COLUMNS:
            rows = [
                {
                    "subject": name,
                    **{
                        model: number(value, 1)
                        for model, value in zip(table.models, values, strict=True)
                    },
                }
                for name, values in zip(
                    table.subjects,
                    table.log_evidence - np.nanmax(table.log_evidence, axis=1, keepdims=True),
                    strict=True,
                )
            ]
            out.table("log evidence below the subject's best model, nats", rows)
        _say_models(out, table)
    about: dict[str, list[ModelRow]] = {}
    for one in table:
        for note in one.notes:
            if note != FAR:
                # Which pair fails differs from row to row: the file says it, here one line for all.
                kind, rest = (
                    note.partition(":")[::2] if note.startswith("leave-one-out") else (note, "")
                )
                about.setdefault(f"{kind}, see the column note" if rest else kind, []).append(one)
    for note, found in about.items():
        out.note(f"{_whose(found, table.subjects)}: {note}")


def _say_parts(out: Terminal, table: ModelComparison) -> None:
    """Probabilities of what departs from the paper's levels; the best composition, its lead over free frequencies, its fit."""
    from bayes_toe.comparison.model_comparison import STUDY
    from bayes_toe.inference.predictive_checks import MISFIT

    best, rows = table.best_compositions(), list[dict[Any, Any]]()
    # The order effect is the answer's, where the whole space was compared; of two levels the second says all.
    shown = [
        (part, slice(0 if len(part.levels) > 2 else 1, None))
        for part in table.parts
        if not (table.verdicts and part.part == "order")
    ]
    for i, name in enumerate(table.subjects):
        shares = {
            " / ".join(part.levels[which]): " / ".join(map(number, part.probability[i][which]))
            for part, which in shown
        }
        found, against = best.get(name, (None, None))
        fit = None if found is None else found.checks.p_predictive
        said = {
            "best": "-" if found is None else found.model,
            "less H0": "-" if against is None else f"{against:+.1f}",
        }
        rows.append(
            {
                "subject": name,
                **shares,
                **said,
                "fit p": "-" if fit is None else f"{fit:.2g}" + " misfit" * (fit < MISFIT),
            }
        )
    studied = [
        (part.levels[which], part.study[which]) for part, which in shown if part.study is not None
    ]
    if of_study := {
        " / ".join(levels): " / ".join(map(number, shares)) for levels, shares in studied
    }:
        rows.append(
            {"subject": STUDY, **of_study, **dict.fromkeys(("best", "less H0", "fit p"), "")}
        )
    out.table(
        "probability of parts; the best model, its log evidence less that of free frequencies (H0), its fit",
        rows,
    )
    if of_study:
        out.line(
            f"{STUDY}: of a new subject, by random effects over {table.parts[0].counted} of {len(table.subjects)} subjects"
        )


def _whose(rows: list[ModelRow], subjects: tuple[str, ...]) -> str:
    """Subjects with their models; once for all subjects where all have the same models."""
    models = dict.fromkeys(row.model for row in rows)
    if len({(row.subject, row.model) for row in rows}) < len(models) * len(subjects):
        return listed([f"{row.subject} ({row.model})" for row in rows], MOST_NAMES)
    return f"{subjects[0] if len(subjects) == 1 else 'every subject'} ({', '.join(models)})"


def _say_models(out: Terminal, table: ModelComparison) -> None:
    """The models over the study, with their frequencies over more than one subject: how often a model is found means nothing for one."""
    everyone = len(table.subjects)
    many, frame = everyone > 1, table.study_frame()
    columns = (
        {"expected": "frequency", "exceedance": "exceedance", "protected": "protected"}
        if many
        else {}
    )
    sums = {
        "group_log_evidence": "log evidence",
        "elpd_loo_trial": "LOO by trial",
        "elpd_loo_pair": "LOO by pair",
    }
    lines = [
        {
            "model": row["model"],
            "best for": row["best"],
            **{shown: number(row[key], 3) for key, shown in columns.items()},
            **{shown: number(row[key], 1) for key, shown in sums.items()},
        }
        for row in frame.to_dict("records")
    ]
    first, found = frame.iloc[0].to_dict(), table.frequencies() if many else None
    how = "" if found is None else ", random effects (sampled)"
    out.table(
        f"models over {first['subjects']} of {everyone} subjects{how}" if many else "models", lines
    )
    if how:
        risk, error = number(first["omnibus_risk"], 3), first["omnibus_risk_exact_se"]
        out.line(
            f"all models equally frequent with probability {risk} ± {error:.1g} ({first['exact_how']})"
        )
    for unit in ("trial", "pair"):
        if (counted := int(first[f"elpd_loo_{unit}_subjects"])) < everyone:
            over = (
                f"sums over {counted} of {everyone} subjects, those with"
                if counted
                else "no sum, no subject has"
            )
            out.note(f"LOO by {unit}: {over} a value under every model")
