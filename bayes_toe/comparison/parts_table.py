"""What a comparison of compositions says of their parts: which level each part has, whatever the other parts are.

A level is a family of models. Each level of a part is equally probable beforehand, and within a level each model that has it: its evidence
is their average, its inclusion Bayes factor the ratio of posterior to prior odds. Where the models cross the levels evenly, as those of the
default space do, a probability is the sum of the probabilities of the models that have the level. Source: Penny et al. 2010 (PLoS
Comput. Biol. 6:e1000709), also for the study: each subject is of one family, drawn with unknown frequencies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import log_expit, logit, logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.random_effects import random_effects
from bayes_toe.model.ladder import Record

#: Columns of compare_parts.csv.
PARTS_COLUMNS = ("subject", "part", "level", "probability", "log_inclusion_bayes_factor")
#: In the place of a subject: the study, that is a new subject of its population.
STUDY = "*"


@dataclass(frozen=True, eq=False)
class PartTable:
    """The levels of one part; NaN where an evidence of the subject is withheld.

    Attributes
    ----------
    part : str
    levels : tuple of str
        Those that some compared composition has, in the order of the models.
    probability : array, shape (subjects, levels)
    log_inclusion : array, shape (subjects, levels)
        Log inclusion Bayes factors, nats.
    study, study_log_inclusion : array, shape (levels,), or None
        The same of a new subject, by random effects over the subjects whose evidences are all there; None with fewer than two of them.
    """

    part: str
    levels: tuple[str, ...]
    probability: FloatArray
    log_inclusion: FloatArray
    study: FloatArray | None
    study_log_inclusion: FloatArray | None

    @property
    def counted(self) -> int:
        """Subjects whose evidences are all there."""
        return int((~np.isnan(self.probability).any(axis=1)).sum())

    def cells(self, subjects: Sequence[str]) -> list[tuple[object, ...]]:
        """Rows of compare_parts.csv, subject by subject, the study last where there is one."""
        found = [*zip(subjects, self.probability, self.log_inclusion, strict=True)]
        if self.study is not None and self.study_log_inclusion is not None:
            found.append((STUDY, self.study, self.study_log_inclusion))
        return [(who, self.part, *row) for who, p, b in found for row in zip(self.levels, p.tolist(), b.tolist(), strict=True)]


def part_tables(models: Sequence[Record], log_evidence: npt.ArrayLike, *, seed: int = 0) -> tuple[PartTable, ...]:
    """Probabilities of the levels of every part that varies among the compositions; free frequencies are none and do not count.

    Parameters
    ----------
    models : sequence of record
    log_evidence : array_like, shape (subjects, models)
        Nats; NaN where withheld.
    seed : int
        Of the study's frequencies, which are sampled.

    Examples
    --------
    >>> from bayes_toe.model.parts import compositions
    >>> models = compositions(order=("none", "update"), noise=("Weber", "sloped"))
    >>> order, noise = part_tables(models, np.log([[0.1, 0.2, 0.3, 0.4]]))
    >>> order.levels, order.probability.round(3).tolist(), np.exp(noise.log_inclusion).round(3).tolist()
    (('none', 'update'), [[0.3, 0.7]], [[0.667, 1.5]])
    """
    composed = [i for i, model in enumerate(models) if model.levels]
    families: dict[str, dict[str, list[int]]] = {}
    for place, i in enumerate(composed):
        for part, level in models[i].levels:
            families.setdefault(part, {}).setdefault(level, []).append(place)
    values = np.asarray(log_evidence, np.float64)[:, composed]
    return tuple(_part_table(part, levels, values, seed) for part, levels in families.items() if len(levels) > 1)


def _part_table(part: str, levels: dict[str, list[int]], log_evidence: FloatArray, seed: int) -> PartTable:
    # NaN wherever an evidence is missing: all levels would depend on it.
    values = np.where(np.isnan(log_evidence).any(axis=1, keepdims=True), np.nan, log_evidence)
    families = np.column_stack([logsumexp(values[:, of], axis=1) - np.log(len(of)) for of in levels.values()])
    odds = np.column_stack([families[:, k] - logsumexp(np.delete(families, k, axis=1), axis=1) for k in range(len(levels))])
    even, known = logit(1.0 / len(levels)), families[~np.isnan(families).any(axis=1)]
    study = random_effects(known, seed=seed).expected if len(known) > 1 else None
    of_study = None if study is None else np.asarray(logit(study) - even)
    return PartTable(part, tuple(levels), np.exp(log_expit(odds)), odds - even, study, of_study)
