"""A ladder of models of the same answers, each a small record: which parameters are free, how the first stimulus is pulled, which link.

One likelihood core serves all: z = ((s2 - s1) - c + p (s1 - sbar)) / w with offset c, pull p and width w, and a link from z to P(equal)
that ends in a peak at z = 0. What a record leaves out is fixed: no offset means c = 0, no pull K = 1 - p = 1, no peak q0 = 1.
Where a subject has several inter-stimulus intervals, pull and width are those at one second, and the record's propagator scales them
(:mod:`bayes_toe.model.propagators`). A model without a memory has none: it does not mention the interval and answers a pair alike at
every one, so that comparing it with H1 asks whether intervals matter.
:class:`LadderPosterior` turns a record into what the engines sample (:class:`bayes_toe.model.target.Target`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logit

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.differences import central_derivatives
from bayes_toe.model.interval_posterior import posterior_of
from bayes_toe.model.levelling import Levelling, Probits
from bayes_toe.model.links import Link, differencing_link, lapse_link
from bayes_toe.model.parameters import Block, Memory, Random, Share, Shift, Update, Width
from bayes_toe.model.prior import Prior
from bayes_toe.model.propagators import MEAN_REVERSION, RANDOM_WALK, UNSCALED, Propagator, Scales, grouped_intervals, typical_interval
from bayes_toe.model.target import Levels, Target, require_points

_BLOCK = 1 << 16  # values of one temporary array

#: q0, or the peak of the differencing model: uniform, as each frequency under H0.
PEAK = Share("q0")
#: Offset at the mean first stimulus: one log unit is a factor of e in intensity, far beyond constant errors that are found.
OFFSET = Shift(1.0)
#: Weight of the first stimulus, from none to twice that of the second, around "no effect" at 1 without preference.
GAIN = Share("gain", top=2.0, starts=(-0.8, 0.4))


@dataclass(frozen=True)
class Pull:
    """How a coordinate sets the pull: p = low + span expit(coordinate)."""

    coordinate: str
    low: float
    span: float
    #: Whether the offset is p (mu1 - sbar), so that it narrows with p under mu1's prior.
    funnel: bool


@dataclass(frozen=True)
class Model:
    """One rung.

    Parameters
    ----------
    name : str
    about : str
        What it says of the observer, in a few words.
    free : tuple of Block
        Free parameters; blocks that share a quantity with another model are the same objects.
    pull : Pull, optional
        None fixes K = 1.
    link : callable
        From z and the logit of the peak to the log probabilities of both answers.
    propagator : Propagator, optional
        How pull and width depend on the inter-stimulus interval. None: the model does not mention it.
    """

    name: str
    about: str
    free: tuple[Block, ...]
    pull: Pull | None = None
    link: Link = lapse_link
    propagator: Propagator | None = None

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the unconstrained coordinates."""
        return tuple(name for block in self.free for name in block.coordinates)

    @property
    def of_intervals(self) -> str:
        """What it says of inter-stimulus intervals, in a few words."""
        return IGNORES_INTERVALS if self.propagator is None else self.propagator.about

    def describe(self, prior: Prior) -> str:
        """The prior of every free parameter, in words."""
        return ", ".join(block.describe(prior) for block in self.free)


#: What a model without a memory says of inter-stimulus intervals.
IGNORES_INTERVALS = "ignores the interval: a pair has the same P(equal) at every one"
#: H0: one free frequency per pair; it has no record, because everything about it is known in closed form.
FREE_FREQUENCIES = "free frequencies"
_OF_UPDATE = Pull("logit_pull", 0.0, MAX_PULL, funnel=True)

SYMMETRIC = Model("symmetric", "no order effect", (Width(), PEAK))
CONSTANT_BIAS = Model("constant bias", "the second stimulus is judged with a constant error", (OFFSET, Width(), PEAK))
PREDICTIVE_UPDATE = Model(
    "predictive update", "H1: memory is updated by a prior and diffuses", (Update(), PEAK), _OF_UPDATE, propagator=RANDOM_WALK
)
NO_LAPSES = Model("no lapses", "H1 with q0 = 1", (Update(),), _OF_UPDATE, propagator=RANDOM_WALK)
FREE_WEIGHTING = Model(
    "free weighting",
    "Hellstrom's sensation weighting: any gain, any constant error",
    (OFFSET, GAIN, Width(), PEAK),
    Pull("logit_gain", 1.0, -2.0, funnel=False),  # p = 1 - K, K = 2 expit
)
MEAN_REVERTING = Model(
    "mean-reverting memory",
    "memory decays toward the prior mean (Ornstein-Uhlenbeck)",
    (Memory(), PEAK),
    Pull("logit_pull", 0.0, 1.0, funnel=True),
    propagator=MEAN_REVERSION,
)
# The peak 2 Phi(k) - 1 is uniform if and only if the criterion k is HalfNormal(1); the width is the noise of the difference.
DIFFERENCING = Model(
    "differencing", "signal detection: the difference against a criterion, with bias", (OFFSET, Width(), PEAK), link=differencing_link
)

#: From fewest parameters to most.
MODELS = (SYMMETRIC, CONSTANT_BIAS, DIFFERENCING, NO_LAPSES, PREDICTIVE_UPDATE, FREE_WEIGHTING, MEAN_REVERTING)
NAMES = (FREE_FREQUENCIES, *(model.name for model in MODELS))


def require_models(names: Sequence[str] | None) -> tuple[str, ...]:
    """The names asked for, in the order of the ladder; all of them by default.

    Raises
    ------
    InputError
        If a name is unknown, or none is left.
    """
    if names is None:
        return NAMES
    unknown = [name for name in names if name not in NAMES]
    if unknown or not names:
        raise InputError(f"models: {', '.join(map(repr, unknown)) or 'none given'}; allowed: {', '.join(NAMES)}")
    return tuple(name for name in NAMES if name in names)


def model_named(name: str) -> Model:
    """The record of a model.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    for model in MODELS:
        if model.name == name:
            return model
    raise InputError(f"model {name!r}; allowed: {', '.join(model.name for model in MODELS)}")


def prior_of(name: str, prior: Prior) -> str:
    """The prior of every parameter of a model, in words.

    Examples
    --------
    >>> prior_of("symmetric", Prior())
    'width ~ HalfNormal(1), q0 ~ Uniform(0, 1)'
    """
    return "every frequency ~ Uniform(0, 1)" if name == FREE_FREQUENCIES else model_named(name).describe(prior)


def knows_intervals(name: str) -> bool:
    """Whether a model says how an inter-stimulus interval acts.

    Examples
    --------
    >>> [name for name in NAMES if knows_intervals(name)]
    ['no lapses', 'predictive update', 'mean-reverting memory']
    """
    return name != FREE_FREQUENCIES and model_named(name).propagator is not None


def said_of_intervals(name: str) -> str:
    """What a model says of inter-stimulus intervals, in a few words.

    Examples
    --------
    >>> said_of_intervals("symmetric")
    'ignores the interval: a pair has the same P(equal) at every one'
    """
    return "one frequency for each pair at each interval" if name == FREE_FREQUENCIES else model_named(name).of_intervals


def model_posterior(subject: Subject, model: Model | str, prior: Prior | None = None) -> Target:
    """Posterior of one subject under a model of the ladder; for H1 the one with analytic derivatives.

    Where the subject has intervals, models with a propagator know them and the others ignore them; pairs are told apart in any case.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> model_posterior(subject, "constant bias").coordinates
    ('offset', 'log_width', 'logit_q0')
    """
    record = model_named(model) if isinstance(model, str) else model
    chosen = Prior() if prior is None else prior
    return posterior_of(subject, chosen) if record == PREDICTIVE_UPDATE else LadderPosterior(subject, record, chosen)


@dataclass(frozen=True, eq=False)
class LadderPosterior:
    """Log posterior of one subject under one record of the ladder, derivatives by central differences.

    Parameters
    ----------
    subject : Subject
    model : Model
    prior : Prior
    centre : float, optional
        Intensity from which the offset counts; the mean first stimulus by default.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0], [0.0, 0.3], [49, 20], [50, 50])
    >>> LadderPosterior(subject, SYMMETRIC).log_density([[-1.0, 2.0]]).shape
    (1,)
    """

    subject: Subject
    model: Model
    prior: Prior = field(default_factory=Prior)
    centre: float | None = None
    sbar: float = field(init=False)
    _counts: tuple[FloatArray, FloatArray] = field(init=False, repr=False)
    _parts: tuple[tuple[Block, slice], ...] = field(init=False, repr=False)
    _places: dict[str, int] = field(init=False, repr=False)
    _intervals: tuple[FloatArray, IndexArray] | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        subject, ends = self.subject, np.cumsum([0, *(len(block.coordinates) for block in self.model.free)]).tolist()
        for key, value in {
            "sbar": float(np.average(subject.s1, weights=subject.n_trials)) if self.centre is None else self.centre,
            "_counts": (subject.n_equal.astype(np.float64), (subject.n_trials - subject.n_equal).astype(np.float64)),
            "_parts": tuple((block, slice(i, j)) for block, i, j in zip(self.model.free, ends[:-1], ends[1:], strict=True)),
            "_places": {name: i for i, name in enumerate(self.model.coordinates)},
            "_intervals": None if subject.isi is None else grouped_intervals(subject.isi),
        }.items():
            object.__setattr__(self, key, value)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the unconstrained coordinates."""
        return self.model.coordinates

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        """Log posterior density at x, shape (points, k) -> (points,)."""
        return self.log_likelihood(x) + self.log_prior(x)

    def log_prior(self, x: npt.ArrayLike) -> FloatArray:
        """Log prior density at x, shape (points, k) -> (points,)."""
        points = require_points(x, len(self.coordinates))
        return np.asarray(sum(block.log_prior(points[:, part], self.prior, self.sbar) for block, part in self._parts))

    def sample_prior(self, rng: Random, size: int) -> FloatArray:
        """Independent draws from the prior, shape (size, k)."""
        return np.concatenate([block.sample(rng, size, self.prior, self.sbar) for block, _ in self._parts], axis=1)

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood at x, shape (points, k) -> (points,)."""
        points = require_points(x, len(self.coordinates))
        rows = max(1, _BLOCK // self.subject.n_pairs)
        return np.concatenate([self.pair_log_likelihood(points[i : i + rows]).sum(axis=1) for i in range(0, len(points), rows)])

    def pair_log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        """Log likelihood of each pair, shape (points, k) -> (points, pairs)."""
        # An answer never given contributes 0, also where its probability is 0.
        given = [
            np.where(counts > 0, counts * np.where(counts > 0, log_answer, 0.0), 0.0)
            for counts, log_answer in zip(self._counts, self.log_answers(x), strict=True)
        ]
        return np.asarray(given[0] + given[1])

    def log_answers(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Log P(equal) and log P(different) of every pair, (points, k) -> (points, pairs) each."""
        points = require_points(x, len(self.coordinates))
        peak = self._column(points, "logit_q0")
        return self.model.link(self.distance(points), np.full((len(points), 1), np.inf) if peak is None else peak)

    def distance(self, x: FloatArray) -> FloatArray:
        """Normalised distance z of every pair, (points, k) -> (points, pairs)."""
        subject, pull, offset, scale = self.subject, self.model.pull, self._column(x, "offset"), self._scales(x)
        shift = np.broadcast_to(subject.s2 - subject.s1, (len(x), subject.n_pairs))
        if pull is not None:
            pulled = pull.low + pull.span * expit(self._column(x, pull.coordinate))
            shift = shift + pulled * scale.pull * (subject.s1 - self.sbar)
        if offset is not None:
            shift = shift - offset * scale.pull
        with np.errstate(over="ignore", invalid="ignore"):  # a width below the smallest float leaves only exact equality at distance 0
            return np.where(shift == 0.0, 0.0, shift * (np.exp(-x[:, self._places["log_width"], None]) / scale.width))

    def _scales(self, x: FloatArray) -> Scales:
        """Pull and width of every pair over those at one second; one row and column of 1 where nothing depends on the interval."""
        if self._intervals is None or self.model.propagator is None:
            return UNSCALED
        seconds, which = self._intervals
        return self._scales_at(self.model.propagator, x, seconds).of_pairs(which)

    def _scales_at(self, propagator: Propagator, x: FloatArray, seconds: FloatArray) -> Scales:
        """Pull and width at intervals over those at one second, (points, k) and (intervals,) -> (points, intervals)."""
        return propagator.scales(*(x[:, self._places[name]] for name in propagator.coordinates), seconds)

    def derivatives(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Gradient (points, k) and Hessian (points, k, k) of the log posterior density."""
        return central_derivatives(self.log_density, require_points(x, len(self.coordinates)))

    def likelihood_derivatives(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (points, k) and Hessian (points, k, k) of the log likelihood alone."""
        return central_derivatives(self.log_likelihood, require_points(x, len(self.coordinates)))

    def starts(self) -> FloatArray:
        """A grid on the scale of the stimuli, shape (starts, k); points of density 0 are left out."""
        subject = self.subject
        steps = np.abs(subject.s2 - subject.s1)
        scale = float(np.sqrt(np.mean(steps[steps > 0] ** 2))) if np.any(steps > 0) else 0.3
        peak = float(logit(((subject.n_equal + 1.0) / (subject.n_trials + 2.0)).max()))
        axes = np.meshgrid(*(values for block in self.model.free for values in block.grid(scale, peak)))
        points = self._from_typical_interval(np.stack([axis.ravel() for axis in axes], axis=-1))
        return points[np.isfinite(self.log_density(points))]

    def _from_typical_interval(self, points: FloatArray) -> FloatArray:
        """Points whose offset and width are those at the typical interval, the geometric mean, with those at one second."""
        if self.model.propagator is None or self.subject.isi is None:
            return points
        typical = typical_interval(self.subject.isi, self.subject.n_trials)
        scale = self._scales_at(self.model.propagator, points, typical)
        return scale.to_one_second(points, self._places["offset"], self._places["log_width"])

    def levelling(self, modes: FloatArray) -> Levels:
        """Coordinates in which mixtures fit: the funnel of a free prior mean straightened, probits in the place of logits."""
        pull = self.model.pull
        if pull is not None and pull.funnel:
            return Levelling.at(self, modes, max_pull=pull.span)
        logits = tuple(i for name, i in self._places.items() if name.startswith("logit_"))
        return Probits(logits, self._places["log_width"])

    def for_subject(self, subject: Subject) -> LadderPosterior:
        """The same model for other answers, offsets counted from the same intensity."""
        return replace(self, subject=subject, centre=self.sbar)

    def judged(self, x: FloatArray) -> dict[str, FloatArray]:
        """Every named quantity, each with the shape of x without its last axis."""
        return {name: values for block, part in self._parts for name, values in block.named(x[..., part], self.sbar).items()}

    def _column(self, x: FloatArray, name: str) -> FloatArray | None:
        return x[:, self._places[name], None] if name in self._places else None
