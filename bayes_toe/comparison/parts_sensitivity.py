"""How the probabilities of parts depend on the prior: one value of it varied at a time, for every model of a space.

Draws of one proposal a model are re-used under every prior (:mod:`bayes_toe.comparison.reweighting`), so a scan costs little more than the
comparison itself. A value that a model does not use leaves its evidence alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.model_comparison import STUDY, part_tables
from bayes_toe.comparison.prior_sensitivity import moved
from bayes_toe.comparison.reweighting import RESAMPLED, reweighted, under
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tables import Table, frame_of
from bayes_toe.errors import InputError
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Wanted, fitted_result
from bayes_toe.model.ladder import Record, require_models
from bayes_toe.model.posterior import Model
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_fields import PriorField
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import root_seed
from bayes_toe.workers import Progress, Workers, run_in_order

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = ("subject", "varied", "factor", "value", "part", "level", "probability", "pareto_k", "sampled_anew")


@dataclass(frozen=True)
class PartsRow:
    """One level of a part for one subject under one prior.

    Attributes
    ----------
    subject : str
        '*' is the study, by random effects over families of models.
    varied : str
        The number of the prior that differs from the one given, by its name.
    factor : float or None
        By which a scale or shape is multiplied; None where a location is varied.
    value : float
        The varied value.
    part, level : str
    probability : float or None
        None where the evidence of some model is withheld.
    pareto_k : float
        The largest over the models.
    sampled_anew : int
        How many of the models needed draws under that prior.
    """

    subject: str
    varied: str
    factor: float | None
    value: float
    part: str
    level: str
    probability: float | None
    pareto_k: float
    sampled_anew: int


class _Scanned(NamedTuple):
    """Of a subject: log evidences, (priors, models), NaN where withheld; largest k-hat, and models sampled anew, (priors,) each."""

    log_evidence: FloatArray
    pareto_k: FloatArray
    sampled_anew: FloatArray


@dataclass(frozen=True, eq=False)
class PartsSensitivity(Table[PartsRow]):
    """Rows of every subject, then of the study; within one a value of the prior after the other."""

    prior: Prior
    seed: int

    def frame(self) -> pd.DataFrame:
        """The table with the columns of sensitivity_parts.csv."""
        return frame_of(self.rows, COLUMNS).astype({"factor": "float64", "probability": "float64"})

    def of(self, subject: str, varied: str, part: str) -> dict[str, list[PartsRow]]:
        """Rows of one subject, varied value and part, ascending, by level."""
        return self._grouped.get((subject, varied, part), {})

    @cached_property
    def _grouped(self) -> dict[tuple[str, str, str], dict[str, list[PartsRow]]]:
        found: dict[tuple[str, str, str], dict[str, list[PartsRow]]] = {}
        for row in self.rows:
            found.setdefault((row.subject, row.varied, row.part), {}).setdefault(row.level, []).append(row)
        return found

    @property
    def subjects(self) -> tuple[str, ...]:
        """Subjects, '*' last where there is one."""
        return tuple(dict.fromkeys(row.subject for row in self.rows))

    @property
    def varied(self) -> tuple[str, ...]:
        """What is varied."""
        return tuple(dict.fromkeys(row.varied for row in self.rows))

    def turns(self, subject: str, part: str = "order") -> bool:
        """Whether its most probable level is another one under some of the priors."""
        return len(_conclusion(self, subject, part)) > 1

    def summary(self, part: str = "order") -> tuple[str, ...]:
        """One line a subject: its most probable level under the prior given, and where another one takes over."""
        said = (_conclusion(self, subject, part) for subject in self.subjects)
        return tuple("; ".join(words if len(words) > 1 else [f"{words[0]}, at every value"]) for words in said)


def parts_sensitivity(
    study: Study,
    models: str | Sequence[str | Record] = "parts",
    *,
    prior: Prior | str | None = None,
    factors: Sequence[float] = (0.25, 0.5, 1.0, 2.0, 4.0),
    seed: int | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> PartsSensitivity:
    """Probabilities of the levels of parts, of every subject and of the study, under priors around the one given.

    Parameters
    ----------
    study : Study
    models : str or sequence of str or record
        As :func:`bayes_toe.comparison.model_comparison.compare` takes them.
    prior : Prior, optional
        The middle of the range; varied is every number of it that some model uses.
    factors : sequence of float
        By which scales and shapes are multiplied, ascending, 1 among them. Locations are shifted in proportion to the factor's logarithm,
        by one prior standard deviation of their parameter at the last.
    seed, workers, progress
        As in :func:`bayes_toe.comparison.prior_sensitivity.sensitivity`.

    Raises
    ------
    InputError
        If the factors are not such, or a model is unknown.

    Examples
    --------
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> table = parts_sensitivity(Study([one]), ["none", "none + sloped"], factors=(0.5, 1.0, 2.0), seed=1, workers=1)
    >>> table.varied, [row.level for row in table.rows[:2]]
    (('sigma_p_scale', 'noise_slope_sd'), ['Weber', 'sloped'])
    """
    reach = _require_factors(factors)
    root, middle = root_seed(seed), prior_for(study, prior)
    records = [model for model in require_models(models) if isinstance(model, Model)]
    used = frozenset(name for model in records for name in model.parameters(middle))
    varied = [one for one in middle.varied(used) if getattr(middle, one.name) is not None]
    powers = (np.log(factors) / np.log(reach)).tolist()
    settings = [_Setting(one, reach**by if one.positive else None, moved(middle, one, by, reach)) for one in varied for by in powers]
    jobs = [partial(_scan, subject, records, middle, settings, root) for subject in study]
    scanned = run_in_order(jobs, workers, progress, [(name,) for name in study.names])
    rows = [row for i, at in enumerate(settings) for row in _rows(study.names, scanned, i, records, at)]
    order = {name: place for place, name in enumerate((*study.names, STUDY))}
    return PartsSensitivity(tuple(sorted(rows, key=lambda row: order[row.subject])), middle, root)


def _require_factors(factors: Sequence[float]) -> float:
    """The largest of them."""
    if len(factors) < 2 or not factors[0] > 0.0 or not all(a < b for a, b in pairwise(factors)) or 1.0 not in factors or factors[-1] == 1.0:
        raise InputError(f"factors={tuple(factors)}: allowed are positive numbers in ascending order, with 1 and larger ones among them")
    return float(factors[-1])


class _Setting(NamedTuple):
    """One prior of the scan: what is varied, by which factor, None for a location."""

    varied: PriorField
    factor: float | None
    prior: Prior


def _scan(subject: Subject, records: Sequence[Model], middle: Prior, settings: Sequence[_Setting], seed: int) -> _Scanned:
    values, k, anew = (np.zeros((len(settings), len(records))) for _ in range(3))
    for j, model in enumerate(records):
        posterior, used = model.posterior(subject, middle), model.parameters(middle)
        fitted = fitted_result(posterior, seed, Wanted(evidence_draws=EVIDENCE_DRAWS))[1].proposal
        own = reweighted(fitted, posterior, posterior)
        for i, (varied, _, prior) in enumerate(settings):
            same = varied.parameter not in used or prior == middle
            found = own if same else under(fitted, posterior, model.posterior(subject, prior), seed)
            values[i, j] = found.log_evidence if found.trusted else np.nan
            k[i, j], anew[i, j] = found.pareto_k, found.method == RESAMPLED
    return _Scanned(values, k.max(axis=1), anew.sum(axis=1))


def _rows(names: Sequence[str], scanned: Sequence[_Scanned], i: int, records: Sequence[Model], at: _Setting) -> list[PartsRow]:
    """Every subject and the study under the i-th prior."""
    largest, anew = [float(one.pareto_k[i]) for one in scanned], [int(one.sampled_anew[i]) for one in scanned]
    quality = dict(zip(names, zip(largest, anew, strict=True), strict=True)) | {STUDY: (max(largest), sum(anew))}
    said = at.varied.name, at.factor, float(getattr(at.prior, at.varied.name))
    tables = part_tables(records, np.stack([one.log_evidence[i] for one in scanned]))
    cells = cast("list[tuple[str, str, str, float, float]]", [row for table in tables for row in table.cells(names)])
    return [
        PartsRow(subject, *said, part, level, None if np.isnan(probability) else probability, *quality[subject])
        for subject, part, level, probability, _ in cells
    ]


class _Top(NamedTuple):
    """The most probable level under one prior, in words with its probability, and the varied value."""

    level: str
    words: str
    value: float


def _conclusion(table: PartsSensitivity, subject: str, part: str) -> list[str]:
    """What is most probable under the prior given, then under which values of which number another level is."""
    said: list[str] = []
    for varied in table.varied:
        tops = [_top(each) for each in zip(*table.of(subject, varied, part).values(), strict=True)]
        given = next(top for top in tops if top.value == getattr(table.prior, varied))
        said = said or [f"{'study' if subject == STUDY else subject}: {given.words}"]
        said += [f"{top.words} at {varied} = {top.value:.3g}" for top in tops if top.level != given.level]
    return said


def _top(rows: Sequence[PartsRow]) -> _Top:
    if any(row.probability is None for row in rows):
        return _Top("", "no estimate", rows[0].value)
    best = max(rows, key=lambda row: row.probability or 0.0)
    return _Top(best.level, f"{best.level} ({best.probability:.2f})", best.value)
