"""Weighted draws of posteriors, from mixtures that are adapted to them: the evidences follow.

`weighted_draws` draws many posteriors at once. Each has a mixture of Student-t densities, to which
the prior joins. The mixture is adapted to a pool of draws (Cornuet et al. 2012) and then fixed:
**fresh draws of the fixed mixture give the evidence**. Draws that helped to choose a mixture would
give too small an evidence, which the spread over seeds cannot show.

`mixture_of_maxima` and `mixture_of_points` are the mixtures to begin with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray, Rng
from bayes_toe.inference.maxima import Ascent
from bayes_toe.inference.proposal import (
    StudentMixture,
    WeightedDraws,
    joined_draws,
    tempered,
)
from bayes_toe.model.posterior_array import PosteriorArray

# --- Mixture ---
_PRIOR_SHARE = 0.1
_LEAST_WEIGHT = 0.05  # of a component, beside the root of its Laplace evidence
_TEMPERED = 60.0  # effective draws that weights are flattened to
_FLOOR = 0.4  # weight that all components keep, beside the 1 that the draws distribute
_NEIGHBOURS = 120  # draws that give a component its shape where one is added at a heavy draw
_ADDED_SHARE = 1.0 / 16.0  # of that component

# --- Draws ---
_FAR = 8.0  # nats below the best of its family at which a posterior needs no further draws
_FEWEST_ASSESSED = 1000
_HEAVY = 0.03  # share of the weight of one draw that sends a posterior back
_POOR = 0.25  # efficiency that sends a posterior back, twice at most
_MOST_RETURNS, _MOST_POOR_RETURNS = 8, 2


@dataclass(frozen=True)
class Precision:
    """The precision at which a posterior has enough fresh draws.

    Attributes
    ----------
    standard_error : float
        Of the log evidence, to reach.
    effective_draws : float
        To reach.
    most_draws : int
        At which a posterior ends in any case.
    round_draws : int
        Draws of a round.
    pool_rounds : int
        Rounds of draws by which a mixture is adapted.
    """

    standard_error: float = 0.03
    effective_draws: float = 250.0
    most_draws: int = 6000
    round_draws: int = 500
    pool_rounds: int = 2


USUAL = Precision()


@dataclass(frozen=True, eq=False)
class PriorMixture:
    """The proposal of one posterior: a mixture of Student-t densities, and a share of the prior.

    A coordinate that the posterior does not have stays at 0 and is no dimension of the mixture.
    """

    is_free: BoolArray  # (d,)
    student: StudentMixture

    def log_density(self, points: FloatArray, log_prior: FloatArray) -> FloatArray:
        """Log density at points, (n, d) -> (n,)."""
        student = self.student.log_density(points[:, self.is_free]) + np.log1p(-_PRIOR_SHARE)
        return np.logaddexp(student, log_prior + np.log(_PRIOR_SHARE))

    def updated(self, draws: WeightedDraws) -> PriorMixture:
        """A step of EM toward draws whose weights are flattened."""
        weights = tempered(draws.log_weights, _TEMPERED)
        inertia = 2.0 * len(self.is_free)
        student = self.student.drawn_toward(draws.x[:, self.is_free], weights, _FLOOR, inertia)
        return replace(self, student=student)

    def sample(self, rng: Rng, size: int) -> tuple[FloatArray, BoolArray]:
        """Draws, shape (n, d), and which of them are to come from the prior instead, (n,)."""
        d = len(self.is_free)
        component = self.student.sample_components(rng, size)
        normal = rng.standard_normal((size, d))[:, self.is_free]
        points = np.zeros((size, d))
        points[:, self.is_free] = self.student.offset(component, normal, rng)
        return points, rng.uniform(size=size) < _PRIOR_SHARE


def mixture_of_maxima(maxima: Ascent, is_free: BoolArray) -> PriorMixture:
    """A component at every maximum of a posterior, weighted by the root of its Laplace evidence."""
    log_mass = maxima.value - 0.5 * np.linalg.slogdet(maxima.curvature)[1]
    weights = np.exp(0.5 * (log_mass - log_mass.max())) + _LEAST_WEIGHT
    scales = np.asarray(np.linalg.inv(maxima.curvature[:, is_free][:, :, is_free]))
    df = _degrees_of_freedom(is_free)
    student = StudentMixture(weights / weights.sum(), maxima.x[:, is_free], scales, df)
    return PriorMixture(is_free, student)


def mixture_of_points(points: FloatArray, is_free: BoolArray) -> PriorMixture:
    """One component with the mean and covariance of points, shape (n, d)."""
    free_points = points[:, is_free]
    scale = np.atleast_2d(np.cov(free_points.T))
    means, df = free_points.mean(axis=0)[None], _degrees_of_freedom(is_free)
    return PriorMixture(is_free, StudentMixture(np.ones(1), means, scale[None], df))


def _degrees_of_freedom(is_free: BoolArray) -> int:
    """Degrees of freedom that add up with the dimensions to the same even number in all models."""
    return 2 * ((len(is_free) + 5) // 2) - int(is_free.sum())


def weighted_draws(
    array: PosteriorArray,
    mixtures: Sequence[PriorMixture],
    generators: Sequence[Rng],
    families: IndexArray,
    precision: Precision = USUAL,
) -> list[WeightedDraws]:
    """Fresh draws of every posterior's fixed mixture.

    Parameters
    ----------
    array : PosteriorArray
    mixtures : sequence of PriorMixture
        To begin with, one for each posterior.
    generators : sequence of Generator
        One for each posterior; several may share one.
    families : ndarray of int, shape (posteriors,)
        Posteriors that are compared are of one family: one that is far less probable than the best
        of its family needs no precision.
    precision : Precision
    """
    return _Engine(array, list(mixtures), generators, families, precision).run()


@dataclass(eq=False)
class _Pool:
    """Draws of one posterior, of all rounds by which its mixture was adapted."""

    draws: WeightedDraws  # their proposal: the sum over rounds of draws times density
    mixtures: list[tuple[PriorMixture, int]]  # of every round, with its number of draws

    def join(self, mixture: PriorMixture, draws: WeightedDraws) -> None:
        """Add the draws that a mixture made."""
        self.mixtures.append((mixture, len(draws.x)))
        pooled = joined_draws([self.draws, draws])
        densities = []
        for earlier, count in self.mixtures:
            log_density = earlier.log_density(pooled.x, pooled.log_prior)
            densities.append(log_density + np.log(count))
        self.draws = replace(pooled, log_proposal=np.logaddexp.reduce(densities))


@dataclass(eq=False)
class _Fresh:
    """Fresh draws of one posterior's fixed mixture, and how often it went back."""

    draws: WeightedDraws
    returns: int = 0
    poor_returns: int = 0


@dataclass(eq=False)
class _Engine:
    """The posteriors of an array, from the first mixtures to fresh draws."""

    array: PosteriorArray
    mixtures: list[PriorMixture]
    generators: Sequence[Rng]
    families: IndexArray
    precision: Precision

    def run(self) -> list[WeightedDraws]:
        """The fresh draws of every posterior."""
        n = len(self.array)
        no_draws = WeightedDraws(np.empty((0, len(self.array.names))), *np.empty((3, 0)))
        pools = [_Pool(no_draws, []) for _ in range(n)]
        for _ in range(self.precision.pool_rounds):
            for i, draws in enumerate(self._round(range(n))):
                pools[i].join(self.mixtures[i], draws)
                self.mixtures[i] = self.mixtures[i].updated(pools[i].draws)

        fresh = [_Fresh(no_draws) for _ in range(n)]
        active = list(range(n))
        while active:
            for i, draws in zip(active, self._round(active), strict=True):
                fresh[i].draws = joined_draws([fresh[i].draws, draws])
            active = self._unfinished(active, fresh, pools)
        return [entry.draws for entry in fresh]

    def _round(self, active: Sequence[int]) -> list[WeightedDraws]:
        """Draws of some posteriors, each from its own mixture."""
        n_draws = self.precision.round_draws
        shape = (len(active), n_draws, len(self.array.names))
        probability, points = np.empty(shape), np.empty(shape)
        is_prior = np.empty(shape[:2], np.bool_)
        for row, i in enumerate(active):
            rng = self.generators[i]
            probability[row] = rng.uniform(size=shape[1:])
            points[row], is_prior[row] = self.mixtures[i].sample(rng, n_draws)

        array = self.array.part(np.array(active))
        points = np.where(is_prior[..., None], array.prior_points(probability), points)
        log_prior, log_posterior = array.densities(points)
        draws = []
        for i, x, prior, posterior in zip(active, points, log_prior, log_posterior, strict=True):
            log_proposal = self.mixtures[i].log_density(x, prior)
            draws.append(WeightedDraws(x, prior, posterior, log_proposal))
        return draws

    def _unfinished(
        self, active: Sequence[int], fresh: Sequence[_Fresh], pools: Sequence[_Pool]
    ) -> list[int]:
        """The posteriors that need more draws; those that fit badly get a new mixture first."""
        log_evidences = np.array([entry.draws.log_evidence for entry in fresh])
        going = []
        for i in active:
            draws, log_evidence = fresh[i].draws, log_evidences[i]
            best = log_evidences[self.families == self.families[i]].max()
            is_far = log_evidence + 3.0 * draws.standard_error < best - _FAR
            if is_far or len(draws.x) >= self.precision.most_draws:
                continue
            if _must_return(fresh[i], draws):
                self.mixtures[i] = _refitted(self.mixtures[i], pools[i], fresh[i])
                going.append(i)
                continue
            is_precise = draws.standard_error <= self.precision.standard_error
            if not is_precise or draws.effective_number < self.precision.effective_draws:
                going.append(i)
        return going


def _must_return(fresh: _Fresh, draws: WeightedDraws) -> bool:
    """Whether a mixture misses a part of its posterior; counts how often it did."""
    n_draws = len(draws.x)
    if n_draws < _FEWEST_ASSESSED or fresh.returns >= _MOST_RETURNS:
        return False
    is_heavy = draws.shares.max() > _HEAVY
    is_poor = draws.effective_number < _POOR * n_draws and fresh.poor_returns < _MOST_POOR_RETURNS
    if not (is_heavy or is_poor):
        return False
    fresh.returns += 1
    fresh.poor_returns += not is_heavy
    return True


def _refitted(mixture: PriorMixture, pool: _Pool, fresh: _Fresh) -> PriorMixture:
    """A mixture with a component at its heaviest draw, adapted to all draws that were made."""
    draws = fresh.draws
    heaviest = draws.x[np.argmax(draws.log_weights), mixture.is_free]
    pool.join(mixture, draws)
    fresh.draws = draws.part(slice(0))  # because the mixture changes
    points = pool.draws.x[:, mixture.is_free]
    offsets = points - heaviest
    distance = np.square(offsets / points.std(axis=0)).sum(axis=1)
    near = np.argpartition(distance, _NEIGHBOURS)[:_NEIGHBOURS]
    scale = offsets[near].T @ offsets[near] / _NEIGHBOURS
    student = mixture.student
    component = StudentMixture(np.ones(1), heaviest[None], scale[None], student.df)
    widened = replace(mixture, student=student.joined([component], _ADDED_SHARE))
    return widened.updated(pool.draws)
