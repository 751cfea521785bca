"""One chain rule for the log likelihood of every model: link x distance x propagator.

The normalised distance is z = N e^(-L) with the numerator N = step + r (p lever - c) and the log of the width L = b + log v; r and v are
the scales of a pair's interval (:mod:`bayes_toe.model.propagators`). For coordinates i and k of N and L

    z_i   = N_i h - z L_i,                                                      h = e^(-L)
    z_ik  = N_ik h - N_i h L_k - N_k h L_i + z (L_i L_k - L_ik),

so that the log likelihood A(z, l) of a link with peak logit l has, with S = (z A_z)_z = A_z + z A_zz,

    A_i  = A_z N_i h - z A_z L_i
    A_ik = A_zz N_i h N_k h + A_z N_ik h - S (N_i h L_k + N_k h L_i) + z S L_i L_k - z A_z L_ik.

S enters whole: its two terms cancel where answers are surprising, and the link forms it without.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.model.links import Slopes
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

    @property
    def places(self) -> list[int]:
        """Every coordinate that z depends on, ascending."""
        return sorted({*self.numerator, *self.log_width})


@dataclass(frozen=True, eq=False)
class Pulled:
    """Offset and pull as the numerator of z has them: c - p lever, with the places of their coordinates (None: not free).

    `pull`, `slope` and `bend` are p and its derivatives in its coordinate, shape (points, 1).
    """

    lever: FloatArray
    offset: FloatArray
    pull: FloatArray
    slope: FloatArray
    bend: FloatArray
    offset_place: int | None
    pull_place: int | None


def add_numerator(distance: Distance, of: Pulled, h: FloatArray, scales: Scales) -> None:
    """Fill in N_i h and N_ik h at fixed scales r."""
    per = scales.pull * h
    if of.offset_place is not None:
        distance.numerator[of.offset_place] = -per
    if of.pull_place is not None:
        distance.numerator[of.pull_place] = of.slope * of.lever * per
        distance.numerator_bend[of.pull_place, of.pull_place] = of.bend * of.lever * per


def add_growth(distance: Distance, of: Pulled, per: FloatArray, growth: Growth, places: tuple[int, ...]) -> None:
    """What the scales' dependence on the coordinates at these places adds; per is r h.

    (r p)_i = r (p_i + p rho_i) and r_i = r rho_i with rho = log r, and so on; log v enters L.
    """
    pulled = per * (of.pull * of.lever - of.offset)
    for i, place in enumerate(places):
        _add(distance.numerator, place, pulled * growth.pull[i])
        _add(distance.log_width, place, growth.width[i])
        if of.offset_place is not None:
            _add(distance.numerator_bend, _pair(of.offset_place, place), -per * growth.pull[i])
        if of.pull_place is not None:
            twice = 2.0 if of.pull_place == place else 1.0
            _add(distance.numerator_bend, _pair(of.pull_place, place), twice * of.slope * of.lever * per * growth.pull[i])
        for k, other in enumerate(places[: i + 1]):
            bend = growth.pull_bend[i, k] + growth.pull[i] * growth.pull[k]
            _add(distance.numerator_bend, _pair(place, other), pulled * bend)
            _add(distance.log_width_bend, _pair(place, other), growth.width_bend[i, k])


def likelihood_derivatives(distance: Distance, link: Slopes, peak: int | None, k: int) -> Derivatives:
    """Gradient (points, k) and Hessian (points, k, k) of the log likelihood; `peak` is the place of its logit, None where it is fixed."""
    points = len(distance.z)
    gradient, hessian = np.zeros((points, k)), np.zeros((points, k, k))
    steep, level = link.z * distance.z, link.stretch * distance.z
    for i in distance.places:
        gradient[:, i] = _summed((distance.numerator.get(i), link.z), (distance.log_width.get(i), -steep))
        for j in distance.places:
            if j <= i:
                hessian[:, i, j] = hessian[:, j, i] = _bend(distance, link, (i, j), steep, level)
    if peak is not None:
        gradient[:, peak], hessian[:, peak, peak] = link.peak.sum(axis=1), link.peak_peak.sum(axis=1)
        for i in distance.places:
            terms = (distance.numerator.get(i), link.z_peak), (distance.log_width.get(i), -link.z_peak * distance.z)
            hessian[:, i, peak] = hessian[:, peak, i] = _summed(*terms)
    return gradient, hessian


def _bend(distance: Distance, link: Slopes, at: tuple[int, int], steep: FloatArray, level: FloatArray) -> FloatArray:
    """One element of the Hessian, A_ik."""
    n, w = ([of.get(place) for place in at] for of in (distance.numerator, distance.log_width))
    return _summed(
        (_product(n[0], n[1]), link.zz),
        (distance.numerator_bend.get(_pair(*at)), link.z),
        (_product(n[0], w[1]), -link.stretch),
        (_product(n[1], w[0]), -link.stretch),
        (_product(w[0], w[1]), level),
        (distance.log_width_bend.get(_pair(*at)), -steep),
    )


def _summed(*terms: tuple[FloatArray | None, FloatArray]) -> FloatArray:
    """Sum over pairs of products; factors that are None are 0."""
    total = np.zeros(len(terms[0][1]))
    for factor, weight in terms:
        if factor is not None:
            total = total + (factor * weight).sum(axis=1)
    return total


def _product(a: FloatArray | None, b: FloatArray | None) -> FloatArray | None:
    return None if a is None or b is None else a * b


def _pair(i: int, k: int) -> tuple[int, int]:
    return (i, k) if i < k else (k, i)


def _add(to: dict[Place, FloatArray], key: Place, values: FloatArray) -> None:
    to[key] = to[key] + values if key in to else values
