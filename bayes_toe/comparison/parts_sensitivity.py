"""How the probabilities of parts depend on the prior: one value of it varied at a time, for every model of a space.

Draws of one proposal a model are re-used under every prior (:mod:`bayes_toe.comparison.reweighting`), so a scan costs little more than the
comparison itself. A value that a model does not use leaves its evidence alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.parts_table import STUDY, part_tables
from bayes_toe.comparison.prior_sensitivity import moved
from bayes_toe.comparison.reweighting import RESAMPLED, reweighted, under
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tables import Table
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
        import pandas as pd

        frame = pd.DataFrame([[getattr(row, name) for name in COLUMNS] for row in self.rows], columns=list(COLUMNS))
        return frame.astype({"factor": "float64", "probability": "float64"})

    def of(self, subject: str, varied: str, part: str) -> dict[str, list[PartsRow]]:
        """Rows of one subject, varied value and part, ascending, by level."""
        found = [row for row in self.rows if (row.subject, row.varied, row.part) == (subject, varied, part)]
        return {level: [row for row in found if row.level == level] for level in dict.fromkeys(row.level for row in found)}

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
        return "; " in _line(self, subject, part)

    def summary(self, part: str = "order") -> tuple[str, ...]:
        """One line a subject: its most probable level under the prior given, and where another one takes over."""
        return tuple(_line(self, subject, part) for subject in self.subjects)


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
        As :func:`bayes_toe.comparison.ladder_table.compare` takes them.
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
    priors = [(one, power, moved(middle, one, power, reach)) for one in varied for power in (np.log(factors) / np.log(reach)).tolist()]
    jobs = [partial(_scan, subject, records, middle, [(one, there) for one, _, there in priors], root) for subject in study]
    scanned = run_in_order(jobs, workers, progress, [(name,) for name in study.names])
    rows = [
        row
        for i, (one, power, there) in enumerate(priors)
        for row in _rows(study.names, scanned, i, records, _Setting(one, power, there, reach))
    ]
    order = {name: place for place, name in enumerate((*study.names, STUDY))}
    return PartsSensitivity(tuple(sorted(rows, key=lambda row: order[row.subject])), middle, root)


def _require_factors(factors: Sequence[float]) -> float:
    """The largest of them."""
    if len(factors) < 2 or not factors[0] > 0.0 or not all(a < b for a, b in pairwise(factors)) or 1.0 not in factors or factors[-1] == 1.0:
        raise InputError(f"factors={tuple(factors)}: allowed are positive numbers in ascending order, with 1 and larger ones among them")
    return float(factors[-1])


class _Setting(NamedTuple):
    """One prior of the scan: what is varied, by which power of the reach."""

    varied: PriorField
    power: float
    prior: Prior
    reach: float

    @property
    def said(self) -> tuple[str, float | None, float]:
        """Name, factor and value, as a row has them."""
        factor = self.reach**self.power if self.varied.positive else None
        return self.varied.name, factor, float(getattr(self.prior, self.varied.name))


def _scan(subject: Subject, records: Sequence[Model], middle: Prior, priors: Sequence[tuple[PriorField, Prior]], seed: int) -> _Scanned:
    values, k, anew = (np.zeros((len(priors), len(records))) for _ in range(3))
    for j, model in enumerate(records):
        posterior, used = model.posterior(subject, middle), model.parameters(middle)
        fitted = fitted_result(posterior, seed, Wanted(evidence_draws=EVIDENCE_DRAWS))[1].proposal
        own = reweighted(fitted, posterior, posterior)
        for i, (varied, prior) in enumerate(priors):
            same = varied.parameter not in used or prior == middle
            found = own if same else under(fitted, posterior, model.posterior(subject, prior), seed)
            values[i, j] = found.log_evidence if found.trusted else np.nan
            k[i, j], anew[i, j] = found.pareto_k, found.method == RESAMPLED
    return _Scanned(values, k.max(axis=1), anew.sum(axis=1))


def _rows(names: Sequence[str], scanned: Sequence[_Scanned], i: int, records: Sequence[Model], at: _Setting) -> list[PartsRow]:
    """Every subject and the study under the i-th prior."""
    largest, anew = [float(one.pareto_k[i]) for one in scanned], [int(one.sampled_anew[i]) for one in scanned]
    quality = dict(zip(names, zip(largest, anew, strict=True), strict=True)) | {STUDY: (max(largest), sum(anew))}
    tables = part_tables(records, np.stack([one.log_evidence[i] for one in scanned]))
    cells = cast("list[tuple[str, str, str, float, float]]", [row for table in tables for row in table.cells(names)])
    return [
        PartsRow(subject, *at.said, part, level, None if np.isnan(probability) else probability, *quality[subject])
        for subject, part, level, probability, _ in cells
    ]


def _line(table: PartsSensitivity, subject: str, part: str) -> str:
    """What is most probable under the prior given, and under which value of which number another level is."""
    start, turns = "", []
    for varied in table.varied:
        rows = table.of(subject, varied, part)
        tops = [_top(each) for each in zip(*rows.values(), strict=True)]
        values = [row.value for row in next(iter(rows.values()))]
        given = tops[values.index(float(getattr(table.prior, varied)))]
        start = start or f"{'study' if subject == STUDY else subject}: {given}"
        name = given.partition(" (")[0]
        turns += [f"{top} at {varied} = {value:.3g}" for top, value in zip(tops, values, strict=True) if top.partition(" (")[0] != name]
    return "; ".join([start, *turns]) if turns else f"{start}, at every value"


def _top(rows: Sequence[PartsRow]) -> str:
    """The most probable level with its probability."""
    if any(row.probability is None for row in rows):
        return "no estimate"
    best = max(rows, key=lambda row: row.probability or 0.0)
    return f"{best.level} ({best.probability:.2f})"
