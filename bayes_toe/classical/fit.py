"""The paper's fit of a study: maximum likelihood with bootstrap intervals.

`fit` gives a :class:`FitTable`, which can stand beside the intervals of the posterior.

The bootstrap says how far the fit would move if the same subject did the experiment again: each
pair's frequency q' ~ Beta(n_yes + 1, n_no + 1), new answers n' ~ Binomial(n, q'), refit. Source:
Methods, with the exponent corrected: p(q | n_Eq) is q^n_Eq (1 - q)^n_Diff. All replicates are
fitted in one batch of Newton ascents.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import product
from numbers import Integral
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayes_toe.arrays import FloatArray, IntArray, Rng
from bayes_toe.classical.maximum_likelihood import MaximumLikelihoodFits, fit_counts
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tables import SubjectTable
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError, require_kind, require_share
from bayes_toe.model.paper_equations import natural_names
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_file import prior_for
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Progress, Workers, run_in_order

if TYPE_CHECKING:
    from bayes_toe.inference.draws import Draws


#: Words for replicates on an edge.
_EDGE_WORDS = {
    "sigma_p=0": "have sigma_p = 0",
    "sigma_p=inf": "have an infinite sigma_p",
    "not unique": "do not determine a parameter; its interval uses the other replicates",
}


#: Bootstrap replicates of a subject; the paper has about 1,000.
REPLICATES = 400


@dataclass(frozen=True, eq=False)
class SubjectFit:
    """Fit of one subject: the maximum, and those of the bootstrap replicates."""

    subject: str
    fitted: MaximumLikelihoodFits  # of the subject's own answers, one row
    # one row a replicate: parameters (replicates, 4), log likelihoods, edges, arrived, curves
    fits: MaximumLikelihoodFits

    def __len__(self) -> int:
        return len(self.fits)

    @property
    def parameters(self) -> FloatArray:
        """mu1, sigma_p, sigma_l (natural-log intensity) and q0, or lapse_rate.

        NaN where the data leave one open, which `at_edge` says.
        """
        return self.fitted.parameters[0]

    @property
    def log_likelihood(self) -> float:
        """Log likelihood at the maximum, without binomial coefficients and penalty on mu1."""
        return float(self.fitted.log_likelihood[0])

    @property
    def at_edge(self) -> str:
        """Edges on which the maximum lies, joined with ';', empty inside.

        :data:`bayes_toe.classical.maximum_likelihood.EDGES`.
        """
        return self.fitted.at_edge[0]

    def intervals(self, level: float = 0.95) -> FloatArray:
        """Percentile interval of the four parameters, shape (4, 2).

        The limits are order statistics, so infinite values stay infinite. Only replicates that
        determine the parameter count. The limits are NaN if the fit, or at least half of the
        replicates, do not determine it.
        """
        require_share("level", level)
        result = np.full((self.fits.parameters.shape[1], 2), np.nan)
        for i, values in enumerate(self.fits.parameters.T):
            determined = values[~np.isnan(values)]
            if 2 * len(determined) > len(self) and not np.isnan(self.fitted.parameters[0, i]):
                result[i] = np.quantile(
                    determined, [0.5 - level / 2.0, 0.5 + level / 2.0], method="inverted_cdf"
                )
        return result

    def bands(
        self, s1: npt.ArrayLike, s2: npt.ArrayLike, low: float = 0.2, high: float = 0.8
    ) -> FloatArray:
        """Quantiles of the replicates' P of the counted answer, shape (2, pairs).

        s1 and s2 are natural-log intensities. The default is the paper's central 60 % range.
        Source: Methods; Fig. 3, shaded.
        """
        first, second = np.broadcast_arrays(
            np.atleast_1d(np.asarray(s1, np.float64)), np.atleast_1d(np.asarray(s2, np.float64))
        )
        return np.quantile(self.fits.curves.yes(first, second), [low, high], axis=0)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the fit and its intervals, a sentence each."""
        remarks = []
        if not self.fitted.arrived[0]:
            remarks.append("the fit did not converge: the best point found is given")
        value = self.fitted.parameters[0]
        if np.isnan(value).any():
            names = ", ".join(np.array(self.fitted.names)[np.isnan(value)])
            remarks.append(f"not determined by these answers: {names}")
        replicates = f"of {len(self)} bootstrap replicates"
        n_lost = int((~self.fits.arrived).sum())
        if n_lost:
            remarks.append(
                f"{n_lost} {replicates} did not converge; intervals use their best points"
            )
        for name, is_on_edge in self.fits.edges.items():
            n_there = int(is_on_edge.sum())
            if name == "not unique" and n_there == len(self):
                remarks.append("no bootstrap replicate determines every parameter")
            elif n_there and name in _EDGE_WORDS:
                remarks.append(f"{n_there} {replicates} {_EDGE_WORDS[name]}")
        low, high = self.intervals().T
        is_outside = (value < low) | (value > high)
        if is_outside.any():
            names = ", ".join(np.array(self.fitted.names)[is_outside])
            remarks.append(
                f"outside the 95 % interval: {names}, because the replicates come from smoothed "
                "frequencies"
            )
        return tuple(remarks)


def resample(subject: Subject, rng: Rng, replicates: int) -> IntArray:
    """New counts of every pair, (replicates, pairs).

    Q' ~ Beta(n_yes + 1, n_no + 1), n' ~ Binomial(n, q').
    """
    q = rng.beta(
        subject.n_yes + 1.0,
        subject.n_trials - subject.n_yes + 1.0,
        size=(replicates, subject.n_pairs),
    )
    return np.asarray(rng.binomial(subject.n_trials, q), np.int64)


UNCERTAINTY_COLUMNS = (
    *("subject", "parameter", "posterior_median", "posterior_lower", "posterior_upper"),
    *("fit", "bootstrap_lower", "bootstrap_upper", "at_edge"),
)


def fit_columns(task: Task) -> tuple[str, ...]:
    """Columns of fit.csv."""
    natural = natural_names(task)
    limits = map("_".join, product(natural, ("lower", "upper")))
    ending = ("level", "replicates", "penalty")
    return ("subject", *natural, "log_likelihood", "at_edge", *limits, *ending)


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
    task : Task
    """

    level: float
    replicates: int
    seed: int
    prior: Prior | None = None
    task: Task = SAME_DIFFERENT

    def _full_frame(self) -> pd.DataFrame:
        """The table with the columns of fit.csv.

        NaN (in the file: empty) where the data leave a parameter open.
        """
        penalty = None if self.prior is None else self.prior.describe_penalty()
        ending = (self.level, self.replicates, penalty)
        rows = []
        for row in self:
            limits = row.intervals(self.level).ravel()
            fitted = (row.subject, *row.parameters, row.log_likelihood, row.at_edge)
            rows.append((*fitted, *limits, *ending))
        return pd.DataFrame(rows, columns=list(fit_columns(self.task)))

    def frame(self, *, full: bool = False) -> pd.DataFrame:
        """The parameters; with `full` all columns of fit.csv."""
        frame = self._full_frame()
        return frame if full else frame.loc[:, :"at_edge"]

    def compare_with(self, draws: Draws) -> pd.DataFrame:
        """Posterior and bootstrap interval of every subject and natural parameter.

        Both are central intervals at the table's level.

        Columns: :data:`UNCERTAINTY_COLUMNS`; the standard deviations and mu1 in natural-log
        intensity. The two answer different questions: the posterior weighs parameters by the prior
        and the answers given, the bootstrap says where the maximum would fall if the experiment
        were done again.

        Raises
        ------
        InputError
            If the draws are not of the same subjects.
        """
        if {row.subject for row in self} != set(draws.names):
            raise InputError("the draws and the fits must be of the same subjects")
        tails = [0.5 - self.level / 2.0, 0.5, 0.5 + self.level / 2.0]
        rows = []
        for row in self:
            intervals = row.intervals(self.level)
            for key, best, limits in zip(row.fitted.names, row.parameters, intervals, strict=True):
                low, middle, high = np.quantile(draws.values(row.subject, key), tails)
                rows.append((row.subject, key, middle, low, high, best, *limits, row.at_edge))
        return pd.DataFrame(rows, columns=list(UNCERTAINTY_COLUMNS))


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
    """Fit the paper's model to every subject by maximum likelihood, with bootstrap intervals.

    The fit has a penalty on mu1. The intervals are percentile intervals.

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
        Its normal of mu1 is the penalty; the paper's, V_1 = 10^2 around 0, is that of "paper".
    workers, progress
        As in :func:`bayes_toe.analysis.run`.

    Raises
    ------
    InputError
        If `replicates` or `workers` is less than 1, `level` not between 0 and 1, `seed` not a whole
        number from 0 to 2**63 - 1.

    Examples
    --------
    >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> fit(Study([one]), replicates=50, seed=1, workers=1)["S01"].at_edge
    'q0=1'
    """
    require_share("level", level)
    require_kind("replicates", replicates, Integral, "a whole number from 1")
    if replicates < 1:
        raise InputError(f"replicates={replicates} must be at least 1")
    require_study(study)
    root, penalty = root_seed(seed), prior_for(study, prior)
    jobs = [
        partial(subject_fit, subject, penalty, seed=root, replicates=replicates)
        for subject in study
    ]
    rows = run_in_order(jobs, workers, progress, [(name,) for name in study.names])
    return FitTable(tuple(rows), level, replicates, root, penalty, study.task)


def subject_fit(
    subject: Subject, prior: Prior, *, seed: int, replicates: int = REPLICATES
) -> SubjectFit:
    """Fit and bootstrap of one subject; arguments as in :func:`fit`.

    The seed and the name of the subject determine the random stream.
    """
    counts = resample(subject, generator(seed, subject.name, "bootstrap"), replicates)
    return SubjectFit(subject.name, fit_counts(subject, prior), fit_counts(subject, prior, counts))
