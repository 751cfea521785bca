"""Log evidences of the four models of the observer.

`order_evidence` computes them for the subjects of one task, as :class:`OrderEvidence`, from the
weighted draws of :mod:`bayes_toe.inference.engine`. `observer_maxima` finds the maxima with which
it begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, IndexArray
from bayes_toe.data.conditions import StimulusScales
from bayes_toe.data.study import Subject
from bayes_toe.errors import NumericalError
from bayes_toe.inference.engine import USUAL, Precision, mixture_of_maxima, weighted_draws
from bayes_toe.inference.maxima import Ascent, Expansion, ascend
from bayes_toe.inference.model_set import AveragedDraws, ModelSet
from bayes_toe.model.derivatives import hessian
from bayes_toe.model.distributions import LOG_2PI
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.observer import DEFAULT_PRIOR, ObserverRows
from bayes_toe.model.parameters import (
    CONSTANT_ERROR,
    CONTRACTION,
    LAPSE_RATE,
    MODEL_PRIOR,
    ORDER_MODELS,
    ObserverPrior,
)
from bayes_toe.model.posterior_array import PosteriorArray, observer_array
from bayes_toe.seeds import generator

#: Names of the four models, in the order of all arrays.
MODEL_NAMES = tuple(ORDER_MODELS)
_N_MODELS = len(MODEL_NAMES)
#: Their prior probabilities.
PRIOR_PROBABILITIES = np.array([MODEL_PRIOR[name] for name in MODEL_NAMES])
#: Which of the four models have each effect.
HAS_ERROR = np.array([CONSTANT_ERROR in ORDER_MODELS[name] for name in MODEL_NAMES])
HAS_CONTRACTION = np.array([CONTRACTION in ORDER_MODELS[name] for name in MODEL_NAMES])
HAS_EFFECT = HAS_ERROR | HAS_CONTRACTION
EVERY_MODEL = np.ones(len(MODEL_NAMES), np.bool_)
#: Subjects whose posteriors are computed together where there are many.
BATCH = 8

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
_POLISH_GAIN = 1e-8  # the same for the maximum of which Laplace's evidence is


@dataclass(frozen=True, eq=False)
class OrderDraws(AveragedDraws):
    """Draws of several of the four models; the coordinates of an absent effect are 0."""

    posterior: ObserverPosterior  # of the model 'both', in whose coordinates the points are

    @cached_property
    def quantities(self) -> dict[str, FloatArray]:
        """Every named quantity at the draws, (draws,) each."""
        return self.posterior.quantities(self.x)


@dataclass(frozen=True, eq=False)
class OrderEvidence(ModelSet):
    """The four models of one subject by their draws, in the order of :data:`MODEL_NAMES`.

    Attributes
    ----------
    subject : Subject
    prior : ObserverPrior
    laplace : ndarray, shape (4,)
        Laplace's log evidence; NaN where the Hessian at the maximum is not negative definite.
    modes : ndarray, shape (4, k)
        The maximum of each model's posterior density.
    """

    subject: Subject
    prior: ObserverPrior
    laplace: FloatArray
    modes: FloatArray

    @property
    def scales(self) -> StimulusScales:
        """Location and scales of the subject's stimuli."""
        return self.subject.scales

    def averaged(self, is_chosen: BoolArray = EVERY_MODEL) -> OrderDraws:
        """Draws of some models, by default of all four, by probability and weight."""
        draws = super().averaged(is_chosen)
        posterior = OrderModel("both").posterior(self.subject, self.prior)
        return OrderDraws(draws.x, draws.weights, posterior)


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
        results += _evidences(subjects[start : start + BATCH], seed, prior, precision)
    return results


def _evidences(
    subjects: Sequence[Subject], seed: int, prior: ObserverPrior, precision: Precision
) -> list[OrderEvidence]:
    """The evidences of a few subjects, four posteriors each, computed together."""
    families = np.repeat(np.arange(len(subjects)), _N_MODELS)
    rows = ObserverRows.from_subjects(subjects, prior).part(families)
    coordinates = [OrderModel(name).coordinates(subjects[0].task) for name in MODEL_NAMES]
    array = observer_array(rows, coordinates * len(subjects))

    maxima = observer_maxima(array)
    modes, laplace = _laplace(array, maxima)
    mixtures = [mixture_of_maxima(*pair) for pair in zip(maxima, array.is_free, strict=True)]
    streams = [generator(seed, subject.name, "order evidence") for subject in subjects]
    generators = [streams[i] for i in families]
    draws = weighted_draws(array, mixtures, generators, families, precision)

    results = []
    for i, subject in enumerate(subjects):
        models = slice(_N_MODELS * i, _N_MODELS * (i + 1))
        of_models = tuple(draws[models]), PRIOR_PROBABILITIES
        results.append(OrderEvidence(*of_models, subject, prior, laplace[models], modes[models]))
        _require_finite(results[-1])
    return results


def _require_finite(evidence: OrderEvidence) -> None:
    """Refuse an evidence that is not a finite number."""
    for model, log_evidence in zip(MODEL_NAMES, evidence.log_evidence, strict=True):
        if not np.isfinite(log_evidence):
            raise NumericalError(
                f"subject {evidence.subject.name!r}: the evidence of the model {model!r} is not a "
                "finite number"
            )


# --- Maxima --------------------------------------------------------------------------------------


def observer_maxima(array: PosteriorArray) -> list[Ascent]:
    """The maxima of every posterior with the observer's coordinates, as a mixture begins with.

    A search starts at several constant errors and from a flat curve, then at several lapse rates.
    A posterior without constant error must have its neighbour with it next to it.
    """
    profile, profile_owners, values = _profile(array)
    starts, owners, is_held = _second_starts(array, profile, profile_owners, values)
    second = ascend_from(array, owners, starts, is_held)
    # A search along the constant error is of the posteriors that have it.
    searches = profile.joined(second)
    all_owners = np.concatenate([profile_owners, owners])
    return [searches.part(all_owners == i) for i in range(len(array))]


def ascend_from(
    array: PosteriorArray,
    owners: IndexArray,
    starts: FloatArray,
    is_held: BoolArray | bool = False,
    least_gain: float = _GAIN,
) -> Ascent:
    """Fisher scoring from many starts at once.

    Parameters
    ----------
    array : PosteriorArray
    owners : ndarray of int, shape (searches,)
        The posterior of each search.
    starts : ndarray, shape (searches, d)
    is_held : ndarray of bool, shape (searches, d)
        Further coordinates that stay where they start.
    least_gain : float
        A search ends where the predicted gain, nats, is below this.
    """
    return ascend(
        lambda x, index: _expansion(array.part(owners[index]), x),
        starts,
        is_held=~array.is_free[owners] | is_held,
        least_gain=least_gain,
        largest_step=_LARGEST_STEP,
        most_steps=_MOST_STEPS,
        retry_damping=0.0,
    )


def _expansion(array: PosteriorArray, points: FloatArray) -> Expansion:
    """The log density of each posterior about its point, (posteriors, d).

    The curvature is that of Fisher information and prior.
    """
    w, is_free = points[:, None, :], array.is_free
    log_likelihood, gradient, information = array.likelihood.scoring(w)
    slopes, curvatures = array.prior_slopes(w)
    value = log_likelihood[:, 0] + array.log_prior(w)[:, 0]
    gradient = np.where(is_free, (gradient + slopes)[:, 0], 0.0)

    both_free = is_free[:, :, None] & is_free[:, None, :]
    curvature = np.where(both_free, information[:, 0], 0.0)
    diagonal = np.arange(points.shape[1])
    curvature[:, diagonal, diagonal] += np.where(is_free, curvatures[:, 0], 1.0)
    return Expansion(value, gradient, curvature)


def _start(array: PosteriorArray, noise: float) -> FloatArray:
    """A point from which to search, (d,)."""
    values = {"noise": noise, "q0": _START_PEAK}
    return np.array([values.get(name, 0.0) for name in array.names])


def _profile(array: PosteriorArray) -> tuple[Ascent, IndexArray, FloatArray]:
    """Maxima along the constant error, and one from a flat curve for every posterior."""
    error, n_values = array.names.index(CONSTANT_ERROR.name), len(_CONSTANT_ERRORS)
    with_error = np.flatnonzero(array.is_free[:, error])
    held_owners = np.repeat(with_error, n_values)
    values = np.tile(_CONSTANT_ERRORS, len(with_error))
    starts = np.tile(_start(array, _START_NOISE), (len(held_owners), 1))
    starts[:, error] = values / array.likelihood.rows.prior.constant_error_scale

    flat = np.tile(_start(array, _FLAT_NOISE), (len(array), 1))
    is_held = np.zeros((len(starts) + len(flat), len(array.names)), np.bool_)
    is_held[: len(starts), error] = True
    owners = np.concatenate([held_owners, np.arange(len(array))])
    maxima = ascend_from(array, owners, np.concatenate([starts, flat]), is_held)
    return maxima, owners, values


def _second_starts(
    array: PosteriorArray, profile: Ascent, owners: IndexArray, values: FloatArray
) -> tuple[FloatArray, IndexArray, BoolArray]:
    """Starts of free maxima, and of those with lapse rates held."""
    n_held = len(values)  # the searches after these start from a flat curve
    lapse = array.names.index(LAPSE_RATE.name)
    starts: list[FloatArray] = []
    start_owners: list[int] = []
    lapse_is_held: list[bool] = []
    for i in range(len(array)):
        candidates = _profile_maxima(array, i, owners[:n_held], values, profile)
        flat = n_held + i
        best = flat if profile.value[flat] > profile.value[candidates[0]] else candidates[0]
        free = profile.x[candidates]
        with_lapse = np.tile(profile.x[best], (len(_LAPSE_SCORES), 1))
        with_lapse[:, lapse] = _LAPSE_SCORES
        starts += [*free, *with_lapse]
        start_owners += [i] * (len(free) + len(with_lapse))
        lapse_is_held += [False] * len(free) + [True] * len(with_lapse)
    is_held = np.zeros((len(starts), len(array.names)), np.bool_)
    is_held[:, lapse] = lapse_is_held
    return np.array(starts), np.array(start_owners), is_held


def _profile_maxima(
    array: PosteriorArray, i: int, owners: IndexArray, values: FloatArray, profile: Ascent
) -> IndexArray:
    """The maxima of a profile from which a posterior starts, the best first.

    A posterior without constant error starts at the maximum of its neighbour with c = 0.
    """
    if array.is_free[i, array.names.index(CONSTANT_ERROR.name)]:
        searches = np.flatnonzero(owners == i)
        return searches[_two_best_local(values[searches], profile.value[searches])]
    searches = np.flatnonzero(owners == i + 1)
    return searches[values[searches] == 0.0]


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


def _laplace(array: PosteriorArray, maxima: Sequence[Ascent]) -> ArrayPair:
    """The highest maximum of every posterior, (n, d), and Laplace's log evidence, (n,)."""
    n, d = array.is_free.shape
    owners = np.arange(n)
    highest = np.array([ends.x[np.argmax(ends.value)] for ends in maxima])
    top = ascend_from(array, owners, highest, least_gain=_POLISH_GAIN)

    def gradient(points: FloatArray) -> FloatArray:
        repeated = array.part(np.resize(owners, len(points)))
        w = points[:, None, :]
        slope = repeated.likelihood.gradient(w)[1] + repeated.prior_slopes(w)[0]
        return slope[:, 0]

    diagonal = np.arange(d)
    curvature = -hessian(gradient, top.x, top.curvature[:, diagonal, diagonal])
    both_free = array.is_free[:, :, None] & array.is_free[:, None, :]
    curvature = np.where(both_free, curvature, np.eye(d))
    is_proper = np.linalg.eigvalsh(curvature)[:, 0] > 0.0
    log_determinant = np.linalg.slogdet(curvature)[1]
    dimensions = array.is_free.sum(axis=1)
    laplace = top.value + 0.5 * dimensions * LOG_2PI - 0.5 * log_determinant
    return top.x, np.where(is_proper, laplace, np.nan)
