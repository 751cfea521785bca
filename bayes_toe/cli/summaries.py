"""What the command line says of results: draws, evidence, models, asymmetries, fits, calibration."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from bayes_toe.cli.digits import allowed_in_order
from bayes_toe.cli.terminal import (
    MOST_NAMES,
    OUTPUT,
    chosen,
    once,
    safe,
    say,
    say_footnote,
    say_lines,
    say_note,
    say_notes,
    say_once,
    say_table,
)
from bayes_toe.data.messages import listed

if TYPE_CHECKING:
    from rich.console import Console

    from bayes_toe.classical.asymmetry import AsymmetryTable
    from bayes_toe.classical.covariates import CovariateTable
    from bayes_toe.classical.fit_table import FitTable
    from bayes_toe.comparison.evidence_table import EvidenceTable, SubjectEvidence
    from bayes_toe.comparison.ladder_table import ModelComparison
    from bayes_toe.comparison.model_row import ModelRow
    from bayes_toe.comparison.parts_sensitivity import PartsSensitivity
    from bayes_toe.comparison.prior_sensitivity import SensitivityTable
    from bayes_toe.experiments.calibration_table import CalibrationTable
    from bayes_toe.inference.draws import Draws


#: What order effects show in: these have their range beside the median.
_WITH_RANGE = ("mu1", "offset", "gain")
_SHOWN_QUANTILES = [0.05, 0.5, 0.95]
_MOST_SHOWN = 7  # of a model with a parameter for each pair
_MOST_COLUMNS = 8  # models whose evidences stand side by side; the file and the figure have them all


def say_draws(console: Console, draws: Draws, file: str = OUTPUT) -> None:
    """Medians and convergence of every subject; of very many, of those first that did not converge."""
    import numpy as np

    from bayes_toe.inference.diagnostics import quantile_errors

    stats, missed = draws.group("sample_stats"), draws.not_converged
    natural = draws.posterior(draws.names[0]).names.natural
    known = [key for key in ("mu1", "offset", "gain") if key in draws.parameters]
    shown = [*known, *(key for key in natural if key not in known)][:_MOST_SHOWN]
    rows, places = [], {name: i for i, name in enumerate(draws.names)}
    for name in chosen(places, missed):
        row, i = dict[Any, Any](subject=name), places[name]
        for key in shown:
            values = draws.values(name, key)
            # The smallest of all effective sizes: errors that are rather too large, and cost next to nothing.
            errors = quantile_errors(values, _SHOWN_QUANTILES, float(stats["min_ess"][i]))
            low, middle, high = allowed_in_order(np.quantile(values, _SHOWN_QUANTILES).tolist(), errors.tolist(), 2)
            row[key] = middle + (f" ({low}, {high})" if key in _WITH_RANGE else "")
        row["min ESS"] = f"{float(stats['min_ess'][i]):.0f}"
        row["max R-hat"] = f"{float(stats['max_r_hat'][i]):.3f}"
        row["converged"] = "NO" if name in missed else "yes"
        rows.append(row)
    say_table(console, f"{draws.model}: medians (5 %, 95 %)", rows, total=len(places), file=file)
    say_notes(console, (f"{name}: {shortfall}" for name, shortfall in missed.items()), "not converged", "red", file=file)
    if draws.attrs["left_out"]:
        say(console, safe(draws.attrs["left_out"]))


def say_evidence(console: Console, table: EvidenceTable, file: str = OUTPUT, first: str = "") -> None:
    """Which order effect, whether the model describes the answers, then H1 against H0, and each note once with its subjects."""
    from bayes_toe.cli.attention import flagged
    from bayes_toe.cli.headline import APPENDIX_C, FIT, tally
    from bayes_toe.comparison.words import STATED, conclusion

    of_subject, of_all = {row.subject: row for row in table}, partial(say_table, console, total=len(table), file=file)
    shown = [of_subject[name] for name in chosen(of_subject, flagged(table))]
    of_all("order effect, and fit of the model", [_headline(row) for row in shown])
    say(console, f"[bold]order effect[/bold]: {tally(table)}")
    _say_misfits(console, table, file, first)
    say_footnote(console, f"Order effect: three models with equal prior odds that differ in it alone. {STATED}. {FIT}.")
    rows: list[dict[Any, Any]] = [
        {
            "subject": row.subject,
            "log evidence H1": _number(row.log_evidence_h1),
            "s.e.": _number(row.log_evidence_h1_se, 4),
            "log evidence H0": _number(row.log_evidence_h0),
            "log Bayes factor": _number(row.log_bayes_factor),
            "evidence": conclusion(row.log_bayes_factor),
            "k-hat": _number(row.pareto_k),
            "Laplace": _number(row.log_bayes_factor_laplace),
        }
        for row in shown
    ]
    of_all("Appendix C: one smooth curve (H1) against a free frequency per pair (H0), natural logs", rows)
    say_footnote(console, f"{APPENDIX_C}.")
    say_once(console, ((row.subject, note) for row in table for note in row.notes))
    for line in once((row.subject, note) for row in table for note in row.footnotes)[:MOST_NAMES]:
        say_footnote(console, line)


def _headline(row: SubjectEvidence) -> dict[Any, Any]:
    from bayes_toe.cli.headline import deviance, p_value
    from bayes_toe.comparison.words import order_effect_and_probability

    return {
        "subject": row.subject,
        "order effect": order_effect_and_probability(row.log_evidence_orders),
        "none": _number(row.p_none),
        "constant error": _number(row.p_constant_error),
        "update": _number(row.p_update),
        "fit": "MISFIT" if row.misfit else "no misfit" if row.fit else "-",
        "predictive p": p_value(row.fit.p_overall) if row.fit else "-",
        "deviance (d.f.)": deviance(row.fit) if row.fit else "-",
    }


def _say_misfits(console: Console, table: EvidenceTable, file: str, first: str) -> None:
    from bayes_toe.cli.headline import NEXT, misfit, misfits

    if found := misfits(table):
        say(console, f"[bold]fit[/bold]: {found}")
        wrong = (f"{row.subject}: {misfit(row.fit)}" for row in table if row.fit is not None and row.misfit)
        say_notes(console, wrong, "misfit", "red", file=file)
        say(console, first + NEXT, "red")


def say_comparison(console: Console, table: ModelComparison) -> None:
    """First the parts of models, then log evidence below the best model, then the models over the study, and each note once."""
    from math import isnan

    _say_parts(console, table)
    rows: list[dict[Any, Any]] = []
    evidence = dict(zip(table.subjects, table.log_evidence, strict=True))
    for name in chosen(table.subjects, _noted(table)):
        values = evidence[name]
        best = max((value for value in values if not isnan(value)), default=0.0)
        cells = ["-" if isnan(value) else f"{value - best:.1f}" for value in values]
        rows.append({"subject": name, **dict(zip(table.models, cells, strict=True))})
    if len(table.models) <= _MOST_COLUMNS:
        say_table(console, "log evidence below the subject's best model, nats", rows, total=len(table.subjects))
    _say_models(console, table)
    about: dict[str, list[ModelRow]] = {}
    for one in table:
        for note in one.notes:
            # Which pair fails differs from row to row: the file says it, here one line for all.
            kind, rest = note.partition(":")[::2] if note.startswith("leave-one-out") else (note, "")
            about.setdefault(f"{kind}, see the column note" if rest else kind, []).append(one)
    for note, found in about.items():
        say_note(console, f"{_whose(found, table.subjects)}: {note}")


def _say_parts(console: Console, table: ModelComparison) -> None:
    """Probabilities of the levels of each part for every subject and the study; the best composition and whether it fits."""
    from bayes_toe.comparison.parts_table import STUDY
    from bayes_toe.inference.predictive_checks import MISFIT

    best, rows, parts = table.best_compositions(), [], table.parts
    places = {name: i for i, name in enumerate(table.subjects)}
    for name in chosen(places, _noted(table)):
        i = places[name]
        row: dict[Any, Any] = {"subject": name, **{" / ".join(part.levels): _shares(part.probability[i]) for part in parts}}
        found, against = best.get(name, (None, None))
        fit = None if found is None else found.checks.p_predictive
        row |= {"best": "-" if found is None else found.model, "less H0": "-" if against is None else f"{against:+.1f}"}
        rows.append({**row, "fit p": "-" if fit is None else f"{fit:.2g}" + (" misfit" if fit < MISFIT else "")})
    of_study = {" / ".join(part.levels): _shares(part.study) for part in parts if part.study is not None}
    if of_study:
        rows.append({"subject": STUDY, **of_study, **dict.fromkeys(("best", "less H0", "fit p"), "")})
    title = "probability of the levels of each part; best composition: log evidence less that of free frequencies, fit"
    say_table(console, title, rows, total=len(places) + bool(of_study))
    if of_study:
        say(console, f"{STUDY}: of a new subject, by random effects over {parts[0].counted} of {len(table.subjects)} subjects")


def _noted(table: ModelComparison) -> set[str]:
    """Subjects whose best composition does not describe the answers, or who lack an evidence."""
    from math import isnan

    from bayes_toe.inference.predictive_checks import MISFIT

    fits = {name: found.checks.p_predictive for name, (found, _) in table.best_compositions().items()}
    lacking = {name for name, values in zip(table.subjects, table.log_evidence, strict=True) if any(map(isnan, values))}
    return lacking | {name for name, p in fits.items() if p is not None and p < MISFIT}


def _shares(probability: Any) -> str:
    return " / ".join(_or_dash(value, 2) for value in probability)


def _whose(rows: list[ModelRow], subjects: tuple[str, ...]) -> str:
    """Subjects with their models; once for all subjects where all have the same models."""
    models = dict.fromkeys(row.model for row in rows)
    if len({(row.subject, row.model) for row in rows}) < len(models) * len(subjects):
        return listed([f"{row.subject} ({row.model})" for row in rows], MOST_NAMES)
    return f"{subjects[0] if len(subjects) == 1 else 'every subject'} ({', '.join(models)})"


def _say_models(console: Console, table: ModelComparison) -> None:
    """The models over the study, with their frequencies over more than one subject."""
    # How often a model is found over subjects means nothing for one of them.
    many = len(table.subjects) > 1
    frame, found = table.study_frame(), table.frequencies() if many else None
    columns = {"expected": "frequency", "exceedance": "exceedance", "protected": "protected"} if many else {}
    sums = {"group_log_evidence": "log evidence", "elpd_loo_trial": "LOO by trial", "elpd_loo_pair": "LOO by pair"}
    lines = [
        {
            "model": row["model"],
            "best for": row["best"],
            **{shown: _or_dash(row[key], 3) for key, shown in columns.items()},
            **{shown: _or_dash(row[key], 1) for key, shown in sums.items()},
        }
        for row in frame.to_dict("records")
    ]
    first, everyone = frame.iloc[0].to_dict(), len(table.subjects)
    how = "" if found is None else ", random effects (sampled)"
    say_table(console, f"models over {first['subjects']} of {everyone} subjects{how}" if many else "models", lines)
    if how:
        _say_risk(console, first)
    for key, unit in (("elpd_loo_trial", "trial"), ("elpd_loo_pair", "pair")):
        _say_summed(console, unit, int(first[f"{key}_subjects"]), everyone)


def _say_risk(console: Console, row: Mapping[Any, Any]) -> None:
    """The probability that all models are equally frequent, with its Monte Carlo error."""
    risk, error = _or_dash(row["omnibus_risk"], 3), row["omnibus_risk_exact_se"]
    say(console, f"all models equally frequent with probability {risk} ± {error:.1g} ({row['exact_how']})")


def _say_summed(console: Console, unit: str, counted: int, everyone: int) -> None:
    """Over how many subjects sums of leave-one-out go, where not over all."""
    if counted < everyone:
        how = f"sums over {counted} of {everyone} subjects, those with" if counted else "no sum, no subject has"
        say_note(console, f"LOO by {unit}: {how} a value under every model")


def say_sensitivity(console: Console, table: SensitivityTable) -> None:
    """One line a subject, the subjects whose conclusion turns marked, and how many they are."""
    from bayes_toe.comparison.reweighting import RESAMPLED
    from bayes_toe.comparison.words import STATED

    turning = [name for name in table.names if any(table.turns(name, varied) for varied in table.varied)]
    say_lines(console, ((line, "yellow" if name in turning else None) for name, line in zip(table.names, table.summary(), strict=True)))
    anew = sum(row.method == RESAMPLED for row in table)
    tally = f"[bold]{len(turning)} of {len(table.names)}[/bold] conclusions turn within this range"
    say(console, f"{tally}; {anew} of {len(table.rows)} rows sampled anew, the others re-weighted")
    say_footnote(console, f"{STATED}.")


def say_parts_sensitivity(console: Console, table: PartsSensitivity) -> None:
    """One line a subject on its order effect; marked where another kind is the most probable within the range."""
    lines = zip(table.subjects, table.summary(), strict=True)
    say_lines(console, ((line, "yellow" if table.turns(subject) else None) for subject, line in lines))


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
    say_table(console, "asymmetry: q(c, r) - q(r, c), largest of each subject", filled)
    say(console, safe(table.population().describe()))
    for note in table.notes:
        say_note(console, note)


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
    say_table(console, "covariates: Welch's t or Pearson's r, not corrected for their number", rows)
    for note in dict.fromkeys([*tests.notes, *(f"{row.covariate}, {row.outcome}: {row.note}" for row in tests if row.note)]):
        say_note(console, note)


def say_fits(console: Console, table: FitTable) -> None:
    """Maximum-likelihood fits with their bootstrap intervals."""
    rows: list[dict[Any, Any]] = []
    for one in table:
        limits = one.bootstrap.intervals(table.level).tolist()
        cells = map(_with_interval, one.parameters.tolist(), limits)
        row: dict[Any, Any] = {"subject": one.subject, **dict(zip(("mu1", "sigma_p", "sigma_l", "q0"), cells, strict=True))}
        rows.append({**row, "log likelihood": f"{one.log_likelihood:.2f}", "at edge": one.at_edge})
    title = f"maximum likelihood ({100 * table.level:g} % percentile intervals of {table.replicates} bootstrap replicates)"
    say_table(console, title, rows)
    say_notes(console, (f"{one.subject}: {note}" for one in table for note in one.notes))


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
        say_table(console, f"ranks of true values: outside where p < {table.ranks[0].threshold:.2g}", ranks)
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
        say_table(console, "probability of H1: calibration error, and shift of the log Bayes factor against the default", rows)
    for line in verdict_lines(table):
        say(console, safe(line), "red" if line.startswith("NOT") else None)


def _with_interval(value: float, limits: list[float]) -> str:
    from math import isnan

    if isnan(value):
        return "-"
    return f"{value:.2f}" + ("" if isnan(limits[0]) else f" ({limits[0]:.2f}, {limits[1]:.2f})")


def _or_dash(value: float, digits: int) -> str:
    return "-" if value != value else f"{value:.{digits}f}"


def _number(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
