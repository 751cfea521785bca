"""The models that can be sampled, by name: the four of the observer, and the paper's.

`require_model` finds a model by the name that a user types, `stored_model` by its name in files,
and `model_posterior` makes a posterior.

The paper's model (H1) keeps the name 'predictive update' in files and in the keys of its random
streams.
"""

from __future__ import annotations

from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import Task
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.order_models import ObserverPosterior, OrderModel
from bayes_toe.model.paper_model import PAPER_MODEL, PaperModel, PaperPosterior
from bayes_toe.model.parameters import ORDER_MODELS
from bayes_toe.model.prior import DEFAULT, Prior

SampledModel = OrderModel | PaperModel
#: The names to type.
MODEL_NAMES = (*(name.replace(" ", "-") for name in ORDER_MODELS), "paper")
#: Former names of the paper's model.
_PAPER_NAMES = ("paper", "update", "predictive update", "predictive-update")


def require_model(name: str, task: Task) -> SampledModel:
    """The model of a task by the name that a user types.

    Raises
    ------
    InputError
        For another name.

    Examples
    --------
    >>> from bayes_toe.data.tasks import SAME_DIFFERENT
    >>> require_model("constant-error", SAME_DIFFERENT).name
    'constant error'
    >>> require_model("paper", SAME_DIFFERENT).name
    'predictive update'
    """
    require_kind("model", name, str, f"one of: {', '.join(MODEL_NAMES)}")
    if name in _PAPER_NAMES:
        return PaperModel(task)
    spaced = name.replace("-", " ")
    if spaced in ORDER_MODELS:
        return OrderModel(spaced)
    raise InputError(f"model {name!r}: no such model; allowed: {', '.join(MODEL_NAMES)}")


def stored_model(name: str, task: Task) -> SampledModel:
    """The model of a task by the name that files and records have.

    Raises
    ------
    InputError
        For another name, such as that of a model of an earlier state.
    """
    if name in ORDER_MODELS:
        return OrderModel(name)
    if name == PAPER_MODEL:
        return PaperModel(task)
    raise InputError(f"model {name!r}: no such model; allowed: {', '.join(MODEL_NAMES)}")


def model_title(name: str) -> str:
    """The name in figures and tables of the model that has this name in files.

    Examples
    --------
    >>> model_title("both"), model_title("predictive update")
    ("model 'both'", "paper's model")
    """
    return "paper's model" if name == PAPER_MODEL else f"model {name!r}"


def observer_posterior(
    subject: Subject, prior: Prior = DEFAULT, *, model: str = "both"
) -> ObserverPosterior:
    """The posterior of one subject under one of the four models of the observer.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> observer_posterior(subject).coordinates[-2:]
    ('constant_error', 'contraction')
    """
    order_model = require_model(model, subject.task)
    if isinstance(order_model, PaperModel):
        raise InputError("model 'paper': its posterior is bt.model.paper_posterior(subject, prior)")
    return order_model.posterior(subject, prior.observer)


def model_posterior(
    model: SampledModel, subject: Subject, prior: Prior = DEFAULT
) -> ObserverPosterior | PaperPosterior:
    """The posterior of one subject under a model."""
    if isinstance(model, OrderModel):
        return model.posterior(subject, prior.observer)
    return model.posterior(subject, prior)


def describe_prior(model: SampledModel, prior: Prior, task: Task) -> str:
    """The prior of every parameter of a model, in words."""
    if isinstance(model, OrderModel):
        return model.describe(prior.observer, task)
    return prior.describe(task)
