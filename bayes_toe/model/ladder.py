"""A ladder of models of the same answers, each a small record over the one posterior (:mod:`bayes_toe.model.posterior`).

Two of them know what an inter-stimulus interval does: pull and width are those at the reference
interval, and the record's propagator scales them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.free_frequencies import FREE_FREQUENCIES, FreeFrequencies, FrequencyPosterior
from bayes_toe.model.links import DIFFERENCING as DIFFERENCING_LINK
from bayes_toe.model.parameters import Memory, Share, Shift, Update, Width
from bayes_toe.model.posterior import Model, Posterior, Pull
from bayes_toe.model.prior import Prior
from bayes_toe.model.propagators import MEAN_REVERSION, RANDOM_WALK

Record = Model | FreeFrequencies

#: q0, or the peak of the differencing model: uniform, as each frequency under H0.
PEAK = Share("q0")
#: Offset at the mean first stimulus: one log unit is a factor of e in intensity, far beyond constant errors that are found.
OFFSET = Shift(1.0)
#: Weight of the first stimulus, from none to twice that of the second, around "no effect" at 1 without preference.
GAIN = Share("gain", top=2.0, starts=(-0.8, 0.4))
_OF_UPDATE = Pull("logit_pull", 0.0, MAX_PULL, centre="mu1")

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
    Pull("logit_gain", 1.0, -2.0),  # p = 1 - K, K = 2 expit
)
MEAN_REVERTING = Model(
    "mean-reverting memory",
    "memory decays toward the prior mean (Ornstein-Uhlenbeck)",
    (Memory(), PEAK),
    Pull("logit_pull", 0.0, 1.0, centre="mu1"),
    propagator=MEAN_REVERSION,
)
# The peak 2 Phi(k) - 1 is uniform if and only if the criterion k is HalfNormal(1); the width is the noise of the difference.
DIFFERENCING = Model(
    "differencing", "signal detection: the difference against a criterion, with bias", (OFFSET, Width(), PEAK), link=DIFFERENCING_LINK
)

#: From fewest parameters to most, after H0.
MODELS: tuple[Record, ...] = (
    *(FREE_FREQUENCIES, SYMMETRIC, CONSTANT_BIAS, DIFFERENCING),
    *(NO_LAPSES, PREDICTIVE_UPDATE, FREE_WEIGHTING, MEAN_REVERTING),
)
NAMES = tuple(model.name for model in MODELS)


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


def model_named(name: str | Record) -> Record:
    """The record of a model, or the record that was given.

    Raises
    ------
    InputError
        If there is none of that name.

    Examples
    --------
    >>> model_named("symmetric").describe(Prior())
    'width ~ HalfNormal(1), q0 ~ Uniform(0, 1)'
    >>> [model.name for model in MODELS if model.knows_intervals]
    ['no lapses', 'predictive update', 'mean-reverting memory']
    """
    for model in MODELS:
        if name in (model, model.name):
            return model
    if isinstance(name, Record):
        return name
    raise InputError(f"model {name!r}; allowed: {', '.join(NAMES)}")


@overload
def posterior_of(subject: Subject, prior: Prior | None = None) -> Posterior: ...
@overload
def posterior_of(subject: Subject, prior: Prior | None = None, *, model: str | Record) -> Posterior | FrequencyPosterior: ...
def posterior_of(
    subject: Subject, prior: Prior | None = None, *, model: str | Record = PREDICTIVE_UPDATE
) -> Posterior | FrequencyPosterior:
    """Posterior of one subject under a model of the ladder, by default the predictive update (H1).

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> posterior_of(subject, model="constant bias").coordinates
    ('offset', 'log_width', 'logit_q0')
    """
    return model_named(model).posterior(subject, prior)
