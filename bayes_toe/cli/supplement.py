"""Tables for a supplement: of subjects their parameters, order effect, fit and evidence, of the group what is said of it; CSV and LaTeX.

And the two languages in which these and the text of :mod:`bayes_toe.cli.methods` are written.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from bayes_toe.answers.order_effect import (
    ANSWER_COLUMNS,
    QUESTIONS,
    OrderEffect,
    format_probability,
)
from bayes_toe.answers.words import Word
from bayes_toe.cli.headline import p_value
from bayes_toe.cli.terminal import allowed_quantiles
from bayes_toe.data.messages import visible
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.predictive_checks import MISFIT
from bayes_toe.model.paper_model import PAPER_MODEL
from bayes_toe.model.posterior import DOMINATED
from bayes_toe.plots.style import LABELS

if TYPE_CHECKING:
    import pandas as pd

    from bayes_toe.groups.population import PopulationResult

#: Columns of methods_order_effect.csv, and of methods_fit.csv.
ORDER_EFFECT_COLUMNS = (
    *ANSWER_COLUMNS,
    "n_pairs",
    "n_trials",
    "log_bayes_factor",
    "log_evidence_h1_se",
    "pareto_k",
)
FIT_TABLE_COLUMNS = ("subject", "n_pairs", "n_trials", "predictive_p", "p_deviance", "fit")
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
        return (
            value
            if isinstance(value, Markup)
            else Markup(visible(str(value)).translate(_LETTERS[language]))
        )

    def symbol(name: str) -> Markup:
        """A parameter as the paper has it, where it has it."""
        return Markup(LABELS.get(name, letters(name)).replace("\n", " "))

    def distributed(text: str) -> Markup:
        """A prior with symbols, and a sign for 'is distributed as'."""
        words = re.split(r"(\w+) ~ ", text)
        return Markup(
            "".join(
                rf"{symbol(word)} $\sim$ " if i % 2 else letters(word)
                for i, word in enumerate(words)
            )
        )

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


class SupplementTable(NamedTuple):
    """One table, in two forms: numbers as they are, for the CSV file, and what people read, a text a cell.

    Its files are called after the document, NAME_parameters.csv and .tex, and columns that are parameters after these.
    """

    name: str
    caption: str
    frame: pd.DataFrame
    shown: pd.DataFrame

    def written(self, markup: Any, stem: str) -> Markup:
        """For people, with the macros of a language; columns that are parameters have their symbols."""
        head = [markup.symbol(one) if f"{one}_median" in self.frame else one for one in self.shown]
        return Markup(
            markup.table(
                head, self.shown.to_numpy().tolist(), self.caption, Markup(f"{stem}_{self.name}")
            ).strip()
        )


def parameter_table(draws: Draws, summary: pd.DataFrame) -> SupplementTable:
    """Medians and intervals of every subject, what the prior rules, and what sampling has reached."""
    import pandas as pd

    names, stats, missed = (
        draws.posterior(draws.names[0]).names,
        draws.group("sample_stats"),
        draws.not_converged,
    )
    keys = (
        *names.natural,
        *(("gain",) if "gain" in names.reported and "gain" not in names.natural else ()),
    )
    frames, shown = list[dict[str, Any]](), list[dict[str, str]]()
    for i, (name, part) in enumerate(summary.groupby("subject", sort=False)):
        by = {str(row["parameter"]): row for row in part.to_dict("records")}
        ruled = [key for key in keys if by[key]["contraction"] < DOMINATED]
        reached = {"min_ess": float(stats["min_ess"][i]), "max_r_hat": float(stats["max_r_hat"][i])}
        values = {
            f"{key}_{ending}": by[key][column] for key in keys for ending, column in _RANGE.items()
        }
        converged = "no" if name in missed else "yes"
        frames.append(
            {
                "subject": name,
                **values,
                "prior_dominated": ", ".join(ruled),
                **reached,
                "converged": converged,
            }
        )
        ranges = {
            key: "{1} ({0}, {2})".format(*allowed_quantiles(by[key], 3)) + "*" * (key in ruled)
            for key in keys
        }
        numbers = {"ESS": f"{reached['min_ess']:.0f}", "R-hat": f"{reached['max_r_hat']:.3f}"}
        shown.append({"subject": str(name), **ranges, **numbers, "converged": converged})
    whose = "the paper's model" if draws.model == PAPER_MODEL else f"the model {draws.model}"
    caption = (
        f"Posterior medians (5 %, 95 %) of each subject under {whose}. *: dominated by the prior (posterior contraction below "
        f"{DOMINATED:g}). ESS: smallest bulk or tail effective sample size; R-hat: largest."
    )
    return SupplementTable("parameters", caption, pd.DataFrame(frames), pd.DataFrame(shown))


def order_effect_table(evidence: pd.DataFrame) -> SupplementTable:
    """The answer of every subject, and the paper's model against H0, of the rows of evidence.csv."""
    import pandas as pd

    caption = (
        "Order effect by subject, with posterior probabilities in brackets. Estimates: medians [95 % intervals], averaged over the "
        "models that have the effect. PSE shift: positive where the first stimulus is overestimated. p: positive for a contraction, "
        "negative for a repulsion. !: the model does not fit. ?: the word depends on the prior. ln BF H1:H0: natural log Bayes factor "
        "of the paper's model against one free probability per pair."
    )
    rows = evidence.to_dict("records")
    shown = pd.DataFrame([_answer_cells(row) for row in rows])
    return SupplementTable("order_effect", caption, evidence[[*ORDER_EFFECT_COLUMNS]], shown)


def _answer_cells(row: Mapping[Any, Any]) -> dict[str, str]:
    """A row of evidence.csv as people read it."""
    answer = OrderEffect.from_row(row)
    factor = row["log_bayes_factor"]
    return {
        "subject": answer.subject,
        "trials": f"{row['n_trials']:.0f}",
        **{question.replace("_", " "): _word(answer, question) for question in QUESTIONS},
        "PSE shift (%)": _estimate(answer, "pse_shift_percent", "+.2g"),
        "p": _estimate(answer, "contraction_p", ".2f"),
        "JND (%)": _estimate(answer, "jnd_percent", ".2g"),
        "ln BF H1:H0": _NOTHING if factor != factor else f"{factor:.1f}",
    }


def _word(answer: OrderEffect, question: str) -> str:
    if not answer.is_interpretable:
        return "not interpreted"
    if answer.words[question] is Word.CANNOT_BE_TOLD:
        return Word.CANNOT_BE_TOLD.value
    probability = format_probability(answer.probabilities[question]).removeprefix("= ")
    return f"{answer.marked_word(question)} ({probability})"


def _estimate(answer: OrderEffect, name: str, form: str) -> str:
    """A size with its interval; nothing where the subject is not interpreted."""
    if not answer.is_interpretable or name not in answer.sizes:
        return _NOTHING
    size = answer.sizes[name]
    return f"{size.q50:{form}} [{size.q025:{form}}, {size.q975:{form}}]"


def _in_words(column: Iterable[Any], words: Callable[[Any], str]) -> list[str]:
    return [
        _NOTHING if value is None or value == "" or value != value else words(value)
        for value in column
    ]


def fit_table(draws: Draws) -> SupplementTable:
    """The fit of the model of the draws by subject; empty where it is not testable."""
    import pandas as pd

    stats, nothing = draws.group("sample_stats"), np.full(len(draws.names), np.nan)
    p, deviance_p = (
        stats[name].values if name in stats else nothing for name in ("predictive_p", "deviance_p")
    )
    wrong = (p < MISFIT) | (deviance_p < MISFIT)
    known = ~np.isnan(p) & (
        wrong | (stats["degrees_of_freedom"].values > 0 if "degrees_of_freedom" in stats else False)
    )
    counts = [(subject.n_pairs, subject.total_trials) for subject in draws.study]
    cells = zip(
        draws.names,
        *zip(*counts, strict=True),
        p,
        deviance_p,
        np.where(known, np.where(wrong, "poor", "good"), ""),
        strict=True,
    )
    frame = pd.DataFrame(cells, columns=list(FIT_TABLE_COLUMNS))
    columns: dict[str, Callable[[Any], str]] = {
        "subject": str,
        "n_trials": str,
        "predictive_p": p_value,
        "p_deviance": p_value,
        "fit": str,
    }
    shown = pd.DataFrame({name: _in_words(frame[name], words) for name, words in columns.items()})
    caption = f"Fit of the model by subject: poor where a predictive p or a p-value of the deviance is below {MISFIT:g}."
    heads = {"n_trials": "trials", "predictive_p": "predictive p", "p_deviance": "p of deviance"}
    return SupplementTable("fit", caption, frame, shown.rename(columns=heads))


def group_table(found: PopulationResult) -> SupplementTable:
    """Everything that is known of a group: the rows of population.csv."""
    import pandas as pd

    shown = [
        {
            "quantity": row.quantity.replace("_", " "),
            "parameter": row.parameter,
            "of": row.level,
            "median [95 % interval]": f"{row.q50:.3f} [{row.q025:.3f}, {row.q975:.3f}]",
            "P(sign)": _NOTHING
            if row.p_direction is None
            else format_probability(row.p_direction).removeprefix("= "),
            "ln BF of 0": _NOTHING if row.zero_words == "-" else row.zero_words,
            "bulk ESS": f"{row.ess_bulk:.0f}",
            "R-hat": f"{row.r_hat:.3f}",
        }
        for row in found.table
    ]
    caption = "The group. ln BF of 0: natural log of the Bayes factor of a mean, effect or difference of 0."
    return SupplementTable("population", caption, found.table.frame(), pd.DataFrame(shown))
