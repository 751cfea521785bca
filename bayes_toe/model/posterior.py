"""The one posterior: a subject, a record of what the observer does, a prior.

log posterior = log likelihood (no binomial coefficients, :mod:`bayes_toe.model.likelihood`) + log prior, a density with respect to
unconstrained coordinates x, so that its integral over x is the evidence of the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Never

import numpy as np
import numpy.typing as npt
from scipy.special import logit

from bayes_toe.arrays import BLOCK, FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.coordinates import NATURAL, Natural
from bayes_toe.model.distributions import Random
from bayes_toe.model.intervals import typical_interval
from bayes_toe.model.levelling import Funnel, Levelling
from bayes_toe.model.likelihood import Likelihood
from bayes_toe.model.memory import Block
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import Levels, Names, require_points

if TYPE_CHECKING:
    from bayes_toe.model.record import Model

PRIOR_DRAWS = 100_000


@dataclass(frozen=True, eq=False)
class Posterior(Likelihood):
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

    @cached_property
    def _parts(self) -> tuple[tuple[Block, slice], ...]:
        ends = np.cumsum([0, *(len(block.coordinates) for block in self.model.free)]).tolist()
        return tuple(
            (block, slice(*part))
            for block, part in zip(self.model.free, pairwise(ends), strict=True)
        )

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Log posterior density at x, shape (points, k) -> (points,)."""
        points = require_points(x, len(self.coordinates))
        return self.log_likelihood(points) + self.log_prior(points)

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density at x, shape (points, k) -> (points,)."""
        return np.asarray(
            self.block_log_prior(require_points(x, len(self.coordinates))).sum(axis=1)
        )

    def block_log_prior(self, x: FloatArray) -> FloatArray:
        """Log prior density of every block of coordinates, (points, k) -> (points, blocks)."""
        return np.stack(
            [block.log_prior(x[:, part], self.prior, self.sbar) for block, part in self._parts],
            axis=1,
        )

    @property
    def block_starts(self) -> list[int]:
        """The first coordinate of every block."""
        return [part.start for _, part in self._parts]

    def log_prior_under(self, x: npt.ArrayLike, prior: Prior) -> FloatArray:
        """Log density that another prior gives to the quantities at x, with respect to x, shape (points, k) -> (points,)."""
        return replace(self, prior=prior).log_prior(x)

    def gradient(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Log posterior density at x, (points,), and its gradient, (points, k)."""
        points = require_points(x, len(self.coordinates))
        rows = max(1, BLOCK // self.subject.n_pairs)
        parts = [
            self.likelihood_gradient(points[i : i + rows])
            for i in range(0, max(1, len(points)), rows)
        ]
        value, gradient = (np.concatenate(of) for of in zip(*parts, strict=True))
        return value + self.log_prior(points), gradient + self.prior_gradient(points)

    def prior_gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of the log prior density, (points, k)."""
        return np.concatenate(
            [block.gradient(x[:, part], self.prior, self.sbar) for block, part in self._parts],
            axis=1,
        )

    # --- What engines ask for -------------------------------------------------------------------------

    def starts(self) -> FloatArray:
        """A grid on the scale of the stimuli, at the typical interval, shape (starts, k); points of density 0 are left out.

        Where no point is left, an answer that was given is impossible under the model, which is refused.
        """
        subject = self.subject
        steps = np.abs(subject.s2 - subject.s1)
        scale = float(np.sqrt(np.mean(steps[steps > 0] ** 2))) if np.any(steps > 0) else 0.3
        peak = float(logit(((subject.n_yes + 1.0) / (subject.n_trials + 2.0)).max()))
        axes = np.meshgrid(
            *(values for block in self.model.free for values in block.grid(scale, peak))
        )
        points: FloatArray = np.stack([axis.ravel() for axis in axes], axis=-1)
        if (
            self._offset_place is not None
            and "logit_q0" in self.model.link.coordinates
            and "logit_q0" not in self._places
        ):
            points = np.concatenate([points, *map(self._between_pairs, np.unique(points, axis=0))])
        if (
            self._intervals is not None
        ):  # offset and width are those at the typical interval: what they are at the reference
            at = self._scales_at(
                points, typical_interval(np.asarray(subject.isi) / self.reference, subject.n_trials)
            )
            points[:, self._places["offset"]] /= at.pull[:, 0]
            points[:, self._places["log_width"]] -= np.log(at.width[:, 0])
        some = np.isfinite(self.log_density(points))
        return points[some] if some.any() else self._refuse(points)

    def _between_pairs(self, point: FloatArray) -> FloatArray:
        """Copies of a point with offsets between those that put a pair on the axis, shape (offsets, k).

        Where identical stimuli are never called 'different' such an offset is impossible if the pair ever was: a wall, with a maximum of
        its own on each side.
        """
        walls = np.unique(
            (self.subject.s2 - self.subject.s1)
            + self._pull(point[None])[0] * (self.subject.s1 - self.sbar)
        )
        moved, offsets = (
            np.repeat(point[None], len(walls) - 1, axis=0),
            0.5 * (walls[1:] + walls[:-1]),
        )
        moved[:, self._offset_place] = offsets
        return moved

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
        return np.concatenate(
            [block.sample(rng, size, self.prior, self.sbar) for block, _ in self._parts], axis=1
        )

    def levelling(self, modes: FloatArray) -> Levels:
        """Coordinates in which mixtures fit: the funnel of a free prior mean straightened, probits in the place of logits."""
        pull, logits = (
            self.model.pull,
            tuple(i for name, i in self._places.items() if name.startswith("logit_")),
        )
        if pull is None or pull.centre is None:
            return Levelling(logits, self._places["log_width"])
        mu1 = self.prior.distribution(pull.centre)
        funnel = Funnel.at(
            modes, lambda x: self.likelihood_gradient(x)[1], mu1, self.sbar, pull.span
        )
        return Levelling(logits, self._places["log_width"], funnel)

    def for_subject(self, subject: Subject) -> Posterior:
        """The same model with the same prior for other answers or other pairs, with the same centre and reference interval."""
        return replace(self, subject=subject, centre=self.sbar, interval=self.reference)

    def to_group(self, x: FloatArray) -> FloatArray:
        """The quantities of :attr:`Model.group` on their group scales, shape (points, k) -> (points, k)."""
        return np.concatenate(
            [block.to_group(x[:, part], self.prior, self.sbar) for block, part in self._parts],
            axis=1,
        )

    def from_group(self, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The inverse: x, shape (points, k), and dx/d(eta), shape (points, k, k)."""
        x, jacobian = np.empty(eta.shape), np.zeros((*eta.shape, eta.shape[1]))
        for block, part in self._parts:
            x[:, part], jacobian[:, part, part] = block.from_group(
                eta[:, part], self.prior, self.sbar
            )
        return x, jacobian

    # --- What readers ask for -------------------------------------------------------------------------

    def gain(self, x: FloatArray, seconds: FloatArray) -> FloatArray:
        """Weight of the first stimulus at intervals, (points, k) and (intervals,) -> (points, intervals); no unit."""
        scale = self._scales_at(x, seconds / self.reference).pull
        return np.asarray(1.0 - np.broadcast_to(self._pull(x) * scale, (len(x), len(seconds))))

    def yes_at_distance(self, x: FloatArray, z: FloatArray) -> FloatArray:
        """P of the answer that the task counts at normalised distances, (points, k) and (n,) -> (points, n)."""
        return np.asarray(
            np.exp(
                self.model.link.log_answers(
                    np.broadcast_to(z, (len(x), len(z))), *self._own(x, self.model.link)
                )[0]
            )
        )

    def noticeable(self, x: FloatArray) -> FloatArray:
        """Just noticeable normalised distance, (points, k) -> (points,); of the answers that depend on the stimuli.

        'Equal' is there half as often as at its peak, or 'second' has 75 %.
        """
        link = self.model.link_without_lapses
        if isinstance(link.noticeable, float):
            return np.full(len(x), link.noticeable)
        return link.noticeable(*(part[:, 0] for part in self._own(x, link)))

    @property
    def names(self) -> Names:
        """What the quantities are called."""
        published = ("pse_shift", "jnd") if self._offset_place is not None else ("jnd",)
        return sum(
            (block.names for block in self.model.free), start=Names((), (), published, published)
        )

    def quantities(self, x: FloatArray) -> dict[str, FloatArray]:
        """Every named quantity, each with the shape of x without its last axis.

        The shift of the point of subjective equality, at the mean first stimulus, is the offset; the just noticeable difference is the
        distance of the stimuli at which 'equal' is half as frequent as at its peak, or P(second) 75 %, leaving lapses aside.
        """
        found = {
            name: values
            for block, part in self._parts
            for name, values in block.named(x[..., part], self.prior, self.sbar).items()
        }
        found["jnd"] = found["width"] * self.noticeable(x.reshape(-1, x.shape[-1])).reshape(
            x.shape[:-1]
        )
        return found | ({"pse_shift": found["offset"]} if "offset" in found else {})

    def judged(self, x: FloatArray) -> dict[str, FloatArray]:
        """The quantities by which draws are judged: those that are no monotone function of a single other one."""
        repeated = self.names.monotone
        return {name: values for name, values in self.quantities(x).items() if name not in repeated}

    def points(self, quantities: Mapping[str, FloatArray]) -> FloatArray:
        """Unconstrained coordinates, shape (..., k), from named quantities, each of shape (...); they must name all that is free."""
        return np.concatenate(
            [
                block.coordinates_from(quantities, self.prior, self.sbar)
                for block in self.model.free
            ],
            axis=-1,
        )

    def prior_quantile(self, name: str, probability: float) -> float:
        """Prior quantile of a named quantity; from draws, to about half a percent of the prior's range, where it has no short form."""
        if name == "pse_shift":
            return self.prior_quantile("offset", probability)
        if name == "jnd":
            of_width = self.model.link_without_lapses.noticeable
            if isinstance(of_width, float):
                return of_width * self.prior_quantile("width", probability)
            return float(
                np.quantile(
                    self.quantities(self.sample_prior(np.random.default_rng(0), PRIOR_DRAWS))[name],
                    probability,
                )
            )
        for block in self.model.free:
            if name in block.names.all:
                known = block.prior_quantile(name, probability, self.prior, self.sbar)
                return (
                    float(
                        np.quantile(
                            prior_draws(self.model, self.prior, self.sbar)[name], probability
                        )
                    )
                    if known is None
                    else known
                )
        raise InputError(f"unknown quantity {name!r}; there are: {', '.join(self.names.all)}")

    def natural(self, x: npt.ArrayLike) -> Natural:
        """The paper's parameters, of a model that has them all, at unconstrained points, shape (..., k)."""
        found = self.quantities(np.asarray(x, np.float64))
        return Natural(*(found[name] for name in NATURAL))


@lru_cache(maxsize=4)
def prior_draws(model: Model, prior: Prior, sbar: float) -> dict[str, FloatArray]:
    """Draws of every named quantity from the prior; the same for all subjects of a design."""
    rng = np.random.default_rng(0)
    found: dict[str, FloatArray] = {}
    for block in model.free:
        found |= block.named(block.sample(rng, PRIOR_DRAWS, prior, sbar), prior, sbar)
    return found
