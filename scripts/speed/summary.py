"""Medians over subjects: one row a method and effort, for the tables and the figure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from speed.race import NOT_RUN, OK, PARTLY

if TYPE_CHECKING:
    import pandas as pd

KEYS = ["method", "coordinates", "effort", "effort_unit"]
_NUMBERS = [
    "wall_s",
    "compile_s",
    "claimed_ess",
    "true_ess",
    "claimed_ess_per_s",
    "true_ess_per_s",
    "claimed_ess_per_evaluation",
    "claimed_ess_per_sampling_evaluation",
    "true_ess_per_evaluation",
    "divergences",
    "error_worst",
    "log_evidence_error",
    "log_evidence_se",
]


def common_subjects(table: pd.DataFrame, kind: str) -> list[str]:
    """Subjects of one kind on which every method that ran at all was run, so that medians compare like with like."""
    chosen = table[table.kind == kind]
    run = chosen[chosen.status != NOT_RUN]
    methods = set(run.method + run.coordinates)
    found = [name for name, part in run.groupby("subject", sort=False) if set(part.method + part.coordinates) == methods]
    return list(dict.fromkeys(name for name in table.subject if name in found))


def medians(table: pd.DataFrame, subjects: list[str]) -> pd.DataFrame:
    """Medians over these subjects, with how many gave a result (`solved`) and on how many all runs said they had converged."""
    chosen = table[table.subject.isin(subjects)]
    groups = chosen.assign(**{key: chosen[key].astype(float) for key in [*_NUMBERS, "converged"]}).groupby(KEYS, sort=False)
    result = groups[_NUMBERS].median()
    result["solved"] = groups.status.apply(lambda status: int(status.isin([OK, PARTLY]).sum()))
    result["content"] = groups.converged.apply(lambda share: int((share == 1.0).sum()))
    return result.reset_index()
