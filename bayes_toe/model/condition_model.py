"""One observer in several conditions: some parameters differ between them, others are shared.

`ConditionModels` has the posteriors. D is the root mean square step and R the standard deviation
of all stimuli.

The coordinates u are those of the observer 'both' (:mod:`bayes_toe.model.parameters`). Where a
parameter differs, its coordinate in condition i is

    u_i = u + h unit X_i a,    a ~ N(0, I),    h = 1/2,

with row i of the design X of :meth:`bayes_toe.data.conditions.Conditions.design`. Any two levels
then differ by N(0, (h unit)^2), whichever is the reference. The units, and the prior SDs of a
difference between two levels, are

    constant error   D/2                      D/4
    contraction      0.25                     0.125; less where first stimuli are roved
    noise            1 of log sigma_d         0.5 of log sigma_d
    lapse rate       1 of its normal score    0.5 of its normal score
    q0               1.2 of its logit         0.6 of its logit

The mean first stimulus sbar and the scales D and R come from all conditions: otherwise c would move
with the stimuli of a condition. The evidence is one integral over all conditions. If nothing
differs, it is the evidence of the pooled answers.

The conditions may be tasks. Then one observer does all tasks, and has one criterion in the tasks
with the answer 'equal'. Only parameters of all tasks can differ.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bayes_toe.arrays import FloatArray, NamedArrays
from bayes_toe.data.study import Subject, common_scales, pooled
from bayes_toe.model.densities import StandardNormal
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.observer import DEFAULT_PRIOR, ObserverRows
from bayes_toe.model.parameters import (
    CONSTANT_ERROR,
    CONTRACTION,
    LAPSE_RATE,
    NOISE,
    ORDER_MODELS,
    PEAK,
    ObserverPrior,
    Parameter,
    Parameters,
    task_parameters,
)
from bayes_toe.model.posterior_array import LinearLikelihood, PosteriorArray, loading_of

#: Prior standard deviation of the difference between two levels, h unit: of the parameter's
#: coordinate, but for the noise of log sigma_d.
DIFFERENCE_SDS: Mapping[Parameter, float] = {
    CONSTANT_ERROR: 0.5,
    CONTRACTION: 0.5,
    NOISE: 0.5,
    LAPSE_RATE: 0.5,
    PEAK: 0.6,
}


@dataclass(frozen=True, eq=False)
class ConditionModels:
    """The posteriors of a subject's conditions, one for each choice of the differing parameters.

    Points have the k coordinates of the observer 'both', then a coordinate for each parameter that
    may differ and each column of the design.

    Attributes
    ----------
    units : tuple of Subject
        The answers in each condition.
    design : ndarray, shape (conditions, columns)
    prior : ObserverPrior

    Examples
    --------
    >>> left = Subject("S@left", [0.0, 0.3], [0.3, 0.0], [5, 9], [20, 20], condition="left")
    >>> right = Subject("S@right", [0.0, 0.3], [0.3, 0.0], [15, 9], [20, 20], condition="right")
    >>> models = ConditionModels((left, right), np.array([[-0.5], [0.5]]))
    >>> posteriors = models.posteriors([(), (CONTRACTION,)])
    >>> posteriors.is_free[:, posteriors.names.index("contraction 1")].tolist()
    [False, True]
    """

    units: tuple[Subject, ...]
    design: FloatArray
    prior: ObserverPrior = DEFAULT_PRIOR

    @cached_property
    def units_by_task(self) -> list[list[int]]:
        """The positions of the units of each task; a task that has a criterion comes first."""
        positions = defaultdict(list)
        for i, unit in enumerate(self.units):
            positions[unit.task].append(i)
        # A task without a criterion has fewer parameters, and the first task must have all of them:
        # `parameters` and `loading` are those of the first task.
        tasks = sorted(positions, key=lambda task: not task.has_criterion)
        return [positions[task] for task in tasks]

    @cached_property
    def subject(self) -> Subject:
        """All answers of the subject; with several tasks, all answers to the first task."""
        subject = pooled([self.units[i] for i in self.units_by_task[0]])
        if len(self.units_by_task) == 1:
            return subject
        # The scales come from the answers to all tasks, and so from all units.
        return replace(subject, shared_scales=common_scales(*self.units))

    @cached_property
    def shared_observer(self) -> ObserverPosterior:
        """The posterior of the answers of :attr:`subject`, where nothing differs."""
        return OrderModel("both").posterior(self.subject, self.prior)

    @cached_property
    def parameters(self) -> Parameters:
        """The parameters of all tasks, in the order of the coordinates."""
        return task_parameters(self.subject.task)

    @cached_property
    def differing_parameters(self) -> Parameters:
        """The parameters that may differ between units, because all tasks have them."""
        tasks = {unit.task for unit in self.units}
        return tuple(parameter for parameter in DIFFERENCE_SDS if tasks.issubset(parameter.tasks))

    @cached_property
    def loading(self) -> FloatArray:
        """The loading L of each condition, u = L w, (conditions, k, d).

        u are the k coordinates of the observer, and w the d coordinates of a posterior.
        """
        unit_column = np.ones((len(self.design), 1))
        columns = [(parameter.name, unit_column) for parameter in self.parameters]  # shared
        for parameter in self.differing_parameters:
            sd = DIFFERENCE_SDS[parameter]
            if parameter == NOISE:
                sd /= self.prior.noise_sd  # a unit of its coordinate is noise_sd of log sigma_d
            columns.append((parameter.name, sd * self.design))
        return loading_of([parameter.name for parameter in self.parameters], columns)

    def _likelihood(self, positions: Sequence[int]) -> LinearLikelihood:
        """The likelihood of the answers of some units, which have one task."""
        units = [self.units[i] for i in positions]
        rows = ObserverRows.from_subjects(
            units, self.prior, [self.shared_observer.scales] * len(units)
        )
        # The task of these units may have fewer parameters than the first task.
        is_of_task = np.isin([parameter.name for parameter in self.parameters], rows.coordinates)
        loading = self.loading[positions][:, is_of_task]
        # All rows belong to one posterior.
        return LinearLikelihood(rows, loading, np.zeros(1, np.intp))

    def posteriors(self, choices: Sequence[Collection[Parameter]]) -> PosteriorArray:
        """A posterior for each choice of the parameters that differ between the conditions."""
        # One likelihood for each task. The first likelihood has the further likelihoods as a part.
        first_task, *further_tasks = map(self._likelihood, self.units_by_task)
        likelihood = replace(first_task, further_tasks=tuple(further_tasks))
        # Every choice has this one likelihood, which has the index 0.
        repeated = likelihood.part(np.zeros(len(choices), np.intp))

        # After the observer's coordinates: 'contraction 1', 'contraction 2', one for each column.
        names = [parameter.name for parameter in self.parameters]
        further_parameters = []  # of each further coordinate
        for parameter in self.differing_parameters:
            for i in range(self.design.shape[1]):
                names.append(f"{parameter.name} {i + 1}")
                further_parameters.append(parameter)

        is_free = np.ones((len(choices), len(names)), np.bool_)
        for i, choice in enumerate(choices):
            is_free[i, len(self.parameters) :] = [
                parameter in choice for parameter in further_parameters
            ]
        further_priors = (StandardNormal(),) * len(further_parameters)
        return PosteriorArray(repeated, tuple(names), further_priors, is_free)

    @property
    def posteriors_without_differences(self) -> PosteriorArray:
        """The posteriors of the four models for a design without columns: nothing differs."""
        posteriors = self.posteriors([()] * len(ORDER_MODELS))
        task = self.subject.task
        is_free = [
            np.isin(posteriors.names, OrderModel(name).coordinates(task)) for name in ORDER_MODELS
        ]
        return replace(posteriors, is_free=np.array(is_free))

    def quantities(self, points: FloatArray) -> NamedArrays:
        """The observer's quantities in each condition, natural units, (conditions, points) each."""
        return self.shared_observer.quantities(points @ self.loading.swapaxes(1, 2))
