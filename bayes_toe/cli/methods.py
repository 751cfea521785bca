"""What was done in an analysis and what came out, as text for a paper, with the tables and citations that go with it.

`run` writes it from what it has at hand, the command `methods` from a results folder: posterior and evidence.csv, and beside them
population.nc where it is there.
"""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from bayes_toe.answers import words as answer_words
from bayes_toe.answers.contrast import CONTRAST_COLUMNS, PROBABLY, SURELY, sentences
from bayes_toe.answers.evidence_table import EVIDENCE_COLUMNS
from bayes_toe.answers.order_effect import QUESTIONS, OrderEffect
from bayes_toe.answers.study_summary import FEWEST_FOR_GROUP, frequency_line, study_lines
from bayes_toe.checks.identification import identify
from bayes_toe.cli.headline import said_p
from bayes_toe.cli.population import group_answer
from bayes_toe.cli.supplement import (
    SupplementTable,
    fit_table,
    group_table,
    order_effect_table,
    parameter_table,
    templates,
)
from bayes_toe.data.messages import bare, counted, listed, quoted, shown
from bayes_toe.data.validation import read_rows
from bayes_toe.errors import InputError
from bayes_toe.groups.population import PopulationResult, load_population
from bayes_toe.inference.belonging import (
    require_said_prior,
    require_subjects,
    require_update,
    same_answers,
)
from bayes_toe.inference.draws import Draws, load_draws
from bayes_toe.inference.predictive_checks import MISFIT
from bayes_toe.model.free_frequencies import frequency_evidence
from bayes_toe.model.paper_model import PAPER_MODEL, PaperPosterior

if TYPE_CHECKING:
    import pandas as pd

    from bayes_toe.analysis import Analysis

_MOST_NAMED = 10
#: Columns of text in evidence.csv and contrast.csv; the others hold numbers.
_EVIDENCE_TEXTS = ("subject", *QUESTIONS, "interpretable", "flags", "best_model", "prior")
_CONTRAST_TEXTS = ("subject", "quantity", "comparison", "word", "robust", "model", "prior")
_EVIDENCE_TOLERANCE = 1e-6  # of an exact evidence, nats: files have all digits
#: What notes of reading a study say where it did something to the data.
_DONE = ("dropped", "left out", "merged", "turned", "only rows", "only pairs")


@dataclass(frozen=True, eq=False)
class Methods:
    """An analysis as the text tells it."""

    draws: Draws
    evidence: pd.DataFrame | None = (
        None  # the rows of evidence.csv in the order of the draws, where these are of the paper's model
    )
    group: PopulationResult | None = None
    figures: bool = False  # whether there are corner plots
    notes: tuple[str, ...] = ()  # what is there and is not told of, and why
    summary: pd.DataFrame | None = None  # of the draws, where it is known
    contrast: pd.DataFrame | None = None  # the rows of contrast.csv

    @cached_property
    def tables(self) -> tuple[SupplementTable, ...]:
        """Those of the supplement."""
        second = (
            fit_table(self.draws) if self.evidence is None else order_effect_table(self.evidence)
        )
        summary = self.draws.summary() if self.summary is None else self.summary
        return (
            parameter_table(self.draws, summary),
            second,
            *(() if self.group is None else (group_table(self.group),)),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """What the tables are called, known before they are made."""
        return (
            "parameters",
            "fit" if self.evidence is None else "order_effect",
            *(() if self.group is None else ("population",)),
        )


def of_analysis(analysis: Analysis, group: PopulationResult | None, *, figures: bool) -> Methods:
    """What :func:`read_methods` would find in the results folder of an analysis."""
    evidence = _in_order_of_draws(analysis.evidence.frame(), analysis.draws)
    apart = None if analysis.contrast is None else analysis.contrast.frame()
    return Methods(
        analysis.draws, evidence, group, figures=figures, summary=analysis.summary(), contrast=apart
    )


def read_methods(results: Path) -> Methods:
    """What lies in a results folder, or beside a file of draws; files of different analyses are refused."""
    posterior = _posterior(results)
    draws, beside = load_draws(posterior), posterior.parent
    if not isinstance(draws.posterior(draws.names[0]), PaperPosterior):
        raise InputError(
            f"{shown(posterior)}: found draws of the model {draws.model!r}, allowed: the paper's"
        )
    notes, evidence = list[str](), beside / "evidence.csv"
    group = _group(beside / "population.nc", draws)
    if group is None and (table := beside / "population.csv").exists():
        notes.append(
            f"{shown(table)}: left out, since what it was made with is in population.nc, which bayes-toe population writes"
        )
    known = evidence.exists() and draws.model == PAPER_MODEL
    if evidence.exists() and not known:
        notes.append(
            f"{shown(evidence)} goes with draws of the paper's model, these are of {draws.model!r}: left out"
        )
    return Methods(
        draws,
        _read_evidence(evidence, draws) if known else None,
        group,
        (beside / "corner").is_dir(),
        tuple(notes),
        contrast=_read_contrast(beside / "contrast.csv", draws)
        if (beside / "contrast.csv").exists()
        else None,
    )


def _posterior(results: Path) -> Path:
    """The draws themselves, or those of a folder."""
    # A Path refuses names that are too long with an error of its own.
    if not os.path.isdir(results) or results.suffix == ".zarr":
        return results
    draws = results / "posterior.nc"
    if not draws.exists():
        raise InputError(
            f"{shown(results)}: found no posterior.nc, allowed: a folder that bayes-toe run wrote, or a file of draws"
        )
    return draws


def _group(path: Path, draws: Draws) -> PopulationResult | None:
    if not path.exists():
        return None
    found = load_population(path)
    known = draws.study.without_conditions()
    others = [
        one.name
        for one in found.study
        if one.name not in known.names or not same_answers(one, known[one.name])
    ]
    if others:
        raise InputError(
            f"{shown(path)}: found other answers than the draws have of {listed(others, 3)}, allowed: one study"
        )
    return found


# --- Tables that lie beside the draws ---------------------------------------------------------------


def _read_evidence(path: Path, draws: Draws) -> pd.DataFrame:
    """An evidence.csv, a row for each subject of the draws, in their order.

    Refused where it is of other subjects, answers or another prior than the draws.
    """
    import pandas as pd

    source = bare(path.name)
    require_update(draws, source)
    number_columns = [name for name in EVIDENCE_COLUMNS if name not in _EVIDENCE_TEXTS]
    texts, numbers = read_rows(path, _EVIDENCE_TEXTS, number_columns)
    require_subjects(source, texts["subject"], draws)
    require_said_prior(source, texts["prior"][0], draws.prior.describe_orders(draws.task))
    evidence = pd.DataFrame({**texts, **numbers}, columns=list(EVIDENCE_COLUMNS))
    _require_same_answers(source, evidence, draws)
    return _in_order_of_draws(evidence, draws)


def _in_order_of_draws(evidence: pd.DataFrame, draws: Draws) -> pd.DataFrame:
    """Rows of an evidence.csv: numbers may be NaN, texts may be empty."""
    rows = evidence.set_index("subject", drop=False).loc[list(draws.names)]
    texts = rows[list(_EVIDENCE_TEXTS)].fillna("")
    numbers = rows.drop(columns=list(_EVIDENCE_TEXTS)).astype(float)
    counts = numbers.astype({"n_pairs": int, "n_trials": int})
    return texts.join(counts)[list(EVIDENCE_COLUMNS)]


def _require_same_answers(source: str, evidence: pd.DataFrame, draws: Draws) -> None:
    """Compare the evidence of free frequencies, which is exact, with that of the answers."""
    for subject, saved in zip(evidence["subject"], evidence["log_evidence_h0"], strict=True):
        if subject in draws.failed:
            continue
        exact = frequency_evidence(draws.subject(subject))
        if not abs(saved - exact) < _EVIDENCE_TOLERANCE * (1.0 + abs(exact)):
            raise InputError(
                f"{source}: found other answers than the draws have of {quoted(subject)}, "
                "allowed: one study"
            )


def _read_contrast(path: Path, draws: Draws) -> pd.DataFrame:
    """The rows of a contrast.csv, refused where it has subjects that the draws do not have."""
    import pandas as pd

    number_columns = [name for name in CONTRAST_COLUMNS if name not in _CONTRAST_TEXTS]
    texts, numbers = read_rows(path, _CONTRAST_TEXTS, number_columns)
    others = set(texts["subject"]).difference(subject.person for subject in draws.study)
    if others:
        raise InputError(
            f"{bare(path.name)}: found other subjects than the draws have, "
            f"{listed(sorted(others), 3)}, allowed: one study"
        )
    return pd.DataFrame({**texts, **numbers})


# --- In words ---------------------------------------------------------------------------------------


def write_text(told: Methods, path: Path) -> None:
    """Write the document, in Markdown or LaTeX by its ending, and its citations, NAME.bib."""
    facts = _facts(told) | {"stem": Markup(path.stem), "latex": path.suffix == ".tex"}
    parts = templates(path.suffix[1:]).get_template("methods.txt").render(facts).split("\n\n")
    wrapped = [_filled(part) if part.startswith(("**", r"\paragraph")) else part for part in parts]
    text = "\n\n".join(part.strip("\n") for part in wrapped if part.strip()) + "\n"
    every = (
        (files("bayes_toe") / "cli" / "references.bib").read_text(encoding="utf-8").split("\n\n")
    )
    entries = {entry.partition("{")[2].partition(",")[0]: entry.strip() for entry in every}
    cited = [
        entry
        for key, entry in entries.items()
        if f"[@{key}]" in text or rf"\citep{{{key}}}" in text
    ]
    path.write_text(text, encoding="utf-8")
    path.with_suffix(".bib").write_text(
        "\n\n".join(cited).replace("VERSION", facts["versions"]["bayes_toe"]) + "\n",
        encoding="utf-8",
    )


def _filled(paragraph: str) -> str:
    """In lines of 110 letters, which end within no formula: one that begins with a minus would be an item of a list in Markdown."""
    whole = re.sub(
        r"\$[^$]*\$", lambda formula: formula[0].replace(" ", "\xa0"), " ".join(paragraph.split())
    )
    return fill(whole, 110, break_long_words=False, break_on_hyphens=False).replace("\xa0", " ")


def _facts(told: Methods) -> dict[str, Any]:
    """Everything that the text says."""
    draws, stats, study = told.draws, told.draws.group("sample_stats"), told.draws.study
    trials = [subject.total_trials for subject in study.without_conditions()]
    sizes, r_hats = stats["min_ess"].values, stats["max_r_hat"].values
    least, most = int(sizes.argmin()), int(r_hats.argmax())
    return {
        "told": told,
        "draws": draws,
        "attrs": draws.attrs,
        "versions": json.loads(draws.attrs["versions"]),
        "words": vars(answer_words),
        "misfit": MISFIT,
        "subjects": counted(len(trials), "subject"),
        "trials": f"{sum(trials):,}",
        "each": ""
        if len(trials) == 1
        else f" ({' to '.join(dict.fromkeys(f'{n:,}' for n in (min(trials), max(trials))))} each)",
        "done": [note for note in study.notes if any(word in note for word in _DONE)],
        "failed": _each(draws.failed),
        "h1": draws.model == PAPER_MODEL,
        "asked": draws.task,
        "observer_prior": draws.prior.observer.describe(draws.task),
        "answer": None if told.evidence is None else _answer(told.evidence, draws),
        "sampler": draws.sampler,
        "kept": f"{draws.group('posterior').sizes['chain'] * draws.group('posterior').sizes['draw']:,}",
        "ess": f"{sizes[least]:,.0f}",
        "ess_of": draws.names[least],
        "r_hat": f"{r_hats[most]:.4f}",
        "r_hat_of": draws.names[most],
        "missed": _each(draws.not_converged),
        "ruled": _ruled(told),
        "reference": f"{draws.prior.reference_interval or 1.0:g} s",
        **_of_model(draws),
        "group": None if told.group is None else _group_facts(told.group),
        "differing": () if told.contrast is None else sentences(told.contrast),
        "limits": (f"{PROBABLY:g}", f"{SURELY:g}"),
    }


def _each(reasons: Mapping[Any, object]) -> str:
    return listed([f"{name} ({reason})" for name, reason in reasons.items()], _MOST_NAMED)


def _ruled(told: Methods) -> str:
    """Parameters that the prior dominates, and in how many subjects."""
    counts = Counter(
        key
        for cell in told.tables[0].frame["prior_dominated"]
        for key in str(cell).split(", ")
        if key
    )
    return ", ".join(f"{key} in {count}" for key, count in counts.items())


def _answer(evidence: pd.DataFrame, draws: Draws) -> dict[str, Any]:
    """The answer of the study and its limits, and the paper's model (H1) against H0."""
    answers = [OrderEffect.from_row(row) for row in evidence.to_dict("records")]
    units = draws.study.conditions is not None
    has_frequencies = len(answers) < FEWEST_FOR_GROUP and not units
    factors = evidence["log_bayes_factor"].dropna()
    is_absent = evidence["log_bayes_factor"].isna()
    dependent = [answer.subject for answer in answers if answer.depends_on_prior]
    serial = [answer.subject for answer in answers if answer.depends_on_previous_trial]
    untestable = [answer.subject for answer in answers if answer.fits is None]
    return {
        "lines": study_lines(answers, synthetic=draws.synthetic, units=units),
        "frequencies": frequency_line(answers) if has_frequencies else "",
        "limits": _design_limits(draws),
        "dependent": listed(dependent, _MOST_NAMED),
        "serial": listed(serial, _MOST_NAMED),
        "untestable": listed(untestable, _MOST_NAMED),
        "unreported": listed(evidence["subject"][is_absent].tolist(), _MOST_NAMED),
        "factors": len(factors),
        "favoured": int((factors > 0.0).sum()),
        "median": f"{factors.median():.1f}",
        "lowest": f"{factors.min():.1f}",
        "highest": f"{factors.max():.1f}",
        "error": f"{evidence['log_evidence_h1_se'].max():.2g} nat",
        "pareto_k": f"{evidence['pareto_k'].max():.2f}",
    }


def _design_limits(draws: Draws) -> list[str]:
    """What the designs of the subjects cannot show."""
    limits = Counter[str]()
    for subject in draws.study:
        identification = identify(subject)
        limits.update({*identification.notes, *identification.reasons.values()})
    n_subjects = len(draws.study)
    return [
        note if count == n_subjects else f"{note} ({counted(count, 'subject')})"
        for note, count in limits.items()
    ]


def _of_model(draws: Draws) -> dict[str, Any]:
    """Of how many subjects the model of the draws describes the answers, by the rule that all models are judged by."""
    fits = fit_table(draws).frame
    wrong = (
        fits[fits["fit"] == "poor"].set_index("subject")[["predictive_p", "p_deviance"]].min(axis=1)
    )
    return {
        "judged": int((fits["fit"] != "").sum()),
        "fitting": int((fits["fit"] == "good").sum()),
        "wrong": _each(wrong.map(said_p).to_dict()),
        "untold": listed(
            fits["subject"][(fits["fit"] == "") & fits["predictive_p"].notna()].tolist(),
            _MOST_NAMED,
        ),
    }


def _group_facts(found: PopulationResult) -> dict[str, Any]:
    rows = found.table.rows
    return {
        "settings": found.settings,
        "subjects": counted(len(found.subjects), "subject"),
        "n_draws": f"{found.draws.mean[..., 0].size:,}",
        "has_q0": "q0" in found.names,
        "n_chains": len(found.draws.mean),
        "hyperprior": found.settings.hyperprior.describe(found.study.task),
        "covariates": [column.about for column in found.regressors.columns],
        "ess": f"{min(min(row.ess_bulk, row.ess_tail) for row in rows):,.0f}",
        "r_hat": f"{max(row.r_hat for row in rows):.4f}",
        "problems": found.problems,
        "answer": group_answer(found),
    }
