"""Maximum-likelihood fit of the paper's observer with its penalty on mu1.

`fit_counts` fits one vector of counts, or thousands at once, in either task.

The fit maximises log likelihood (no binomial coefficients) - (mu1 - mean)^2 / (2 V_1), over 0 <=
gamma <= 1, any width w, and a share of 0 to 1: q0, or 1 - lambda. Source: Eq. mod:logp_grouped.
(The paper calls it minimising the log-likelihood; it is maximising.)

The maximum often lies on an edge, sometimes one where a parameter is infinite or 0. A search moves
in u = (c, -log(p/p_max), -log w, -log share), where c is the offset and p the pull. gamma = 1 and a
share of 1 are the bounds u_1 = 0 and u_3 = 0, on which a search can end. Towards the other edges
the likelihood rises less and less; a search ends far out, and the edge is named.

Searches start at the highest points of the parts of a grid. Several maxima differ in the pull: a
vanishing one with the prior mean far to either side, a middle one, the largest, and none at all. A
pull nearly determines the other coordinates, so the highest grid point of a range of pulls lies
close to the maximum. The probabilities at grid points are the same for all rows, so that one matrix
product gives all likelihoods there. A parameter on which equally high maxima disagree is left open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import expit

from bayes_toe.arrays import ArrayPair, BoolArray, FloatArray, IntArray
from bayes_toe.data.study import Subject
from bayes_toe.inference.maxima import Ascent, Differenced, ascend
from bayes_toe.inference.prediction import predicted_answers
from bayes_toe.model.answer_curves import LogAnswers, log_likelihoods, times_counts
from bayes_toe.model.paper_equations import MAX_PULL, natural_names
from bayes_toe.model.paper_rows import (
    POWERS,
    bell_answers,
    bell_slopes,
    guessing_answers,
    guessing_slopes,
)
from bayes_toe.model.prior import DEFAULT, Prior

_BLOCK = 1 << 12  # counts that are fitted together
_FULL = 1e-15  # -log of a share that is 1 to all digits
_EMPTY = 80.0  # -log of a share that is 0 to all digits
_SMALL = 12.0  # -log of a share at which a search has gone towards 0
_WIDE = 7.0  # log of a width, over the steps between stimuli, that counts as infinite
_NARROWER = 30.0  # difference to the log of a width that counts as 0
_EQUAL = 1e-7  # nats: maxima that differ by less are equally high
_TOLERANCE = 0.01  # parameters that differ by less are the same
_MOST_STEPS = 40  # of the first searches; after them only the best one of each row goes on
_LEAST_GAIN = 1e-9  # nats: the first searches end where a step promises less
#: Parts of the grid: pulls as shares of the largest one, and signs of the offset.
_PARTS = (
    ((0.003, 0.01, 0.03), (-1.0,)),
    ((0.003, 0.01, 0.03), (1.0,)),
    ((0.1, 0.2, 0.4), (-1.0, 1.0)),
    ((1.0,), (-1.0, 1.0)),
)
#: Offsets and log widths of the grid on the scale of the design, and its shares.
_OFFSETS = (0.05, 0.15, 0.4, 1.0, 2.0)
_LOG_WIDTHS = np.arange(-2.0, 1.6, 0.5)
_SHARES = (0.05, 0.2, 0.5, 0.8, 0.95, 0.99)


@dataclass(frozen=True, eq=False)
class PenalisedLikelihood:
    """The function that a fit maximises, for the pairs of a subject.

    Points u have the shape (points, 4), and counts (points, pairs). The likelihood is that of the
    paper's model. The normal prior of mu1 is the penalty; the paper's has mean 0 and V_1 = 10^2.
    """

    curve: IdentifiedCurve
    mu1_mean: float
    mu1_sd: float

    @cached_property
    def log_scale(self) -> float:
        """Log of the root mean square step between the stimuli of a pair."""
        steps = np.abs(self.curve.subject.s2 - self.curve.subject.s1)
        steps = steps[steps > 0.0]
        if len(steps) == 0:
            return float(np.log(0.3))
        return float(0.5 * np.log(np.mean(np.square(steps))))

    def coordinates(self, u: FloatArray) -> FloatArray:
        """The coordinates of the curve at points, (points, 4)."""
        logits = -u - np.log(-np.expm1(-np.maximum(u, _FULL)))
        share = logits[:, 3]
        if self.curve.share == "lapse_rate":
            share = -share
        return np.stack([u[:, 0], logits[:, 1], -u[:, 2], share], axis=-1)

    def gradient(self, u: FloatArray, n_yes: IntArray) -> ArrayPair:
        """The objective, (points,), and its gradient, (points, 4).

        The gradient of the penalty follows from mu1 = sbar + c/p and d(1/p)/du_1 = 1/p.
        """
        value, slopes = self.curve.likelihood_gradient(self.coordinates(u), n_yes)
        logit_slopes = 1.0 / np.expm1(-np.maximum(u, _FULL))
        slopes[:, 1] *= logit_slopes[:, 1]
        slopes[:, 2] *= -1.0
        slopes[:, 3] *= logit_slopes[:, 3]
        if self.curve.share == "lapse_rate":
            slopes[:, 3] *= -1.0
        inverse_pull = np.exp(u[:, 1]) / MAX_PULL
        offset_slope = self._deviation(u) / self.mu1_sd * inverse_pull
        slopes[:, 0] -= offset_slope
        slopes[:, 1] -= offset_slope * u[:, 0]
        return value - self.penalty(u), slopes

    def penalty(self, u: FloatArray) -> FloatArray:
        """(mu1 - mean)^2 / (2 V_1), (points,)."""
        return 0.5 * np.square(self._deviation(u))

    def _deviation(self, u: FloatArray) -> FloatArray:
        """Distance of mu1 from the mean of its normal, in its standard deviations, (points,)."""
        mu1 = self.curve.sbar + u[:, 0] * np.exp(u[:, 1]) / MAX_PULL
        return (mu1 - self.mu1_mean) / self.mu1_sd

    @cached_property
    def grid(self) -> list[FloatArray]:
        """The points of each part of the grid, (points, 4); the last part has no pull."""
        scale = np.exp(self.log_scale)
        mean_offset = self.mu1_mean - self.curve.sbar
        axes = []
        for shares, signs in _PARTS:
            pulls = np.maximum(-np.log(shares), _FULL)
            axes.append((scale * np.outer(signs, _OFFSETS).ravel(), pulls))
        axes.append((MAX_PULL * mean_offset * np.exp([-_EMPTY]), np.array([_EMPTY])))

        grid = []
        for offsets, pulls in axes:
            minus_log_widths = -self.log_scale - _LOG_WIDTHS
            points = np.meshgrid(offsets, pulls, minus_log_widths, -np.log(_SHARES))
            grid.append(np.stack(points, axis=-1).reshape(-1, 4))
        return grid

    @cached_property
    def grid_answers(self) -> list[FloatArray]:
        """The log probabilities of both answers at the points of the grid, (points, 2 pairs)."""
        log_answers = []
        for points in self.grid:
            log_answers.append(np.hstack(self.curve.log_answers(self.coordinates(points))))
        return log_answers

    def starts(self, n_yes: IntArray) -> FloatArray:
        """The highest points of the parts of the grid for each row, (rows, parts, 4).

        Searches from them missed the best known maximum in 3 of 6,400 rows (replicates of 16
        subjects, most of them with few or extreme counts).
        """
        counts = np.hstack([n_yes, self.curve.subject.n_trials - n_yes])
        starts = []
        for points, log_answers in zip(self.grid, self.grid_answers, strict=True):
            objective = counts @ log_answers.T - self.penalty(points)
            starts.append(points[objective.argmax(axis=1)])
        return np.stack(starts, axis=1)

    def natural(self, u: FloatArray) -> FloatArray:
        """The natural parameters at points, (points, 4)."""
        return self.curve.natural(self.coordinates(u))


@dataclass(frozen=True, eq=False)
class MaximumLikelihoodFits:
    """Maximum-likelihood fits of one design to one or many vectors of counts.

    Attributes
    ----------
    parameters : ndarray, shape (rows, 4)
        mu1, sigma_p, sigma_l (natural-log intensity), and q0 or the lapse rate. NaN where the data
        leave one open ("not unique").
    log_likelihood : ndarray, shape (rows,)
        At the maximum, without binomial coefficients and penalty, nats.
    objective : ndarray, shape (rows,)
        Log likelihood minus penalty, which is maximised.
    edges : dict
        By name of an edge: whether the maximum lies on it, (rows,).
    arrived : ndarray, shape (rows,)
        False where the search did not converge; the row is then the best point that it found.
    points : ndarray, shape (rows, 4)
        The maximum in the coordinates of the curve, also where a parameter is open.
    subject : Subject
        The pairs.
    """

    parameters: FloatArray
    log_likelihood: FloatArray
    objective: FloatArray
    edges: dict[str, BoolArray]
    arrived: BoolArray
    points: FloatArray
    subject: Subject

    def __len__(self) -> int:
        return len(self.objective)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return natural_names(self.subject.task)

    def yes(self, s1: FloatArray, s2: FloatArray) -> FloatArray:
        """P of the answer that the task counts, for any pairs, (pairs,) -> (rows, pairs)."""
        return predicted_answers(IdentifiedCurve(self.subject), self.points, s1, s2)

    @property
    def at_edge(self) -> tuple[str, ...]:
        """The edges of every row as text, joined with ';', empty for a maximum inside."""
        names = np.array(list(self.edges))
        is_on_edge = np.stack(list(self.edges.values()), axis=-1)
        return tuple(";".join(names[row]) for row in is_on_edge)


def fit_counts(
    subject: Subject, prior: Prior = DEFAULT, n_yes: npt.ArrayLike | None = None
) -> MaximumLikelihoodFits:
    """Fit counts, (rows, pairs), over a subject's pairs, by default its own.

    The prior's normal of mu1 is the penalty.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> fits = fit_counts(subject)
    >>> fits.at_edge, bool(fits.arrived[0])
    (('q0=1',), True)
    """
    own_prior, share = prior.for_subjects(subject), subject.task.lapses
    curve = IdentifiedCurve(subject)
    likelihood = PenalisedLikelihood(curve, *own_prior.mu1_normal)
    counts = np.atleast_2d(np.asarray(subject.n_yes if n_yes is None else n_yes))
    size = max(1, _BLOCK // subject.n_pairs)
    blocks = []
    for i in range(0, len(counts), size):
        blocks.append(_fit_block(likelihood, counts[i : i + size]))
    u, value, arrived, is_narrow, is_open = map(np.concatenate, zip(*blocks, strict=True))

    _, pull, minus_log_width, minus_log_share = u.T
    no_share, full_share = minus_log_share > _SMALL, minus_log_share <= _FULL
    is_wide = (-minus_log_width - likelihood.log_scale > _WIDE) & ~no_share
    is_open[is_wide | is_narrow, 1:3] = False
    # Without a share no answer depends on the curve.
    is_open[no_share, 1:3] = True
    # A share of 1 is q0 = 1, or a lapse rate of 0.
    if share == "lapse_rate":
        no_share, full_share = full_share, no_share

    parameters = likelihood.natural(u)
    parameters[pull > _SMALL, 2] = 0.0
    parameters[is_wide, 1:3] = np.inf
    parameters[is_narrow, 1:3] = 0.0

    return MaximumLikelihoodFits(
        parameters=np.where(is_open, np.nan, parameters),
        log_likelihood=value + likelihood.penalty(u),
        objective=value,
        edges={
            "gamma=0": (pull > _SMALL) & ~(is_wide | is_open[:, 2]),
            "gamma=1": (pull <= _FULL) & ~(is_wide | is_narrow | is_open[:, 2]),
            f"{share}=0": no_share,
            f"{share}=1": full_share,
            "sigma_p=0": is_narrow,
            "sigma_p=inf": is_wide,
            "not unique": np.asarray(is_open.any(axis=1)),
        },
        arrived=arrived,
        points=likelihood.coordinates(u),
        subject=subject,
    )


def _fit_block(
    likelihood: PenalisedLikelihood, n_yes: IntArray
) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray, BoolArray]:
    """The maxima u of some rows, their values, whether the searches converged, and flatness.

    The last two say whether a width of 0 is as high, (rows,), and which natural parameters stay
    open, (rows, 4).
    """
    starts = likelihood.starts(n_yes)
    shape, rows = starts.shape, np.arange(len(starts))
    first = _search(
        likelihood,
        np.repeat(n_yes, shape[1], axis=0),
        starts.reshape(-1, 4),
        most_steps=_MOST_STEPS,
        least_gain=_LEAST_GAIN,
    )
    value = first.value.reshape(shape[:2])
    is_equal = value > value.max(axis=1, keepdims=True) - _EQUAL
    # Of equal ones the last: no pull, rather than one that the search has almost lost.
    best = shape[1] - 1 - is_equal[:, ::-1].argmax(axis=1)
    ended = _search(likelihood, n_yes, first.x.reshape(shape)[rows, best])

    u, is_narrow = _vanishing_width(likelihood, n_yes, ended)
    natural = likelihood.natural(first.x).reshape(shape)
    is_open = _disagreement(np.where(is_equal[:, :, None], natural, natural[rows, best][:, None]))
    return u, ended.value, ended.has_converged, is_narrow, is_open


def _vanishing_width(
    likelihood: PenalisedLikelihood, n_yes: IntArray, ended: Ascent
) -> tuple[FloatArray, BoolArray]:
    """The ends of searches, (rows, 4), and whether a width of 0 is as high there, (rows,).

    Without a width different stimuli are told apart for certain. Equal ones still differ where the
    pull vanishes with the width; such an end is moved there.
    """
    narrower = ended.x.copy()
    narrower[:, 2] += _NARROWER
    weaker = narrower.copy()
    weaker[:, 0] *= np.exp(-_NARROWER)
    weaker[:, 1] += _NARROWER

    subject, least = likelihood.curve.subject, ended.value - _EQUAL
    can_narrow = (ended.x[:, 3] < _SMALL) & (subject.s1 != subject.s2).any()
    is_vanishing = can_narrow & (likelihood.gradient(weaker, n_yes)[0] >= least)
    is_narrow = can_narrow & (likelihood.gradient(narrower, n_yes)[0] >= least)
    return np.where(is_vanishing[:, None], weaker, ended.x), is_narrow | is_vanishing


def _disagreement(natural: FloatArray) -> BoolArray:
    """Whether maxima disagree on natural parameters, (rows, maxima, 4) -> (rows, 4).

    Standard deviations are compared in units of sigma_p. The penalty determines mu1.
    """
    difference = np.ptp(natural, axis=1)
    difference[:, 0] = 0.0
    difference[:, 1:3] /= natural[:, :, 1].min(axis=1)[:, None]
    return difference > _TOLERANCE


def _search(
    likelihood: PenalisedLikelihood,
    n_yes: IntArray,
    starts: FloatArray,
    *,
    most_steps: int = 10 * _MOST_STEPS,
    least_gain: float = 0.0,
) -> Ascent:
    """Newton's method from starts, (points, 4), with counts, (points, pairs).

    Offset and pull are held where there is no pull.
    """
    density = Differenced(lambda u, row: likelihood.gradient(u, n_yes[row]), np.ones(starts.shape))
    return ascend(
        density.expand,
        starts,
        lower=[-np.inf, _FULL, -np.inf, _FULL],
        is_held=(starts[:, 1:2] == _EMPTY) & [True, True, False, False],
        largest_step=3.0,
        most_steps=most_steps,
        least_gain=least_gain,
    )


@dataclass(frozen=True, eq=False)
class IdentifiedCurve:
    """The likelihood of one subject's pairs; points x have the shape (points, 4).

    Parameters
    ----------
    subject : Subject
    centre : float, optional
        The intensity sbar, natural-log units; by default the mean first stimulus.
    """

    subject: Subject
    centre: float | None = None

    @cached_property
    def sbar(self) -> float:
        """Intensity from which the offset counts, natural-log units."""
        if self.centre is not None:
            return self.centre
        return float(np.average(self.subject.s1, weights=self.subject.n_trials))

    @property
    def share(self) -> str:
        """The name of the fourth parameter: q0 or lapse_rate."""
        return self.subject.task.lapses

    def for_subject(self, subject: Subject) -> IdentifiedCurve:
        """The same centre for other answers or other pairs."""
        return replace(self, subject=subject, centre=self.sbar)

    def distance(self, x: FloatArray) -> FloatArray:
        """Distance z of every pair, (points, 4) -> (points, pairs)."""
        numerator = (self.subject.s2 - self.subject.s1) - x[:, :1]
        numerator = numerator + MAX_PULL * expit(x[:, 1:2]) * (self.subject.s1 - self.sbar)
        with np.errstate(divide="ignore", over="ignore"):
            # In logs, because 0 over a width below the smallest float is 0.
            return np.sign(numerator) * np.exp(np.log(np.abs(numerator)) - x[:, 2:3])

    def log_answers(self, x: FloatArray) -> LogAnswers:
        """Log probability of both answers to every pair, (points, pairs) each."""
        if self.share == "q0":
            return bell_answers(self.distance(x), x[:, 3:])
        return guessing_answers(self.distance(x), x[:, 3:])

    def likelihood_gradient(self, x: FloatArray, n_yes: IntArray) -> ArrayPair:
        """Log likelihood, (points,), and its gradient, (points, 4), of counts (points, pairs).

        With the slope A_z of the log likelihood in z, that in log w is -A_z z.
        """
        z, n_trials = self.distance(x), self.subject.n_trials
        answers = self.log_answers(x)
        curve_slopes = bell_slopes if self.share == "q0" else guessing_slopes
        in_z, in_share = curve_slopes(z, x[:, 3:], answers)
        yes, no = n_yes.astype(np.float64), (n_trials - n_yes).astype(np.float64)
        with np.errstate(over="ignore", invalid="ignore"):  # far out, where nothing changes
            slope_z = times_counts(yes, in_z.yes) + times_counts(no, in_z.no)
            slope_share = times_counts(yes, in_share.yes) + times_counts(no, in_share.no)
            inverse_width, p = np.exp(-x[:, 2:3]), MAX_PULL * expit(x[:, 1:2])
            lever = p * expit(-x[:, 1:2]) * (self.subject.s1 - self.sbar)
            terms = slope_z * inverse_width, slope_z * inverse_width * lever, slope_z * z
            # A slope of 0 falls faster than any factor may grow.
            by_c, by_pull, by_width = (np.where(slope_z == 0.0, 0.0, term) for term in terms)

        columns = -by_c.sum(1), by_pull.sum(1), -by_width.sum(1), slope_share.sum(1)
        value = log_likelihoods(n_yes, n_trials, answers).sum(axis=1)
        return value, np.stack(columns, axis=-1)

    def natural(self, x: FloatArray) -> FloatArray:
        """mu1, sigma_p, sigma_l and q0 or lapse rate at points, (points, 4)."""
        p, width = MAX_PULL * expit(x[:, 1]), np.exp(x[:, 2])
        sigma_p = width * (1.0 - p) ** POWERS[self.share]
        with np.errstate(over="ignore"):  # 1/p beyond the largest float
            inverse_pull = (1.0 + np.exp(-x[:, 1])) / MAX_PULL
        with np.errstate(invalid="ignore"):
            reach = np.where(x[:, 0] == 0.0, 0.0, x[:, 0] * inverse_pull)
        columns = self.sbar + reach, sigma_p, sigma_p * np.sqrt(p) / (1.0 - p), expit(x[:, 3])
        return np.stack(columns, axis=-1)
