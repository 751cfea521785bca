"""How well a model predicts answers that it has not seen: leave-one-out expected log predictive density, with its unit stated.

Left out is either one trial (one answer; the other answers of its pair stay) or one pair (all its answers). The first asks for the next
answer in the same experiment, the second for a pair of stimuli never tried. All answers of one kind to one pair are exchangeable, so the
first needs two values a pair, however many trials there are:

    elpd = sum over pairs of n_Eq ln p(equal | others) + n_Diff ln p(different | others).

Models with draws: Pareto-smoothed importance sampling (Vehtari, Gelman, Gabry 2017; Vehtari et al. 2024), withheld where k-hat says that
it cannot be trusted; of pairs by the draws of a proposal with wide tails where there is one (:mod:`bayes_toe.comparison.left_out_pairs`).
Free frequencies (H0): in closed form, because there the weights of a left-out pair fail always.

Values are natural logs, without binomial coefficients as the evidences are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
from scipy.special import betaln

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.errors import InputError
from bayes_toe.inference.diagnostics import log_sum, smoothed_unnormalised, smoothed_weights
from bayes_toe.inference.proposal import efficiency

Unit = Literal["trial", "pair"]
ANSWERS = ("equal", "different")
#: Pareto k-hat beyond which a value is withheld; with fewer than 2,200 draws less is allowed, 1 - 1/log10(draws).
LARGEST_K = 0.7
#: Share of weighted draws that must count for a left-out pair: below it one in fifty values is off by more than their scatter tells.
LEAST_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class LeaveOneOut:
    """Expected log predictive density of one model and subject.

    Attributes
    ----------
    unit : 'trial' or 'pair'
        What is left out at a time.
    elpd : float
        Sum over units, natural log; NaN where withheld.
    se : float
        Standard error of the sum as an estimate for new data, from the spread over units; NaN with a single unit.
    largest_k : float
        Largest Pareto k-hat; -inf where nothing had to be weighted.
    values : array
        Per left-out unit, natural log: shape (2, pairs) for trials, one 'equal' and one 'different' answer; (1, pairs) for pairs.
        NaN where no such answer was given, or withheld.
    counts : array of int, same shape
        How often each value counts.
    pareto_k : array, same shape
        Of each value; -inf where nothing had to be weighted, NaN where no such answer was given.
    note : str
        Why the value is withheld, or empty.
    """

    unit: Unit
    elpd: float
    se: float
    largest_k: float
    values: FloatArray
    counts: IntArray
    pareto_k: FloatArray
    note: str = ""

    def minus(self, other: LeaveOneOut) -> tuple[float, float]:
        """Difference of elpd to another model on the same answers, with the standard error of the paired difference.

        Raises
        ------
        InputError
            If units or answers differ.
        """
        if self.unit != other.unit or not np.array_equal(self.counts, other.counts):
            raise InputError("leave-one-out values of different units or answers cannot be compared")
        return _sum(self.values - other.values, self.counts)

    @classmethod
    def joined(cls, parts: Sequence[LeaveOneOut]) -> LeaveOneOut:
        """One model over several subjects: all their units together."""
        values, counts, k = (np.concatenate([getattr(one, key) for one in parts], axis=1) for key in ("values", "counts", "pareto_k"))
        return cls(parts[0].unit, *_sum(values, counts), float(np.nanmax(k)), values, counts, k)

    def filled(self, exact: Mapping[int, float]) -> LeaveOneOut:
        """The same with values of left-out pairs, by index, from another route in the place of those that were withheld."""
        values = self.values.copy()
        for pair, value in exact.items():
            values[0, pair] = value
        elpd, se = _sum(values, self.counts)
        return replace(self, elpd=elpd, se=se, values=values, note=self.note if np.isnan(elpd) else "")


def leave_one_out(
    log_equal: npt.ArrayLike,
    log_different: npt.ArrayLike,
    n_equal: npt.ArrayLike,
    n_trials: npt.ArrayLike,
    *,
    unit: Unit = "trial",
    pairs: Sequence[str] | None = None,
) -> LeaveOneOut:
    """Expected log predictive density from posterior draws.

    Parameters
    ----------
    log_equal, log_different : array_like, shape (draws, pairs)
        ln P(equal) and ln P(different) of one answer, given all others to its pair, at draws of equal weight.
    n_equal, n_trials : array_like of int, shape (pairs,)
    unit : 'trial' or 'pair'
        What is left out at a time.
    pairs : sequence of str, optional
        Names of the pairs for the note; numbers from 1 by default.

    Raises
    ------
    InputError
        If shapes or counts do not fit, a probability is NaN or above 1, or an answer that was given has probability 0 in some draw.

    Examples
    --------
    >>> q = np.random.default_rng(0).beta([[31.0, 11.0]], [[11.0, 31.0]], size=(4000, 2))  # each pair for itself: H0
    >>> found, exact = leave_one_out(np.log(q), np.log1p(-q), [30, 10], [40, 40]), leave_one_out_frequencies([30, 10], [40, 40])
    >>> round(found.elpd, 1) == round(exact.elpd, 1), leave_one_out(np.log(q), np.log1p(-q), [30, 10], [40, 40], unit="pair").elpd
    (True, nan)
    """
    counts = _counts(n_equal, n_trials)
    logs = np.stack([_logs(ANSWERS[0], log_equal, counts), _logs(ANSWERS[1], log_different, counts)])
    _require_possible(logs, counts)
    if _require_unit(unit) == "trial":
        return _weighted(unit, logs, counts, pairs)
    given = counts[:, :, None] > 0  # an answer never given contributes 0, also where its probability is 0
    return leave_one_pair_out(np.where(given, counts[:, :, None] * np.where(given, logs, 0.0), 0.0).sum(axis=0).T, n_trials, pairs=pairs)


def leave_one_pair_out(log_likelihood: npt.ArrayLike, n_trials: npt.ArrayLike, *, pairs: Sequence[str] | None = None) -> LeaveOneOut:
    """The same by pair for answers that need not be independent: from the log likelihood of each pair, shape (draws, pairs).

    Raises
    ------
    InputError
        As :func:`leave_one_out`.
    """
    tried = (np.asarray(n_trials)[None] > 0).astype(np.int64)
    logs = _logs("likelihood", log_likelihood, tried)[None]
    _require_possible(logs, tried, "this")
    return _weighted("pair", logs, tried, pairs)


def _weighted(unit: Unit, logs: FloatArray, counts: IntArray, pairs: Sequence[str] | None) -> LeaveOneOut:
    """From log probabilities of shape (answers, pairs, draws), of each unit given all that stays."""
    names = _numbers(counts) if pairs is None else tuple(pairs)
    if len(names) != counts.shape[1]:
        raise InputError(f"pairs: {len(names)} names, allowed are {counts.shape[1]}")
    values, k = np.full(counts.shape, np.nan), np.full(counts.shape, np.nan)
    for answer, pair in np.argwhere(counts > 0):
        values[answer, pair], k[answer, pair] = _left_out(logs[answer, pair])
    bad = k > trusted_k(logs.shape[-1])
    values[bad] = np.nan
    return LeaveOneOut(unit, *_sum(values, counts), float(np.nanmax(k)), values, counts, k, _note(unit, bad, k, names))


def weighted_pairs(log_likelihood: FloatArray, log_weights: FloatArray, n_trials: npt.ArrayLike, *, withheld: BoolArray) -> LeaveOneOut:
    """The same from draws that are weighted: ln p(pair | rest) = ln Z(all) - ln Z(rest), with mean weights in the place of both evidences.

    A value is withheld as well where the draws that count for the rest are below :data:`LEAST_SHARE` of all: few of a proposal that was
    made for all answers reach where the pair forbids, and neither their number nor k-hat then says how far the mean is off.

    Parameters
    ----------
    log_likelihood : array, shape (draws, pairs)
        Of each pair; -inf where the draw makes its answers impossible.
    log_weights : array, shape (draws,)
        Log of prior over proposal density, unnormalised.
    n_trials : array_like of int, shape (pairs,)
    withheld : array of bool, shape (pairs,)
        Pairs without which the posterior may have mass where no draw is.
    """
    tried = (np.asarray(n_trials)[None] > 0).astype(np.int64)
    impossible = np.isneginf(log_likelihood)
    possible, walls = np.where(impossible, 0.0, log_likelihood), impossible.sum(axis=1)
    whole = log_weights + possible.sum(axis=1)
    log_all = log_sum(whole[walls == 0])
    values, k = np.full(tried.shape, np.nan), np.full(tried.shape, np.nan)
    for pair in np.flatnonzero(tried[0]):
        rest = np.where(walls > impossible[:, pair], -np.inf, whole - possible[:, pair])
        smoothed, k[0, pair] = smoothed_unnormalised(rest)
        if not withheld[pair] and k[0, pair] <= trusted_k(len(rest)) and efficiency(rest) >= LEAST_SHARE:
            values[0, pair] = log_all - log_sum(smoothed)
    bad = np.isnan(values) & (tried > 0)
    return LeaveOneOut("pair", *_sum(values, tried), float(np.nanmax(k)), values, tried, k, _note("pair", bad, k, _numbers(tried)))


def below_best(models: Sequence[LeaveOneOut]) -> list[tuple[float, float]]:
    """Difference of elpd to the best of several models of the same answers, at most 0, with the standard error of the paired difference.

    0 and 0 for the best itself; NaN where a value is withheld.

    Examples
    --------
    >>> free, sure = leave_one_out_frequencies([3, 4], [5, 5]), leave_one_out(*np.log(np.full((2, 100, 2), 0.5)), [3, 4], [5, 5])
    >>> [[round(value, 2) for value in pair] for pair in below_best([free, sure])]
    [[-0.76, 1.42], [0.0, 0.0]]
    """
    elpd = np.array([one.elpd for one in models])
    if np.isnan(elpd).all():
        return [(np.nan, np.nan)] * len(models)
    best = int(np.nanargmax(elpd))
    return [(0.0, 0.0) if i == best else one.minus(models[best]) for i, one in enumerate(models)]


def leave_one_out_frequencies(n_equal: npt.ArrayLike, n_trials: npt.ArrayLike, *, unit: Unit = "trial") -> LeaveOneOut:
    """The same for H0, one free frequency per pair with a uniform prior, in closed form.

    A left-out 'equal' answer has probability n_Eq/(n + 1), a left-out 'different' one n_Diff/(n + 1). Nothing is known of a left-out pair:
    ln B(n_Eq + 1, n_Diff + 1), so that the sum over pairs is the log evidence of H0.

    Raises
    ------
    InputError
        If counts do not fit.

    Examples
    --------
    >>> found = leave_one_out_frequencies([1], [2])  # one of each: two times 1/3
    >>> round(found.elpd, 12) == round(2 * float(np.log(1 / 3)), 12)
    True
    """
    counts = _counts(n_equal, n_trials)
    if _require_unit(unit) == "pair":
        tried = np.asarray(counts.sum(axis=0, keepdims=True) > 0).astype(np.int64)
        values, counts = np.where(tried > 0, betaln(counts[0] + 1.0, counts[1] + 1.0), np.nan), tried
    else:
        with np.errstate(divide="ignore"):  # log 0 is not used where no such answer was given
            values = np.where(counts > 0, np.log(counts) - np.log1p(counts.sum(axis=0)), np.nan)
    k = np.where(counts > 0, -np.inf, np.nan)
    return LeaveOneOut(unit, *_sum(values, counts), -np.inf, values, counts, k)


def trusted_k(draws: int) -> float:
    """Largest Pareto k-hat that so many draws allow, min(0.7, 1 - 1/log10(draws)). Source: Vehtari et al. 2024."""
    return min(LARGEST_K, 1.0 - 1.0 / float(np.log10(draws)))


def _left_out(log_p: FloatArray) -> tuple[float, float]:
    """Log predictive density of a unit whose log probability in every draw is given, and k-hat."""
    if np.ptp(log_p) == 0.0:
        return float(log_p[0]), -np.inf  # all weights are equal: no tail to smooth
    smoothed = smoothed_weights(-log_p)
    return log_sum(smoothed.log_weights + log_p), smoothed.pareto_k


def _sum(values: FloatArray, counts: IntArray) -> tuple[float, float]:
    """Sum over units and its standard error, sqrt(N var)."""
    given = counts > 0
    v, n = values[given], counts[given].astype(np.float64)
    total = n.sum()
    if total < 2:
        return float(n @ v), float("nan")
    return float(n @ v), float(np.sqrt(total * (n @ np.square(v - n @ v / total)) / (total - 1.0)))


def _note(unit: Unit, bad: BoolArray, k: FloatArray, names: tuple[str, ...]) -> str:
    if not bad.any():
        return ""
    which = [f"pair {names[i]}" + (f" ('{ANSWERS[a]}')" if unit == "trial" else "") + f" {k[a, i]:.2f}" for a, i in np.argwhere(bad)]
    listed = ", ".join(which[:5]) + (f" and {len(which) - 5} more" if len(which) > 5 else "")
    return f"leave-one-out by {unit} withheld: importance weights are unreliable (Pareto k-hat: {listed})"


def _numbers(counts: IntArray) -> tuple[str, ...]:
    return tuple(str(i + 1) for i in range(counts.shape[1]))


def _require_unit(unit: Unit) -> Unit:
    if unit not in get_args(Unit):
        raise InputError(f"unit={unit!r}: allowed are 'trial' and 'pair'")
    return unit


def _counts(n_equal: npt.ArrayLike, n_trials: npt.ArrayLike) -> IntArray:
    """Counts of 'equal' and 'different', shape (2, pairs)."""
    k, n = np.asarray(n_equal), np.asarray(n_trials)
    if k.ndim != 1 or k.shape != n.shape or not np.all((k >= 0) & (k <= n)) or not np.any(n > 0):
        raise InputError("n_equal and n_trials: allowed are two rows of the same length with 0 <= n_equal <= n_trials, not all 0")
    return np.stack([k, n - k]).astype(np.int64)


def _logs(name: str, values: npt.ArrayLike, counts: IntArray) -> FloatArray:
    """Checked log probabilities of one answer, shape (pairs, draws), so that the draws of a pair lie side by side in memory."""
    logs = np.asarray(values, np.float64)
    if logs.ndim != 2 or logs.shape[1] != counts.shape[1] or len(logs) < 100:
        raise InputError(f"log_{name} of shape {logs.shape}: allowed is (draws, {counts.shape[1]}) with at least 100 draws")
    if not np.all(logs <= 1e-12):  # a logarithm of 1 - q may round up
        raise InputError(f"log_{name}: a log probability is NaN or above 0")
    return np.ascontiguousarray(logs.T)


def _require_possible(logs: FloatArray, counts: IntArray, *names: str) -> None:
    impossible = (logs.min(axis=-1) == -np.inf) & (counts > 0)
    for answer, pair in np.argwhere(impossible):
        said = names[answer] if names else repr(ANSWERS[answer])
        raise InputError(f"pair {pair + 1}: {said} was answered but has probability 0 in some draw of the posterior")
