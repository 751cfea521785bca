"""The group-level test of an order effect: how much likelier 'equal' is in one order than in the other, on the population's average.

    E[q(c, r) - q(r, c)],    r the weaker stimulus, c the stronger one,

over subjects eta = m + x' beta + tau L u of the population, for every draw of m, beta, tau and L. The expectation over u is a sum over a
fixed set of scores, the same for every draw and every level, so that its error hardly enters differences between levels; that over x is
over the covariates that the group has. The sign is that of :mod:`bayes_toe.classical.asymmetry`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.data.messages import bare
from bayes_toe.data.study import Study, Subject
from bayes_toe.groups.scatter import scatter_named
from bayes_toe.model.posterior import Posterior
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    from bayes_toe.groups.population import Population

#: The mean over all comparisons.
OVERALL = "P(equal) stronger first less weaker first"
MOST_DRAWS = 1000
_SCORES = 128  # and as many again on the other side: errors of about a tenth of the posterior's sd where subjects differ much
_AT_ONCE = 1 << 20  # values of one temporary array
_AFFORDABLE = 1 << 28  # probabilities in all; of a study with very many pairs fewer draws are taken


class Level(NamedTuple):
    """Which part of the population: regressors of every score, shape (scores, r); where `less` is given, the difference to those."""

    label: str
    x: FloatArray
    less: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Asymmetries:
    """Draws of the population's asymmetries.

    Attributes
    ----------
    levels : tuple of str
        "" for the whole population, then 'group A', 'group B', 'group B - A', 'age +1 sd - mean'.
    differences : tuple of bool
        Which of them are differences.
    comparisons : tuple of str
        :data:`OVERALL`, then every pair of different stimuli that was presented in both orders.
    draws : array, shape (chains, kept, levels, comparisons)
    new_subject : array, shape (chains, kept)
        The mean over comparisons of one further subject for each draw, with the covariates of one that there is.
    kept : array of int, shape (kept,)
        Which draws of each chain.
    """

    levels: tuple[str, ...]
    differences: tuple[bool, ...]
    comparisons: tuple[str, ...]
    draws: FloatArray
    new_subject: FloatArray
    kept: IndexArray


def asymmetries(found: Population, pairs: FloatArray | None = None) -> Asymmetries | None:
    """Of a population; None where no pair of different stimuli was presented in both orders.

    `pairs`, weaker and stronger stimulus and interval where there are any, (comparisons, 2 or 3), asks for these instead.
    """
    pairs = _both_orders(found.study) if pairs is None else pairs
    if not len(pairs):
        return None
    shown, places = _shown_both_ways(pairs)
    posterior = found.posterior(found.study.names[0]).for_subject(shown)
    levels = list(_levels(found))
    kept = _kept(found, len(pairs) * sum(2 if one.less is not None else 1 for one in levels))
    own = found.chains
    mean, scatter, effects, root = (part[:, kept] for part in (own.mean, own.scatter, own.effects, own.root))
    lead, k = mean.shape[:2], mean.shape[-1]
    scores, _ = _scores(found)
    flat = mean.reshape(-1, k), scatter.reshape(-1, k), effects.reshape(len(mean) * len(kept), -1, k), root.reshape(-1, k, k)

    def average(x: FloatArray) -> FloatArray:
        rows = max(1, _AT_ONCE // (2 * len(pairs) * len(scores)))
        parts = []
        for i in range(0, len(flat[0]), rows):
            m, tau, beta, factor = (part[i : i + rows] for part in flat)
            eta = m[:, None] + x @ beta + tau[:, None] * (scores @ factor.swapaxes(1, 2))
            parts.append(_asymmetry(posterior, eta, places).mean(axis=1))
        return np.concatenate(parts)

    draws = np.stack([average(one.x) - (0.0 if one.less is None else average(one.less)) for one in levels], axis=1)
    further = _asymmetry(posterior, _further(found)[:, kept].reshape(-1, 1, k), places).mean(axis=(1, 2)).reshape(lead)
    whole = np.concatenate([draws.mean(axis=2, keepdims=True), draws], axis=2)
    names = (OVERALL, *(_label(pair) for pair in pairs))
    labels, differences = zip(*((one.label, one.less is not None) for one in levels), strict=True)
    return Asymmetries(labels, differences, names, whole.reshape(*lead, *whole.shape[1:]), further, kept)


def _asymmetry(posterior: Posterior, eta: FloatArray, places: IndexArray) -> FloatArray:
    """q(c, r) - q(r, c) of subjects, (draws, scores, k) -> (draws, scores, comparisons)."""
    x, _ = posterior.from_group(eta.reshape(-1, eta.shape[-1]))
    equal = np.exp(posterior.log_answers(x)[0]).reshape(*eta.shape[:2], -1)
    return np.asarray(equal[:, :, places[0]] - equal[:, :, places[1]])


def _further(found: Population) -> FloatArray:
    """A further subject for each draw, with the covariates of one that there is, shape (chains, draws, k)."""
    rng = generator(found.settings.seed, "population", "covariates of a new subject")
    x = found.regressors.x[rng.integers(len(found.study), size=found.chains.mean.shape[:2])]
    return found.new_subject(x)


# --- Comparisons ----------------------------------------------------------------------------------


def _both_orders(study: Study) -> FloatArray:
    """Weaker and stronger stimulus, and interval where there are any, of pairs that somebody met in both orders: (comparisons, 2 or 3)."""
    keys = ("s1", "s2", "isi") if study.intervals else ("s1", "s2")
    every = [np.column_stack([getattr(one, key) for key in keys]) for one in study]
    shown = {tuple(row) for row in np.unique(np.concatenate(every), axis=0).tolist()}
    return np.array(sorted(row for row in shown if row[0] < row[1] and (row[1], row[0], *row[2:]) in shown))


def _shown_both_ways(pairs: FloatArray) -> tuple[Subject, IndexArray]:
    """Somebody without answers to whom all pairs were shown; which of its pairs are those with the stronger first, then the others."""
    s1, s2 = pairs[:, [1, 0]].T.ravel(), pairs[:, [0, 1]].T.ravel()
    isi = [np.tile(column, 2) for column in pairs[:, 2:].T]
    shown = Subject("population", s1, s2, np.zeros(len(s1), int), np.ones(len(s1), int), *isi)
    return shown, np.argsort(np.lexsort([*isi[::-1], s2, s1])).reshape(2, -1)  # a subject has its pairs in this order


def _label(pair: FloatArray) -> str:
    weak, strong, *isi = (f"{value:.6g}" for value in pair.tolist())
    return f"P(equal) {strong} then {weak} less {weak} then {strong}" + "".join(f", {one} s" for one in isi)


# --- Whom to average over -------------------------------------------------------------------------


def _levels(found: Population) -> Iterator[Level]:
    """The population with its own mix of covariates, then with one of them set to a level, the others as they are."""
    who, mix = found.regressors, found.regressors.x[_scores(found)[1]]
    yield Level("", mix)
    for name in dict.fromkeys(column.covariate for column in who.columns):
        places = [i for i, column in enumerate(who.columns) if column.covariate == name]
        first = who.columns[places[0]]
        reference = _set(mix, places)
        if not first.level:
            yield Level(f"{first.label} +1 sd - mean", _set(mix, places, places[0]), reference)
            continue
        words = {None: bare(first.reference)} | {i: bare(who.columns[i].level) for i in places}
        at = {i: _set(mix, places, i) for i in words}
        yield from (Level(f"{bare(name)} {word}", at[i]) for i, word in words.items())
        yield from (Level(f"{bare(name)} {words[i]} - {words[None]}", at[i], reference) for i in places)


def _set(mix: FloatArray, places: list[int], one: int | None = None) -> FloatArray:
    """Regressors with those of one covariate at 0, or one of them at 1."""
    x = mix.copy()
    x[:, places] = 0.0
    if one is not None:
        x[:, one] = 1.0
    return x


def _scores(found: Population) -> tuple[FloatArray, IndexArray]:
    """Scores u, shape (scores, k), and whose covariates each has; every score with its opposite, so that what is odd in u cancels.

    Points of a Kronecker sequence, which fill the unit cube evenly: shifts by the powers of 1/g, g^(d + 1) = g + 1.
    """
    k, n = len(found.names), len(found.study)
    g = 2.0
    for _ in range(60):
        g = (1.0 + g) ** (1.0 / (k + 2))
    cube = (0.5 + np.arange(1, _SCORES + 1)[:, None] * g ** -np.arange(1.0, k + 2)) % 1.0
    u = scatter_named(found.settings.scatter).quantile(cube[:, :k])
    whose = (cube[:, k] * n).astype(np.intp)
    return np.concatenate([u, -u]), np.concatenate([whose, whose])


def _kept(found: Population, comparisons: int) -> IndexArray:
    """Which draws of each chain: of a study with very many pairs fewer."""
    chains, draws, _ = found.chains.mean.shape
    return spaced(chains, draws, min(MOST_DRAWS, _AFFORDABLE // (4 * _SCORES * comparisons)))


def spaced(chains: int, draws: int, most: int) -> IndexArray:
    """Draws of each chain, evenly spaced, at most so many in all chains, and at least four of each.

    Examples
    --------
    >>> spaced(16, 600, 1000)[:3].tolist(), len(spaced(16, 600, 1000))
    ([0, 10, 20], 60)
    """
    return np.arange(0, draws, -(-draws // max(4, most // chains)))
