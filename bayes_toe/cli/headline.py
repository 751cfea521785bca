"""What terminal and report say of a subject in a word or two, and who must be looked at."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from bayes_toe.comparison.evidence_table import EvidenceTable
from bayes_toe.comparison.study_answer import said_pair
from bayes_toe.comparison.words import (
    HAS,
    NAMED,
    NONE,
    PROBABLY_HAS,
    PROBABLY_NAMED,
    PROBABLY_NONE,
    SMALL,
    SURELY,
)
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.inference.predictive_checks import MISFIT, FitSummary
from bayes_toe.model.ladder import models_of

#: From where on a word is said.
LIMITS = (
    f"An order effect is said up to P(none) = {HAS}, and probably up to {PROBABLY_HAS}; probably none from {PROBABLY_NONE} on, none from "
    f"{NONE}; negligible where it is open and P(size > {SMALL}) is at most {SURELY}; otherwise it is undecided. The kind is named where it "
    f"has {NAMED:.0%} of the probability of any effect, probably from {PROBABLY_NAMED:.0%} on".replace(
        "%", " %"
    )
)
#: What the figure of a subject's answers shows, of either task, before its bands.
CURVES = {
    SAME_DIFFERENT: "P('equal') by the paper's model, central 60 % (dark) and 95 % (light) bands",
    WHICH_STRONGER: "P('second') over s2 − s1 by the paper's model, after each first stimulus s1, central 60 % bands; where a curve "
    "crosses one half (dotted) is the point of subjective equality (PSE), and without an order effect all cross it at 0",
}
#: What is said of those who must be looked at.
FLAGGED = "not described, data in doubt, draws not converged, or no verdict"


def legend(task: Task) -> str:
    """What the columns of a verdict mean."""
    space = models_of(task).space
    varied = [
        part
        for part in dict(space[0].levels)
        if len({dict(model.levels)[part] for model in space}) > 1
    ]
    return (
        f"P: averaged over {len(space)} models ({', '.join(varied)}), equally probable beforehand. Size: in just noticeable differences "
        f"(JND). Fit: of the best of them; not described: predictive p or p of the deviance below {MISFIT:g}. Robust: the same with the "
        "prior's scales of the order halved and doubled"
    )


def flagged(
    table: EvidenceTable, not_converged: Collection[str] = ()
) -> dict[str, tuple[str, ...]]:
    """Subjects that someone must look at, in the order of the table, with the reasons in a word or two.

    Examples
    --------
    >>> flagged(EvidenceTable(()))
    {}
    """
    found = {}
    for row in table:
        said = {
            "not described": row.verdict is not None and row.verdict.fit == "not described",
            "data in doubt": row.verdict is not None and bool(row.verdict.data),
            "not converged": row.subject in not_converged,
            "no verdict": row.verdict is None or row.verdict.p_orders is None,
        }
        if why := tuple(word for word, true in said.items() if true):
            found[row.subject] = why
    return found


def told(
    value: float,
    limits: Sequence[float] = (HAS, PROBABLY_HAS, PROBABLY_NONE, NONE),
    digits: int = 2,
) -> str:
    """A number with so many decimals, or as many as tell on which side of the limits it is.

    Examples
    --------
    >>> told(0.2531), told(0.2478), told(0.25), told(0.2499997)
    ('0.253', '0.248', '0.25', '0.2499997')
    """
    while digits < 15 and any(
        _side(value, one) != _side(round(value, digits), one) for one in limits
    ):
        digits += 1
    return f"{value:.{digits}f}"


def _side(value: float, limit: float) -> int:
    return (value > limit) - (value < limit)


def p_value(value: float) -> str:
    """A p-value for a table, two digits that count; one that is below the limit of a misfit looks so.

    Examples
    --------
    >>> p_value(0.0), p_value(0.0123), p_value(0.00997), p_value(0.5)
    ('< 0.001', '0.012', '0.00997', '0.50')
    """
    return (
        "< 0.001"
        if value < 0.001
        else told(value, [MISFIT], 2 + (value < 0.095) + (value < 0.0095))
    )


def said_p(value: float) -> str:
    """A p-value in a sentence."""
    shown = p_value(value)
    return f"p {shown if shown.startswith('<') else f'= {shown}'}"


def deviance(fit: FitSummary) -> str:
    """A deviance with its degrees of freedom."""
    return f"{fit.deviance:.1f} ({fit.degrees_of_freedom})"


def misfit(fit: FitSummary) -> str:
    """A misfit in one line: how bad, and the worst pairs."""
    size = f"predictive {said_p(fit.p_overall)}, deviance {fit.deviance:.1f} on {fit.degrees_of_freedom} d.f."
    return "; ".join([size, *map(said_pair, fit.worst)])
