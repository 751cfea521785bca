"""Weighted draws of posteriors, from mixtures that are adapted to them: the evidences follow.

`fitted_draws` draws many posteriors at once. Each has a mixture of Student-t densities, to which
the prior joins. The mixture is adapted to a pool of draws (Cornuet et al. 2012) and then fixed:
**fresh draws of the fixed mixture give the evidence**. Draws that helped to choose a mixture would
give too small an evidence, which the spread over seeds cannot show.

`mixture_of_maxima` and `mixture_of_points` are the mixtures to begin with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bayes_toe.arrays import AnyRng, BoolArray, FloatArray, IndexArray, Rng
from bayes_toe.inference.maxima import Ascent
from bayes_toe.inference.mixture import StudentMixture, WeightedDraws, flattened_weights
from bayes_toe.model.posterior_array import PosteriorArray

_CLOUD = 400  # points of the normal about a maximum
_FEWEST_ASSESSED = 1000  # draws by which a mixture is judged, at least


@dataclass(frozen=True)
class Precision:
    """How well a mixture is to fit, and how precise its fresh draws are to be.

    Attributes
    ----------
    standard_error : float
        Standard error of the log evidence that is to be reached.
    effective_draws : float
        Number of effective draws that is to be reached.
    most_draws : int
        Number of draws at which a posterior ends in any case.
    round_draws : int
        Draws of a round.
    pool_rounds : int
        Rounds of draws by which a mixture is adapted.
    floor : float
        Weight that all components share equally, in addition to the weight 1 that the draws
        distribute.
    em_draws : float
        For EM the weights of draws are flattened until so many draws are effective.
    em_steps : int
        Steps of EM in a round.
    n_added : int
        Components that a refitted mixture gets at its heaviest draws.
    largest_share, largest_weight, largest_k : float
        Share of all weight, and weight over the mean, of one draw, and Pareto k of the weights,
        above which a mixture is refitted.
    most_refits : int
        How often a mixture is refitted at most.
    has_cover : bool
        Whether a mixture has wide components, so that no draw in a tail is heavy.
    """

    standard_error: float = 0.03
    effective_draws: float = 250.0
    most_draws: int = 6000
    round_draws: int = 500
    pool_rounds: int = 2
    floor: float = 0.4
    em_draws: float = 60.0
    em_steps: int = 1
    n_added: int = 1
    largest_share: float = 0.03
    largest_weight: float = np.inf
    largest_k: float = np.inf
    most_refits: int = 8
    has_cover: bool = False


#: Enough for an evidence.
USUAL = Precision()
#: Enough for emcee, where a walker stays at a draw of weight w for about w steps.
SHARP = Precision(
    standard_error=0.0,
    most_draws=8000,
    round_draws=2000,
    pool_rounds=3,
    floor=0.05,
    em_draws=400.0,
    em_steps=3,
    n_added=4,
    largest_share=1.0,
    largest_weight=10.0,
    largest_k=0.5,
    most_refits=12,
    has_cover=True,
)


@dataclass(frozen=True, eq=False)
class PriorMixture:
    """The proposal of one posterior: a mixture of Student-t densities, and a share of the prior.

    The core is adapted to the posterior. The cover, if there is one, is adapted to a flattened
    posterior, and so reaches into its tails.

    A coordinate that the posterior does not have stays at 0 and is no dimension of the mixture.
    """

    is_free: BoolArray  # (d,): the coordinates that the posterior has
    core: StudentMixture
    prior_share: float = 0.1
    cover: StudentMixture | None = None

    @cached_property
    def student(self) -> StudentMixture:
        """The core, and the cover with a tenth of the whole."""
        if self.cover is None:
            return self.core
        return self.core.joined(self.cover, share=0.1)

    def log_density(self, points: FloatArray, log_prior: FloatArray) -> FloatArray:
        """Log density at points, (n, d) -> (n,): (1 - share) student + share prior."""
        log_student = self.student.log_density(points[:, self.is_free])
        return np.logaddexp(
            log_student + np.log1p(-self.prior_share), log_prior + np.log(self.prior_share)
        )

    def updated(self, draws: WeightedDraws, precision: Precision) -> PriorMixture:
        """The proposal after steps of EM toward draws.

        The core follows the draws by their flattened weights. The cover is wide, because it follows
        the posterior density to the power 0.3. It begins with six components.
        """
        inertia = 2.0 * len(self.is_free)  # effective draws that move a component half of the way
        points = draws.x[:, self.is_free]

        weights = flattened_weights(draws.log_weights, precision.em_draws)
        core = self.core
        for _ in range(precision.em_steps):
            core = core.em_step(points, weights, precision.floor, inertia)
        if not precision.has_cover:
            return replace(self, core=core)

        flat_log_weights = 0.3 * draws.log_posterior - draws.log_proposal
        flat_weights = flattened_weights(flat_log_weights, precision.em_draws)
        cover = self.cover or _components(points, flat_weights, n=6, df=core.df)
        # Two steps, because the cover need not fit well; with a high floor no component disappears.
        for _ in range(2):
            cover = cover.em_step(points, flat_weights, floor=0.4, inertia=inertia)
        return replace(self, core=core, cover=cover)

    def sample(self, rng: AnyRng, size: int) -> tuple[FloatArray, BoolArray]:
        """Draws, shape (n, d), and which of them are to come from the prior instead, (n,)."""
        shape = size, len(self.is_free)
        component = self.student.sample_components(rng, size)
        # Every model takes a random number for every coordinate of the task, also for a coordinate
        # that it does not have. So later draws do not depend on the coordinates of the model.
        normal = rng.standard_normal(shape)[:, self.is_free]
        points = np.zeros(shape)
        points[:, self.is_free] = self.student.draws_from(component, normal, rng)
        is_from_prior = rng.uniform(size=size) < self.prior_share
        return points, is_from_prior


def _components(points: FloatArray, weights: FloatArray, n: int, df: int) -> StudentMixture:
    """Components at some of the points, (points, d), chosen by weights that sum to 1.

    Points are in random order, so that neighbours in the array are not near each other. All
    components have the covariance of the points as their scale matrix. The factor 0.7 moves
    them toward the mean of the points, so that the mixture is not much wider than the points.
    """
    centre = weights @ points
    # Systematic resampling: one point for each n-th part of the weight.
    indices = np.searchsorted(np.cumsum(weights), (np.arange(n) + 0.5) / n)
    means = centre + 0.7 * (points[indices] - centre)
    scale = np.atleast_2d(np.cov(points.T, aweights=weights))
    return StudentMixture(np.full(n, 1.0 / n), means, np.repeat(scale[None], n, axis=0), df)


def mixture_of_maxima(maxima: Ascent, is_free: BoolArray) -> PriorMixture:
    """A component at every maximum of a posterior, weighted by the root of its Laplace evidence."""
    weights = _laplace_weights(maxima)
    # Laplace's normal at a maximum has the inverse of the curvature as its covariance.
    scales = np.asarray(np.linalg.inv(maxima.curvature[:, is_free][:, :, is_free]))
    df = _degrees_of_freedom(is_free)
    return PriorMixture(is_free, StudentMixture(weights, maxima.x[:, is_free], scales, df))


def mixture_of_clouds(
    clouds: Sequence[FloatArray], maxima: Ascent, posterior: PosteriorArray, rng: Rng
) -> PriorMixture:
    """A mixture for one posterior: half of it about every maximum, and half over the prior.

    The first half has about twelve components in the clouds, which are points about every maximum,
    (n, d) each. `posterior` is an array of one posterior.
    """
    is_free = posterior.is_free[0]
    n_each = 12 // len(clouds) + 1  # components of each cloud
    df = 8 + int(is_free.sum()) % 2  # `StudentMixture` needs an even sum of df and dimension
    equal_weights = np.full(_CLOUD, 1.0 / _CLOUD)
    cloud_mixtures = [_components(cloud[:, is_free], equal_weights, n_each, df) for cloud in clouds]

    weights = np.repeat(_laplace_weights(maxima), n_each) / n_each
    means = np.concatenate([mixture.means for mixture in cloud_mixtures])
    scales = np.concatenate([mixture.scales for mixture in cloud_mixtures])
    about_maxima = StudentMixture(weights, means, scales, df)
    core = about_maxima.joined(_prior_components(posterior, df, rng), share=0.5)
    # Only fits of the precision `SHARP` begin with this mixture, so the prior has a small share.
    return PriorMixture(is_free, core, prior_share=0.03)


def _prior_components(posterior: PosteriorArray, df: int, rng: Rng) -> StudentMixture:
    """Six components that find what lies far from every maximum, such as a ridge.

    They are at draws from the prior of one posterior, chosen from 2,000 by a likelihood that is
    flattened to 200 effective draws.
    """
    points = posterior.prior_points(rng.uniform(size=(1, 2000, len(posterior.names))))
    log_prior, log_posterior = posterior.densities(points)
    weights = flattened_weights((log_posterior - log_prior)[0], least=200.0)
    return _components(points[0][:, posterior.is_free[0]], weights, n=6, df=df)


def normal_clouds(maxima: Ascent, rng: Rng) -> list[FloatArray]:
    """Points of Laplace's normal about every maximum, (n, d) each."""
    clouds = []
    for x, curvature in zip(maxima.x, maxima.curvature, strict=True):
        # An axis with an inverse variance below 0.2 is a ridge that only the prior ends.
        inverse_variances, axes = np.linalg.eigh(curvature)
        sds = 1.0 / np.sqrt(np.maximum(inverse_variances, 0.2))
        along_axes = rng.standard_normal((_CLOUD, len(x))) * sds
        clouds.append(x + along_axes @ axes.T)
    return clouds


def mixture_of_points(points: FloatArray, is_free: BoolArray) -> PriorMixture:
    """One component with the mean and covariance of points, shape (n, d)."""
    free_points = points[:, is_free]
    means = free_points.mean(axis=0)[None]
    scale = np.atleast_2d(np.cov(free_points.T))
    df = _degrees_of_freedom(is_free)
    return PriorMixture(is_free, StudentMixture(np.ones(1), means, scale[None], df))


def _laplace_weights(maxima: Ascent) -> FloatArray:
    """Weights of maxima by the root of their Laplace evidence, (maxima,)."""
    # Laplace's log evidence, but for a constant: the height less half of the log determinant.
    _, log_determinant = np.linalg.slogdet(maxima.curvature)
    log_mass = maxima.value - 0.5 * log_determinant
    # No weight is below a twentieth of the largest weight, because the approximation may be poor.
    weights = np.exp(0.5 * (log_mass - log_mass.max())) + 0.05
    return np.asarray(weights / weights.sum())


def _degrees_of_freedom(is_free: BoolArray) -> int:
    """Degrees of freedom that add up with the dimensions to the same even number in all models.

    `StudentMixture` needs an even sum. A posterior with all coordinates has 4 or 5 degrees of
    freedom, and each coordinate that is held adds 1.
    """
    # The even sum is the number of all coordinates and 4, or 5.
    return 2 * ((len(is_free) + 5) // 2) - int(is_free.sum())


def fitted_draws(
    posteriors: PosteriorArray,
    mixtures: Sequence[PriorMixture],
    generators: Sequence[Rng],
    precision: Precision,
    families: IndexArray | None = None,
) -> tuple[list[PriorMixture], list[WeightedDraws]]:
    """Mixtures that are adapted to posteriors, and fresh draws of each.

    Parameters
    ----------
    posteriors : PosteriorArray
        Posteriors in the coordinates w of the mixtures, (posteriors, points, d).
    mixtures : sequence of PriorMixture
        The mixture of each posterior to begin with.
    generators : sequence of Generator
        The generator of each posterior; several posteriors may share a generator.
    precision : Precision
    families : ndarray of int, shape (posteriors,), optional
        The family of each posterior, by default one family of all. Posteriors that are compared are
        of one family, in which a posterior that is far less probable than the best one needs no
        precision.
    """
    if families is None:
        families = np.zeros(len(posteriors), np.intp)
    no_points = np.empty((0, len(posteriors.names)))
    no_draws = WeightedDraws(no_points, *np.empty((3, 0)))  # three log densities of no draw
    states = []
    for mixture, rng in zip(mixtures, generators, strict=True):
        states.append(_State(mixture, rng, pool=no_draws, rounds=[], fresh=no_draws))

    # Adapt each mixture to the pool of its draws.
    active = list(range(len(posteriors)))
    for _ in range(precision.pool_rounds):
        round_draws = _draw_round(posteriors, states, active, precision)
        for state, draws in zip(states, round_draws, strict=True):
            state.add_to_pool(draws)
            state.mixture = state.mixture.updated(state.pool, precision)

    # Draw from the fixed mixtures, until every posterior has enough draws or too little evidence.
    while active:
        round_draws = _draw_round(posteriors, states, active, precision)
        for i, draws in zip(active, round_draws, strict=True):
            states[i].fresh = states[i].fresh.joined(draws)

        log_evidences = np.array([state.fresh.log_evidence for state in states])
        still_active = []
        for i in active:
            best = log_evidences[families == families[i]].max()
            fresh = states[i].fresh
            # With an evidence that is 8 nats below the best one, even with three standard errors
            # more, a posterior has a share of the sum below exp(-8).
            if fresh.log_evidence + 3.0 * fresh.standard_error < best - 8.0:
                continue
            needs_more = _needs_more(fresh, precision)
            was_refitted = _refit_if_bad(states[i], precision)
            if needs_more or was_refitted:
                still_active.append(i)
        active = still_active
    return [state.mixture for state in states], [state.fresh for state in states]


def fresh_draws(
    posteriors: PosteriorArray,
    mixtures: Sequence[PriorMixture],
    generators: Sequence[AnyRng],
    size: int,
) -> list[WeightedDraws]:
    """`size` draws of every posterior, each posterior from its own mixture."""
    shape = (len(posteriors), size, len(posteriors.names))
    probability = np.empty(shape)
    points = np.empty(shape)
    is_from_prior = np.empty(shape[:2], np.bool_)
    for i, (mixture, rng) in enumerate(zip(mixtures, generators, strict=True)):
        probability[i] = rng.uniform(size=shape[1:])
        points[i], is_from_prior[i] = mixture.sample(rng, size)

    points = _with_prior_points(posteriors, points, is_from_prior, probability)
    log_prior, log_posterior = posteriors.densities(points)
    draws = []
    for i, mixture in enumerate(mixtures):
        log_proposal = mixture.log_density(points[i], log_prior[i])
        draws.append(WeightedDraws(points[i], log_prior[i], log_posterior[i], log_proposal))
    return draws


def _with_prior_points(
    posteriors: PosteriorArray,
    points: FloatArray,
    is_from_prior: BoolArray,
    probability: FloatArray,
) -> FloatArray:
    """Points, (posteriors, n, d), of which those from the prior are replaced by its quantiles.

    Only these points, (posteriors, n), need quantiles at `probability`, because quantiles take
    long.
    """
    # The positions of points from the prior, (posteriors, n_most). A posterior with fewer of them
    # has other positions behind, whose points stay.
    n_most = is_from_prior.sum(axis=1).max()
    positions = np.argsort(~is_from_prior, axis=1, kind="stable")[:, :n_most]
    index = np.arange(len(posteriors))[:, None], positions
    prior_points = posteriors.prior_points(probability[index])

    replaced = points.copy()
    replaced[index] = np.where(is_from_prior[index][..., None], prior_points, points[index])
    return replaced


@dataclass(eq=False)
class _State:
    """One posterior, from its first mixture to fresh draws.

    Attributes
    ----------
    mixture : PriorMixture
    rng : Generator
    pool : WeightedDraws
        The draws by which the mixture was adapted, of all rounds, see :meth:`add_to_pool`.
    rounds : list of (PriorMixture, int)
        The mixture of every round of the pool, with its number of draws.
    fresh : WeightedDraws
        Draws of the present mixture, which did not choose it.
    refits, poor_refits : int
        How often the mixture was refitted, and how often for a poor efficiency alone.
    """

    mixture: PriorMixture
    rng: Rng
    pool: WeightedDraws
    rounds: list[tuple[PriorMixture, int]]
    fresh: WeightedDraws
    refits: int = 0
    poor_refits: int = 0

    def add_to_pool(self, draws: WeightedDraws) -> None:
        """Add draws of the present mixture to the pool.

        The proposal density of the pool is the sum of n q(x) over rounds of n draws, of density q.
        """
        pool = self.pool
        log_count = np.log(len(draws.x))
        # The density at the pool grows by the density of the present mixture.
        log_added = self.mixture.log_density(pool.x, pool.log_prior) + log_count
        log_proposal_at_pool = np.logaddexp(pool.log_proposal, log_added)
        # The density at the new draws is the sum of the densities of all mixtures.
        terms = []
        for mixture, count in self.rounds:
            terms.append(mixture.log_density(draws.x, draws.log_prior) + np.log(count))
        terms.append(draws.log_proposal + log_count)
        log_proposal_at_draws = np.logaddexp.reduce(terms)

        log_proposal = np.concatenate([log_proposal_at_pool, log_proposal_at_draws])
        self.pool = replace(pool.joined(draws), log_proposal=log_proposal)
        self.rounds.append((self.mixture, len(draws.x)))


def _draw_round(
    posteriors: PosteriorArray,
    states: Sequence[_State],
    active: Sequence[int],
    precision: Precision,
) -> list[WeightedDraws]:
    """Draws of some posteriors, each from its own mixture."""
    mixtures = [states[i].mixture for i in active]
    generators = [states[i].rng for i in active]
    return fresh_draws(
        posteriors.part(np.array(active)), mixtures, generators, precision.round_draws
    )


def _needs_more(draws: WeightedDraws, precision: Precision) -> bool:
    """Whether the evidence is not yet precise, or the draws too few, and more draws are allowed."""
    is_precise = draws.standard_error <= precision.standard_error
    has_enough = is_precise and draws.effective_number >= precision.effective_draws
    return not has_enough and len(draws.x) < precision.most_draws


def _refit_if_bad(state: _State, precision: Precision) -> bool:
    """Refit the mixture of `state` if it misses a part of its posterior; say whether it did."""
    draws = state.fresh
    if len(draws.x) < _FEWEST_ASSESSED or state.refits >= precision.most_refits:
        return False

    if not _has_heavy_draws(draws, precision):
        # An efficiency below a quarter is poor. Alone, it is a reason twice at most: a further
        # mixture may not do better.
        if draws.efficiency >= 0.25 or state.poor_refits >= 2:
            return False
        state.poor_refits += 1

    state.refits += 1
    _refit(state, precision)
    return True


def _has_heavy_draws(draws: WeightedDraws, precision: Precision) -> bool:
    """Whether one draw has too much weight, or the weights have too heavy a tail."""
    largest = draws.shares.max()
    # The mean share is one over the number of draws.
    if largest > precision.largest_share or largest * len(draws.x) > precision.largest_weight:
        return True
    if precision.largest_k == np.inf:  # no limit
        return False

    # Only here, because a quick command needs no tails, and their library takes long to load.
    from bayes_toe.inference.diagnostics import pareto_k

    return pareto_k(draws.log_weights) > precision.largest_k


def _refit(state: _State, precision: Precision) -> None:
    """Give the mixture of `state` components at its heaviest draws, and adapt it to all draws.

    The draws so far join the pool, and `state.fresh` becomes empty, because the mixture changes.
    """
    mixture = state.mixture
    draws = state.fresh
    state.add_to_pool(draws)
    state.fresh = draws.part(slice(0))  # no draw

    heaviest = np.argsort(-draws.log_weights)[: precision.n_added]
    core = mixture.core
    added = _components_at(
        draws.x[heaviest][:, mixture.is_free], state.pool.x[:, mixture.is_free], core.df
    )
    widened = replace(mixture, core=core.joined(added, share=1.0 / 16.0))
    state.mixture = widened.updated(state.pool, precision)


def _components_at(centres: FloatArray, points: FloatArray, df: int) -> StudentMixture:
    """A component at each centre, (J, D), with the covariance of the 120 points nearest to it."""
    n_nearest = 120
    sds = points.std(axis=0)
    scales = []
    for centre in centres:
        deviations = points - centre  # (points, D)
        distances = np.square(deviations / sds).sum(axis=1)
        nearest = deviations[np.argpartition(distances, n_nearest)[:n_nearest]]
        scales.append(nearest.T @ nearest / n_nearest)  # the covariance about the centre
    weights = np.full(len(centres), 1.0 / len(centres))
    return StudentMixture(weights, centres, np.array(scales), df)
