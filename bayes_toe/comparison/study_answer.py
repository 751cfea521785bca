"""What the verdicts of its subjects say of a study: one sentence, a new subject of its population beside it, and where to go on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.comparison.verdict import Verdict
from bayes_toe.comparison.words import EFFECTS, KINDS, compared
from bayes_toe.data.messages import counted, listed
from bayes_toe.data.validation import AT
from bayes_toe.inference.predictive_checks import PairFit

_NAMES = 5  # of subjects in a line
#: What a clause says after one that named the order effect.
_AGAIN = (
    ("an order effect", "one"),
    ("no order effect", "none"),
    ("negligible order effect", "negligible one"),
)
#: One sentence on the table of Appendix C.
APPENDIX_C = "H0 has a free frequency per pair: this asks whether answers follow one smooth curve, not whether there is an order effect"


@dataclass(frozen=True)
class SavedVerdict:
    """What evidence.csv says of one subject, in the words of its columns."""

    subject: str
    effect: str
    kind: str
    fit: str
    data: tuple[str, ...]
    robust: str
    p_orders: tuple[float, ...] | None
    first_seems: str = ""

    @classmethod
    def of(cls, row: Mapping[Any, Any]) -> SavedVerdict:
        """By the row's cells, where texts that are not there are empty; of the data what was found, without the option that acts on it."""
        p = tuple(float(row[name]) for name in ("p_none", "p_constant_error", "p_update"))
        words = {name: str(row[name]) for name in ("subject", "effect", "kind", "fit", "robust")}
        data = tuple(one.partition(" (--")[0] for one in str(row["data"]).split("; ") if one)
        return cls(**words, data=data, p_orders=None if p[0] != p[0] else p)

    def describe(self) -> str:
        """The verdict in words, without the subject's name."""
        none = "" if self.p_orders is None else f" (P of none {compared(self.p_orders[0])})"
        doubts = ["no model describes the answers"] if self.fit == "not described" else []
        doubts += [f"data: {', '.join(self.data)}"] if self.data else []
        doubts += ["the choice of the prior has a say"] if self.robust == "no" else []
        return "; ".join([EFFECTS[self.effect] + _kinds([self]) + none, *doubts])


def study_sentence(
    verdicts: Sequence[Verdict | SavedVerdict], *, synthetic: bool = False, units: bool = False
) -> str:
    """How many subjects have an order effect, of how many no model describes the answers, and whose data are in doubt; one sentence.

    `units` says that each is a subject in one condition.

    Examples
    --------
    >>> from bayes_toe.comparison.verdict import Doubt
    >>> has = Verdict("A", (0.0, 0.02, 0.98), (), 9.0, 0.5, 1.0, "update", None)
    >>> none = Verdict("B", (0.9, 0.05, 0.05), (), -2.9, 0.0, 0.0, "none", None, data=(Doubt("near chance"),))
    >>> study_sentence([has, none])
    '1 of 2 subjects has an order effect (a pull), 1 probably has none; the data of 1 are in doubt (B)'
    >>> study_sentence([Verdict("C", (0.5, 0.3, 0.2), (), 0.0, 0.0, 0.0, "none", None), none])
    '1 of 2 subjects has at most a negligible order effect, 1 probably has none; the data of 1 are in doubt (B)'
    """
    if len(verdicts) == 1:
        return f"{verdicts[0].subject} {verdicts[0].describe()}"
    found = Counter(one.effect for one in verdicts)
    parts, whose = list[str](), f"{'synthetic ' * synthetic}subject"
    people = len({one.subject.rpartition(AT)[0] for one in verdicts}) if units else 0
    who = (
        f"{counted(len(verdicts), 'condition')} of {counted(people, whose)}"
        if units
        else counted(len(verdicts), whose)
    )
    for word in EFFECTS:
        if not found[word]:
            continue
        among = f" of {who}" if not parts else ""
        verb = EFFECTS[word]
        for full, short in _AGAIN if parts else ():
            verb = verb.replace(full, short)
        verb = verb.replace("has ", "have ").replace("is ", "are ") if found[word] > 1 else verb
        parts.append(
            f"{found[word]}{among} {verb}{_kinds([one for one in verdicts if one.effect == word])}"
        )
    said = [", ".join(parts)]
    felt = {
        how: [one.subject for one in verdicts if one.first_seems == how]
        for how in ("stronger", "weaker")
    }
    sides = [
        f"{how} to {len(whose)} ({listed(whose, _NAMES)})" for how, whose in felt.items() if whose
    ]
    said += [f"by constant errors the first stimulus seems {' and '.join(sides)}"] if sides else []
    for named, why in (
        (
            [one.subject for one in verdicts if one.fit == "not described"],
            "no model describes the answers of {}",
        ),
        ([one.subject for one in verdicts if one.data], "the data of {} are in doubt"),
        (
            [one.subject for one in verdicts if one.robust == "no"],
            "of {} the choice of the prior has a say",
        ),
    ):
        if named:
            said.append(f"{why.format(len(named))} ({listed(named, _NAMES)})")
    return "; ".join(said)


def _kinds(some: Sequence[Verdict | SavedVerdict]) -> str:
    """Of which kinds effects are, in brackets; nothing where none is said.

    Examples
    --------
    >>> of = [(0.0, 0.0, 1.0), (0.0, 0.15, 0.85), (0.0, 0.5, 0.5)]
    >>> _kinds([Verdict(str(i), p, (), 9.0, 0.5, 1.0, "", None) for i, p in enumerate(of)])
    ' (1 a pull, 1 probably a pull, 1 of an open kind)'
    """
    found = Counter(one.kind for one in some if one.kind)
    words = {
        kind: f"a {kind}" if kind in KINDS.values() else f"probably a {kind[9:]}" for kind in found
    }
    words |= {"open": "of an open kind"}
    order = sorted(
        found,
        key=lambda kind: (
            kind == "open",
            kind.removeprefix("probably "),
            kind.startswith("probably"),
        ),
    )
    shown = [f"{found[kind]} {words[kind]}" if len(some) > 1 else words[kind] for kind in order]
    return f" ({', '.join(shown)})" if shown else ""


def of_new_subject(
    verdicts: Sequence[Verdict | SavedVerdict], seed: int, *, units: bool = False
) -> str:
    """How probable each kind is of a new subject of the population, by random effects; empty with fewer than two subjects.

    With `units`, of a new subject in one condition, those of the same subject taken for others.

    Each subject is of one kind, drawn with unknown frequencies. Source: Penny et al. 2010 (PLoS Comput. Biol. 6:e1000709).
    """
    known = np.array([one.p_orders for one in verdicts if one.p_orders is not None])
    if len(known) < 2:
        return ""
    with np.errstate(divide="ignore"):  # a kind without any probability
        found = random_effects(np.log(known), seed=seed)
    said = ("no order effect", "constant error", "pull")
    shares = ", ".join(
        f"P({word}) {compared(p)}" for word, p in zip(said, found.expected.tolist(), strict=True)
    )
    return f"of a new subject{' in one condition' * units}, by random effects over {len(known)}: {shares}"


def way_on(verdict: Verdict) -> str:
    """Where no model of the space describes a subject: how the answers depart, what scatter does, and what to do next; else empty."""
    if verdict.fit != "not described" or verdict.best_fit is None:
        return ""
    pairs = ", ".join(map(said_pair, verdict.best_fit.worst))
    scatter = ""
    if verdict.p_none_scattered is not None and verdict.p_none is not None:
        changed = f"{verdict.p_none_scattered:.2f} and not {verdict.p_none:.2f}"
        scatter = f"; if answers to a pair may scatter from block to block, P of none is {changed}"
    options = [one.option for one in verdict.data if one.option]
    advice = (
        f"run again with {' '.join(options)}, which may be all of it"
        if options
        else "report the effect as undecided, with these pairs"
    )
    return f"no model describes the answers: {pairs}{scatter}; next: {advice}"


def doubts_of(verdict: Verdict) -> str:
    """What the data have against them, and what acts on it; empty where nothing was found."""
    return ", ".join(
        one.kind + (f", which {one.option} acts on" if one.option else "") for one in verdict.data
    )


def said_pair(pair: PairFit) -> str:
    """A pair with both shares of the answer that the task counts.

    Examples
    --------
    >>> said_pair(PairFit(3.688879, 3.296837, 0.95, 0.7))
    '(3.69, 3.3) answered equal 95 %, expected 70 %'
    """
    interval = "" if pair.isi is None else f" at {pair.isi:g} s"
    return f"({pair.s1:.3g}, {pair.s2:.3g}){interval} answered {pair.answer} {100 * pair.observed:.0f} %, expected {100 * pair.expected:.0f} %"
