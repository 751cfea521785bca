"""What posteriors and engines share: names of quantities, points, counts, differences of gradients, levelled coordinates, contraction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import NumericalError

if TYPE_CHECKING:
    from bayes_toe.model.posterior_protocol import AnswerPosterior

#: Steps of differences of gradients, in units of 1/sqrt abs H_ii: one-sided ones during a search, central ones where they are kept.
_SHORT, _LONG = 1e-6, 1e-4
_FLAT, _FINEST = (
    1e-6,
    1e-12,
)  # a curvature that is taken to be no smaller; the smallest step over the coordinate
Gradient = Callable[[FloatArray], FloatArray]
#: The range that is compared.
RANGE = (0.05, 0.95)
#: Contraction below which a parameter is said to be dominated by its prior: a range narrowed by less than three tenths.
DOMINATED = 0.5
#: The order in which tables and figures name quantities.
ORDER = (
    *(
        "noise",
        "mu1",
        "sigma_p",
        "sigma_l",
        "rho",
        "q0",
        "lapse_rate",
        "noise_slope",
        "criterion_slope",
        "peak_slope",
        "guess_second",
        "exponent",
        "icc",
    ),
    *("gamma", "sigma1", "gain", "width", "offset", "pull", "pse_shift"),
    *("constant_error", "contraction", "jnd", "zone"),
)


@dataclass(frozen=True)
class Names:
    """Names of quantities: as many natural and as many identified ones as there are coordinates."""

    natural: tuple[str, ...]  # what the model is written in
    identified: tuple[str, ...]  # what the answers depend on
    derived: tuple[str, ...] = ()  # further ones that tables report
    monotone: tuple[
        str, ...
    ] = ()  # those that are a monotone function of a single other one, so that their ranks say nothing new

    @property
    def reported(self) -> tuple[str, ...]:
        """What tables and files hold: natural and derived, in order."""
        return _ordered((*self.natural, *self.derived))

    @property
    def all(self) -> tuple[str, ...]:
        """Every name, in order."""
        return _ordered((*self.natural, *self.derived, *self.identified))

    def __add__(self, other: Names) -> Names:
        return Names(
            self.natural + other.natural,
            self.identified + other.identified,
            self.derived + other.derived,
            self.monotone + other.monotone,
        )


def _ordered(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(
        sorted(
            dict.fromkeys(names),
            key=lambda name: ORDER.index(name) if name in ORDER else len(ORDER),
        )
    )


def require_points(x: npt.ArrayLike, k: int) -> FloatArray:
    """Points as an array of shape (points, k) without NaN."""
    points = np.atleast_2d(np.asarray(x, np.float64))
    if points.ndim != 2 or points.shape[1] != k:
        raise NumericalError(f"points must have shape (points, {k}), found {points.shape}")
    if np.isnan(points).any():
        raise NumericalError("a coordinate is NaN")
    return points


def require_defined(log_posterior: FloatArray, target: AnswerPosterior) -> None:
    """Refuse log densities among which there is a NaN."""
    if np.isnan(log_posterior).any():
        raise NumericalError(f"subject {target.subject.name!r}: log posterior is NaN")


def log_likelihoods(subject: Subject, log_answers: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Log likelihood of each pair from the log probabilities of both answers, (points, pairs) each, without binomial coefficients."""
    of_equal, of_different = (
        times_counts(count, values)
        for count, values in zip(answer_counts(subject), log_answers, strict=True)
    )
    return of_equal + of_different


def answer_counts(subject: Subject) -> tuple[FloatArray, FloatArray]:
    """How often each pair got either answer, that which the task counts first, shape (pairs,) each."""
    return subject.n_yes.astype(np.float64), (subject.n_trials - subject.n_yes).astype(np.float64)


def times_counts(counts: FloatArray, values: FloatArray) -> FloatArray:
    """Counts times what each answer adds; an answer never given adds 0, also where its probability is 0."""
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # a product beyond the largest float is infinite to all digits; 0 times infinity
        product = np.asarray(counts * values)
    never = ~(counts > 0.0)
    if never.any():
        np.copyto(product, 0.0, where=never)
    return product


def one_sided(gradient: Gradient, x: FloatArray, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gradient (points, k) and Hessian (points, k, k) from one call: what a search needs of a gradient's differences.

    `bend`, shape (points, k), has the sizes of the Hessian's diagonal about there, which set the steps.
    """
    points, k = x.shape
    ahead = x[None] + _steps(x, bend, _SHORT)
    found = gradient(np.concatenate([x[None], ahead]).reshape(-1, k)).reshape(k + 1, points, k)
    return found[0], _symmetric(found[1:] - found[0], ahead - x)


def hessian(gradient: Gradient, x: FloatArray, bend: FloatArray | None = None) -> FloatArray:
    """Hessian, shape (points, k, k), by central differences of a gradient, (points, k) -> (points, k).

    `bend`, as in :func:`one_sided`, is found by differences over 1e-4 first where it is not given.
    """
    k = x.shape[1]
    if bend is None:
        bend = np.abs(np.diagonal(hessian(gradient, x, np.ones(x.shape)), axis1=1, axis2=2))
    step = _steps(x, bend, _LONG)
    ahead, behind = x + step, x - step
    found = gradient(np.concatenate([ahead, behind]).reshape(-1, k)).reshape(2, k, *x.shape)
    return _symmetric(found[0] - found[1], ahead - behind)


def _steps(x: FloatArray, bend: FloatArray, unit: float) -> FloatArray:
    """Steps in one coordinate after the other, (k, points, k), none so small that it is rounding."""
    return np.eye(x.shape[1])[:, None] * np.maximum(
        unit / np.sqrt(np.maximum(bend, _FLAT)), _FINEST * np.abs(x)
    )


def _symmetric(change: FloatArray, step: FloatArray) -> FloatArray:
    """Hessians from what gradients change by, (k, points, k), over steps in one coordinate after the other, of the same shape."""
    k = len(change)
    rows = change / step[np.arange(k), :, np.arange(k)][:, :, None]
    return np.asarray(0.5 * (rows.transpose(1, 0, 2) + rows.transpose(1, 2, 0)))


class Levels(Protocol):
    """A bijection between unconstrained coordinates x and levelled ones y, in which mixtures of Student-t densities fit the posterior."""

    def level(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Levelled coordinates of x, shape (points, k), and log |dy/dx|, shape (points,)."""

    def unlevel(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unconstrained coordinates of y, shape (points, k), and log |dy/dx| there; points beyond all floats go where the density is 0."""


class SameCoordinates:
    """The levelling that changes nothing."""

    def level(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A copy of x, and 0."""
        return x.copy(), np.zeros(len(x))

    def unlevel(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A copy of y, and 0."""
        return y.copy(), np.zeros(len(y))


def contraction(target: AnswerPosterior, parameter: str, low: float, high: float) -> float:
    """How much the answers narrowed a parameter whose posterior quantiles at 5 and 95 % are `low` and `high`.

    contraction = 1 - (posterior width / prior width)^2, widths from the 5 % to the 95 % quantile. For normal densities that is one minus
    the ratio of variances; where mu1 has a funnel its variance is ruled by rare far draws, its quantiles are not. 1: all from the data;
    0: as wide as the prior; negative: wider.

    Examples
    --------
    >>> from bayes_toe.data.study import Subject
    >>> from bayes_toe.model.ladder import posterior_of
    >>> round(contraction(posterior_of(Subject("S01", [0.0], [0.3], [20], [50])), "q0", 0.5, 0.59), 2)
    0.97
    """
    before = target.prior_quantile(parameter, RANGE[1]) - target.prior_quantile(parameter, RANGE[0])
    return 1.0 - ((high - low) / before) ** 2
