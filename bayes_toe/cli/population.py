"""The command that infers a group, population, and what is said of it: first whether it has an order effect, then what covariates do."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import bayes_toe as bt
from bayes_toe.cli.options import InTheirPlace, StudyFileOrSaved, rare, writes
from bayes_toe.cli.task import MODEL, Takes, Task
from bayes_toe.cli.terminal import Terminal, allowed, safe
from bayes_toe.comparison.words import STATED, compared, conclusion
from bayes_toe.data.messages import counted, listed
from bayes_toe.groups.hyperprior import CORRELATIONS, GROUP_PARAMETERS, LKJ, NUMBERS

if TYPE_CHECKING:
    from bayes_toe.comparison.population_answer import OnAverage
    from bayes_toe.groups.population import Population
    from bayes_toe.groups.population_table import PopulationRow

_HYPERPRIOR = (
    f"A file with sections [{'], ['.join(GROUP_PARAMETERS)}] of any of {', '.join(name for name, _, _ in NUMBERS)}, "
    f"and [{CORRELATIONS}] of {LKJ.name}; see docs/population.md."
).replace("[", r"\[")  # no markup
BAYES_FACTOR = "BF: by how much the answers change the odds of no difference against a difference; below 1 they speak for a difference"
_SIDES = ("a difference", "no difference")
_PULLING = ("pull", "gain", "offset")


@dataclass(frozen=True, kw_only=True)
class GroupOptions:
    """What may move the subjects of a population, and of which form it is."""

    covariates: Annotated[
        Path | None,
        typer.Option(
            "--covariates",
            metavar="FILE.csv",
            help="Columns subject and one per covariate: what may move subjects.",
        ),
    ] = None
    categorical: Annotated[
        list[str] | None,
        rare(
            "--categorical",
            metavar="NAME",
            help="A covariate whose numbers name levels; repeat for more.",
        ),
    ] = None
    model: Annotated[
        str,
        rare("--model", help="A name or a composition; the paper's model is 'predictive update'."),
    ] = "free weighting"
    scatter: Annotated[
        str,
        rare(
            "--population",
            metavar="normal|t",
            help="How subjects scatter; t (4 d.f.) lets single ones be far away.",
        ),
    ] = "normal"
    correlations: Annotated[
        bool | None,
        rare(
            "--correlations/--no-correlations",
            help="May parameters be correlated between subjects? By default of 30 with 500 trials each.",
        ),
    ] = None
    hyperprior: Annotated[
        Path | None, rare("--hyperprior", metavar="FILE.toml", help=_HYPERPRIOR)
    ] = None


def population(
    *,
    study: StudyFileOrSaved,
    output: Annotated[
        Path,
        writes(
            "population.nc",
            "NetCDF file to write; NAME.csv, NAME_subjects.csv, NAME.png beside it.",
        ),
    ] = Path("population.nc"),
    asked: GroupOptions,
    posterior: InTheirPlace = None,
    task: Annotated[Task, Takes(*MODEL, "spreadsheet_safe", "resume", draws=2000)],
) -> None:
    """What the subjects of a study have in common, how far they differ, what covariates do, and each subject in the light of the others.

    [bold]Example[/bold]: bayes-toe population study.csv -o population.nc --covariates people.csv --seed 1
    """
    from bayes_toe.groups.population_table import pooled_subjects
    from bayes_toe.groups.predictive_check import predictive_check

    if output.suffix != ".nc":
        raise bt.InputError(
            f"{output}: found the ending {output.suffix!r}, allowed: .nc, for draws; tables and figure go beside it"
        )
    table, figure, subjects = (
        output.with_suffix(".csv"),
        output.with_suffix(".png"),
        output.with_name(f"{output.stem}_subjects.csv"),
    )
    task.require_files(output, table, subjects, figure)
    if asked.categorical and asked.covariates is None:
        raise bt.InputError(
            f"--categorical {asked.categorical[0]}: allowed with --covariates FILE.csv"
        )
    if task.resume and posterior is not None:
        raise bt.InputError(
            "--resume: allowed without --posterior, where subjects are sampled alone"
        )
    keep = task.partial(output) if posterior is None else None
    stored = None if posterior is None else task.saved(posterior, study, None)
    read, prior = task.read(study) if stored is None else (stored.study, stored.prior)
    task.out.introduce(read)
    what = "subjects alone, then the group" if stored is None else "the group"
    given = vars(asked) | {
        "categorical": tuple(asked.categorical or ()),
        "draws": task.draws,
        "prior": prior,
        "posterior": stored,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bt.ConvergenceWarning)  # said below
        found = task.work(what, len(read), bt.population, read, **given, keep=keep)
    check = predictive_check(found)
    made: dict[Path, Callable[[Path], object]] = {
        output: found.save,
        table: partial(found.table.save, **task.saving),
        subjects: partial(pooled_subjects(found).save, **task.saving_of(found.study)),
        figure: partial(bt.plots.save_figure, bt.plots.population_figure(found, check)),
    }
    task.write(made)
    failed = {
        name: reason
        for name, reason in found.left_out.items()
        if name not in found.regressors.left_out
    }
    if keep is not None:
        task.finish(keep, failed)
    say_population(task.out, found, check.warnings)
    missed = {} if found.converged else {"group": found.chains.reason}
    task.done("written:", *made, seed=found.settings.seed, failed=failed, missed=missed)


def say_population(out: Terminal, found: Population, contradicted: Sequence[str] = ()) -> None:
    """The answer, tables, what each prior was, and what to know before any of it is believed."""
    from bayes_toe.answers.contrast import WORDS_LEGEND

    out.answer(answer(found))
    for title, rows in tables(found):
        out.table(safe(title), rows)
        scale = STATED if "evidence" in rows[0] else WORDS_LEGEND if "word" in rows[0] else ""
        if scale:
            out.footnote(f"{BAYES_FACTOR}. {scale}.")
    for line in found.settings.hyperprior.describe(
        found.names, correlations=found.settings.correlations
    ):
        out.footnote(f"hyperprior: {line}")
    out.notes(found.regressors.notes)
    say_attention(out, found, contradicted)


def say_attention(out: Terminal, found: Population, contradicted: Sequence[str]) -> None:
    """What to know before any of it is believed: what was not reached, and what contradicts a population of this form."""
    out.notes((*found.shortfalls, *contradicted), "attention", "red")


def answer(found: Population) -> list[str]:
    """Whether the population has an order effect, where a subject at its mean is, what covariates and conditions do: a line each."""
    from bayes_toe.comparison.population_answer import on_average

    average, names = on_average(found), list(found.not_described)
    described = (
        f"the model does not describe {len(names)} of them ({listed(names, 5)})"
        if names
        else "the model describes all of them"
    )
    if average is None:
        means = {row.parameter: _interval(row, "q50") for row in found.table.some("mean")}
        said = ", ".join(f"{name} {means[name]}" for name in _PULLING if name in means)
        lines = [f"a subject at the mean{_reference(found)}: {said}; {described}"]
    else:
        who = counted(len(found.study), "subject")
        lines = [
            f"order effect of the population{_reference(found)}: {_on_average(found, average)}; {who}, {described}"
        ]
    return lines + _by_condition(found)


def _on_average(found: Population, said: OnAverage) -> str:
    """Whether there is an order effect on average; then both means and both sds."""
    parts = [f"P of none {compared(said.p_none)}"] + [
        f"Bayes factor of none {said.both.of_none}"
    ] * (len(said.means) > 1)
    for row in said.means:
        (sd,) = found.table.some("sd", row.parameter)
        parts.append(
            f"{row.parameter} {_interval(row)}, Bayes factor of none {row.of_none}, sd between subjects {_shown(sd.mean, sd)}"
        )
    return f"{said.words} ({'; '.join(parts)})"


#: Quantities as readers know them, by the group parameters that Bayes factors are of.
_KNOWN_AS = {
    GROUP_PARAMETERS[name].label: known for name, known in (("gain", "pull"), ("gamma", "pull"))
}
_KNOWN_AS |= {GROUP_PARAMETERS[name].label: name for name in ("pull", "width")}


def _by_condition(found: Population) -> list[str]:
    """What differs between conditions on average, a line a comparison."""
    from bayes_toe.answers.contrast import word_of

    rows, lines = found.table.some("condition_effect"), list[str]()
    for level in dict.fromkeys(row.level for row in rows):
        own, said = {row.parameter: row for row in rows if row.level == level}, list[str]()
        for label, row in own.items():
            name = _KNOWN_AS.get(label, label)
            if row.p_direction is not None and row.log_bf_differs is not None:
                word = word_of(row.log_bf_differs)
                said.append(
                    f"{name} {_interval(own.get(name, row))}, {word} (Bayes factor of no difference {row.of_none})"
                )
        lines.append(f"on average, {level}: {'; '.join(said)}")
    return lines


def tables(found: Population) -> list[tuple[str, list[dict[Any, Any]]]]:
    """Differences between conditions, effects of covariates, parameters, correlations, quantities: each with a title, none empty."""
    some, about = found.table.some, "; ".join(column.about for column in found.regressors.columns)
    means, sds = {row.parameter: row for row in some("mean")}, some("sd")
    what = (
        "sd between subjects"
        if found.settings.scatter == "normal"
        else "scale between subjects (t)"
    )
    every: dict[str, list[dict[Any, Any]]] = {
        "differences between conditions on average": [
            _effect(row, "comparison") for row in some("condition_effect")
        ],
        f"effects of covariates ({about})": [_effect(row, "covariate") for row in some("effect")],
        f"{found.settings.model}, {len(found.study)} subjects": [
            {
                "scale": sd.parameter,
                "mean": _interval(mean),
                what: _interval(sd),
                "min ESS": f"{min(mean.ess_bulk, mean.ess_tail, sd.ess_bulk, sd.ess_tail):.0f}",
                "max R-hat": f"{max(sd.r_hat, mean.r_hat):.3f}",
            }
            for sd, mean in ((sd, means[sd.parameter]) for sd in sds)
        ],
        "correlations between subjects": [  # those first of which the sign is most certain
            {"scales": row.parameter, "correlation": _interval(row), "P(sign)": _sign(row)}
            for row in sorted(some("correlation"), key=lambda row: -(row.p_direction or 0.0))
        ],
    }
    naturals = [
        {
            "quantity": row.parameter,
            "subject at the mean": _interval(means[row.parameter], "q50"),
            "further subject": _interval(row, "q50"),
        }
        for row in some("new_subject")
        if row.parameter in means
    ]
    named = [(f"{title}, mean (5 %, 95 %)", rows) for title, rows in every.items() if rows]
    return [*named, (f"medians (5 %, 95 %){_reference(found)}", naturals)]


def _effect(row: PopulationRow, of: str) -> dict[Any, Any]:
    """One effect of a covariate, or of a condition, as a table shows it, each in the words of what else is said of such effects."""
    from bayes_toe.answers.contrast import word_of

    said = {
        of: row.level,
        "on": row.parameter,
        "effect": _interval(row),
        "P(sign)": "-" if row.p_direction is None else _sign(row),
    }
    said["BF no difference"], nats = row.of_none, row.log_bf_differs
    if row.quantity == "condition_effect":
        return said | {"word": word_of(nats) or "-"}
    words = "-" if nats is None else conclusion(None)
    if nats is not None and row.of_none != "-":
        words = f"{'at least ' * (row.bf_no_difference is None)}{conclusion(nats, _SIDES)}"
    return said | {"evidence": words}


def _reference(found: Population) -> str:
    """Who is meant where there are covariates."""
    of = {column.covariate: column.reference or "mean" for column in found.regressors.columns}
    return f" ({', '.join(f'{name} {level}' for name, level in of.items())})" if of else ""


def _sign(row: PopulationRow) -> str:
    return compared(row.p_direction or 0.0)


def _interval(row: PopulationRow, middle: str = "mean") -> str:
    return f"{_shown(getattr(row, middle), row)} ({_ends(row, ', ')})"


def _ends(row: PopulationRow, between: str = " to ") -> str:
    return between.join(_shown(value, row) for value in (row.q05, row.q95))


def _shown(value: float, row: PopulationRow) -> str:
    return allowed(value, row.sd / math.sqrt(min(row.ess_bulk, row.ess_tail)), 3)
