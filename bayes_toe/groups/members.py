"""The likelihood of every member of a group at once, on the scales on which members scatter about the group's mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.model.crowd import crowd_posterior
from bayes_toe.model.posterior import Model
from bayes_toe.model.prior import Prior

_BLOCK = 1 << 14  # values of one temporary array: there are about a hundred of them


class MembersLikelihood:
    """Log likelihood of each of N subjects, without binomial coefficients, at several points of all of them, with its exact gradient.

    Parameters
    ----------
    model : Model
    prior : Prior
        Whose reference interval the quantities refer to; nothing else of it matters.
    subjects : sequence of Subject
    centre : float
        Intensity from which offsets count, natural-log units.
    copies : int
        Points of all subjects in one call.

    Examples
    --------
    >>> from bayes_toe.model.ladder import PREDICTIVE_UPDATE
    >>> one = Subject("A", [0.0, 0.0], [0.0, 0.3], [49, 20], [50, 50])
    >>> value, gradient = MembersLikelihood(PREDICTIVE_UPDATE, Prior(), [one], 0.0, 2)(np.zeros((2, 1, 4)))
    >>> value.shape, gradient.shape
    ((2, 1), (2, 1, 4))
    """

    def __init__(self, model: Model, prior: Prior, subjects: Sequence[Subject], centre: float, copies: int) -> None:
        rows = list(subjects) * copies
        size = max(1, _BLOCK // max(one.n_pairs for one in subjects))
        interval = 1.0 if prior.reference_interval is None else prior.reference_interval
        plain = Prior(offset_sd=1.0, reference_interval=prior.reference_interval)  # an offset is then its own coordinate
        self._blocks = [
            (slice(i, i + size), crowd_posterior(model, plain, rows[i : i + size], centre, interval)) for i in range(0, len(rows), size)
        ]

    def __call__(self, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, (copies, N), and their gradient, (copies, N, k), at eta, (copies, N, k)."""
        points = eta.reshape(-1, eta.shape[-1])
        value, gradient = np.empty(len(points)), np.empty(points.shape)
        with np.errstate(over="ignore", invalid="ignore"):  # a width next to nothing: density 0, where no trajectory goes on
            for some, posterior in self._blocks:
                x, jacobian = posterior.from_group(points[some])
                value[some], slope = posterior.likelihood_gradient(x)
                gradient[some] = (slope[:, None, :] @ jacobian)[:, 0]
        return value.reshape(eta.shape[:-1]), gradient.reshape(eta.shape)

    def repeated(self, eta: FloatArray, rng: np.random.Generator) -> IntArray:
        """Answers 'equal' if everything were done once more, (copies, N, k) -> (copies, N, pairs); 0 where a subject has fewer pairs."""
        points, counts = eta.reshape(-1, eta.shape[-1]), []
        for some, posterior in self._blocks:
            x, _ = posterior.from_group(points[some])
            equal = np.exp(posterior.realised_answers(rng, x, posterior.log_answers(x))[0])
            counts.append(rng.binomial(posterior.subject.n_trials, equal))
        pairs = max(found.shape[1] for found in counts)
        padded = [np.pad(found, ((0, 0), (0, pairs - found.shape[1]))) for found in counts]
        return np.concatenate(padded).reshape(*eta.shape[:-1], pairs)
