"""Evidence of any composition by tempering: particles from the prior that walk while the likelihood is turned on.

Shares nothing with the package's inference: natural parameters with normal scores as coordinates, answers and counts written as on paper,
no modes, no fitted proposal. Between two powers of the likelihood, chosen so that two thirds of the particles count, they are weighted,
resampled and moved by differences of two others (ter Braak's differential evolution) and in one direction; the mean weights multiply
to the evidence (Del Moral, Doucet and Jasra 2006). Importance sampling about these particles then makes it precise.

The prior is stated here, in numbers: H1's is the paper's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, gammaln, log_ndtr, logit, logsumexp, ndtr, ndtri

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.model.parts import composition
from bayes_toe.model.prior import Prior

#: The prior of the references; :data:`_NATURAL` says the same.
PRIOR = Prior(offset_sd=0.3, noise_slope_sd=1.0, peak_slope_sd=1.0, lapse_rate_b=1.0)
#: Changes whenever a change of the method can change a number; stored references carry it.
METHOD = "tempering 1"
_KEPT = 0.66  # share of the particles that count after a change of the power
_STEPS = 8  # moves of each particle between two powers
_KERNELS, _NARROW = (
    200,
    0.4,
)  # kernels of the refinement, and their width over that of the whole cloud
LogLikelihood = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Scored:
    """Log likelihood of a composition at normal scores of its natural parameters under :data:`PRIOR`."""

    subject: Subject
    name: str

    @property
    def levels(self) -> dict[str, str]:
        """Level of each part."""
        return dict(composition(self.name).levels)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Natural parameters, one score each."""
        levels = self.levels
        of_order = {
            "none": (),
            "constant error": ("c",),
            "update": ("mu1", "gamma"),
            "free weighting": ("c", "gain"),
        }
        wanted = {
            "b": levels["noise"] == "sloped",
            "q0": levels["lapses"] != "no lapses",
            "rate": levels["lapses"] == "both ways",
            "g": levels["peak"] == "sloped peak",
            "nu": levels["curve"] == "exponent",
            "icc": levels["spread"] == "beta-binomial",
        }
        return (
            "spread",
            *of_order[levels["order"]],
            *(name for name, is_free in wanted.items() if is_free),
        )

    def __call__(self, scores: FloatArray) -> FloatArray:
        """(particles, parameters) -> (particles,)."""
        theta = {
            name: _NATURAL[name](score)[:, None]
            for name, score in zip(self.parameters, scores.T, strict=True)
        }
        with np.errstate(
            all="ignore"
        ):  # where a probability is 0 an answer that was given makes the likelihood 0
            value = np.asarray(self._counts(theta, self._equal(theta)).sum(axis=1))
        return np.where(np.isnan(value), -np.inf, value)

    def _equal(self, theta: Mapping[str, FloatArray]) -> FloatArray:
        """P(equal)."""
        s, order, curve = self.subject, self.levels["order"], self.levels["curve"]
        sbar = np.average(s.s1, weights=s.n_trials)
        shift, width = s.s2 - s.s1, theta["spread"]
        if order == "update":
            big = (1.0 + np.sqrt(1.0 + 4.0 * theta["gamma"])) / 2.0  # sigma_1^2 / sigma_p^2
            shift, width = (
                s.s2 - s.s1 / big - (1.0 - 1.0 / big) * theta["mu1"],
                theta["spread"] * big**1.5,
            )
        elif order != "none":
            shift = shift - theta["c"] + (1.0 - theta.get("gain", 1.0)) * (s.s1 - sbar)
        middle = 0.5 * (s.s1 + s.s2) - sbar
        z = shift / (width * np.exp(theta.get("b", 0.0) * middle))
        q0, rate = theta.get("q0", np.ones((1, 1))), theta.get("rate", 0.0)
        if "g" in theta:
            q0 = expit(logit(q0) + theta["g"] * middle)
        if curve == "differencing":
            k = ndtri(0.5 + 0.5 * q0)
            attended = ndtr(k - z) - ndtr(-k - z)
        else:
            attended = q0 * 2.0 ** -(np.abs(z) ** theta.get("nu", 2.0))
        return np.asarray(rate * q0 + (1.0 - rate) * attended)

    def _counts(self, theta: Mapping[str, FloatArray], p: FloatArray) -> FloatArray:
        """Log probability of the counts, without binomial coefficients."""
        k, n = self.subject.n_yes, self.subject.n_trials
        binomial = np.where(k > 0, k * np.log(p), 0.0) + np.where(
            n > k, (n - k) * np.log1p(-p), 0.0
        )
        if "icc" not in theta:
            return binomial
        total = 1.0 / theta["icc"] - 1.0
        ends = ((total * p, k), (total * (1.0 - p), n - k), (total, n))
        rising = [np.where(m > 0, gammaln(of + m) - gammaln(of), 0.0) for of, m in ends]
        # Beyond it the binomial is off by n^2/1e8, and gammaln would lose its digits.
        return np.asarray(np.where(total > 1e8, binomial, rising[0] + rising[1] - rising[2]))


#: From a normal score to a natural parameter of the prior.
_NATURAL: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "mu1": lambda x: 10.0 * x,
    "spread": lambda x: np.asarray(-ndtri(0.5 * ndtr(-x))),  # HalfNormal(1): sigma_p, or the width
    "gamma": ndtr,
    "gain": lambda x: np.asarray(2.0 * ndtr(x)),
    "q0": ndtr,
    "rate": ndtr,
    "b": lambda x: x,
    "g": lambda x: x,
    "c": lambda x: 0.3 * x,
    "nu": lambda x: np.asarray(2.0 * np.exp(0.5 * x)),
    "icc": lambda x: np.asarray(-np.expm1(log_ndtr(-x) / 9.0)),  # Beta(1, 9)
}


def tempered(
    log_likelihood: LogLikelihood, k: int, rng: np.random.Generator, particles: int
) -> tuple[FloatArray, float]:
    """Particles of the posterior, shape (particles, k), and the log of the mean likelihood under k standard normal scores; one run.

    Examples
    --------
    >>> hill = lambda x: -50.0 * ((x - 1.0) ** 2).sum(axis=1)  # the mean is (101)^(-1/2) exp(-50/101) in each direction
    >>> found = tempered(hill, 2, np.random.default_rng(1), 4000)[1]
    >>> bool(abs(found + np.log(101) + 100 / 101) < 0.1)
    True
    """
    x = rng.standard_normal((particles, k))
    value, power, total = log_likelihood(x), 0.0, 0.0
    while power < 1.0:
        step = _step(value, 1.0 - power)
        weights = step * value
        total += float(logsumexp(weights)) - np.log(particles)
        power += step
        shares = np.exp(weights - logsumexp(weights))
        chosen = np.searchsorted(
            np.cumsum(shares)[:-1], (rng.uniform() + np.arange(particles)) / particles
        )  # systematic resampling
        chosen = rng.permutation(chosen)
        x, value = _moved(log_likelihood, x[chosen], value[chosen], power, rng)
    return x, total


def refined(
    log_likelihood: LogLikelihood, x: FloatArray, rng: np.random.Generator, size: int
) -> tuple[float, float]:
    """The same mean by importance sampling about particles of the posterior, and its standard error.

    Half of the points have a Student-t kernel (4 degrees of freedom) about one of some particles, a quarter one of the whole cloud,
    a quarter are from the prior.
    """
    k, centres = x.shape[1], x[rng.choice(len(x), _KERNELS, replace=False)]
    factor = np.linalg.cholesky(np.cov(x.T).reshape(k, k) + 1e-9 * np.eye(k))
    whole: FloatArray = np.asarray(factor, np.float64)
    few = rng.multinomial(size, [0.5, 0.25, 0.25])
    tails = [
        rng.standard_normal((n, k)) / np.sqrt(rng.chisquare(4, size=(n, 1)) / 4.0) @ whole.T
        for n in few
    ]
    near = centres[rng.integers(_KERNELS, size=few[0])] + _NARROW * tails[0]
    points = np.concatenate(
        [near, x.mean(axis=0) + 1.5 * tails[1], rng.standard_normal((few[2], k))]
    )
    log_prior = -0.5 * (np.square(points).sum(axis=1) + k * np.log(2.0 * np.pi))
    narrow: FloatArray = np.asarray(_NARROW * whole, np.float64)
    of_kernels = np.concatenate(
        [logsumexp(_log_t(part, centres, narrow), axis=1) for part in np.array_split(points, 20)]
    )
    of_whole = _log_t(points, x.mean(axis=0)[None], np.asarray(1.5 * whole, np.float64))[:, 0]
    parts = np.stack(
        [np.log(0.5 / _KERNELS) + of_kernels, np.log(0.25) + of_whole, np.log(0.25) + log_prior]
    )
    weights = log_likelihood(points) + log_prior - logsumexp(parts, axis=0)
    total = float(logsumexp(weights))
    return total - float(np.log(size)), float(
        np.sqrt(np.exp(logsumexp(2.0 * weights) - 2.0 * total) - 1.0 / size)
    )


def _log_t(points: FloatArray, centres: FloatArray, factor: FloatArray) -> FloatArray:
    """Log density of Student-t kernels, 4 degrees of freedom, (points, centres)."""
    k = len(factor)
    a, b = (np.linalg.solve(factor, part.T).T for part in (points, centres))
    far = np.square(a).sum(axis=1)[:, None] + np.square(b).sum(axis=1) - 2.0 * a @ b.T
    norm = (
        gammaln(0.5 * (4 + k))
        - gammaln(2.0)
        - 0.5 * k * np.log(4.0 * np.pi)
        - np.log(np.diagonal(factor)).sum()
    )
    return np.asarray(norm - 0.5 * (4 + k) * np.log1p(np.maximum(far, 0.0) / 4.0))


def _step(value: FloatArray, most: float) -> float:
    """Growth of the power after which the wanted share of the particles counts."""

    def share(step: float) -> float:
        return float(np.exp(2.0 * logsumexp(step * value) - logsumexp(2.0 * step * value))) / len(
            value
        )

    if share(most) >= _KEPT:
        return most
    low, high = 0.0, most
    alive = np.isfinite(value).mean()
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if share(middle) >= _KEPT * alive else (low, middle)
    return low if low > 0.0 else high


def _moved(
    log_likelihood: LogLikelihood,
    x: FloatArray,
    value: FloatArray,
    power: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Particles after some Metropolis moves; each half moves by differences within the other, so that detailed balance holds."""
    half, k = len(x) // 2, x.shape[1]
    for step in range(_STEPS):
        for mine, others in ((slice(None, half), x[half:]), (slice(half, None), x[:half])):
            here = x[mine]
            one, two = (others[rng.integers(len(others), size=len(here))] for _ in range(2))
            size = 2.38 / np.sqrt(2.0 * k) * np.exp(rng.normal(-0.3, 0.7, size=(len(here), 1)))
            jump = size * (one - two) + 1e-6 * rng.standard_normal(here.shape)
            if step % 2:  # in one coordinate
                jump *= np.sqrt(k) * (np.arange(k) == rng.integers(k, size=(len(here), 1)))
            trial = here + jump
            found = log_likelihood(trial)
            with np.errstate(invalid="ignore"):
                rise = power * (found - value[mine]) + 0.5 * (
                    np.square(here) - np.square(trial)
                ).sum(axis=1)
            taken = np.log(rng.uniform(size=len(here))) < rise
            x[mine] = np.where(taken[:, None], trial, here)
            value[mine] = np.where(taken, found, value[mine])
    return x, value


def composed_evidence(
    subject: Subject, name: str, *, runs: int = 8, particles: int = 2000, size: int = 30_000
) -> tuple[float, float]:
    """Log evidence of a composition under :data:`PRIOR` and its standard error, the larger of what weights and runs say of it."""
    scored = Scored(subject, name)
    found = []
    for run in range(runs):
        rng = np.random.default_rng([run, 2611])
        x, _ = tempered(scored, len(scored.parameters), rng, particles)
        found.append(refined(scored, x, rng, size))
    values, errors = np.array(found).T
    relative = np.exp(values - values.max())
    between = relative.std(ddof=1) / relative.mean() / np.sqrt(runs)
    within = float(np.sqrt(np.square(relative * errors).sum()) / relative.sum())
    return float(values.max() + np.log(relative.mean())), max(float(between), within)
