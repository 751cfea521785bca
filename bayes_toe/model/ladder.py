"""The models by name: the ladder of a few that the field knows, the space of compositions that are compared, and any other composition.

Two levels of the order part know what an inter-stimulus interval does: pull and width are those at the reference interval, and the record's
propagator scales them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import overload

from bayes_toe.data.study import Subject
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.free_frequencies import FREE_FREQUENCIES, FreeFrequencies, FrequencyPosterior
from bayes_toe.model.parts import NAMED, allowed_words, composition, compositions
from bayes_toe.model.posterior import Model, Posterior
from bayes_toe.model.prior import Prior

Record = Model | FreeFrequencies

#: From fewest parameters to most, after H0.
SYMMETRIC, CONSTANT_BIAS, DIFFERENCING, NO_LAPSES, PREDICTIVE_UPDATE, FREE_WEIGHTING, MEAN_REVERTING = map(composition, NAMED)
MODELS: tuple[Record, ...] = (
    *(FREE_FREQUENCIES, SYMMETRIC, CONSTANT_BIAS, DIFFERENCING),
    *(NO_LAPSES, PREDICTIVE_UPDATE, FREE_WEIGHTING, MEAN_REVERTING),
)
NAMES = tuple(model.name for model in MODELS)
#: What is compared by default: is there an order effect and of which kind, whatever noise, lapses, curve and peak are.
SPACE = compositions(
    order=("none", "constant error", "update"),
    noise=("Weber", "sloped"),
    lapses=("misses", "both ways"),
    curve=("bell", "differencing"),
    peak=("one peak", "sloped peak"),
)
COMPOSED: tuple[Record, ...] = (FREE_FREQUENCIES, *SPACE)
#: Spaces of models by name.
SPACES = {"parts": COMPOSED, "ladder": MODELS}


def require_models(names: str | Sequence[str | Record]) -> tuple[Record, ...]:
    """The models asked for, each once: a space by its name, or models by theirs, those of a space in its order, then others.

    Raises
    ------
    InputError
        If a name is unknown, or there is none.
    """
    if not isinstance(names, Iterable) or isinstance(names, Mapping):
        require_kind("models", names, str, f"names of models, or of a space: {', '.join(SPACES)}")
    if isinstance(names, str):
        return SPACES[names] if names in SPACES else (model_named(names),)
    if not names:
        raise InputError(f"models: none given; allowed: {', '.join(NAMES)}, or {allowed_words()}")
    asked = tuple(dict.fromkeys(map(model_named, names)))
    first = tuple(model for model in (*MODELS, *COMPOSED) if model in asked)
    return tuple(dict.fromkeys((*first, *asked)))


def model_named(name: str | Record) -> Record:
    """The record of a model by its name or its composition, or the record that was given.

    Raises
    ------
    InputError
        If there is none of that name.

    Examples
    --------
    >>> model_named("symmetric").describe(Prior())
    'width ~ HalfNormal(1), q0 ~ Uniform(0, 1)'
    >>> model_named("update + sloped + both ways").coordinates
    ('offset', 'logit_pull', 'log_width', 'logit_q0', 'logit_lapse_rate', 'noise_slope')
    >>> [model.name for model in MODELS if model.knows_intervals]
    ['no lapses', 'predictive update', 'mean-reverting memory']
    """
    if isinstance(name, Record):
        return name
    require_kind("model", name, str, "a name or a composition, such as 'update + sloped + both ways'")
    for model in MODELS:
        if model.name == name:
            return model
    try:
        return composition(name)
    except InputError as error:
        raise InputError(f"{error}; or: {', '.join(NAMES)}") from error


@overload
def posterior_of(subject: Subject, prior: Prior | None = None) -> Posterior: ...
@overload
def posterior_of(subject: Subject, prior: Prior | None = None, *, model: str | Record) -> Posterior | FrequencyPosterior: ...
def posterior_of(
    subject: Subject, prior: Prior | None = None, *, model: str | Record = PREDICTIVE_UPDATE
) -> Posterior | FrequencyPosterior:
    """Posterior of one subject under a model, by default the predictive update (H1).

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> posterior_of(subject, model="constant bias").coordinates
    ('offset', 'log_width', 'logit_q0')
    """
    return model_named(model).posterior(subject, prior)
