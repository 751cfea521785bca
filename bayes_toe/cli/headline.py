"""What terminal and report say first of a subject: where the model does not describe the answers, and what to do about it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection

from bayes_toe.comparison.evidence_table import EvidenceTable
from bayes_toe.comparison.words import KINDS, order_effect, order_effect_and_probability
from bayes_toe.data.messages import counted
from bayes_toe.data.study import Study
from bayes_toe.inference.predictive_checks import MISFIT, FitSummary, PairFit
from bayes_toe.model.prior import Prior

_SOME = "some order effect"
#: What to do about a misfit, where no composition is known that describes the answers.
NEXT = "next: bayes-toe compare, which finds the noise and the lapses that these answers need, and the order effect under them"
#: What the comparison of Appendix C tests, and what it does not.
APPENDIX_C = "H0 has a free frequency per pair: this asks whether the answers follow one smooth curve, not whether there is an order effect"
#: When a misfit is said, and what follows from it.
FIT = (
    f"A misfit is a predictive p or a p-value of the deviance below {MISFIT:g}; the three models of the order effect share noise and "
    "lapses with H1, so that their probabilities mean little there"
)

#: What is said of them all.
FLAGGED = "misfit, draws not converged, or evidence withheld"


def flagged(table: EvidenceTable, not_converged: Collection[str] = ()) -> dict[str, tuple[str, ...]]:
    """Subjects that someone must look at, in the order of the table, with the reasons in a word or two.

    Examples
    --------
    >>> flagged(EvidenceTable(()))
    {}
    """
    found = {
        row.subject: {
            "misfit": row.misfit,
            "not converged": row.subject in not_converged,
            "evidence withheld": row.log_evidence_orders is None,
        }
        for row in table
    }
    return {name: why for name, said in found.items() if (why := tuple(word for word, true in said.items() if true))}


def tally(table: EvidenceTable) -> str:
    """How many subjects have which order effect, in the order of the kinds; for a single subject, which one."""
    if len(table) == 1:
        return order_effect_and_probability(table.rows[0].log_evidence_orders)
    found = Counter(order_effect(row.log_evidence_orders) for row in table)
    words = [word for word in (*KINDS, _SOME, "undecided", "no estimate") if found[word]]
    return ", ".join(f"{word} for {found[word]}" for word in words) + f" of {len(table)} subjects"


def in_short(table: EvidenceTable, *, synthetic: bool = False) -> str:
    """What a study supports, in one sentence: who has an order effect, among those whose answers the model describes, and what next.

    An effect is counted where its evidence is at least positive, as :func:`~bayes_toe.comparison.words.order_effect` has it.
    """
    described, whose = [row for row in table if not row.misfit], "synthetic subject" if synthetic else "subject"
    if not described:
        return f"H1 describes the answers of none of {counted(len(table), whose)}; {NEXT}"
    found, wrong = Counter(_whether(row.log_evidence_orders) for row in described), len(table) - len(described)
    effect, none, undecided, unknown = (found[word] for word in (_SOME, KINDS[0], "undecided", "no estimate"))
    among = f"the {counted(len(described), whose)} whose answers H1 describes" if wrong else counted(len(described), whose)
    parts = [f"{effect} of {among} {'has' if 1 in (effect, len(described)) else 'have'} an order effect"]
    parts += [f"{none} {'has' if none == 1 else 'have'} none"] if none else []
    parts += [f"{undecided} {'is' if undecided == 1 else 'are'} undecided"] if undecided else []
    parts += [f"{unknown} {'has' if unknown == 1 else 'have'} no estimate"] if unknown else []
    untold = sum(row.fit is None or row.fit.describes is None for row in described)
    last = f"{wrong} more {'is' if wrong == 1 else 'are'} not described, {NEXT}" if wrong else _describes(len(described), untold)
    return f"{', '.join(parts)} (counted where evidence is at least positive: P above 0.73 against each rival); {last}"


def _whether(orders: tuple[float, ...] | None) -> str:
    """Whether there is an order effect, of whatever kind, in a word or two."""
    word = order_effect(orders)
    return _SOME if word in KINDS[1:] else word


def _describes(subjects: int, untold: int) -> str:
    """That H1 describes the answers of those of whom it can be told: one who has as many parameters as pairs fits whatever was said.

    Examples
    --------
    >>> _describes(3, 1), _describes(1, 1)
    ('H1 describes the answers of 2, of 1 it cannot be told', 'whether H1 describes the answers cannot be told')
    """
    if untold == 0:
        return "H1 describes the answers of all"
    if untold == subjects:
        return "whether H1 describes the answers cannot be told"
    return f"H1 describes the answers of {subjects - untold}, of {untold} it cannot be told"


def scale_first(study: Study, prior: Prior) -> str:
    """What comes before all else that a summary says is next: stimuli in another unit than the prior; empty where they are not."""
    from bayes_toe.experiments.checks import prior_scale

    found = prior_scale(study, prior)
    return "first mend the unit of the stimuli, or use the default prior: the scale of this one is not theirs; " if found else ""


def misfits(table: EvidenceTable) -> str:
    """Of how many subjects the model does not describe the answers; empty where it does for all."""
    found = sum(row.misfit for row in table)
    return f"H1 does not describe the answers{f' of {found} of {len(table)} subjects' if len(table) > 1 else ''}" if found else ""


def p_value(value: float) -> str:
    """A p-value for a table.

    Examples
    --------
    >>> p_value(0.0), p_value(0.0123), p_value(0.5)
    ('< 0.001', '0.012', '0.50')
    """
    return "< 0.001" if value < 0.001 else f"{value:.2g}" if value < 0.095 else f"{value:.2f}"


def deviance(fit: FitSummary) -> str:
    """A deviance with its degrees of freedom."""
    return f"{fit.deviance:.1f} ({fit.degrees_of_freedom})"


def misfit(fit: FitSummary) -> str:
    """A misfit in one line: how bad, and the worst pairs."""
    p = p_value(fit.p_overall)
    size = f"predictive p {p if p.startswith('<') else f'= {p}'}, deviance {fit.deviance:.1f} on {fit.degrees_of_freedom} d.f."
    return "; ".join([size, *map(_pair, fit.worst)])


def _pair(pair: PairFit) -> str:
    """A pair with both shares of 'equal'.

    Examples
    --------
    >>> _pair(PairFit(3.688879, 3.296837, 0.95, 0.7))
    '(3.69, 3.3) called equal 95 %, expected 70 %'
    """
    interval = "" if pair.isi is None else f" at {pair.isi:g} s"
    return f"({pair.s1:.3g}, {pair.s2:.3g}){interval} called equal {100 * pair.observed:.0f} %, expected {100 * pair.expected:.0f} %"
