"""Tables for a supplement: of subjects their parameters, order effect, fit and evidence, of the group what is said of it; CSV and LaTeX.

And the two languages in which these and the text of :mod:`bayes_toe.cli.methods` are written.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from bayes_toe.cli.headline import p_value, told
from bayes_toe.cli.terminal import allowed_quantiles
from bayes_toe.comparison.verdict import VERDICT_COLUMNS
from bayes_toe.comparison.words import compared
from bayes_toe.data.messages import visible
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.predictive_checks import MISFIT
from bayes_toe.model.ladder import models_of
from bayes_toe.model.target import DOMINATED
from bayes_toe.plots.style import LABELS

if TYPE_CHECKING:
    import pandas as pd

    from bayes_toe.groups.population import Population

#: Columns of methods_order_effect.csv, and of methods_fit.csv.
ORDER_EFFECT_COLUMNS = (*VERDICT_COLUMNS, "n_pairs", "n_trials", "log_bayes_factor", "log_evidence_h1_se", "pareto_k")
FIT_TABLE_COLUMNS = ("subject", "n_pairs", "n_trials", "predictive_p", "p_deviance", "fits")
_RANGE = {"median": "q50", "q05": "q05", "q95": "q95"}
_NOTHING = "--"
#: What letters of a text from outside become.
_LETTERS = {
    "md": str.maketrans({one: f"\\{one}" for one in "\\`*_[]<>|#~$"}),
    "tex": str.maketrans(
        {one: f"\\{one}" for one in "&%$#_{}"} | {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}"}
        | {"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}"}
    ),
}  # fmt: skip


def templates(language: str) -> Environment:
    """Where documents are made in a language, "md" or "tex": texts come out as letters, its macros (markup.md, markup.tex) are `m`."""

    def letters(value: object) -> Markup:
        return value if isinstance(value, Markup) else Markup(visible(str(value)).translate(_LETTERS[language]))

    def symbol(name: str) -> Markup:
        """A parameter as the paper has it, where it has it."""
        return Markup(LABELS.get(name, letters(name)).replace("\n", " "))

    def distributed(text: str) -> Markup:
        """A prior with symbols, and a sign for 'is distributed as'."""
        words = re.split(r"(\w+) ~ ", text)
        return Markup("".join(rf"{symbol(word)} $\sim$ " if i % 2 else letters(word) for i, word in enumerate(words)))

    made = Environment(
        loader=PackageLoader("bayes_toe", "cli"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=letters,
    )
    made.filters.update(letters=letters, symbol=symbol, distributed=distributed)
    made.globals["m"] = made.get_template(f"markup.{language}").module
    return made


@dataclass(frozen=True, eq=False)
class SupplementTable:
    """One table, in two forms: numbers as they are, for the CSV file, and what people read."""

    name: str  # after that of the document: NAME_parameters.csv and .tex
    caption: str
    frame: pd.DataFrame
    head: tuple[str, ...]  # names of parameters, where a column is one, and words
    rows: tuple[tuple[str, ...], ...]

    def written(self, markup: Any, stem: str) -> Markup:
        """For people, with the macros of a language; columns that are parameters have their symbols."""
        parameters = {name.removesuffix("_median") for name in self.frame.columns if name.endswith("_median")}
        head = [markup.symbol(one) if one in parameters else one for one in self.head]
        return Markup(markup.table(head, self.rows, self.caption, Markup(f"{stem}_{self.name}")).strip())


def parameter_table(draws: Draws, summary: pd.DataFrame) -> SupplementTable:
    """Medians and intervals of every subject, what the prior rules, and what sampling has reached."""
    import pandas as pd

    names, stats, missed = draws.posterior(draws.names[0]).names, draws.group("sample_stats"), draws.not_converged
    shown = (*names.natural, *(("gain",) if "gain" in names.reported and "gain" not in names.natural else ()))
    frames, rows = list[dict[str, Any]](), list[tuple[str, ...]]()
    for i, (name, part) in enumerate(summary.groupby("subject", sort=False)):
        by = {str(row["parameter"]): row for row in part.to_dict("records")}
        ruled = [key for key in shown if by[key]["contraction"] < DOMINATED]
        reached = {"min_ess": float(stats["min_ess"][i]), "max_r_hat": float(stats["max_r_hat"][i])}
        values = {f"{key}_{ending}": by[key][column] for key in shown for ending, column in _RANGE.items()}
        converged = "no" if name in missed else "yes"
        frames.append({"subject": name, **values, "prior_dominated": ", ".join(ruled), **reached, "converged": converged})
        ranges = {key: allowed_quantiles(by[key], 3) for key in shown}
        cells = [f"{middle} ({low}, {high}){'*' * (key in ruled)}" for key, (low, middle, high) in ranges.items()]
        rows.append((str(name), *cells, f"{reached['min_ess']:.0f}", f"{reached['max_r_hat']:.3f}", converged))
    whose = "the paper's model" if draws.model == models_of(draws.task).update.name else f"the model {draws.model}"
    caption = (
        f"Posterior medians (5 %, 95 %) of each subject under {whose}. *: dominated by the prior (contraction below "
        f"{DOMINATED:g}). ESS: smallest bulk or tail effective sample size; R-hat: largest."
    )
    head = ("subject", *shown, "ESS", "R-hat", "converged")
    return SupplementTable("parameters", caption, pd.DataFrame(frames), head, tuple(rows))


def _probability(value: float) -> str:
    return compared(value).removeprefix("= ")


#: What people read of the columns of evidence.csv: the head of each, and its values in words.
_COLUMNS: dict[str, tuple[str, Callable[[Any], str]]] = {
    "subject": ("subject", str),
    "n_trials": ("trials", "{:.0f}".format),
    "effect": ("order effect", str),
    "kind": ("kind", str),
    "p_none": ("P(none)", lambda p: told(p) if 0.005 <= p <= 0.995 else _probability(p)),
    "p_constant_error": ("P(constant error)", _probability),
    "p_update": ("P(pull)", _probability),
    "size_q50": ("size", "{:.2f}".format),
    "log_bayes_factor_effect": ("ln BF effect:none", "{:.1f}".format),
    "fit": ("fit", str),
    "data": ("data", lambda value: re.sub(r" \(--[^)]*\)", "", value)),  # options that act on it are no part of a paper
    "robust": ("robust", str),
    "log_bayes_factor": ("ln BF H1:H0", "{:.2f}".format),
}


def order_effect_table(evidence: pd.DataFrame) -> SupplementTable:
    """The verdict of every subject, and the evidence of the paper's model against free frequencies, of the rows of evidence.csv."""
    frame = evidence[[*ORDER_EFFECT_COLUMNS]]

    def said(row: dict[Any, Any], name: str) -> str:
        value = row[name]
        return _NOTHING if value is None or value == "" or value != value else _COLUMNS[name][1](value)

    caption = (
        "Order effect by subject. P: posterior probabilities over all models, none, constant error and pull equally probable beforehand. "
        "ln BF effect:none: natural log Bayes factor of an effect of either kind. Size: posterior median, in just noticeable differences. "
        "Fit: of the model with the highest evidence. Robust: the same with the prior scales of the order halved and doubled. ln BF H1:H0: "
        "natural log Bayes factor of the paper's model against free frequencies."
    )
    cells = {name: [said(row, name) for row in frame.to_dict("records")] for name in _COLUMNS}
    shown = [name for name, column in cells.items() if {*column} != {_NOTHING}]
    rows = tuple(zip(*(cells[name] for name in shown), strict=True))
    return SupplementTable("order_effect", caption, frame, tuple(_COLUMNS[name][0] for name in shown), rows)


def fit_table(draws: Draws) -> SupplementTable:
    """Whether the model of the draws describes the answers of every subject; empty where it was not judged or cannot be told."""
    import pandas as pd

    stats, nothing = draws.group("sample_stats"), np.full(len(draws.names), np.nan)
    p, deviance_p = (stats[name].values if name in stats else nothing for name in ("predictive_p", "deviance_p"))
    wrong = (p < MISFIT) | (deviance_p < MISFIT)
    known = ~np.isnan(p) & (wrong | (stats["degrees_of_freedom"].values > 0 if "degrees_of_freedom" in stats else False))
    counts = [(subject.n_pairs, subject.total_trials) for subject in draws.study]
    cells = zip(draws.names, *zip(*counts, strict=True), p, deviance_p, np.where(known, np.where(wrong, "no", "yes"), ""), strict=True)
    frame = pd.DataFrame(cells, columns=list(FIT_TABLE_COLUMNS))
    p_values = ([_NOTHING if np.isnan(value) else p_value(value) for value in values.tolist()] for values in (p, deviance_p))
    rows = zip(draws.names, map(str, frame["n_trials"]), *p_values, [fits or _NOTHING for fits in frame["fits"]], strict=True)
    caption = f"Fit of the model by subject: no where a predictive p or a p-value of the deviance is below {MISFIT:g}."
    return SupplementTable("fit", caption, frame, ("subject", "trials", "predictive p", "p of deviance", "fits"), tuple(rows))


def group_table(found: Population) -> SupplementTable:
    """Everything that is said of a population: the rows of population.csv."""
    frame = found.table.frame()
    rows = tuple(
        (
            row.quantity.replace("_", " "),
            row.parameter,
            row.level,
            f"{row.q50:.3f} ({row.q05:.3f}, {row.q95:.3f})",
            _NOTHING if row.p_direction is None else _probability(row.p_direction),
            _NOTHING if row.of_none == "-" else row.of_none,
            f"{row.ess_bulk:.0f}",
            f"{row.r_hat:.3f}",
        )
        for row in found.table
    )
    head = ("quantity", "parameter", "of", "median (5 %, 95 %)", "P(sign)", "BF of none", "bulk ESS", "R-hat")
    caption = f"The population under the model {found.settings.model}. BF of none: Bayes factor of a mean of 0, or of no difference."
    return SupplementTable("population", caption, frame, head, rows)
