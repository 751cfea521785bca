"""The steps of a study in a few lines of Python: sample, evidence, or both at once."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

from bayes_toe.analysis import Settings, SubjectResult, analyse
from bayes_toe.classical.fit_table import REPLICATES, FitTable
from bayes_toe.comparison.evidence_table import EvidenceTable
from bayes_toe.data.study import Study
from bayes_toe.errors import ConvergenceWarning
from bayes_toe.inference.draws import Draws, build_draws
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import root_seed
from bayes_toe.workers import Progress

_LEVEL = 0.9  # of the bootstrap intervals beside the posterior's 5 and 95 %


@dataclass(frozen=True, eq=False)
class Analysis:
    """Draws and evidence of one study, from the same fitted proposals, with the settings that made them, and the paper's fits."""

    study: Study
    draws: Draws
    evidence: EvidenceTable
    settings: Settings
    fits: FitTable


def settings_for(*, draws: int = 4000, seed: int | None = None, prior: Prior | None = None) -> Settings:
    """Settings from the few that users change; without a seed, fresh entropy that is stored with the results."""
    return Settings(root_seed(seed), Prior() if prior is None else prior, SamplerSettings(draws=draws))


def run(study: Study, settings: Settings, *, workers: int | None = None, progress: Progress | None = None) -> Analysis:
    """Sample every subject and compute every evidence in one pass.

    Parameters
    ----------
    study : Study
    settings : Settings
        See :func:`settings_for`.
    workers : int, optional
        Processes; by default one per processor. The numbers do not depend on it.
    progress : callable, optional
        Called with a subject's name when that subject is done.
    """
    results = analyse(study, settings, workers=workers, progress=progress)
    fits = FitTable(tuple(r.fit for r in results if r.fit is not None), _LEVEL, REPLICATES, settings.seed, settings.prior)
    return Analysis(study, build_draws(study, results, settings), _table(results, settings), settings, fits)


def draw(study: Study, settings: Settings, *, workers: int | None = None, progress: Progress | None = None) -> Draws:
    """Sample every subject, without the evidence; arguments as in :func:`run`."""
    results = analyse(study, settings, with_evidence=False, workers=workers, progress=progress)
    return build_draws(study, results, settings)


def sample(
    study: Study,
    *,
    draws: int = 4000,
    seed: int | None = None,
    prior: Prior | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Draws:
    """Posterior draws of every subject.

    Parameters
    ----------
    study : Study
    draws : int
        Bulk and tail effective draws to reach for every parameter of every subject.
    seed, prior, workers, progress
        As in :func:`run` and :func:`settings_for`.

    Warns
    -----
    ConvergenceWarning
        For subjects that missed the criteria; they are marked in the result as well.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> draws = sample(Study([one]), draws=500, seed=1, workers=1)
    >>> draws.values("S01", "gain").shape
    (4, 1024)
    """
    result = draw(study, settings_for(draws=draws, seed=seed, prior=prior), workers=workers, progress=progress)
    for name, shortfall in result.not_converged.items():
        warnings.warn(f"subject {name!r} did not converge: {shortfall}", ConvergenceWarning, stacklevel=2)
    return result


def evidence(
    study: Study,
    *,
    seed: int | None = None,
    prior: Prior | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> EvidenceTable:
    """Log evidence of the predictive-update model (H1) and of free frequencies (H0) for every subject.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> evidence(Study([one]), seed=1, workers=1)["S01"].log_evidence_h1_se < 0.02
    True
    """
    settings = settings_for(seed=seed, prior=prior)
    results = analyse(study, settings, with_chains=False, workers=workers, progress=progress)
    return _table(results, settings)


def _table(results: Sequence[SubjectResult], settings: Settings) -> EvidenceTable:
    return EvidenceTable(tuple(r.evidence for r in results if r.evidence is not None), settings.seed, settings.prior)
