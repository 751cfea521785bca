"""What is stored for every pair and every draw of a thinned sample: the log likelihood, and an answer that the model predicts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Study
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.model.target import Answering
from bayes_toe.seeds import generator

#: Values of one of the two beyond which both are left out of the file: 20 million log likelihoods are 80 MB.
POINTWISE_LIMIT = 20_000_000
#: Draws of a subject, about, for which both are stored: enough for what is done with them (Pareto k-hat, leave-one-out, predictive checks).
POINTWISE_DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Pointwise:
    """Per draw and pair of one subject, for every so-many-th draw; see :func:`spacing`.

    Attributes
    ----------
    log_likelihood : array of float32, shape (chains, draws, pairs)
    predicted : array of int32, shape (chains, draws, pairs)
        'Equal' answers of a repeated experiment.
    """

    log_likelihood: npt.NDArray[np.float32]
    predicted: npt.NDArray[np.int32]


def spacing(chains: int, draws: int) -> int:
    """Every so-many-th draw of a chain has both.

    Examples
    --------
    >>> spacing(4, 1000), spacing(4, 5000)
    (1, 5)
    """
    return max(1, chains * draws // POINTWISE_DRAWS)


def values_needed(study: Study, sampler: SamplerSettings) -> int:
    """Values of one of the two for a whole study."""
    draws = sampler.walkers * sampler.kept_steps
    kept = sampler.ensembles * -(-draws // spacing(sampler.ensembles, draws))
    return kept * sum(subject.n_pairs for subject in study)


def pointwise(posterior: Answering, x: FloatArray, seed: int) -> Pointwise:
    """Both for unconstrained draws x, shape (chains, draws, k), with a random stream of the subject's and the model's own."""
    subject, x = posterior.subject, x[:, :: spacing(*x.shape[:2])]
    rng = generator(seed, subject.name, posterior.model.name, "posterior_predictive")
    shape = (*x.shape[:2], subject.n_pairs)
    log_likelihood, predicted = np.empty(shape, np.float32), np.empty(shape, np.int32)
    for chain, points in enumerate(x):  # one at a time: temporaries of a large design stay small
        answers = posterior.log_answers(points)
        log_likelihood[chain] = posterior.pair_log_likelihood(points, answers)
        predicted[chain] = rng.binomial(subject.n_trials, np.exp(posterior.realised_answers(rng, points, answers)[0]))
    return Pointwise(log_likelihood, predicted)
