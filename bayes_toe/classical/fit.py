"""The paper's fit of a study: maximum likelihood with bootstrap intervals.

`fit` gives a :class:`FitTable`, which can stand beside the intervals of the posterior.

A fit maximises the log likelihood minus (mu1 - mean)^2 / (2 V_1) with SciPy's L-BFGS-B, from
several starts. Source: Eq. mod:logp_grouped. (The paper calls it minimising the log-likelihood; it
is maximising.) A point x has mu1, the log of the width w, gamma, and q0 or the lapse rate. A
maximum on one of their bounds is named.

The bootstrap says how far the fit would move if the same subject did the experiment again: each
pair's frequency q' ~ Beta(n_yes + 1, n_no + 1), new answers n' ~ Binomial(n, q'), refit. Source:
Methods, with the exponent corrected: p(q | n_Eq) is q^n_Eq (1 - q)^n_Diff.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.optimize import minimize

from bayes_toe.arrays import BoolArray, FloatArray, IntArray, Rng, Texts
from bayes_toe.data.study import Study, Subject, require_study
from bayes_toe.data.tables import SubjectTable
from bayes_toe.data.tasks import Task
from bayes_toe.errors import require_number
from bayes_toe.inference.searches import step_of_pairs
from bayes_toe.model.paper_equations import (
    Natural,
    natural_names,
    p_counted,
    pull,
    variance_ratio,
)
from bayes_toe.model.paper_model import CURVES, POWERS
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_file import prior_for
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Progress, Workers, run_in_order

#: Bootstrap replicates of a subject; the paper has about 1,000.
REPLICATES = 400
#: Bounds of q0 and of the lapse rate, between which no log probability is infinite.
_SHARE_BOUNDS = (1e-9, 1.0 - 1e-9)
#: Largest width, in units of the step between stimuli; the smallest width is its inverse.
_LARGEST_WIDTH = 1000.0
#: Nats by which equally high maxima may differ, since a search ends before the maximum.
_EQUAL_HEIGHT = 1e-5
#: Range of a parameter over equally high maxima, above which it is not determined.
_DETERMINED_WITHIN = 0.01


# --- Maximum likelihood --------------------------------------------------------------------------


class Maxima(NamedTuple):
    """The points at which searches from several starts ended, for one row of counts.

    A search that has converged ends at a maximum. Several searches may end at the same maximum.
    """

    x: FloatArray  # (starts, 4)
    value: FloatArray  # log likelihood minus penalty, (starts,)
    has_converged: BoolArray  # (starts,)

    @property
    def best(self) -> FloatArray:
        """The end with the highest value, (4,)."""
        return self.x[self.value.argmax()]

    @property
    def is_highest(self) -> BoolArray:
        """Whether the value at each end is the highest, or close to it, (starts,)."""
        return self.value > self.value.max() - _EQUAL_HEIGHT


@dataclass(frozen=True, eq=False)
class PenalisedLikelihood:
    """The function that a fit maximises: log likelihood of a subject's counts minus the penalty.

    A point x is (mu1, log width, gamma, share); the share is q0 or the lapse rate. The penalty is
    (mu1 - mu1_mean)^2 / (2 mu1_sd^2).
    """

    subject: Subject
    mu1_mean: float
    mu1_sd: float

    @cached_property
    def step(self) -> float:
        """The scale of a search, natural-log intensity."""
        return step_of_pairs(self.subject)

    @cached_property
    def bounds(self) -> FloatArray:
        """Lowest and highest value of each coordinate, (4, 2). The paper has gamma from 0 to 1."""
        # From step / _LARGEST_WIDTH to step * _LARGEST_WIDTH.
        log_widths = np.log(self.step) + np.log(_LARGEST_WIDTH) * np.array([-1.0, 1.0])
        return np.array([(-np.inf, np.inf), log_widths, (0.0, 1.0), _SHARE_BOUNDS])

    def starts(self, n_yes: IntArray) -> FloatArray:
        """Points from which searches start, for counts (rows, pairs): (rows, 4 values of mu1, 4).

        Each is the point of a grid with the highest log likelihood among those with its mu1.
        """
        # Four values of mu1: far below the stimuli, on both sides of their mean, and far above the
        # stimuli. No two values have the same distance from the mean, because a symmetric design
        # has equal maxima on both sides of the mean, and rounding would choose between the two.
        mu1_values = self.subject.mean_first + self.step * np.array([-8.0, -0.5, 0.6, 8.1])
        log_widths = np.log(self.step) + np.arange(-2.0, 1.1, 0.5)  # 0.14 to 2.7 steps
        gammas = (0.01, 0.1, 0.3, 0.9)  # between the bounds 0 and 1
        shares = np.array([0.03, 0.15, 0.4, 0.7])  # lapse rates
        if self.subject.task.lapses == "q0":  # P(equal) without a difference, near 1
            shares = 1.0 - shares

        answers_at, _ = CURVES[self.subject.task.lapses]
        starts = []  # the best point with each mu1, (rows, 4) each
        for mu1 in mu1_values:
            points = np.array(list(product([mu1], log_widths, gammas, shares)))  # (points, 4)
            share = points[:, 3:]
            log_yes, log_no = answers_at(self.distance(points), share, 1.0 - share)
            # (rows, points). The penalty is the same at all points.
            log_likelihood = n_yes @ log_yes.T + (self.subject.n_trials - n_yes) @ log_no.T
            starts.append(points[log_likelihood.argmax(axis=1)])
        return np.stack(starts, axis=1)

    def distance(self, x: FloatArray) -> FloatArray:
        """Distance z = (s2 - s1 + p (s1 - mu1)) / width at points, (..., 4) -> (..., pairs).

        p is the pull of gamma.
        """
        mu1, log_width, gamma, _ = np.moveaxis(x[..., None], -2, 0)  # (..., 1) each
        s1 = self.subject.s1
        return np.asarray((self.subject.s2 - s1 + pull(gamma) * (s1 - mu1)) / np.exp(log_width))

    def minus_objective(self, x: FloatArray, n_yes: IntArray) -> tuple[float, FloatArray]:
        """Penalty minus log likelihood of counts, and its gradient, (4,), at one point, (4,)."""
        mu1, log_width, gamma, share = x.tolist()
        z = self.distance(x)  # (pairs,)

        # The log likelihood, and its slopes in z of each pair and in the share.
        answers_at, slopes_at = CURVES[self.subject.task.lapses]
        log_yes, log_no = answers_at(z, share, 1.0 - share)
        (yes_in_z, no_in_z), (yes_in_share, no_in_share) = slopes_at(z, share, (log_yes, log_no))
        n_no = self.subject.n_trials - n_yes
        log_likelihood = n_yes @ log_yes + n_no @ log_no
        z_slopes = n_yes * yes_in_z + n_no * no_in_z  # (pairs,)
        share_slope = (n_yes * yes_in_share + n_no * no_in_share).sum()

        # The slopes in the other coordinates follow from those in z = (s2 - s1 + p (s1 - mu1))/w:
        # dz/dmu1 = -p/w, dz/d(log w) = -z, dz/dp = (s1 - mu1)/w. From gamma = p/(1 - p)^2 follows
        # dp/dgamma = (1 - p)^3/(1 + p).
        p = float(pull(gamma))
        w = np.exp(log_width)
        deviation = (mu1 - self.mu1_mean) / self.mu1_sd  # the penalty is half its square
        mu1_slope = -p * z_slopes.sum() / w - deviation / self.mu1_sd
        gamma_slope = z_slopes @ (self.subject.s1 - mu1) / w * (1.0 - p) ** 3 / (1.0 + p)
        gradient = np.array([mu1_slope, -(z_slopes @ z), gamma_slope, share_slope])
        return 0.5 * deviation**2 - log_likelihood, -gradient

    def search(self, n_yes: IntArray, starts: FloatArray) -> Maxima:
        """Search the maximum for counts, (pairs,), from each of the starts, (starts, 4)."""
        # The first step of a search has the length 1. So each coordinate, mu1, log width, gamma and
        # share, is searched in a unit that is small for this coordinate.
        units = np.array([0.3 * self.step, 0.1, 0.1, 0.05])

        def minus_objective_in_units(point: FloatArray) -> tuple[float, FloatArray]:
            """The function that is minimised, and its gradient, at a point in these units."""
            value, gradient = self.minus_objective(point * units, n_yes)
            return value, gradient * units

        ends = []
        for start in starts:
            end = minimize(
                minus_objective_in_units,
                start / units,
                method="L-BFGS-B",
                jac=True,  # The function returns its gradient, too.
                bounds=self.bounds / units[:, None],  # (4, 2)
                # The search ends where steps change the value by little more than rounding.
                options={"ftol": 1e-13, "gtol": 1e-6, "maxiter": 1000},
            )
            ends.append((end.x * units, -end.fun, end.success))
        return Maxima(*map(np.array, zip(*ends, strict=True)))

    def natural(self, x: FloatArray) -> FloatArray:
        """mu1, sigma_p, sigma_l and q0 or lapse rate at points, (points, 4).

        The width is sigma_p G^power, with the variance ratio G of gamma and the power of the task.
        The square of sigma_l / sigma_p is gamma.
        """
        mu1, log_width, gamma, share = x.T
        sigma_p = np.exp(log_width) / variance_ratio(gamma) ** POWERS[self.subject.task.lapses]
        return np.stack([mu1, sigma_p, sigma_p * np.sqrt(gamma), share], axis=-1)

    def reached_bounds(self, x: FloatArray) -> str:
        """The bounds on which a point lies, such as 'gamma=0;q0=1'; empty inside."""
        names = ("mu1", "width", "gamma", self.subject.task.lapses)
        texts = []
        # An infinite bound, which mu1 has, is never reached.
        for name, value, bounds in zip(names, x, self.bounds, strict=True):
            if np.abs(bounds - value).min() < 1e-6:  # on a bound, up to rounding
                if name == "width":  # its coordinate is the logarithm
                    number = np.exp(value)
                else:  # the bound 1 - 1e-9 of a share becomes 1
                    number = round(value, 6)
                texts.append(f"{name}={number:.3g}")
        return ";".join(texts)


# --- Bootstrap -----------------------------------------------------------------------------------


def resample(subject: Subject, rng: Rng, replicates: int) -> IntArray:
    """New counts of every pair, (replicates, pairs).

    With q' ~ Beta(n_yes + 1, n_no + 1), they are n' ~ Binomial(n, q'), see the module.
    """
    q = rng.beta(
        subject.n_yes + 1.0,
        subject.n_trials - subject.n_yes + 1.0,
        size=(replicates, subject.n_pairs),
    )
    return np.asarray(rng.binomial(subject.n_trials, q), np.int64)


@dataclass(frozen=True, eq=False)
class SubjectFit:
    """Fit of one subject: the maximum of its counts, and the maxima of bootstrap replicates.

    Attributes
    ----------
    subject : str
    task : Task
    parameters : ndarray, shape (4,)
        mu1, sigma_p, sigma_l (natural-log intensity) and q0, or lapse_rate. NaN where the answers
        do not determine a parameter.
    log_likelihood : float
        Log likelihood at the maximum, without binomial coefficients and penalty on mu1.
    at_edge : str
        Bounds on which the maximum lies, joined with ';', empty inside.
    replicates : ndarray, shape (replicates, 4)
        The parameters of the bootstrap replicates.
    n_failed : int
        Fits that did not converge, among those of the subject itself and of the replicates.
    """

    subject: str
    task: Task
    parameters: FloatArray
    log_likelihood: float
    at_edge: str
    replicates: FloatArray
    n_failed: int

    @property
    def names(self) -> Texts:
        """Names of the parameters."""
        return natural_names(self.task)

    def intervals(self) -> FloatArray:
        """95 % percentile interval of the four parameters, shape (4, 2).

        NaN where the answers do not determine a parameter.
        """
        # This method takes an order statistic, so that each limit is the value of a replicate.
        tails = (0.025, 0.975)
        limits = np.quantile(self.replicates, tails, axis=0, method="inverted_cdf").T
        return np.where(np.isnan(self.parameters)[:, None], np.nan, limits)

    def yes(self, s1: npt.ArrayLike, s2: npt.ArrayLike) -> FloatArray:
        """Probability of the counted answer by each replicate, shape (replicates, pairs).

        s1 and s2 are natural-log intensities. The shaded bands of the paper (Fig. 3) are from the
        20 to the 80 % quantile of the replicates.
        """
        parameters = Natural(*self.replicates.T[:, :, None])  # (replicates, 1) each
        return p_counted(self.task, s1, s2, parameters)

    @property
    def notes(self) -> Texts:
        """Remarks on the fit and its intervals, a sentence each."""
        remarks = []
        names = np.array(self.names)
        if self.n_failed:
            n_fits = len(self.replicates) + 1  # 1 for the fit of the subject itself
            remarks.append(f"{self.n_failed} of {n_fits} searches did not converge")
        is_unknown = np.isnan(self.parameters)
        if is_unknown.any():
            remarks.append(f"not determined by these answers: {', '.join(names[is_unknown])}")

        low, high = self.intervals().T
        is_outside = (self.parameters < low) | (self.parameters > high)
        if is_outside.any():
            remarks.append(
                f"outside the 95 % interval: {', '.join(names[is_outside])}, because the "
                "replicates come from smoothed frequencies"
            )
        return tuple(remarks)


def fit_columns(task: Task) -> Texts:
    """Columns of fit.csv; limits are named such as mu1_lower and mu1_upper."""
    natural = natural_names(task)
    limits = map("_".join, product(natural, ("lower", "upper")))
    return (
        "subject",
        *natural,
        "log_likelihood",
        "at_edge",
        *limits,
        "replicates",
        "penalty",
    )


@dataclass(frozen=True, eq=False)
class FitTable(SubjectTable[SubjectFit]):
    """Fits of every subject of a study, in the study's order.

    Attributes
    ----------
    rows : tuple of SubjectFit
    replicates : int
    seed : int
    prior : Prior
        Its normal of mu1 is the penalty.
    task : Task
    """

    replicates: int
    seed: int
    prior: Prior
    task: Task

    def _full_frame(self) -> pd.DataFrame:
        """The table with the columns of fit.csv.

        NaN (in the file: empty) where the answers do not determine a parameter.
        """
        penalty = self.prior.describe_penalty()
        rows = [
            (
                row.subject,
                *row.parameters,
                row.log_likelihood,
                row.at_edge,
                *row.intervals().ravel(),
                self.replicates,
                penalty,
            )
            for row in self
        ]
        return pd.DataFrame(rows, columns=list(fit_columns(self.task)))

    def frame(self, *, full: bool = False) -> pd.DataFrame:
        """The parameters; with `full` all columns of fit.csv."""
        frame = self._full_frame()
        return frame if full else frame.loc[:, :"at_edge"]


def fit(
    study: Study,
    *,
    replicates: int = REPLICATES,
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
    seed : int, optional
        Root seed of the bootstrap; without it fresh entropy, stored in the table.
    prior : Prior or str, optional
        Its normal prior of mu1 is the penalty. By default this is the default prior. The prior
        "paper" has the mean 0 and the variance V_1 = 10^2 of mu1.
    workers, progress
        As in :func:`bayes_toe.analysis.run`.

    Raises
    ------
    InputError
        If `replicates` or `workers` is less than 1, `seed` not a whole number from 0 to 2**63 - 1.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> fit(Study([subject]), replicates=50, seed=1, workers=1)["S01"].at_edge
    'q0=1'
    """
    require_number("replicates", replicates)
    require_study(study)
    root = root_seed(seed)
    study_prior = prior_for(study, prior)
    jobs = [
        partial(subject_fit, subject, study_prior, seed=root, replicates=replicates)
        for subject in study
    ]
    rows = run_in_order(jobs, workers, progress, [(name,) for name in study.names])
    return FitTable(tuple(rows), replicates, seed=root, prior=study_prior, task=study.task)


def subject_fit(
    subject: Subject, prior: Prior, *, seed: int, replicates: int = REPLICATES
) -> SubjectFit:
    """Fit and bootstrap of one subject; arguments as in :func:`fit`.

    The seed and the name of the subject determine the random stream.
    """
    # The prior may depend on the stimuli of the subjects, here on those of this subject alone.
    mu1_mean, mu1_sd = prior.for_subjects(subject).mu1_normal
    likelihood = PenalisedLikelihood(subject, mu1_mean, mu1_sd)
    resampled = resample(subject, generator(seed, subject.name, "bootstrap"), replicates)
    # The counts of the subject come first, then those of the bootstrap.
    counts = np.vstack([subject.n_yes, resampled])  # (1 + replicates, pairs)
    fits = list(map(likelihood.search, counts, likelihood.starts(counts)))
    natural = likelihood.natural(np.array([maxima.best for maxima in fits]))  # (1 + replicates, 4)
    # The fit to a row of counts has several searches. It has failed if none of the searches that
    # reached the highest value converged.
    has_failed = [not maxima.has_converged[maxima.is_highest].any() for maxima in fits]

    # A parameter that differs between equally high maxima is not determined by the answers.
    maxima = fits[0]  # those of the subject
    equally_high = likelihood.natural(maxima.x[maxima.is_highest])
    is_unknown = np.ptp(equally_high, axis=0) > _DETERMINED_WITHIN  # (4,)
    # The value of the maximum is the log likelihood minus the penalty on mu1, which is the first
    # coordinate. The log likelihood in the table has no penalty.
    penalty = 0.5 * ((maxima.best[0] - mu1_mean) / mu1_sd) ** 2
    return SubjectFit(
        subject=subject.name,
        task=subject.task,
        parameters=np.where(is_unknown, np.nan, natural[0]),
        log_likelihood=float(maxima.value.max() + penalty),
        at_edge=likelihood.reached_bounds(maxima.best),
        replicates=natural[1:],
        n_failed=sum(has_failed),
    )
