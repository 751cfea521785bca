"""Log evidences of the four models of the observer: maxima, a mixture for each row, draws.

`order_evidence` computes them for the subjects of one task, as :class:`OrderEvidence`.

A row is a subject under a model. Fisher scoring finds the maxima. It starts at several
constant errors, at three lapse rates, and from a large noise. The maxima become the components of
a mixture of Student-t densities, to which the prior joins. The mixture is adapted to a pool of
draws (Cornuet et al. 2012) and then fixed: **fresh draws of the fixed mixture give the
evidence**. Draws that helped to choose a mixture would give too small an evidence, which the
spread over seeds cannot show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Never

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, IndexArray, Rng
from bayes_toe.data.conditions import StimulusScales
from bayes_toe.data.study import Subject
from bayes_toe.errors import NumericalError
from bayes_toe.inference.maxima import Ascent, Expansion, ascend
from bayes_toe.inference.proposal import (
    StudentMixture,
    WeightedDraws,
    joined_draws,
    tempered,
)
from bayes_toe.model.derivatives import hessian
from bayes_toe.model.distributions import LOG_2PI
from bayes_toe.model.observer import (
    DEFAULT_PRIOR,
    ObserverBatch,
    free_coordinates,
)
from bayes_toe.model.parameters import ORDER_MODELS, ObserverPrior
from bayes_toe.seeds import generator

#: Names of the four models, in the order of all arrays.
MODEL_NAMES = tuple(ORDER_MODELS)
_N_MODELS = len(MODEL_NAMES)
#: Subjects whose rows are computed together where there are many.
BATCH = 8

# --- Maxima ---
#: Constant errors, in D, at which the other coordinates are maximised.
_CONSTANT_ERRORS = (0.0, -0.4, 0.4, -0.9, 0.9, -2.0, 2.0, -4.0, 4.0)
#: Normal scores of the lapse rate at which the other coordinates are maximised.
_LAPSE_SCORES = (-1.0, 0.6, 1.8)
_START_PEAK = 2.0  # logit of q0 where a search begins
_START_NOISE = -0.5  # score of the noise there; a steep curve shows more than a flat one
_FLAT_NOISE = 2.0  # score of the noise of a flat curve
_GAIN = 0.03  # nats of predicted gain below which a search ends
_LARGEST_STEP = 2.0
_MOST_STEPS = 12
_POLISH_GAIN = 1e-8  # the same for the maximum of a row, of which Laplace's evidence is

# --- Mixture ---
_PRIOR_SHARE = 0.1
_LEAST_WEIGHT = 0.05  # of a component, beside the root of its Laplace evidence
_POOL = 500  # draws of a round
_TEMPERED = 60.0  # effective draws that weights are flattened to
_FLOOR = 0.4  # weight that all components keep, beside the 1 that the draws distribute
_NEIGHBOURS = 120  # draws that give a component its shape where one is added at a heavy draw
_ADDED_SHARE = 1.0 / 16.0  # of that component

# --- Evidence ---
_FAR = 8.0  # nats below the best at which a model needs no further draws
_FEWEST_ASSESSED = 1000
_HEAVY = 0.03  # share of the weight of one draw that sends a row back
_POOR = 0.25  # efficiency that sends a row back, twice at most
_MOST_RETURNS, _MOST_POOR_RETURNS = 8, 2


@dataclass(frozen=True)
class Precision:
    """The precision at which a row has enough fresh draws.

    Attributes
    ----------
    standard_error : float
        Of the log evidence, to reach.
    effective_draws : float
        To reach.
    most_draws : int
        At which a row ends in any case.
    """

    standard_error: float = 0.03
    effective_draws: float = 250.0
    most_draws: int = 6000


USUAL = Precision()


class ModelDraws(NamedTuple):
    """Weighted draws of one model for one subject."""

    points: FloatArray  # (draws, k): all coordinates of the task, an absent effect is 0
    log_weights: FloatArray  # (draws,): log of posterior density over proposal density


@dataclass(frozen=True, eq=False)
class OrderEvidence:
    """Log evidences of the four models for one subject, nats, without binomial coefficients.

    Attributes
    ----------
    subject : Subject
    prior : ObserverPrior
    scales : StimulusScales
    log_evidence, standard_error, laplace : ndarray, shape (4,)
        In the order of :data:`MODEL_NAMES`. Laplace's approximation is NaN where the Hessian at
        the maximum is not negative definite.
    modes : ndarray, shape (4, k)
        The maximum of each model's posterior density.
    draws : tuple of ModelDraws
        Fresh draws of each model's fixed proposal.
    effective_draws : ndarray, shape (4,)
    """

    subject: Subject
    prior: ObserverPrior
    scales: StimulusScales
    log_evidence: FloatArray
    standard_error: FloatArray
    laplace: FloatArray
    modes: FloatArray
    draws: tuple[ModelDraws, ...]
    effective_draws: FloatArray

    def probabilities(self, prior_probabilities: FloatArray) -> FloatArray:
        """Posterior probabilities of the four models, shape (4,)."""
        log_joint = self.log_evidence + np.log(prior_probabilities)
        return np.exp(log_joint - logsumexp(log_joint))


def order_evidence(
    subjects: Sequence[Subject],
    seed: int,
    prior: ObserverPrior = DEFAULT_PRIOR,
    precision: Precision = USUAL,
) -> list[OrderEvidence]:
    """The evidences of the four models for subjects of one task.

    Random streams are keyed by seed and subject. Subjects are computed :data:`BATCH` at a time;
    one subject at a time gives the same numbers up to Monte Carlo error.

    Raises
    ------
    NumericalError
        If an evidence is not finite; the message names the subject.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> (evidence,) = order_evidence([subject], seed=1)
    >>> evidence.log_evidence.shape
    (4,)
    """
    results = []
    for start in range(0, len(subjects), BATCH):
        results += _Sampler(subjects[start : start + BATCH], seed, prior, precision).run()
    return results


# --- Maxima --------------------------------------------------------------------------------------


def _ascend(
    batch: ObserverBatch,
    is_free: BoolArray,
    rows: IndexArray,
    starts: FloatArray,
    is_held: BoolArray,
    least_gain: float = _GAIN,
) -> Ascent:
    """Fisher scoring from many starts at once.

    Parameters
    ----------
    batch : ObserverBatch
    is_free : ndarray of bool, shape (rows, k)
        The coordinates that each row's model has.
    rows : ndarray of int, shape (searches,)
        The row of each search.
    starts : ndarray, shape (searches, k)
    is_held : ndarray of bool, shape (searches, k)
        Further coordinates that stay where they start.
    least_gain : float
        A search ends where the predicted gain, nats, is below this.
    """
    batch, is_free = batch.rows(rows), is_free[rows]
    return ascend(
        lambda x, index: _expansion(batch.rows(index), is_free[index], x),
        starts,
        is_held=~is_free | is_held,
        least_gain=least_gain,
        largest_step=_LARGEST_STEP,
        most_steps=_MOST_STEPS,
        retry_damping=0.0,
    )


def _expansion(batch: ObserverBatch, is_free: BoolArray, points: FloatArray) -> Expansion:
    """The log density of each row about its point, (rows, k), by Fisher information and prior."""
    u = points[:, None, :]
    log_likelihood, gradient, information = batch.scoring(u)
    slopes, curvatures = batch.prior_slopes(u)
    value = log_likelihood[:, 0] + batch.log_prior(u, is_free)[:, 0]
    gradient = np.where(is_free, (gradient + slopes)[:, 0], 0.0)
    both_free = is_free[:, :, None] & is_free[:, None, :]
    curvature = np.where(both_free, information[:, 0], 0.0)
    diagonal = np.arange(points.shape[1])
    curvature[:, diagonal, diagonal] += np.where(is_free, curvatures[:, 0], 1.0)
    return Expansion(value, gradient, curvature)


# --- Mixture -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RowMixture:
    """The proposal of one row: a mixture of Student-t densities, and a share of the prior.

    A coordinate that the row does not have stays at 0 and is no dimension of the mixture.
    """

    is_free: BoolArray  # (k,)
    student: StudentMixture

    def log_density(self, points: FloatArray, log_prior: FloatArray) -> FloatArray:
        """Log density at points, (n, k) -> (n,)."""
        student = self.student.log_density(points[:, self.is_free]) + np.log1p(-_PRIOR_SHARE)
        return np.logaddexp(student, log_prior + np.log(_PRIOR_SHARE))

    def updated(self, draws: WeightedDraws) -> RowMixture:
        """A step of EM toward draws whose weights are flattened."""
        weights = tempered(draws.log_weights, _TEMPERED)
        inertia = 2.0 * len(self.is_free)
        student = self.student.drawn_toward(draws.x[:, self.is_free], weights, _FLOOR, inertia)
        return replace(self, student=student)

    def sample(self, rng: Rng, prior: FloatArray) -> FloatArray:
        """Draws, shape (n, k); some of `prior`, shape (n, k), take the prior's share."""
        n, k = prior.shape
        component = self.student.sample_components(rng, n)
        normal = rng.standard_normal((n, k))[:, self.is_free]
        points = np.zeros((n, k))
        points[:, self.is_free] = self.student.offset(component, normal, rng)
        is_prior = rng.uniform(size=n) < _PRIOR_SHARE
        points[is_prior] = prior[is_prior]
        return points


def _mixture_of_maxima(maxima: Ascent, is_free: BoolArray) -> RowMixture:
    """A component at every maximum of a row, weighted by the root of its Laplace evidence."""
    log_mass = maxima.value - 0.5 * np.linalg.slogdet(maxima.curvature)[1]
    weights = np.exp(0.5 * (log_mass - log_mass.max())) + _LEAST_WEIGHT
    scales = np.asarray(np.linalg.inv(maxima.curvature[:, is_free][:, :, is_free]))
    # Degrees of freedom and dimensions add up to the same even number in all rows.
    df = 2 * ((len(is_free) + 5) // 2) - int(is_free.sum())
    student = StudentMixture(weights / weights.sum(), maxima.x[:, is_free], scales, df)
    return RowMixture(is_free, student)


# --- Draws ---------------------------------------------------------------------------------------


@dataclass(eq=False)
class _Pool:
    """Draws of one row, of all rounds by which its mixture was adapted."""

    draws: WeightedDraws  # their proposal: the sum over rounds of draws times density
    mixtures: list[tuple[RowMixture, int]]  # of every round, with its number of draws

    def join(self, mixture: RowMixture, draws: WeightedDraws) -> None:
        """Add the draws that a mixture made."""
        self.mixtures.append((mixture, len(draws.x)))
        pooled = joined_draws([self.draws, draws])
        densities = []
        for earlier, count in self.mixtures:
            log_density = earlier.log_density(pooled.x, pooled.log_prior)
            densities.append(log_density + np.log(count))
        self.draws = replace(pooled, log_proposal=np.logaddexp.reduce(densities))


@dataclass(eq=False)
class _Row:
    """Fresh draws of one row's fixed mixture by rounds, and how often it went back."""

    rounds: list[WeightedDraws]
    returns: int = 0
    poor_returns: int = 0

    @property
    def draws(self) -> WeightedDraws:
        """All fresh draws."""
        return joined_draws(self.rounds)


class _Sampler:
    """The rows of some subjects, from maxima to evidences."""

    def __init__(
        self, subjects: Sequence[Subject], seed: int, prior: ObserverPrior, precision: Precision
    ) -> None:
        self.subjects, self.prior, self.precision = subjects, prior, precision
        self.scales = [subject.scales for subject in subjects]
        single = ObserverBatch.from_subjects(subjects, prior, self.scales)
        self.batch = single.rows(np.repeat(np.arange(len(subjects)), _N_MODELS))
        free = [free_coordinates(subjects[0].task, name) for name in MODEL_NAMES]
        self.is_free = np.tile(np.array(free), (len(subjects), 1))
        self.n_rows, self.k = self.is_free.shape
        self.generators = [generator(seed, subject.name, "order evidence") for subject in subjects]

    def run(self) -> list[OrderEvidence]:
        """The evidences of every subject."""
        maxima, rows = self._search()
        modes, laplace = self._laplace(maxima, rows)
        mixtures = []
        for row in range(self.n_rows):
            of_row = Ascent(*(values[rows == row] for values in maxima))
            mixtures.append(_mixture_of_maxima(of_row, self.is_free[row]))
        pools = self._adapt(mixtures)
        fresh = self._draw(mixtures, pools)
        return [self._result(i, modes, laplace, fresh) for i in range(len(self.subjects))]

    # --- Searches --------------------------------------------------------------------------------

    def _start(self, noise: float) -> FloatArray:
        """A point from which to search, (k,)."""
        point = np.zeros(self.k)
        point[0] = noise
        if self.batch.is_same_different:
            point[1] = _START_PEAK
        return point

    def _search(self) -> tuple[Ascent, IndexArray]:
        """All maxima that become components, and their rows."""
        profile, profile_rows, values = self._profile()
        second_starts, second_rows, is_held = self._second_starts(profile, profile_rows, values)
        second = _ascend(self.batch, self.is_free, second_rows, second_starts, is_held)
        # A search along the constant error is of the rows that have it.
        joined = [np.concatenate(parts) for parts in zip(profile, second, strict=True)]
        return Ascent(*joined), np.concatenate([profile_rows, second_rows])

    def _profile(self) -> tuple[Ascent, IndexArray, FloatArray]:
        """Maxima along the constant error, and one from a flat curve for every row."""
        n_values = len(_CONSTANT_ERRORS)
        with_error = np.flatnonzero(self.is_free[:, self.k - 2])
        held_rows = np.repeat(with_error, n_values)
        values = np.tile(_CONSTANT_ERRORS, len(with_error))
        starts = np.tile(self._start(_START_NOISE), (len(held_rows), 1))
        starts[:, self.k - 2] = values / self.prior.constant_error_scale
        is_held = np.zeros((len(held_rows) + self.n_rows, self.k), np.bool_)
        is_held[: len(held_rows), self.k - 2] = True
        flat = np.tile(self._start(_FLAT_NOISE), (self.n_rows, 1))
        rows = np.concatenate([held_rows, np.arange(self.n_rows)])
        maxima = _ascend(self.batch, self.is_free, rows, np.concatenate([starts, flat]), is_held)
        return maxima, rows, values

    def _second_starts(
        self, profile: Ascent, rows: IndexArray, values: FloatArray
    ) -> tuple[FloatArray, IndexArray, BoolArray]:
        """Starts of free maxima, and of those with lapse rates held."""
        n_held = len(values)  # the searches after these start from a flat curve, one for each row
        lapse = 2 if self.batch.is_same_different else 1
        starts: list[FloatArray] = []
        start_rows: list[int] = []
        lapse_is_held: list[bool] = []
        for row in range(self.n_rows):
            chosen, at_row = self._profile_maxima(row, rows[:n_held], values, profile)
            candidates, flat = at_row[chosen], n_held + row
            best = flat if profile.value[flat] > profile.value[candidates[0]] else candidates[0]
            free = profile.x[candidates]
            with_lapse = np.tile(profile.x[best], (len(_LAPSE_SCORES), 1))
            with_lapse[:, lapse] = _LAPSE_SCORES
            starts += [*free, *with_lapse]
            start_rows += [row] * (len(free) + len(with_lapse))
            lapse_is_held += [False] * len(free) + [True] * len(with_lapse)
        is_held = np.zeros((len(starts), self.k), np.bool_)
        is_held[:, lapse] = lapse_is_held
        return np.array(starts), np.array(start_rows), is_held

    def _profile_maxima(
        self, row: int, rows: IndexArray, values: FloatArray, profile: Ascent
    ) -> tuple[IndexArray, IndexArray]:
        """The maxima of a profile from which a row starts, the best first, and the profile.

        A row without constant error starts at the maximum of its neighbour with c = 0.
        """
        has_error = bool(self.is_free[row, self.k - 2])
        profile_row = row if has_error else row + 1
        at_row = np.flatnonzero(rows == profile_row)
        if has_error:
            return _two_best_local(values[at_row], profile.value[at_row]), at_row
        return np.flatnonzero(values[at_row] == 0.0), at_row

    def _laplace(self, maxima: Ascent, rows: IndexArray) -> ArrayPair:
        """The highest maximum of every row, (rows, k), and Laplace's log evidence, (rows,)."""
        best = np.empty(self.n_rows, np.intp)
        for row in range(self.n_rows):
            at_row = np.flatnonzero(rows == row)
            best[row] = at_row[np.argmax(maxima.value[at_row])]
        own_rows = np.arange(self.n_rows)
        is_held = np.zeros(self.is_free.shape, np.bool_)
        top = _ascend(self.batch, self.is_free, own_rows, maxima.x[best], is_held, _POLISH_GAIN)

        def gradient(points: FloatArray) -> FloatArray:
            batch = self.batch.rows(np.resize(own_rows, len(points)))
            u = points[:, None, :]
            slope = batch.gradient(u)[1] + batch.prior_slopes(u)[0]
            return slope[:, 0]

        diagonal = np.arange(self.k)
        curvature = -hessian(gradient, top.x, top.curvature[:, diagonal, diagonal])
        both_free = self.is_free[:, :, None] & self.is_free[:, None, :]
        curvature = np.where(both_free, curvature, np.eye(self.k))
        is_proper = np.linalg.eigvalsh(curvature)[:, 0] > 0.0
        log_determinant = np.linalg.slogdet(curvature)[1]
        dimensions = self.is_free.sum(axis=1)
        laplace = top.value + 0.5 * dimensions * LOG_2PI - 0.5 * log_determinant
        return top.x, np.where(is_proper, laplace, np.nan)

    # --- Draws -----------------------------------------------------------------------------------

    def _round(self, mixtures: Sequence[RowMixture], rows: Sequence[int]) -> list[WeightedDraws]:
        """Draws of some rows, each from its own mixture."""
        points = np.empty((len(rows), _POOL, self.k))
        for i, row in enumerate(rows):
            rng = self.generators[row // _N_MODELS]
            uniform = rng.uniform(size=(_POOL, self.k))
            from_prior = self.batch.rows(np.array([row])).prior_points(uniform)
            from_prior *= self.is_free[row]
            points[i] = mixtures[row].sample(rng, from_prior)
        index = np.array(rows)
        batch = self.batch.rows(index)
        log_prior = batch.log_prior(points, self.is_free[index])
        log_target = batch.plain_log_likelihood(points) + log_prior
        # Beyond the edges of the contraction the density is 0.
        log_target[~np.isfinite(log_prior)] = -np.inf
        densities = zip(points, log_prior, log_target, strict=True)
        draws = []
        for row, (x, prior, target) in zip(rows, densities, strict=True):
            draws.append(WeightedDraws(x, prior, target, mixtures[row].log_density(x, prior)))
        return draws

    def _adapt(self, mixtures: list[RowMixture]) -> list[_Pool]:
        """Adapt mixtures by two rounds of draws, which are the pools."""
        no_draws = WeightedDraws(np.empty((0, self.k)), *np.empty((3, 0)))
        pools = [_Pool(no_draws, []) for _ in mixtures]
        for _ in range(2):
            for row, draws in enumerate(self._round(mixtures, range(self.n_rows))):
                pools[row].join(mixtures[row], draws)
                mixtures[row] = mixtures[row].updated(pools[row].draws)
        return pools

    def _draw(self, mixtures: list[RowMixture], pools: list[_Pool]) -> list[_Row]:
        """Fresh draws of every row, until its evidence is known well enough."""
        fresh = [_Row([]) for _ in range(self.n_rows)]
        active = list(range(self.n_rows))
        while active:
            for row, draws in zip(active, self._round(mixtures, active), strict=True):
                fresh[row].rounds.append(draws)
            active = self._unfinished(active, fresh, mixtures, pools)
        return fresh

    def _unfinished(
        self,
        active: Sequence[int],
        fresh: Sequence[_Row],
        mixtures: list[RowMixture],
        pools: Sequence[_Pool],
    ) -> list[int]:
        """The rows that need more draws; those that fit badly get a new mixture first."""
        all_draws = [row.draws for row in fresh]
        log_evidences = [draws.log_evidence for draws in all_draws]
        going = []
        for row in active:
            draws, log_evidence = all_draws[row], log_evidences[row]
            if not np.isfinite(log_evidence):
                self._refuse(row)
            first = row - row % _N_MODELS
            best = max(log_evidences[first : first + _N_MODELS])
            is_far = log_evidence + 3.0 * draws.standard_error < best - _FAR
            if is_far or len(draws.x) >= self.precision.most_draws:
                continue
            if self._must_return(fresh[row], draws):
                mixtures[row] = _refitted(mixtures[row], pools[row], fresh[row])
                going.append(row)
                continue
            is_precise = draws.standard_error <= self.precision.standard_error
            if not is_precise or draws.effective_number < self.precision.effective_draws:
                going.append(row)
        return going

    def _must_return(self, row: _Row, draws: WeightedDraws) -> bool:
        """Whether a row's mixture misses a part of its posterior; counts how often it did."""
        n_draws = len(draws.x)
        if n_draws < _FEWEST_ASSESSED or row.returns >= _MOST_RETURNS:
            return False
        is_heavy = draws.shares.max() > _HEAVY
        is_poor = draws.effective_number < _POOR * n_draws and row.poor_returns < _MOST_POOR_RETURNS
        if not (is_heavy or is_poor):
            return False
        row.returns += 1
        row.poor_returns += not is_heavy
        return True

    def _refuse(self, row: int) -> Never:
        subject, model = self.subjects[row // _N_MODELS], MODEL_NAMES[row % _N_MODELS]
        raise NumericalError(
            f"subject {subject.name!r}: the evidence of the model {model!r} is not a finite number"
        )

    def _result(
        self, i: int, modes: FloatArray, laplace: FloatArray, fresh: Sequence[_Row]
    ) -> OrderEvidence:
        rows = range(_N_MODELS * i, _N_MODELS * (i + 1))
        draws = [fresh[row].draws for row in rows]
        return OrderEvidence(
            self.subjects[i],
            self.prior,
            self.scales[i],
            np.array([entry.log_evidence for entry in draws]),
            np.array([entry.standard_error for entry in draws]),
            laplace[list(rows)],
            modes[list(rows)],
            tuple(ModelDraws(entry.x, entry.log_weights) for entry in draws),
            np.array([entry.effective_number for entry in draws]),
        )


def _two_best_local(values: FloatArray, heights: FloatArray) -> IndexArray:
    """Places of the two highest local maxima along sorted values, the highest first."""
    order = np.argsort(values)
    padded = np.concatenate([[-np.inf], heights[order], [-np.inf]])
    is_local = (padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:])
    local = order[is_local]
    ranked = local[np.argsort(-heights[local])]
    if len(ranked) < 2:
        by_height = np.argsort(-heights)
        ranked = np.concatenate([ranked, by_height[by_height != ranked[0]]])
    return ranked[:2]


def _refitted(mixture: RowMixture, pool: _Pool, row: _Row) -> RowMixture:
    """A row's mixture with a component at its heaviest draw, adapted to all that were made."""
    draws = row.draws
    heaviest = draws.x[np.argmax(draws.log_weights), mixture.is_free]
    pool.join(mixture, draws)
    row.rounds.clear()  # because the mixture changes
    points = pool.draws.x[:, mixture.is_free]
    offsets = points - heaviest
    distance = np.square(offsets / points.std(axis=0)).sum(axis=1)
    near = np.argpartition(distance, _NEIGHBOURS)[:_NEIGHBOURS]
    scale = offsets[near].T @ offsets[near] / _NEIGHBOURS
    student = mixture.student
    component = StudentMixture(np.ones(1), heaviest[None], scale[None], student.df)
    widened = replace(mixture, student=student.joined([component], _ADDED_SHARE))
    return widened.updated(pool.draws)
