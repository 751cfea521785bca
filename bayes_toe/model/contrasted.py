"""One subject in several conditions: a model of which some quantities differ between them; a target of the engines like any other.

On the scales eta on which members of a group scatter (:meth:`bayes_toe.model.record.Model.group`), in units of each quantity's prior,

    eta_c = eta + unit h X_c a,    a ~ N(0, I),    h = 1/2,

with the columns X of :meth:`bayes_toe.data.conditions.Conditions.design`, so that any two levels differ by N(0, (unit h)^2) beforehand.
A unit is D/2 of a constant error, 2.5 R of mu1, 1 of the log of the width and of a probit: the sd of the single subject's prior. What does
not differ is shared, and so are the scales and the mean first stimulus, which are those over all conditions. The evidence of the
conditions is one integral: where nothing differs it is that of the pooled answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.model.distributions import LOG_2PI, Random
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import Levels, require_points

#: Prior sd h of the difference between two levels, in the units of each quantity.
DIFFERENCE = 0.5
#: What conditions may change, as readers know it, by the quantities of models that it is of.
QUANTITIES = {
    "constant error": ("offset", "mu1"),
    "pull": ("pull", "gamma", "gain"),
    "width": ("width",),
    "lapses": ("q0", "lapse_rate", "guess_second"),
}
#: Those that an effect of the order is made of.
OF_ORDER = ("constant error", "pull")
_NARROW = {
    "q0": 0.7,
    "lapse_rate": 0.6,
    "gain": 0.4,
}  # sds of probits, as a population's mean has them


@dataclass(frozen=True)
class _Padded:
    """Levelled coordinates of the first k, and further ones that are normal as they are."""

    first: Levels
    k: int

    def level(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As :meth:`~bayes_toe.model.target.Levels.level`."""
        y, log_volume = self.first.level(x[:, : self.k])
        return np.concatenate([y, x[:, self.k :]], axis=1), log_volume

    def unlevel(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As :meth:`~bayes_toe.model.target.Levels.unlevel`."""
        x, log_volume = self.first.unlevel(y[:, : self.k])
        return np.concatenate([x, y[:, self.k :]], axis=1), log_volume


@dataclass(frozen=True, eq=False)
class Contrasted(Posterior):
    """The joint posterior of a subject's conditions; the coordinates of the model, shared, come first, then those of the differences.

    The subject has all answers, the units those of each condition, for which the design has a row. What differs are keys of
    :data:`QUANTITIES`.

    Examples
    --------
    >>> from bayes_toe.model.parts import compose
    >>> a, b = (Subject(f"S@{at}", [0.0, 0.3], [0.3, 0.0], [k, 9], [20, 20], condition=at) for at, k in (("a", 5), ("b", 15)))
    >>> whole = Subject("S", [0.0, 0.3], [0.3, 0.0], [20, 18], [40, 40])
    >>> found = Contrasted(whole, compose(order="contraction"), units=(a, b), design=np.array([[-0.5], [0.5]]), differing=("width",))
    >>> found.coordinates
    ('offset', 'logit_pull', 'log_width', 'logit_q0', 'width 1')
    """

    units: tuple[Subject, ...] = ()
    design: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    differing: tuple[str, ...] = ()

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        columns = range(1, self.design.shape[1] + 1)
        return self.model.coordinates + tuple(
            f"{self.model.group[place]} {i}" for place in self._moved for i in columns
        )

    @cached_property
    def pooled(self) -> Posterior:
        """The posterior where nothing differs."""
        return Posterior(self.subject, self.model, self.prior, self.sbar, self.reference)

    @cached_property
    def parts(self) -> tuple[Posterior, ...]:
        """Those of the conditions by themselves, with the scales of the whole."""
        return tuple(
            Posterior(one, self.model, self.prior, self.sbar, self.reference) for one in self.units
        )

    @cached_property
    def _moved(self) -> list[int]:
        """Places of the quantities that differ."""
        moved = {name for key in self.differing for name in QUANTITIES[key]}
        return [place for place, name in enumerate(self.model.group) if name in moved]

    @cached_property
    def _steps(self) -> FloatArray:
        """What a coordinate of a difference adds to each eta in each condition, shape (conditions, differences, k)."""
        unit = [unit_of(self.model.group[place], self.prior) for place in self._moved]
        found = np.zeros(
            (len(self.units), len(self._moved), self.design.shape[1], len(self.model.group))
        )
        for i, (place, size) in enumerate(zip(self._moved, unit, strict=True)):
            found[:, i, :, place] = DIFFERENCE * size * self.design
        return found.reshape(len(self.units), -1, len(self.model.group))

    def to_group(self, x: FloatArray) -> FloatArray:
        """Shared quantities on their group scales, and differences over the columns of the design, (points, k + differences), the same."""
        k, sizes = (
            len(self.model.coordinates),
            [unit_of(self.model.group[place], self.prior) for place in self._moved],
        )
        units = DIFFERENCE * np.repeat(sizes, self.design.shape[1])
        return np.concatenate([self.pooled.to_group(x[:, :k]), x[:, k:] * units], axis=1)

    def in_conditions(self, x: FloatArray) -> FloatArray:
        """The model's own coordinates in every condition, (points, k + differences) -> (points, conditions, k)."""
        return np.stack([at for at, _ in self._moved_to(x)], axis=1)

    def _moved_to(self, x: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Coordinates in every condition, (points, k), and their derivatives in eta, (points, k, k)."""
        k = len(self.model.coordinates)
        eta = self.pooled.to_group(x[:, :k])
        return [self.pooled.from_group(eta + x[:, k:] @ step) for step in self._steps]

    # --- Densities ------------------------------------------------------------------------------------

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density at x, shape (points, k + differences) -> (points,)."""
        points, k = require_points(x, len(self.coordinates)), len(self.model.coordinates)
        return np.asarray(
            self.pooled.log_prior(points[:, :k])
            - 0.5 * (np.square(points[:, k:]) + LOG_2PI).sum(axis=1)
        )

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Sum of those of the conditions, (points,)."""
        points = require_points(x, len(self.coordinates))
        return np.asarray(
            sum(
                part.log_likelihood(at)
                for part, (at, _) in zip(self.parts, self._moved_to(points), strict=True)
            )
        )

    def prior_gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of the log prior density, (points, k + differences)."""
        k = len(self.model.coordinates)
        return np.concatenate([self.pooled.prior_gradient(x[:, :k]), -x[:, k:]], axis=1)

    def likelihood_gradient(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log likelihood and its gradient, (points, k + differences), with d eta/dx of the shared ones, the inverse of dx/d eta."""
        k = len(self.model.coordinates)
        eta = self.pooled.to_group(x[:, :k])
        value, shared, own = (
            np.zeros(len(x)),
            np.zeros((len(x), k)),
            np.zeros((len(x), x.shape[1] - k)),
        )
        for part, step in zip(self.parts, self._steps, strict=True):
            at, jacobian = part.from_group(eta + x[:, k:] @ step)
            of_part, slope = part.likelihood_gradient(at)
            by_eta = (slope[:, None, :] @ jacobian)[:, 0]
            value, shared, own = value + of_part, shared + by_eta, own + by_eta @ step.T
        back = np.linalg.solve(self.pooled.from_group(eta)[1].swapaxes(1, 2), shared[:, :, None])[
            :, :, 0
        ]
        return value, np.concatenate([back, own], axis=1)

    # --- What engines ask for -------------------------------------------------------------------------

    def starts(self) -> FloatArray:
        """Those of the pooled answers, without differences."""
        return self.without_differences(self.pooled.starts())

    def without_differences(self, x: FloatArray) -> FloatArray:
        """Points of the model, (points, k), as points of this, where conditions are alike."""
        return np.pad(x, ((0, 0), (0, len(self.coordinates) - x.shape[1])))

    def sample_prior(self, rng: Random, size: int) -> FloatArray:
        """Independent draws from the prior, shape (size, k + differences)."""
        shared = self.pooled.sample_prior(rng, size)
        return np.concatenate(
            [shared, rng.standard_normal((size, len(self.coordinates) - shared.shape[1]))], axis=1
        )

    def levelling(self, modes: FloatArray) -> Levels:
        """That of the pooled answers; differences are normal as they are."""
        k = len(self.model.coordinates)
        return _Padded(self.pooled.levelling(modes[:, :k]), k)

    def values(self, x: FloatArray) -> dict[str, FloatArray]:
        """Constant error, pull and width, as far as the model has them, of coordinates in every condition, (..., k) -> (...) each."""
        found = self.pooled.quantities(x)
        found |= {"pull": 1.0 - found["gain"]} if "gain" in found and "pull" not in found else {}
        named = {"constant error": "offset", "pull": "pull", "width": "width"}
        return {key: found[name] for key, name in named.items() if name in found}


def unit_of(name: str, prior: Prior) -> float:
    """The sd of a quantity's prior on its group scale: what differences are counted in."""
    return prior.distribution(name).spread if name in ("offset", "mu1") else _NARROW.get(name, 1.0)


def contrasted(
    posterior: Posterior, units: Sequence[Subject], design: FloatArray, differing: Sequence[str]
) -> Contrasted:
    """The posterior of pooled answers as one of several conditions."""
    return Contrasted(
        *(posterior.subject, posterior.model, posterior.prior, posterior.sbar, posterior.reference),
        units=tuple(units),
        design=design,
        differing=tuple(differing),
    )
