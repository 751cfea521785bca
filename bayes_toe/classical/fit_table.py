"""The fit table of a study: maximum-likelihood parameters of every subject with percentile bootstrap intervals, beside the posterior's."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.classical.bootstrap import Bootstrap, bootstrap_subject, require_level
from bayes_toe.classical.maximum_likelihood import Fits, fit_subject
from bayes_toe.data.study import Study, Subject, refuse_intervals, require_study
from bayes_toe.data.tables import SubjectTable
from bayes_toe.errors import InputError
from bayes_toe.model.coordinates import NATURAL
from bayes_toe.model.prior import Prior
from bayes_toe.model.study_prior import prior_for
from bayes_toe.seeds import root_seed
from bayes_toe.workers import Progress, Workers, run_in_order

if TYPE_CHECKING:
    import pandas as pd

    from bayes_toe.inference.draws import Draws


#: Bootstrap replicates of a subject, as many as in the paper.
REPLICATES = 1000

FIT_COLUMNS = (
    *("subject", *NATURAL, "log_likelihood", "at_edge"),
    *(f"{name}_{side}" for name in NATURAL for side in ("lower", "upper")),
    *("level", "replicates", "penalty"),
)
UNCERTAINTY_COLUMNS = (
    *("subject", "parameter", "posterior_median", "posterior_lower", "posterior_upper"),
    *("fit", "bootstrap_lower", "bootstrap_upper", "at_edge"),
)


@dataclass(frozen=True, eq=False)
class SubjectFit:
    """Fit of one subject: the maximum, its bootstrap, and what has to be said of them."""

    subject: str
    fitted: Fits
    bootstrap: Bootstrap
    notes: tuple[str, ...] = ()

    @property
    def parameters(self) -> FloatArray:
        """mu1, sigma_p, sigma_l (natural-log intensity) and q0; NaN where the data leave a parameter open, which `at_edge` says."""
        return np.asarray(self.fitted.parameters[0])

    @property
    def log_likelihood(self) -> float:
        """At the maximum, without binomial coefficients and without the penalty on mu1; natural log."""
        return float(self.fitted.log_likelihood[0])

    @property
    def at_edge(self) -> str:
        """Edges on which the maximum lies, joined with ';', empty inside: :data:`bayes_toe.classical.maximum_likelihood.EDGES`."""
        return self.fitted.at_edge[0]


@dataclass(frozen=True, eq=False)
class FitTable(SubjectTable[SubjectFit]):
    """Fits of every subject of a study, in the study's order.

    Attributes
    ----------
    rows : tuple of SubjectFit
    level : float
        Of the percentile bootstrap intervals.
    replicates : int
    seed : int
    prior : Prior, optional
        Its normal of mu1 is the penalty.
    """

    level: float
    replicates: int
    seed: int
    prior: Prior | None = None

    def frame(self) -> pd.DataFrame:
        """The table with the columns of fit.csv; NaN (in the file: empty) where the data leave a parameter open."""
        import pandas as pd

        penalty = None if self.prior is None else self.prior.describe_penalty()
        limits = (row.bootstrap.intervals(self.level).ravel() for row in self)
        fits = ((row.subject, *row.parameters, row.log_likelihood, row.at_edge, *some) for row, some in zip(self, limits, strict=True))
        return pd.DataFrame([(*cells, self.level, self.replicates, penalty) for cells in fits], columns=list(FIT_COLUMNS))


def fit(
    study: Study,
    *,
    replicates: int = REPLICATES,
    level: float = 0.95,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> FitTable:
    """Maximum-likelihood fit of every subject, with the paper's penalty on mu1, and percentile bootstrap intervals.

    Parameters
    ----------
    study : Study
    replicates : int
        Bootstrap replicates of every subject.
    level : float
        Of the intervals, between 0 and 1.
    seed : int, optional
        Root seed of the bootstrap; without it fresh entropy, stored in the table.
    prior : Prior, optional
        Its normal of mu1 is the penalty; the default is the paper's V_1 = 10^2 around 0.
    workers, progress
        As in :func:`bayes_toe.analysis.run`.

    Raises
    ------
    InputError
        If `replicates` or `workers` is less than 1, `level` not between 0 and 1, `seed` not a whole number from 0 to 2**63 - 1, or the
        study has intervals (column isi).

    Examples
    --------
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> fit(Study([one]), replicates=50, seed=1, workers=1)["S01"].at_edge
    'q0=1'
    """
    require_level(level)
    if replicates < 1:
        raise InputError(f"replicates={replicates} must be at least 1")
    require_study(study)
    refuse_intervals(study, "maximum-likelihood fit")
    root, penalty = root_seed(seed), prior_for(study, prior)
    jobs = [partial(subject_fit, subject, penalty, seed=root, replicates=replicates) for subject in study]
    rows = run_in_order(jobs, workers, progress, [(name,) for name in study.names])
    return FitTable(tuple(rows), level, replicates, root, penalty)


def subject_fit(subject: Subject, prior: Prior, *, seed: int, replicates: int = REPLICATES) -> SubjectFit:
    """Fit and bootstrap of one subject; arguments as in :func:`fit`."""
    fitted = fit_subject(subject, prior)
    made = bootstrap_subject(subject, seed=seed, prior=prior, replicates=replicates, fitted=fitted)
    notes = [] if fitted.arrived[0] else ["the fit did not converge: the best point found is given"]
    open_ = [name for name, value in zip(NATURAL, fitted.parameters[0], strict=True) if np.isnan(value)]
    if open_:
        notes.append(f"not determined by these answers: {', '.join(open_)}")
    return SubjectFit(subject.name, fitted, made, (*notes, *made.remarks()))


def uncertainty_table(draws: Draws, fits: FitTable) -> pd.DataFrame:
    """Central posterior interval and percentile bootstrap interval of every subject and natural parameter, both at the table's level.

    Columns: :data:`UNCERTAINTY_COLUMNS`; the standard deviations and mu1 in natural-log intensity. The two answer different questions: the
    posterior weighs parameters by the prior and the answers given, the bootstrap says where the maximum would fall if the experiment were
    done again.

    Raises
    ------
    InputError
        If the two do not hold the same subjects.
    """
    import pandas as pd

    names = [row.subject for row in fits]
    if set(names) != set(draws.names):
        raise InputError("the draws and the fits must be of the same subjects")
    tails = [0.5 - fits.level / 2.0, 0.5, 0.5 + fits.level / 2.0]
    rows = []
    for row in fits:
        for key, best, (lower, upper) in zip(NATURAL, row.parameters, row.bootstrap.intervals(fits.level), strict=True):
            low, middle, high = np.quantile(draws.values(row.subject, key), tails)
            rows.append((row.subject, key, middle, low, high, best, lower, upper, row.at_edge))
    return pd.DataFrame(rows, columns=list(UNCERTAINTY_COLUMNS))
