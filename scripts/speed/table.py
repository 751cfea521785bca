"""The race as a table: one row a subject, method and effort; medians over runs, with quartiles where the spread matters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from speed.race import Entry
from speed.score import Score, spread_ess, true_ess

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    "subject",
    "kind",
    "method",
    "coordinates",
    "effort",
    "effort_unit",
    "status",
    "reason",
    "runs",
    "failed_runs",
    "wall_s",
    "wall_s_lower",
    "wall_s_upper",
    "compile_s",
    "draws",
    "evaluations",
    "sampling_evaluations",
    "claimed_ess",
    "true_ess",
    "spread_ess",
    "independent_means",
    "claimed_ess_per_s",
    "true_ess_per_s",
    "spread_ess_per_s",
    "claimed_ess_per_evaluation",
    "true_ess_per_evaluation",
    "claimed_ess_per_sampling_evaluation",
    "divergences",
    "converged",
    "says",
    "error_mean",
    "error_sd",
    "error_quantiles",
    "error_worst",
    "error_worst_lower",
    "error_worst_upper",
    "log_evidence_error",
    "log_evidence_se",
)
_MEDIANS = ("wall_s", "draws", "evaluations", "sampling_evaluations", "claimed_ess", "divergences")
_ERRORS = ("error_mean", "error_sd", "error_quantiles", "error_worst", "log_evidence_se")


#: One row of the table, by column; numbers and words only.
Row = dict[str, object]


def frame(rows: Sequence[Row]) -> pd.DataFrame:
    """Every row, those without a result too."""
    import pandas as pd

    return pd.DataFrame(rows, columns=list(COLUMNS))


def row_of(entry: Entry) -> Row:
    """What one method gave at one effort on one subject."""
    method = entry.method
    row: Row = dict.fromkeys(COLUMNS)
    row |= {"subject": entry.case.name, "kind": entry.case.kind, "method": method.name, "coordinates": method.coordinates}
    row |= {"effort": entry.effort, "effort_unit": method.effort_unit, "status": entry.status, "reason": entry.reason}
    row |= {"runs": len(entry.scores), "failed_runs": len(entry.failures), "compile_s": entry.compile_s}
    return row | (_measured(entry) if entry.scores else {})


def _measured(entry: Entry) -> Row:
    scores, reference = entry.scores, entry.case.reference
    row: Row = {key: _median(scores, key) for key in (*_MEDIANS, *_ERRORS)}
    for key in ("wall_s", "error_worst"):
        row[f"{key}_lower"], row[f"{key}_upper"] = np.quantile([getattr(one, key) for one in scores], (0.25, 0.75))
    gaps = [abs(one.log_evidence_error) for one in scores if one.log_evidence_error is not None]
    row["log_evidence_error"] = float(np.median(gaps)) if gaps else None
    row["independent_means"] = sum(len(one.chain_means) for one in scores)
    claims = row["claimed_ess"] is not None
    row["true_ess"] = true_ess(scores, reference) if claims else None
    row["spread_ess"] = spread_ess(scores, reference) if claims else None
    for key in ("claimed_ess", "true_ess", "spread_ess"):
        row[f"{key}_per_s"] = _ratio(row[key], row["wall_s"])
    for key in ("claimed_ess", "true_ess"):
        row[f"{key}_per_evaluation"] = _ratio(row[key], row["evaluations"])
    row["claimed_ess_per_sampling_evaluation"] = _ratio(row["claimed_ess"], row["sampling_evaluations"])
    row["converged"] = float(np.mean([one.converged for one in scores]))
    row["says"] = next((one.says for one in scores if not one.converged), scores[0].says)
    return row


def _median(scores: list[Score], key: str) -> float | None:
    """Median over the runs that have a value; a NaN stays one."""
    values = [getattr(one, key) for one in scores if getattr(one, key) is not None]
    return float(np.median(values)) if values else None


def _ratio(above: object, below: object) -> float | None:
    return None if above is None or below is None else float(str(above)) / float(str(below))
