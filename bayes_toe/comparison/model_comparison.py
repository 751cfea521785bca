"""Comparison of models: subject by subject, part by part, and over the subjects of a study.

A level of a part is a family of models, whatever their other parts are. Each level is equally probable beforehand, and within a level each
model that has it: its evidence is their average, its inclusion Bayes factor the ratio of posterior to prior odds. Where the models cross
the levels evenly, as those of the default space do, a probability is the sum of the probabilities of the models that have the level.
Source: Penny et al. 2010 (PLoS Comput. Biol. 6:e1000709), also for the study: each subject is of one family, drawn with unknown
frequencies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.special import log_expit, logit, logsumexp, softmax

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.leave_one_out import LeaveOneOut, Unit, below_best
from bayes_toe.comparison.model_row import (
    ModelRow,
    compare_one,
    compare_space,
    difference_columns,
    failed_row,
    with_differences,
)
from bayes_toe.comparison.random_effects import ModelFrequencies, random_effects
from bayes_toe.comparison.verdict import Verdict, data_doubts
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tables import Table, write_table
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.data.whole_files import whole_together
from bayes_toe.errors import InputError
from bayes_toe.inference.evidence import said_of_bound, weighed
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.kept import keeping
from bayes_toe.model.ladder import Record, model_named, require_models
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Columns of compare.csv.
COMPARE_COLUMNS = (
    *("subject", "model", "parameters", "log_evidence", "log_evidence_se", "pareto_k"),
    *(
        "elpd_loo_trial",
        "elpd_loo_trial_se",
        "elpd_loo_pair",
        "elpd_loo_pair_se",
        "model_probability",
        "p_predictive",
        "p_worst_pair",
    ),
    *(
        "note",
        "prior",
        "elpd_loo_pair_diff",
        "elpd_loo_pair_diff_se",
        "elpd_loo_trial_diff",
        "elpd_loo_trial_diff_se",
        "parts",
    ),
)
#: Columns of compare_parts.csv.
PARTS_COLUMNS = ("subject", "part", "level", "probability", "log_inclusion_bayes_factor")
#: In the place of a subject: the study, that is a new subject of its population.
STUDY = "*"
_TEXTS = ("subject", "model", "parameters", "note", "prior", "parts")
_FREQUENCIES = ("expected", "exceedance", "protected", "omnibus_risk")


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
        return [
            (who, self.part, *row)
            for who, p, b in found
            for row in zip(self.levels, p.tolist(), b.tolist(), strict=True)
        ]


def part_tables(
    models: Sequence[Record], log_evidence: npt.ArrayLike, *, seed: int = 0
) -> tuple[PartTable, ...]:
    """Probabilities of the levels of every part that varies among the compositions; free frequencies are none and do not count.

    Log evidences have the shape (subjects, models), nats, NaN where withheld; the study's frequencies are sampled.

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
    return tuple(
        _part_table(part, levels, values, seed)
        for part, levels in families.items()
        if len(levels) > 1
    )


def _part_table(
    part: str, levels: dict[str, list[int]], log_evidence: FloatArray, seed: int
) -> PartTable:
    # NaN wherever an evidence is missing: all levels would depend on it.
    values = np.where(np.isnan(log_evidence).any(axis=1, keepdims=True), np.nan, log_evidence)
    families = np.column_stack(
        [logsumexp(values[:, of], axis=1) - np.log(len(of)) for of in levels.values()]
    )
    odds = np.column_stack(
        [
            families[:, k] - logsumexp(np.delete(families, k, axis=1), axis=1)
            for k in range(len(levels))
        ]
    )
    even, known = logit(1.0 / len(levels)), _complete(families)
    study = random_effects(known, seed=seed).expected if len(known) > 1 else None
    of_study = None if study is None else np.asarray(logit(study) - even)
    return PartTable(part, tuple(levels), np.exp(log_expit(odds)), odds - even, study, of_study)


@dataclass(frozen=True, eq=False)
class ModelComparison(Table[ModelRow]):
    """Every subject under every model, subjects in the study's order, models in that of their space.

    Attributes
    ----------
    rows : tuple of ModelRow
    subjects, models : tuple of str
    seed : int
    prior : Prior
    verdicts : tuple of Verdict
        Of the subjects, where the space of them was compared.
    task : Task
        What the subjects were asked.
    """

    subjects: tuple[str, ...]
    models: tuple[str, ...]
    seed: int
    prior: Prior
    verdicts: tuple[Verdict, ...] = ()
    task: Task = SAME_DIFFERENT

    def __getitem__(self, key: tuple[str, str]) -> ModelRow:
        """The row of (subject, model)."""
        for row in self.rows:
            if (row.subject, row.model) == tuple(key):
                return row
        raise InputError(
            f"no row {key!r} in the comparison; subjects: {', '.join(self.subjects)}; models: {', '.join(self.models)}"
        )

    @property
    def log_evidence(self) -> FloatArray:
        """Shape (subjects, models), nats; NaN where withheld."""
        return self._matrix("log_evidence")

    @cached_property
    def weighed(self) -> FloatArray:
        """The same with -inf where a withheld one has no weight even by its bound, see :func:`~bayes_toe.inference.evidence.weighed`."""
        bounds = np.reshape(
            [row.bound for row in self.rows], (len(self.subjects), len(self.models))
        )
        return np.array(
            [weighed(*one) for one in zip(self.log_evidence, bounds, strict=True)]
        ).reshape(bounds.shape)

    @property
    def records(self) -> tuple[Record, ...]:
        """The models' records."""
        return tuple(model_named(name, self.task) for name in self.models)

    def frame(self) -> pd.DataFrame:
        """The table with the columns of compare.csv; natural logs, empty where a value does not exist."""
        import pandas as pd

        said = {
            record.name: {
                "prior": record.describe(self.prior),
                "parts": "; ".join(f"{part}: {level}" for part, level in record.levels),
            }
            for record in self.records
        }
        cells = [
            [
                said[row.model][key] if key in ("prior", "parts") else row.cell(key)
                for key in COMPARE_COLUMNS
            ]
            for row in self.rows
        ]
        numbers = {key: "float64" for key in COMPARE_COLUMNS if key not in _TEXTS}
        return pd.DataFrame(cells, columns=list(COMPARE_COLUMNS)).astype(numbers)

    @cached_property
    def parts(self) -> tuple[PartTable, ...]:
        """Probabilities of the levels of every part that varies among the compositions compared."""
        return part_tables(self.records, self.weighed, seed=self.seed)

    def parts_frame(self) -> pd.DataFrame:
        """The same with the columns of compare_parts.csv: one row a level, subject by subject, last the study, '*'; empty where withheld.

        The study's are those of a new subject of its population, by random effects over families of models: see
        :mod:`bayes_toe.comparison.model_comparison`. There are none with fewer than two subjects that have every evidence.
        """
        import pandas as pd

        order = {name: i for i, name in enumerate((*self.subjects, STUDY))}
        rows = [row for part in self.parts for row in part.cells(self.subjects)]
        rows.sort(key=lambda row: order[str(row[0])])  # stable: parts and levels keep their order
        return pd.DataFrame(rows, columns=list(PARTS_COLUMNS))

    def best_compositions(self) -> dict[str, tuple[ModelRow, float | None]]:
        """By subject, the composition with the highest evidence and its log Bayes factor against free frequencies, where those are there.

        Without subjects whose evidences are all withheld.
        """
        composed, evidence = (
            np.array([bool(record.levels) for record in self.records]),
            self.log_evidence,
        )
        found: dict[str, tuple[ModelRow, float | None]] = {}
        for i, (name, values) in enumerate(zip(self.subjects, evidence, strict=True)):
            known = np.where(composed & ~np.isnan(values), values, -np.inf)
            best, free = int(known.argmax()), values[~composed & ~np.isnan(values)].tolist()
            if np.isfinite(known[best]):
                found[name] = (
                    self.rows[i * len(self.models) + best],
                    float(known[best]) - free[0] if free else None,
                )
        return found

    def frequencies(self) -> ModelFrequencies | None:
        """Random-effects model frequencies over subjects with every evidence; None with fewer than two models or no such subject."""
        return self._frequencies

    @cached_property
    def _frequencies(self) -> ModelFrequencies | None:
        known = np.flatnonzero(~np.isnan(self.weighed).any(axis=1)).tolist()
        if len(self.models) < 2 or not known:
            return None
        found = random_effects(self.weighed[known], seed=self.seed)
        return replace(found, models=self.models, subjects=tuple(self.subjects[i] for i in known))

    def study_frame(self) -> pd.DataFrame:
        """One row per model over the whole study.

        Columns: model; subjects, those with every evidence, which alone count in what follows; best, for how many of them the model has
        the highest evidence; expected frequency, exceedance and protected exceedance probability, omnibus_risk, see :meth:`frequencies`;
        group_log_evidence, the sum; elpd_loo_trial and elpd_loo_pair, sums over the subjects that have a value under every model;
        expected_exact to omnibus_risk_exact, the first four again, under the names that they had beside those of the variational scheme;
        elpd_loo_trial_subjects and elpd_loo_pair_subjects, over how many subjects those sums go; elpd_loo_pair_diff to
        elpd_loo_trial_diff_se, differences of those sums to the best model's with the standard errors of the paired differences; exact_how,
        'sampled' where there are frequencies, and expected_exact_se to omnibus_risk_exact_se, Monte Carlo standard errors.
        """
        import pandas as pd

        complete, found = _complete(self.weighed), self.frequencies()
        frequencies = {
            name: np.nan if found is None else getattr(found, name) for name in _FREQUENCIES
        }
        errors = {
            name: np.nan if found is None else getattr(found, f"{name}_se")
            for name in _FREQUENCIES
            if name != "protected"
        }
        predicted = {
            f"elpd_loo_{unit}": _complete(self._matrix(f"elpd_loo_{unit}"))
            for unit in ("trial", "pair")
        }
        columns = {
            "model": self.models,
            "subjects": len(complete),
            "best": np.bincount(complete.argmax(axis=1), minlength=len(self.models))
            if len(complete)
            else 0,
            **frequencies,
            "group_log_evidence": _sum(np.where(np.isinf(complete), np.nan, complete)),
            **{name: _sum(values) for name, values in predicted.items()},
            **{f"{name}_exact": value for name, value in frequencies.items()},
            **{f"{name}_subjects": len(values) for name, values in predicted.items()},
            **self._differences("pair"),
            **self._differences("trial"),
            "exact_how": "" if found is None else "sampled",
            **{f"{name}_exact_se": value for name, value in errors.items()},
        }
        return pd.DataFrame(columns)

    def save(
        self,
        path: str | Path,
        *,
        overwrite: bool = False,
        spreadsheet_safe: bool = False,
        units: bool = False,
    ) -> Path:
        """Write compare.csv, and beside it compare_models.csv (the study) and compare_parts.csv; all of them or none."""
        files, frames = (
            (Path(path), *beside(path)),
            (self.frame(), self.study_frame(), self.parts_frame()),
        )
        with whole_together(*files, overwrite=overwrite) as folder:
            for frame, file in zip(frames, files, strict=True):
                write_table(
                    frame,
                    folder / file.name,
                    spreadsheet_safe=spreadsheet_safe,
                    units=units and "subject" in frame,
                )
        return files[0]

    def _differences(self, unit: Unit) -> dict[str, list[float]]:
        """Leave-one-out differences to the best model and their errors over the subjects with a value under every model."""
        size = len(self.models)
        subjects = [self.rows[i : i + size] for i in range(0, len(self.rows), size)]
        found = [
            [row.left_out[unit] for row in rows]
            for rows in subjects
            if all(unit in row.left_out for row in rows)
        ]
        counted = [rows for rows in found if not any(np.isnan(one.elpd) for one in rows)]
        joined = [LeaveOneOut.joined(parts) for parts in zip(*counted, strict=True)]
        pairs = below_best(joined) if joined else [(np.nan, np.nan)] * size
        return dict(zip(difference_columns(unit), map(list, zip(*pairs, strict=True)), strict=True))

    def _matrix(self, name: str) -> FloatArray:
        flat = np.array([row.cell(name) for row in self.rows], np.float64)  # None becomes NaN
        return flat.reshape(len(self.subjects), len(self.models))


def _complete(table: FloatArray) -> FloatArray:
    """The subjects with a value under every model."""
    return np.asarray(table[~np.isnan(table).any(axis=1)])


def _sum(rows: FloatArray) -> FloatArray:
    """Sum over subjects; no number where there is none of them."""
    return np.asarray(rows.sum(axis=0)) if len(rows) else np.full(rows.shape[1], np.nan)


def beside(path: str | Path) -> tuple[Path, Path]:
    """Where the tables of the study and of the parts go: compare_models.csv and compare_parts.csv beside compare.csv."""
    models, parts = (
        Path(path).with_name(f"{Path(path).stem}_{what}{Path(path).suffix}")
        for what in ("models", "parts")
    )
    return models, parts


def compare(
    study: Study,
    models: str | Sequence[str | Record] = "parts",
    *,
    draws: int = 1000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
    keep: str | Path | None = None,
) -> ModelComparison:
    """Evidence, leave-one-out and predictive checks of every model for every subject, and model frequencies over the study.

    Parameters
    ----------
    study : Study
        With intervals (column isi), models with a memory say how they act, and the others answer a pair alike at every one: the note of
        their rows says so. Free frequencies have one for each pair at each interval.
    models : str or sequence of str or record
        Models by name or composition; or the name of a space: "parts", the 48 compositions of order, noise, lapses, curve and peak over
        which verdicts average, or "ladder", the models that have a name. Of the 48 those that are far behind have Laplace's evidence alone.
    draws : int
        Effective draws to reach for every named quantity of every model.
    seed, prior, workers, progress, keep
        As in :func:`bayes_toe.analysis.evidence`; the prior's scales hold for every model. Progress is told 'subject: model'.

    Raises
    ------
    InputError
        If a model, the seed or a number is not allowed.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> table = compare(Study([one]), ["free frequencies", "symmetric"], seed=1, workers=1)
    >>> table["S01", "symmetric"].parameters, round(sum(row.model_probability for row in table), 12)
    (2, 1.0)
    """
    require_study(study)
    records, chosen = require_models(models, study.task), prior_for(study, prior)
    SamplerSettings(draws=draws)  # refuses a bad number before any work
    whole = models == "parts"
    of = [
        (subject, some)
        for subject in study
        for some in ([records] if whole else [(model,) for model in records])
    ]
    names = [
        (subject.name if whole else f"{subject.name}: {some[0].name}",) for subject, some in of
    ]
    with keeping(keep, "models of subjects") as kept:
        common: dict[str, Any] = {
            "draws": draws,
            "seed": (root := kept.seed(seed)),
            "prior": chosen,
        }
        jobs: list[Callable[[], tuple[Sequence[ModelRow], Verdict | None]]] = (
            [
                partial(compare_space, subject, data=data, **common)
                for subject, data in zip(study, data_doubts(study), strict=True)
            ]
            if whole
            else [partial(_alone, subject, some[0], **common) for subject, some in of]
        )
        done = kept.work(jobs, workers, progress, names)
        found = [
            (
                [
                    failed_row(subject, model, done.failed[at].reason, prior=chosen)
                    for model in some
                ],
                None,
            )
            if at in done.failed
            else done.read(at)
            for at, (subject, some) in enumerate(of)
        ]
    rows, size = [row for some, _ in found for row in some], len(records)
    groups = [rows[i : i + size] for i in range(0, len(rows), size)]
    table = tuple(row for group in groups for row in with_probabilities(with_differences(group)))
    said = tuple(said for _, said in found if said)
    return ModelComparison(
        table,
        tuple(study.names),
        tuple(model.name for model in records),
        root,
        chosen,
        said,
        study.task,
    )


def _alone(
    subject: Subject, model: Record, *, draws: int, seed: int, prior: Prior
) -> tuple[Sequence[ModelRow], None]:
    return [compare_one(subject, model, draws=draws, seed=seed, prior=prior)], None


def with_probabilities(rows: Sequence[ModelRow]) -> list[ModelRow]:
    """Model probabilities of one subject; none where an evidence is missing that may count, because they would depend on it."""
    values = weighed([row.log_evidence for row in rows], [row.bound for row in rows])
    if np.isnan(values).any():
        missing = [row.model for row, value in zip(rows, values, strict=True) if np.isnan(value)]
        note = f"no model probability: no evidence of {', '.join(missing)}"
        return [replace(row, notes=(*row.notes, note)) for row in rows]
    said = [
        () if row.log_evidence is not None else (said_of_bound(row.bound, values),) for row in rows
    ]
    return [
        replace(row, model_probability=float(share), notes=(*row.notes, *more))
        for row, share, more in zip(rows, softmax(values), said, strict=True)
    ]
