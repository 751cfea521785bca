"""What terminal and report say of a subject in a word or two, and who must be looked at."""

from __future__ import annotations

from collections.abc import Collection

from bayes_toe.comparison.evidence_table import EvidenceTable
from bayes_toe.comparison.study_answer import said_pair
from bayes_toe.inference.predictive_checks import MISFIT, FitSummary

#: What the columns of a verdict mean.
LEGEND = (
    "P: averaged over 48 models (order, noise, lapses, curve, peak), equally probable beforehand. Size: in half-widths of the curve. Fit: "
    f"of the best of them; not described: predictive p or p of the deviance below {MISFIT:g}. Robust: the same with the prior's scales "
    "of the order halved and doubled"
)
#: What is said of those who must be looked at.
FLAGGED = "not described, data in doubt, draws not converged, or no verdict"


def flagged(table: EvidenceTable, not_converged: Collection[str] = ()) -> dict[str, tuple[str, ...]]:
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
            "data": row.verdict is not None and bool(row.verdict.data),
            "not converged": row.subject in not_converged,
            "no verdict": row.verdict is None or row.verdict.p_orders is None,
        }
        if why := tuple(word for word, true in said.items() if true):
            found[row.subject] = why
    return found


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
    return "; ".join([size, *map(said_pair, fit.worst)])
