"""Comparison of models: subject by subject, and over the subjects of a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import softmax

from bayes_toe.arrays import FloatArray
from bayes_toe.comparison.leave_one_out import LeaveOneOut, Unit, below_best
from bayes_toe.comparison.model_row import ModelRow, compare_one, difference_columns, failed_row, with_differences
from bayes_toe.comparison.parts_table import PARTS_COLUMNS, PartTable, part_tables
from bayes_toe.comparison.random_effects import ModelFrequencies, random_effects
from bayes_toe.data.study import Study
from bayes_toe.data.tables import Table, write_table
from bayes_toe.data.whole_files import whole_together
from bayes_toe.errors import InputError
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.kept import keeping
from bayes_toe.model.ladder import Record, model_named, require_models
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.workers import Cluster, Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Columns of compare.csv.
COMPARE_COLUMNS = (
    "subject",
    "model",
    "parameters",
    "log_evidence",
    "log_evidence_se",
    "pareto_k",
    "elpd_loo_trial",
    "elpd_loo_trial_se",
    "elpd_loo_pair",
    "elpd_loo_pair_se",
    "model_probability",
    "p_predictive",
    "p_worst_pair",
    "note",
    "prior",
    "elpd_loo_pair_diff",
    "elpd_loo_pair_diff_se",
    "elpd_loo_trial_diff",
    "elpd_loo_trial_diff_se",
    "parts",
)
_TEXTS = ("subject", "model", "parameters", "note", "prior", "parts")
_FREQUENCY_COLUMNS = ("expected", "exceedance", "protected", "omnibus_risk")
_ERROR_COLUMNS = ("expected", "exceedance", "omnibus_risk")
_SUMMED = ("elpd_loo_trial", "elpd_loo_pair")


@dataclass(frozen=True, eq=False)
class ModelComparison(Table[ModelRow]):
    """Every subject under every model, subjects in the study's order, models in that of their space.

    Attributes
    ----------
    rows : tuple of ModelRow
    subjects, models : tuple of str
    seed : int
    prior : Prior
    """

    subjects: tuple[str, ...]
    models: tuple[str, ...]
    seed: int
    prior: Prior

    def __getitem__(self, key: tuple[str, str]) -> ModelRow:
        """The row of (subject, model)."""
        for row in self.rows:
            if (row.subject, row.model) == tuple(key):
                return row
        raise InputError(f"no row {key!r} in the comparison; subjects: {', '.join(self.subjects)}; models: {', '.join(self.models)}")

    @property
    def log_evidence(self) -> FloatArray:
        """Shape (subjects, models), nats; NaN where withheld."""
        return self._matrix("log_evidence")

    def frame(self) -> pd.DataFrame:
        """The table with the columns of compare.csv; natural logs, empty where a value does not exist."""
        import pandas as pd

        records = dict(zip(self.models, self.records, strict=True))
        said = {name: {"prior": record.describe(self.prior), "parts": _composed(record)} for name, record in records.items()}
        cells = [[said[row.model][key] if key in ("prior", "parts") else row.cell(key) for key in COMPARE_COLUMNS] for row in self.rows]
        numbers = {key: "float64" for key in COMPARE_COLUMNS if key not in _TEXTS}
        return pd.DataFrame(cells, columns=list(COMPARE_COLUMNS)).astype(numbers)

    @property
    def records(self) -> tuple[Record, ...]:
        """The models' records."""
        return tuple(map(model_named, self.models))

    @cached_property
    def parts(self) -> tuple[PartTable, ...]:
        """Probabilities of the levels of every part that varies among the compositions compared."""
        return part_tables(self.records, self.log_evidence, seed=self.seed)

    def parts_frame(self) -> pd.DataFrame:
        """The same with the columns of compare_parts.csv: one row a level, subject by subject, last the study, '*'; empty where withheld.

        The study's are those of a new subject of its population, by random effects over families of models: see
        :mod:`bayes_toe.comparison.parts_table`. There are none with fewer than two subjects that have every evidence.
        """
        import pandas as pd

        order = {name: i for i, name in enumerate(self.subjects)}
        rows = [row for part in self.parts for row in part.cells(self.subjects)]
        rows.sort(key=lambda row: order.get(str(row[0]), len(order)))  # stable: parts and levels keep their order
        return pd.DataFrame(rows, columns=list(PARTS_COLUMNS))

    def best_compositions(self) -> dict[str, tuple[ModelRow, float | None]]:
        """By subject, the composition with the highest evidence and its log Bayes factor against free frequencies, where those are there.

        Without subjects whose evidences are all withheld.
        """
        composed, evidence = np.array([bool(record.levels) for record in self.records]), self.log_evidence
        found: dict[str, tuple[ModelRow, float | None]] = {}
        for i, (name, values) in enumerate(zip(self.subjects, evidence, strict=True)):
            known = np.where(composed & ~np.isnan(values), values, -np.inf)
            best, free = int(known.argmax()), values[~composed & ~np.isnan(values)].tolist()
            if np.isfinite(known[best]):
                found[name] = self.rows[i * len(self.models) + best], float(known[best]) - free[0] if free else None
        return found

    def frequencies(self) -> ModelFrequencies | None:
        """Random-effects model frequencies over subjects with every evidence; None with fewer than two models or no such subject."""
        return self._frequencies

    @cached_property
    def _frequencies(self) -> ModelFrequencies | None:
        if len(self.models) < 2 or not len(_complete(self.log_evidence)):
            return None
        return random_effects(self.log_evidence, models=self.models, subjects=self.subjects, leave_out=True, seed=self.seed)

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

        complete = _complete(self.log_evidence)
        best = np.bincount(complete.argmax(axis=1), minlength=len(self.models)) if len(complete) else np.zeros(len(self.models), int)
        frame = pd.DataFrame({"model": self.models, "subjects": len(complete), "best": best})
        frame = _with_frequencies(frame, self.frequencies(), "")
        frame["group_log_evidence"] = _sum(complete)
        predicted = {name: _complete(self._matrix(name)) for name in _SUMMED}
        for name, values in predicted.items():
            frame[name] = _sum(values)
        frame = _with_frequencies(frame, self.frequencies(), "_exact")
        frame = frame.assign(**{f"{name}_subjects": len(values) for name, values in predicted.items()})
        frame = frame.assign(**{name: values for unit in ("pair", "trial") for name, values in self._differences(unit).items()})
        found = self.frequencies()
        errors = {f"{name}_exact_se": np.nan if found is None else getattr(found, f"{name}_se") for name in _ERROR_COLUMNS}
        return frame.assign(exact_how="" if found is None else "sampled", **errors)

    def save(self, path: str | Path, *, overwrite: bool = False, spreadsheet_safe: bool = False) -> Path:
        """Write compare.csv, and beside it compare_models.csv (the study) and compare_parts.csv; all of them or none."""
        files, frames = (Path(path), *beside(path)), (self.frame(), self.study_frame(), self.parts_frame())
        with whole_together(*files, overwrite=overwrite) as folder:
            for frame, file in zip(frames, files, strict=True):
                write_table(frame, folder / file.name, spreadsheet_safe=spreadsheet_safe)
        return files[0]

    def _differences(self, unit: Unit) -> dict[str, list[float]]:
        """Leave-one-out differences to the best model and their errors over the subjects with a value under every model."""
        size = len(self.models)
        subjects = [self.rows[i : i + size] for i in range(0, len(self.rows), size)]
        found = [[row.left_out[unit] for row in rows] for rows in subjects if all(unit in row.left_out for row in rows)]
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


def _with_frequencies(frame: pd.DataFrame, found: ModelFrequencies | None, suffix: str) -> pd.DataFrame:
    values = {f"{name}{suffix}": np.nan if found is None else getattr(found, name) for name in _FREQUENCY_COLUMNS}
    return frame.assign(**values)


def beside(path: str | Path) -> tuple[Path, Path]:
    """Where the tables of the study and of the parts go: compare_models.csv and compare_parts.csv beside compare.csv."""
    models, parts = (Path(path).with_name(f"{Path(path).stem}_{what}{Path(path).suffix}") for what in ("models", "parts"))
    return models, parts


def _composed(model: Record) -> str:
    """The level of every part; nothing for free frequencies, which have none."""
    return "; ".join(f"{part}: {level}" for part, level in model.levels)


def compare(
    study: Study,
    models: str | Sequence[str | Record] = "parts",
    *,
    draws: int = 1000,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    engine: Cluster | None = None,
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
        Models by name or composition; or the name of a space: "parts", every composition of order, noise and lapses, or "ladder", the
        models that have a name.
    draws : int
        Effective draws to reach for every named quantity of every model.
    seed, prior, workers, engine, progress, keep
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
    records, chosen = require_models(models), prior_for(study, prior)
    SamplerSettings(draws=draws)  # refuses a bad number before any work
    pairs = [(subject, model) for subject in study for model in records]
    names = [(f"{subject.name}: {model.name}",) for subject, model in pairs]
    with keeping(keep, "models of subjects") as kept:
        root = kept.seed(seed)
        jobs = [partial(compare_one, *pair, draws=draws, seed=root, prior=chosen) for pair in pairs]
        done = kept.work(jobs, workers if engine is None else engine, progress, names)
        lost = {at: failed_row(*pairs[at], one.reason, prior=chosen) for at, one in done.failed.items()}
        rows = [lost[at] if at in lost else done.read(at) for at in range(len(pairs))]
    size = len(records)
    groups = [_with_probabilities(with_differences(rows[i : i + size])) for i in range(0, len(rows), size)]
    table = tuple(row for group in groups for row in group)
    return ModelComparison(table, tuple(study.names), tuple(model.name for model in records), root, chosen)


def _with_probabilities(rows: list[ModelRow]) -> list[ModelRow]:
    """Model probabilities of one subject; none where an evidence is missing, because they would depend on it."""
    missing = [row.model for row in rows if row.log_evidence is None]
    if missing:
        note = f"no model probability: no evidence of {', '.join(missing)}"
        return [replace(row, notes=(*row.notes, note)) for row in rows]
    shares = softmax(np.array([row.log_evidence for row in rows], np.float64))
    return [replace(row, model_probability=float(share)) for row, share in zip(rows, shares, strict=True)]
