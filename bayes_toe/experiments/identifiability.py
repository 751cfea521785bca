"""What a design can tell, whatever the answers: the rank of the model's Jacobian on the pairs presented.

With d = s2 - s1 and l = s1 - sbar, a pair has z = (d + p l - c)/w and log q = log q0 - ln2 z^2. The rows of the Jacobian with respect to
(c, p, log w, logit q0) are, up to factors, (z, z l, z^2, 1); since z^2 = z (d + p l - c)/w, they span the same directions as
(z, z l, z d, 1), that is, after division by z, as (1, l, d, 1/z). So everything hangs on the points (l, d): with n pairs that span a point,
a line or a plane (0, 1, 2 dimensions), min(n, dimensions + 2) combinations of the four parameters can be told at their generic values:

    one pair                     1    one frequency: a symmetric observer produces any
    two pairs                    2    two frequencies: with different d an offset produces any, with equal d a pull
    a line of constant l         3    p does not enter: a constant bias
    a line of constant d         3    only (d - c)/w, p/w and q0: the scale is open
    any other line d = a + b l   3    only (a - c)/w, (b + p)/w and q0: an offset and a width produce every such curve with no pull
    three pairs in a plane       3    three frequencies: with different d an offset, a width and q0 produce them
    four or more in a plane      4    everything

With intervals a pair counts at each of its intervals, and the parameters are those at the reference; several intervals tell more.
The code finds the rank and what remains open from singular values; the list above tells which model of the ladder is enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logit

from bayes_toe.arrays import FloatArray
from bayes_toe.data.conditions import mean_first
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.model.coordinates import IDENTIFIED, NATURAL
from bayes_toe.model.ladder import models_of
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior

PARAMETERS = 4
#: The model with all four, and the one without a pull.
FULL, _BIAS = "predictive update", "constant bias"
#: Relative singular value below which a direction counts as absent; stimuli that are equal up to rounding stay well below it.
_TOLERANCE = 1e-7
_STEP = 1e-5  # of differences, whose error is then a thousandth of that
#: Generic parameter values on the scale of the design: offset, pull as a share of the largest, width. No two are special.
_GENERIC = ((0.37, 0.31, 0.83), (-0.59, 0.67, 1.13), (0.13, 0.89, 1.71))


@dataclass(frozen=True)
class Identifiability:
    """What the pairs of one subject can tell.

    That are `rank` combinations of the four parameters, 1..4; the identified and natural parameters that can be told by themselves, and
    those that are open: their posterior reflects the prior, alone or in combination with others; the smallest model of the ladder that
    carries all the information, "predictive update" where none smaller does; and why, in words, empty where everything can be told.
    """

    rank: int
    told: tuple[str, ...]
    open: tuple[str, ...]
    model: str
    reason: str


def identifiability(subject: Subject) -> Identifiability:
    """Rank, open parameters and the smallest sufficient model for the pairs of one subject; the answers are not looked at.

    Examples
    --------
    >>> found = identifiability(Subject("S01", [0, 0, 0, 0], [0, 0.1, 0.2, 0.3], [9, 8, 5, 2], [9, 9, 9, 9]))
    >>> found.rank, found.model, found.open
    (3, 'constant bias', ('pull', 'mu1', 'sigma_p', 'sigma_l'))
    """
    lever, step = _points(subject)
    isi, none = subject.isi if len(subject.intervals) > 1 else None, np.zeros(len(step), np.int64)
    pairs = Subject.from_counts("pairs", lever, lever + step, none, none + 1, isi)
    target = Posterior(pairs, models_of(SAME_DIFFERENT).update, Prior(), 0.0, 1.0)
    told, rank = np.ones(len(_NAMES), np.bool_), 0
    for c, share, w in _GENERIC:
        of_answers, of_quantities = _slopes(target, np.array([c, logit(share), np.log(w), 0.0]))
        _, values, rows = np.linalg.svd(
            np.pad(of_answers, ((0, max(0, PARAMETERS - len(of_answers))), (0, 0))),
            full_matrices=False,
        )
        here = int(np.count_nonzero(values > _TOLERANCE * values[0]))
        told &= (
            np.abs(of_quantities @ rows[here:].T).max(axis=1, initial=0.0) < 1e-5
        )  # rows beyond the rank change no answer
        rank = max(rank, here)
    several = (
        FULL,
        ""
        if rank == PARAMETERS
        else "offset, pull and width at every interval follow from those at one",
    )
    model, reason = _smallest(lever, step, rank) if len(subject.intervals) <= 1 else several
    of = dict(zip(_NAMES, told.tolist(), strict=True))
    return Identifiability(
        rank,
        tuple(k for k in _NAMES if of[k]),
        tuple(k for k in _NAMES if not of[k]),
        model,
        reason,
    )


_NAMES = tuple(dict.fromkeys([*IDENTIFIED, *NATURAL]))


def _points(subject: Subject) -> tuple[FloatArray, FloatArray]:
    """(l, d) of every pair in units of the design's largest extent, so that nothing depends on the units."""
    lever = subject.s1 - mean_first(subject)
    step = subject.s2 - subject.s1
    extent = max(float(np.abs(lever).max()), float(np.abs(step).max()))
    return (lever / extent, step / extent) if extent > 0 else (lever, step)


def _slopes(target: Posterior, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Central differences of log q of every pair, (pairs, 4), and of the named quantities, (names, 4), in the model's coordinates.

    The rank is that of the derivatives of q itself, which differ by factors q > 0.
    """
    around = x + _STEP * np.concatenate([np.eye(PARAMETERS), -np.eye(PARAMETERS)])
    quantities = target.quantities(around)
    values = target.log_answers(around)[0], np.stack([quantities[name] for name in _NAMES], axis=1)
    of_answers, of_quantities = (
        (one[:PARAMETERS] - one[PARAMETERS:]).T / (2.0 * _STEP) for one in values
    )
    return of_answers, of_quantities


def _smallest(lever: FloatArray, step: FloatArray, rank: int) -> tuple[str, str]:
    """The smallest sufficient model and why, by the table of the module: the first case that applies."""
    level, flat = (bool(np.ptp(values) < _TOLERANCE) for values in (lever, step))
    points = np.stack([lever - lever[0], step - step[0]], axis=1)
    three = (
        len(step) == 3
        and np.count_nonzero(np.linalg.svd(points, compute_uv=False) > _TOLERANCE) == 2
    )  # in a plane
    open_scale = (
        "offset/width, pull/width and q0"
        if step[0] == 0
        else "(s2 - s1 - offset)/width, pull/width and q0"
    )
    cases = (
        (rank == PARAMETERS, FULL, ""),
        (
            len(step) == 1,
            "symmetric",
            "one pair gives one frequency, which a symmetric observer can produce",
        ),
        (
            len(step) == 2 and flat,
            "no lapses",
            "two pairs with the same difference s2 - s1 differ by the pull alone, and q0 = 1 loses nothing",
        ),
        (
            len(step) == 2,
            _BIAS,
            "two pairs give two frequencies, which an offset, a width and q0 can produce",
        ),
        (
            level,
            _BIAS,
            "with one first stimulus the pull only adds to the offset and does not enter",
        ),
        (
            flat,
            FULL,
            f"with one difference s2 - s1 only {open_scale} enter, so the width may be held fixed",
        ),
        (
            three and bool(np.diff(np.sort(step)).min() < _TOLERANCE),
            FULL,
            "three pairs give three frequencies, and free frequencies (H0) say as much",
        ),
        # with different d log q is a parabola in them, of any offset, width and peak; only a peak above 1 has no such observer
        (
            three,
            _BIAS,
            "three pairs give three frequencies, which an offset, a width and q0 produce unless their curve peaks above 1",
        ),
        (True, _BIAS, "along one line of pairs the pull only rescales offset and width"),
    )
    return next((model, why) for applies, model, why in cases if applies)
