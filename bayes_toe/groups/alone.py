"""A member before it joins the group: its own posterior, on the scales on which members scatter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.groups.told import Funnel, Told
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.diagnostics import smoothed_weights
from bayes_toe.inference.draws import Draws
from bayes_toe.model.posterior import Model, Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator

_PRIOR_DRAWS, _EQUAL = 4000, 4000


@dataclass(frozen=True, eq=False)
class Alone:
    """Independent weighted draws of one subject's posterior, and what its answers alone say of each parameter.

    Attributes
    ----------
    name : str
    eta : array, shape (draws, k)
        Group parameters on their scales.
    log_weights : array, shape (draws,)
        Log of posterior over proposal density: likelihood without binomial coefficients times prior, so that the log of their mean is the
        log evidence.
    log_prior : array, shape (draws,)
        Log density of the subject's own prior with respect to eta.
    equal : array, shape (4000, k)
        Draws of equal weight, with repeats.
    log_precision, place : array, shape (k,)
        See :class:`bayes_toe.groups.told.Told`.
    trusted : bool
        Whether the weights are good enough for averages.
    """

    name: str
    eta: FloatArray
    log_weights: FloatArray
    log_prior: FloatArray
    equal: FloatArray
    log_precision: FloatArray
    place: FloatArray
    trusted: bool

    @property
    def log_evidence(self) -> float:
        """Log of the mean weight."""
        return float(logsumexp(self.log_weights) - np.log(len(self.log_weights)))

    def part(self, draws: int) -> Alone:
        """The same with the first ones of its weighted draws: all of a thousand subjects take a gigabyte."""
        return replace(self, eta=self.eta[:draws], log_weights=self.log_weights[:draws], log_prior=self.log_prior[:draws])


def funnel_of(model: Model, centre: float) -> Funnel | None:
    """Where mu1 and what its pull follows from are among the model's group parameters."""
    for block in model.free:
        if block.group_pull is not None:
            place = model.group.index(block.group[0])
            return Funnel(place, place + 1, centre, block.group_pull)
    return None


def told_by(members: Sequence[Alone], model: Model, centre: float) -> Told:
    """What the answers of all members say."""
    return Told(np.stack([one.log_precision for one in members]), np.stack([one.place for one in members]), funnel_of(model, centre))


def alone(subject: Subject, model: Model, prior: Prior, centre: float, draws: int, seed: int) -> Alone:
    """Fit a proposal to a subject's own posterior and draw from it."""
    posterior = Posterior(subject, model, prior, centre=centre)
    fitted = fit_proposal(posterior, generator(seed, subject.name, model.name, "alone"), draws=draws)
    some = np.isfinite(fitted.draws.log_posterior)
    x = fitted.draws.x[some]
    eta = posterior.to_group(x)
    told = _told(posterior, x, eta, fitted.draws.shares[some], seed)
    _, jacobian = posterior.from_group(eta)
    log_prior = posterior.log_prior(x) + np.log(np.diagonal(jacobian, axis1=1, axis2=2)).sum(axis=1)
    log_weights = fitted.draws.log_weights[some] + np.log(len(x) / len(fitted.draws.x))  # those of density 0 count as draws
    shares = np.exp(smoothed_weights(log_weights).log_weights)
    equal = eta[generator(seed, subject.name, "alone").choice(len(eta), _EQUAL, p=shares / shares.sum())]
    return Alone(subject.name, eta, log_weights, log_prior, equal, *told, fitted.trusted)


def alone_from_draws(draws: Draws, name: str, model: Model, centre: float, seed: int) -> Alone:
    """The same from draws of the subject's own posterior that are there already, of equal weight; none that could be weighted anew.

    Raises
    ------
    InputError
        If the subject met other first stimuli than the group, and the model counts from their mean.
    """
    own = Posterior(draws.subject(name), model, draws.prior)
    if _counts_from_centre(model) and not np.isclose(own.sbar, centre):
        raise InputError(
            f"posterior: subject {name!r} met other first stimuli than the group, and {model.name!r} counts from their mean; "
            "allowed: no posterior"
        )
    posterior = replace(own, centre=centre)
    x = posterior.points({key: draws.values(name, key).ravel() for key in draws.parameters})
    eta = posterior.to_group(x)
    told = _told(posterior, x, eta, np.full(len(x), 1.0 / len(x)), seed)
    equal = eta[generator(seed, name, "alone").choice(len(eta), _EQUAL)]
    return Alone(name, eta[:0], np.empty(0), np.empty(0), equal, *told, name not in draws.not_converged)


def _counts_from_centre(model: Model) -> bool:
    """Whether what is stored depends on the mean first stimulus: of an offset beside a pull of its own, of a slope of the noise."""
    return ("offset" in model.group and model.pull is not None) or "noise_slope" in model.coordinates


def _told(posterior: Posterior, x: FloatArray, eta: FloatArray, shares: FloatArray, seed: int) -> tuple[FloatArray, FloatArray]:
    """Log precision and place of every parameter by the answers, from weighted draws less what the prior knows, shape (k,) each."""
    believed = posterior.sample_prior(generator(seed, posterior.subject.name, "prior"), _PRIOR_DRAWS)
    at, first = (_tellable(posterior, *points) for points in ((x, eta), (believed, posterior.to_group(believed))))
    place = shares @ at
    gained = 1.0 / (shares @ np.square(at - place)) - 1.0 / first.var(axis=0)
    with np.errstate(divide="ignore"):  # nothing told: a precision of 0
        return np.log(np.where(gained > 0.0, gained, 0.0)), place


def _tellable(posterior: Posterior, x: FloatArray, eta: FloatArray) -> FloatArray:
    """What answers tell more or less normally: group parameters, but p (mu1 - centre) in the place of mu1, shape (points, k)."""
    told, funnel = eta.copy(), funnel_of(posterior.model, posterior.sbar)
    if funnel is not None:
        told[:, funnel.mean] = x[:, posterior.coordinates.index("offset")]
    return told
