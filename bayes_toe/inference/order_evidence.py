"""Log evidences of the four models of the observer.

`order_evidence` computes them for the subjects of one task, as :class:`OrderEvidence`, from the
weighted draws of :mod:`bayes_toe.inference.engine`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, NamedArrays
from bayes_toe.data.study import Subject
from bayes_toe.errors import NumericalError
from bayes_toe.inference.engine import USUAL, Precision, fitted_draws, mixture_of_maxima
from bayes_toe.inference.maxima import laplace
from bayes_toe.inference.model_set import AveragedDraws, ModelSet
from bayes_toe.inference.searches import observer_maxima
from bayes_toe.model.densities import CutNormal, PriorDensity, StandardStudent
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.observer import DEFAULT_PRIOR, ObserverRows
from bayes_toe.model.parameters import (
    CONSTANT_ERROR,
    CONTRACTION,
    MODEL_PRIOR,
    ORDER_MODELS,
    ObserverPrior,
    Parameter,
)
from bayes_toe.model.posterior_array import PosteriorArray, independent_array
from bayes_toe.seeds import generator

#: Names of the four models, in the order of all arrays.
MODEL_NAMES = tuple(ORDER_MODELS)
_N_MODELS = len(MODEL_NAMES)
#: Prior probabilities of the four models.
PRIOR_PROBABILITIES = np.array(list(MODEL_PRIOR.values()))
#: Which of the four models have each effect.
HAS_ERROR = np.array([CONSTANT_ERROR in effects for effects in ORDER_MODELS.values()])
HAS_CONTRACTION = np.array([CONTRACTION in effects for effects in ORDER_MODELS.values()])
HAS_EFFECT = HAS_ERROR | HAS_CONTRACTION
EVERY_MODEL = np.ones(_N_MODELS, np.bool_)
#: Largest number of subjects whose posteriors are one array.
BATCH = 8


@dataclass(frozen=True, eq=False)
class OrderDraws(AveragedDraws):
    """Draws of several of the four models; the coordinates of an absent effect are 0."""

    posterior: ObserverPosterior  # of the model 'both', in whose coordinates the points are

    @cached_property
    def quantities(self) -> NamedArrays:
        """Every named quantity at the draws, (draws,) each."""
        return self.posterior.quantities(self.x)


@dataclass(frozen=True, eq=False, kw_only=True)
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

    def averaged(self, is_chosen: BoolArray = EVERY_MODEL) -> OrderDraws:
        """Draws of some models, by default of all four."""
        draws = super().averaged(is_chosen)
        posterior = OrderModel("both").posterior(self.subject, self.prior)
        return OrderDraws(draws.x, draws.weights, posterior)

    def checked(self) -> Self:
        """The evidences if all are finite numbers; else a NumericalError that names the subject."""
        is_finite = np.isfinite(self.log_evidence)
        if is_finite.all():
            return self
        model = MODEL_NAMES[np.argmin(is_finite)]  # the first model with False
        raise NumericalError(
            f"subject {self.subject.name!r}: the evidence of the model {model!r} is not a finite "
            "number"
        )

    def with_prior_scale(self, effect: Parameter, factor: float) -> ModelSet:
        """The models where the prior of the constant error, or of p, is `factor` times as wide.

        The weights of the draws are multiplied by the density of the other prior over that of this
        prior.
        """
        # The last two coordinates u belong to the constant error and to p, in widths of the
        # prior. A prior that is `factor` times as wide has the density f(u / factor) / factor. The
        # prior of p ends at -1 and 1, which are fewer widths from 0 if it is wider.
        if effect == CONSTANT_ERROR:
            has_effect = HAS_ERROR
            coordinate = -2
            density: PriorDensity = StandardStudent()
            other_density = density
        else:
            has_effect = HAS_CONTRACTION
            coordinate = -1
            sd = self.prior.contraction_sd * self.subject.scales.roving_share
            density = CutNormal(1.0 / sd)
            other_density = CutNormal(1.0 / (factor * sd))

        reweighted = list(self.draws)
        for i in np.flatnonzero(has_effect):
            draws = self.draws[i]
            # A draw beyond the edge of this prior has no weight under either prior.
            is_inside = np.isfinite(draws.log_prior)
            u = draws.x[is_inside, coordinate]
            log_other = other_density.log_density(u / factor) - np.log(factor)
            log_posterior = draws.log_posterior.copy()
            log_posterior[is_inside] += log_other - density.log_density(u)
            reweighted[i] = replace(draws, log_posterior=log_posterior)
        return ModelSet.from_draws(reweighted, self.prior_probabilities)


def order_evidence(
    subjects: Sequence[Subject],
    seed: int,
    prior: ObserverPrior = DEFAULT_PRIOR,
    precision: Precision = USUAL,
) -> list[OrderEvidence]:
    """The evidences of the four models for subjects of one task.

    Random streams depend on the seed and the subject's name.

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
    evidences = unchecked_evidence(subjects, seed, prior, precision)
    return [evidence.checked() for evidence in evidences]


def unchecked_evidence(
    subjects: Sequence[Subject],
    seed: int,
    prior: ObserverPrior = DEFAULT_PRIOR,
    precision: Precision = USUAL,
) -> list[OrderEvidence]:
    """:func:`order_evidence`, where an evidence may be no finite number.

    Up to :data:`BATCH` subjects are one array, which is faster. Subjects of one array have equally
    many pairs: a sum over more pairs may round otherwise, and the results would depend on the other
    subjects.
    """
    indices_by_pairs = defaultdict(list)  # the positions of subjects, by their number of pairs
    for i, subject in enumerate(subjects):
        indices_by_pairs[subject.n_pairs].append(i)

    by_index: dict[int, OrderEvidence] = {}
    for indices in indices_by_pairs.values():
        for start in range(0, len(indices), BATCH):
            batch = indices[start : start + BATCH]
            subjects_of_batch = [subjects[i] for i in batch]
            posteriors = order_posteriors(ObserverRows.from_subjects(subjects_of_batch, prior))
            evidences = evidences_of(posteriors, subjects_of_batch, seed, prior, precision)
            by_index.update(zip(batch, evidences, strict=True))
    return [by_index[i] for i in range(len(subjects))]


def order_posteriors(rows: ObserverRows) -> PosteriorArray:
    """The posteriors of the four models for every row: four of the first row, and so on."""
    n_rows = len(rows.counts)
    repeated_rows = rows.part(np.repeat(np.arange(n_rows), _N_MODELS))
    coordinates = [OrderModel(name).coordinates(rows.task) for name in MODEL_NAMES]
    return independent_array(repeated_rows, coordinates * n_rows)


def evidences_of(
    posteriors: PosteriorArray,
    subjects: Sequence[Subject],
    seed: int,
    prior: ObserverPrior,
    precision: Precision = USUAL,
) -> list[OrderEvidence]:
    """The evidences of subjects, from the four posteriors of each subject."""
    maxima = observer_maxima(posteriors)
    modes, laplace_evidences = laplace(posteriors, maxima)

    mixtures = list(map(mixture_of_maxima, maxima, posteriors.is_free))
    generators = []
    for subject in subjects:  # its four models share a generator
        generators += [generator(seed, subject.name, "order evidence")] * _N_MODELS
    families = np.repeat(np.arange(len(subjects)), _N_MODELS)  # the four models of a subject
    _, draws = fitted_draws(posteriors, mixtures, generators, precision, families)

    evidences = []
    for i, subject in enumerate(subjects):
        models = slice(_N_MODELS * i, _N_MODELS * (i + 1))  # the models of this subject
        evidences.append(
            OrderEvidence.from_draws(
                draws[models],
                PRIOR_PROBABILITIES,
                subject=subject,
                prior=prior,
                laplace=laplace_evidences[models],
                modes=modes[models],
            )
        )
    return evidences
