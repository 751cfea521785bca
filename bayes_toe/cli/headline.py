"""Short texts that terminal and report share, and which subjects need action."""

from __future__ import annotations

from collections.abc import Collection

from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.answers.order_effect import OrderEffect
from bayes_toe.answers.study_summary import describe_pair
from bayes_toe.answers.words import (
    NO_UP_TO,
    PROBABLY_FROM,
    PROBABLY_NOT_LOG_BAYES_FACTOR,
    PROBABLY_NOT_UP_TO,
    YES_FROM,
)
from bayes_toe.data.messages import describe_p
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.inference.predictive_checks import FitSummary

#: The limits of the words.
LIMITS = (
    f"An effect is 'yes' from a posterior probability of {YES_FROM} on, 'probably' from "
    f"{PROBABLY_FROM} on, 'no' up to {NO_UP_TO}, 'probably not' up to {PROBABLY_NOT_UP_TO} where "
    f"the log Bayes factor is at most {PROBABLY_NOT_LOG_BAYES_FACTOR:g}; otherwise 'undecided'"
)
#: What the figure of a subject's responses shows, in either task.
CURVES = {
    SAME_DIFFERENT: "P('equal') averaged over the four models, central 50 % (dark) and 95 % "
    "(light) bands",
    WHICH_STRONGER: "P('second') over s2 − s1 averaged over the four models, after each first "
    "stimulus s1; where a curve crosses one half (dotted) is the point of subjective equality (PSE)",
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


def deviance(fit: FitSummary) -> str:
    """A deviance with its degrees of freedom."""
    return f"{fit.deviance:.1f} ({fit.degrees_of_freedom})"


def misfit(fit: FitSummary) -> str:
    """A misfit in one line: how bad, and the worst pairs."""
    size = f"predictive {describe_p(fit.p_overall)}, deviance {fit.deviance:.1f} on {fit.degrees_of_freedom} d.f."
    return "; ".join([size, *map(describe_pair, fit.worst)])
