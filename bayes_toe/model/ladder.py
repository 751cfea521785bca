"""The models by name: the ladder of a few that the field knows, the space of compositions that are compared, and any other composition.

Two levels of the order part know what an inter-stimulus interval does: pull and width are those at the reference interval, and the record's
propagator scales them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.free_frequencies import FREE_FREQUENCIES, FreeFrequencies
from bayes_toe.model.parts import NAMED, allowed_words, compose, composition, compositions, parts_of
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model

Record = Model | FreeFrequencies
#: What engines work on: a log density over unconstrained x with gradient, starts and levelling; and what gives probabilities of answers.
Target = Posterior


class TaskModels(NamedTuple):
    """The models of a task that have a role; the last three are the plain ones of each kind of order effect."""

    named: tuple[
        Record, ...
    ]  # those that have a name of their own, from fewest parameters to most, after free frequencies (H0)
    space: tuple[
        Model, ...
    ]  # what verdicts average over: is there an order effect and of which kind, whatever the other parts are
    symmetric: Model
    constant_bias: Model
    update: Model  # the paper's observer (H1)

    @property
    def compared(self) -> tuple[Record, ...]:
        """What `compare` compares by default."""
        return (FREE_FREQUENCIES, *self.space)


#: Levels of the order part of which a verdict is.
ORDERS = ("none", "constant error", "update")
#: Which levels the space of a task crosses beside those of the order; the others are its defaults.
CROSSED: Mapping[Task, Mapping[str, tuple[str, ...]]] = {
    SAME_DIFFERENT: {
        "noise": ("Weber", "sloped"),
        "lapses": ("misses", "both ways"),
        "curve": ("bell", "differencing"),
        "peak": ("one peak", "sloped peak"),
    },
    WHICH_STRONGER: {"noise": ("Weber", "sloped"), "lapses": ("guesses", "no lapses")},
}


@cache
def models_of(task: Task) -> TaskModels:
    """The models of a task.

    Examples
    --------
    >>> len(models_of(SAME_DIFFERENT).space), len(models_of(WHICH_STRONGER).space)
    (48, 12)
    """
    words = {
        word
        for levels in parts_of(task).values()
        for level in levels
        for word in (level.name, *level.also)
    }
    named = [composition(text, task) for text in NAMED if {*text.split(" + ")} <= words]
    plain = (compose(task, order=order) for order in ORDERS)
    return TaskModels(
        (FREE_FREQUENCIES, *named), compositions(task, order=ORDERS, **CROSSED[task]), *plain
    )


#: Of same or different.
MODELS, SPACE, SYMMETRIC, CONSTANT_BIAS, PREDICTIVE_UPDATE = models_of(SAME_DIFFERENT)
NAMES = tuple(model.name for model in MODELS)
#: Spaces of models that have a name.
SPACES = ("parts", "ladder")


def require_models(
    names: str | Sequence[str | Record], task: Task = SAME_DIFFERENT
) -> tuple[Record, ...]:
    """The models of a task asked for, each once: a space by its name, or models by theirs, those of a space in its order, then others."""
    if not isinstance(names, Iterable) or isinstance(names, Mapping):
        require_kind("models", names, str, f"names of models, or of a space: {', '.join(SPACES)}")
    known = models_of(task)
    if isinstance(names, str):
        spaces = dict(zip(SPACES, (known.compared, known.named), strict=True))
        return spaces[names] if names in spaces else (model_named(names, task),)
    if not names:
        raise InputError(
            f"models: none given; allowed: {', '.join(one.name for one in known.named)}, or {allowed_words(task)}"
        )
    asked = tuple(dict.fromkeys(model_named(name, task) for name in names))
    first = tuple(model for model in (*known.named, *known.compared) if model in asked)
    return tuple(dict.fromkeys((*first, *asked)))


def model_named(name: str | Record, task: Task = SAME_DIFFERENT) -> Record:
    """The record of a task's model by its name or its composition, or the record that was given.

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
    require_kind(
        "model", name, str, "a name or a composition, such as 'update + sloped + both ways'"
    )
    named = {model.name: model for model in models_of(task).named}
    if name in named:
        return named[name]
    try:
        return composition(name, task)
    except InputError as error:
        raise InputError(f"{error}; or: {', '.join(named)}") from error


def posterior_of(
    subject: Subject, prior: Prior | None = None, *, model: str | Record = PREDICTIVE_UPDATE.name
) -> Posterior:
    """Posterior of one subject under a model of the task, by default the predictive update (H1).

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> posterior_of(subject, model="constant bias").coordinates
    ('offset', 'log_width', 'logit_q0')
    """
    record = model_named(model, subject.task)
    if not isinstance(record, Model):
        raise InputError(f"model {record.name!r}: allowed are models with parameters")
    return record.posterior(subject, prior)
