"""Log evidences of many compositions of one subject at once: Laplace's approximation for all, importance sampling for those that matter.

Compositions of one order effect and one curve are one posterior with some coordinates fixed (a slope at 0, no lapses), so all of them climb
in one batch. Laplace's approximation is taken in coordinates u in which posteriors are nearly normal: the prior mean mu1 in the place of
the offset c = p (mu1 - sbar), the probit of the lapse rate. Every model within :data:`WINDOW` nats of the best is then sampled; the others
keep Laplace's value, and none is dropped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import expit, log_expit, ndtr
from scipy.stats import multivariate_t

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray
from bayes_toe.data.study import Subject
from bayes_toe.inference.adaptation import quick_proposal, with_trusted_draws
from bayes_toe.inference.evidence import Evidence, importance_evidence
from bayes_toe.inference.maxima import Differenced, ascend
from bayes_toe.inference.prediction import Predictor
from bayes_toe.inference.proposal import FittedProposal
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.coordinates import log_slope, logit_of_probit, probit_of_logit
from bayes_toe.model.distributions import LOG_2PI
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model
from bayes_toe.seeds import generator

#: Nats below the best model within which evidences are sampled.
WINDOW = 5.0
_LAPSE = "logit_lapse_rate"
_FLATTEST = 0.02  # curvature, over that of one coordinate by itself, below which a direction is no use as a scale
_CLOUD = 400  # draws of Laplace's normal with which a proposal begins
_FREEDOM = 5.0  # of Student's t in its shape


class Sampled(NamedTuple):
    """A model that was sampled: its proposal with draws, its evidence, and its maximum, shape (1, k), unconstrained."""

    fitted: FittedProposal
    evidence: Evidence
    mode: FloatArray


@dataclass(frozen=True, eq=False)
class SpaceEvidence:
    """Log evidences of the models of a space for one subject, nats.

    They are by importance sampling where `sampled` has the model, by its place, else Laplace's, and NaN where there is neither.
    """

    subject: Subject
    prior: Prior  # in numbers
    models: tuple[Model, ...]
    log_evidence: FloatArray  # (models,)
    bounds: (
        FloatArray  # (models,): what one that is NaN is at most; infinite where that is not known
    )
    sampled: Mapping[int, Sampled]
    notes: tuple[
        str, ...
    ] = ()  # of models near the best that have Laplace's value because their draws cannot be trusted

    def value(self, model: Model) -> float | None:
        """The log evidence of a model; None where it is withheld."""
        found = float(self.log_evidence[self.models.index(model)])
        return None if np.isnan(found) else found

    def predictor(self, model: str, size: int, rng: np.random.Generator) -> Predictor:
        """So many posterior draws of a model that was sampled."""
        fitted = next(
            self.sampled[i].fitted for i, one in enumerate(self.models) if one.name == model
        )
        target = fitted.proposal.posterior
        assert isinstance(target, Posterior)
        return Predictor(target, fitted.draws.resampled(rng, size))


def space_evidence(
    subject: Subject, prior: Prior, models: Sequence[Model], seed: int, *, window: float = WINDOW
) -> SpaceEvidence:
    """The log evidence of every model; random streams are keyed by seed, subject and model."""
    numbers = prior.at(subject)
    values, counting = laplace_evidences(subject, numbers, models, window)
    sampled, bounds, notes = dict[int, Sampled](), np.full(len(models), np.inf), list[str]()
    for place, (family, i) in counting.items():
        rng = generator(seed, subject.name, models[place].name, "space")
        mode, cloud = family.cloud(i, rng)
        fitted = with_trusted_draws(
            quick_proposal(models[place].posterior(subject, numbers), mode, cloud, rng), rng
        )
        evidence = importance_evidence(fitted)
        if evidence.value is not None:
            values[place], sampled[place] = evidence.value, Sampled(fitted, evidence, mode)
        elif np.isnan(values[place]):
            bounds[place] = evidence.bound
        else:
            notes.append(
                f"{models[place].name}: evidence by Laplace's approximation, importance weights are unreliable"
            )
    return SpaceEvidence(subject, numbers, tuple(models), values, bounds, sampled, tuple(notes))


def laplace_evidences(
    subject: Subject, prior: Prior, models: Sequence[Model], window: float = WINDOW
) -> tuple[FloatArray, dict[int, tuple[Family, int]]]:
    """Laplace's log evidence of every model, (models,), NaN where it does not exist; by place, family and place in it of those that count.

    These are the models within the window of the best, nats, and those that have none. Models that are the largest one of them with some
    coordinates fixed are one family.
    """
    families: list[tuple[object, list[int]]] = []
    for place in sorted(range(len(models)), key=lambda i: -len(models[i].coordinates)):
        model = models[place]
        kind = (
            model.pull,
            model.coordinates[0],
            model.link_without_lapses,
            model.spread,
        )
        larger = (
            of
            for known, of in families
            if known == kind and {*model.coordinates} <= {*models[of[0]].coordinates}
        )
        places = next(larger, None)
        if places is None:
            families.append((kind, places := []))
        places.append(place)
    values, own = np.empty(len(models)), dict[int, tuple[Family, int]]()
    for _, places in families:
        family = Family(subject, prior, [models[place] for place in places])
        values[places] = family.laplace
        own |= {place: (family, i) for i, place in enumerate(places)}
    within = np.flatnonzero(~(values < np.nanmax(values) - window))
    return values, {place: own[place] for place in within.tolist()}


class Family:
    """Models that are one posterior with some coordinates fixed, in coordinates u; arrays have points first, `which` model each."""

    def __init__(self, subject: Subject, prior: Prior, models: Sequence[Model]) -> None:
        largest = max(models, key=lambda model: len(model.coordinates))
        self.models, self.whole = models, Posterior(subject, largest, prior)
        names = self.whole.coordinates
        self.free: BoolArray = np.array(
            [[name in model.coordinates for name in names] for model in models]
        )
        self.rest = np.array([-np.inf if name == _LAPSE else 0.0 for name in names])
        self.lapse = names.index(_LAPSE) if _LAPSE in names else None
        pull = largest.pull
        self.funnel = pull is not None and pull.centre is not None
        if self.funnel:
            of_mu1 = prior.distribution("mu1")
            self.reach, self.unit = float(of_mu1.quantile(0.5)) - self.whole.sbar, of_mu1.spread

    # --- Coordinates ------------------------------------------------------------------------------

    def points(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """X of u and log |dx/du| coordinate by coordinate, (points, k) each, as if all were free."""
        x, volume = u.copy(), np.zeros_like(u)
        if self.funnel:
            x[:, 0] = MAX_PULL * expit(u[:, 1]) * (self.reach + self.unit * u[:, 0])
            volume[:, 0] = np.log(MAX_PULL * self.unit) + log_expit(u[:, 1])
        if self.lapse is not None:
            x[:, self.lapse], volume[:, self.lapse] = (
                logit_of_probit(u[:, self.lapse]),
                -log_slope(u[:, self.lapse]),
            )
        return x, volume

    def straight(self, x: FloatArray) -> FloatArray:
        """The inverse of :meth:`points`."""
        u = x.copy()
        if self.funnel:
            u[:, 0] = (x[:, 0] / (MAX_PULL * expit(x[:, 1])) - self.reach) / self.unit
        if self.lapse is not None:
            u[:, self.lapse] = probit_of_logit(x[:, self.lapse])
        return u

    def log_density(self, u: FloatArray, which: IndexArray) -> FloatArray:
        """With respect to the coordinates that are free, (points, k) -> (points,)."""
        free, (x, volume) = self.free[which], self.points(u)
        of_prior = (self.whole.block_log_prior(x) * free[:, self.whole.block_starts]).sum(axis=1)
        return np.asarray(
            self.whole.log_likelihood(np.where(free, x, self.rest))
            + of_prior
            + np.where(free, volume, 0.0).sum(axis=1)
        )

    def gradient(self, u: FloatArray, which: IndexArray) -> FloatArray:
        """Gradient of :meth:`log_density`, 0 in fixed coordinates."""
        free, (x, _) = self.free[which], self.points(u)
        slope = self.whole.likelihood_gradient(np.where(free, x, self.rest))[
            1
        ] + self.whole.prior_gradient(x)
        if self.funnel:
            down, per = expit(-u[:, 1]), MAX_PULL * expit(u[:, 1])
            slope[:, 1] += (1.0 + slope[:, 0] * x[:, 0]) * down
            slope[:, 0] *= per * self.unit
        if self.lapse is not None:
            v = u[:, self.lapse]
            density = np.exp(-0.5 * np.square(v) - 0.5 * LOG_2PI)
            slope[:, self.lapse] = (
                slope[:, self.lapse] * np.exp(-log_slope(v))
                - density / ndtr(v)
                + density / ndtr(-v)
                - v
            )
        return np.where(free, slope, 0.0)

    # --- Maxima -----------------------------------------------------------------------------------

    def starts(self) -> tuple[FloatArray, IndexArray]:
        """Of every model the best points of its grid, one for each start of offset and pull, and whose they are."""
        found, whose = [], []
        for i, model in enumerate(self.models):
            grid = Posterior(
                self.whole.subject, model, self.whole.prior, self.whole.centre
            ).starts()
            x = np.zeros((len(grid), len(self.rest)))
            x[:, self.free[i]] = grid
            u = self.straight(x)
            u[:, ~self.free[i]] = 0.0
            value = self.log_density(u, np.full(len(u), i))
            lead = x[:, : 2 if self.funnel else 1 if model.coordinates[0] == "offset" else 0]
            _, cell = np.unique(lead, axis=0, return_inverse=True)
            cell = np.zeros(len(u), np.intp) if lead.shape[1] == 0 else cell.ravel()
            best = [
                np.flatnonzero(cell == j)[value[cell == j].argmax()] for j in range(cell.max() + 1)
            ]
            found.append(u[best])
            whose.append(np.full(len(best), i))
        return np.concatenate(found), np.concatenate(whose)

    @cached_property
    def maxima(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of every model its highest maximum, (models, k), value, (models,), and negative Hessian, (models, k, k), 1 where fixed."""
        u, whose = self.starts()
        climb = Differenced(
            lambda u, starts: self.log_density(u, whose[starts]),
            lambda u, starts: self.gradient(u, whose[starts]),
            *u.shape,
        )
        found = ascend(climb, u.T, fixed=~self.free[whose].T, rivals=whose)
        value = np.where(found.arrived, found.value, -np.inf)
        best = np.array(
            [
                np.flatnonzero(whose == i)[np.argmax(value[whose == i])]
                for i in range(len(self.models))
            ]
        )
        bend = climb.curvature(found.x[:, best], best)
        bend[:, np.arange(len(self.rest)), np.arange(len(self.rest))] += ~self.free
        return found.x.T[best], value[best], bend

    @cached_property
    def laplace(self) -> FloatArray:
        """Laplace's log evidences, (models,); NaN where there is no proper maximum."""
        _, value, bend = self.maxima
        sign, log_det = np.linalg.slogdet(bend)
        proper = np.isfinite(value) & (sign > 0) & (np.linalg.eigvalsh(bend)[:, 0] > 0)
        return np.where(
            proper, value + 0.5 * self.free.sum(axis=1) * LOG_2PI - 0.5 * log_det, np.nan
        )

    def cloud(self, i: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """The maximum of a model, (1, k), and draws of Laplace's normal, (draws, k), in the model's own coordinates x."""
        top, spread, _ = self._normal(i)
        u = top + rng.standard_normal((_CLOUD, len(spread))) @ spread.T
        return self.points(top[None])[0][:, self.free[i]], self.points(u)[0][:, self.free[i]]

    def weighted(
        self, i: int, rng: np.random.Generator, size: int
    ) -> tuple[FloatArray, FloatArray]:
        """Draws of a model from Student's t of Laplace's shape, (size, k), in its own coordinates x, and log weights of mean evidence."""
        (top, spread, log_det), k = self._normal(i), int(self.free[i].sum())
        t = multivariate_t(np.zeros(k), np.eye(k), df=_FREEDOM)
        z = np.zeros((size, len(top)))
        z[:, self.free[i]] = half = t.rvs(size, random_state=rng).reshape(size, k)
        u = top + z @ spread.T
        log_weights = self.log_density(u, np.full(size, i)) - t.logpdf(half) + log_det
        return self.points(u)[0][:, self.free[i]], np.asarray(log_weights)

    def _normal(self, i: int) -> tuple[FloatArray, FloatArray, float]:
        """Maximum of a model, factor of the covariance of Laplace's normal, no direction of which is too flat, and its log determinant."""
        tops, _, bends = self.maxima
        size = np.sqrt(np.maximum(np.abs(np.diagonal(bends[i])), 1e-3))
        bend = bends[i] / np.outer(
            size, size
        )  # so that the draws do not depend on the unit of intensity
        bend += max(0.0, _FLATTEST - float(np.linalg.eigvalsh(bend)[0])) * np.diag(
            self.free[i].astype(np.float64)
        )
        spread = np.linalg.inv(np.linalg.cholesky(bend)).T / size[:, None]
        return tops[i], spread, float(np.log(np.diagonal(spread)).sum())
