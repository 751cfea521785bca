"""Where the ascents of a fit start: at the highest points of the parts of a grid.

Several maxima differ in the pull: a vanishing one with the prior mean far to either side, a middle one, the largest.
At each pull the rest is nearly determined, so that the highest grid point of a range of pulls lies close to the ridge. At points of a grid
log q and log(1 - q) of the pairs are the same for all rows: their likelihoods there are one matrix product.
"""

from __future__ import annotations

import numpy as np
from scipy.special import log_expit, logit

from bayes_toe.arrays import BLOCK, FloatArray
from bayes_toe.classical.counts import Counts, Design
from bayes_toe.classical.fits import Fits
from bayes_toe.model.closed_form import LN2, MAX_PULL

#: Parts of the grid: pulls as shares of the largest, 0 for the edge gamma = 0, and sides of the offset.
_PARTS = (
    ((0.0,), (0.0,)),
    ((0.003, 0.01, 0.03), (-1.0,)),
    ((0.003, 0.01, 0.03), (1.0,)),
    ((0.1, 0.2, 0.4), (-1.0, 1.0)),
    ((1.0,), (-1.0, 1.0)),
)
#: Of a subject's own fit: offsets and widths (log) on the scale of the design, narrow, middle and wide ones apart, and logits of q0.
_OFFSETS = (0.05, 0.15, 0.4, 1.0, 2.0)
_WIDTHS = ((-2.0, -1.5, -1.0, -0.5), (0.0, 0.5, 1.0), (1.5, 2.0, 2.5, 3.0))
_PEAKS = logit(np.array([0.05, 0.2, 0.5, 0.8, 0.95, 0.99]))
#: Of its replicates: the same from those of the fit.
_OFFSETS_AROUND = (0.02, 0.1, 0.25, 0.5, 1.0)
_WIDTHS_AROUND = (-0.8, -0.4, 0.0, 0.4, 0.8)
_PEAKS_AROUND = (-2.0, -1.0, 0.0, 1.0, 2.0)


def first_starts(design: Design, counts: Counts) -> FloatArray:
    """Starts (offset, log(p/p_max), log w, log q0) of rows of which nothing is known, shape (4, rows, 15).

    Of 66,000 rows (replicates of 43 subjects, bundled, hard and real) 7 stayed below the best that these or others led to.
    """
    scale = design.scale
    grids = [
        _points(part, scale * np.array(_OFFSETS), np.log(scale) + widths, _PEAKS) for part in _PARTS for widths in map(np.array, _WIDTHS)
    ]
    return np.stack([_highest(design, counts, points) for points in grids], axis=-1)


def replicate_starts(design: Design, fitted: Fits, counts: Counts) -> FloatArray:
    """The same for replicates of a subject, (4, rows, 6): its own fit, and the highest points around it.

    Of the same 66,000 replicates 18 stayed below the best, all of subjects whose answers leave the pull nearly open.
    """
    offset, pull, width, q0 = fitted.identified[0]
    scale = (2.0 if width > design.scale else 0.3) * design.scale
    w = width if 0.05 * design.scale < width < np.inf else scale
    peaks = logit(np.clip(q0, 0.02, 0.98)) + np.array(_PEAKS_AROUND)
    grids = [_points(part, w * np.array(_OFFSETS_AROUND), np.log(w) + np.array(_WIDTHS_AROUND), peaks) for part in _PARTS]
    own = np.empty((4, len(counts.equal)))
    own[:3] = [[offset], [min(0.0, np.log(max(pull / MAX_PULL, 1e-4)))], [np.log(w)]]
    own[3] = np.log(((counts.equal + 1.0) / (counts.equal + counts.different + 2.0)).max(axis=1))
    return np.stack([own, *(_highest(design, counts, points) for points in grids)], axis=-1)


def _points(
    part: tuple[tuple[float, ...], tuple[float, ...]], offsets: FloatArray, log_widths: FloatArray, peaks: FloatArray
) -> FloatArray:
    """Points of a part of a grid, (4, points)."""
    shares, sides = part
    with np.errstate(divide="ignore"):
        axes = np.meshgrid(np.unique(np.outer(sides, offsets)), np.log(shares), log_widths, log_expit(peaks))
    return np.stack([axis.ravel() for axis in axes])


def _highest(design: Design, counts: Counts, points: FloatArray) -> FloatArray:
    """The point that is highest for each row, (4, rows)."""
    c, log_share, log_width, log_q0 = points[..., None]
    p = MAX_PULL * np.exp(log_share)
    t = LN2 * np.square(((design.s2 - design.s1) + p * (design.s1 - design.sbar) - c) * np.exp(-log_width))
    table = np.concatenate([log_q0 - t, np.log(-np.expm1(log_q0) - np.exp(log_q0) * np.expm1(-t))], axis=1).T
    mu1 = design.sbar + np.divide(c, p, out=np.full_like(c, design.penalty.mean - design.sbar), where=p > 0.0)
    penalty = 0.5 * np.square((mu1[:, 0] - design.penalty.mean) / design.penalty.sd)
    answers, size = np.concatenate(counts, axis=1), max(1, 4 * BLOCK // points.shape[1])
    best = [(answers[i : i + size] @ table - penalty).argmax(axis=1) for i in range(0, len(answers), size)]
    return points[:, np.concatenate(best)]
