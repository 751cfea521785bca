"""Short texts that terminal and report share, and which subjects need action."""

from __future__ import annotations

from collections.abc import Collection

from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.answers.order_effect import OrderEffect, format_decimals
from bayes_toe.answers.words import (
    NO_UP_TO,
    PROBABLY_FROM,
    PROBABLY_NOT_LOG_BAYES_FACTOR,
    PROBABLY_NOT_UP_TO,
    YES_FROM,
)
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER

#: The words, and the probabilities that they need.
LIMITS = {
    "yes": f"at least {format_decimals(YES_FROM)}",
    "probably": f"at least {format_decimals(PROBABLY_FROM)}",
    "undecided": "otherwise",
    "probably not": f"at most {format_decimals(PROBABLY_NOT_UP_TO)}, with a log Bayes factor of at most "
    f"{PROBABLY_NOT_LOG_BAYES_FACTOR:g}",
    "no": f"at most {format_decimals(NO_UP_TO)}",
}
#: What the figure of a subject's responses shows, in either task.
CURVES = {
    SAME_DIFFERENT: "Curves show P('equal') averaged over the four models, with 50 % (dark) and "
    "95 % (light) bands.",
    WHICH_STRONGER: "Curves show P('second') over s2 − s1, averaged over the four models, for "
    "each first stimulus s1. The point of subjective equality (PSE) is where a curve crosses one "
    "half (dotted line).",
}
#: Why a subject needs action.
FLAGGED = "poor fit, not interpreted, draws not converged, or no answer"


def needs_action(answer: OrderEffect) -> bool:
    """Whether a subject needs a decision before its conclusion is used."""
    return answer.fits is False or not answer.is_interpretable or bool(answer.options)


def flagged(
    table: EvidenceTable, not_converged: Collection[str] = ()
) -> dict[str, tuple[str, ...]]:
    """Subjects that need action, in the order of the table, with the reasons in a word or two.

    Examples
    --------
    >>> flagged(EvidenceTable(()))
    {}
    """
    reasons = {}
    for row in table:
        own = []
        if row.answer is None:
            own.append("no answer")
        else:
            if row.answer.fits is False:
                own.append("poor fit")
            if not row.answer.is_interpretable:
                own.append("not interpreted")
            elif row.answer.options:
                own.append("action possible")
        if row.subject in not_converged:
            own.append("not converged")
        if own:
            reasons[row.subject] = tuple(own)
    return reasons
