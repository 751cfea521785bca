"""The models that can be sampled: the four of the observer, and the paper's (H1).

The four models of the observer (:mod:`bayes_toe.model.observer`) are 'none', 'constant error',
'contraction' and 'both'. An effect that a model does not have is held at 0. `ObserverPosterior` is
the posterior of one subject under one of these models.

`require_model` finds a model by the name that a user types, and `model_posterior` makes the
posterior by the name in files. The paper's model keeps the name 'predictive update' in files and in
the keys of its random streams.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import expit, logit

from bayes_toe.arrays import FloatArray, NamedArrays, Texts
from bayes_toe.data.conditions import StimulusScales
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import Task
from bayes_toe.errors import InputError, require_kind
from bayes_toe.model.answer_curves import criterion
from bayes_toe.model.observer import DEFAULT_PRIOR, JND_OVER_NOISE, ObserverRows
from bayes_toe.model.paper_model import PAPER_MODEL, PaperPosterior
from bayes_toe.model.parameters import (
    CONSTANT_ERROR,
    CONTRACTION,
    LOG_INTENSITY_UNIT,
    ORDER_MODELS,
    PER_LOG_INTENSITY,
    PURE_NUMBER,
    ObserverPrior,
    Parameter,
    lapse_logs,
    lapse_score,
    task_parameters,
)
from bayes_toe.model.posterior import Names, SubjectPosterior
from bayes_toe.model.prior import DEFAULT, Prior


@dataclass(frozen=True)
class OrderModel:
    """One of the four models of the observer, by its name in :data:`ORDER_MODELS`."""

    name: str

    @property
    def held_parameters(self) -> frozenset[Parameter]:
        """The order effects that the model does not have: they are held at 0."""
        return frozenset((CONSTANT_ERROR, CONTRACTION)).difference(ORDER_MODELS[self.name])

    def coordinates(self, task: Task) -> Texts:
        """Names of the coordinates of a task that are free in the model.

        Examples
        --------
        >>> from bayes_toe.data.tasks import WHICH_STRONGER
        >>> "contraction" in OrderModel("none").coordinates(WHICH_STRONGER)
        False
        """
        parameters = task_parameters(task)
        return tuple(
            parameter.name for parameter in parameters if parameter not in self.held_parameters
        )

    def posterior(
        self, subject: Subject, prior: ObserverPrior = DEFAULT_PRIOR
    ) -> ObserverPosterior:
        """The posterior of a subject under this model."""
        return ObserverPosterior(subject, self, prior)


@dataclass(frozen=True, eq=False)
class ObserverPosterior(SubjectPosterior):
    """The posterior of one subject under one of the four models.

    The coordinates are those that are free in the model, in the order of
    :func:`bayes_toe.model.parameters.task_parameters`.

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> posterior = OrderModel("both").posterior(subject)
    >>> "contraction" in posterior.coordinates
    True
    >>> posterior.log_density(np.zeros((3, len(posterior.coordinates)))).shape
    (3,)
    """

    subject: Subject
    model: OrderModel
    prior: ObserverPrior = DEFAULT_PRIOR
    given_scales: StimulusScales | None = None

    @property
    def model_name(self) -> str:
        """The name of the model."""
        return self.model.name

    @cached_property
    def scales(self) -> StimulusScales:
        """Location and scales of the stimuli: the given scales, or those of the subject."""
        return self.given_scales or self.subject.scales

    @property
    def sbar(self) -> float:
        """Mean first stimulus, natural-log intensity."""
        return self.scales.sbar

    @cached_property
    def rows(self) -> ObserverRows:
        """The counts, as one row."""
        return ObserverRows.from_subjects([self.subject], self.prior, [self.scales])

    @property
    def coordinates(self) -> Texts:
        """Names of the coordinates that the model has."""
        return self.model.coordinates(self.subject.task)

    def for_subject(self, subject: Subject) -> ObserverPosterior:
        """The same model with the same prior and scales for other answers or other pairs."""
        return replace(self, subject=subject, given_scales=self.scales)

    @cached_property
    def names(self) -> Names:
        """The names of the quantities."""
        derived = ("jnd", "zone") if "q0" in self.coordinates else ("jnd",)
        # The parameters are both what the model is written in and what the answers depend on.
        return Names(
            natural=self.coordinates,
            identified=self.coordinates,
            derived=derived,
            same_ranks={"jnd": "noise"},
        )

    def quantities(self, x: FloatArray) -> NamedArrays:
        """Every named quantity, each with the shape of x without its last axis.

        Quantities are in the unit of the subject's stimuli, natural-log intensity. The rows compute
        in units of D (`scales.step`). An effect that the model does not have is 0.
        """
        u = np.zeros((*x.shape[:-1], len(self.array.names)))  # all coordinates of the task
        u[..., self.is_free] = x
        values = self.rows.quantities(u)  # in D: "log_noise", "lapse_score" and so on

        step = self.scales.step
        log_lapse, _ = lapse_logs(values["lapse_score"], self.prior.lapse_rate_b)
        noise = step * np.exp(values["log_noise"])
        by_name = {
            "noise": noise,
            "lapse_rate": np.exp(log_lapse),
            "jnd": JND_OVER_NOISE * noise,
        }
        if "logit_q0" in values:
            by_name["q0"] = expit(values["logit_q0"])
            by_name["zone"] = criterion(values["logit_q0"]) * noise
        # The other parameters, slopes and effects, have their own names in `values`, too.
        factors = {LOG_INTENSITY_UNIT: step, PER_LOG_INTENSITY: 1.0 / step, PURE_NUMBER: 1.0}
        for parameter in task_parameters(self.subject.task):
            if parameter.name in values:
                by_name[parameter.name] = values[parameter.name] * factors[parameter.unit]
        # A factor of shape (1, 1), one row, may have added axes to the axes of x.
        return {name: by_name[name].reshape(x.shape[:-1]) for name in self.names.all}

    def points(self, quantities: NamedArrays) -> FloatArray:
        """Points, shape (..., k), from quantities of shape (...).

        The inverse of :meth:`quantities`.
        """
        step = self.scales.step
        prior = self.prior
        # A slope or an effect is its coordinate times a unit: the quantity at the coordinate 1.
        units = self.quantities(np.ones(len(self.coordinates)))
        columns = []
        for name in self.coordinates:
            values = np.asarray(quantities[name], np.float64)
            if name == "noise":
                columns.append(np.log(values / (step * prior.noise_median)) / prior.noise_sd)
            elif name == "q0":
                columns.append(logit(values))
            elif name == "lapse_rate":
                columns.append(lapse_score(values, prior.lapse_rate_b))
            else:
                columns.append(values / units[name])
        return np.stack(np.broadcast_arrays(*columns), axis=-1)


# --- Models by name ------------------------------------------------------------------------------

#: The names that users type.
_ALLOWED_NAMES = ", ".join([*ORDER_MODELS, "paper"]).replace("constant error", "constant-error")


def require_model(name: str) -> str:
    """The name in files of the model that a user types.

    Raises
    ------
    InputError
        For another name. A name in files is allowed, too.

    Examples
    --------
    >>> require_model("constant-error"), require_model("paper")
    ('constant error', 'predictive update')
    """
    require_kind("model", name, str, f"one of: {_ALLOWED_NAMES}")
    if name in ("paper", PAPER_MODEL):
        return PAPER_MODEL
    spaced = name.replace("-", " ")
    if spaced in ORDER_MODELS:
        return spaced
    raise InputError(f"model {name!r}: no such model; allowed: {_ALLOWED_NAMES}")


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
    >>> "contraction" in observer_posterior(subject).coordinates
    True
    """
    name = require_model(model)
    if name == PAPER_MODEL:
        raise InputError("model 'paper': its posterior is bt.model.paper_posterior(subject, prior)")
    return OrderModel(name).posterior(subject, prior.observer)


def model_posterior(
    name: str, subject: Subject, prior: Prior
) -> ObserverPosterior | PaperPosterior:
    """The posterior of one subject under the model that has this name in files.

    Raises
    ------
    InputError
        For another name, such as the name of a model of an earlier state.
    """
    if name == PAPER_MODEL:
        return PaperPosterior(subject, prior)
    return OrderModel(require_model(name)).posterior(subject, prior.observer)


def describe_prior(name: str, prior: Prior, task: Task) -> str:
    """The prior of every parameter of the model that has this name in files, in words."""
    if name == PAPER_MODEL:
        return prior.describe(task)
    return prior.observer.describe(task, OrderModel(name).held_parameters)
