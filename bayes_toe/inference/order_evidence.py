"""Log evidences of the four models of the observer, all rows of one array: maxima, mixture, draws.

A row is a subject under a model. Fisher scoring finds the maxima from starts along the constant
error, with lapse rates held at three values, and from a flat curve. They become the components of
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
from scipy.special import gammaln, logsumexp

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import NumericalError
from bayes_toe.inference.proposal import WeightedDraws, efficiency, joined_draws, tempered
from bayes_toe.model.derivatives import hessian
from bayes_toe.model.distributions import LOG_2PI
from bayes_toe.model.observer import (
    DEFAULT_PRIOR,
    ObserverBatch,
    StimulusScales,
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
_ITERATIONS = 12
_POLISH_GAIN = 1e-8  # the same for the maximum of a row, of which Laplace's evidence is

# --- Mixture ---
_PRIOR_SHARE = 0.1
_LEAST_WEIGHT = 0.05  # of a component, beside the root of its Laplace evidence
_POOL = 500  # draws of a round
_TEMPERED = 60.0  # effective draws that weights are flattened to
_FLOOR = 0.4  # weight that all components keep, beside the 1 that the draws distribute
_NEIGHBOURS = 120

# --- Evidence ---
_FAR = 8.0  # nats below the best at which a model needs no further draws
_JUDGED_FROM = 1000
_HEAVY = 0.03  # share of the weight of one draw that sends a row back
_POOR = 0.25  # efficiency that sends a row back, twice at most
_MOST_RETURNS, _MOST_POOR_RETURNS = 8, 2


@dataclass(frozen=True)
class Precision:
    """When a row has enough fresh draws.

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
        return np.asarray(np.exp(log_joint - logsumexp(log_joint)))


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


class Maxima(NamedTuple):
    """Points at which searches ended, with the log density and its positive curvature there."""

    points: FloatArray  # (searches, k)
    log_density: FloatArray  # (searches,)
    curvature: FloatArray  # (searches, k, k): Fisher information and prior; 1 where held


def find_maxima(
    batch: ObserverBatch,
    is_free: BoolArray,
    rows: IndexArray,
    starts: FloatArray,
    is_held: BoolArray,
    gain: float = _GAIN,
) -> Maxima:
    """Damped Fisher scoring from many starts at once.

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
    gain : float
        A search ends where the predicted gain, nats, is below this.
    """
    own, free = batch.rows(rows), is_free[rows]
    is_moving = free & ~is_held
    points = starts.copy()
    value, gradient, curvature = _expansion(own, free, points)
    damping = np.full(len(rows), 1e-3)
    active = np.arange(len(rows))
    for _ in range(_ITERATIONS):
        step, predicted = _damped_step(
            gradient[active], curvature[active], is_moving[active], damping[active]
        )
        is_going = predicted > gain
        active, step = active[is_going], step[is_going]
        if not len(active):
            break
        trial = points[active] + step
        new_value, new_gradient, new_curvature = _expansion(own.rows(active), free[active], trial)
        is_better = new_value >= value[active]
        better = active[is_better]
        points[better], value[better] = trial[is_better], new_value[is_better]
        gradient[better], curvature[better] = new_gradient[is_better], new_curvature[is_better]
        damping[active] *= np.where(is_better, 0.1, 10.0)
    return Maxima(points, value, curvature)


def _expansion(
    batch: ObserverBatch, is_free: BoolArray, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log density (rows,), gradient (rows, k) and positive curvature (rows, k, k), a point a row."""
    u = points[:, None, :]
    log_likelihood, gradient, information = batch.scoring(u)
    slopes, curvatures = batch.prior_slopes(u)
    value = log_likelihood[:, 0] + batch.log_prior(u, is_free)[:, 0]
    gradient = np.where(is_free, (gradient + slopes)[:, 0], 0.0)
    both_free = is_free[:, :, None] & is_free[:, None, :]
    curvature = np.where(both_free, information[:, 0], 0.0)
    diagonal = np.arange(points.shape[1])
    curvature[:, diagonal, diagonal] += np.where(is_free, curvatures[:, 0], 1.0)
    return value, gradient, curvature


def _damped_step(
    gradient: FloatArray, curvature: FloatArray, is_moving: BoolArray, damping: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Steps of at most :data:`_LARGEST_STEP` in every coordinate, and their predicted gains."""
    both_move = is_moving[:, :, None] & is_moving[:, None, :]
    matrix = np.where(both_move, curvature, 0.0)
    diagonal = np.arange(gradient.shape[1])
    own = matrix[:, diagonal, diagonal]
    matrix[:, diagonal, diagonal] = np.where(is_moving, own * (1.0 + damping[:, None]), 1.0)
    slope = np.where(is_moving, gradient, 0.0)
    step = np.linalg.solve(matrix, slope[..., None])[..., 0]
    predicted = 0.5 * (step * slope).sum(axis=1)
    longest = np.abs(step).max(axis=1)
    return step * np.minimum(1.0, _LARGEST_STEP / np.maximum(longest, 1e-300))[:, None], predicted


# --- Mixture -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RowMixtures:
    """A mixture of Student-t densities and the prior for every row.

    A coordinate that a row does not have stays at 0 and is no dimension of its mixture. Degrees of
    freedom and dimensions add up to the same even number in all rows, so densities are powers.
    """

    is_free: BoolArray  # (rows, k)
    weights: FloatArray  # (rows, components): they sum to 1; 0 for a component that is not used
    means: FloatArray  # (rows, components, k)
    factors: FloatArray  # (rows, components, k, k): Cholesky factors of the scale matrices

    @property
    def half_power(self) -> int:
        """Half the sum of degrees of freedom and dimensions."""
        return (int(self.is_free.shape[1]) + 5) // 2

    @property
    def freedom(self) -> FloatArray:
        """Degrees of freedom of the rows, (rows,)."""
        return np.asarray(2.0 * self.half_power - self.is_free.sum(axis=1))

    def kernels(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Components' kernels (1 + d^2 / nu)^-(nu + k)/2, and 1 / (1 + d^2 / nu).

        Of points, (rows, n, k), both have the shape (rows, components, n).
        """
        n_rows, n_components, k = self.means.shape
        whitener = np.linalg.inv(self.factors) / np.sqrt(self.freedom)[:, None, None, None]
        centres = (whitener @ self.means[..., None])[..., 0]
        stacked = whitener.reshape(n_rows, n_components * k, k) @ np.swapaxes(points, 1, 2)
        apart = stacked.reshape(n_rows, n_components, k, -1) - centres[..., None]
        closeness = 1.0 / (1.0 + np.square(apart).sum(axis=2))
        kernel = closeness.copy()
        for _ in range(self.half_power - 1):
            kernel *= closeness
        return kernel, closeness

    def log_tops(self) -> FloatArray:
        """Log of weight times highest density of every component, (rows, components)."""
        dimensions, freedom = self.is_free.sum(axis=1), self.freedom
        diagonal = np.diagonal(self.factors, axis1=2, axis2=3)
        log_volume = np.log(diagonal).sum(axis=2)
        log_norm = gammaln(self.half_power) - gammaln(0.5 * freedom)
        log_norm = log_norm - 0.5 * dimensions * np.log(freedom * np.pi)
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self.weights) + log_norm[:, None] - log_volume)

    def log_density(self, points: FloatArray, log_prior: FloatArray) -> FloatArray:
        """Log density with the prior's share, (rows, n)."""
        kernel, _ = self.kernels(points)
        log_tops = self.log_tops()
        highest = log_tops.max(axis=1, keepdims=True)
        total = (np.exp(log_tops - highest)[:, None, :] @ kernel)[:, 0]
        with np.errstate(divide="ignore"):
            student = np.log(total) + highest + np.log1p(-_PRIOR_SHARE)
        return np.asarray(np.logaddexp(student, log_prior + np.log(_PRIOR_SHARE)))

    def updated(self, points: FloatArray, weights: FloatArray) -> RowMixtures:
        """A step of EM toward weighted points, (rows, n, k) and normalised (rows, n).

        A component that holds few of the effective points keeps most of its old shape.
        """
        k = points.shape[2]
        effective = 1.0 / np.square(weights).sum(axis=1)
        kernel, closeness = self.kernels(points)
        log_tops = self.log_tops()
        tops = np.exp(log_tops - log_tops.max(axis=1, keepdims=True))
        shares = tops[:, :, None] * kernel
        shares *= weights[:, None, :] / shares.sum(axis=1, keepdims=True)
        held = shares.sum(axis=2)
        ratio = 2.0 * self.half_power / self.freedom
        pulls = shares * closeness * ratio[:, None, None]
        trust = _trust(held * effective[:, None], k)
        mean = (pulls @ points) / np.maximum(pulls.sum(axis=2), 1e-300)[..., None]
        means = self.means + trust[..., None] * (mean - self.means)
        apart = points[:, None] - means[:, :, None]
        scatter = np.swapaxes(apart * pulls[..., None], 2, 3) @ apart
        scatter /= np.maximum(held, 1e-300)[..., None, None]
        old = self.factors @ np.swapaxes(self.factors, 2, 3)
        scales = old + trust[..., None, None] * (scatter - old)
        is_used = self.weights > 0.0
        floor = _FLOOR / is_used.sum(axis=1, keepdims=True)
        new_weights = np.where(is_used, held + floor, 0.0)
        new_weights /= new_weights.sum(axis=1, keepdims=True)
        return RowMixtures(self.is_free, new_weights, means, _factors(scales, self.is_free))

    def sample(self, rng: np.random.Generator, row: int, prior: FloatArray) -> FloatArray:
        """Draws of one row, shape (n, k); some of `prior`, shape (n, k), take the prior's share."""
        n, k = prior.shape
        component = np.searchsorted(np.cumsum(self.weights[row])[:-1], rng.uniform(size=n), "right")
        normal = rng.standard_normal((n, k)) * self.is_free[row]
        freedom = self.freedom[row]
        stretch = np.sqrt(freedom / rng.chisquare(freedom, n))
        offsets = (self.factors[row, component] @ normal[..., None])[..., 0]
        points = self.means[row, component] + offsets * stretch[:, None]
        is_prior = np.asarray(rng.uniform(size=n)) < _PRIOR_SHARE
        points[is_prior] = prior[is_prior]
        return np.asarray(points)


def _trust(effective: FloatArray, k: int) -> FloatArray:
    """Share by which a component follows its points, of which so many are effective."""
    return np.asarray(effective / (effective + 2.0 * k))


def _factors(scales: FloatArray, is_free: BoolArray) -> FloatArray:
    """Cholesky factors of scale matrices, (rows, components, k, k); 1 where a row has none."""
    both_free = (is_free[:, :, None] & is_free[:, None, :])[:, None]
    matrices = np.where(both_free, scales, 0.0)
    diagonal = np.arange(scales.shape[-1])
    own = matrices[..., diagonal, diagonal]
    matrices[..., diagonal, diagonal] = np.where(is_free[:, None], own * (1.0 + 1e-9), 1.0)
    return np.linalg.cholesky(matrices)


def _mixture_of_maxima(maxima: Maxima, rows: IndexArray, is_free: BoolArray) -> RowMixtures:
    """A component at every maximum of a row, weighted by the root of its Laplace evidence."""
    n_rows, k = is_free.shape
    order = np.argsort(rows, kind="stable")
    counts = np.bincount(rows, minlength=n_rows)
    n_components = int(counts.max())
    means = np.zeros((n_rows, n_components, k))
    scales = np.broadcast_to(np.eye(k), (n_rows, n_components, k, k)).copy()
    log_mass = np.full((n_rows, n_components), -np.inf)
    place = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    curvature = maxima.curvature[order]
    log_determinant = np.linalg.slogdet(curvature)[1]
    means[rows[order], place] = maxima.points[order]
    scales[rows[order], place] = np.linalg.inv(curvature)
    log_mass[rows[order], place] = maxima.log_density[order] - 0.5 * log_determinant
    root = np.exp(0.5 * (log_mass - log_mass.max(axis=1, keepdims=True)))
    weights = np.where(np.isfinite(log_mass), root + _LEAST_WEIGHT, 0.0)
    weights /= weights.sum(axis=1, keepdims=True)
    return RowMixtures(is_free, weights, means, _factors(scales, is_free))


# --- Draws ---------------------------------------------------------------------------------------


@dataclass(eq=False)
class _Pool:
    """Draws of one row, of all rounds by which its mixture was adapted."""

    draws: WeightedDraws  # their proposal: the sum over rounds of draws times density
    mixtures: list[tuple[RowMixtures, int]]  # of every round, with its number of draws

    def join(self, mixture: RowMixtures, draws: WeightedDraws) -> None:
        """Add the draws that a mixture made."""
        self.mixtures.append((mixture, len(draws.x)))
        pooled = joined_draws([self.draws, draws])
        made = []
        for known, count in self.mixtures:
            log_density = known.log_density(pooled.x[None], pooled.log_prior[None])[0]
            made.append(log_density + np.log(count))
        self.draws = replace(pooled, log_proposal=np.logaddexp.reduce(made))


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


class _Estimate(NamedTuple):
    """What fresh draws say of an evidence."""

    log_evidence: float
    standard_error: float
    efficiency: float
    n_draws: int
    largest_share: float  # of the weight, of one draw


def _estimate(log_weights: FloatArray) -> _Estimate:
    """From log weights, (n,)."""
    n = len(log_weights)
    highest = log_weights.max()
    weights = np.exp(log_weights - highest)
    total = weights.sum()
    share_used = efficiency(log_weights)
    log_evidence = float(np.log(total / n) + highest)
    error = float(np.sqrt((1.0 / share_used - 1.0) / n))
    return _Estimate(log_evidence, error, share_used, n, float(weights.max() / total))


class _Sampler:
    """The rows of some subjects, from maxima to evidences."""

    def __init__(
        self, subjects: Sequence[Subject], seed: int, prior: ObserverPrior, precision: Precision
    ) -> None:
        self.subjects, self.prior, self.precision = subjects, prior, precision
        self.scales = [StimulusScales.from_subject(subject) for subject in subjects]
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
        mixture = _mixture_of_maxima(maxima, rows, self.is_free)
        mixtures, pools = self._adapt(mixture)
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

    def _search(self) -> tuple[Maxima, IndexArray]:
        """All maxima that become components, and their rows."""
        profile, profile_rows, values = self._profile()
        second_starts, second_rows, is_held = self._second_starts(profile, profile_rows, values)
        second = find_maxima(self.batch, self.is_free, second_rows, second_starts, is_held)
        # A search along the constant error is of the rows that have it.
        joined = [np.concatenate(parts) for parts in zip(profile, second, strict=True)]
        return Maxima(*joined), np.concatenate([profile_rows, second_rows])

    def _profile(self) -> tuple[Maxima, IndexArray, FloatArray]:
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
        maxima = find_maxima(
            self.batch, self.is_free, rows, np.concatenate([starts, flat]), is_held
        )
        return maxima, rows, values

    def _second_starts(
        self, profile: Maxima, rows: IndexArray, values: FloatArray
    ) -> tuple[FloatArray, IndexArray, BoolArray]:
        """Starts of free maxima, and of those with lapse rates held."""
        starts: list[FloatArray] = []
        start_rows: list[int] = []
        lapse_is_held: list[bool] = []
        lapse = 2 if self.batch.is_same_different else 1
        for row in range(self.n_rows):
            chosen, at_row = self._profile_maxima(row, rows[: len(values)], values, profile)
            heights = profile.log_density[at_row]
            flat = profile.points[len(values) + row]
            candidates = [profile.points[at_row[i]] for i in chosen]
            best = candidates[0]
            if profile.log_density[len(values) + row] > heights[chosen[0]]:
                best = flat
            for point in candidates:
                starts.append(point)
                lapse_is_held.append(False)
            for score in _LAPSE_SCORES:
                point = best.copy()
                point[lapse] = score
                starts.append(point)
                lapse_is_held.append(True)
            start_rows += [row] * (len(chosen) + len(_LAPSE_SCORES))
        is_held = np.zeros((len(starts), self.k), np.bool_)
        is_held[:, lapse] = lapse_is_held
        return np.array(starts), np.array(start_rows), is_held

    def _profile_maxima(
        self, row: int, rows: IndexArray, values: FloatArray, profile: Maxima
    ) -> tuple[IndexArray, IndexArray]:
        """Which maxima of a profile are the row's to start from, the best first, and the profile.

        A row without constant error starts at the maximum of its neighbour with c = 0.
        """
        has_error = bool(self.is_free[row, self.k - 2])
        profile_row = row if has_error else row + 1
        at_row = np.flatnonzero(rows == profile_row)
        if has_error:
            return _two_best_local(values[at_row], profile.log_density[at_row]), at_row
        return np.flatnonzero(values[at_row] == 0.0), at_row

    def _laplace(self, maxima: Maxima, rows: IndexArray) -> tuple[FloatArray, FloatArray]:
        """The highest maximum of every row, (rows, k), and Laplace's log evidence, (rows,)."""
        best = np.empty(self.n_rows, np.intp)
        for row in range(self.n_rows):
            at_row = np.flatnonzero(rows == row)
            best[row] = at_row[np.argmax(maxima.log_density[at_row])]
        own_rows = np.arange(self.n_rows)
        is_held = np.zeros(self.is_free.shape, np.bool_)
        top = find_maxima(
            self.batch, self.is_free, own_rows, maxima.points[best], is_held, _POLISH_GAIN
        )

        def gradient(points: FloatArray) -> FloatArray:
            batch = self.batch.rows(np.resize(own_rows, len(points)))
            u = points[:, None, :]
            slope = batch.gradient(u)[1] + batch.prior_slopes(u)[0]
            return np.asarray(slope[:, 0])

        diagonal = np.arange(self.k)
        curvature = -hessian(gradient, top.points, top.curvature[:, diagonal, diagonal])
        both_free = self.is_free[:, :, None] & self.is_free[:, None, :]
        curvature = np.where(both_free, curvature, np.eye(self.k))
        is_proper = np.linalg.eigvalsh(curvature)[:, 0] > 0.0
        log_determinant = np.linalg.slogdet(curvature)[1]
        dimensions = self.is_free.sum(axis=1)
        laplace = top.log_density + 0.5 * dimensions * LOG_2PI - 0.5 * log_determinant
        return top.points, np.where(is_proper, laplace, np.nan)

    # --- Draws -----------------------------------------------------------------------------------

    def _round(self, mixtures: Sequence[RowMixtures], rows: Sequence[int]) -> list[WeightedDraws]:
        """Draws of some rows, each from its own mixture."""
        points = np.empty((len(rows), _POOL, self.k))
        for i, row in enumerate(rows):
            rng = self.generators[row // _N_MODELS]
            uniform = rng.uniform(size=(_POOL, self.k))
            from_prior = self.batch.rows(np.array([row])).prior_points(uniform)
            from_prior *= self.is_free[row]
            points[i] = mixtures[row].sample(rng, 0, from_prior)
        index = np.array(rows)
        batch = self.batch.rows(index)
        log_prior = batch.log_prior(points, self.is_free[index])
        log_target = batch.plain_log_likelihood(points) + log_prior
        # Beyond the edges of the contraction the density is 0.
        log_target[~np.isfinite(log_prior)] = -np.inf
        log_made = _joined(mixtures, rows).log_density(points, log_prior)
        return list(map(WeightedDraws, points, log_prior, log_target, log_made))

    def _adapt(self, mixture: RowMixtures) -> tuple[list[RowMixtures], list[_Pool]]:
        """Two rounds of draws, and the mixtures adapted to them."""
        row_numbers = range(self.n_rows)
        nothing = WeightedDraws(np.empty((0, self.k)), *np.empty((3, 0)))
        pools = [_Pool(nothing, []) for _ in row_numbers]
        for _ in range(2):
            mixtures = [_row_mixture(mixture, row) for row in row_numbers]
            for row, draws in enumerate(self._round(mixtures, row_numbers)):
                pools[row].join(mixtures[row], draws)
            pooled = np.stack([pool.draws.x for pool in pools])
            log_weights = np.stack([pool.draws.log_weights for pool in pools])
            mixture = mixture.updated(pooled, tempered(log_weights, _TEMPERED))
        return [_row_mixture(mixture, row) for row in row_numbers], pools

    def _draw(self, mixtures: list[RowMixtures], pools: list[_Pool]) -> list[_Row]:
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
        mixtures: list[RowMixtures],
        pools: Sequence[_Pool],
    ) -> list[int]:
        """The rows that need more draws; those that fit badly get a new mixture first."""
        estimates = [_estimate(row.draws.log_weights) for row in fresh]
        going = []
        for row in active:
            estimate = estimates[row]
            if not np.isfinite(estimate.log_evidence):
                self._refuse(row)
            first = row - row % _N_MODELS
            best = max(other.log_evidence for other in estimates[first : first + _N_MODELS])
            is_far = estimate.log_evidence + 3.0 * estimate.standard_error < best - _FAR
            if is_far or estimate.n_draws >= self.precision.most_draws:
                continue
            if self._must_return(fresh[row], estimate):
                mixtures[row] = _refitted(mixtures[row], pools[row], fresh[row])
                going.append(row)
                continue
            n_effective = estimate.efficiency * estimate.n_draws
            is_precise = estimate.standard_error <= self.precision.standard_error
            if not is_precise or n_effective < self.precision.effective_draws:
                going.append(row)
        return going

    def _must_return(self, row: _Row, estimate: _Estimate) -> bool:
        """Whether a row's mixture misses a part of its posterior; counts how often it did."""
        if estimate.n_draws < _JUDGED_FROM or row.returns >= _MOST_RETURNS:
            return False
        is_heavy = estimate.largest_share > _HEAVY
        is_poor = estimate.efficiency < _POOR and row.poor_returns < _MOST_POOR_RETURNS
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
        estimates = [_estimate(entry.log_weights) for entry in draws]
        return OrderEvidence(
            self.subjects[i],
            self.prior,
            self.scales[i],
            np.array([estimate.log_evidence for estimate in estimates]),
            np.array([estimate.standard_error for estimate in estimates]),
            laplace[list(rows)],
            modes[list(rows)],
            tuple(ModelDraws(entry.x, entry.log_weights) for entry in draws),
            np.array([estimate.efficiency * estimate.n_draws for estimate in estimates]),
        )


def _two_best_local(values: FloatArray, heights: FloatArray) -> IndexArray:
    """Places of the two highest local maxima along sorted values, the highest first."""
    order = np.argsort(values)
    padded = np.concatenate([[-np.inf], heights[order], [-np.inf]])
    is_local = (padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:])
    local = order[is_local]
    ranked = local[np.argsort(-heights[local])]
    if len(ranked) < 2:
        others = np.argsort(-heights)
        ranked = np.concatenate([ranked, others[others != ranked[0]]])
    return np.asarray(ranked[:2])


def _row_mixture(mixture: RowMixtures, row: int) -> RowMixtures:
    """One row as a mixture of its own."""
    part = slice(row, row + 1)
    return RowMixtures(
        mixture.is_free[part], mixture.weights[part], mixture.means[part], mixture.factors[part]
    )


def _joined(mixtures: Sequence[RowMixtures], rows: Sequence[int]) -> RowMixtures:
    """Rows as one mixture; those with fewer components get some without weight."""
    chosen = [mixtures[row] for row in rows]
    n_components = max(mixture.weights.shape[1] for mixture in chosen)
    k = chosen[0].means.shape[2]
    weights = np.zeros((len(rows), n_components))
    means = np.zeros((len(rows), n_components, k))
    factors = np.broadcast_to(np.eye(k), (len(rows), n_components, k, k)).copy()
    for i, mixture in enumerate(chosen):
        own = mixture.weights.shape[1]
        weights[i, :own], means[i, :own] = mixture.weights[0], mixture.means[0]
        factors[i, :own] = mixture.factors[0]
    is_free = np.concatenate([mixture.is_free for mixture in chosen])
    return RowMixtures(is_free, weights, means, factors)


def _refitted(mixture: RowMixtures, pool: _Pool, row: _Row) -> RowMixtures:
    """A row's mixture with a component at its heaviest draw, adapted to all that were made."""
    draws = row.draws
    heaviest = draws.x[np.argmax(draws.log_weights)]
    pool.join(mixture, draws)
    row.rounds.clear()  # because the mixture changes
    points = pool.draws.x
    apart = points - heaviest
    spread = np.maximum(points.std(axis=0), 1e-12)
    distance = np.square(apart / spread).sum(axis=1)
    near = np.argpartition(distance, _NEIGHBOURS)[:_NEIGHBOURS]
    scale = apart[near].T @ apart[near] / _NEIGHBOURS
    factor = _factors(scale[None, None], mixture.is_free)
    share = 1.0 / (1.0 + mixture.weights.shape[1])
    widened = replace(
        mixture,
        weights=np.concatenate([(1.0 - share) * mixture.weights, [[share]]], axis=1),
        means=np.concatenate([mixture.means, heaviest[None, None]], axis=1),
        factors=np.concatenate([mixture.factors, factor], axis=1),
    )
    weights = tempered(pool.draws.log_weights[None], _TEMPERED)
    return widened.updated(points[None], weights)
