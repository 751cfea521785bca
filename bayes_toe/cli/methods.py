"""What was done in an analysis, said from its files: a text for a methods section, and the tables and citations that go with it."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from bayes_toe.cli.methods_of_models import compared_facts, other_priors, varied_facts
from bayes_toe.cli.supplement import SupplementTable, group_table, order_effect_table, parameter_table, stored_fit, templates
from bayes_toe.comparison.evidence_table import EvidenceTable
from bayes_toe.comparison.prior_sensitivity import SensitivityTable
from bayes_toe.comparison.saved_tables import ComparisonFile, read_comparison, read_evidence, read_sensitivity
from bayes_toe.data.messages import counted, listed, shown
from bayes_toe.data.whole_files import is_store
from bayes_toe.errors import InputError
from bayes_toe.groups.population import Population
from bayes_toe.groups.population_file import load_population
from bayes_toe.inference.belonging import same_answers
from bayes_toe.inference.draws import Draws, load
from bayes_toe.model.ladder import CONSTANT_BIAS, PREDICTIVE_UPDATE, SYMMETRIC
from bayes_toe.model.posterior import Posterior

if TYPE_CHECKING:
    import pandas as pd

_MOST_NAMED = 10


@dataclass(frozen=True, eq=False)
class Methods:
    """An analysis as its files have it.

    Attributes
    ----------
    draws : Draws
    evidence : EvidenceTable or None
        Of evidence.csv, where that lies beside draws of H1.
    group : Population or None
        Of population.nc, where that lies beside them.
    figures : bool
        Whether corner plots lie beside them.
    notes : tuple of str
        What is there and is not told of, and why.
    compared, varied : ComparisonFile, SensitivityTable or None
        Of compare.csv and sensitivity.csv, where these lie beside the draws or are named.
    """

    draws: Draws
    evidence: EvidenceTable | None
    group: Population | None
    figures: bool
    notes: tuple[str, ...]
    compared: ComparisonFile | None = None
    varied: SensitivityTable | None = None

    @cached_property
    def summary(self) -> pd.DataFrame:
        """That of the draws, with the columns of summary.csv."""
        return self.draws.summary()

    @cached_property
    def tables(self) -> tuple[SupplementTable, ...]:
        """Those of the supplement."""
        made = parameter_table(self.draws, self.summary), order_effect_table(self.draws, self.evidence)
        return made if self.group is None else (*made, group_table(self.group))

    @property
    def names(self) -> tuple[str, ...]:
        """What the tables are called, known before they are made."""
        return ("parameters", "fit" if self.evidence is None else "order_effect", *(() if self.group is None else ("population",)))


def read_methods(results: Path, compared: Path | None = None, varied: Path | None = None) -> Methods:
    """What lies in a results folder, or beside a file of draws; with tables of compare and sensitivity that lie elsewhere.

    Raises
    ------
    InputError
        Where there are no draws, or files are of different analyses.
    """
    posterior = _posterior(results)
    draws, beside = load(posterior), posterior.parent
    if not isinstance(draws.posterior(draws.names[0]), Posterior):
        raise InputError(f"{shown(posterior)}: found draws of the model {draws.model!r}, allowed: one with parameters")
    notes: list[str] = []
    group = _group(beside / "population.nc", draws)
    if group is None and (beside / "population.csv").exists():
        notes.append(
            f"{shown(beside / 'population.csv')}: left out, since what it was made with is in population.nc, which "
            "bayes-toe population writes"
        )
    evidence = _about_h1(_there(beside / "evidence.csv"), draws, notes)
    scan = _table(varied, beside, "sensitivity.csv")
    scan = _about_h1(scan, draws, notes) if varied is None else scan
    models = _table(compared, beside, "compare.csv")
    return Methods(
        draws,
        None if evidence is None else read_evidence(evidence, draws),
        group,
        (beside / "corner").is_dir(),
        tuple(notes),
        None if models is None else read_comparison(models, draws),
        None if scan is None else read_sensitivity(scan, draws),
    )


def _about_h1(path: Path | None, draws: Draws, notes: list[str]) -> Path | None:
    """A file that only draws of H1 can be told with; otherwise a note that it is left out."""
    if path is None or draws.model == PREDICTIVE_UPDATE.name:
        return path
    notes.append(f"{shown(path)} is about H1, the draws are of the model {draws.model!r}: left out")
    return None


def _table(given: Path | None, beside: Path, name: str) -> Path | None:
    """The file that was named, or in the folder that was named; otherwise that beside the draws, where there is one."""
    if given is None:
        return _there(beside / name)
    return given / name if os.path.isdir(given) else given


def _there(path: Path) -> Path | None:
    return path if path.exists() else None


def _posterior(results: Path) -> Path:
    """The draws themselves, or those of a folder."""
    if not os.path.isdir(results) or is_store(results):  # a Path refuses names that are too long with an error of its own
        return results
    there = [path for path in (results / "posterior.nc", results / "posterior.zarr") if path.exists()]
    if len(there) != 1:
        found = "posterior.nc and posterior.zarr" if there else "no posterior.nc and no posterior.zarr"
        raise InputError(f"{shown(results)}: found {found}, allowed: a folder that bayes-toe run wrote, or a file of draws")
    return there[0]


def _group(path: Path, draws: Draws) -> Population | None:
    if not path.exists():
        return None
    found = load_population(path)
    others = [one.name for one in found.study if one.name not in draws.names or not same_answers(one, draws.subject(one.name))]
    if others:
        raise InputError(f"{shown(path)}: found other answers than the draws have of {listed(others, 3)}, allowed: one study")
    return found


# --- In words ---------------------------------------------------------------------------------------


def written(told: Methods, language: str, stem: str) -> tuple[str, str]:
    """The document, and its citations as BibTeX.

    Parameters
    ----------
    told : Methods
    language : str
        "md" or "tex".
    stem : str
        Of the names of all files: the document names them.
    """
    facts = _facts(told) | {"stem": Markup(stem), "latex": language == "tex"}
    parts = templates(language).get_template("methods.txt").render(facts).split("\n\n")
    leads = "**" if language == "md" else r"\paragraph"
    wrapped = [fill(part, 110, break_long_words=False, break_on_hyphens=False) if part.startswith(leads) else part for part in parts]
    text = "\n\n".join(part.strip("\n") for part in wrapped if part.strip()) + "\n"
    every = (files("bayes_toe") / "cli" / "references.bib").read_text(encoding="utf-8").split("\n\n")
    entries = {entry.partition("{")[2].partition(",")[0]: entry.strip() for entry in every}
    cited = [entry for key, entry in entries.items() if f"[@{key}]" in text or rf"\citep{{{key}}}" in text]
    return text, "\n\n".join(cited).replace("VERSION", _versions(told.draws)["bayes_toe"]) + "\n"


def _facts(told: Methods) -> dict[str, Any]:
    """Everything that the text says, each from a file."""
    from bayes_toe.cli.headline import in_short, misfit, scale_first

    draws, evidence = told.draws, told.evidence
    stats, trials = draws.group("sample_stats"), [draws.subject(name).total_trials for name in draws.names]
    fits = {name: stored_fit(draws, name) for name in draws.names}
    wrong = {name: misfit(fit) for name, fit in fits.items() if fit is not None and fit.misfit}
    sizes, r_hats = stats["min_ess"].values, stats["max_r_hat"].values
    least, most = int(sizes.argmin()), int(r_hats.argmax())
    return {
        "told": told,
        "draws": draws,
        "attrs": draws.attrs,
        "versions": _versions(draws),
        "subjects": counted(len(draws.names), "subject"),
        "trials": f"{sum(trials):,}",
        "each": f"{min(trials):,}" if min(trials) == max(trials) else f"{min(trials):,} to {max(trials):,}",
        "h1": draws.model == PREDICTIVE_UPDATE.name,
        "sampler": draws.sampler,
        "kept": f"{draws.group('posterior').sizes['chain'] * draws.group('posterior').sizes['draw']:,}",
        "ess": f"{sizes[least]:,.0f}",
        "ess_of": draws.names[least],
        "r_hat": f"{r_hats[most]:.4f}",
        "r_hat_of": draws.names[most],
        "missed": _each(draws.not_converged),
        "failed": _each(draws.failed),
        "ruled": _ruled(told),
        "judged": sum(fit is not None and fit.describes is not None for fit in fits.values()),
        "untold": listed([name for name, fit in fits.items() if fit is not None and fit.describes is None], _MOST_NAMED),
        "wrong": _each(wrong),
        "misfits": len(wrong),
        "reference": f"{draws.prior.reference_interval or 1.0:g} s",
        "weighed": None if evidence is None else _weighed(evidence, draws),
        "in_short": None if evidence is None else scale_first(draws.study, draws.prior) + in_short(evidence, synthetic=draws.synthetic),
        "compared": None if told.compared is None else compared_facts(told.compared, draws),
        "varied": None if told.varied is None else varied_facts(told.varied),
        "group": None if told.group is None else _group_facts(told.group),
    }


def _versions(draws: Draws) -> dict[str, str]:
    import json

    return {str(name): str(version) for name, version in json.loads(draws.attrs["versions"]).items()}


def _each(reasons: Mapping[str, str]) -> str:
    return listed([f"{name} ({reason})" for name, reason in reasons.items()], _MOST_NAMED)


def _ruled(told: Methods) -> str:
    """Parameters that the prior dominates, and in how many subjects."""
    counts = Counter(key for cell in told.tables[0].frame["prior_dominated"] for key in str(cell).split(", ") if key)
    return ", ".join(f"{key} in {count}" for key, count in counts.items())


def _weighed(table: EvidenceTable, draws: Draws) -> dict[str, Any]:
    from bayes_toe.cli.headline import tally
    from bayes_toe.comparison.words import STATED

    errors = [row.log_evidence_h1_se for row in table if row.log_evidence_h1_se is not None]
    return {
        "priors": other_priors((SYMMETRIC, CONSTANT_BIAS), draws),
        "error": f"{max(errors):.2g}" if errors else "",
        "pareto_k": f"{max(row.pareto_k for row in table):.2f}",
        "withheld": listed([row.subject for row in table if row.log_evidence_orders is None], _MOST_NAMED),
        "tally": tally(table),
        "scale": STATED.partition(" (Kass")[0],  # who is cited
    }


def _group_facts(found: Population) -> dict[str, Any]:
    from rich.text import Text

    from bayes_toe.cli.population import answer

    rows = found.table.rows
    return {
        "settings": found.settings,
        "subjects": counted(len(found.study), "subject"),
        "hyperprior": found.settings.hyperprior.describe(found.names, correlations=found.settings.correlations),
        "covariates": [column.about for column in found.regressors.columns],
        "ess": f"{min(min(row.ess_bulk, row.ess_tail) for row in rows):,.0f}",
        "r_hat": f"{max(row.r_hat for row in rows):.4f}",
        "problems": found.problems,
        "answer": [Text.from_markup(line).plain for line in answer(found)],
    }
