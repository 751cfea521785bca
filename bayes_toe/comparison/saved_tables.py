"""Tables of evidence, models and priors read back from their files, beside the draws that they belong to."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from math import isnan
from pathlib import Path

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.evidence_table import EVIDENCE_COLUMNS, ORDERS, EvidenceTable, SubjectEvidence
from bayes_toe.comparison.model_comparison import PartTable, part_tables
from bayes_toe.comparison.prior_sensitivity import QUANTILES, SUMMARISED, SensitivityRow, SensitivityTable
from bayes_toe.data.messages import bare, listed, quoted
from bayes_toe.data.validation import read_rows
from bayes_toe.errors import InputError
from bayes_toe.inference.belonging import require_said_prior, require_subjects, require_update
from bayes_toe.inference.draws import Draws
from bayes_toe.model.free_frequencies import FrequencyPosterior
from bayes_toe.model.ladder import Record, model_named

_EVIDENCE = tuple(name for name in EVIDENCE_COLUMNS if name not in ("subject", "prior"))
#: Columns that a row of an evidence table holds itself, those that may be empty first; the others follow from them.
_HELD = (
    *("log_evidence_h1", "log_evidence_h1_se", "log_evidence_h1_laplace", "log_evidence_h1_laplace_natural", "log_evidence_h1_bootstrap"),
    *("log_evidence_symmetric", "log_evidence_constant_error"),
)
_PROBABILITIES = dict(zip(ORDERS, ("p_none", "p_constant_error", "p_update"), strict=True))
_ALWAYS = ("log_evidence_h0", "log_evidence_h0_laplace", "pareto_k")
_COMPARED = ("log_evidence", "log_evidence_se", "pareto_k", "p_predictive")
_DIGITS = 1e-6  # of an exact evidence, nats: the file has all digits


def read_evidence(path: str | Path, draws: Draws) -> EvidenceTable:
    """The table of a results folder, in the order of the draws; goodness of fit is theirs, and notes are not stored.

    Raises
    ------
    InputError
        If the file is not such a table, or is of other subjects, counts or another prior than the draws.
    """
    source = bare(Path(path).name)
    require_update(draws, source)
    texts, columns = read_rows(path, ("subject", "prior"), _EVIDENCE)
    cells = {name: {key: float(values[i]) for key, values in columns.items()} for i, name in enumerate(texts["subject"])}
    subjects = {name: draws.subject(name) for name in draws.names}
    others = sorted(set(subjects) ^ (cells.keys() - draws.failed.keys()))
    others += [
        name
        for name, one in subjects.items()
        if name in cells and (cells[name]["n_pairs"], cells[name]["n_trials"]) != (one.n_pairs, one.total_trials)
    ]
    if others:
        raise InputError(f"{source}: found other answers than the draws have of {listed([*map(quoted, others)], 3)}, allowed: one analysis")
    require_said_prior(source, texts["prior"][0], draws.prior.describe_orders())
    efficiency = draws.group("sample_stats")["proposal_efficiency"]
    rows = [
        SubjectEvidence(
            subject=name,
            n_pairs=one.n_pairs,
            n_trials=one.total_trials,
            **{key: None if isnan(cells[name][key]) else cells[name][key] for key in _HELD},  # type: ignore[arg-type]
            **{key: cells[name][key] for key in _ALWAYS},  # type: ignore[arg-type]
            efficiency=float(efficiency.sel(subject=name)),
            fit=None if isnan(cells[name]["predictive_p"]) else draws.fit(name),
            without_weight=tuple(key for key, p in _PROBABILITIES.items() if isnan(cells[name][key]) and cells[name][p] == 0.0),
        )
        for name, one in subjects.items()
    ]
    return EvidenceTable(tuple(rows), seed=draws.seed, prior=draws.prior, failed=draws.failed)


@dataclass(frozen=True, eq=False)
class ComparisonFile:
    """What compare.csv says of every subject under every model.

    Attributes
    ----------
    subjects : tuple of str
    records : tuple of record
    log_evidence, log_evidence_se, pareto_k, p_predictive : array, shape (subjects, models)
        Nats, nats, none, none; NaN where withheld or not there, but an evidence of -inf where the model has no weight without one.
    seed : int
        Of the study's frequencies.
    """

    subjects: tuple[str, ...]
    records: tuple[Record, ...]
    log_evidence: FloatArray
    log_evidence_se: FloatArray
    pareto_k: FloatArray
    p_predictive: FloatArray
    seed: int = 0

    @cached_property
    def parts(self) -> tuple[PartTable, ...]:
        """How probable every level of every part is, as compare_parts.csv has it."""
        return part_tables(self.records, self.log_evidence, seed=self.seed)

    @property
    def best(self) -> dict[str, tuple[str, float]]:
        """By subject, the composition with the highest evidence and its posterior predictive p; without subjects who have no evidence."""
        composed = np.array([bool(record.levels) for record in self.records])
        known = np.where(composed & ~np.isnan(self.log_evidence), self.log_evidence, -np.inf)
        best = zip(self.subjects, known.argmax(axis=1), known.max(axis=1), self.p_predictive, strict=True)
        return {name: (self.records[place].name, float(p[place])) for name, place, value, p in best if np.isfinite(value)}


def read_comparison(path: str | Path, draws: Draws) -> ComparisonFile:
    """The table in the order of the draws' subjects.

    Raises
    ------
    InputError
        If the file is not such a table, or is of other subjects, answers or another prior than the draws.
    """
    source = bare(Path(path).name)
    texts, numbers = read_rows(path, ("subject", "model", "prior"), (*_COMPARED, "model_probability"))
    models = tuple(dict.fromkeys(texts["model"]))
    places = {key: row for row, key in enumerate(zip(texts["subject"], texts["model"], strict=True))}
    require_subjects(source, texts["subject"], draws)
    for name, model in product(draws.names, models):
        if (name, model) not in places:
            raise InputError(f"{source}: no row of subject {quoted(name)} with model {quoted(model)}, allowed: every subject with each")
    records = tuple(map(model_named, models))
    for record in records:
        require_said_prior(source, texts["prior"][places[draws.names[0], record.name]], record.describe(draws.prior))
    rows = np.array([[places[name, model] for model in models] for name in draws.names])
    numbers["log_evidence"][np.isnan(numbers["log_evidence"]) & (numbers["model_probability"] == 0.0)] = -np.inf
    found = ComparisonFile(draws.names, records, **{name: numbers[name][rows] for name in _COMPARED}, seed=draws.seed)
    # The evidence of free frequencies is exact, and so tells whether the answers are the same.
    free = [place for place, record in enumerate(records) if not record.levels]
    for i, name in enumerate(draws.names if free else ()):
        exact = FrequencyPosterior(draws.subject(name)).log_evidence
        if not abs(found.log_evidence[i, free[0]] - exact) < _DIGITS * (1.0 + abs(exact)):
            raise InputError(f"{source}: found other answers than the draws have of {quoted(name)}, allowed: one study")
    return found


def read_sensitivity(path: str | Path, draws: Draws) -> SensitivityTable:
    """The table without its quantiles, with the seed of the draws.

    Raises
    ------
    InputError
        If the file is not such a table, or is of other subjects or a range about another prior than the draws.
    """
    source = bare(Path(path).name)
    require_update(draws, source)
    texts, numbers = read_rows(path, ("subject", "varied", "method", "prior"), ("factor", "value", "log_bayes_factor", "se", "pareto_k"))
    require_subjects(source, texts["subject"], draws)
    nothing = np.full((len(SUMMARISED), len(QUANTILES)), np.nan)
    rows = []
    for i, (subject, varied, method, said) in enumerate(zip(*texts.values(), strict=True)):
        given, value, *found, k = (float(values[i]) for values in numbers.values())
        factor, bayes_factor, error = (None if isnan(one) else one for one in (given, *found))
        draws.prior.declared_as(varied)
        prior = replace(draws.prior.at(draws.subject(subject)), **{varied: value})
        require_said_prior(source, said, prior.describe(), f" but for {varied}")
        rows.append(SensitivityRow(subject, varied, factor, prior, bayes_factor, error, k, method, nothing))
    table = SensitivityTable(tuple(rows), prior=draws.prior, seed=draws.seed)
    _require_middle(source, table, draws)
    return table


def _require_middle(source: str, found: SensitivityTable, draws: Draws) -> None:
    """Whether every range has the value of the draws' own prior, which conclusions are compared with."""
    values = {(row.subject, row.varied, row.value) for row in found.rows}
    for subject, varied in dict.fromkeys((row.subject, row.varied) for row in found.rows):
        given = getattr(draws.prior.at(draws.subject(subject)), varied)
        if (subject, varied, given) not in values:
            raise InputError(f"{source}: found a range of {quoted(varied)} about another prior, allowed: about that of the draws, {given}")
