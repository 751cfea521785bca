"""What the answers alone say: frequencies of 'equal' with their uncertainty, accuracy, order.

Their collapse on the model's curve is here too.

The Laplace estimator is the mean, and its error the standard deviation, of the posterior Beta(n_Eq
+ 1, n_Diff + 1) that a uniform prior gives each frequency; neither degenerates where every answer
was the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import log_expit

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.model.paper_model import PaperPosterior
from bayes_toe.model.posterior import require_points


def laplace_estimate(n_yes: npt.ArrayLike, n_trials: npt.ArrayLike) -> FloatArray:
    """Estimated P(equal), qhat = (n_Eq + 1)/(n + 2); no unit. Arguments broadcast.

    Source: Eq. e:2b.

    Examples
    --------
    >>> laplace_estimate([0, 24, 48], 48).tolist()
    [0.02, 0.5, 0.98]
    """
    k, n = np.asarray(n_yes, np.float64), np.asarray(n_trials, np.float64)
    return np.asarray((k + 1.0) / (n + 2.0))


def laplace_error(n_yes: npt.ArrayLike, n_trials: npt.ArrayLike) -> FloatArray:
    """Uncertainty of qhat, sigmahat_q = sqrt(qhat (1 - qhat)/(n + 3)).

    Arguments as for :func:`laplace_estimate`.

    Source: Eq. e:2b, in the form in which nothing cancels.
    """
    k, n = np.asarray(n_yes, np.float64), np.asarray(n_trials, np.float64)
    return np.asarray(np.sqrt((k + 1.0) / (n + 2.0) * ((n - k + 1.0) / (n + 2.0)) / (n + 3.0)))


def accuracy(subject: Subject) -> float:
    """Share of correct answers among those that can be, 0..1; NaN where there is none.

    Source: Results, first part. Every trial counts alike.

    Examples
    --------
    >>> accuracy(Subject("S01", [0.0, 0.0], [0.0, 0.3], [9, 4], [10, 10]))
    0.75
    """
    difference = subject.s2 - subject.s1
    wrong, n = (
        subject.task.wrong(difference, subject.n_yes, subject.n_trials),
        subject.n_trials[subject.task.right(difference) != 0].sum(),
    )
    return float(1.0 - wrong.sum() / n) if n else float("nan")


def presentation_order(subject: Subject) -> IntArray:
    """Order of every pair, sign(s1 - s2): -1 weaker first (the paper's red), 0 equal stimuli (grey), 1 stronger first (blue).

    Source: Methods and Fig. 1C; the caption of Fig. 3 swaps the colours of its circles.

    Examples
    --------
    >>> presentation_order(Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [9, 4, 5], [10, 10, 10])).tolist()
    [0, -1, 1]
    """
    return np.sign(subject.s1 - subject.s2).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Collapse:
    """Model-free frequencies on the normalised distance, where both orders fall on q/q0 = 2^(-z^2).

    Source: Fig. 3, lower row.

    Arrays have shape (pairs,). Bands are quantiles over the draws that were given.
    """

    order: IntArray  # -1 weaker stimulus first, 0 equal stimuli, 1 stronger first
    # normalised distance (s2 - mu_2)/w, the median, and its lower and upper quantile; no unit
    z: FloatArray
    z_low: FloatArray
    z_high: FloatArray
    ratio: FloatArray  # qhat/q0, and sigmahat_q/q0, at the median q0. Source: Eq. e:2b
    error: FloatArray
    top: float  # the median q0; 1 of a model without it, as of 'which is stronger'


def collapse(posterior: PaperPosterior, x: npt.ArrayLike, *, mass: float = 0.9) -> Collapse:
    """Data of Fig. 3's lower row at unconstrained points x, shape (draws, k) or (k,).

    Bands hold `mass` of the draws.
    """
    points = require_points(x, len(posterior.coordinates))
    low, middle, high = np.quantile(
        posterior.distance(points), [0.5 - 0.5 * mass, 0.5, 0.5 + 0.5 * mass], axis=0
    )
    peak = [points[:, i] for i, name in enumerate(posterior.coordinates) if name == "logit_q0"]
    top = float(np.exp(log_expit(np.median(peak)))) if peak else 1.0
    subject = posterior.subject
    q, error = (
        estimate(subject.n_yes, subject.n_trials) for estimate in (laplace_estimate, laplace_error)
    )
    return Collapse(presentation_order(subject), middle, low, high, q / top, error / top, top)
