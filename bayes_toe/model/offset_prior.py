"""The prior of a constant error c: by default that of c = p (mu1 - sbar), which the prior of mu1 and gamma implies.

So a model with a constant error and the predictive update differ in the pull alone, not in how large an error they expect. With a the logit
of p/p_max and f_a its prior density,

    P(c' < c) = int F_mu1(sbar + c/p(a)) f_a(a) da,    f(c) = int f_mu1(sbar + c/p(a)) / p(a) f_a(a) da.

f has a logarithmic singularity at c = 0 where gamma is uniform (p -> 0), a stronger one where gamma_a < 1. Models therefore have the
coordinate x ~ Normal(0, 1) with c = G(x), G = F^-1(Phi(x)), G' = phi(x)/f(c) and G'' = -x G' - G'^2 f'(c)/f(c).

Both integrals are trapezoidal sums: integrands are analytic in a, and fall off exponentially at both ends. G is a piecewise quintic with
the exact G, G' and G'' at its knots, between which knots are put until it hardly changes; within 1e-9 spreads of mu1 about c = 0 it is
straight, beyond |x| = 35 as well. A model's prior is by construction the image of Normal(0, 1) under this G, whose density is that of the
exact marginal to a relative 1e-8 wherever |c| is at least 1e-7 spreads of mu1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit, log_expit, logit, logsumexp, ndtri, ndtri_exp

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.model.closed_form import MAX_PULL, pull
from bayes_toe.model.coordinates import inverse_pull, log_noise_ratio
from bayes_toe.model.distributions import LOG_2PI, Distribution, Normal
from bayes_toe.model.prior import Prior, log_density_of_noise_ratio

#: Largest step of the trapezoidal sums: integrands do not grow within pi/4 of the real axis, so the error is exp(-pi^2/2 / STEP).
_STEP = 0.18
#: Logits of the pull beyond which nothing is looked for, and how far below its maximum the log density at a node may be.
_REACH, _DEPTH = 700.0, 40.0
#: Of G's knots: the last score, the innermost offset in spreads of mu1, first step of asinh(c).
_FARTHEST, _INNERMOST, _PACE = 35.0, 1e-9, 0.4
#: Relative change of G' by a new knot half way between two at which these get none; a quintic is then about 2^-5 of that off.
_TOLERANCE = 3e-8
_ROUNDS = 12
_BLOCK = 1 << 20


def offset_prior(prior: Prior, sbar: float) -> OffsetPrior | NormalOffset:
    """The prior of the constant error at the mean first stimulus `sbar`, natural-log intensity.

    Examples
    --------
    >>> implied = offset_prior(Prior(), 0.0)
    >>> np.exp(implied.log_density([0.01, 0.1, 0.2, 1.0])).round(2).tolist()
    [0.35, 0.25, 0.22, 0.14]
    >>> round(implied.spread, 2), round(float(implied.quantile(0.95)), 2)
    (2.66, 4.48)
    >>> offset_prior(Prior(offset_sd=2.0), 0.0).offset(np.array([1.5]))
    (array([3.]), array([2.]))
    """
    if prior.offset_sd is not None:
        return NormalOffset(prior.offset_sd)
    return _implied(prior.distribution("mu1"), prior.distribution("gamma"), float(sbar))


@dataclass(frozen=True)
class NormalOffset:
    """c ~ Normal(0, sd), c = sd x; `sd` in natural-log intensity."""

    sd: float

    @property
    def spread(self) -> float:
        """Standard deviation."""
        return self.sd

    def offset(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The offset and its derivative in x, each of the shape of x."""
        return self.sd * x, np.full(np.shape(x), self.sd)

    def score(self, c: npt.ArrayLike) -> FloatArray:
        """X from c."""
        return np.asarray(np.asarray(c, np.float64) / self.sd)

    def log_density(self, c: npt.ArrayLike) -> FloatArray:
        """Log density with respect to c."""
        return Normal(0.0, self.sd).log_density(c)

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return Normal(0.0, self.sd).quantile(p)

    def describe(self) -> str:
        """Family and numbers."""
        return Normal(0.0, self.sd).describe()


class _Nodes(NamedTuple):
    """Log weights, which sum to 1, and 1/p with its log, each of shape (nodes,)."""

    log_weight: FloatArray
    inverse: FloatArray
    log_inverse: FloatArray


class _Knots(NamedTuple):
    """Offsets c = G(x), their x, G' and G'', each of shape (knots,)."""

    c: FloatArray
    x: FloatArray
    first: FloatArray
    second: FloatArray

    def where(self, some: BoolArray) -> _Knots:
        """Some of them."""
        return _Knots(*(part[some] for part in self))

    def joined(self, other: _Knots) -> _Knots:
        """With others, in order."""
        order = np.argsort(np.concatenate([self.c, other.c]))
        return _Knots(*(np.concatenate(pair)[order] for pair in zip(self, other, strict=True)))


@dataclass(frozen=True)
class OffsetPrior:
    """The prior of c = p (mu1 - sbar) that the distributions of mu1 and gamma imply, natural-log intensity.

    Examples
    --------
    >>> implied = OffsetPrior(Normal(0.0, 10.0), Prior().distribution("gamma"), 0.2)
    >>> c = implied.offset(np.array([-1.0, 0.3]))[0]
    >>> implied.score(c).round(12).tolist()
    [-1.0, 0.3]
    """

    mu1: Distribution
    gamma: Distribution
    sbar: float

    def __reduce__(self) -> tuple[Callable[..., OffsetPrior], tuple[object, ...]]:
        """Its declaration alone: another process makes its own table, once."""
        return _implied, (self.mu1, self.gamma, self.sbar)

    def offset(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The offset c = G(x) and its derivative in x, each of the shape of x."""
        points = np.asarray(x, np.float64)
        knots, _, terms = self._table
        at = np.searchsorted(knots[1:-1], points.ravel(), side="right")
        value, slope = _horner(terms[:, at], points.ravel() - knots[at])
        return value.reshape(points.shape), slope.reshape(points.shape)

    def score(self, c: npt.ArrayLike) -> FloatArray:
        """X = G^-1(c), to rounding."""
        wanted = np.asarray(c, np.float64)
        knots, values, terms = self._table
        flat = wanted.ravel()
        at = np.searchsorted(values[1:-1], flat, side="right")
        return np.asarray(knots[at] + _root(terms[:, at], flat, np.diff(knots)[at])).reshape(wanted.shape)

    def log_density(self, c: npt.ArrayLike) -> FloatArray:
        """Log density with respect to c, by the integral itself; it levels off at |c| about 1e-17 spreads, where it may have no limit."""
        wanted = np.asarray(c, np.float64)
        nodes = self._nodes
        rows = np.array_split(wanted.ravel(), 1 + wanted.size * len(nodes.log_weight) // _BLOCK)
        found = [logsumexp(nodes.log_weight + nodes.log_inverse + self.mu1.log_density(self._mu1(row)), axis=-1) for row in rows]
        return np.concatenate(found).reshape(wanted.shape)

    def quantile(self, p: npt.ArrayLike) -> FloatArray:
        """Inverse of the distribution function, 0 < p < 1."""
        return self.offset(np.asarray(ndtri(p)))[0]

    @cached_property
    def spread(self) -> float:
        """Standard deviation."""
        x = np.linspace(-12.0, 12.0, 4801)
        c, weight = self.offset(x)[0], np.exp(-0.5 * x * x)
        mean = np.average(c, weights=weight)
        return float(np.sqrt(np.average(np.square(c - mean), weights=weight)))

    def describe(self) -> str:
        """What it is the distribution of."""
        return f"that of pull x (mu1 - mean first stimulus), mu1 ~ {self.mu1.describe()}, gamma ~ {self.gamma.describe()}"

    # --- the integrals --------------------------------------------------------------------------------

    @cached_property
    def _nodes(self) -> _Nodes:
        """Nodes in the logit of the pull, wherever the prior has some density."""
        quarter, three = logit(pull(self.gamma.quantile(np.array([0.25, 0.75]))) / MAX_PULL)
        spread, away = float(self.mu1.spread), abs(float(self.mu1.quantile(0.5)) - self.sbar)
        a = np.arange(-_REACH, _REACH, min(_STEP, 0.5 * (three - quarter), 0.7 * spread / (away + spread)))
        p, (log_gamma, _) = MAX_PULL * expit(a), log_noise_ratio(a)
        slope = log_gamma + log_expit(-a) + np.log1p(p) - np.log1p(-p)  # log of d gamma/da
        log_weight = log_density_of_noise_ratio(self.gamma, a) + slope
        some = log_weight > log_weight.max() - np.where((a < 0.0) & (p > 1e-18), 2.0 * _DEPTH, _DEPTH)  # c near 0 asks for small pulls
        inverse = inverse_pull(a[some])
        return _Nodes(log_weight[some] - logsumexp(log_weight[some]), inverse, np.log(inverse))

    def _mu1(self, c: FloatArray) -> FloatArray:
        """mu1 = sbar + c/p at every node, shape (points, nodes)."""
        return np.asarray(self.sbar + c[:, None] * self._nodes.inverse)

    def _exact(self, c: FloatArray) -> _Knots:
        """Score, G' and G'' at offsets; not finite where a probability is below the smallest float."""
        nodes, mu1 = self._nodes, self._mu1(c)
        weight = np.exp(nodes.log_weight)
        tail = self.mu1.cdf(mu1) @ weight
        upper = tail > 0.5
        tail[upper] = self.mu1.sf(mu1[upper]) @ weight
        of_nodes = np.exp(self.mu1.log_density(mu1)) * (weight * nodes.inverse)
        density, slope = of_nodes.sum(axis=-1), (of_nodes * self.mu1.slope(mu1)) @ nodes.inverse
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            x = np.where(upper, -1.0, 1.0) * ndtri_exp(np.log(tail))
            first = np.exp(-0.5 * (x * x + LOG_2PI)) / density
            return _Knots(c, x, first, -x * first - first * first * slope / density)

    # --- the table ------------------------------------------------------------------------------------

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ends of the pieces in x and in c, and the coefficients of each, (6, pieces), in powers of x from its left end."""
        knots = self._knots()
        x, c, (first, last) = knots.x, knots.c, knots.first[[0, -1]]
        before = [c[0] - first, first, 0.0, 0.0, 0.0, 0.0]  # straight beyond both ends
        after = [c[-1], last, 0.0, 0.0, 0.0, 0.0]
        ends = np.concatenate([[x[0] - 1.0], x, [x[-1] + 1.0]])
        values = np.concatenate([[c[0] - first], c, [c[-1] + last]])
        return ends, values, np.column_stack([before, _quintics(knots), after])

    def _knots(self) -> _Knots:
        """Enough of them: evenly in asinh(c) and in c at first, then half way between (in asinh c) where G is not yet known."""
        spread, away = float(self.mu1.spread), abs(float(self.mu1.quantile(0.5)) - self.sbar)
        far, unit = MAX_PULL * away + 50.0 * spread, _INNERMOST * spread
        half = np.arange(0.5 * _PACE, np.arcsinh(far / unit), _PACE)
        found = self._usable(np.sort(np.concatenate([unit * np.sinh([-half, half]).ravel(), np.linspace(-far, far, 100)])))
        todo = found.c[:-1]
        for _ in range(_ROUNDS):
            knots = _straight_at_0(found)
            at = np.flatnonzero(np.isin(knots.c[:-1], todo) & (knots.c[1:] * knots.c[:-1] > 0.0))
            if not len(at):
                break
            between = self._usable(unit * np.sinh(0.5 * (np.arcsinh(knots.c[at] / unit) + np.arcsinh(knots.c[at + 1] / unit))))
            at = np.searchsorted(knots.x, between.x) - 1
            guess = _horner(_quintics(knots)[:, at], between.x - knots.x[at])[1]
            allowed = _TOLERANCE + 4e-15 * np.maximum(1.0, np.abs(between.x)) / np.diff(knots.x)[at]
            wrong = np.abs(guess - between.first) > allowed * between.first
            todo = np.concatenate([knots.c[at[wrong]], between.c[wrong]])
            found = found.joined(between)
        return _straight_at_0(found)

    def _usable(self, c: FloatArray) -> _Knots:
        """Those with a score that a float can tell."""
        found = self._exact(c)
        return found.where((np.abs(found.x) <= _FARTHEST) & np.isfinite(found.second) & (found.first > 0.0))


def _straight_at_0(knots: _Knots) -> _Knots:
    """The same with the innermost piece, which holds c = 0, straight; where c cannot be negative, or not positive, there is none."""
    i = int(np.searchsorted(knots.c, 0.0))
    if not 0 < i < len(knots.c):
        return knots
    first, second = knots.first.copy(), knots.second.copy()
    first[i - 1 : i + 1] = (knots.c[i] - knots.c[i - 1]) / (knots.x[i] - knots.x[i - 1])
    second[i - 1 : i + 1] = 0.0
    return knots._replace(first=first, second=second)


def _quintics(knots: _Knots) -> FloatArray:
    """Coefficients, shape (6, knots - 1), of the quintics through values, slopes and curvatures, in powers of x from the left knot."""
    h = np.diff(knots.x)
    rise = np.diff(knots.c) - knots.first[:-1] * h - 0.5 * knots.second[:-1] * h * h
    turn = (np.diff(knots.first) - knots.second[:-1] * h) * h
    bend = np.diff(knots.second) * h * h
    cubic, quartic = 10.0 * rise - 4.0 * turn + 0.5 * bend, -15.0 * rise + 7.0 * turn - bend
    quintic = 6.0 * rise - 3.0 * turn + 0.5 * bend
    return np.stack([knots.c[:-1], knots.first[:-1], 0.5 * knots.second[:-1], cubic / h**3, quartic / h**4, quintic / h**5])


def _horner(terms: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Value and derivative of polynomials, coefficients (6, points), at t, (points,)."""
    value, slope = terms[5], np.zeros_like(t)
    for term in terms[4::-1]:
        slope = value + t * slope
        value = term + t * value
    return np.asarray(value), slope


def _root(terms: FloatArray, wanted: FloatArray, h: FloatArray) -> FloatArray:
    """T at which rising quintics on 0..h have the values wanted; Newton, from the chord."""
    top = _horner(terms, h)[0]
    chord = h * (wanted - terms[0]) / (top - terms[0])
    t, low, high = chord, np.minimum(chord, 0.0), np.maximum(chord, h)
    for _ in range(_ROUNDS):
        value, slope = _horner(terms, t)
        t = np.clip(t + (wanted - value) / slope, low, high)
    return np.asarray(t)


@lru_cache(maxsize=256)
def _implied(mu1: Distribution, gamma: Distribution, sbar: float) -> OffsetPrior:
    return OffsetPrior(mu1, gamma, sbar)
