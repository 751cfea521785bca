"""The group-level test of an order effect: how much likelier a wrong answer is in one order than in the other, on the population's average.

    E[q(c, r) - q(r, c)],    r the weaker stimulus, c the stronger one, q the probability of the wrong answer, as 'equal' is,

over subjects eta = m + x' beta + tau L u of the population, for every draw of m, beta, tau and L. The expectation over u is a sum over
Sobol points, the same for every draw and every level, so that its error hardly enters differences between levels; that over x is over the
covariates that the group has. Where offsets count from each subject's own mean, a pair is as far from it as for those who met the pair.
The sign is that of :mod:`bayes_toe.classical.asymmetry`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import qmc

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.data.messages import bare
from bayes_toe.data.study import Subject
from bayes_toe.groups.joint import scatter_named
from bayes_toe.groups.subjects import centre_of
from bayes_toe.seeds import generator

if TYPE_CHECKING:
    from bayes_toe.groups.population import Population

MOST_DRAWS = 1000
_SCORES = 128  # and as many again on the other side: errors of about a tenth of the posterior's sd where subjects differ much
_AT_ONCE = 1 << 20  # values of one temporary array
_AFFORDABLE = 1 << 28  # probabilities in all; of a study with very many pairs fewer draws are taken


@dataclass(frozen=True, eq=False)
class Asymmetries:
    """Draws of the population's asymmetries, shape (chains, kept, levels, comparisons); `kept`: which draws of each chain.

    The first level is the whole population, "", then follow 'group A', 'group B', 'group B - A', 'age +1 sd - mean', of which some are
    differences. The first comparison is the mean over all others, one for each pair of different stimuli that was presented in both orders.
    Whose probabilities says `answer`: 'equal', which is wrong of different stimuli whatever their order, or 'wrong', where that depends on
    the order. For each draw `new_subject` is the mean over comparisons of one further subject, with the covariates of one that there is.
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
    pairs, far = _both_orders(found)
    if not len(pairs):
        return None
    met = np.concatenate(
        [pairs[:, [1, 0, *range(2, pairs.shape[1])]], pairs]
    )  # stronger first, then weaker first
    met[:, :2] -= np.tile(far, 2)[:, None]
    met, places = np.unique(met, axis=0, return_inverse=True)
    strong, weak = places.reshape(2, -1)
    nothing = np.zeros(len(met), int)
    shown = Subject(
        "population",
        met[:, 0],
        met[:, 1],
        nothing,
        nothing + 1,
        *met[:, 2:].T,
        task=found.study.task,
    )
    posterior, right = found.typical.for_subject(shown), shown.task.right(shown.s2 - shown.s1)
    answer = "wrong" if right.max() > 0 else shown.task.yes

    def asymmetry(eta: FloatArray) -> FloatArray:
        """Of subjects, (draws, scores, k) -> (draws, scores, comparisons)."""
        yes, no = posterior.log_answers(posterior.from_group(eta.reshape(-1, eta.shape[-1]))[0])
        wrong = np.exp(np.where(right > 0, no, yes)).reshape(*eta.shape[:2], -1)
        return np.asarray(wrong[:, :, strong] - wrong[:, :, weak])

    (scores, whose), own, k = _scores(found), found.chains, len(found.names)
    labels, of, less = zip(*_levels(found, whose), strict=True)
    differences = tuple(x is not None for x in less)
    work = 4 * _SCORES * len(pairs) * (len(labels) + sum(differences))
    kept = spaced(len(own.mean), own.mean.shape[1], min(MOST_DRAWS, _AFFORDABLE // work))
    lead, rows = (len(own.mean), len(kept)), max(1, _AT_ONCE // (2 * len(pairs) * len(scores)))
    flat = [
        part[:, kept].reshape(lead[0] * lead[1], -1, k)
        for part in (own.mean, own.scatter, own.effects, own.root)
    ]

    def average(x: FloatArray) -> FloatArray:
        parts = []
        for i in range(0, len(flat[0]), rows):
            m, tau, beta, factor = (part[i : i + rows] for part in flat)
            parts.append(
                asymmetry(m + x @ beta + tau * (scores @ factor.swapaxes(1, 2))).mean(axis=1)
            )
        return np.concatenate(parts)

    draws = np.stack(
        [average(x) - (0.0 if y is None else average(y)) for x, y in zip(of, less, strict=True)],
        axis=1,
    )
    whole = np.concatenate([draws.mean(axis=2, keepdims=True), draws], axis=2).reshape(
        *lead, len(labels), -1
    )
    rng = generator(found.settings.seed, "population", "covariates of a new subject")
    further = found.new_subject(
        found.regressors.x[rng.integers(len(found.study), size=own.mean.shape[:2])]
    )
    of_further = asymmetry(further[:, kept].reshape(-1, 1, k)).mean(axis=(1, 2)).reshape(lead)
    comparisons = (
        f"P({answer}) stronger first less weaker first",
        *(_label(answer, pair) for pair in pairs),
    )
    return Asymmetries(labels, differences, answer, comparisons, whole, of_further, kept)


def _both_orders(found: Population) -> tuple[FloatArray, FloatArray]:
    """Pairs that were met in both orders, and how far from the group's centre offsets count for those who met them, on average.

    A row is the weaker and the stronger stimulus, and the interval where there are any: (comparisons, 2 or 3), and (comparisons,).
    """
    met = defaultdict[tuple[float, ...], list[float]](list)
    for one in found.study:
        far = centre_of(found.model, one, found.centre) - found.centre
        for row in zip(
            *(
                getattr(one, key).tolist()
                for key in ("s1", "s2", "isi")
                if getattr(one, key) is not None
            ),
            strict=True,
        ):
            met[row].append(far)
    other = {row: (row[1], row[0], *row[2:]) for row in met if row[0] < row[1]}
    pairs = sorted(row for row in other if other[row] in met)
    return np.array(pairs), np.array([np.mean(met[row] + met[other[row]]) for row in pairs])


def _label(answer: str, pair: FloatArray) -> str:
    weak, strong, *isi = (f"{value:.6g}" for value in pair.tolist())
    return f"P({answer}) {strong} then {weak} less {weak} then {strong}" + "".join(
        f", {one} s" for one in isi
    )


# --- Whom to average over -------------------------------------------------------------------------


def _levels(
    found: Population, whose: IndexArray
) -> Iterator[tuple[str, FloatArray, FloatArray | None]]:
    """The population with its own mix of covariates, then with one of them set to a level, the others as they are.

    Each with the regressors of every score, shape (scores, r), and of a difference those of what it is the difference to.
    """
    who, mix = found.regressors, found.regressors.x[whose]
    yield "", mix, None
    for name in dict.fromkeys(column.covariate for column in who.columns):
        places = [i for i, column in enumerate(who.columns) if column.covariate == name]
        reference = mix.copy()
        reference[:, places] = 0.0
        at = {who.columns[i].label: reference + (np.arange(mix.shape[1]) == i) for i in places}
        first = who.columns[places[0]]
        if not first.level:
            yield f"{first.label} +1 sd - mean", at[first.label], reference
            continue
        yield f"{bare(name)} {bare(first.reference)}", reference, None
        yield from ((label, x, None) for label, x in at.items())
        yield from ((f"{label} - {bare(first.reference)}", x, reference) for label, x in at.items())


def _scores(found: Population) -> tuple[FloatArray, IndexArray]:
    """Scores u, shape (scores, k), and whose covariates each has; every score with its opposite, so that what is odd in u cancels."""
    k = len(found.names)
    cube = qmc.Sobol(k + 1, scramble=False).random(_SCORES) + 0.5 / _SCORES
    u, whose = (
        scatter_named(found.settings.scatter).quantile(cube[:, :k]),
        (cube[:, k] * len(found.study)).astype(np.intp),
    )
    return np.concatenate([u, -u]), np.concatenate([whose, whose])


def spaced(chains: int, draws: int, most: int) -> IndexArray:
    """Draws of each chain, evenly spaced, at most so many in all chains, and at least four of each.

    Examples
    --------
    >>> spaced(16, 600, 1000)[:3].tolist(), len(spaced(16, 600, 1000))
    ([0, 10, 20], 60)
    """
    return np.arange(0, draws, -(-draws // max(4, most // chains)))
