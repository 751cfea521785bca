"""One chain rule for the log likelihood of every model: link x distance x propagator.

The normalised distance is z = N e^(-L) with the numerator N = step + r (p lever - c) and the log of the width L = b + log v; r and v are
the scales of a pair's interval (:mod:`bayes_toe.model.propagators`). For coordinates i and k of N and L

    z_i   = N_i h - z L_i,                                                      h = e^(-L)
    z_ik  = N_ik h - N_i h L_k - N_k h L_i + z (L_i L_k - L_ik),

so that the log likelihood A(z, l) of a link with own coordinates l, the peak's logit and others, has, with S = (z A_z)_z = A_z + z A_zz,

    A_i  = A_z N_i h - z A_z L_i
    A_ik = A_zz N_i h N_k h + A_z N_ik h - S (N_i h L_k + N_k h L_i) + z S L_i L_k - z A_z L_ik.

S enters whole: its two terms cancel where answers are surprising, and the link forms it without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.model.decay import Jet
from bayes_toe.model.links import Logarithm, Rise
from bayes_toe.model.propagators import Growth, Scales

Derivatives = tuple[FloatArray, FloatArray]
Place = TypeVar("Place", int, tuple[int, int])


@dataclass(eq=False)
class Distance:
    """z with the derivatives of its parts by the place of the coordinate; what is absent is 0. Arrays broadcast to (points, pairs).

    Attributes
    ----------
    z : array, shape (points, pairs)
    numerator, log_width : dict of place to array
        N_i h and L_i.
    numerator_bend, log_width_bend : dict of (place, place) to array
        N_ik h and L_ik; each pair of places once, in ascending order.
    """

    z: FloatArray
    numerator: dict[int, FloatArray] = field(default_factory=dict)
    numerator_bend: dict[tuple[int, int], FloatArray] = field(default_factory=dict)
    log_width: dict[int, FloatArray] = field(default_factory=dict)
    log_width_bend: dict[tuple[int, int], FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Pulled:
    """Offset and pull as the numerator of z has them: c - p lever, with the places of their coordinates (None: not free).

    Offset and pull come with their derivatives, each in its coordinate, shape (points, 1).
    """

    lever: FloatArray
    offset: Jet
    pull: Jet
    offset_place: int | None
    pull_place: int | None


def add_numerator(distance: Distance, of: Pulled, h: FloatArray, scales: Scales) -> None:
    """Fill in N_i h and N_ik h at fixed scales r."""
    per = scales.pull * h
    if of.offset_place is not None:
        distance.numerator[of.offset_place] = -of.offset.first * per
        distance.numerator_bend[of.offset_place, of.offset_place] = -of.offset.second * per
    if of.pull_place is not None:
        distance.numerator[of.pull_place] = of.pull.first * of.lever * per
        distance.numerator_bend[of.pull_place, of.pull_place] = of.pull.second * of.lever * per


def add_growth(distance: Distance, of: Pulled, per: FloatArray, growth: Growth, places: tuple[int, ...]) -> None:
    """What the scales' dependence on the coordinates at these places adds; per is r h.

    (r p)_i = r (p_i + p rho_i) and r_i = r rho_i with rho = log r, and so on; log v enters L.
    """
    pulled = per * (of.pull.value * of.lever - of.offset.value)
    for i, place in enumerate(places):
        _add(distance.numerator, place, pulled * growth.pull[i])
        _add(distance.log_width, place, growth.width[i])
        if of.offset_place is not None:
            _add(distance.numerator_bend, _pair(of.offset_place, place), -of.offset.first * per * growth.pull[i])
        if of.pull_place is not None:
            twice = 2.0 if of.pull_place == place else 1.0
            _add(distance.numerator_bend, _pair(of.pull_place, place), twice * of.pull.first * of.lever * per * growth.pull[i])
        for k, other in enumerate(places[: i + 1]):
            bend = growth.pull_bend[i, k] + growth.pull[i] * growth.pull[k]
            _add(distance.numerator_bend, _pair(place, other), pulled * bend)
            _add(distance.log_width_bend, _pair(place, other), growth.width_bend[i, k])


def likelihood_derivatives(distance: Distance, of: Logarithm, own: Sequence[int | None], k: int) -> Derivatives:
    """Gradient (points, k) and Hessian (points, k, k) of the log likelihood.

    `own` has the places of the link's own coordinates, None for one that is fixed.
    """
    z = distance.z
    gradient, hessian = likelihood_gradient(distance, of, own, k), np.zeros((len(z), k, k))
    steep, level = (_finished(part, z) for part in (of.z, of.stretch))
    (at_n, n), (at_w, w) = (_stacked(part, z) for part in (distance.numerator, distance.log_width))
    free = [(m, place) for m, place in enumerate(own) if place is not None]
    at_own, mixed = _stacked({place: of.z_own[m] for m, place in free}, z)
    _add_products(hessian, at_n, at_n, _finished(of.zz, n), n)
    _add_products(hessian, at_n, at_w, _finished(-of.stretch, n), w, mirrored=True)
    _add_products(hessian, at_w, at_w, _finished(level, w), w)
    _add_products(hessian, at_own, at_n, mixed, n, mirrored=True)
    _add_products(hessian, at_own, at_w, _finished(-mixed, z), w, mirrored=True)
    for slope, bends in ((of.z, distance.numerator_bend), (-steep, distance.log_width_bend)):
        for at, bend in bends.items():
            _add_symmetric(hessian, at, _finished(slope, bend).sum(axis=1))
    for m, place in free:
        for i, other in free:
            if i <= m:
                _add_symmetric(hessian, (place, other), _over_pairs(of.own_own[m][i], distance))
    return gradient, hessian


def likelihood_gradient(distance: Distance, of: Logarithm | Rise, own: Sequence[int | None], k: int) -> FloatArray:
    """The gradient alone, shape (points, k)."""
    gradient, steep = np.zeros((len(distance.z), k)), _finished(of.z, distance.z)
    for place, part in distance.numerator.items():
        gradient[:, place] += _finished(of.z, part).sum(axis=-1)
    for place, part in distance.log_width.items():
        gradient[:, place] -= _finished(steep, part).sum(axis=-1)
    for m, at in enumerate(own):
        if at is not None:
            gradient[:, at] += _over_pairs(of.own[m], distance)
    return gradient


def _stacked(parts: Mapping[int, FloatArray], like: FloatArray) -> tuple[list[int], FloatArray]:
    """Places, and the arrays at them, broadcast to (places, points, pairs)."""
    stack = np.empty((len(parts), *like.shape))
    for row, part in zip(stack, parts.values(), strict=True):
        row[...] = part
    return list(parts), stack


def _add_products(
    hessian: FloatArray, rows: list[int], columns: list[int], a: FloatArray, b: FloatArray, *, mirrored: bool = False
) -> None:
    """Add the sums over pairs of the products of a, (rows, points, pairs), and b, (columns, points, pairs); a is 0 where all is."""
    if not rows or not columns:
        return
    with np.errstate(over="ignore", invalid="ignore"):
        found = a.transpose(1, 0, 2) @ b.transpose(1, 2, 0)
    if not np.isfinite(found).all():
        found = _finished(a[:, None], b[None]).sum(axis=-1).transpose(2, 0, 1)
    hessian[:, np.array(rows)[:, None], columns] += found
    if mirrored:
        hessian[:, np.array(columns)[:, None], rows] += found.transpose(0, 2, 1)


def _add_symmetric(hessian: FloatArray, at: tuple[int, int], values: FloatArray) -> None:
    i, j = at
    hessian[:, i, j] += values
    if i != j:
        hessian[:, j, i] += values


def _over_pairs(values: FloatArray, distance: Distance) -> FloatArray:
    """Sum over pairs of an array that broadcasts to them."""
    return np.asarray(np.broadcast_to(values, distance.z.shape).sum(axis=1))


def _finished(slope: FloatArray, factor: FloatArray) -> FloatArray:
    """Their product, 0 where the slope is: it falls faster than anything else may grow, so answers have no more to say out there."""
    with np.errstate(over="ignore", invalid="ignore"):  # a factor beyond the largest float
        product = np.asarray(slope * factor)
        return product if np.isfinite(product).all() else np.where(slope == 0.0, 0.0, product)


def _pair(i: int, k: int) -> tuple[int, int]:
    return (i, k) if i < k else (k, i)


def _add(to: dict[Place, FloatArray], key: Place, values: FloatArray) -> None:
    to[key] = to[key] + values if key in to else values
