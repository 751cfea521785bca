"""The posteriors of several subjects or models as one array.

A posterior has one or several rows of counts: a subject has one, or one for each condition. The
coordinates of a row are linear in those of its posterior:

    u = L w,   L the loading of the row.

A model is a choice of coordinates. All other coordinates are held at 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, IndexArray, Texts
from bayes_toe.model.answer_curves import AnswerRows
from bayes_toe.model.densities import Priors, by_coordinate


@dataclass(frozen=True, eq=False)
class LinearLikelihood:
    """The likelihood of several posteriors.

    Points w have the shape (posteriors, points, d).

    Attributes
    ----------
    rows : AnswerRows
    loading : ndarray, shape (rows, k, d)
    first_row : ndarray of int, shape (posteriors,)
        The first row of each posterior, whose rows stand together.
    further_tasks : tuple of LinearLikelihood
        The likelihoods of the answers to further tasks, with rows of every posterior. `rows` are of
        the task that has all coordinates of the observer.
    """

    rows: AnswerRows
    loading: FloatArray
    first_row: IndexArray
    further_tasks: tuple[LinearLikelihood, ...] = field(default=(), kw_only=True)

    @cached_property
    def sizes(self) -> IndexArray:
        """The number of rows of every posterior."""
        return np.diff(np.append(self.first_row, len(self.loading)))

    def part(self, index: IndexArray) -> LinearLikelihood:
        """The likelihood of the posteriors with these indices; an index may come more than once."""
        sizes = self.sizes[index]
        first_row = np.cumsum(sizes) - sizes  # of each posterior in the part
        # Row i of the part is row i + shift of all rows, with one shift for each posterior.
        shift = np.repeat(self.first_row[index] - first_row, sizes)
        rows = np.arange(sizes.sum()) + shift
        further_tasks = tuple(task.part(index) for task in self.further_tasks)
        return LinearLikelihood(
            self.rows.part(rows), self.loading[rows], first_row, further_tasks=further_tasks
        )

    def row_points(self, w: FloatArray) -> FloatArray:
        """Coordinates u = L w of the rows, (posteriors, points, d) -> (rows, points, k)."""
        w_of_rows = np.repeat(w, self.sizes, axis=0)  # each row has the points of its posterior
        return w_of_rows @ self.loading.swapaxes(1, 2)

    def value(self, w: FloatArray) -> FloatArray:
        """Log likelihood without binomial coefficients, (posteriors, points)."""
        value = self.summed(self.rows.log_likelihood(self.row_points(w)))
        for task in self.further_tasks:
            value = value + task.value(w)
        return value

    def scoring(self, w: FloatArray) -> tuple[FloatArray, ...]:
        """Log likelihood, gradient and Fisher information, (posteriors, points[, d[, d]])."""
        value, slope, information = self.rows.scoring(self.row_points(w))
        # The chain rule of u = L w. Where an answer is impossible, an infinite slope times 0 is
        # NaN; the value is -inf there, so that no search goes there.
        loading = self.loading[:, None]  # with an axis for the points
        with np.errstate(invalid="ignore"):
            slope = slope @ self.loading
            information = loading.swapaxes(2, 3) @ information @ loading
        sums = tuple(map(self.summed, (value, slope, information)))
        for task in self.further_tasks:
            sums = tuple(map(np.add, sums, task.scoring(w)))
        return sums

    def summed(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Sums of values over the rows of every posterior, (rows, ...) -> (posteriors, ...)."""
        if len(self.first_row) == len(values):  # each posterior has one row
            return values
        return np.add.reduceat(values, self.first_row, axis=0)


@dataclass(frozen=True, eq=False)
class PosteriorArray:
    """Posteriors that share their coordinates w, (posteriors, points, d).

    The first k coordinates are those of the observer, and every row has them.

    Attributes
    ----------
    likelihood : LinearLikelihood
    names : tuple of str
        Names of the d coordinates.
    further_priors : tuple of PriorDensity
        Priors of the coordinates that follow those of the observer.
    is_free : ndarray of bool, shape (posteriors, d)
        The coordinates that each posterior's model has.
    """

    likelihood: LinearLikelihood
    names: Texts
    further_priors: Priors
    is_free: BoolArray

    def __len__(self) -> int:
        return len(self.is_free)

    def part(self, index: IndexArray) -> PosteriorArray:
        """The posteriors with these indices; an index may come more than once."""
        return replace(self, likelihood=self.likelihood.part(index), is_free=self.is_free[index])

    @cached_property
    def priors(self) -> Priors:
        """The prior of every coordinate."""
        # One row of each posterior, because priors may differ between subjects.
        likelihood = self.likelihood
        return (*likelihood.rows.part(likelihood.first_row).priors, *self.further_priors)

    def log_prior(self, w: FloatArray) -> FloatArray:
        """Log prior density of the free coordinates, (posteriors, points)."""
        log_densities = by_coordinate(self.priors, "log_density", w)
        return np.where(self.is_free[:, None], log_densities, 0.0).sum(axis=-1)

    def prior_slopes(self, w: FloatArray) -> ArrayPair:
        """Gradient of the log prior, and a positive stand-in for its negative curvature.

        The shape of both is (posteriors, points, d).
        """
        priors = self.priors
        return by_coordinate(priors, "slope", w), by_coordinate(priors, "curvature", w)

    def prior_points(self, probability: FloatArray) -> FloatArray:
        """Quantiles of the prior, (posteriors, points, d); 0 where a coordinate is held."""
        quantiles = by_coordinate(self.priors, "quantile", probability)
        return np.where(self.is_free[:, None], quantiles, 0.0)

    def densities(self, w: FloatArray) -> ArrayPair:
        """Log prior and log posterior density, (posteriors, points)."""
        log_prior = self.log_prior(w)
        log_posterior = self.likelihood.value(w) + log_prior
        # At an impossible contraction, abs(p) of 1 or more, the density is 0.
        log_posterior[~np.isfinite(log_prior)] = -np.inf
        return log_prior, log_posterior

    def original(self, w: FloatArray) -> ArrayPair:
        """Points u in the coordinates of the priors, and log |dw/du|: here w itself, and 0."""
        return w, np.zeros(w.shape[:-1])


def loading_of(names: Sequence[str], columns: Iterable[tuple[str, FloatArray]]) -> FloatArray:
    """The loading L of each row, u = L w, shape (rows, k, d).

    Parameters
    ----------
    names : sequence of str
        The k coordinates u of a row.
    columns : iterable of (str, ndarray of shape (rows, n))
        The d coordinates w, in their order: a coordinate of the row, and what each of n coordinates
        w adds to it.
    """
    blocks = []
    for name, factors in columns:
        n_rows, n_columns = factors.shape
        block = np.zeros((n_rows, len(names), n_columns))
        block[:, names.index(name)] = factors
        blocks.append(block)
    return np.concatenate(blocks, axis=2)


def independent_array(rows: AnswerRows, free_names: Sequence[Sequence[str]]) -> PosteriorArray:
    """A posterior for each row, with the row's coordinates of these names.

    Parameters
    ----------
    rows : AnswerRows
    free_names : sequence of (sequence of str)
        The coordinates that the model of each row has.
    """
    names = rows.coordinates
    n_rows = len(rows.counts)
    # A row has the coordinates of its posterior: L is the identity.
    loading = np.broadcast_to(np.eye(len(names)), (n_rows, len(names), len(names)))
    likelihood = LinearLikelihood(rows, loading, np.arange(n_rows))
    is_free = np.array([np.isin(names, list(free)) for free in free_names])
    return PosteriorArray(likelihood, names, further_priors=(), is_free=is_free)
