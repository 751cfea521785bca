"""The posterior of one subject under one model.

`SubjectPosterior` has what the posteriors of all models have in common: their densities, by a
:class:`bayes_toe.model.posterior_array.PosteriorArray` of one posterior, and the quantiles of the
prior.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import AnyRng, BoolArray, FloatArray, NamedArrays, Texts
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError, NumericalError
from bayes_toe.model.answer_curves import AnswerRows
from bayes_toe.model.parameters import QUANTITY_BY_NAME
from bayes_toe.model.posterior_array import PosteriorArray, independent_array

#: The range of quantiles that :func:`posterior_contraction` compares.
RANGE = (0.05, 0.95)
#: Contraction below which a parameter is said to be dominated by its prior: a range narrowed by
#: less than three tenths.
DOMINATED = 0.5


@dataclass(frozen=True)
class Names:
    """Names of quantities: as many natural and as many identified names as coordinates."""

    natural: Texts  # what the model is written in
    identified: Texts  # what the answers depend on
    derived: Texts = ()  # further quantities that tables report
    # For a monotone function of another quantity: that other quantity, which has the same ranks.
    same_ranks: Mapping[str, str] = field(default_factory=dict)

    @property
    def reported(self) -> Texts:
        """The natural and the derived quantities, in the order of tables and files."""
        return _in_table_order({*self.natural, *self.derived})

    @property
    def all(self) -> Texts:
        """Every name, in the order of tables and files."""
        return _in_table_order({*self.natural, *self.identified, *self.derived})


def _in_table_order(names: set[str]) -> Texts:
    """Names of quantities in the order of tables and files."""
    return tuple(filter(names.__contains__, QUANTITY_BY_NAME))


class SubjectPosterior(ABC):
    """The posterior of one subject under one model.

    Points x have the shape (points, k), with the coordinates that the model has.
    """

    subject: Subject

    @property
    @abstractmethod
    def model_name(self) -> str:
        """The name of the model in files, by which random streams are keyed."""

    @property
    @abstractmethod
    def rows(self) -> AnswerRows:
        """The counts, as one row."""

    @property
    @abstractmethod
    def sbar(self) -> float:
        """The intensity from which constant errors and offsets count, natural-log units."""

    @property
    @abstractmethod
    def names(self) -> Names:
        """The names of the quantities."""

    @abstractmethod
    def for_subject(self, subject: Subject) -> Self:
        """The same model with the same prior and scales for other answers or other pairs."""

    @abstractmethod
    def quantities(self, x: FloatArray) -> NamedArrays:
        """Every named quantity, each with the shape of x without its last axis."""

    @abstractmethod
    def points(self, quantities: NamedArrays) -> FloatArray:
        """Points, shape (..., k), from natural quantities of shape (...)."""

    @property
    def coordinates(self) -> Texts:
        """Names of the coordinates that the model has."""
        return self.rows.coordinates

    @cached_property
    def array(self) -> PosteriorArray:
        """This posterior as an array of one posterior, with all coordinates of the task."""
        return independent_array(self.rows, [self.coordinates])

    @property
    def is_free(self) -> BoolArray:
        """Which coordinates of the task the model has, shape (all,)."""
        return self.array.is_free[0]

    def full_points(self, x: npt.ArrayLike) -> FloatArray:
        """Points with all coordinates of the task, (points, k) -> (1, points, all)."""
        k = len(self.coordinates)
        points = np.atleast_2d(np.asarray(x, np.float64))
        if points.ndim != 2 or points.shape[1] != k:
            raise NumericalError(f"points must have shape (points, {k}), found {points.shape}")
        if np.isnan(points).any():
            raise NumericalError("a coordinate is NaN")

        full = np.zeros((1, len(points), len(self.array.names)))
        full[0][:, self.is_free] = points
        return full

    # --- Densities -------------------------------------------------------------------------------

    def log_answers(self, x: npt.ArrayLike) -> FloatArray:
        """Log probability of each answer to every pair, (answers, points, pairs).

        The answer that the task counts comes first. Of three answers, the paper's model has 'equal'
        and not 'equal'.
        """
        log_answers = self.rows.log_answers(self.full_points(x))  # (1, points, pairs) each
        return np.concatenate(log_answers)

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood without binomial coefficients, (points, k) -> (points,)."""
        return self.rows.log_likelihood(self.full_points(x))[0]  # of the one row

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density of the coordinates, (points, k) -> (points,)."""
        return self.array.log_prior(self.full_points(x))[0]  # of the one posterior

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Log posterior density, (points, k) -> (points,); its integral is the evidence."""
        return self.log_likelihood(x) + self.log_prior(x)

    # --- Prior -----------------------------------------------------------------------------------

    def sample_prior(self, rng: AnyRng, size: int) -> FloatArray:
        """Independent draws from the prior, shape (size, k)."""
        return self._prior_points(rng.uniform(size=(size, len(self.array.names))))

    def _prior_points(self, probability: FloatArray) -> FloatArray:
        """Points at quantiles of the prior, (points, all) -> (points, k)."""
        return self.array.prior_points(probability[None])[0][:, self.is_free]

    def prior_quantile(self, name: str, probability: float) -> float:
        """Prior quantile of a quantity.

        A quantity that no coordinate alone determines has its quantile from evenly spread points of
        the prior.

        Raises
        ------
        InputError
            If there is no such quantity.
        """
        if name not in self.names.all:
            raise InputError(f"unknown quantity {name!r}; there are: {', '.join(self.names.all)}")
        coordinate = self.names.same_ranks.get(name, name)
        if coordinate not in self.coordinates:
            return float(np.quantile(self._prior_quantities[name], probability))

        # The quantity has its quantile where its coordinate has the same quantile, or where the
        # coordinate has that from above, if the quantity falls where the coordinate rises. All
        # other coordinates, which do not matter, are at their medians.
        probabilities = np.full((2, len(self.array.names)), 0.5)  # (points, coordinates)
        probabilities[:, self.array.names.index(coordinate)] = probability, 1.0 - probability
        low, high = sorted(self.quantities(self._prior_points(probabilities))[name].tolist())
        return float(low if probability < 0.5 else high)

    @cached_property
    def _prior_quantities(self) -> NamedArrays:
        """Every named quantity at 2^14 evenly spread points of the prior."""
        # Only here, because a quick command needs no Sobol points, and scipy.stats loads slowly.
        from scipy.stats import qmc

        sobol = qmc.Sobol(len(self.array.names), rng=np.random.default_rng(0))
        return self.quantities(self._prior_points(sobol.random_base2(14)))


def posterior_contraction(
    target: SubjectPosterior, parameter: str, low: float, high: float
) -> float:
    """How much the answers narrow a parameter, with posterior quantiles `low` and `high`.

    contraction = 1 - (posterior width / prior width)^2, widths from the 5 % to the 95 % quantile.
    For normal densities it is one minus the ratio of variances. Where mu1 has a funnel, rare far
    draws determine its variance, but not its quantiles. 1: all from the data; 0: as wide as the
    prior; negative: wider.

    Examples
    --------
    >>> from bayes_toe.model.paper_model import paper_posterior
    >>> subject = Subject("S01", [0.0], [0.3], [20], [50])
    >>> round(posterior_contraction(paper_posterior(subject), "q0", 0.5, 0.59), 2)
    0.97
    """
    prior_low, prior_high = (target.prior_quantile(parameter, probability) for probability in RANGE)
    return 1.0 - ((high - low) / (prior_high - prior_low)) ** 2
