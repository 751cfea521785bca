"""What the command line says of a population: first whether it has an order effect, then what covariates do, then all in numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import compress
from typing import TYPE_CHECKING, Any

from bayes_toe.cli.digits import allowed
from bayes_toe.cli.terminal import safe, say, say_footnote, say_notes, say_table
from bayes_toe.data.messages import counted

if TYPE_CHECKING:
    from rich.console import Console

    from bayes_toe.groups.population import Population
    from bayes_toe.groups.population_table import PopulationRow

_DECIDED = 0.95  # a probability of direction: the interval from 5 to 95 % is on one side of 0
BAYES_FACTOR = "BF: by how much the answers change the odds of no difference against a difference; below 1 they speak for a difference"
CORRELATED = "correlations between subjects, mean (5 %, 95 %)"
_SIDES = ("a difference", "no difference")
_PULLING = ("pull", "gain", "offset")


def say_population(console: Console, found: Population, contradicted: Sequence[str] = ()) -> None:
    """The answer, tables, what each prior was, and what to know before any of it is believed."""
    from bayes_toe.comparison.words import STATED

    for line in answer(found):
        say(console, line)
    if effects := [effect(row) for row in found.table.some("effect")]:
        about = "; ".join(column.about for column in found.regressors.columns)
        say_table(console, f"effects of covariates, mean (5 %, 95 %): {safe(about)}", effects)
        say_footnote(console, f"{BAYES_FACTOR}. {STATED}.")
    say_table(console, f"{found.settings.model}: {len(found.study)} subjects, mean (5 %, 95 %)", scales(found))
    if together := correlations(found):
        say_table(console, CORRELATED, together)
    say_table(console, f"medians (5 %, 95 %){reference(found)}", naturals(found))
    for line in found.settings.hyperprior.describe(found.names, correlations=found.settings.correlations):
        say_footnote(console, f"hyperprior: {line}")
    say_notes(console, found.regressors.notes)
    say_attention(console, found, contradicted)


def say_attention(console: Console, found: Population, contradicted: Sequence[str]) -> None:
    """What to know before any of it is believed: what was not reached, and what contradicts a population of this form."""
    say_notes(console, (*found.shortfalls, *contradicted), "attention", "red")


def answer(found: Population) -> list[str]:
    """Whether the population has an order effect, where a subject at its mean is, and what covariates do: a line each, with markup."""
    return [line for line in (_order_effect(found), _at_the_mean(found), *_contrasts(found)) if line]


def _order_effect(found: Population) -> str:
    from bayes_toe.comparison.words import compared
    from bayes_toe.groups.asymmetries import OVERALL

    if found.asymmetries is None:
        return "[bold]order effect of the population[/bold]: no pair of different stimuli was presented in both orders; see pull and gain"
    row, (further,) = found.table.some("asymmetry", OVERALL)[0], found.table.some("new_subject", OVERALL)
    p, many = row.p_direction or 0.0, len(found.asymmetries.comparisons) - 1
    side = "stronger" if row.mean > 0.0 else "weaker"
    if p >= _DECIDED:
        said = f"'equal' is likelier with the {side} stimulus first (P {compared(p)})"
    else:
        said = f"direction undecided ('equal' likelier with the {side} stimulus first: P {compared(p)})"
    size = f"asymmetry, P(equal) stronger first less weaker first, {_interval(row)} on average over {counted(many, 'comparison')}"
    return f"[bold]order effect of the population[/bold]: {said}; {size} and all subjects; of a further subject {_ends(further)}"


def _at_the_mean(found: Population) -> str:
    rows = {row.parameter: row for row in found.table.some("mean")}
    said = ", ".join(f"{name} {_median(rows[name])}" for name in _PULLING if name in rows)
    return said and f"[bold]a subject at the mean[/bold]{reference(found)}: {said}"


def _contrasts(found: Population) -> list[str]:
    """How the asymmetry differs by covariates."""
    from bayes_toe.comparison.words import compared
    from bayes_toe.groups.asymmetries import OVERALL

    if found.asymmetries is None:
        return []
    rows = compress(found.table.some("asymmetry", OVERALL), found.asymmetries.differences)
    return [f"[bold]{safe(row.level)}[/bold]: asymmetry {_interval(row)}, P(sign) {compared(row.p_direction or 0.0)}" for row in rows]


def effect(row: PopulationRow) -> dict[Any, Any]:
    """One effect of a covariate, as a table shows it."""
    from bayes_toe.comparison.words import compared, conclusion

    if row.bf_no_difference is not None:
        factor, words = f"{row.bf_no_difference:.2g}", conclusion(_nats(row.bf_no_difference), _SIDES)
    elif row.bf_below is not None and row.bf_below < 1.0:
        factor, words = f"< {row.bf_below:.2g}", f"at least {conclusion(_nats(row.bf_below), _SIDES)}"
    else:  # a bound that says nothing
        factor, words = "-", conclusion(None)
    said = {"covariate": row.level, "on": row.parameter, "effect": _interval(row), "P(sign)": compared(row.p_direction or 0.0)}
    return {**said, "BF no difference": factor, "evidence": words}


def _nats(factor: float) -> float:
    """For a difference; a factor may be below the smallest float."""
    return -math.log(factor) if factor > 0.0 else math.inf


def scales(found: Population) -> list[dict[Any, Any]]:
    """Mean and scatter of every parameter on its scale."""
    what = "sd between subjects" if found.settings.scatter == "normal" else "scale between subjects (t)"
    rows = []
    for sd in found.table.some("sd"):
        (mean,) = found.table.some("mean", sd.parameter)
        ess, r_hat = min(one for row in (mean, sd) for one in (row.ess_bulk, row.ess_tail)), max(mean.r_hat, sd.r_hat)
        row = {"scale": sd.parameter, "mean": _interval(mean), what: _interval(sd)}
        rows.append({**row, "min ESS": f"{ess:.0f}", "max R-hat": f"{r_hat:.3f}"})
    return rows


def correlations(found: Population) -> list[dict[Any, Any]]:
    """How parameters go together over subjects, those first of which the sign is most certain; none where these were not asked for."""
    from bayes_toe.comparison.words import compared

    rows = sorted(found.table.some("correlation"), key=lambda row: -(row.p_direction or 0.0))
    return [{"scales": row.parameter, "correlation": _interval(row), "P(sign)": compared(row.p_direction or 0.0)} for row in rows]


def naturals(found: Population) -> list[dict[Any, Any]]:
    """Every quantity of a subject at the mean and of a further one."""
    means = {row.parameter: _median(row) for row in found.table.some("mean")}
    further = {row.parameter: _median(row) for row in found.table.some("new_subject")}
    shown = [name for name in further if name in means]
    return [{"quantity": name, "subject at the mean": means[name], "further subject": further[name]} for name in shown]


def reference(found: Population) -> str:
    """Who is meant where there are covariates."""
    of = {column.covariate: column.reference or "mean" for column in found.regressors.columns}
    return safe(f" ({', '.join(f'{name} {level}' for name, level in of.items())})") if of else ""


def _interval(row: PopulationRow) -> str:
    return f"{_shown(row.mean, row)} ({_ends(row, ', ')})"


def _median(row: PopulationRow) -> str:
    return f"{_shown(row.q50, row)} ({_ends(row, ', ')})"


def _ends(row: PopulationRow, between: str = " to ") -> str:
    return between.join(_shown(value, row) for value in (row.q05, row.q95))


def _shown(value: float, row: PopulationRow) -> str:
    return allowed(value, row.sd / math.sqrt(min(row.ess_bulk, row.ess_tail)), 3)
