"""Why a design is as it is, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.planning.observers import UPDATE, Observer, of_kind
from bayes_toe.planning.study_design import StudyDesign

#: Names of the designs that are compared; the paper's pairs are moved to a range that does not lie about them.
OPTIMISED, SECOND, PAPER, FULL, RANDOM = "optimised", "second best", "the paper's pairs", "full factorial", "random pairs"
MOVED = "the paper's pairs, moved"
#: What utilities are, by the aim.
UTILITIES: Mapping[str, str] = {
    "update": "log probability to name those who update, plus expected log Bayes factor against an update of the others, nats",
    "parameters": "half the log determinant of the information about the four parameters",
    "gain": "minus log expected sd of the gain",
    "mu1": "minus log expected sd of mu1",
    "width": "minus log expected sd of log width",
}


@dataclass(frozen=True, eq=False)
class Candidate:
    """A design with what the closed form says of it.

    Attributes
    ----------
    design : StudyDesign
    utility : float
        For the aim; see :class:`bayes_toe.planning.information.Information`.
    sd : float
        Root mean square over observers of the posterior sd of what is wanted; of the pull, where the update is to be named.
    """

    design: StudyDesign
    utility: float
    sd: float


def reasons_for(candidates: Mapping[str, Candidate], people: Sequence[Observer], aim: str) -> Iterator[str]:
    """Which pairs the optimised design has and why, and what the closed form says of it and the others."""
    best = candidates[OPTIMISED]
    design = best.design
    share, apart = design.n_trials / design.total, np.abs(design.s2 - design.s1)
    firsts = ", ".join(f"{value:g} ({100 * part:.0f} %)" for value, part in _largest(design.s1, share))
    yield (
        f"first stimuli, of most trials: {firsts}; a pull moves what is remembered up from below and down from above, a constant error all "
        "of it one way, so that stimuli far apart tell the two from each other"
    )
    q = np.mean([one.equal(design) for one in of_kind(people, UPDATE)], axis=0)
    (low, high), (near, far) = (_middle(values, share) for values in (q, apart))
    yield (
        f"second stimuli: mostly {near:.2g} to {far:.2g} from the first, where those who update say 'equal' to {100 * low:.0f} to "
        f"{100 * high:.0f} % of the trials: answers that are certain beforehand tell nothing"
    )
    yield f"equal pairs: {int((apart == 0).sum())} of {design.n_pairs}, {100 * share[apart == 0].sum():.0f} % of the trials" + (
        "" if (apart == 0).any() else "; q0 is told by pairs that seem equal, which are others with a pull (to have some: --keep)"
    )
    if MOVED in candidates:
        there = candidates[MOVED].design
        yield f"{MOVED}: as far apart as the paper's, from {there.s1.min():.3g} to {there.s1.max():.3g}, amid what can be shown"
    others = "; ".join(f"{name} {one.utility:.2f}" for name, one in candidates.items() if name != OPTIMISED)
    yield f"utility ({UTILITIES[aim]}), lapses and sloped noise being unknown: {best.utility:.2f}; {others}"
    more = [name for name, one in candidates.items() if one.utility > best.utility and name not in (OPTIMISED, SECOND)]
    if more:
        yield f"{more[0]}: tell more, but are not among the admissible pairs"


def _largest(values: FloatArray, share: FloatArray) -> list[tuple[float, float]]:
    """The values with the largest shares, four at most, in ascending order."""
    different, place = np.unique(values, return_inverse=True)
    total = np.bincount(place, share)
    return sorted((float(different[i]), float(total[i])) for i in np.argsort(-total)[:4])


def _middle(values: FloatArray, share: FloatArray) -> tuple[float, float]:
    """Between which values the middle four fifths lie."""
    order = np.argsort(values)
    low, high = values[order][np.searchsorted(np.cumsum(share[order]), (0.1, 0.9))]
    return float(low), float(high)
