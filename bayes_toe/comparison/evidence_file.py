"""evidence.csv read back, beside the draws that it belongs to."""

from __future__ import annotations

from math import isnan
from pathlib import Path

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.evidence_table import EVIDENCE_COLUMNS, EvidenceTable, SubjectEvidence
from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.data.text_table import read_table
from bayes_toe.data.validation import read_numbers
from bayes_toe.errors import InputError
from bayes_toe.inference.belonging import require_said_prior, require_update
from bayes_toe.inference.draws import Draws

_NUMBERS = tuple(name for name in EVIDENCE_COLUMNS if name not in ("subject", "prior"))
#: Columns that a record holds itself, those that may be empty first; the others follow from them.
_HELD = (
    *("log_evidence_h1", "log_evidence_h1_se", "log_evidence_h1_laplace", "log_evidence_h1_laplace_natural", "log_evidence_h1_bootstrap"),
    *("log_evidence_symmetric", "log_evidence_constant_error"),
)
_ALWAYS = ("log_evidence_h0", "log_evidence_h0_laplace", "pareto_k")


def read_evidence(path: str | Path, draws: Draws) -> EvidenceTable:
    """The table of a results folder, in the order of the draws; goodness of fit is theirs, and notes are not stored.

    Raises
    ------
    InputError
        If the file is not such a table, or is of other subjects, counts or another prior than the draws.
    """
    source = bare(Path(path).name)
    require_update(draws, source)
    names, columns = read_numbers(path, (), "subject", optional=_NUMBERS, gaps=True)
    if missing := [name for name in _NUMBERS if name not in columns]:
        raise InputError(f"{source}, column {missing[0]}: missing, allowed: the columns of evidence.csv")
    rows = {name: row for row, name in enumerate(names)}
    others = [*sorted(set(draws.names) ^ (rows.keys() - draws.failed.keys())), *_other_counts(draws, rows, columns)]
    if others:
        raise InputError(f"{source}: found other answers than the draws have of {listed([*map(quoted, others)], 3)}, allowed: one analysis")
    require_said_prior(source, _prior_in(path), draws.prior.describe_orders())
    return EvidenceTable(
        tuple(_row(draws, name, {key: float(values[rows[name]]) for key, values in columns.items()}) for name in draws.names),
        seed=draws.seed,
        prior=draws.prior,
        failed=draws.failed,
    )


def _other_counts(draws: Draws, rows: dict[str, int], columns: dict[str, FloatArray]) -> list[str]:
    known = [(name, draws.subject(name)) for name in draws.names if name in rows]
    found = {name: (columns["n_pairs"][rows[name]], columns["n_trials"][rows[name]]) for name, _ in known}
    return [name for name, subject in known if found[name] != (subject.n_pairs, subject.total_trials)]


def _prior_in(path: str | Path) -> str:
    """What the first row says of the prior; empty without the column."""
    columns = read_table(path, ("subject", "prior")).columns
    return columns["prior"].text(0) if "prior" in columns else ""


def _row(draws: Draws, name: str, cells: dict[str, float]) -> SubjectEvidence:
    stats = draws.group("sample_stats").sel(subject=name)
    return SubjectEvidence(
        subject=name,
        n_pairs=int(cells["n_pairs"]),
        n_trials=int(cells["n_trials"]),
        **{key: None if isnan(cells[key]) else cells[key] for key in _HELD},  # type: ignore[arg-type]
        **{key: cells[key] for key in _ALWAYS},  # type: ignore[arg-type]
        efficiency=float(stats["proposal_efficiency"]),
        fit=None if isnan(cells["predictive_p"]) else draws.fit(name),
    )
