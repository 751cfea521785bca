"""One observer in several conditions: some parameters differ between them, others are shared.

`ConditionPosterior` is the posterior. D is the root mean square step and R the standard deviation
of all stimuli.

The coordinates u are those of the observer 'both' (:mod:`bayes_toe.model.parameters`). Where a
parameter differs, its coordinate in condition i is

    u_i = u + h unit X_i a,    a ~ N(0, I),    h = 1/2,

with row i of the design X of :meth:`bayes_toe.data.conditions.Conditions.design`. Any two levels
then differ by N(0, (h unit)^2), whichever is the reference. The units are

    constant error   D/2                so the prior sd of the difference of c is D/4
    contraction      0.25               that of p is 0.125; less where first stimuli are roved
    noise            1 of log sigma_d   that of log sigma_d is 0.5
    lapse rate       1 of its normal score, whose sd is 0.5
    q0               1.2 of its logit, whose sd is 0.6

The mean first stimulus sbar and the scales D and R are those over all conditions: otherwise c would
move with the stimuli of a condition. The evidence is one integral over all conditions; where
nothing differs it is that of the pooled answers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import AnyRng, ArrayPair, FloatArray
from bayes_toe.data.study import Subject, pooled
from bayes_toe.model.distributions import LOG_2PI
from bayes_toe.model.observer import DEFAULT_PRIOR, ObserverBatch, ObserverPosterior, OrderModel
from bayes_toe.model.parameters import (
    CONSTANT_ERROR,
    CONTRACTION,
    LAPSE_RATE,
    NOISE,
    PEAK,
    ObserverPrior,
    Parameter,
    task_parameters,
)
from bayes_toe.model.posterior import Transform, require_points

#: Prior standard deviation h of the difference between two levels, in the unit of the parameter.
DIFFERENCE_SD = 0.5
#: What h counts in, as a multiple of the parameter's coordinate; that of the noise is over its sd.
DIFFERENCE_UNITS: Mapping[Parameter, float] = {
    CONSTANT_ERROR: 1.0,
    CONTRACTION: 1.0,
    NOISE: 1.0,
    LAPSE_RATE: 1.0,
    PEAK: 1.2,
}


@dataclass(frozen=True, eq=False)
class ConditionPosterior:
    """The joint posterior of a subject's conditions.

    Points have the shape (points, k + differences): the k coordinates of the observer 'both', then
    a coordinate for each parameter that differs and each column of the design.

    Attributes
    ----------
    units : tuple of Subject
        The answers in each condition.
    design : ndarray, shape (conditions, columns)
    differing : tuple of Parameter
        Keys of :data:`DIFFERENCE_UNITS`.

    Examples
    --------
    >>> left = Subject("S@left", [0.0, 0.3], [0.3, 0.0], [5, 9], [20, 20], condition="left")
    >>> right = Subject("S@right", [0.0, 0.3], [0.3, 0.0], [15, 9], [20, 20], condition="right")
    >>> design = np.array([[-0.5], [0.5]])
    >>> posterior = ConditionPosterior((left, right), design, (CONTRACTION,))
    >>> posterior.coordinates[-2:]
    ('contraction', 'contraction 1')
    """

    units: tuple[Subject, ...]
    design: FloatArray
    differing: tuple[Parameter, ...] = ()
    prior: ObserverPrior = DEFAULT_PRIOR

    @cached_property
    def subject(self) -> Subject:
        """All answers of the subject."""
        return pooled(self.units)

    @cached_property
    def shared(self) -> ObserverPosterior:
        """The posterior of all answers, where nothing differs."""
        return OrderModel("both").posterior(self.subject, self.prior)

    @cached_property
    def batch(self) -> ObserverBatch:
        """A row for each condition, on the scales of all answers."""
        scales = [self.shared.scales] * len(self.units)
        return ObserverBatch.from_subjects(self.units, self.prior, scales)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the task, in the order of the coordinates."""
        return task_parameters(self.subject.task)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        names = list(self.shared.coordinates)
        for parameter in self.differing:
            names += [f"{parameter.name} {i + 1}" for i in range(self.design.shape[1])]
        return tuple(names)

    @cached_property
    def steps(self) -> FloatArray:
        """The change of each coordinate by a difference, (conditions, differences, k)."""
        n_conditions, n_columns = self.design.shape
        k = len(self.parameters)
        steps = np.zeros((n_conditions, len(self.differing), n_columns, k))
        for i, parameter in enumerate(self.differing):
            unit = DIFFERENCE_UNITS[parameter]
            if parameter == NOISE:
                unit /= self.prior.noise_sd
            index = self.parameters.index(parameter)
            steps[:, i, :, index] = DIFFERENCE_SD * unit * self.design
        return steps.reshape(n_conditions, -1, k)

    def in_conditions(self, x: FloatArray) -> FloatArray:
        """The observer's coordinates in each condition, (conditions, points, k)."""
        k = len(self.parameters)
        return x[:, :k] + x[:, k:] @ self.steps

    def quantities(self, x: FloatArray) -> dict[str, FloatArray]:
        """The observer's quantities in each condition, natural units, (conditions, points) each."""
        return self.shared.quantities(self.in_conditions(x))

    # --- Densities -------------------------------------------------------------------------------

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density, (points, k + differences) -> (points,)."""
        points = require_points(x, len(self.coordinates))
        k = len(self.parameters)
        of_differences = -0.5 * (np.square(points[:, k:]) + LOG_2PI).sum(axis=1)
        return self.shared.log_prior(points[:, :k]) + of_differences

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood of all conditions, without binomial coefficients, (points,)."""
        points = require_points(x, len(self.coordinates))
        return self.batch.log_likelihood(self.in_conditions(points)).sum(axis=0)

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Log posterior density, (points,); its integral is the evidence."""
        return self.log_likelihood(x) + self.log_prior(x)

    def gradient(self, x: npt.ArrayLike) -> ArrayPair:
        """Log posterior density, (points,), and its gradient, (points, k + differences)."""
        points = require_points(x, len(self.coordinates))
        k = len(self.parameters)
        value, slopes = self.batch.gradient(self.in_conditions(points))
        of_prior = self.shared.batch.prior_slopes(points[None, :, :k])[0][0]
        of_differences = np.einsum("cpk,cdk->pd", slopes, self.steps)
        shared_slope = slopes.sum(axis=0) + of_prior
        difference_slope = of_differences - points[:, k:]
        slope = np.concatenate([shared_slope, difference_slope], axis=1)
        return value.sum(axis=0) + self.log_prior(points), slope

    # --- What engines ask for --------------------------------------------------------------------

    def starts(self) -> FloatArray:
        """The starts for all answers together, without differences."""
        return self.without_differences(self.shared.starts())

    def without_differences(self, u: FloatArray) -> FloatArray:
        """Points of the observer, (points, k), as points at which conditions are alike."""
        return np.pad(u, ((0, 0), (0, len(self.coordinates) - u.shape[1])))

    def sample_prior(self, rng: AnyRng, size: int) -> FloatArray:
        """Independent draws from the prior, shape (size, k + differences)."""
        shared = self.shared.sample_prior(rng, size)
        differences = rng.standard_normal((size, self.steps.shape[1]))
        return np.concatenate([shared, differences], axis=1)

    def transform(self, modes: FloatArray) -> Transform:
        """The coordinates as they are."""
        return self.shared.transform(modes)
