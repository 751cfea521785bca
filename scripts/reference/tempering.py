"""Evidences of the four models of the observer by tempering: particles that walk from the prior.

The method shares nothing with the package's inference: every parameter is a function of a standard
normal score, the formulas stand as on paper, there is no search for a maximum and no fitted
mixture. The likelihood is turned on in steps after which two thirds of the particles count. At
every step the particles are weighted, resampled and moved by differences of two others (ter
Braak's differential evolution) and along one score (Del Moral, Doucet and Jasra 2006). Importance
sampling about the last particles gives the evidence.

    z = ((s2 - s1) - c + p (s1 - sbar)) / (sigma_d exp(b m)),   m = (s1 + s2)/2 - sbar
    which is stronger   P(second) = lambda/2 + (1 - lambda) Phi(z)
    same or different   P(equal) = lambda q0_m + (1 - lambda) (Phi(k_m - z) - Phi(-k_m - z))
                        k_m = k exp(g m),   q0_m = 2 Phi(k_m) - 1,   q0 = 2 Phi(k) - 1

The numbers of the prior are stated here; they are those that the package has by default.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import erf, erfinv, log_ndtr, logsumexp, ndtr, ndtri, stdtrit, xlogy
from scipy.stats import multivariate_t

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject

#: Median of sigma_d in D, and standard deviation of its logarithm.
NOISE_MEDIAN, NOISE_SD = 1.0, 0.7
#: q0 has the distribution Beta(4, 1), whose distribution function is q0^4.
Q0_A = 4.0
#: lambda has the distribution Beta(1, 9): P(lambda > x) = (1 - x)^9.
LAPSE_RATE_B = 9.0
#: Scale of Student's t with 3 degrees of freedom: of b and g over R, of c in D.
SLOPE_SCALE, CONSTANT_ERROR_SCALE = 0.15, 0.5
#: Standard deviation of p on (-1, 1); D over sd(s1) where that is smaller.
CONTRACTION_SD = 0.25
#: The four models: which of c and p they have.
MODELS: Mapping[str, tuple[str, ...]] = {
    "none": (),
    "constant error": ("c",),
    "contraction": ("p",),
    "both": ("c", "p"),
}
#: Changes whenever a change of the method can change a number; stored references carry it.
METHOD = "tempering of the observer 1"
_COUNTING = 0.66  # share of the particles that count after a step of the power
_MOVES = 8  # moves of each particle between two powers
#: Kernels of the refinement, and their width over that of the whole cloud.
_KERNELS, _NARROW = 200, 0.4
_BATCH = 20_000  # points whose weights are computed together
LogLikelihood = Callable[[FloatArray], FloatArray]
Parameters = Mapping[str, FloatArray | float]


@dataclass(frozen=True, eq=False)
class Observer:
    """One of the four models for the counts of one subject, at normal scores of its parameters."""

    subject: Subject
    model: str

    @cached_property
    def trials(self) -> tuple[FloatArray, FloatArray]:
        """First and second stimulus of every trial, (trials,) each."""
        n_trials = self.subject.n_trials
        return np.repeat(self.subject.s1, n_trials), np.repeat(self.subject.s2, n_trials)

    @cached_property
    def sbar(self) -> float:
        """Mean first stimulus."""
        return self.trials[0].mean()

    @cached_property
    def step(self) -> float:
        """D: root mean square of s2 - s1 over the trials with two different stimuli."""
        difference = np.subtract(*self.trials)
        return np.sqrt(np.mean(np.square(difference[difference != 0.0])))

    @cached_property
    def spread(self) -> float:
        """R: standard deviation of all stimuli."""
        return np.concatenate(self.trials).std()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the free parameters, one score each."""
        if self.subject.task.yes == "equal":
            return ("sigma_d", "q0", "lambda", "b", "g", *MODELS[self.model])
        return ("sigma_d", "lambda", "b", *MODELS[self.model])

    def natural(self, scores: FloatArray) -> dict[str, FloatArray]:
        """The parameters at scores, (particles, parameters) -> (particles, 1) each.

        In place of q0 there is k.
        """
        values = {}
        for name, x in zip(self.parameters, scores.T[:, :, None], strict=True):
            if name == "sigma_d":
                values[name] = NOISE_MEDIAN * self.step * np.exp(NOISE_SD * x)
            elif name == "q0":
                log_q0 = log_ndtr(x) / Q0_A
                from_below = np.sqrt(2.0) * erfinv(np.exp(log_q0))
                from_above = -ndtri(-0.5 * np.expm1(log_q0))
                values["k"] = np.where(x < 0.0, from_below, from_above)
            elif name == "lambda":
                values[name] = -np.expm1(log_ndtr(-x) / LAPSE_RATE_B)
            elif name == "c":
                values[name] = CONSTANT_ERROR_SCALE * self.step * _student(x)
            elif name == "p":
                values[name] = self._contraction(x)
            else:
                values[name] = SLOPE_SCALE / self.spread * _student(x)
        return values

    def _contraction(self, x: FloatArray) -> FloatArray:
        """The normal quantile of p on (-1, 1)."""
        sd, first_spread = CONTRACTION_SD, self.trials[0].std()
        if first_spread > 0.0:
            sd = min(sd, self.step / first_spread)
        outside = ndtr(-1.0 / sd)
        lower_half = outside + ndtr(-np.abs(x)) * (1.0 - 2.0 * outside)
        return -np.sign(x) * sd * ndtri(lower_half)

    def __call__(self, scores: FloatArray) -> FloatArray:
        """Log likelihood without binomial coefficients, (particles, parameters) -> (particles,)."""
        yes, no = answer_probabilities(self.subject, self.sbar, self.natural(scores))
        n_yes = self.subject.n_yes
        terms = xlogy(n_yes, yes) + xlogy(self.subject.n_trials - n_yes, no)
        return terms.sum(axis=1)


def _student(x: FloatArray) -> FloatArray:
    """Quantile of Student's t with 3 degrees of freedom at normal scores."""
    return -np.sign(x) * stdtrit(3.0, ndtr(-np.abs(x)))


def shifted_difference(
    subject: Subject, sbar: float, values: Parameters
) -> tuple[FloatArray, FloatArray]:
    """The numerator of z, (..., pairs), and m, (pairs,)."""
    shift = values.get("p", 0.0) * (subject.s1 - sbar) - values.get("c", 0.0)
    return subject.s2 - subject.s1 + shift, 0.5 * (subject.s1 + subject.s2) - sbar


def answer_probabilities(
    subject: Subject, sbar: float, values: Parameters
) -> tuple[FloatArray, FloatArray]:
    """Probability of the answer that the task counts and of the other one, (..., pairs) each."""
    numerator, middle = shifted_difference(subject, sbar, values)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        # In logs, because far out the noise, the distance and the criterion leave the floats.
        log_noise = np.log(values["sigma_d"]) + values["b"] * middle
        log_distance = np.log(np.abs(numerator)) - log_noise
        distance = np.exp(log_distance)
        lapse = values["lambda"]
        attend = 1.0 - lapse
        if subject.task.yes == "second":
            z = np.sign(numerator) * distance
            return 0.5 * lapse + attend * ndtr(z), 0.5 * lapse + attend * ndtr(-z)
        log_k = np.log(values["k"]) + values["g"] * middle
        k = np.exp(log_k)
        to_edge = _difference(log_k, log_distance)
        window = ndtr(to_edge) - ndtr(-k - distance)
        # Both terms cancel in a window that is narrow; the density is level in it.
        narrow_window = 2.0 * k * np.exp(-0.5 * distance**2) / np.sqrt(2.0 * np.pi)
        inside = np.where(k < 1e-4, narrow_window, window)
        outside = ndtr(-to_edge) + ndtr(-k - distance)
        equal = lapse * erf(k / np.sqrt(2.0)) + attend * inside
        different = lapse * 2.0 * ndtr(-k) + attend * outside
    return equal, different


def _difference(log_a: FloatArray, log_b: FloatArray) -> FloatArray:
    """a - b from their logs, also where both leave the floats."""
    ratio = log_a - log_b
    larger = np.exp(np.maximum(log_a, log_b))
    return -np.sign(ratio) * larger * np.expm1(-np.abs(ratio))


def _near_prior(log_likelihood: LogLikelihood, scores: FloatArray) -> FloatArray:
    """The log likelihood, and -inf beyond 20 standard deviations: 1e-88 of the prior is there."""
    is_near = (np.abs(scores) < 20.0).all(axis=1)
    value = np.full(len(scores), -np.inf)
    value[is_near] = log_likelihood(scores[is_near])
    return value


def tempered(
    log_likelihood: LogLikelihood, k: int, rng: np.random.Generator, particles: int
) -> FloatArray:
    """One run: particles of the posterior of k standard normal scores, (particles, k)."""
    x = rng.standard_normal((particles, k))
    value, power = log_likelihood(x), 0.0
    while power < 1.0:
        step = _step(value, 1.0 - power)
        weights = step * value
        power += step
        shares = np.exp(weights - logsumexp(weights))
        # Systematic resampling.
        places = (rng.uniform() + np.arange(particles)) / particles
        chosen = np.searchsorted(np.cumsum(shares)[:-1], places)
        chosen = rng.permutation(chosen)
        x, value = _moved(log_likelihood, x[chosen], value[chosen], power, rng)
    return x


def weighted_points(
    log_likelihood: LogLikelihood, k: int, rng: np.random.Generator, particles: int, size: int
) -> tuple[FloatArray, FloatArray]:
    """Points about particles of the posterior, (size, k), and the logs of their weights, (size,).

    Half of the points have a Student-t kernel (4 degrees of freedom) about one of some particles,
    a quarter have one about the mean of all, a quarter are from the prior.

    Examples
    --------
    The mean of this hill is (101)^(-1/2) exp(-50/101) in each direction:

    >>> hill = lambda x: -50.0 * ((x - 1.0) ** 2).sum(axis=1)
    >>> _, log_weights = weighted_points(hill, 2, np.random.default_rng(1), 400, 4000)
    >>> bool(abs(log_mean(log_weights)[0] + np.log(101) + 100 / 101) < 0.1)
    True
    """
    log_likelihood = partial(_near_prior, log_likelihood)
    x = tempered(log_likelihood, k, rng, particles)
    centres = x[rng.choice(len(x), _KERNELS, replace=False)]
    factor = np.linalg.cholesky(np.cov(x.T).reshape(k, k) + 1e-9 * np.eye(k))
    whole, narrow = 1.5 * factor, _NARROW * factor

    n_near, n_whole, n_prior = rng.multinomial(size, [0.5, 0.25, 0.25])
    near = centres[rng.integers(_KERNELS, size=n_near)] + _draw_t(rng, n_near, narrow)
    around = x.mean(axis=0) + _draw_t(rng, n_whole, whole)
    points = np.concatenate([near, around, rng.standard_normal((n_prior, k))])

    log_weights = []
    for part in np.array_split(points, 1 + size // _BATCH):
        log_prior = -0.5 * (np.square(part).sum(axis=1) + k * np.log(2.0 * np.pi))
        log_near = logsumexp(_log_t(part, centres, narrow), axis=1) + np.log(0.5 / _KERNELS)
        log_around = _log_t(part, x.mean(axis=0)[None], whole)[:, 0] + np.log(0.25)
        parts = [log_near, log_around, np.log(0.25) + log_prior]
        log_weights.append(log_likelihood(part) + log_prior - np.logaddexp.reduce(parts))
    return points, np.concatenate(log_weights)


def log_mean(log_weights: FloatArray) -> tuple[float, float]:
    """Log of the mean weight, and its standard error."""
    size = len(log_weights)
    log_total = logsumexp(log_weights)
    error = np.sqrt(np.exp(logsumexp(2.0 * log_weights) - 2.0 * log_total) - 1.0 / size)
    return log_total - np.log(size), error


def estimate_by_tempering(
    log_likelihood: LogLikelihood, k: int, _size: int, seed: int
) -> tuple[FloatArray, FloatArray, float]:
    """Points, the logs of their weights, and the log evidence, by a run of 4,000 points."""
    rng = np.random.default_rng(seed)
    points, log_weights = weighted_points(log_likelihood, k, rng, 1000, 4000)
    return points, log_weights, log_mean(log_weights)[0]


def _draw_t(rng: np.random.Generator, n: int, factor: np.ndarray) -> FloatArray:
    """Draws of a Student-t kernel about 0, 4 degrees of freedom, (n, k)."""
    stretch = np.sqrt(rng.chisquare(4, size=(n, 1)) / 4.0)
    return rng.standard_normal((n, len(factor))) / stretch @ factor.T


def _log_t(points: FloatArray, centres: FloatArray, factor: np.ndarray) -> FloatArray:
    """Log density of Student-t kernels, 4 degrees of freedom, (points, centres)."""
    k = len(factor)
    peak = multivariate_t(np.zeros(k), factor @ factor.T, df=4).logpdf(np.zeros(k))
    a, b = (np.linalg.solve(factor, part.T).T for part in (points, centres))
    far = cdist(a, b, "sqeuclidean")
    return peak - 0.5 * (4 + k) * np.log1p(far / 4.0)


def _step(value: FloatArray, largest: float) -> float:
    """Growth of the power after which the wanted share of the particles counts."""

    def share(step: float) -> float:
        log_effective = 2.0 * logsumexp(step * value) - logsumexp(2.0 * step * value)
        return np.exp(log_effective) / len(value)

    if share(largest) >= _COUNTING:
        return largest
    low, high = 0.0, largest
    alive = np.isfinite(value).mean()
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if share(middle) >= _COUNTING * alive else (low, middle)
    return low if low > 0.0 else high


def _moved(
    log_likelihood: LogLikelihood,
    x: FloatArray,
    value: FloatArray,
    power: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Particles after some Metropolis moves.

    Each half moves by differences within the other, so that detailed balance holds.
    """
    half, k = len(x) // 2, x.shape[1]
    for step in range(_MOVES):
        for mine, others in ((slice(None, half), x[half:]), (slice(half, None), x[:half])):
            here = x[mine]
            pairs = others[rng.integers(len(others), size=(2, len(here)))]
            size = 2.38 / np.sqrt(2.0 * k) * np.exp(rng.normal(-0.3, 0.7, size=(len(here), 1)))
            jump = size * (pairs[0] - pairs[1]) + 1e-6 * rng.standard_normal(here.shape)
            if step % 2:  # in one coordinate
                jump *= np.sqrt(k) * (np.arange(k) == rng.integers(k, size=(len(here), 1)))
            trial = here + jump
            new_value = log_likelihood(trial)
            prior_rise = 0.5 * (np.square(here) - np.square(trial)).sum(axis=1)
            with np.errstate(invalid="ignore"):
                rise = power * (new_value - value[mine]) + prior_rise
            taken = np.log(rng.uniform(size=len(here))) < rise
            x[mine] = np.where(taken[:, None], trial, here)
            value[mine] = np.where(taken, new_value, value[mine])
    return x, value


def describe_prior() -> str:
    """The numbers of the prior; a stored reference carries them."""
    return (
        f"sigma_d ~ LogNormal({NOISE_MEDIAN:g} D, {NOISE_SD:g}), q0 ~ Beta({Q0_A:g}, 1), "
        f"lambda ~ Beta(1, {LAPSE_RATE_B:g}), b, g ~ Student(3, {SLOPE_SCALE:g}/R), "
        f"c ~ Student(3, {CONSTANT_ERROR_SCALE:g} D), p ~ Normal(0, {CONTRACTION_SD:g}) on (-1, 1)"
    )


def tempered_points(
    log_likelihood: LogLikelihood, k: int, *, runs: int = 6, particles: int = 1000, size: int
) -> tuple[FloatArray, FloatArray]:
    """Points of some runs, (runs, size, k), and the logs of their weights, (runs, size)."""
    generators = [np.random.default_rng([run, 2611]) for run in range(runs)]
    samples = [weighted_points(log_likelihood, k, rng, particles, size) for rng in generators]
    points, log_weights = zip(*samples, strict=True)
    return np.stack(points), np.stack(log_weights)


def tempered_evidence(log_weights: FloatArray) -> tuple[float, float]:
    """Log evidence and its standard error, the larger one of weights and of runs."""
    values, errors = np.array([log_mean(of_run) for of_run in log_weights]).T
    relative = np.exp(values - values.max())
    between = relative.std(ddof=1) / relative.mean() / np.sqrt(len(values))
    within = np.sqrt(np.square(relative * errors).sum()) / relative.sum()
    return float(values.max() + np.log(relative.mean())), float(max(between, within))
