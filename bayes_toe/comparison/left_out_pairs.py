"""Log predictive density of pairs left out, from the proposal that was fitted to all answers.

Its draws are independent, its cover and its share of the prior reach beyond the posterior, and their weights without a pair are known as
exactly as those with it: a mean of them is the evidence of the other answers. Where too few of them count, a proposal is fitted to these
answers, beginning with the one for all.

Where stimuli that seem the same are never called 'different', a pair that was is a wall between offsets, and the other answers may have
their mass beyond it, where no draw is: nothing that is computed from draws would tell. Maxima that all answers together make hopeless do:
where one of them comes near the best without the pair, a proposal is fitted to the other answers from the maxima to which they lead.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.comparison.leave_one_out import LeaveOneOut, weighted_pairs
from bayes_toe.data.study import Subject
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import Evidence, importance_evidence
from bayes_toe.inference.modes import Maxima, find_maxima
from bayes_toe.inference.proposal import FittedProposal, efficiency
from bayes_toe.model.target import Target
from bayes_toe.seeds import generator

#: Values of one array of log probabilities; draws are thinned to stay below, to no fewer than the least.
VALUES, LEAST_DRAWS = 5_000_000, 1000
_MOST_REFITS = 10  # a model that more pairs surprise describes the answers badly, which the other columns show
#: Nats below the best at which a maximum still has draws, and at which one may matter once it has moved; by how much it rises at least.
_SHOWN, _NEAR, _RISEN = 5.0, 8.0, 3.0
_JUDGING = 5000  # draws behind the evidence without a pair: uncertain by less than 0.01 then
_START, _LEAST_START = 5000, 20.0  # draws with which a refit begins, and how many must count: fewer do not show where to look


def left_out_pairs(fitted: FittedProposal, maxima: Maxima, evidence: Evidence, seed: int) -> LeaveOneOut:
    """Leave-one-out by pair of a model whose proposal can be trusted; values where weights fail come from refits, at most ten.

    `maxima` are those of the posterior of all answers.
    """
    target, subject = fitted.proposal.posterior, fitted.proposal.posterior.subject
    some = fitted.draws.part(slice(None, None, thinning(len(fitted.draws.x), subject.n_pairs)))
    elsewhere = _elsewhere(target, maxima)
    log_likelihood, log_weights = target.pair_log_likelihood(some.x), some.log_prior - some.log_proposal
    found = weighted_pairs(log_likelihood, log_weights, subject.n_trials, withheld=elsewhere)
    failed = np.flatnonzero(np.isnan(found.values[0]) & (subject.n_trials > 0)).tolist()
    if evidence.value is None or not 0 < len(failed) <= _MOST_REFITS:
        return found
    exact: dict[int, float] = {}
    for pair in failed:
        rng = generator(seed, subject.name, target.model.name, "left out", pair)
        rest = log_evidence_without(target, pair, rng, fitted=None if elsewhere[pair] else fitted, starts=maxima.all)
        if rest is not None:
            exact[pair] = evidence.value - rest
    return found.filled(exact)


def _elsewhere(target: Target, maxima: Maxima) -> BoolArray:
    """Pairs, shape (pairs,), without which a maximum that draws do not show rises, and is near the best even before it has moved."""
    x = maxima.all
    value = target.log_density(x)
    without = value[:, None] - target.pair_log_likelihood(x)
    shown = value > value.max() - _SHOWN
    below = without[~shown] - without[shown].max(axis=0)
    risen = below - (value[~shown, None] - value.max())
    return np.asarray(((below > -_NEAR) & (risen > _RISEN)).any(axis=0))


def thinning(draws: int, pairs: int) -> int:
    """Every so-many-th draw is enough where pairs are many."""
    return max(1, -(-draws // max(LEAST_DRAWS, VALUES // pairs)))


def log_evidence_without(
    target: Target, pair: int, rng: np.random.Generator, *, fitted: FittedProposal | None = None, starts: FloatArray | None = None
) -> float | None:
    """Of all answers but those to one pair, by a fit without it; None where that is withheld.

    It begins with `fitted`, that to all answers, or with the maxima to which `starts` lead. Beginning at the maxima of all answers, where
    a wall falls, loses none that the grid of starts would find, and costs a third.
    """
    kept = np.arange(target.subject.n_pairs) != pair
    if not kept.any():
        return 0.0  # no answers: their probability is 1
    rest = target.for_subject(_of_pairs(target.subject, kept))
    moved = None if fitted is None else _moved(fitted, rest)
    return importance_evidence(fit_proposal(rest, rng, start=moved or find_maxima(rest, starts), draws=_JUDGING)).value


def _of_pairs(subject: Subject, kept: BoolArray) -> Subject:
    isi = None if subject.isi is None else subject.isi[kept]
    return Subject(subject.name, subject.s1[kept], subject.s2[kept], subject.n_equal[kept], subject.n_trials[kept], isi)


def _moved(fitted: FittedProposal, rest: Target) -> FittedProposal | None:
    """The proposal and draws of it as those of another posterior of the model; None where too few of them count."""
    some = fitted.draws.part(slice(_START))
    draws = replace(some, log_posterior=rest.log_likelihood(some.x) + some.log_prior)
    share = efficiency(draws.log_weights)
    if share * len(draws.x) < _LEAST_START:
        return None
    return FittedProposal(replace(fitted.proposal, posterior=rest), draws, share, pareto_k=float("nan"))
