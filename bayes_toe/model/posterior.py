"""The one posterior: a subject, a record of what the observer does, a prior; a :class:`bayes_toe.model.target.Target`.

One likelihood core serves every record: z = ((s2 - s1) + r [p (s1 - sbar - E) - c] + k a) / (w e^(b m) v) with offset c, pull p and width
w, expectation E that follows the trials (:mod:`bayes_toe.model.history`), bias k by the answer a = 1, -1 before, noise slope b over the
pair's mean m = (s1 + s2)/2 - sbar, a link from z to both answers (that of P(equal) ends at z = 0 in a peak of logit
q0 + g m), a spread of the counts about it, and a propagator's scales r and v of the pair's interval, 1 where there is one interval. What a
record leaves out is fixed: no offset means c = 0, no pull K = 1 - p = 1, no slopes b = 0 and g = 0, no peak q0 = 1, no propagator that the
interval does not matter.

log posterior = log likelihood (no binomial coefficients) + log prior, a density with respect to unconstrained coordinates x, so that its
integral over x is the evidence of the model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Never

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logit

from bayes_toe.arrays import BLOCK, FloatArray, IndexArray
from bayes_toe.data.conditions import mean_first
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.coordinates import NATURAL, Natural
from bayes_toe.model.distributions import Random
from bayes_toe.model.history import Trials
from bayes_toe.model.intervals import UNSCALED, Propagator, Scales, reference_interval, typical_interval
from bayes_toe.model.levelling import Funnel, Levelling
from bayes_toe.model.links import Answers, Lapsing, Link
from bayes_toe.model.memory import Block
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.model.spread import Spread
from bayes_toe.model.target import Levels, Names, require_points

if TYPE_CHECKING:
    from bayes_toe.model.record import Model

_OFFSET, _PEAK, _SLOPE, _PEAK_SLOPE, _ANSWER_BIAS = "offset", "logit_q0", "noise_slope", "peak_slope", "answer_bias"
PRIOR_DRAWS = 100_000
_NONE = np.zeros((1, 1))


@dataclass(frozen=True, eq=False)
class Posterior:
    """Log posterior of one subject under one record; pairs at several intervals are told apart in any case.

    Parameters
    ----------
    subject : Subject
        The counts.
    model : Model
    prior : Prior
        In the place of "stimuli" it gets the numbers of this subject's.
    centre : float, optional
        Intensity from which the offset counts, natural-log units; the mean first stimulus by default.
    interval : float, optional
        The reference, to which coordinates, quantities and their prior refer, seconds: the prior's, or else the subject's geometric mean.

    Examples
    --------
    >>> from bayes_toe.model.ladder import SYMMETRIC
    >>> subject = Subject("S01", [0.0, 0.0], [0.0, 0.3], [49, 20], [50, 50])
    >>> Posterior(subject, SYMMETRIC).log_density([[-1.0, 2.0]]).shape
    (1,)
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
        return reference_interval(self.prior.reference_interval, self.subject) if self.interval is None else self.interval

    @cached_property
    def _places(self) -> Mapping[str, int]:
        return {name: i for i, name in enumerate(self.coordinates)}

    @cached_property
    def _parts(self) -> tuple[tuple[Block, slice], ...]:
        ends = np.cumsum([0, *(len(block.coordinates) for block in self.model.free)]).tolist()
        return tuple((block, slice(*part)) for block, part in zip(self.model.free, pairwise(ends), strict=True))

    @cached_property
    def _offset_place(self) -> int | None:
        return self._places.get(_OFFSET)

    @cached_property
    def _rows(self) -> Subject | Trials:
        """What the likelihood is a product over: pairs, or trials where an answer depends on those before it, and these are known."""
        known = self.model.by_trial and self.subject.answers is not None and self.subject.answers.place is not None
        return Trials.of(self.subject) if known else self.subject

    @cached_property
    def _intervals(self) -> tuple[FloatArray, IndexArray] | None:
        """Distinct intervals over the reference, and the place of each row's among them; None where the interval does not matter."""
        return None if self._rows.isi is None else self._placed(self._rows.isi)

    @cached_property
    def _felt_intervals(self) -> tuple[FloatArray, IndexArray] | None:
        """The same of every trial that was felt, shape (steps, sessions, 1), or of a crowd with a subject for each point."""
        return None if not isinstance(self._rows, Trials) or self._rows.seconds is None else self._placed(self._rows.seconds)

    def _placed(self, seconds: FloatArray) -> tuple[FloatArray, IndexArray] | None:
        if self.model.propagator is None:
            return None
        intervals, which = np.unique(np.asarray(seconds) / self.reference, return_inverse=True)
        return intervals, which.reshape(np.shape(seconds))

    # --- Densities ------------------------------------------------------------------------------------

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Log posterior density at x, shape (points, k) -> (points,).

        Raises
        ------
        NumericalError
            If a coordinate is NaN.
        """
        points = require_points(x, len(self.coordinates))
        return self.log_likelihood(points) + self.log_prior(points)

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density at x, shape (points, k) -> (points,)."""
        return np.asarray(self.block_log_prior(require_points(x, len(self.coordinates))).sum(axis=1))

    def block_log_prior(self, x: FloatArray) -> FloatArray:
        """Log prior density of every block of coordinates, (points, k) -> (points, blocks)."""
        return np.stack([block.log_prior(x[:, part], self.prior, self.sbar) for block, part in self._parts], axis=1)

    @property
    def block_starts(self) -> list[int]:
        """The first coordinate of every block."""
        return [part.start for _, part in self._parts]

    def log_prior_under(self, x: npt.ArrayLike, prior: Prior) -> FloatArray:
        """Log density that another prior gives to the quantities at x, with respect to x, shape (points, k) -> (points,)."""
        return replace(self, prior=prior).log_prior(x)

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood at x, shape (points, k) -> (points,)."""
        points = require_points(x, len(self.coordinates))
        rows = max(1, BLOCK // self._rows.n_pairs)
        return np.concatenate([self.pair_log_likelihood(points[i : i + rows]).sum(axis=1) for i in range(0, len(points), rows)])

    def pair_log_likelihood(self, x: npt.ArrayLike, answers: Answers | None = None) -> FloatArray:
        """Log likelihood of each pair, shape (points, k) -> (points, pairs); `answers` are :meth:`log_answers` at x where known."""
        points, rows = require_points(x, len(self.coordinates)), self._rows
        known = self._row_answers(points) if answers is None or isinstance(rows, Trials) else answers
        found = self.model.spread.log_likelihood(rows, known, *self._own(points, self.model.spread))
        return np.add.reduceat(found, rows.starts, axis=1) if isinstance(rows, Trials) else found

    def log_answers(self, x: npt.ArrayLike) -> Answers:
        """Log P of the counted answer and of the other one, of every pair, (points, k) -> (points, pairs) each. Source: Eq. mod:q.

        Where answers depend on the trials before, of the mean probability over a pair's trials.
        """
        found, rows = self._row_answers(require_points(x, len(self.coordinates))), self._rows
        return (rows.by_pair(found[0]), rows.by_pair(found[1])) if isinstance(rows, Trials) else found

    def trial_answers(self, x: npt.ArrayLike) -> FloatArray:
        """Log P of the counted answer of every answered trial, in the order of the pairs, (points, k) -> (points, trials)."""
        found = self._row_answers(require_points(x, len(self.coordinates)))[0]
        return found if isinstance(self._rows, Trials) else np.repeat(found, self.subject.n_trials, axis=1)

    def _row_answers(self, x: FloatArray) -> Answers:
        return self.model.link.log_answers(self.distance(x), *self._of_link(x))

    def answers_given_the_rest(self, x: npt.ArrayLike) -> Answers:
        """The same of one answer given all others to its pair: what leave-one-out by trial asks for."""
        points = require_points(x, len(self.coordinates))
        return self.model.spread.given_the_rest(self.subject, self.log_answers(points), *self._own(points, self.model.spread))

    def realised_answers(self, rng: Random, x: npt.ArrayLike, answers: Answers) -> Answers:
        """The same, from those at x, of one session for each point: pairs have the probabilities that the spread of counts gives them."""
        return self.model.spread.realised(rng, answers, *self._own(require_points(x, len(self.coordinates)), self.model.spread))

    def distance(self, x: FloatArray) -> FloatArray:
        """Normalised distance z of every pair, or trial, (points, k) -> (points, pairs)."""
        return self._distance(self._pull(x), self._scales(x), self._at_trials(self.expectation(x)), x)

    def gradient(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Log posterior density at x, (points,), and its gradient, (points, k)."""
        points = require_points(x, len(self.coordinates))
        rows = max(1, BLOCK // self._rows.n_pairs)
        parts = [self.likelihood_gradient(points[i : i + rows]) for i in range(0, max(1, len(points)), rows)]
        value, gradient = (np.concatenate(of) for of in zip(*parts, strict=True))
        return value + self.log_prior(points), gradient + self.prior_gradient(points)

    def prior_gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of the log prior density, (points, k)."""
        return np.concatenate([block.gradient(x[:, part], self.prior, self.sbar) for block, part in self._parts], axis=1)

    def likelihood_gradient(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log likelihood, (points,), and its gradient, (points, k); of the points of a crowd too.

        The normalised distance is z = N e^(-L) with the numerator N = step + r (p lever - c) and the log of the width L, so a coordinate i
        that moves both adds A_z (N_i e^(-L) - z L_i) for the slope A_z of the log likelihood of a pair in z.
        """
        link, spread, rows = self.model.link, self.model.spread, self._rows
        own, of_spread = self._of_link(x), self._own(x, spread)
        scales, felt = self._scales(x), self.expectation(x)
        z = self._distance(self._pull(x), scales, self._at_trials(felt), x)
        answers = link.log_answers(z, *own)
        with np.errstate(over="ignore"):  # far out a free exponent makes slopes beyond the largest float, and the density almost 0
            slopes = spread.slopes(rows, answers, link.slopes(z, answers, *own), *of_spread)
            steep = -_finished(slopes.z, z)  # what a coordinate of log width adds
        gradient, per, growths = np.zeros(x.shape), self._per_width(x, scales), self._growths(x)

        def add(name: str, values: FloatArray) -> None:
            """What rows add to the slope in a coordinate, if it is free."""
            if name in self._places:
                gradient[:, self._places[name]] += np.broadcast_to(values, z.shape).sum(axis=1)

        for name, rise in self._numerator_slopes(x, scales, felt, growths):
            add(name, _finished(slopes.z, per * rise))
        add("log_width", steep)
        add(_SLOPE, _finished(steep, np.atleast_2d(self._middle)))
        for name, growth in growths:
            add(name, _finished(steep, growth.width))
        for name, part in zip((*link.coordinates, *spread.coordinates), slopes.own, strict=True):
            add(name, part)
        if _PEAK_SLOPE in self._places:
            add(_PEAK_SLOPE, _finished(slopes.own[link.coordinates.index(_PEAK)], np.atleast_2d(self._middle)))
        return spread.log_likelihood(rows, answers, *of_spread).sum(axis=1), gradient

    def _numerator_slopes(
        self, x: FloatArray, scales: Scales, felt: FloatArray | None, growths: Sequence[tuple[str, Scales]]
    ) -> Iterator[tuple[str, FloatArray]]:
        """Coordinates on which the numerator N depends, and its derivatives there, (points, rows)."""
        pull, lever = self._pull(x), self._rows.s1 - self.sbar - self._at_trials(felt)
        yield _OFFSET, -scales.pull
        if self.model.pull is not None:
            a = x[:, self._places[self.model.pull.coordinate], None]
            yield self.model.pull.coordinate, scales.pull * (self.model.pull.span * expit(a) * expit(-a) * lever)
        for name, growth in growths:
            yield name, scales.pull * (pull * lever - self._offset(x)) * growth.pull
        for name, rise in self._expectation_slopes(x, felt):
            yield name, -scales.pull * pull * rise
        if isinstance(self._rows, Trials):
            yield _ANSWER_BIAS, np.atleast_2d(self._rows.before)

    # --- What engines ask for -------------------------------------------------------------------------

    def starts(self) -> FloatArray:
        """A grid on the scale of the stimuli, at the typical interval, shape (starts, k); points of density 0 are left out.

        Raises
        ------
        InputError
            If an answer that was given is impossible under the model.
        """
        subject = self.subject
        steps = np.abs(subject.s2 - subject.s1)
        scale = float(np.sqrt(np.mean(steps[steps > 0] ** 2))) if np.any(steps > 0) else 0.3
        peak = float(logit(((subject.n_yes + 1.0) / (subject.n_trials + 2.0)).max()))
        axes = np.meshgrid(*(values for block in self.model.free for values in block.grid(scale, peak)))
        points: FloatArray = np.stack([axis.ravel() for axis in axes], axis=-1)
        if self._offset_place is not None and _PEAK in self.model.link.coordinates and _PEAK not in self._places:
            points = np.concatenate([points, *map(self._between_pairs, np.unique(points, axis=0))])
        if self._intervals is not None:  # offset and width are those at the typical interval: what they are at the reference
            at = self._scales_at(points, typical_interval(np.asarray(subject.isi) / self.reference, subject.n_trials))
            points[:, self._places["offset"]] /= at.pull[:, 0]
            points[:, self._places["log_width"]] -= np.log(at.width[:, 0])
        some = np.isfinite(self.log_density(points))
        return points[some] if some.any() else self._refuse(points)

    def _refuse(self, points: FloatArray) -> Never:
        """Name the pair whose answers have probability 0 at most of these points, (points, k)."""
        subject, pairs = self.subject, np.isneginf(self.pair_log_likelihood(points)).sum(axis=0)
        i = int(pairs.argmax())
        answers = f"{subject.n_yes[i]} of {subject.n_trials[i]} {subject.task.yes!r}"
        raise InputError(
            f"subject {subject.name!r}, pair s1={subject.s1[i]:g}, s2={subject.s2[i]:g}: {answers}, which model {self.model.name!r} says "
            "is impossible; allowed is a model with lapses or a constant error"
        )

    def sample_prior(self, rng: Random, size: int) -> FloatArray:
        """Independent draws from the prior, shape (size, k)."""
        return np.concatenate([block.sample(rng, size, self.prior, self.sbar) for block, _ in self._parts], axis=1)

    def levelling(self, modes: FloatArray) -> Levels:
        """Coordinates in which mixtures fit: the funnel of a free prior mean straightened, probits in the place of logits."""
        pull, logits = self.model.pull, tuple(i for name, i in self._places.items() if name.startswith("logit_"))
        if pull is None or pull.centre is None:
            return Levelling(logits, self._places["log_width"])
        mu1 = self.prior.distribution(pull.centre)
        funnel = Funnel.at(modes, lambda x: self.likelihood_gradient(x)[1], mu1, self.sbar, pull.span)
        return Levelling(logits, self._places["log_width"], funnel)

    def for_subject(self, subject: Subject) -> Posterior:
        """The same model with the same prior for other answers or other pairs, with the same centre and reference interval."""
        return replace(self, subject=subject, centre=self.sbar, interval=self.reference)

    def to_group(self, x: FloatArray) -> FloatArray:
        """The quantities of :attr:`Model.group` on their group scales, shape (points, k) -> (points, k)."""
        return np.concatenate([block.to_group(x[:, part], self.prior, self.sbar) for block, part in self._parts], axis=1)

    def from_group(self, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The inverse: x, shape (points, k), and dx/d(eta), shape (points, k, k)."""
        x, jacobian = np.empty(eta.shape), np.zeros((*eta.shape, eta.shape[1]))
        for block, part in self._parts:
            x[:, part], jacobian[:, part, part] = block.from_group(eta[:, part], self.prior, self.sbar)
        return x, jacobian

    def gain(self, x: FloatArray, seconds: FloatArray) -> FloatArray:
        """Weight of the first stimulus at intervals, (points, k) and (intervals,) -> (points, intervals); no unit."""
        scale = self._scales_at(x, seconds / self.reference).pull
        return np.asarray(1.0 - np.broadcast_to(self._pull(x) * scale, (len(x), len(seconds))))

    def yes_at_distance(self, x: FloatArray, z: FloatArray) -> FloatArray:
        """P of the answer that the task counts at normalised distances, (points, k) and (n,) -> (points, n)."""
        return np.asarray(np.exp(self.model.link.log_answers(np.broadcast_to(z, (len(x), len(z))), *self._own(x, self.model.link))[0]))

    def noticeable(self, x: FloatArray) -> FloatArray:
        """Just noticeable normalised distance, (points, k) -> (points,); of the answers that depend on the stimuli.

        'Equal' is there half as often as at its peak, or 'second' has 75 %.
        """
        link = self.model.link_without_lapses
        if isinstance(link.noticeable, float):
            return np.full(len(x), link.noticeable)
        return link.noticeable(*(part[:, 0] for part in self._own(x, link)))

    # --- What readers ask for -------------------------------------------------------------------------

    @property
    def names(self) -> Names:
        """What the quantities are called."""
        published = ("pse_shift", "jnd") if self._offset_place is not None else ("jnd",)
        return sum((block.names for block in self.model.free), start=Names((), (), published, published))

    def quantities(self, x: FloatArray) -> dict[str, FloatArray]:
        """Every named quantity, each with the shape of x without its last axis.

        The shift of the point of subjective equality, at the mean first stimulus, is the offset; the just noticeable difference is the
        distance of the stimuli at which 'equal' is half as frequent as at its peak, or P(second) 75 %, leaving lapses aside.
        """
        found = {name: values for block, part in self._parts for name, values in block.named(x[..., part], self.prior, self.sbar).items()}
        found["jnd"] = found["width"] * self.noticeable(x.reshape(-1, x.shape[-1])).reshape(x.shape[:-1])
        return found | ({"pse_shift": found["offset"]} if "offset" in found else {})

    def judged(self, x: FloatArray) -> dict[str, FloatArray]:
        """The quantities by which draws are judged: those that are no monotone function of a single other one."""
        repeated = self.names.monotone
        return {name: values for name, values in self.quantities(x).items() if name not in repeated}

    def points(self, quantities: Mapping[str, FloatArray]) -> FloatArray:
        """Unconstrained coordinates, shape (..., k), from named quantities, each of shape (...); they must name all that is free."""
        return np.concatenate([block.coordinates_from(quantities, self.prior, self.sbar) for block in self.model.free], axis=-1)

    def prior_quantile(self, name: str, probability: float) -> float:
        """Prior quantile of a named quantity; from draws, to about half a percent of the prior's range, where it has no short form."""
        if name == "pse_shift":
            return self.prior_quantile("offset", probability)
        if name == "jnd":
            of_width = self.model.link_without_lapses.noticeable
            if isinstance(of_width, float):
                return of_width * self.prior_quantile("width", probability)
            return float(np.quantile(self.quantities(self.sample_prior(np.random.default_rng(0), PRIOR_DRAWS))[name], probability))
        for block in self.model.free:
            if name in block.names.all:
                known = block.prior_quantile(name, probability, self.prior, self.sbar)
                return float(np.quantile(prior_draws(self.model, self.prior, self.sbar)[name], probability)) if known is None else known
        raise InputError(f"unknown quantity {name!r}; there are: {', '.join(self.names.all)}")

    def natural(self, x: npt.ArrayLike) -> Natural:
        """The paper's parameters, of a model that has them all, at unconstrained points, shape (..., k)."""
        found = self.quantities(np.asarray(x, np.float64))
        return Natural(*(found[name] for name in NATURAL))

    # --- Parts ----------------------------------------------------------------------------------------

    def _pull(self, x: FloatArray) -> FloatArray:
        """Pull p, shape (points, 1)."""
        pull = self.model.pull
        return np.zeros((1, 1)) if pull is None else pull.low + pull.span * expit(x[:, self._places[pull.coordinate], None])

    def _offset(self, x: FloatArray) -> FloatArray:
        """Offset c, shape (points, 1)."""
        return _NONE if self._offset_place is None else x[:, self._offset_place, None]

    @property
    def _middle(self) -> FloatArray:
        """Mean stimulus of every pair from the mean first stimulus, shape (pairs,)."""
        return np.asarray(0.5 * (self._rows.s1 + self._rows.s2) - self.sbar)

    def expectation(self, x: FloatArray) -> FloatArray | None:
        """E of every trial that was felt, shape (steps, sessions, points), natural-log intensity; None where the expectation stays."""
        history, rows = self.model.history, self._rows
        if history is None or not isinstance(rows, Trials):
            return None
        return history.expectation(rows, x[:, self._places[history.coordinate]], self._pull(x)[:, 0] * self._felt_scale(x))

    def _expectation_slopes(self, x: FloatArray, felt: FloatArray | None) -> list[tuple[str, FloatArray]]:
        """Coordinates on which the expectation depends, and its derivatives at answered trials, shape (points, trials)."""
        history, rows, part = self.model.history, self._rows, self.model.pull
        if felt is None or history is None or part is None or not isinstance(rows, Trials):
            return []
        scale, a = self._felt_scale(x), x[:, self._places[part.coordinate]]
        pull, by = self._pull(x)[:, 0] * scale, [(part.coordinate, part.span * expit(a) * expit(-a) * scale)]
        if self._felt_intervals is not None:
            intervals, which = self._felt_intervals
            of_points = np.broadcast_to(which.reshape(-1, which.shape[2]).T, (len(x), which.shape[0] * which.shape[1]))
            for name, growth in self._growths(x, (intervals, of_points)):
                by.append((name, pull * growth.pull.T.reshape(pull.shape)))
        found = history.slopes(rows, x[:, self._places[history.coordinate]], pull, felt, [rise for _, rise in by])
        return [(name, self._at_trials(rise)) for name, rise in zip((history.coordinate, *(name for name, _ in by)), found, strict=True)]

    def _felt_scale(self, x: FloatArray) -> FloatArray:
        """Pull over that at the reference of every trial that was felt, (steps, sessions, points), or one 1 where there is one interval."""
        if self._felt_intervals is None:
            return np.ones((1, 1, 1))
        intervals, which = self._felt_intervals
        return np.asarray(self._scales_at(x, intervals).pull[np.arange(len(x)), which])

    def _at_trials(self, felt: FloatArray | None) -> FloatArray:
        """What is known of all trials that were felt, at those that were answered, shape (points, trials)."""
        return _NONE if felt is None or not isinstance(self._rows, Trials) else self._rows.answered(felt)

    def _distance(self, pull: FloatArray, scales: Scales, expected: FloatArray, x: FloatArray) -> FloatArray:
        """As :meth:`distance`; in memory points lie next to each other, and so in all that follows from it: of pairs there are a few."""
        s1, s2 = np.atleast_2d(self._rows.s1).T, np.atleast_2d(self._rows.s2).T  # a column, or of a crowd a column a point
        shift = (s2 - s1) + scales.pull.T * (pull.T * (s1 - self.sbar - expected.T) - self._offset(x).T)
        if _ANSWER_BIAS in self._places and isinstance(self._rows, Trials):
            shift = shift + x[:, self._places[_ANSWER_BIAS]] * np.atleast_2d(self._rows.before).T
        with np.errstate(over="ignore", invalid="ignore"):  # a width below the smallest float leaves only exact equality at distance 0
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
        return tuple(x[:, self._places[name], None] if name in self._places else np.full((len(x), 1), np.inf) for name in of.coordinates)

    def _scales(self, x: FloatArray) -> Scales:
        """Pull and width of every pair over those at the reference; one row and column of 1 where nothing depends on the interval."""
        if self._intervals is None:
            return UNSCALED
        return self._scales_at(x, self._intervals[0]).of_pairs(self._intervals[1])

    def _scales_at(self, x: FloatArray, intervals: FloatArray) -> Scales:
        """Pull and width at intervals in units of the reference over those at it, (points, k) and (intervals,) -> (points, intervals)."""
        propagator = self.model.propagator
        return UNSCALED if propagator is None else propagator.scales(*self._columns(x, propagator), intervals)

    def _growths(self, x: FloatArray, at: tuple[FloatArray, IndexArray] | None = None) -> list[tuple[str, Scales]]:
        """Coordinates on which the scales of rows depend, or of intervals elsewhere, and their logarithmic derivatives, (points, ...)."""
        placed, propagator = self._intervals if at is None else at, self.model.propagator
        if placed is None or propagator is None:
            return []
        intervals, which = placed
        growth = propagator.growth(*self._columns(x, propagator), intervals).of_pairs(which)
        return [(name, Scales(*of)) for name, *of in zip(propagator.coordinates, *growth, strict=True)]

    def _columns(self, x: FloatArray, propagator: Propagator) -> list[FloatArray]:
        """The coordinates that a propagator depends on, shape (points,) each."""
        return [x[:, self._places[name]] for name in propagator.coordinates]

    def _between_pairs(self, point: FloatArray) -> FloatArray:
        """Copies of a point with offsets between those that put a pair on the axis, shape (offsets, k).

        Where identical stimuli are never called 'different' such an offset is impossible if the pair ever was: a wall, with a maximum of
        its own on each side.
        """
        walls = np.unique((self.subject.s2 - self.subject.s1) + self._pull(point[None])[0] * (self.subject.s1 - self.sbar))
        moved, offsets = np.repeat(point[None], len(walls) - 1, axis=0), 0.5 * (walls[1:] + walls[:-1])
        moved[:, self._offset_place] = offsets
        return moved


@lru_cache(maxsize=4)
def prior_draws(model: Model, prior: Prior, sbar: float) -> dict[str, FloatArray]:
    """Draws of every named quantity from the prior; the same for all subjects of a design."""
    rng = np.random.default_rng(0)
    found: dict[str, FloatArray] = {}
    for block in model.free:
        found |= block.named(block.sample(rng, PRIOR_DRAWS, prior, sbar), prior, sbar)
    return found


def _finished(slope: FloatArray, factor: FloatArray) -> FloatArray:
    """Their product, 0 where the slope is: it falls faster than anything else may grow, so answers have no more to say out there."""
    with np.errstate(over="ignore", invalid="ignore"):  # a factor beyond the largest float
        product = np.asarray(slope * factor)
        return product if np.isfinite(product).all() else np.where(slope == 0.0, 0.0, product)
