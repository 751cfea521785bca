"""What the draws of one subject say of answers: P(equal) in both orders over the stronger stimulus, and the axis of symmetry."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.classical.frequencies import presentation_order
from bayes_toe.data.study import Subject
from bayes_toe.inference.prediction import Predictor

#: Of every curve; with straight lines between them a bell is a bell.
POINTS = 21
_BEYOND = 0.04  # of its length, by which a curve goes on after its last pair


@dataclass(frozen=True, eq=False)
class Slice:
    """Pairs with one weaker stimulus, at one interval: what one panel of curves shows.

    Attributes
    ----------
    weaker : float
        Natural-log intensity.
    isi : float or None
        Seconds.
    pairs : array of int
        Which of the subject's pairs these are.
    x : array, shape (POINTS,)
        The stronger stimulus.
    orders : tuple of int
        Orders that have a curve: -1 weaker first, 1 stronger first, 0 equal stimuli of several intensities.
    """

    weaker: float
    isi: float | None
    pairs: IndexArray
    x: FloatArray
    orders: tuple[int, ...]

    def title(self, several: bool) -> str:
        """What tells it from others."""
        words = [f"weaker stimulus {self.weaker:.3g}"] if several else []
        return ", ".join(words + ([] if self.isi is None else [f"interval {self.isi:g} s"])).replace("-", "−")

    def equal(self, fitted: Predictor) -> FloatArray:
        """P(equal) of every draw, shape (orders, POINTS, draws)."""
        fixed = np.full_like(self.x, self.weaker)
        presented = {-1: (fixed, self.x), 1: (self.x, fixed), 0: (self.x, self.x)}
        seconds = None if self.isi is None else np.full_like(self.x, self.isi)
        return np.stack([fitted.equal(*presented[order], seconds).T for order in self.orders])


def slices(counts: Subject, most: int) -> list[Slice]:
    """The slices with the most trials of different stimuli, at most so many, in the order of weaker stimulus and interval."""
    chosen = [key for key, _ in _trials(counts).most_common(most)]
    return [_slice(counts, low, isi) for low, isi in sorted(chosen, key=lambda key: (key[0], key[1] or 0.0))]


def slice_count(counts: Subject) -> int:
    """How many slices there are."""
    return len(_trials(counts))


def _trials(counts: Subject) -> Counter[tuple[float, float | None]]:
    """Trials of different stimuli by weaker stimulus and interval; without any, of all stimuli at once."""
    weaker, order = np.minimum(counts.s1, counts.s2), presentation_order(counts)
    seconds = [None] * counts.n_pairs if counts.isi is None else counts.isi.tolist()
    found: Counter[tuple[float, float | None]] = Counter()
    for low, isi, kind, count in zip(weaker.tolist(), seconds, order.tolist(), counts.n_trials.tolist(), strict=True):
        if kind:
            found[low, isi] += count
    return found or Counter({(float(weaker.min()), seconds[0]): 1})


def _slice(counts: Subject, weaker: float, isi: float | None) -> Slice:
    low, high, order = np.minimum(counts.s1, counts.s2), np.maximum(counts.s1, counts.s2), presentation_order(counts)
    shown = (low == weaker) | ((order == 0) & (high >= weaker))
    if isi is not None:
        shown &= np.asarray(counts.isi) == isi
    top = max(float(high[shown].max()), weaker + 1e-9)
    x = np.linspace(weaker, top + _BEYOND * (top - weaker), POINTS)
    orders = [one for one in (-1, 1) if (order[shown] == one).any()]
    several = len(np.unique(high[shown & (order == 0)])) > 1 or not orders
    return Slice(weaker, isi, np.flatnonzero(shown), x, (*orders, 0) if several else tuple(orders))


def axis(quantities: Mapping[str, FloatArray], sbar: float, ends: Sequence[float]) -> FloatArray:
    """Second stimulus that seems equal to the first, at both ends of a line: s2 = s1 - p (s1 - sbar) + c, (draws,) -> (2, draws).

    At the reference interval, where there are several. Source: the distance z of :mod:`bayes_toe.model.posterior` is 0 there.
    """
    first = np.asarray(ends)[:, None]
    none = np.zeros(len(next(iter(quantities.values()))))
    return np.asarray(first - quantities.get("pull", none) * (first - sbar) + quantities.get("offset", none))
