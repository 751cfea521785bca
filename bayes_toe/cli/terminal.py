"""What the command line prints: tables, notes, a progress bar. On a terminal and, plainer, in a log."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from bayes_toe.classical.asymmetry import AsymmetryTable
    from bayes_toe.classical.covariates import CovariateTable
    from bayes_toe.classical.fit_table import FitTable
    from bayes_toe.comparison.evidence_table import EvidenceTable
    from bayes_toe.comparison.ladder_table import ModelComparison
    from bayes_toe.comparison.model_row import ModelRow
    from bayes_toe.comparison.prior_sensitivity import SensitivityTable
    from bayes_toe.data.study import Study
    from bayes_toe.experiments.calibration_table import CalibrationTable
    from bayes_toe.experiments.checks import Finding
    from bayes_toe.inference.draws import Draws
    from bayes_toe.model.prior import Prior


def new_console(quiet: bool) -> Console:
    """Where everything is printed; nothing is where `quiet`."""
    from rich.console import Console

    # Not a terminal: a width that keeps a table's row on one line, so that logs can be searched.
    return Console(quiet=quiet, width=None if sys.stdout.isatty() else 140)


def safe(text: object) -> str:
    """Text from outside, kept from being read as markup."""
    from rich.markup import escape

    return escape(str(text))


@contextmanager
def progress_bar(console: Console, what: str, total: int) -> Iterator[Callable[[str], None]]:
    """A progress bar on a terminal, nothing elsewhere."""
    from rich.progress import Progress

    with Progress(console=console, disable=not console.is_terminal or console.quiet, transient=True) as bar:
        task = bar.add_task(what, total=total)

        def tick(_: str) -> None:
            bar.advance(task)

        yield tick


def table_of(title: str, rows: list[dict[Any, Any]], formats: Mapping[str, Callable[[Any], str]]) -> Any:
    """A table of rows with the same keys, which name its columns; texts are escaped."""
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold")
    for index, key in enumerate(rows[0]):
        table.add_column(str(key), justify="left" if index == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*(formats.get(key, safe)(value) for key, value in row.items()))
    return table


def console_for(study: Study, prior: Prior, quiet: bool) -> Console:
    """A console on which the study that was read and the prior have been said."""
    console = new_console(quiet)
    say_study(console, study)
    say_prior(console, prior)
    return console


def say_study(console: Console, study: Study) -> None:
    """What was read, and what there is to say of it."""
    label = " (synthetic)" if study.synthetic and "synthetic" not in study.source else ""
    trials = sum(subject.total_trials for subject in study)
    plural = "" if len(study) == 1 else "s"
    console.print(f"[bold]{safe(study.source)}[/bold]{label}: {len(study)} subject{plural}, {trials} trials", highlight=False)
    for note in study.notes:
        console.print(f"  {safe(note)}", highlight=False, soft_wrap=True)


def say_prior(console: Console, prior: Prior) -> None:
    """The prior that everything below depends on."""
    console.print(f"  prior: {prior.describe()}", highlight=False, soft_wrap=True)


def say_penalty(console: Console, prior: Prior) -> None:
    """The part of the prior that a maximum-likelihood fit uses."""
    console.print(f"  penalty: {prior.describe_penalty()}", highlight=False, soft_wrap=True)


def say_findings(console: Console, findings: Iterable[Finding], word: str = "warning") -> None:
    """Each message once, with the subjects that it is about."""
    about: dict[str, list[str]] = {}
    for finding in findings:
        about.setdefault(finding.message, []).append(finding.subject)
    for message, names in about.items():
        who = ", ".join(name for name in names if name)
        console.print(f"[yellow]{word}[/yellow] {safe(f'{who}: ' if who else '')}{safe(message)}", highlight=False, soft_wrap=True)


def say_smaller_models(console: Console, study: Study) -> None:
    """Before sampling: designs that cannot tell all parameters, and the model that would be enough."""
    from bayes_toe.experiments.checks import check_study

    say_findings(console, (finding for finding in check_study(study) if finding.code == "design_rank"), "note")


def say_draws(console: Console, draws: Draws) -> None:
    """Medians and convergence of every subject."""
    import numpy as np

    stats, missed = draws.group("sample_stats"), draws.not_converged
    rows = []
    for i, name in enumerate(draws.names):
        row: dict[Any, Any] = {"subject": name}
        for key in ("mu1", "gain", "sigma_p", "sigma_l", "q0"):
            low, middle, high = np.quantile(draws.values(name, key), [0.05, 0.5, 0.95])
            row[key] = f"{middle:.2f}" + (f" ({low:.2f}, {high:.2f})" if key in ("mu1", "gain") else "")
        row["min ESS"] = f"{float(stats['min_ess'][i]):.0f}"
        row["max R-hat"] = f"{float(stats['max_r_hat'][i]):.3f}"
        row["converged"] = "NO" if name in missed else "yes"
        rows.append(row)
    console.print(table_of("posterior: medians (5 %, 95 %)", rows, {}))
    for name, shortfall in missed.items():
        console.print(f"[red]not converged[/red] {safe(name)}: {safe(shortfall)}", highlight=False, soft_wrap=True)
    if draws.attrs["left_out"]:
        console.print(safe(draws.attrs["left_out"]), highlight=False, soft_wrap=True)


def say_evidence(console: Console, table: EvidenceTable) -> None:
    """The evidence table, and each note once with the subjects that it is about."""
    from bayes_toe.cli.report import verdict

    rows: list[dict[Any, Any]] = [
        {
            "subject": row.subject,
            "log evidence H1": _number(row.log_evidence_h1),
            "s.e.": _number(row.log_evidence_h1_se, 4),
            "log evidence H0": _number(row.log_evidence_h0),
            "log Bayes factor": _number(row.log_bayes_factor),
            "favours": verdict(row),
            "k-hat": _number(row.pareto_k),
            "Laplace": _number(row.log_bayes_factor_laplace),
        }
        for row in table
    ]
    console.print(table_of("evidence: natural logs, H1 minus H0", rows, {}))
    about: dict[str, list[str]] = {}
    for row in table:
        for note in row.notes:
            about.setdefault(note, []).append(row.subject)
    for note, names in about.items():
        console.print(f"[yellow]note[/yellow] {safe(', '.join(names))}: {safe(note)}", highlight=False, soft_wrap=True)


def say_comparison(console: Console, table: ModelComparison) -> None:
    """Log evidence of every model below the best one of each subject, the models over the study, and each note once."""
    from math import isnan

    rows: list[dict[Any, Any]] = []
    for name, values in zip(table.subjects, table.log_evidence, strict=True):
        best = max((value for value in values if not isnan(value)), default=0.0)
        cells = ["-" if isnan(value) else f"{value - best:.1f}" for value in values]
        rows.append({"subject": name, **dict(zip(table.models, cells, strict=True))})
    console.print(table_of("log evidence below the subject's best model, nats", rows, {}))
    _say_models(console, table)
    about: dict[str, list[ModelRow]] = {}
    for one in table:
        for note in one.notes:
            # Which pair fails differs from row to row: the file says it, here one line for all.
            kind, rest = note.partition(":")[::2] if note.startswith("leave-one-out") else (note, "")
            about.setdefault(f"{kind}, see the column note" if rest else kind, []).append(one)
    for note, found in about.items():
        console.print(f"[yellow]note[/yellow] {safe(_whose(found, table.subjects))}: {safe(note)}", highlight=False, soft_wrap=True)


def _whose(rows: list[ModelRow], subjects: tuple[str, ...]) -> str:
    """Subjects with their models; once for all subjects where all have the same models."""
    models = dict.fromkeys(row.model for row in rows)
    if len({(row.subject, row.model) for row in rows}) < len(models) * len(subjects):
        return ", ".join(f"{row.subject} ({row.model})" for row in rows)
    return f"{subjects[0] if len(subjects) == 1 else 'every subject'} ({', '.join(models)})"


def _say_models(console: Console, table: ModelComparison) -> None:
    """The models over the study; frequencies by the exact sum where there is one."""
    frame, exact = table.study_frame(), table.exact_frequencies() is not None
    ending = "_exact" if exact else ""
    columns = {"expected": "frequency", "exceedance": "exceedance", "protected": "protected"}
    sums = {"group_log_evidence": "log evidence", "elpd_loo_trial": "LOO by trial", "elpd_loo_pair": "LOO by pair"}
    lines = [
        {
            "model": row["model"],
            "best for": row["best"],
            **{shown: _or_dash(row[key + ending], 3) for key, shown in columns.items()},
            **{shown: _or_dash(row[key], 1) for key, shown in sums.items()},
        }
        for row in frame.to_dict("records")
    ]
    first, everyone = frame.iloc[0].to_dict(), len(table.subjects)
    how = "" if table.frequencies() is None else f", random effects ({'exact' if exact else 'variational'})"
    console.print(table_of(f"models over {first['subjects']} of {everyone} subjects{how}", lines, {}))
    if how:
        _say_risk(console, first)
    for key, unit in (("elpd_loo_trial", "trial"), ("elpd_loo_pair", "pair")):
        _say_summed(console, unit, int(first[f"{key}_subjects"]), everyone)


def _say_risk(console: Console, row: Mapping[Any, Any]) -> None:
    """The probability that all models are equally frequent, exactly where that is known, and by the variational scheme."""
    values = {"exact": _or_dash(row["omnibus_risk_exact"], 3), "variational": _or_dash(row["omnibus_risk"], 3)}
    said = ", ".join(f"{value} ({name})" for name, value in values.items() if value != "-")
    why = "; too many subjects and models for the exact value, which is lower" if values["exact"] == "-" else ""
    console.print(f"all models equally frequent with probability {said}{why}", highlight=False, soft_wrap=True)


def _say_summed(console: Console, unit: str, counted: int, everyone: int) -> None:
    """Over how many subjects sums of leave-one-out go, where not over all."""
    if counted < everyone:
        how = f"sums over {counted} of {everyone} subjects, those with" if counted else "no sum, no subject has"
        console.print(f"[yellow]note[/yellow] LOO by {unit}: {how} a value under every model", highlight=False, soft_wrap=True)


def say_sensitivity(console: Console, table: SensitivityTable) -> None:
    """One line a subject, the subjects whose conclusion turns marked, and how many they are."""
    from bayes_toe.comparison.prior_sensitivity import RESAMPLED

    turning = [name for name in table.names if any(table.turns(name, varied) for varied in table.varied)]
    for name, line in zip(table.names, table.summary(), strict=True):
        shown = safe(line)
        console.print(f"[yellow]{shown}[/yellow]" if name in turning else shown, highlight=False, soft_wrap=True)
    anew = sum(row.method == RESAMPLED for row in table)
    tally = f"[bold]{len(turning)} of {len(table.names)}[/bold] conclusions turn within this range"
    console.print(f"{tally}; {anew} of {len(table.rows)} rows sampled anew, the others re-weighted", highlight=False, soft_wrap=True)


def say_asymmetry(console: Console, table: AsymmetryTable) -> None:
    """The largest asymmetry of each subject, and the counts over subjects."""
    rows: list[dict[Any, Any]] = []
    for row in table:
        shown: dict[Any, Any] = {"subject": row.subject, "comparisons": len(row.comparisons), "accuracy": f"{row.accuracy:.2f}"}
        one = row.maximal
        if one is not None:
            shown["maximal asymmetry"] = f"{one.asymmetry:+.2f} \u00b1 {one.asymmetry_se:.2f}"
            shown["at (r, c)"] = f"({one.s_weak:.3g}, {one.s_strong:.3g})"
            shown |= {"p": f"{one.p_value:.2g}", "p (Holm)": f"{one.p_adjusted:.2g}"}
            shown["P(q_cr > q_rc)"] = f"{one.probability_of_direction:.3f}"
        rows.append(shown)
    rows.sort(key=len, reverse=True)  # subjects without a comparison come last; the first row names the columns
    filled = [{**dict.fromkeys(rows[0], "-"), **row} for row in rows]
    console.print(table_of("asymmetry: q(c, r) - q(r, c), largest of each subject", filled, {}))
    console.print(safe(table.population().describe()), highlight=False, soft_wrap=True)
    for note in table.notes:
        console.print(f"[yellow]note[/yellow] {safe(note)}", highlight=False, soft_wrap=True)


def say_covariates(console: Console, tests: CovariateTable) -> None:
    """Tests of covariates."""
    rows: list[dict[Any, Any]] = [
        {
            "covariate": row.covariate,
            "outcome": row.outcome,
            "test": f"{row.test}: {row.groups}" if row.groups else row.test,
            "n": row.n,
            "difference or r": _number(row.difference_or_r, 3),
            "statistic": _number(row.statistic),
            "df": _number(row.df, 1),
            "p": _number(row.p_value, 3),
        }
        for row in tests
    ]
    console.print(table_of("covariates: Welch's t or Pearson's r, not corrected for their number", rows, {}))
    for note in dict.fromkeys([*tests.notes, *(f"{row.covariate}, {row.outcome}: {row.note}" for row in tests if row.note)]):
        console.print(f"[yellow]note[/yellow] {safe(note)}", highlight=False, soft_wrap=True)


def say_fits(console: Console, table: FitTable) -> None:
    """Maximum-likelihood fits with their bootstrap intervals."""
    rows: list[dict[Any, Any]] = []
    for one in table:
        limits = one.bootstrap.intervals(table.level).tolist()
        cells = map(_with_interval, one.parameters.tolist(), limits)
        row: dict[Any, Any] = {"subject": one.subject, **dict(zip(("mu1", "sigma_p", "sigma_l", "q0"), cells, strict=True))}
        rows.append({**row, "log likelihood": f"{one.log_likelihood:.2f}", "at edge": one.at_edge})
    title = f"maximum likelihood ({100 * table.level:g} % percentile intervals of {table.replicates} bootstrap replicates)"
    console.print(table_of(title, rows, {}))
    for one in table:
        for note in one.notes:
            console.print(f"[yellow]note[/yellow] {safe(one.subject)}: {safe(note)}", highlight=False, soft_wrap=True)


def say_calibration(console: Console, table: CalibrationTable) -> None:
    """Verdicts on ranks and on evidence estimators, then all in words."""
    from bayes_toe.cli.calibration_folder import verdict_lines

    ranks: list[dict[Any, Any]] = [
        {
            "quantity": row.quantity,
            "design": row.design,
            "largest difference": f"{row.largest_difference:+.3f}",
            "p": f"{row.p_value:.2g}",
            "verdict": "inside" if row.inside else "OUTSIDE",
        }
        for row in table.ranks
    ]
    if ranks:
        console.print(table_of(f"ranks of true values: outside where p < {table.ranks[0].threshold:.2g}", ranks, {}))
    rows: list[dict[Any, Any]] = [
        {
            "estimator": row.estimator,
            "design": row.design,
            "none": row.missing_h1 + row.missing_h0,
            "ECE": _number(None if row.judged is None else row.judged.error, 4),
            "floor": _number(None if row.judged is None else row.judged.floor, 4),
            "log score": _number(None if row.judged is None else row.judged.log_score, 4),
            "median shift": _number(row.median_shift, 3),
            "largest shift": _number(row.largest_shift),
        }
        for row in table.evidence
    ]
    if rows:
        console.print(table_of("probability of H1: calibration error, and shift of the log Bayes factor against the default", rows, {}))
    for line in verdict_lines(table):
        console.print(safe(line), highlight=False, soft_wrap=True, style="red" if line.startswith("NOT") else None)


def _with_interval(value: float, limits: list[float]) -> str:
    from math import isnan

    if isnan(value):
        return "-"
    return f"{value:.2f}" + ("" if isnan(limits[0]) else f" ({limits[0]:.2f}, {limits[1]:.2f})")


def _or_dash(value: float, digits: int) -> str:
    return "-" if value != value else f"{value:.{digits}f}"


def _number(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
