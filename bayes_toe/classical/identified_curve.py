"""The paper's model (H1): the posterior of one subject, and its coordinates.

    natural        (mu1, sigma_p, sigma_l, q0)              what the paper reports
    identified     (offset c, pull p, width w, q0)          what the answers depend on
    unconstrained  (c, logit(p / p_max), log w, logit q0)   where samplers and optimisers work

    z = ((s2 - s1) + p (s1 - sbar) - c) / w,   c = p (mu1 - sbar)
    same or different   P(equal) = q0 2^(-z^2),                       w = sigma_p G^(3/2)
    which is stronger   P(second) = lambda/2 + (1 - lambda) Phi(z),   w = sigma_p G

sbar is the mean first stimulus of the subject; p, gamma and G are those of
:mod:`bayes_toe.model.paper_equations`. Which is stronger has the lapse rate lambda in the place of
q0.

The map between coordinates is a bijection for 0 < gamma < 1. In natural coordinates only p (mu1 -
s1) enters the likelihood, so gamma and mu1 form a funnel as gamma -> 0.

The log posterior is the log likelihood, without binomial coefficients, plus the log prior density
with respect to the unconstrained coordinates: its integral over them is the evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import cast

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.special import expit, log_expit, logit, ndtri

from bayes_toe.arrays import BLOCK, AnyRng, ArrayPair, FloatArray, IntArray, NamedArrays
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.errors import InputError, NumericalError
from bayes_toe.model.answer_curves import (
    LogAnswers,
    Slopes,
    log_likelihoods,
    second_answers,
    second_slopes,
    times_counts,
)
from bayes_toe.model.densities import LogitOfBeta
from bayes_toe.model.distributions import Beta, Distribution, HalfNormal, LogNormal
from bayes_toe.model.normal_scores import Funnel, NormalScores
from bayes_toe.model.paper_equations import (
    LN2,
    MAX_PULL,
    NATURAL,
    Natural,
    log_different,
    log_equal,
    natural_names,
    noise_ratio,
    pull,
    variance_ratio,
    width,
)
from bayes_toe.model.posterior import Names, require_points
from bayes_toe.model.prior import DEFAULT, Prior

#: Its name in files and in the keys of its random streams.
PAPER_MODEL = "predictive update"
PRIOR_DRAWS = 100_000
#: The just noticeable difference over the width: where P(equal) is half its peak, or P(second) 75
#: %.
_JND_OVER_WIDTH = {"q0": 1.0, "lapse_rate": float(ndtri(0.75))}
#: Of G, in the width sigma_p G^power.
_POWERS = {"q0": 1.5, "lapse_rate": 1.0}
#: By so much, relatively, sigma_l may come out above sigma_p though gamma is below 1.
_ROUNDING = 1e-15
#: Nodes of an integral over gamma.
_NODES = 200


# --- Answers -------------------------------------------------------------------------------------


def bell_answers(z: FloatArray, logit_q0: FloatArray) -> LogAnswers:
    """Log of P(equal) = q0 2^(-z^2) and of its complement. Source: Eq. mod:q."""
    with np.errstate(over="ignore"):  # z^2 beyond the largest float: log P(equal) is -inf
        return LogAnswers(log_equal(z, log_expit(logit_q0)), log_different(z, logit_q0))


def bell_slopes(z: FloatArray, logit_q0: FloatArray, answers: LogAnswers) -> tuple[Slopes, Slopes]:
    """Slopes of :func:`bell_answers` in z and in the logit of q0.

    With the odds r = q/(1 - q), those of log(1 - q) are 2 ln2 r z and -r (1 - q0).
    """
    lapse = expit(-logit_q0)
    with np.errstate(over="ignore", invalid="ignore"):
        odds = np.exp(answers.yes - answers.no)
        return Slopes(-2.0 * LN2 * z, 2.0 * LN2 * odds * z), Slopes(lapse, -odds * lapse)


def guessing_answers(z: FloatArray, logit_rate: FloatArray) -> LogAnswers:
    """Log of P(second) = lambda/2 + (1 - lambda) Phi(z) and of its complement.

    Examples
    --------
    >>> far = guessing_answers(np.array([[-1e9]]), np.array([[np.log(0.2 / 0.8)]]))
    >>> round(float(np.exp(far.yes)[0, 0]), 12)
    0.1
    """
    guessed, attended = _guessing_parts(second_answers(z), logit_rate)
    yes, no = np.logaddexp(guessed, attended.yes), np.logaddexp(guessed, attended.no)
    # The larger probability is the complement of the smaller one.
    is_rare = yes < no
    other = np.log1p(-np.exp(np.where(is_rare, yes, no)))
    return LogAnswers(np.where(is_rare, yes, other), np.where(is_rare, other, no))


def guessing_slopes(
    z: FloatArray, logit_rate: FloatArray, answers: LogAnswers
) -> tuple[Slopes, Slopes]:
    """Slopes of :func:`guessing_answers` in z and in the logit of lambda."""
    curve = second_answers(z)
    log_guessed, log_attended = _guessing_parts(curve, logit_rate)
    in_z, in_rate = [], []
    sides = zip(log_attended, answers, second_slopes(z), strict=True)
    for log_part, log_p, slope in sides:
        with np.errstate(over="ignore", invalid="ignore"):
            guessed, attended = np.exp(log_guessed - log_p), np.exp(log_part - log_p)
            # Far out nothing of the curve is left, and its slope may be infinite.
            in_z.append(np.where(attended > 0.0, attended * slope, 0.0))
            in_rate.append(guessed * expit(-logit_rate) - attended * expit(logit_rate))
    return Slopes(*in_z), Slopes(*in_rate)


def _guessing_parts(curve: LogAnswers, logit_rate: FloatArray) -> tuple[FloatArray, LogAnswers]:
    """Log probability of either answer by a guess, and of both by the curve."""
    log_attend = log_expit(-logit_rate)
    attended = LogAnswers(log_attend + curve.yes, log_attend + curve.no)
    return log_expit(logit_rate) - LN2, attended


# --- The model and its posterior -----------------------------------------------------------------


@dataclass(frozen=True)
class PaperModel:
    """The paper's model (H1) of a task."""

    task: Task = SAME_DIFFERENT

    name = PAPER_MODEL
    about = "H1: memory is updated by a prior and diffuses"

    def posterior(self, subject: Subject, prior: Prior = DEFAULT) -> PaperPosterior:
        """The posterior of a subject."""
        return PaperPosterior(subject, prior)


def paper_posterior(subject: Subject, prior: Prior = DEFAULT) -> PaperPosterior:
    """The posterior of one subject under the paper's model (H1).

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> paper_posterior(subject).coordinates
    ('offset', 'logit_pull', 'log_width', 'logit_q0')
    """
    return PaperPosterior(subject, prior)


@dataclass(frozen=True, eq=False)
class PaperPosterior:
    """Log posterior of one subject under the paper's model.

    Points x have the shape (points, 4), with unconstrained coordinates.

    Parameters
    ----------
    subject : Subject
        The counts.
    prior : Prior
        "stimuli" in it become numbers of this subject's stimuli.
    centre : float, optional
        Intensity from which the offset counts, natural-log units; by default the mean first
        stimulus.
    """

    subject: Subject
    prior: Prior = DEFAULT
    centre: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "prior", self.prior.for_subjects(self.subject))

    @property
    def model(self) -> PaperModel:
        """The model of the subject's task."""
        return PaperModel(self.subject.task)

    @property
    def share(self) -> str:
        """The name of the fourth parameter: q0 or lapse_rate."""
        return self.subject.task.lapses

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the unconstrained coordinates."""
        return ("offset", "logit_pull", "log_width", f"logit_{self.share}")

    @property
    def power(self) -> float:
        """The power of G in the width sigma_p G^power."""
        return _POWERS[self.share]

    @cached_property
    def sbar(self) -> float:
        """Intensity from which the offset counts, natural-log units."""
        if self.centre is not None:
            return self.centre
        if self.subject.shared_scales is not None:
            return self.subject.shared_scales.sbar
        return float(np.average(self.subject.s1, weights=self.subject.n_trials))

    def for_subject(self, subject: Subject) -> PaperPosterior:
        """The same prior and centre for other answers or other pairs."""
        return replace(self, subject=subject, centre=self.sbar)

    # --- Likelihood ------------------------------------------------------------------------------

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood without binomial coefficients, (points, 4) -> (points,)."""
        points = require_points(x, 4)
        size = max(1, BLOCK // self.subject.n_pairs)
        blocks = []
        for i in range(0, len(points), size):
            answers = self.log_answers(points[i : i + size])
            pairs = log_likelihoods(self.subject.n_yes, self.subject.n_trials, answers)
            blocks.append(pairs.sum(axis=1))
        return np.concatenate(blocks)

    def log_answers(self, x: npt.ArrayLike) -> LogAnswers:
        """Log probability of both answers to every pair, (points, pairs) each.

        Source: Eq. mod:q.
        """
        points = require_points(x, 4)
        return self._answers_at(self.distance(points), points[:, 3:])

    def _answers_at(self, z: FloatArray, logit_share: FloatArray) -> LogAnswers:
        """Log probability of both answers at distances z."""
        if self.share == "q0":
            return bell_answers(z, logit_share)
        return guessing_answers(z, logit_share)

    def _slopes_at(
        self, z: FloatArray, logit_share: FloatArray, answers: LogAnswers
    ) -> tuple[Slopes, Slopes]:
        """Slopes of :meth:`_answers_at` in z and in the logit of the share."""
        if self.share == "q0":
            return bell_slopes(z, logit_share, answers)
        return guessing_slopes(z, logit_share, answers)

    def distance(self, x: FloatArray) -> FloatArray:
        """Normalised distance z of every pair, (points, 4) -> (points, pairs)."""
        # Points lie next to each other in memory, for there are few pairs.
        s1, s2 = self.subject.s1[:, None], self.subject.s2[:, None]
        lever = pull_at(x).T * (s1 - self.sbar)
        shift = (s2 - s1) + (lever - x[:, :1].T)
        with np.errstate(over="ignore", invalid="ignore"):
            inverse_width = np.exp(-x[:, 2:3]).T
            z = shift * inverse_width
            if not np.isfinite(inverse_width).all():
                # A width below the smallest float leaves only exact equality at distance 0.
                z = np.where(shift == 0.0, 0.0, z)
            return z.T

    def likelihood_gradient(self, x: FloatArray, n_yes: IntArray | None = None) -> ArrayPair:
        """Log likelihood, (points,), and its gradient, (points, 4).

        `n_yes`, shape (points, pairs), has other counts of the same pairs, a row for each point.

        The distance is z = N e^(-L), with the numerator N and the log of the width L. A coordinate
        i that moves both adds A_z (N_i e^(-L) - z L_i), for the slope A_z of the log likelihood in
        z.
        """
        subject = self.subject
        n_yes = subject.n_yes if n_yes is None else n_yes
        n_no = subject.n_trials - n_yes
        z, logit_share = self.distance(x), x[:, 3:]
        answers = self._answers_at(z, logit_share)
        with np.errstate(over="ignore"):  # far out, where the density is almost 0
            in_z, in_share = self._slopes_at(z, logit_share, answers)
            slope_z = _counted(n_yes, in_z.yes) + _counted(n_no, in_z.no)
            slope_share = _counted(n_yes, in_share.yes) + _counted(n_no, in_share.no)
            slope_log_width = -_finite_product(slope_z, z)
        # z = [(s2 - s1) + p lever - c] / width, and its slopes in c and in the logit of p.
        inverse_width, lever = np.exp(-x[:, 2:3]), subject.s1 - self.sbar
        z_slope_c = -inverse_width
        z_slope_logit_p = inverse_width * (pull_at(x) * expit(-x[:, 1:2]) * lever)

        gradient = np.empty(x.shape)
        gradient[:, 0] = _finite_product(slope_z, z_slope_c).sum(axis=1)
        gradient[:, 1] = _finite_product(slope_z, z_slope_logit_p).sum(axis=1)
        gradient[:, 2] = slope_log_width.sum(axis=1)
        gradient[:, 3] = slope_share.sum(axis=1)
        value = log_likelihoods(n_yes, subject.n_trials, answers).sum(axis=1)
        return value, gradient

    # --- Prior -----------------------------------------------------------------------------------

    @cached_property
    def _gamma_prior(self) -> Beta:
        """The prior of gamma."""
        return cast(Beta, self.prior.distribution("gamma"))

    @cached_property
    def _share_prior(self) -> Beta:
        """The prior of q0 or the lapse rate."""
        return cast(Beta, self.prior.distribution(self.share))

    @cached_property
    def _logit_share_prior(self) -> LogitOfBeta:
        """The prior of its logit."""
        return LogitOfBeta(self._share_prior.a, self._share_prior.b)

    @property
    def _spread_power(self) -> float:
        """The power of K in the width that has the prior: sigma_p is w K^power."""
        return 0.0 if self.prior.spread == "width" else self.power

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density, (points, 4) -> (points,).

        Where the width has a distribution, not sigma_p, |d(mu1, gamma)/d(c, a)| is the Jacobian.
        """
        points = require_points(x, 4)
        a, log_width = points[:, 1], points[:, 2]
        log_gain = np.log1p(-MAX_PULL * expit(a))
        log_spread = log_width
        if self._spread_power:
            log_spread = log_width + self._spread_power * log_gain
        with np.errstate(over="ignore"):  # mu1 beyond the largest float: the density is 0
            log_prior = self.prior.penalty.log_density(self.sbar + reach(points))
        log_prior = log_prior + self.prior.spread_distribution.log_density_of_log(log_spread)
        log_prior += self._gamma_prior.log_density_of_logs(*log_noise_ratio(a))
        log_prior += log_jacobian_of_pull(a) - 1.5 * log_gain
        return log_prior + self._logit_share_prior.log_density(points[:, 3])

    def prior_gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of the log prior density, (points, 4)."""
        a, log_width = x[:, 1], x[:, 2]
        p, down = MAX_PULL * expit(a), expit(-a)
        narrowing = -p * down / (1.0 - p)  # d log K / da
        with np.errstate(over="ignore"):  # 1/p beyond the largest float: infinite is right there
            far = reach(x)
            score = self.prior.penalty.slope(self.sbar + far)
            log_spread = log_width
            if self._spread_power:
                log_spread = log_width + self._spread_power * np.log1p(-p)
            of_log_spread = self.prior.spread_distribution.slope_of_log(log_spread)
            of_pull = log_jacobian_slope_of_pull(a) - score * far * down - 1.5 * narrowing
            if self._spread_power:
                of_pull += self._spread_power * narrowing * of_log_spread
            columns = (
                score * inverse_pull(a),
                of_pull + slope_of_noise_ratio(self._gamma_prior, a),
                of_log_spread,
                self._logit_share_prior.slope(x[:, 3]),
            )
            return np.stack(columns, axis=-1)

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Log posterior density, (points, 4) -> (points,)."""
        points = require_points(x, 4)
        return self.log_likelihood(points) + self.log_prior(points)

    def gradient(self, x: npt.ArrayLike) -> ArrayPair:
        """Log posterior density, (points,), and its gradient, (points, 4)."""
        points = require_points(x, 4)
        size = max(1, BLOCK // self.subject.n_pairs)
        starts = range(0, max(1, len(points)), size)
        blocks = [self.likelihood_gradient(points[i : i + size]) for i in starts]
        value, gradient = map(np.concatenate, zip(*blocks, strict=True))
        return value + self.log_prior(points), gradient + self.prior_gradient(points)

    def sample_prior(self, rng: AnyRng, size: int) -> FloatArray:
        """Independent draws from the prior, shape (size, 4)."""
        update = _sample_shape(rng, size, self.prior, self.sbar, self.power)
        return np.column_stack([update, self._share_prior.sample_logits(rng, size)])

    # --- What engines ask for --------------------------------------------------------------------

    def starts(self) -> FloatArray:
        """A grid on the scale of the stimuli, shape (starts, 4)."""
        subject = self.subject
        steps = np.abs(subject.s2 - subject.s1)
        scale = float(np.sqrt(np.mean(steps[steps > 0] ** 2))) if np.any(steps > 0) else 0.3
        # Offsets off the round numbers at which a distance may be exactly 0.
        offsets = (-0.93 * scale, 0.07 * scale, 1.01 * scale)
        widths = np.log(scale) + np.array([-1.0, 0.0, 1.0])
        shares: tuple[float, ...] = (-3.0, -0.5)
        if self.share == "q0":
            largest_share = ((subject.n_yes + 1.0) / (subject.n_trials + 2.0)).max()
            shares = (float(logit(largest_share)),)
        axes = np.meshgrid(offsets, (-2.0, 2.0), widths, shares)
        points = np.stack([axis.ravel() for axis in axes], axis=-1)
        has_density = np.isfinite(self.log_density(points))
        if not has_density.any():
            raise NumericalError(
                f"subject {subject.name!r}: no point on the scale of the stimuli has a density "
                "above 0 under this prior"
            )
        return points[has_density]

    def transform(self, modes: FloatArray) -> NormalScores:
        """Nearly normal coordinates about modes of the posterior, (modes, 4), best first."""
        return NormalScores(
            Funnel.from_modes(modes, self._likelihood_slope, self.prior.penalty, self.sbar)
        )

    def _likelihood_slope(self, x: FloatArray) -> FloatArray:
        """Gradient of the log likelihood, (points, 4)."""
        return self.likelihood_gradient(x)[1]

    # --- What readers ask for --------------------------------------------------------------------

    def yes_at_distance(self, x: FloatArray, z: FloatArray) -> FloatArray:
        """P of the counted answer at distances z, (points, 4) and (n,) -> (points, n)."""
        distances = np.broadcast_to(z, (len(x), len(z)))
        return np.exp(self._answers_at(distances, x[:, 3:]).yes)

    @property
    def names(self) -> Names:
        """The names of the quantities."""
        return Names(
            natural=natural_names(self.subject.task),
            identified=("offset", "pull", "width", self.share),
            derived=("pse_shift", "jnd", "gamma", "sigma1", "gain", "width"),
            monotone=("pse_shift", "jnd", "gain", "pull"),
        )

    def quantities(self, x: FloatArray) -> dict[str, FloatArray]:
        """Every named quantity, each with the shape of x without its last axis.

        The shift of the point of subjective equality, at the mean first stimulus, is the offset.
        The just noticeable difference is the distance at which 'equal' is half as frequent as at
        its peak, or P(second) 75 % without lapses.
        """
        p, w = MAX_PULL * expit(x[..., 1]), np.exp(x[..., 2])
        gain = 1.0 - p
        sigma_p = w * gain**self.power
        return {
            "mu1": self.sbar + reach(x),
            "sigma_p": sigma_p,
            "sigma_l": sigma_p * np.sqrt(p) / gain,
            "gamma": p / np.square(gain),
            "sigma1": sigma_p / np.sqrt(gain),
            "gain": gain,
            "width": w,
            "offset": x[..., 0],
            "pull": p,
            self.share: expit(x[..., 3]),
            "jnd": w * _JND_OVER_WIDTH[self.share],
            "pse_shift": x[..., 0],
        }

    def points(self, quantities: NamedArrays) -> FloatArray:
        """Unconstrained coordinates, shape (..., 4), from the natural quantities of shape (...)."""
        mu1, sigma_p, sigma_l, share = (
            np.asarray(quantities[name], np.float64) for name in self.names.natural
        )
        x = unconstrained(Natural(mu1, sigma_p, sigma_l, share), self.sbar)
        ratio = variance_ratio(noise_ratio(sigma_p, sigma_l))
        x[..., 2] = np.log(sigma_p) + self.power * np.log(ratio)
        return x

    def prior_quantile(self, name: str, probability: float) -> float:
        """Prior quantile of a quantity.

        That of the offset by draws, to half a percent of its range.
        """
        if name not in self.names.all:
            raise InputError(f"unknown quantity {name!r}; there are: {', '.join(self.names.all)}")
        if name in ("offset", "pse_shift"):
            offsets = _prior_offsets(self.prior, self.sbar, self.power)
            return float(np.quantile(offsets, probability))
        if name == self.share:
            return float(self._share_prior.quantile(probability))
        if name == "pull":
            return float(pull(self.prior.distribution("gamma").quantile(probability)))
        if name == "jnd":
            return _JND_OVER_WIDTH[self.share] * self.prior_quantile("width", probability)
        return prior_quantile(self.prior, name, probability, self.power)

    def natural(self, x: npt.ArrayLike) -> Natural:
        """The paper's parameters of same or different at unconstrained points, shape (..., 4)."""
        quantities = self.quantities(np.asarray(x, np.float64))
        return Natural(*(quantities[name] for name in NATURAL))


def _counted(counts: IntArray, values: FloatArray) -> FloatArray:
    """Counts times values; 0 where the count is 0, whatever the value."""
    return times_counts(counts.astype(np.float64), values)


def _finite_product(slope: FloatArray, factor: FloatArray) -> FloatArray:
    """Their product, 0 where the slope is: it falls faster than any factor may grow far out."""
    with np.errstate(over="ignore", invalid="ignore"):
        product = slope * factor
    if np.isfinite(product).all():
        return product
    return np.where(slope == 0.0, 0.0, product)


def _sample_shape(rng: AnyRng, size: int, prior: Prior, sbar: float, power: float) -> FloatArray:
    """Draws of (c, logit pull, log width) from the prior, shape (size, 3).

    With gamma = p/(1 - p)^2, p/(p_max - p) is gamma/(1 - gamma) times (1/p_max - p): finite where
    gamma itself rounds to an edge.
    """
    mu1 = prior.distribution("mu1").sample(rng, size)
    spread = prior.spread_distribution.sample(rng, size)
    logit_gamma = cast(Beta, prior.distribution("gamma")).sample_logits(rng, size)
    gamma = expit(logit_gamma)
    p = pull(gamma)
    w = spread if prior.spread == "width" else spread * variance_ratio(gamma) ** power
    columns = (p * (mu1 - sbar), logit_gamma + np.log(1.0 / MAX_PULL - p), np.log(w))
    return np.stack(columns, axis=-1)


@lru_cache(maxsize=4)
def _prior_offsets(prior: Prior, sbar: float, power: float) -> FloatArray:
    """Draws of the offset from the prior; the same for all subjects of a design."""
    return _sample_shape(np.random.default_rng(0), PRIOR_DRAWS, prior, sbar, power)[:, 0]


# --- Coordinates ---------------------------------------------------------------------------------


def pull_at(x: FloatArray) -> FloatArray:
    """Pull p at unconstrained points, (points, 4) -> (points, 1)."""
    return MAX_PULL * expit(x[:, 1:2])


def reach(x: npt.ArrayLike) -> FloatArray:
    """Distance of the prior mean from the mean first stimulus, mu1 - sbar = c / p.

    It is infinite past the largest float.
    """
    points = np.asarray(x, np.float64)
    c, a = points[..., 0], points[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(c == 0.0, 0.0, c * inverse_pull(a))


def inverse_pull(a: npt.ArrayLike) -> FloatArray:
    """1/p at a = logit(p / p_max); infinite past the largest float."""
    with np.errstate(over="ignore"):
        return (1.0 + np.exp(-np.asarray(a, np.float64))) / MAX_PULL


def unconstrained(theta: Natural, sbar: float) -> FloatArray:
    """Natural coordinates, each of shape (...), to unconstrained ones of shape (..., 4).

    Needs 0 < gamma < 1, 0 < q0 < 1.

    Notes
    -----
    Where sigma_l and sigma_p differ by rounding only, gamma = 1 and the logit is infinite: such a
    point is on the edge, outside the open support. Draws come there: from logit(p / p_max) = 36 on
    no pair of floats distinguishes it.
    """
    gamma = theta.gamma
    p = pull(gamma)
    with np.errstate(divide="ignore"):
        columns = (
            p * (theta.mu1 - sbar),
            _logit_pull(theta, p),
            np.log(width(theta.sigma_p, gamma)),
            logit(theta.q0),
        )
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _logit_pull(theta: Natural, p: FloatArray) -> FloatArray:
    """The logit of p / p_max from 1 - gamma, and that from the difference of the sigmas.

    See :func:`log_noise_ratio` for p_max - p.
    """
    difference = (theta.sigma_p - theta.sigma_l) / theta.sigma_p
    is_rounding = (difference < 0.0) & (difference >= -_ROUNDING)
    complement = difference * (1.0 + theta.sigma_l / theta.sigma_p)
    log_complement = np.log(np.where(is_rounding, 0.0, complement))
    return np.log(p) + np.log(1.0 / MAX_PULL - p) - 2.0 * np.log1p(-p) - log_complement


def log_jacobian(x: npt.ArrayLike) -> FloatArray:
    """Log |d(mu1, sigma_p, gamma, q0) / dx| at unconstrained x, shape (..., 4) -> (...).

    |d(mu1, sigma_p, gamma) / d(c, w, p)| = (1 + p) / (p (1 - p)^(3/2)); with dp/da = p expit(-a)
    the factor p cancels, so the result stays finite however small the pull.
    """
    _, a, b, top = np.moveaxis(np.asarray(x, np.float64), -1, 0)
    return log_jacobian_of_pull(a) + b + log_expit(top) + log_expit(-top)


def log_jacobian_of_pull(a: FloatArray) -> FloatArray:
    """The part of :func:`log_jacobian` that depends on a = logit(p / p_max), shape (...)."""
    p = MAX_PULL * expit(a)
    return np.log1p(p) - 1.5 * np.log1p(-p) + log_expit(-a)


def log_jacobian_slope_of_pull(a: FloatArray) -> FloatArray:
    """Derivative of :func:`log_jacobian_of_pull`, shape (...)."""
    p, fall = MAX_PULL * expit(a), expit(-a)
    return p * fall / (1.0 + p) + 1.5 * p * fall / (1.0 - p) - expit(a)


def log_noise_ratio(a: FloatArray) -> ArrayPair:
    """Log gamma and log(1 - gamma) at a = logit(p / p_max), gamma = p/(1 - p)^2; neither cancels.

    p_max and 1/p_max are the roots of (1 - p)^2 = p, so 1 - gamma = (p_max - p) (1/p_max - p) / (1
    - p)^2 with p_max - p = p_max expit(-a).
    """
    p = MAX_PULL * expit(a)
    log_gamma = np.log(MAX_PULL) + log_expit(a) - 2.0 * np.log1p(-p)
    near = np.log(MAX_PULL) + log_expit(-a) + np.log(1.0 / MAX_PULL - p) - 2.0 * np.log1p(-p)
    return np.asarray(log_gamma), np.where(
        a < 0.0, np.log1p(-np.exp(np.minimum(log_gamma, -0.1))), near
    )


# --- The prior of H1 in other quantities ---------------------------------------------------------


def slope_of_noise_ratio(distribution: Beta, a: FloatArray) -> FloatArray:
    """Derivative in a = logit(p / p_max) of the log density of gamma, with respect to gamma.

    log gamma has the slope expit(-a) (1 + p)/(1 - p), log(1 - gamma) the slope -expit(a) (1 +
    p)/((1 - p) (1/p_max - p)).
    """
    p = MAX_PULL * expit(a)
    rise = (distribution.a - 1.0) * expit(-a)
    fall = (distribution.b - 1.0) * expit(a) / (1.0 / MAX_PULL - p)
    return (1.0 + p) / (1.0 - p) * (rise - fall)


def prior_quantile(prior: Prior, parameter: str, probability: float, power: float = 1.5) -> float:
    """Prior quantile of mu1, sigma_p, sigma_l, gamma, sigma1, gain or width = sigma_p G^power.

    One of sigma_p and width has a prior of its own, and the other spreads are this one times a
    function h(gamma). The distribution function of such a product at x is the average over gamma of
    the distribution function of the spread with the prior at x / h(gamma). The gain falls with
    gamma, so its quantiles follow from those of gamma.

    Examples
    --------
    >>> names = "mu1", "sigma_p", "gamma", "gain"
    >>> [round(prior_quantile(Prior(), name, 0.95), 4) for name in names]
    [16.4485, 1.96, 0.95, 0.9545]
    """
    if parameter in prior.paper_parameters():
        return float(prior.distribution(parameter).quantile(probability))
    of_gamma = prior.distribution("gamma")
    if parameter == "gain":
        return float(1.0 / variance_ratio(of_gamma.quantile(1.0 - probability)))
    return _product_quantile(
        prior.spread_distribution, of_gamma, prior.spread, parameter, probability, power
    )


@cache
def _product_quantile(
    of_spread: HalfNormal | LogNormal,
    of_gamma: Distribution,
    spread: str,
    parameter: str,
    probability: float,
    power: float,
) -> float:
    """Quantile of the spread times h(gamma).

    It lies between the smallest and the largest h times the quantile of the spread.
    """
    nodes, node_weights = np.polynomial.legendre.leggauss(_NODES)
    # The share u = t^2 of gamma's distribution: sigma_l is smooth in t, and du = 2 t dt.
    t = 0.5 * (nodes + 1.0)
    weights = t * node_weights
    gamma = of_gamma.quantile(np.square(t))
    ratio = variance_ratio(gamma)
    over_sigma_p = {
        "sigma_p": np.ones_like(gamma),
        "sigma_l": np.sqrt(gamma),
        "sigma1": np.sqrt(ratio),
        "width": ratio**power,
    }
    h = over_sigma_p[parameter] / over_sigma_p[spread]
    quantile_of_spread = float(of_spread.quantile(probability))

    def excess(factor: float) -> float:
        """How much P(parameter < factor times the spread's quantile) is above the probability."""
        return float(weights @ of_spread.cdf(factor * quantile_of_spread / h)) - probability

    factor = brentq(excess, 0.999 * h.min(), 1.001 * h.max(), xtol=1e-12)
    return quantile_of_spread * float(factor)
