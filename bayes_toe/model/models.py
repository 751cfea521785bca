"""The models that can be sampled, by name: the four of the observer, and the paper's.

The paper's model (H1) keeps the name 'predictive update' in files and in the keys of its random
streams.
"""

from __future__ import annotations

from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import Task
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.ladder import PREDICTIVE_UPDATE, models_of
from bayes_toe.model.observer import ObserverPosterior, OrderModel
from bayes_toe.model.parameters import ORDER_MODELS
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.model.record import Model

SampledModel = OrderModel | Model
#: The names to type.
MODEL_NAMES = (*(name.replace(" ", "-") for name in ORDER_MODELS), "paper")
#: Words of retired models, and the name to type instead; the first word that a name has decides.
_RETIRED = {
    "update": "paper",
    "mean-reverting": "paper",
    "free weighting": "both",
    "free frequencies": "both",
    "contraction": "both",
    "constant": "constant-error",
    "differencing": "constant-error",
    "offset": "constant-error",
    "symmetric": "none",
    "none": "none",
    "no lapses": "paper",
}


def require_model(name: str, task: Task) -> SampledModel:
    """The model of a task by the name that a user types.

    Raises
    ------
    InputError
        For another name; of a retired model with what to type instead.

    Examples
    --------
    >>> from bayes_toe.data.tasks import SAME_DIFFERENT
    >>> require_model("constant-error", SAME_DIFFERENT).name
    'constant error'
    >>> require_model("paper", SAME_DIFFERENT).name
    'predictive update'
    """
    require_kind("model", name, str, f"one of: {', '.join(MODEL_NAMES)}")
    if name == "paper":
        return models_of(task).update
    spaced = name.replace("-", " ")
    if spaced in ORDER_MODELS:
        return OrderModel(spaced)
    raise InputError(f"model {name!r}{_instead(name)}")


def _instead(name: str) -> str:
    """What to type in the place of a name that is no model."""
    for word, model in _RETIRED.items():
        if word in name.casefold():
            return f" is retired; type: --model {model} (in Python model={model!r})"
    return f": no such model; allowed: {', '.join(MODEL_NAMES)}"


def stored_model(name: str, task: Task) -> SampledModel:
    """The model of a task by the name that files and records have.

    Raises
    ------
    InputError
        For a model that an earlier version had.
    """
    if name in ORDER_MODELS:
        return OrderModel(name)
    if name == PREDICTIVE_UPDATE.name:
        return models_of(task).update
    raise InputError(f"model {name!r}{_instead(name)}")


def model_title(name: str) -> str:
    """How figures and tables call the model that has this name in files.

    Examples
    --------
    >>> model_title("both"), model_title("predictive update")
    ("model 'both'", "paper's model")
    """
    return "paper's model" if name == PREDICTIVE_UPDATE.name else f"model {name!r}"


def posterior_of(
    subject: Subject, prior: Prior = DEFAULT, *, model: str = "paper"
) -> ObserverPosterior | Posterior:
    """The posterior of one subject under a model, by default the paper's (H1).

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> posterior_of(subject, model="both").coordinates[-2:]
    ('constant_error', 'contraction')
    """
    return model_posterior(require_model(model, subject.task), subject, prior)


def model_posterior(
    model: SampledModel, subject: Subject, prior: Prior = DEFAULT
) -> ObserverPosterior | Posterior:
    """The posterior of one subject under a model."""
    if isinstance(model, OrderModel):
        return model.posterior(subject, prior.observer)
    return model.posterior(subject, prior)


def describe_prior(model: SampledModel, prior: Prior, task: Task) -> str:
    """The prior of every parameter of a model, in words."""
    if isinstance(model, OrderModel):
        return model.describe(prior.observer, task)
    return model.describe(prior)
