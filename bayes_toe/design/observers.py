"""Assumed observers: for whom a study is planned, and who answer in simulated studies.

`assume_observers` makes them from ranges, a prior, a file of draws or records.

An observer has the parameters of :mod:`bayes_toe.model.parameters`, in the unit of the stimuli
(natural-log intensity). Its contraction is to the mean first stimulus of the design that is shown.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray, StrPath
from bayes_toe.data.conditions import StimulusScales
from bayes_toe.data.messages import quoted
from bayes_toe.data.read_table import toml_table
from bayes_toe.data.study import Subject, pooled
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.design.study_design import StudyDesign, each_once
from bayes_toe.errors import InputError, require_number
from bayes_toe.model.answer_curves import log_questions
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.observer import DEFAULT_PRIOR
from bayes_toe.model.parameters import (
    ORDER_MODELS,
    PARAMETERS,
    ObserverPrior,
    format_value,
    real,
    task_parameters,
)
from bayes_toe.model.posterior import SubjectPosterior
from bayes_toe.model.trial_history import expectations
from bayes_toe.seeds import generator

Range = tuple[float, float]
#: Ranges of parameters by kind.
Kinds = Mapping[str, Mapping[str, Range]]
#: Parameters that an observer must have, where its task has them; all others are 0 by default.
REQUIRED = ("noise", "q0")
#: Ranges of what is not an effect of order; observers are uniform in them.
COMMON = {
    "noise": (0.15, 0.25),
    "q0": (0.85, 0.98),
    "lapse_rate": (0.0, 0.08),
}
#: The kinds of observers that are assumed where nothing else is asked for, with their effects.
KINDS: Kinds = {
    "none": {},
    "small constant error": {"constant_error": (0.05, 0.1)},
    "large constant error": {"constant_error": (0.2, 0.4)},
    "contraction": {"contraction": (0.2, 0.35)},
    "repulsion": {"contraction": (-0.35, -0.2)},
    "both": {"constant_error": (0.1, 0.3), "contraction": (0.2, 0.35)},
}
KINDS_IN_WORDS = (
    "Small: a PSE shift of 5 to 11 %; large: 22 to 49 %. Contraction, repulsion: 20 to 35 %."
)
#: The range with mean 0 and an SD of 10 %: the SD of a uniform number is its range over root 12.
_ABOUT_0 = (-0.17, 0.17)
#: Kinds for a group: subjects differ with an SD of 10 %, about a mean that the name says.
GROUP_KINDS = {
    "mean 0": {"constant_error": _ABOUT_0, "contraction": _ABOUT_0},
    "constant error 5 %": {"constant_error": (-0.12, 0.22), "contraction": _ABOUT_0},
    "constant error 10 %": {"constant_error": (-0.07, 0.27), "contraction": _ABOUT_0},
    "contraction 10 %": {"constant_error": _ABOUT_0, "contraction": (-0.07, 0.27)},
    "contraction 20 %": {"constant_error": _ABOUT_0, "contraction": (0.03, 0.37)},
}
#: The name of the source that has all kinds for a group.
GROUPS = "groups"
#: The source of observers that are drawn from the prior of the four models.
PRIOR = "prior"
_FORM = "sections such as [contraction] of NAME = NUMBER or NAME = [LOWEST, HIGHEST]"


@dataclass(frozen=True)
class Observer:
    """One assumed observer.

    Attributes
    ----------
    name : str
        Unique; random streams are keyed by it.
    kind : str
    parameters : mapping of str to float
        All parameters of the task, in the unit of the stimuli.
    task : Task
    """

    name: str
    kind: str
    parameters: Mapping[str, float]
    task: Task = SAME_DIFFERENT

    def __post_init__(self) -> None:
        problems = list(_problems(self.parameters, parameter_names(self.task)))
        if problems:
            raise InputError(f"observer {self.name!r}: {problem}" for problem in problems)

    def has_effect(self, question: str) -> bool:
        """Whether the observer truly has the effect that one of the three questions is about."""
        if question == "order_effect":
            return self.has_effect("constant_error") or self.has_effect("contraction")
        return self.parameters[question] != 0.0

    def p_questions(
        self,
        s1: npt.ArrayLike,
        s2: npt.ArrayLike,
        sbar: float,
        expected: FloatArray | float = 0.0,
    ) -> FloatArray:
        """Probability of the answer that each question of the task counts, (questions, *s1.shape).

        Parameters
        ----------
        s1, s2 : array_like
            Natural-log intensities.
        sbar : float
            Mean first stimulus, to which the observer contracts.
        expected : ndarray or float
            By how much the first stimulus is expected above sbar, after the trial before.
        """
        s1 = np.asarray(s1, np.float64)
        s2 = np.asarray(s2, np.float64)
        # The model has its parameters in units of the step D and the spread R of the stimuli. With
        # D = R = 1 they are in natural-log intensity, as the parameters of the observer are.
        scales = StimulusScales(mean=sbar, sbar=sbar, step=1.0, spread=1.0, first_spread=0.0)
        any_pair = each_once([0.0], [0.0], task=self.task)
        posterior = ObserverPosterior(any_pair.unanswered, OrderModel("both"), given_scales=scales)

        # The stimuli take the place of the pair of this posterior, (1, 1, stimuli). Its one point
        # is the observer, (1, 1, k).
        rows = replace(
            posterior.rows,
            first=(s1 - sbar - expected).reshape(1, 1, -1),
            difference=(s2 - s1).reshape(1, 1, -1),
            middle=(0.5 * (s1 + s2) - sbar).reshape(1, 1, -1),
        )
        parameters = {name: np.asarray(value) for name, value in self.parameters.items()}
        point = posterior.points(parameters).reshape(1, 1, -1)
        log_yes = [log_yes for log_yes, _ in log_questions(rows.log_answers(point))]
        return np.exp(log_yes).reshape(-1, *s1.shape)

    def p_trials(self, s1: FloatArray, s2: FloatArray, carry_over: float) -> FloatArray:
        """:meth:`p_questions` for trials in their order, (trials,) -> (questions, trials).

        `carry_over` is the share of what is expected after a trial that is carried over to the
        next one.
        """
        sbar = s1.mean()
        expected = expectations(s1 - sbar, s2 - sbar, self.parameters["contraction"], carry_over)
        return self.p_questions(s1, s2, sbar, expected)

    def p_design(self, design: StudyDesign) -> FloatArray:
        """:meth:`p_questions` for the pairs of a design, shape (questions, pairs)."""
        return self.p_questions(design.s1, design.s2, sbar=design.unanswered.mean_first)

    def answers(self, design: StudyDesign, seed: int) -> Subject:
        """Simulate the observer's answers to a design, as a subject with their counts.

        The random stream is keyed by the name of the observer and the number of trials.
        """
        rng = generator(seed, self.name, "answers", design.total)
        probabilities = self.p_design(design)  # (questions, pairs)
        n_yes = rng.binomial(design.n_trials, probabilities[0])
        n_second = None
        if self.task.has_three_answers:  # 'which was stronger?' follows an answer 'not equal'
            n_second = rng.binomial(design.n_trials - n_yes, probabilities[1])
        return design.answered(n_yes, self.name, n_second)


def parameter_names(task: Task) -> list[str]:
    """The parameters of an observer in a task."""
    return [parameter.name for parameter in task_parameters(task)]


def make_observer(name: str, kind: str, values: Mapping[str, float], task: Task) -> Observer:
    """An observer with these parameters. Others are 0, but those in :data:`REQUIRED` must be given.

    Raises
    ------
    InputError
        If a parameter is missing, unknown or out of its range.
    """
    names = parameter_names(task)
    for key in REQUIRED:
        if key in names and key not in values:
            raise InputError(f"observer {name!r}: {key} is missing")
    return Observer(name, kind, {**dict.fromkeys(names, 0.0), **values}, task)


def _problems(
    values: Mapping[str, object], names: Sequence[str], *, has_ranges: bool = False
) -> Iterator[str]:
    """Problems of parameters, a line each: unknown names, and numbers beyond the allowed limits.

    With `has_ranges` a value may be a range, [lowest, highest].
    """
    limits = {parameter.name: parameter.limits for parameter in PARAMETERS}
    for name, value in values.items():
        if name not in names:
            yield f"key {quoted(name)}: unknown, allowed: {', '.join(names)}"
            continue
        low, high = _range(value) if has_ranges else (real(value), real(value))
        lower_limit, upper_limit, description = limits[name]
        # A value that is no number is NaN, for which this comparison fails.
        if not lower_limit < low <= high < upper_limit:
            or_range = ", or [LOWEST, HIGHEST] of such" if has_ranges else ""
            yield f"{name}: found {format_value(value)}, allowed: a number {description}{or_range}"


# --- Sources of observers -------------------------------------------------------------------------


def assume_observers(
    source: StrPath | Sequence[Observer] | None,
    size: int,
    seed: int,
    designs: Sequence[StudyDesign],
    prior: ObserverPrior = DEFAULT_PRIOR,
    *,
    is_even: bool = False,
) -> Sequence[Observer]:
    """Assumed observers, `size` of each kind that the source has.

    Parameters
    ----------
    source : str, path or sequence of Observer, optional
        One of these; by default all of :data:`KINDS`:

        * the name of a kind in :data:`KINDS`, or 'groups' (:data:`GROUP_KINDS`);
        * a TOML file of the ranges of kinds;
        * draws of another study, posterior.nc, as written by `run` or `sample`;
        * 'prior', which has a kind for each of the four models;
        * observers, which are taken as they are.
    size : int
    seed : int
    designs : sequence of StudyDesign
        What will be shown, of one task.
    prior : ObserverPrior
        The prior from which observers 'prior' are drawn.
    is_even : bool
        Whether a parameter has evenly spaced values in its range, combined at random, and not
        random values. Their mean is then the middle of the range.

    Raises
    ------
    InputError
        For something else, or where all observers of a kind always answer alike.

    Examples
    --------
    >>> from bayes_toe.design.study_design import paper_study_design
    >>> some = assume_observers("both", 2, seed=1, designs=[paper_study_design()])
    >>> [observer.name for observer in some]
    ['both 1', 'both 2']
    """
    require_number("data_sets", size)
    task = designs[0].task
    if source == PRIOR:
        # The scales of the prior follow from the pairs of all designs together. So its observers
        # have noise that suits these stimuli, and the right task: they need none of the checks
        # below.
        pairs = pooled([design.unanswered for design in designs])
        return _from_prior(prior, pairs, size, seed)
    if source is not None and not isinstance(source, StrPath):
        observers = source
    elif source is not None and Path(source).suffix == ".nc":
        observers = _from_draws(Path(source), size, seed, task)
    else:
        observers = _in_ranges(_ranges_of(source, task), size, seed, task, is_even=is_even)

    for observer in observers:
        if observer.task != task:
            raise InputError(
                f"observer {observer.name!r}: found the task {observer.task.name!r}, allowed: "
                f"{task.name!r}, the task of the design"
            )
    for design in designs:
        _require_answers(observers, design)
    return observers


def _ranges_of(source: StrPath | None, task: Task) -> Kinds:
    """The ranges of each kind that a source names, or that its TOML file has."""
    if source is None:
        return KINDS
    if source == GROUPS:
        return GROUP_KINDS
    if source in KINDS:
        return {str(source): KINDS[str(source)]}
    if Path(source).suffix == ".toml":
        return read_ranges(source, task)
    raise InputError(
        f"--observers: found {str(source)!r}, allowed: {', '.join(KINDS)}, groups, prior, a "
        ".toml file of ranges, or draws (posterior.nc)"
    )


def _in_ranges(kinds: Kinds, size: int, seed: int, task: Task, *, is_even: bool) -> list[Observer]:
    """Observers of each kind, uniform in its ranges and, for other parameters, in `COMMON`.

    With `is_even` each range is cut into as many equal parts as there are observers, each of whom
    has the middle of one part. The parts of each parameter are shuffled.
    """
    common = {name: COMMON[name] for name in parameter_names(task) if name in COMMON}
    observers = []
    for kind, effects in kinds.items():
        ranges = {**common, **effects}
        # For each parameter, the part of its range that each observer has, from 0 to size - 1.
        parts = {key: generator(seed, kind, key, "even").permutation(size) for key in ranges}
        for i in range(size):
            name = f"{kind} {i + 1}"
            rng = generator(seed, name, "observer")
            values = {}
            for key, (low, high) in ranges.items():
                # The position in the range, from 0 to 1.
                position = (parts[key][i] + 0.5) / size if is_even else rng.uniform()
                values[key] = float(low + (high - low) * position)
            observers.append(make_observer(name, kind, values, task))
    return observers


def read_ranges(path: StrPath, task: Task = SAME_DIFFERENT) -> dict[str, dict[str, Range]]:
    """Ranges of each kind of observers from a TOML file; a number is a range of one value.

    A section is a kind, under any name.

    Raises
    ------
    InputError
        One line per problem of the file.
    """
    table = toml_table(path, _FORM)
    names = parameter_names(task)
    problems = [] if table else [f"found no kind of observers, allowed: {_FORM}"]

    kinds = {}
    for kind, section in table.items():
        if not isinstance(section, Mapping):
            problems.append(f"key {quoted(kind)}: allowed: {_FORM}")
            continue
        problems += [f"[{kind}]: {line}" for line in _problems(section, names, has_ranges=True)]
        kinds[kind] = {name: _range(value) for name, value in section.items()}
    if problems:
        raise InputError([f"{path}: {problem}" for problem in problems])
    return kinds


def _range(value: object) -> Range:
    """Lowest and highest value of a number or of [lowest, highest]; NaN for anything else."""
    ends = value if isinstance(value, list) else [value, value]
    if len(ends) != 2:
        return np.nan, np.nan
    low, high = map(real, ends)
    return low, high


def _from_prior(prior: ObserverPrior, pairs: Subject, size: int, seed: int) -> list[Observer]:
    """Observers drawn from the prior of each of the four models, whose name is their kind."""
    observers = []
    for model in ORDER_MODELS:
        posterior = OrderModel(model).posterior(pairs, prior)
        for number in range(1, size + 1):
            name = f"{model} {number}"
            x = posterior.sample_prior(generator(seed, name, "observer"), size=1)
            observers.append(_from_point(name, model, posterior, x))
    return observers


def _from_point(name: str, kind: str, posterior: SubjectPosterior, x: FloatArray) -> Observer:
    """The observer at a point, shape (1, k), of a posterior."""
    quantities = posterior.quantities(x)
    values = {key: float(quantities[key][0]) for key in posterior.names.natural}
    return make_observer(name, kind, values, posterior.subject.task)


def _from_draws(path: Path, size: int, seed: int, task: Task) -> list[Observer]:
    """Observers like random subjects in a posterior.nc, then a copy of each without effects.

    The `size` observers of the kind 'earlier study' are at random draws. Their copies, of the kind
    'none', have no constant error and no contraction. They are for false positives.
    """
    from bayes_toe.inference.draws import load_draws

    draws = load_draws(path)
    if draws.task != task:
        raise InputError(
            f"{path}: draws of the task {draws.task.name!r}, allowed: those of {task.name!r}"
        )
    if draws.model not in ORDER_MODELS:
        raise InputError(
            f"{path}: draws of the model {draws.model!r}, allowed: those of "
            f"{', '.join(ORDER_MODELS)} (bayes-toe sample --model both)"
        )

    observers = []
    copies_without_effects = []
    for number in range(1, size + 1):
        rng = generator(seed, "earlier study", number, "observer")
        subject = draws.names[rng.integers(len(draws.names))]
        points = np.concatenate(draws.points(subject))  # of all chains, (draws, k)
        x = points[[rng.integers(len(points))]]  # one point, shape (1, k)
        name = f"earlier study {number}"
        observer = _from_point(name, "earlier study", draws.posterior(subject), x)
        observers.append(observer)
        no_effects = {**observer.parameters, "constant_error": 0.0, "contraction": 0.0}
        copies_without_effects.append(Observer(f"none {number}", "none", no_effects, task))
    return observers + copies_without_effects


def _require_answers(observers: Sequence[Observer], design: StudyDesign) -> None:
    """Refuse a design to which all observers of a kind always answer alike, but for lapses.

    The stimuli are then in another unit than the observers' noise.
    """
    p_yes = defaultdict(list)  # by kind, P of the counted answer of each observer, (pairs,)
    for observer in observers:
        attentive_observer = replace(
            observer, parameters={**observer.parameters, "lapse_rate": 0.0}
        )
        p_first_question, *_ = attentive_observer.p_design(design)
        p_yes[observer.kind].append(p_first_question)

    task = design.task
    for kind, p_of_kind in p_yes.items():
        highest_p = {task.yes: np.max(p_of_kind), task.no: 1.0 - np.min(p_of_kind)}
        for answer, highest in highest_p.items():
            if highest <= 0.01:  # the other answer is practically certain
                raise InputError(
                    f"observers: of the kind {kind!r} all practically never answer {answer!r} to "
                    "these pairs, which then show no effect; allowed: --observers people.toml with "
                    "noise and effects in the unit of the stimuli"
                )
