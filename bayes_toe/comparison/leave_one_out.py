"""How well a model predicts answers that it has not seen: leave-one-out expected log predictive density, with its unit stated.

Left out is either one trial (one answer; the other answers of its pair stay) or one pair (all its answers). The first asks for the next
answer in the same experiment, the second for a pair of stimuli never tried. All answers of one kind to one pair are exchangeable, so the
first needs two values a pair, however many trials there are:

    elpd = sum over pairs of n_Eq ln p(equal | others) + n_Diff ln p(different | others).

Models with draws: Pareto-smoothed importance sampling (Vehtari, Gelman, Gabry 2017; Vehtari et al. 2024), withheld where k-hat says that
it cannot be trusted. Pairs: by the proposal that was fitted to all answers, where there is one, whose draws are independent and reach
beyond the posterior; where too few of them count, by one that is fitted to the other answers. Free frequencies (H0): in closed form.

Where stimuli that seem the same are never called 'different', a pair that was is a wall between offsets, and the other answers may have
their mass beyond it, where no draw is: nothing that is computed from draws would tell. Maxima that all answers together make hopeless do:
where one of them comes near the best without the pair, a proposal is fitted to the other answers from the maxima to which they lead.

Values are natural logs, without binomial coefficients as the evidences are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.special import betaln, logsumexp

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.diagnostics import smoothed_unnormalised, smoothed_weights
from bayes_toe.inference.evidence import Evidence, importance_evidence
from bayes_toe.inference.maxima import Maxima, find_maxima
from bayes_toe.inference.proposal import FittedProposal, efficiency
from bayes_toe.model.ladder import Target
from bayes_toe.seeds import generator

Unit = Literal["trial", "pair"]
ANSWERS = ("equal", "different")
#: Pareto k-hat beyond which a value is withheld; with fewer than 2,200 draws less is allowed, 1 - 1/log10(draws).
LARGEST_K = 0.7
#: Share of weighted draws that must count for a left-out pair: below it one in fifty values is off by more than their scatter tells.
LEAST_SHARE = 0.1
#: Values of one array of log probabilities; draws are thinned to stay below, to no fewer than the least.
VALUES, LEAST_DRAWS = 5_000_000, 1000
_MOST_REFITS = (
    10  # a model that more pairs surprise describes the answers badly, which the other columns show
)
#: Nats below the best at which a maximum still has draws, and at which one may matter once it has moved; by how much it rises at least.
_SHOWN, _NEAR, _RISEN = 5.0, 8.0, 3.0
_JUDGING = 5000  # draws behind the evidence without a pair: uncertain by less than 0.01 then
_START, _LEAST_START = (
    5000,
    20.0,
)  # draws with which a refit begins, and how many must count: fewer do not show where to look


@dataclass(frozen=True, eq=False)
class LeaveOneOut:
    """Expected log predictive density of one model and subject.

    Per left-out unit `values`, natural log, `counts`, how often each counts, and `pareto_k` have the shape (2, pairs) for trials, one
    'equal' and one 'different' answer, and (1, pairs) for pairs. Values are NaN where no such answer was given, or withheld, k is NaN where
    none was given, and -inf where nothing had to be weighted; `note` says why values are withheld.
    """

    values: FloatArray
    counts: IntArray
    pareto_k: FloatArray
    note: str = ""

    @cached_property
    def elpd(self) -> float:
        """Sum over units, natural log; NaN where a value is withheld."""
        return _sum(self.values, self.counts)[0]

    @cached_property
    def se(self) -> float:
        """Standard error of the sum as an estimate for new data, from the spread over units; NaN with a single unit."""
        return _sum(self.values, self.counts)[1]

    def minus(self, other: LeaveOneOut) -> tuple[float, float]:
        """Difference of elpd to another model on the same answers, with the standard error of the paired difference."""
        return _sum(self.values - other.values, self.counts)

    @classmethod
    def joined(cls, parts: Sequence[LeaveOneOut]) -> LeaveOneOut:
        """One model over several subjects: all their units together."""
        values, counts, k = (
            np.concatenate([getattr(one, key) for one in parts], axis=1)
            for key in ("values", "counts", "pareto_k")
        )
        return cls(values, counts, k)


def leave_one_out(
    log_equal: FloatArray, log_different: FloatArray, n_yes: npt.ArrayLike, n_trials: npt.ArrayLike
) -> LeaveOneOut:
    """Expected log predictive density of a left-out answer from posterior draws of equal weight.

    From log probabilities, (draws, pairs), of both answers of one trial, the counted one first, given all others to its pair; and counts.

    Examples
    --------
    >>> q = np.random.default_rng(0).beta([[31.0, 11.0]], [[11.0, 31.0]], size=(4000, 2))  # each pair for itself: H0
    >>> found, exact = leave_one_out(np.log(q), np.log1p(-q), [30, 10], [40, 40]), leave_one_out_frequencies([30, 10], [40, 40])
    >>> round(found.elpd, 1) == round(exact.elpd, 1)
    True
    """
    return _smoothed("trial", np.stack([log_equal, log_different]), _counts(n_yes, n_trials))


def leave_one_pair_out(log_likelihood: FloatArray, n_trials: npt.ArrayLike) -> LeaveOneOut:
    """The same of all answers to a pair, which need not be independent: from the log likelihood of each pair, shape (draws, pairs)."""
    return _smoothed(
        "pair", log_likelihood[None], (np.asarray(n_trials)[None] > 0).astype(np.int64)
    )


def leave_one_out_frequencies(
    n_yes: npt.ArrayLike, n_trials: npt.ArrayLike, *, unit: Unit = "trial"
) -> LeaveOneOut:
    """The same for H0, one free frequency per pair with a uniform prior, in closed form.

    A left-out 'equal' answer has probability n_Eq/(n + 1), a left-out 'different' one n_Diff/(n + 1). Nothing is known of a left-out pair:
    ln B(n_Eq + 1, n_Diff + 1), so that the sum over pairs is the log evidence of H0.

    Examples
    --------
    >>> found = leave_one_out_frequencies([1], [2])  # one of each: two times 1/3
    >>> round(found.elpd, 12) == round(2 * float(np.log(1 / 3)), 12)
    True
    """
    counts = _counts(n_yes, n_trials)
    if unit == "pair":
        tried = np.asarray(counts.sum(axis=0, keepdims=True) > 0).astype(np.int64)
        values, counts = (
            np.where(tried > 0, betaln(counts[0] + 1.0, counts[1] + 1.0), np.nan),
            tried,
        )
    else:
        with np.errstate(divide="ignore"):  # log 0 is not used where no such answer was given
            values = np.where(counts > 0, np.log(counts) - np.log1p(counts.sum(axis=0)), np.nan)
    return LeaveOneOut(values, counts, np.where(counts > 0, -np.inf, np.nan))


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


def trusted_k(draws: int) -> float:
    """Largest Pareto k-hat that so many draws allow, min(0.7, 1 - 1/log10(draws)). Source: Vehtari et al. 2024."""
    return min(LARGEST_K, 1.0 - 1.0 / float(np.log10(draws)))


def _smoothed(unit: Unit, logs: FloatArray, counts: IntArray) -> LeaveOneOut:
    """From log probabilities of shape (answers, draws, pairs), of each unit given all that stays."""
    values, k = np.full(counts.shape, np.nan), np.full(counts.shape, np.nan)
    for answer, pair in np.argwhere(counts > 0):
        log_p = logs[answer, :, pair]
        if np.ptp(log_p) == 0.0:
            values[answer, pair], k[answer, pair] = (
                log_p[0],
                -np.inf,
            )  # all weights are equal: no tail to smooth
        else:
            smoothed = smoothed_weights(-log_p)
            values[answer, pair], k[answer, pair] = (
                logsumexp(smoothed.log_weights + log_p),
                smoothed.pareto_k,
            )
    values[k > trusted_k(logs.shape[1])] = np.nan
    return LeaveOneOut(values, counts, k, _note(unit, values, counts, k))


def _sum(values: FloatArray, counts: IntArray) -> tuple[float, float]:
    """Sum over units and its standard error, sqrt(N var)."""
    given = counts > 0
    v, n = values[given], counts[given].astype(np.float64)
    total = n.sum()
    if total < 2:
        return float(n @ v), float("nan")
    return float(n @ v), float(np.sqrt(total * (n @ np.square(v - n @ v / total)) / (total - 1.0)))


def _note(unit: Unit, values: FloatArray, counts: IntArray, k: FloatArray) -> str:
    bad = np.argwhere(np.isnan(values) & (counts > 0))
    if not len(bad):
        return ""
    which = [
        f"pair {i + 1}" + (f" ('{ANSWERS[a]}')" if unit == "trial" else "") + f" {k[a, i]:.2f}"
        for a, i in bad
    ]
    listed = ", ".join(which[:5]) + (f" and {len(which) - 5} more" if len(which) > 5 else "")
    return f"leave-one-out by {unit} withheld: importance weights are unreliable (Pareto k-hat: {listed})"


def _counts(n_yes: npt.ArrayLike, n_trials: npt.ArrayLike) -> IntArray:
    """Counts of both answers, shape (2, pairs)."""
    return np.stack([np.asarray(n_yes), np.asarray(n_trials) - np.asarray(n_yes)]).astype(np.int64)


# --- pairs, by the proposal ---------------------------------------------------------------------------------------------------------


def left_out_pairs(
    fitted: FittedProposal, maxima: Maxima, evidence: Evidence, seed: int
) -> LeaveOneOut:
    """Leave-one-out by pair of a model whose proposal can be trusted; values where weights fail come from refits, at most ten.

    `maxima` are those of the posterior of all answers.
    """
    target, subject = fitted.proposal.posterior, fitted.proposal.posterior.subject
    some = fitted.draws.part(slice(None, None, thinning(len(fitted.draws.x), subject.n_pairs)))
    elsewhere = _elsewhere(target, maxima)
    log_likelihood, log_weights = (
        target.pair_log_likelihood(some.x),
        some.log_prior - some.log_proposal,
    )
    found = weighted_pairs(log_likelihood, log_weights, subject.n_trials, withheld=elsewhere)
    failed = np.flatnonzero(np.isnan(found.values[0]) & (subject.n_trials > 0)).tolist()
    if evidence.value is None or not 0 < len(failed) <= _MOST_REFITS:
        return found
    values = found.values.copy()
    for pair in failed:
        rng = generator(seed, subject.name, target.model.name, "left out", pair)
        rest = log_evidence_without(
            target, pair, rng, fitted=None if elsewhere[pair] else fitted, starts=maxima.all
        )
        values[0, pair] = np.nan if rest is None else evidence.value - rest
    return replace(
        found, values=values, note=found.note if np.isnan(values[found.counts > 0]).any() else ""
    )


def weighted_pairs(
    log_likelihood: FloatArray,
    log_weights: FloatArray,
    n_trials: npt.ArrayLike,
    *,
    withheld: BoolArray,
) -> LeaveOneOut:
    """The same from draws that are weighted: ln p(pair | rest) = ln Z(all) - ln Z(rest), with mean weights in the place of both evidences.

    A value is withheld as well where the draws that count for the rest are below :data:`LEAST_SHARE` of all: few of a proposal that was
    made for all answers reach where the pair forbids, and neither their number nor k-hat then says how far the mean is off.

    From the log likelihood of each pair, (draws, pairs), -inf where the draw makes its answers impossible; log weights, (draws,), of prior
    over proposal density, unnormalised; and `withheld`, (pairs,), those without which the posterior may have mass where no draw is.
    """
    tried = (np.asarray(n_trials)[None] > 0).astype(np.int64)
    impossible = np.isneginf(log_likelihood)
    possible, walls = np.where(impossible, 0.0, log_likelihood), impossible.sum(axis=1)
    whole = log_weights + possible.sum(axis=1)
    log_all = logsumexp(whole[walls == 0])
    values, k = np.full(tried.shape, np.nan), np.full(tried.shape, np.nan)
    for pair in np.flatnonzero(tried[0]):
        rest = np.where(walls > impossible[:, pair], -np.inf, whole - possible[:, pair])
        smoothed, k[0, pair] = smoothed_unnormalised(rest)
        if (
            not withheld[pair]
            and k[0, pair] <= trusted_k(len(rest))
            and efficiency(rest) >= LEAST_SHARE
        ):
            values[0, pair] = log_all - logsumexp(smoothed)
    return LeaveOneOut(values, tried, k, _note("pair", values, tried, k))


def log_evidence_without(
    target: Target,
    pair: int,
    rng: np.random.Generator,
    *,
    fitted: FittedProposal | None = None,
    starts: FloatArray | None = None,
) -> float | None:
    """Of all answers but those to one pair, by a fit without it; None where that is withheld.

    It begins with `fitted`, that to all answers, or with the maxima to which `starts` lead. Beginning at the maxima of all answers, where
    a wall falls, loses none that the grid of starts would find, and costs a third.
    """
    subject, kept = target.subject, np.arange(target.subject.n_pairs) != pair
    if not kept.any():
        return 0.0  # no answers: their probability is 1
    columns = ("s1", "s2", "n_yes", "n_trials", *(() if subject.isi is None else ("isi",)))
    rest = target.for_subject(
        replace(subject, **{key: getattr(subject, key)[kept] for key in columns})
    )
    moved = None if fitted is None else _moved(fitted, rest)
    return importance_evidence(
        fit_proposal(rest, rng, start=moved or find_maxima(rest, starts), draws=_JUDGING)
    ).value


def thinning(draws: int, pairs: int) -> int:
    """Every so-many-th draw is enough where pairs are many."""
    return max(1, -(-draws // max(LEAST_DRAWS, VALUES // pairs)))


def _elsewhere(target: Target, maxima: Maxima) -> BoolArray:
    """Pairs, shape (pairs,), without which a maximum that draws do not show rises, and is near the best even before it has moved."""
    x = maxima.all
    value = target.log_density(x)
    without = value[:, None] - target.pair_log_likelihood(x)
    shown = value > value.max() - _SHOWN
    below = without[~shown] - without[shown].max(axis=0)
    risen = below - (value[~shown, None] - value.max())
    return np.asarray(((below > -_NEAR) & (risen > _RISEN)).any(axis=0))


def _moved(fitted: FittedProposal, rest: Target) -> FittedProposal | None:
    """The proposal and draws of it as those of another posterior of the model; None where too few of them count."""
    some = fitted.draws.part(slice(_START))
    draws = replace(some, log_posterior=rest.log_likelihood(some.x) + some.log_prior)
    share = efficiency(draws.log_weights)
    if share * len(draws.x) < _LEAST_START:
        return None
    return FittedProposal(
        replace(fitted.proposal, posterior=rest), draws, share, pareto_k=float("nan")
    )
