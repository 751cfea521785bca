"""The group-level test of an order effect: how much likelier a wrong answer is in one order than in the other, on the population's average.

    E[q(c, r) - q(r, c)],    r the weaker stimulus, c the stronger one, q the probability of the wrong answer, as 'equal' is,

over subjects eta = m + x' beta + tau L u of the population, for every draw of m, beta, tau and L. The expectation over u is a sum over
Sobol points, the same for every draw and every level, so that its error hardly enters differences between levels; that over x is over the
covariates that the group has. The sign is that of :mod:`bayes_toe.classical.asymmetry`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.stats import qmc

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.data.messages import bare
from bayes_toe.data.study import Study, Subject
from bayes_toe.groups.joint import scatter_named
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    from bayes_toe.groups.population import Population

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
    answer : str
        Whose probabilities: 'equal', which is wrong of different stimuli whatever their order; 'wrong', where that depends on the order.
    comparisons : tuple of str
        The mean over all, then every pair of different stimuli that was presented in both orders.
    draws : array, shape (chains, kept, levels, comparisons)
    new_subject : array, shape (chains, kept)
        The mean over comparisons of one further subject for each draw, with the covariates of one that there is.
    kept : array of int, shape (kept,)
        Which draws of each chain.
    """

    levels: tuple[str, ...]
    differences: tuple[bool, ...]
    answer: str
    comparisons: tuple[str, ...]
    draws: FloatArray
    new_subject: FloatArray
    kept: IndexArray


def asymmetries(found: Population) -> Asymmetries | None:
    """Of a population; None where no pair of different stimuli was presented in both orders."""
    pairs = _both_orders(found.study)
    if not len(pairs):
        return None
    s1, s2 = pairs[:, [1, 0]].T.ravel(), pairs[:, [0, 1]].T.ravel()
    isi = [np.tile(column, 2) for column in pairs[:, 2:].T]
    shown = Subject("population", s1, s2, np.zeros(len(s1), int), np.ones(len(s1), int), *isi, task=found.study.task)
    strong, weak = np.argsort(np.lexsort([*isi[::-1], s2, s1])).reshape(2, -1)  # where a subject, who has pairs in order, has them
    posterior, right = found.typical.for_subject(shown), shown.task.right(shown.s2 - shown.s1)
    answer = "wrong" if right.max() > 0 else shown.task.yes

    def asymmetry(eta: FloatArray) -> FloatArray:
        """Of subjects, (draws, scores, k) -> (draws, scores, comparisons)."""
        yes, no = posterior.log_answers(posterior.from_group(eta.reshape(-1, eta.shape[-1]))[0])
        wrong = np.exp(np.where(right > 0, no, yes)).reshape(*eta.shape[:2], -1)
        return np.asarray(wrong[:, :, strong] - wrong[:, :, weak])

    (scores, whose), own, k = _scores(found), found.chains, len(found.names)
    levels = list(_levels(found, whose))
    work = 4 * _SCORES * len(pairs) * sum(2 if one.less is not None else 1 for one in levels)
    kept = spaced(len(own.mean), own.mean.shape[1], min(MOST_DRAWS, _AFFORDABLE // work))
    lead, rows = (len(own.mean), len(kept)), max(1, _AT_ONCE // (2 * len(pairs) * len(scores)))
    flat = [part[:, kept].reshape(lead[0] * lead[1], -1, k) for part in (own.mean, own.scatter, own.effects, own.root)]

    def average(x: FloatArray) -> FloatArray:
        parts = []
        for i in range(0, len(flat[0]), rows):
            m, tau, beta, factor = (part[i : i + rows] for part in flat)
            parts.append(asymmetry(m + x @ beta + tau * (scores @ factor.swapaxes(1, 2))).mean(axis=1))
        return np.concatenate(parts)

    draws = np.stack([average(one.x) - (0.0 if one.less is None else average(one.less)) for one in levels], axis=1)
    whole = np.concatenate([draws.mean(axis=2, keepdims=True), draws], axis=2).reshape(*lead, len(levels), -1)
    rng = generator(found.settings.seed, "population", "covariates of a new subject")
    further = found.new_subject(found.regressors.x[rng.integers(len(found.study), size=own.mean.shape[:2])])
    of_further = asymmetry(further[:, kept].reshape(-1, 1, k)).mean(axis=(1, 2)).reshape(lead)
    labels, differences = zip(*((one.label, one.less is not None) for one in levels), strict=True)
    comparisons = (f"P({answer}) stronger first less weaker first", *(_label(answer, pair) for pair in pairs))
    return Asymmetries(labels, differences, answer, comparisons, whole, of_further, kept)


def _both_orders(study: Study) -> FloatArray:
    """Weaker and stronger stimulus, and interval where there are any, of pairs that somebody met in both orders: (comparisons, 2 or 3)."""
    keys = ("s1", "s2", "isi") if study.intervals else ("s1", "s2")
    every = [np.column_stack([getattr(one, key) for key in keys]) for one in study]
    shown = {tuple(row) for row in np.unique(np.concatenate(every), axis=0).tolist()}
    return np.array(sorted(row for row in shown if row[0] < row[1] and (row[1], row[0], *row[2:]) in shown))


def _label(answer: str, pair: FloatArray) -> str:
    weak, strong, *isi = (f"{value:.6g}" for value in pair.tolist())
    return f"P({answer}) {strong} then {weak} less {weak} then {strong}" + "".join(f", {one} s" for one in isi)


# --- Whom to average over -------------------------------------------------------------------------


def _levels(found: Population, whose: IndexArray) -> Iterator[Level]:
    """The population with its own mix of covariates, then with one of them set to a level, the others as they are."""
    who, mix = found.regressors, found.regressors.x[whose]
    yield Level("", mix)
    for name in dict.fromkeys(column.covariate for column in who.columns):
        places = [i for i, column in enumerate(who.columns) if column.covariate == name]
        reference = mix.copy()
        reference[:, places] = 0.0
        at = {i: reference + (np.arange(mix.shape[1]) == i) for i in places}
        first = who.columns[places[0]]
        if not first.level:
            yield Level(f"{first.label} +1 sd - mean", at[places[0]], reference)
            continue
        yield Level(f"{bare(name)} {bare(first.reference)}", reference)
        yield from (Level(who.columns[i].label, at[i]) for i in places)
        yield from (Level(f"{who.columns[i].label} - {bare(first.reference)}", at[i], reference) for i in places)


def _scores(found: Population) -> tuple[FloatArray, IndexArray]:
    """Scores u, shape (scores, k), and whose covariates each has; every score with its opposite, so that what is odd in u cancels."""
    k = len(found.names)
    cube = qmc.Sobol(k + 1, scramble=False).random(_SCORES) + 0.5 / _SCORES
    u, whose = scatter_named(found.settings.scatter).quantile(cube[:, :k]), (cube[:, k] * len(found.study)).astype(np.intp)
    return np.concatenate([u, -u]), np.concatenate([whose, whose])


def spaced(chains: int, draws: int, most: int) -> IndexArray:
    """Draws of each chain, evenly spaced, at most so many in all chains, and at least four of each.

    Examples
    --------
    >>> spaced(16, 600, 1000)[:3].tolist(), len(spaced(16, 600, 1000))
    ([0, 10, 20], 60)
    """
    return np.arange(0, draws, -(-draws // max(4, most // chains)))
