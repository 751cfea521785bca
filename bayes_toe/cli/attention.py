"""Who must be looked at before a study is believed: said here once, for pictures, tables and reports."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bayes_toe.comparison.evidence_table import EvidenceTable
    from bayes_toe.comparison.presets import UnderPresets

#: What is said of them all.
FLAGGED = "misfit, draws not converged, evidence withheld, or an order effect that the prior presets name differently"


def flagged(table: EvidenceTable, not_converged: Collection[str] = (), presets: Sequence[UnderPresets] = ()) -> dict[str, tuple[str, ...]]:
    """Subjects that someone must look at, in the order of the table, with the reasons in a word or two.

    Examples
    --------
    >>> from bayes_toe.comparison.evidence_table import EvidenceTable
    >>> flagged(EvidenceTable(()))
    {}
    """
    moved = {one.subject for one in presets if one.differ}
    found = {
        row.subject: {
            "misfit": row.misfit,
            "not converged": row.subject in not_converged,
            "evidence withheld": row.log_evidence_orders is None,
            "prior decides": row.subject in moved,
        }
        for row in table
    }
    return {name: why for name, said in found.items() if (why := tuple(word for word, true in said.items() if true))}
