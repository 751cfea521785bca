"""Each subject of a group: the exact likelihood of all at once, its normal approximation, and each one's posterior without pooling.

All on the scales on which subjects scatter about the group's mean. The normal approximation of a likelihood is exact nowhere, but good for
the coordinates and starts of chains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.conditions import mean_first
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.diagnostics import smoothed_weights
from bayes_toe.inference.draws import Draws
from bayes_toe.model.blocks import GroupPull
from bayes_toe.model.crowd import crowd_posterior
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model
from bayes_toe.seeds import generator

_BLOCK = 1 << 14  # values of one temporary array: there are about a hundred of them
_ROUNDS = 50
_PRIOR_DRAWS, _EQUAL = 4000, 4000


def centre_of(model: Model, subject: Subject, centre: float) -> float:
    """From where a subject's offset counts: the group's centre where mu1 is shared, its own mean first stimulus elsewhere."""
    return centre if "mu1" in model.group else mean_first(subject)


# --- The exact likelihood -------------------------------------------------------------------------


class GroupLikelihood:
    """Log likelihood of each of N subjects, without binomial coefficients, at `copies` points of all of them, with its exact gradient.

    Of the prior the reference interval alone matters. `centre` is the group's; how far from it each subject's own is, natural-log
    intensity, says `away`, by default as :func:`centre_of` has it.

    Examples
    --------
    >>> from bayes_toe.model.ladder import PREDICTIVE_UPDATE
    >>> one = Subject("A", [0.0, 0.0], [0.0, 0.3], [49, 20], [50, 50])
    >>> value, gradient = GroupLikelihood(PREDICTIVE_UPDATE, Prior(), [one], 0.0, 2)(np.zeros((2, 1, 4)))
    >>> value.shape, gradient.shape
    ((2, 1), (2, 1, 4))
    """

    def __init__(
        self,
        model: Model,
        prior: Prior,
        subjects: Sequence[Subject],
        centre: float,
        copies: int,
        away: Sequence[float] | None = None,
    ) -> None:
        far = [centre_of(model, one, centre) - centre for one in subjects] if away is None else away
        rows, far = (
            [*subjects] * copies,
            [*far] * copies,
        )  # stimuli less a centre are all that counts
        size = max(
            1,
            _BLOCK // max(one.n_pairs for one in subjects),
        )
        interval = 1.0 if prior.reference_interval is None else prior.reference_interval
        blocks = [slice(i, i + size) for i in range(0, len(rows), size)]
        self._blocks = [
            (some, crowd_posterior(model, prior, rows[some], centre, interval, far[some]))
            for some in blocks
        ]

    def __call__(self, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, (copies, N), and their gradient, (copies, N, k), at eta, (copies, N, k)."""
        points = eta.reshape(-1, eta.shape[-1])
        value, gradient = np.empty(len(points)), np.empty(points.shape)
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # a width next to nothing: density 0, where no trajectory goes on
            for some, posterior in self._blocks:
                x, jacobian = posterior.from_group(points[some])
                value[some], slope = posterior.likelihood_gradient(x)
                gradient[some] = (slope[:, None, :] @ jacobian)[:, 0]
        return value.reshape(eta.shape[:-1]), gradient.reshape(eta.shape)

    def repeated(self, eta: FloatArray, rng: np.random.Generator) -> IntArray:
        """Counted answers if everything were done once more, (copies, N, k) -> (copies, N, pairs); 0 where a subject has fewer pairs."""
        points, counts = eta.reshape(-1, eta.shape[-1]), []
        for some, posterior in self._blocks:
            x, _ = posterior.from_group(points[some])
            equal = np.exp(posterior.realised_answers(rng, x, posterior.log_answers(x))[0])
            counts.append(rng.binomial(posterior.subject.n_trials, equal))
        pairs = max(found.shape[1] for found in counts)
        padded = [np.pad(found, ((0, 0), (0, pairs - found.shape[1]))) for found in counts]
        return np.concatenate(padded).reshape(*eta.shape[:-1], pairs)


# --- Its normal approximation ---------------------------------------------------------------------


@dataclass(frozen=True)
class Funnel:
    """Columns of the prior mean and of what the pull follows from, the centre, and how it follows."""

    mean: int
    pull: int
    centre: float
    pulled: Callable[[FloatArray], GroupPull]


@dataclass(frozen=True, eq=False)
class NormalApproximation:
    """Log precision and location of each subject's parameters by its answers, shape (N, k); a precision of -inf where they say nothing.

    Of the prior mean mu1 answers tell p (mu1 - centre), with pull p: the less of it there is, the less they say of mu1. Where `funnel` is
    given, precision and location in the column of mu1 are those of this product.
    """

    log_precision: FloatArray
    location: FloatArray
    funnel: Funnel | None = None


def funnel_of(model: Model, centre: float) -> Funnel | None:
    """Where mu1 and what its pull follows from are among the model's group parameters."""
    places = (
        (model.group.index(block.group[0]), block.group_pull)
        for block in model.free
        if block.group_pull is not None
    )
    return next((Funnel(place, place + 1, centre, pulled) for place, pulled in places), None)


def population_moments(
    about: NormalApproximation, hyperprior: HyperpriorNumbers
) -> tuple[FloatArray, FloatArray]:
    """Means and scatters of which the subjects may have been drawn: a few rounds of expectation and maximisation."""
    mean, scatter, n = hyperprior.mean, hyperprior.sd_scale, len(about.location)
    precision = np.exp(about.log_precision)
    for _ in range(_ROUNDS):
        share = 1.0 / (1.0 + precision * np.square(scatter))
        subject, unit = about.location + share * (mean - about.location), np.square(scatter) * share
        inverse = np.square(scatter / hyperprior.mean_sd) / n
        mean = (subject.mean(axis=0) + inverse * hyperprior.mean) / (1.0 + inverse)
        # Half a subject as far away as the hyperprior has them, so that a scatter cannot vanish.
        scatter = np.sqrt(
            ((np.square(subject - mean) + unit).sum(axis=0) + 0.5 * np.square(hyperprior.sd_scale))
            / (n + 0.5)
        )
    return mean, scatter


def without_funnel(
    about: NormalApproximation, hyperprior: HyperpriorNumbers
) -> NormalApproximation:
    """With what is known of mu1 itself, at the pull that each subject seems to have."""
    if about.funnel is None:
        return about
    i, j, centre = about.funnel.mean, about.funnel.pull, about.funnel.centre
    mean, scatter = population_moments(about, hyperprior)
    share = 1.0 / (1.0 + np.exp(about.log_precision[:, j]) * scatter[j] ** 2)
    pull = about.funnel.pulled(about.location[:, j] + share * (mean[j] - about.location[:, j])).pull
    precision, location = about.log_precision.copy(), about.location.copy()
    precision[:, i] += 2.0 * np.log(pull)
    location[:, i] = centre + about.location[:, i] / pull
    return NormalApproximation(precision, location)


# --- The posterior without pooling ----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Unpooled:
    """One subject's posterior without the group: draws eta of equal weight, with repeats, shape (4000, k).

    Log precision and location of its likelihood, shape (k,), are those of :class:`NormalApproximation`; trusted is whether the weights
    behind the draws are good enough for averages.
    """

    name: str
    eta: FloatArray
    log_precision: FloatArray
    location: FloatArray
    trusted: bool


def unpooled(
    subject: Subject, model: Model, prior: Prior, centre: float, draws: int, seed: int
) -> Unpooled:
    """Fit a proposal to a subject's own posterior and draw from it."""
    return unpooled_posterior(
        Posterior(subject, model, prior, centre=centre_of(model, subject, centre)), draws, seed
    )


def unpooled_posterior(posterior: Posterior, draws: int, seed: int) -> Unpooled:
    """The same of a posterior."""
    fitted = fit_proposal(
        posterior,
        generator(seed, posterior.subject.name, posterior.model.name, "alone"),
        draws=draws,
    )
    some = np.isfinite(fitted.draws.log_posterior)
    x, shares = (
        fitted.draws.x[some],
        np.exp(smoothed_weights(fitted.draws.log_weights[some]).log_weights),
    )
    return _unpooled(
        posterior, x, (fitted.draws.shares[some], shares / shares.sum()), fitted.trusted, seed
    )


def unpooled_from_draws(
    draws: Draws, name: str, model: Model, centre: float, seed: int
) -> Unpooled:
    """The same from draws of the subject's own posterior that are there already, of equal weight."""
    own = draws.subject(name)
    posterior = Posterior(own, model, draws.prior, centre=centre_of(model, own, centre))
    # What is stored of a slope of the noise depends on the mean first stimulus.
    if {"noise_slope", "peak_slope"} & {*model.coordinates} and not np.isclose(
        Posterior(own, model, draws.prior).sbar, posterior.sbar
    ):
        raise InputError(
            f"posterior: subject {name!r} met other first stimuli than the group, and {model.name!r} counts from their mean; "
            "allowed: no posterior"
        )
    x = posterior.points({key: draws.values(name, key).ravel() for key in draws.parameters})
    equal = np.full(len(x), 1.0 / len(x))
    return _unpooled(posterior, x, (equal, equal), name not in draws.not_converged, seed)


def _unpooled(
    posterior: Posterior,
    x: FloatArray,
    shares: tuple[FloatArray, FloatArray],
    trusted: bool,
    seed: int,
) -> Unpooled:
    """From points with shares of the whole, as they are and smoothed: what the answers say is the posterior less what the prior knows."""
    name, eta, (plain, smoothed) = posterior.subject.name, posterior.to_group(x), shares
    funnel, believed = (
        funnel_of(posterior.model, posterior.sbar),
        posterior.sample_prior(generator(seed, name, "prior"), _PRIOR_DRAWS),
    )
    told, first = eta.copy(), posterior.to_group(believed)
    if funnel is not None:  # answers tell p (mu1 - centre) more or less normally, and not mu1
        offset = posterior.coordinates.index("offset")
        told[:, funnel.mean], first[:, funnel.mean] = x[:, offset], believed[:, offset]
    location = plain @ told
    gained = 1.0 / (plain @ np.square(told - location)) - 1.0 / first.var(axis=0)
    with np.errstate(divide="ignore"):  # the answers say nothing: a precision of 0
        log_precision = np.log(np.where(gained > 0.0, gained, 0.0))
    some = generator(seed, name, "alone").choice(len(eta), _EQUAL, p=smoothed)
    return Unpooled(name, eta[some], log_precision, location, trusted)
