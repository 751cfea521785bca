"""Whether stated probabilities mean what they say: reliability diagram, calibration error with its floor, scores.

The expected calibration error is not 0 even where every probability is right, because frequencies in bins scatter. Its floor is what
right probabilities would show: answers are drawn anew from the stated probabilities themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import expit, log_expit
from scipy.stats import beta

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.errors import InputError

BINS = 10
#: Excess of the calibration error over its floor that still counts as calibrated.
MARGIN = 0.02
_SIMULATIONS = 2000


@dataclass(frozen=True, eq=False)
class Bins:
    """The reliability diagram: equally wide bins of the stated probability that hold something, each array of shape (bins,).

    Attributes
    ----------
    count : array of int
    stated : array
        Mean stated probability.
    observed : array
        Frequency with which the statement was true.
    lower, upper : array
        Exact (Clopper-Pearson) 95 % binomial interval of the frequency.
    """

    count: IntArray
    stated: FloatArray
    observed: FloatArray
    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True)
class Reliability:
    """How good stated probabilities are.

    Attributes
    ----------
    count : int
        Statements.
    error : float
        Expected calibration error: mean over statements of |observed - stated| of their bin.
    floor : float
        Its mean for right probabilities.
    p_value : float
        Share of simulations of right probabilities with an error as large.
    brier : float
        Mean square of probability minus truth.
    log_score : float
        Mean of minus the log probability given to what was true, nats; infinite where that was 0.
    unsure : float
        Share of statements between 0.02 and 0.98: the others hardly test anything.
    """

    count: int
    error: float
    floor: float
    p_value: float
    brier: float
    log_score: float
    unsure: float

    @property
    def calibrated(self) -> bool:
        """Whether the error is at most its floor and a margin of 0.02."""
        return self.error <= self.floor + MARGIN


def reliability(log_odds: npt.ArrayLike, true: npt.ArrayLike, rng: np.random.Generator) -> Reliability:
    """Judge probabilities given as natural log odds, shape (statements,), against the truth, shape (statements,).

    Raises
    ------
    InputError
        If there is no statement, or log odds are NaN.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> odds = rng.normal(0.0, 2.0, 2000)
    >>> answers = rng.uniform(size=2000) < expit(odds)
    >>> reliability(odds, answers, rng).calibrated, reliability(3.0 * odds, answers, rng).calibrated
    (True, False)
    """
    odds, y = _statements(log_odds, true)
    p = expit(odds)
    index = _bin_index(p)
    error = float(_calibration_error(p, index, y[None])[0])
    right = np.concatenate([_calibration_error(p, index, rng.uniform(size=(100, len(p))) < p) for _ in range(_SIMULATIONS // 100)])
    return Reliability(
        count=len(p),
        error=error,
        floor=float(right.mean()),
        p_value=float((1 + (right >= error).sum()) / (1 + _SIMULATIONS)),
        brier=float(np.mean(np.square(p - y))),
        log_score=log_score(odds, y),
        unsure=float(np.mean((p > 0.02) & (p < 0.98))),
    )


def log_score(log_odds: npt.ArrayLike, true: npt.ArrayLike) -> float:
    """Mean of minus the log probability given to what was true, nats."""
    odds, y = _statements(log_odds, true)
    return float(-np.mean(log_expit(np.where(y, odds, -odds))))


def reliability_bins(log_odds: npt.ArrayLike, true: npt.ArrayLike) -> Bins:
    """The reliability diagram of probabilities given as natural log odds."""
    odds, y = _statements(log_odds, true)
    p = expit(odds)
    index = _bin_index(p)
    filled = np.unique(index)
    count = np.array([(index == b).sum() for b in filled])
    hits = np.array([y[index == b].sum() for b in filled])
    lower = np.where(hits == 0, 0.0, beta.ppf(0.025, np.maximum(hits, 1), count - hits + 1))
    upper = np.where(hits == count, 1.0, beta.ppf(0.975, hits + 1, np.maximum(count - hits, 1)))
    return Bins(count, np.array([p[index == b].mean() for b in filled]), hits / count, lower, upper)


def _statements(log_odds: npt.ArrayLike, true: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
    odds, y = np.asarray(log_odds, np.float64), np.asarray(true, np.bool_)
    if odds.shape != y.shape or odds.ndim != 1 or len(odds) == 0 or np.isnan(odds).any():
        raise InputError("log odds and truth must have one common length of at least 1, without NaN")
    return odds, y


def _bin_index(p: FloatArray) -> IntArray:
    return np.minimum((p * BINS).astype(np.int64), BINS - 1)


def _calibration_error(p: FloatArray, index: IntArray, y: BoolArray) -> FloatArray:
    """Expected calibration error of answers y, shape (sets, statements) -> (sets,)."""
    member = np.eye(BINS)[index]
    return np.asarray(np.abs((y - p) @ member).sum(axis=1) / len(p))
