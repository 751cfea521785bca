"""The likelihood of one subject's answers, one core for every record of what an observer does.

    z = ((s2 - s1) + r [p (s1 - sbar) - c]) / (w e^(b m) v)

with offset c, pull p and width w, noise slope b over the pair's mean m = (s1 + s2)/2 - sbar, a link from z to both
answers (that of P(equal) ends at z = 0 in a peak of logit q0 + g m), a spread of the counts about it,
and a propagator's scales r and v of the pair's interval, 1 where there is one
interval. What a record leaves out is fixed: no offset means c = 0, no pull K = 1 - p = 1, no slopes b = 0 and g = 0, no peak q0 = 1, no
propagator that the interval does not matter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.special import expit

from bayes_toe.arrays import BLOCK, FloatArray, IndexArray
from bayes_toe.data.conditions import mean_first
from bayes_toe.data.study import Subject
from bayes_toe.model.distributions import Random
from bayes_toe.model.intervals import UNSCALED, Propagator, Scales, reference_interval
from bayes_toe.model.links import Answers, Lapsing, Link
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.model.spread import Spread
from bayes_toe.model.target import require_points

if TYPE_CHECKING:
    from bayes_toe.model.record import Model

_OFFSET, _PEAK, _SLOPE, _PEAK_SLOPE = ("offset", "logit_q0", "noise_slope", "peak_slope")
_NONE = np.zeros((1, 1))


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood, without binomial coefficients, over unconstrained coordinates x: a product over pairs.

    The fields are those of :class:`~bayes_toe.model.posterior.Posterior`.
    """

    subject: Subject
    model: Model
    prior: Prior = DEFAULT
    centre: float | None = None
    interval: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "prior", self.prior.at(self.subject))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the k unconstrained coordinates."""
        return self.model.coordinates

    @cached_property
    def sbar(self) -> float:
        """Intensity from which the offset counts, natural-log units."""
        return mean_first(self.subject) if self.centre is None else self.centre

    @cached_property
    def reference(self) -> float:
        """Reference interval, seconds."""
        return (
            reference_interval(self.prior.reference_interval, self.subject)
            if self.interval is None
            else self.interval
        )

    @cached_property
    def _places(self) -> Mapping[str, int]:
        return {name: i for i, name in enumerate(self.coordinates)}

    @cached_property
    def _offset_place(self) -> int | None:
        return self._places.get(_OFFSET)

    @cached_property
    def _intervals(self) -> tuple[FloatArray, IndexArray] | None:
        """Distinct intervals over the reference, and the place of each row's among them; None where the interval does not matter."""
        return None if self.subject.isi is None else self._placed(self.subject.isi)

    def _placed(self, seconds: FloatArray) -> tuple[FloatArray, IndexArray] | None:
        if self.model.propagator is None:
            return None
        intervals, which = np.unique(np.asarray(seconds) / self.reference, return_inverse=True)
        return intervals, which.reshape(np.shape(seconds))

    # --- The likelihood -------------------------------------------------------------------------------

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood at x, shape (points, k) -> (points,)."""
        points = require_points(x, len(self.coordinates))
        rows = max(1, BLOCK // self.subject.n_pairs)
        return np.concatenate(
            [
                self.pair_log_likelihood(points[i : i + rows]).sum(axis=1)
                for i in range(0, len(points), rows)
            ]
        )

    def pair_log_likelihood(self, x: npt.ArrayLike, answers: Answers | None = None) -> FloatArray:
        """Log likelihood of each pair, shape (points, k) -> (points, pairs); `answers` are :meth:`log_answers` at x where known."""
        points = require_points(x, len(self.coordinates))
        known = self.log_answers(points) if answers is None else answers
        own = self._own(points, self.model.spread)
        return self.model.spread.log_likelihood(self.subject, known, *own)

    def log_answers(self, x: npt.ArrayLike) -> Answers:
        """Log P of the counted answer and of the other one, of every pair, (points, k) -> (points, pairs) each. Source: Eq. mod:q."""
        points = require_points(x, len(self.coordinates))
        return self.model.link.log_answers(self.distance(points), *self._of_link(points))

    def answers_given_the_rest(self, x: npt.ArrayLike) -> Answers:
        """The same of one answer given all others to its pair: what leave-one-out by trial asks for."""
        points = require_points(x, len(self.coordinates))
        return self.model.spread.given_the_rest(
            self.subject, self.log_answers(points), *self._own(points, self.model.spread)
        )

    def realised_answers(self, rng: Random, x: npt.ArrayLike, answers: Answers) -> Answers:
        """The same, from those at x, of one session for each point: pairs have the probabilities that the spread of counts gives them."""
        return self.model.spread.realised(
            rng, answers, *self._own(require_points(x, len(self.coordinates)), self.model.spread)
        )

    def distance(self, x: FloatArray) -> FloatArray:
        """Normalised distance z of every pair, (points, k) -> (points, pairs)."""
        return self._distance(self._pull(x), self._scales(x), x)

    def likelihood_gradient(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log likelihood, (points,), and its gradient, (points, k); of the points of a crowd too.

        The normalised distance is z = N e^(-L) with the numerator N = step + r (p lever - c) and the log of the width L, so a coordinate i
        that moves both adds A_z (N_i e^(-L) - z L_i) for the slope A_z of the log likelihood of a pair in z.
        """
        link, spread, rows = self.model.link, self.model.spread, self.subject
        own, of_spread = self._of_link(x), self._own(x, spread)
        scales = self._scales(x)
        z = self._distance(self._pull(x), scales, x)
        answers = link.log_answers(z, *own)
        with np.errstate(
            over="ignore"
        ):  # far out a free exponent makes slopes beyond the largest float, and the density almost 0
            slopes = spread.slopes(rows, answers, link.slopes(z, answers, *own), *of_spread)
            steep = -_finished(slopes.z, z)  # what a coordinate of log width adds
        gradient, per, growths = np.zeros(x.shape), self._per_width(x, scales), self._growths(x)

        def add(name: str, values: FloatArray) -> None:
            """What rows add to the slope in a coordinate, if it is free."""
            if name in self._places:
                gradient[:, self._places[name]] += np.broadcast_to(values, z.shape).sum(axis=1)

        for name, rise in self._numerator_slopes(x, scales, growths):
            add(name, _finished(slopes.z, per * rise))
        add("log_width", steep)
        add(_SLOPE, _finished(steep, np.atleast_2d(self._middle)))
        for name, growth in growths:
            add(name, _finished(steep, growth.width))
        for name, part in zip((*link.coordinates, *spread.coordinates), slopes.own, strict=True):
            add(name, part)
        if _PEAK_SLOPE in self._places:
            add(
                _PEAK_SLOPE,
                _finished(slopes.own[link.coordinates.index(_PEAK)], np.atleast_2d(self._middle)),
            )
        return spread.log_likelihood(rows, answers, *of_spread).sum(axis=1), gradient

    def _numerator_slopes(
        self,
        x: FloatArray,
        scales: Scales,
        growths: Sequence[tuple[str, Scales]],
    ) -> Iterator[tuple[str, FloatArray]]:
        """Coordinates on which the numerator N depends, and its derivatives there, (points, rows)."""
        pull, lever = self._pull(x), self.subject.s1 - self.sbar
        yield _OFFSET, -scales.pull
        if self.model.pull is not None:
            a = x[:, self._places[self.model.pull.coordinate], None]
            yield (
                self.model.pull.coordinate,
                scales.pull * (self.model.pull.span * expit(a) * expit(-a) * lever),
            )
        for name, growth in growths:
            yield name, scales.pull * (pull * lever - self._offset(x)) * growth.pull

    # --- What it is made of ---------------------------------------------------------------------------

    def _pull(self, x: FloatArray) -> FloatArray:
        """Pull p, shape (points, 1)."""
        pull = self.model.pull
        return (
            np.zeros((1, 1))
            if pull is None
            else pull.low + pull.span * expit(x[:, self._places[pull.coordinate], None])
        )

    def _offset(self, x: FloatArray) -> FloatArray:
        """Offset c, shape (points, 1)."""
        return _NONE if self._offset_place is None else x[:, self._offset_place, None]

    @property
    def _middle(self) -> FloatArray:
        """Mean stimulus of every pair from the mean first stimulus, shape (pairs,)."""
        return np.asarray(0.5 * (self.subject.s1 + self.subject.s2) - self.sbar)

    def _distance(self, pull: FloatArray, scales: Scales, x: FloatArray) -> FloatArray:
        """As :meth:`distance`; in memory points lie next to each other, and so in all that follows from it: of pairs there are a few."""
        s1, s2 = (
            np.atleast_2d(self.subject.s1).T,
            np.atleast_2d(self.subject.s2).T,
        )  # a column, or of a crowd a column a point
        shift = (s2 - s1) + scales.pull.T * (pull.T * (s1 - self.sbar) - self._offset(x).T)
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # a width below the smallest float leaves only exact equality at distance 0
            h = self._per_width(x, scales).T
            return (shift * h if np.isfinite(h).all() else np.where(shift == 0.0, 0.0, shift * h)).T

    def _per_width(self, x: FloatArray, scales: Scales) -> FloatArray:
        """One over the width of every pair, shape (points, pairs) or (points, 1)."""
        log_width = x[:, self._places["log_width"], None]
        if _SLOPE in self._places:
            log_width = log_width + x[:, self._places[_SLOPE], None] * self._middle
        return np.asarray(np.exp(-log_width) / scales.width)

    def _of_link(self, x: FloatArray) -> tuple[FloatArray, ...]:
        """Own coordinates of the link, shape (points, 1) each, or (points, pairs) of a peak that depends on the pair."""
        own = self._own(x, self.model.link)
        if _PEAK_SLOPE not in self._places:
            return own
        return (own[0] + x[:, self._places[_PEAK_SLOPE], None] * self._middle, *own[1:])

    def _own(self, x: FloatArray, of: Link | Lapsing | Spread) -> tuple[FloatArray, ...]:
        """Own coordinates of a link or a spread, shape (points, 1) each; a logit that is fixed is infinite."""
        return tuple(
            x[:, self._places[name], None] if name in self._places else np.full((len(x), 1), np.inf)
            for name in of.coordinates
        )

    def _scales(self, x: FloatArray) -> Scales:
        """Pull and width of every pair over those at the reference; one row and column of 1 where nothing depends on the interval."""
        if self._intervals is None:
            return UNSCALED
        return self._scales_at(x, self._intervals[0]).of_pairs(self._intervals[1])

    def _scales_at(self, x: FloatArray, intervals: FloatArray) -> Scales:
        """Pull and width at intervals in units of the reference over those at it, (points, k) and (intervals,) -> (points, intervals)."""
        propagator = self.model.propagator
        return (
            UNSCALED
            if propagator is None
            else propagator.scales(*self._columns(x, propagator), intervals)
        )

    def _growths(self, x: FloatArray) -> list[tuple[str, Scales]]:
        """Coordinates on which the scales of pairs depend, and their logarithmic derivatives, (points, ...)."""
        placed, propagator = self._intervals, self.model.propagator
        if placed is None or propagator is None:
            return []
        intervals, which = placed
        growth = propagator.growth(*self._columns(x, propagator), intervals).of_pairs(which)
        return [
            (name, Scales(*of)) for name, *of in zip(propagator.coordinates, *growth, strict=True)
        ]

    def _columns(self, x: FloatArray, propagator: Propagator) -> list[FloatArray]:
        """The coordinates that a propagator depends on, shape (points,) each."""
        return [x[:, self._places[name]] for name in propagator.coordinates]


def _finished(slope: FloatArray, factor: FloatArray) -> FloatArray:
    """Their product, 0 where the slope is: it falls faster than anything else may grow, so answers have no more to say out there."""
    with np.errstate(over="ignore", invalid="ignore"):  # a factor beyond the largest float
        product = np.asarray(slope * factor)
        return product if np.isfinite(product).all() else np.where(slope == 0.0, 0.0, product)
