"""What a text for a methods section says of a comparison of models, and of how conclusions move with the prior."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.cli.headline import p_value
from bayes_toe.comparison.model_comparison import PartTable
from bayes_toe.comparison.prior_sensitivity import SensitivityTable
from bayes_toe.comparison.reweighting import RESAMPLED
from bayes_toe.comparison.saved_tables import ComparisonFile
from bayes_toe.comparison.words import KINDS, POSITIVE, STATED, compared, order_effect
from bayes_toe.data.messages import counted, listed
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.predictive_checks import MISFIT
from bayes_toe.model.ladder import Record, model_named
from bayes_toe.model.parameters import Block
from bayes_toe.model.posterior import Model
from bayes_toe.model.prior_fields import STIMULI

_MOST_NAMED = 10
#: The levels of the part order for which there are words of their own, and those words that are no level.
ORDERS = ("none", "constant error", "update")
SOME, UNDECIDED, WITHHELD = "some order effect", "undecided", "no estimate"


def other_priors(records: Iterable[Record], draws: Draws) -> str:
    """Priors of what some of these models have and that of the draws has not: they decide on evidence as much as its own."""
    own = {block.describe(draws.prior) for block in _blocks(model_named(draws.model))}
    found = dict.fromkeys(block.describe(draws.prior) for record in records for block in _blocks(record))
    return ", ".join(said for said in found if said not in own)


def _blocks(record: Record) -> tuple[Block, ...]:
    return record.free if isinstance(record, Model) else ()  # free frequencies have no prior that could be another one


def compared_facts(table: ComparisonFile, draws: Draws) -> dict[str, Any]:
    """Which models, how sure, what each part is, and whether the best model describes the answers."""
    best = table.best
    untold = [name for name, (model, fit) in best.items() if fit >= MISFIT and not _pairs_left(draws, name, model)]
    composed = [record.name for record in table.records if record.levels]
    wrong = [f"{name} (p {'' if (p := p_value(fit)).startswith('<') else '= '}{p})" for name, (_, fit) in best.items() if fit < MISFIT]
    errors, ks = table.log_evidence_se[~np.isnan(table.log_evidence_se)], table.pareto_k[~np.isnan(table.pareto_k)]
    withheld = np.isnan(table.log_evidence).sum(axis=1)
    return {
        "models": counted(len(composed), "model"),
        "named": "" if table.parts else listed(composed, _MOST_NAMED),
        "free": len(composed) < len(table.records),
        "priors": other_priors(table.records, draws),
        "parts": "; ".join(f"{part.part} ({', '.join(part.levels)})" for part in table.parts),
        "error": f"{errors.max():.2g}" if len(errors) else "",
        "pareto_k": f"{ks.max():.2f}" if len(ks) else "",
        "scale": STATED.partition(" (Kass")[0],
        "withheld": listed([name for name, missing in zip(table.subjects, withheld, strict=True) if missing], _MOST_NAMED),
        "found": [_found(part, table.subjects) for part in table.parts],
        "best": ", ".join(f"{name} for {count}" for name, count in Counter(name for name, _ in best.values()).most_common()),
        "judged": not all(np.isnan(fit) or name in untold for name, (_, fit) in best.items()),
        "untold": listed(untold, _MOST_NAMED),
        "wrong": listed(wrong, _MOST_NAMED),
    }


def _pairs_left(draws: Draws, subject: str, model: str) -> bool:
    """Whether there are more pairs than parameters: otherwise a model fits whatever was said."""
    record = model_named(model)
    return not isinstance(record, Model) or draws.subject(subject).n_pairs > len(record.coordinates)


def _found(part: PartTable, subjects: tuple[str, ...]) -> str:
    """How many subjects have which level, and how probable each is for a new subject."""
    with np.errstate(divide="ignore"):  # a probability below the smallest float
        logs = np.log(part.probability)
    kinds = part.part == "order" and part.levels == ORDERS
    words = Counter(
        order_effect(row) if kinds else _level(row, part.levels) for row in [None if np.isnan(row).any() else row for row in logs]
    )
    named = [word for word in (*(KINDS if kinds else part.levels), SOME, UNDECIDED, WITHHELD) if words[word]]
    said = f"{part.part}: {', '.join(f'{word} for {words[word]}' for word in named)} of {counted(len(subjects), 'subject')}"
    if part.study is None:
        return said
    shares = ", ".join(f"P({level}) {compared(p)}" for level, p in zip(part.levels, part.study.tolist(), strict=True))
    return f"{said}; of a new subject, {shares}"


def _level(logs: FloatArray | None, levels: tuple[str, ...]) -> str:
    """The level with positive evidence against each other one."""
    if logs is None:
        return WITHHELD
    order = np.sort(logs)
    return levels[logs.argmax()] if order[-1] - order[-2] >= POSITIVE else UNDECIDED


def varied_facts(table: SensitivityTable) -> dict[str, Any]:
    """Over which priors, by which means, and whose conclusion is another one under some of them."""
    turning = {name: [f"{varied} = {listed([f'{value:.3g}' for value in table.turns(name, varied)], 3)}" for varied in table.varied
                      if table.turns(name, varied)] for name in table.names}  # fmt: skip
    withheld = sorted({row.subject for row in table if row.log_bayes_factor is None})
    return {
        "ranges": ", ".join(_range(table, varied) for varied in table.varied),
        "rows": f"{len(table.rows):,}",
        "anew": f"{sum(row.method == RESAMPLED for row in table):,}",
        "subjects": counted(len(table.names), "subject"),
        "turning": listed([f"{name} ({', '.join(where)})" for name, where in turning.items() if where], _MOST_NAMED),
        "many": sum(bool(where) for where in turning.values()),
        "withheld": listed(withheld, _MOST_NAMED),
    }


def _range(table: SensitivityTable, varied: str) -> str:
    rows = table.of(table.names[0], varied)
    values, factors = [row.value for row in rows], [row.factor for row in rows if row.factor is not None]
    if getattr(table.prior, varied) == STIMULI:  # another one for each subject
        return (
            f"{varied} {min(factors):g} to {max(factors):g} times that of the stimuli" if factors else f"{varied} by mu1_sd to both sides"
        )
    return f"{varied} {min(values):g} to {max(values):g}"
