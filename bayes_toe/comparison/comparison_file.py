"""compare.csv read back, beside the draws that it belongs to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.parts_table import PartTable, part_tables
from bayes_toe.data.messages import bare, quoted
from bayes_toe.data.validation import read_rows
from bayes_toe.errors import InputError
from bayes_toe.inference.belonging import require_said_prior, require_subjects
from bayes_toe.inference.draws import Draws
from bayes_toe.model.free_frequencies import FrequencyPosterior
from bayes_toe.model.ladder import Record, model_named

_NUMBERS = ("log_evidence", "log_evidence_se", "pareto_k", "p_predictive")
_DIGITS = 1e-6  # of an exact evidence, nats: the file has all digits


@dataclass(frozen=True, eq=False)
class ComparisonFile:
    """What compare.csv says of every subject under every model.

    Attributes
    ----------
    subjects : tuple of str
    records : tuple of record
    log_evidence, log_evidence_se, pareto_k, p_predictive : array, shape (subjects, models)
        Nats, nats, none, none; NaN where withheld or not there.
    """

    subjects: tuple[str, ...]
    records: tuple[Record, ...]
    log_evidence: FloatArray
    log_evidence_se: FloatArray
    pareto_k: FloatArray
    p_predictive: FloatArray

    @cached_property
    def parts(self) -> tuple[PartTable, ...]:
        """How probable every level of every part is, as compare_parts.csv has it."""
        return part_tables(self.records, self.log_evidence)

    @property
    def best(self) -> dict[str, tuple[str, float]]:
        """By subject, the composition with the highest evidence and its posterior predictive p; without subjects who have no evidence."""
        composed = np.array([bool(record.levels) for record in self.records])
        known = np.where(composed & ~np.isnan(self.log_evidence), self.log_evidence, -np.inf)
        places = known.argmax(axis=1)
        rows = zip(self.subjects, places, strict=True)
        return {
            name: (self.records[place].name, float(self.p_predictive[i, place]))
            for i, (name, place) in enumerate(rows)
            if np.isfinite(known[i, place])
        }


def read_comparison(path: str | Path, draws: Draws) -> ComparisonFile:
    """The table in the order of the draws' subjects.

    Raises
    ------
    InputError
        If the file is not such a table, or is of other subjects, answers or another prior than the draws.
    """
    source = bare(Path(path).name)
    texts, numbers = read_rows(path, ("subject", "model", "prior"), _NUMBERS)
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
    found = ComparisonFile(draws.names, records, *(numbers[name][rows] for name in _NUMBERS))
    _require_answers(found, draws, source)
    return found


def _require_answers(found: ComparisonFile, draws: Draws, source: str) -> None:
    """The evidence of free frequencies is exact, and so tells whether the answers are the same."""
    free = [place for place, record in enumerate(found.records) if not record.levels]
    for i, name in enumerate(draws.names if free else ()):
        exact = FrequencyPosterior(draws.subject(name)).log_evidence
        if not abs(found.log_evidence[i, free[0]] - exact) < _DIGITS * (1.0 + abs(exact)):
            raise InputError(f"{source}: found other answers than the draws have of {quoted(name)}, allowed: one study")
