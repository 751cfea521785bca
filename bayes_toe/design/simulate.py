"""Synthetic studies from a design, observers and a seed.

`simulate` makes one. Observers follow one of the four models or the paper's model (H1). They may
differ between conditions, and carry an expectation over to the next trial.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import NamedTuple, TypeAlias, cast

import numpy as np
import pandas as pd

from bayes_toe.arrays import FloatArray, Record, Rng, StrPath, Texts
from bayes_toe.data.answers import Answers
from bayes_toe.data.conditions import Conditions
from bayes_toe.data.covariates import level_words
from bayes_toe.data.messages import quoted
from bayes_toe.data.read_study import Truth
from bayes_toe.data.stimulus_unit import StimulusUnit
from bayes_toe.data.study import Study, Subject, units_by_subject, with_shared_scales
from bayes_toe.data.tasks import SAME_DIFFERENT, Task, task_of
from bayes_toe.data.validation import CONDITION_SEPARATOR, number, read_numbers
from bayes_toe.design.observers import (
    KINDS,
    Observer,
    assume_observers,
    make_observer,
    parameter_names,
)
from bayes_toe.design.study_design import (
    PAPER_BATCHES,
    StudyDesign,
    full_design,
    read_study_design,
    reference_design,
    stimulus_columns,
)
from bayes_toe.errors import InputError, Remedy, require_number
from bayes_toe.model.paper_equations import (
    Natural,
    natural_names,
    p_counted,
    pull,
    require_natural,
)
from bayes_toe.model.trial_history import expectations
from bayes_toe.seeds import generator, root_seed

#: The population of observers of the paper's kinds.
PAPER = "paper"
POPULATIONS = (PAPER, *KINDS)
#: Parameters that may differ between conditions. A size is a difference, and for the noise a
#: difference of its logarithm.
DIFFERING = ("constant_error", "contraction", "noise")
_ALLOWED_DIFFERENCE = f"QUANTITY=SIZE of {', '.join(DIFFERING)}, separated by commas"
_DESIGNS: Mapping[str, Callable[..., StudyDesign]] = {
    "reference": reference_design,
    "full": full_design,
}
#: The size of the difference between conditions, by parameter.
Sizes: TypeAlias = Mapping[str, float]


# --- Observers of the paper's model ---------------------------------------------------------------


@dataclass(frozen=True)
class PaperObserver:
    """An observer of the paper's model (H1); the lapse rate takes the place of q0 in 2AFC.

    Attributes
    ----------
    name : str
    natural : Natural
        Its parameters, scalars.
    task : Task
    """

    name: str
    natural: Natural
    task: Task = SAME_DIFFERENT

    def __post_init__(self) -> None:
        require_natural(*self.natural)
        if self.task.has_three_answers:
            raise InputError(
                f"--observers: found those of the paper's model with the task {self.task.name!r}, "
                "of which it predicts only 'equal'; allowed: observers such as 'both'"
            )

    @property
    def parameters(self) -> dict[str, float]:
        """The natural parameters by name."""
        return dict(zip(natural_names(self.task), map(float, self.natural), strict=True))

    def p_trials(self, s1: FloatArray, s2: FloatArray, carry_over: float) -> FloatArray:
        """Probability of the counted answer in each trial, shape (1, trials): (questions, trials).

        `carry_over` is as in :meth:`bayes_toe.design.observers.Observer.p_trials`. What is
        expected, relative to the mean stimulus, is added to the prior mean mu1.
        """
        natural = self.natural
        if carry_over:
            mean = 0.5 * (s1.mean() + s2.mean())
            expected = expectations(s1 - mean, s2 - mean, pull(natural.gamma), carry_over)
            natural = natural._replace(mu1=natural.mu1 + expected)
        return p_counted(self.task, s1, s2, natural)[None]


def paper_population(size: int, rng: Rng, task: Task) -> list[PaperObserver]:
    """Observers of the paper's kinds in turn: A, B, C, B, A. Every sixteenth is inset C of Fig. 4.

    A: prior mean below the stimuli, mu1 ~ Normal(-0.5, 0.15); more accurate with the weaker
    stimulus first. B: above the stimuli, mu1 ~ Normal(0.95, 0.2); more accurate with the stronger
    first. C: among the stimuli, mu1 ~ Normal(0.25, 0.08); nearly symmetric. Inset C of Fig. 4: mu1
    = -0.6 but sigma_l = 0.02, so symmetric all the same. For all: sigma_p = 0.22 exp(0.15 Normal(0,
    1)), gamma ~ Uniform(0.1, 0.5), q0 ~ Beta(40, 4), or the lapse rate ~ Beta(2, 30).
    """
    # Mean and SD of mu1 for A, B, C, B and A, repeated until there are enough rows.
    mu1_of_kinds = [(-0.5, 0.15), (0.95, 0.2), (0.25, 0.08), (0.95, 0.2), (-0.5, 0.15)]
    mean, sd = np.resize(mu1_of_kinds, (size, 2)).T
    mu1 = rng.normal(mean, sd)
    sigma_p = 0.22 * np.exp(0.15 * rng.standard_normal(size))
    sigma_l = sigma_p * np.sqrt(rng.uniform(0.1, 0.5, size))  # gamma = (sigma_l / sigma_p)^2
    beta = (40.0, 4.0) if task == SAME_DIFFERENT else (2.0, 30.0)
    q0_or_lapse_rate = rng.beta(*beta, size)
    # Inset C of Fig. 4: the last of each sixteen.
    mu1[15::16] = -0.6
    sigma_l[15::16] = 0.02
    observers = zip(subject_names(size), mu1, sigma_p, sigma_l, q0_or_lapse_rate, strict=True)
    return [PaperObserver(name, Natural(*natural), task) for name, *natural in observers]


def subject_names(size: int) -> list[str]:
    """Names of so many subjects: S01, S02 and so on, all of the same length.

    Examples
    --------
    >>> subject_names(2), subject_names(100)[0]
    (['S01', 'S02'], 'S001')
    """
    width = max(2, len(str(size)))
    return [f"S{i + 1:0{width}d}" for i in range(size)]


# --- Conditions -----------------------------------------------------------------------------------


def simulated_conditions(levels: Sequence[str], sizes: Sizes) -> Conditions | None:
    """The conditions of these levels; None without levels. Bad levels and sizes are refused.

    Levels that are all numbers make a numeric condition.

    Examples
    --------
    >>> simulated_conditions(["left", "right"], {"contraction": 0.2}).levels
    ('left', 'right')
    """
    if isinstance(levels, str):
        raise InputError(f"conditions: found the text {levels!r}, allowed: a list of levels")
    if not levels:
        if sizes:
            raise InputError("--differ: allowed with --conditions, between which observers differ")
        return None

    numbers = list(map(number, levels))  # NaN for a text
    is_numeric = bool(np.isfinite(numbers).all())
    # Numbers are written in one way, so that '1' and '1.0' are the same level.
    names = tuple(level_words(numbers) if is_numeric else levels)
    # A unit is named such as 'S01@left', from which its level must be read again.
    can_be_read = all(name and CONDITION_SEPARATOR not in name for name in names)
    if len(names) < 2 or len(set(names)) < len(names) or not can_be_read:
        raise InputError(
            f"--conditions: found {quoted(','.join(levels))}, allowed: two levels and more, "
            f"each once, without {CONDITION_SEPARATOR}"
        )

    for name, size in sizes.items():
        if name not in DIFFERING or not np.isfinite(size):
            raise InputError(
                f"--differ: found {quoted(f'{name}={size:g}')}, allowed: {_ALLOWED_DIFFERENCE}"
            )
    return Conditions("condition", names, is_numeric)


def in_conditions(
    observer: SimulatedObserver, conditions: Conditions, sizes: Sizes
) -> dict[str, SimulatedObserver]:
    """An observer in every condition, by level, named such as S01@left.

    `sizes` has what differs between the first and the last level, by the names in
    :data:`DIFFERING`. A parameter of the observer has step * size added, and the noise is
    multiplied by exp(step * size). Steps go evenly from -1/2 at the first level to 1/2 at the last.
    If levels x are numbers, the steps are (x - mean)/range.
    """
    if sizes and isinstance(observer, PaperObserver):
        raise InputError(
            "--differ: allowed with observers of the four models, such as --observers both"
        )
    if conditions.numeric:
        steps = conditions.design()[:, 0]  # the only column of a numeric condition
    else:
        steps = np.linspace(-0.5, 0.5, len(conditions.levels))

    observers: dict[str, SimulatedObserver] = {}
    for level, step in zip(conditions.levels, steps.tolist(), strict=True):
        name = f"{observer.name}{CONDITION_SEPARATOR}{level}"
        if isinstance(observer, PaperObserver):  # the same in every condition
            observers[level] = replace(observer, name=name)
            continue
        parameters = dict(observer.parameters)
        for parameter, size in sizes.items():
            if parameter == "noise":  # its logarithm differs
                parameters[parameter] *= float(np.exp(step * size))
            else:
                parameters[parameter] += step * size
        observers[level] = replace(observer, name=name, parameters=parameters)
    return observers


def split_levels(text: str | None) -> list[str]:
    """The levels of `--conditions`: 'left, right' -> ['left', 'right']; none without a text."""
    return [] if text is None else [level.strip() for level in text.split(",")]


def read_differences(text: str | None) -> dict[str, float]:
    """The sizes of `--differ` by parameter; none without a text.

    Examples
    --------
    >>> read_differences("contraction=0.2,noise=0.3")
    {'contraction': 0.2, 'noise': 0.3}
    """
    sizes: dict[str, float] = {}
    if not text:
        return sizes
    for difference in text.split(","):
        name, _, value = map(str.strip, difference.partition("="))
        if name in sizes:
            raise InputError(f"--differ: found {name} twice, allowed: once")
        try:
            sizes[name] = float(value)
        except ValueError:
            raise InputError(
                f"--differ: found {quoted(difference)}, allowed: {_ALLOWED_DIFFERENCE}"
            ) from None
    return sizes


# --- Trials ---------------------------------------------------------------------------------------

SimulatedObserver: TypeAlias = "Observer | PaperObserver"


def answer_trials(
    observer: SimulatedObserver, design: StudyDesign, seed: int, carry_over: float = 0.0
) -> Answers:
    """Simulate one observer's answers to the trials of a design, a row a trial.

    The trials are shown in equal batches, as many as there can be, each in a random order. The
    random stream is keyed by the observer's name. `carry_over` is the share of what is expected
    after a trial that is carried over to the next one.
    """
    # At a share of 1, an expectation would never fade.
    require_number("--carry-over", carry_over, smallest=0, largest=0.999, kind=Real)
    rng = generator(seed, observer.name, "trials")

    # A batch has each pair as often as any other batch. Its random order sorts uniform numbers.
    pairs_of_batch = np.repeat(np.arange(design.n_pairs), design.n_trials // design.n_batches)
    order = np.argsort(rng.uniform(size=(design.n_batches, len(pairs_of_batch))), axis=1)
    pair = pairs_of_batch[order].ravel()  # the index of the pair of each trial, (trials,)
    s1 = design.s1[pair]
    s2 = design.s2[pair]

    probabilities = observer.p_trials(s1, s2, carry_over)  # (questions, trials)
    is_yes = rng.uniform(size=len(pair)) < probabilities[0]
    n_trials = np.ones(len(pair), int)  # each row is a trial
    columns = {"n_yes": is_yes.astype(int), "n_trials": n_trials, "place": np.arange(len(pair))}
    if observer.task.has_three_answers:  # 'second' or 'first', where the answer is not 'equal'
        is_second = rng.uniform(size=len(pair)) < probabilities[1]
        columns["n_second"] = (~is_yes & is_second).astype(int)
    return Answers(np.column_stack([s1, s2]), has_trial_rows=True, **columns)


# --- A study --------------------------------------------------------------------------------------


class Simulated(NamedTuple):
    """A synthetic study, and the true parameters of each of its subjects."""

    study: Study
    truth: Truth


def simulate(  # each is a choice of its own, and has a default
    observers: int | Truth = 16,
    *,
    population: str = "",
    design: str | StudyDesign = "reference",
    batches: int = PAPER_BATCHES,
    seed: int | None = None,
    task: Task | str = SAME_DIFFERENT,
    carry_over: float = 0.0,
    conditions: Sequence[str] = (),
    differ: Sizes | None = None,
) -> Simulated:
    """Simulate the responses of observers, as a study. `bayes-toe simulate` writes this study.

    Parameters
    ----------
    observers : int or mapping
        The number of observers, who are drawn from the population. Or the parameters of each
        observer by its name: noise, q0, lapse_rate, noise_slope, criterion_slope, constant_error
        and contraction. Those of the paper's model are mu1, sigma_p, sigma_l and q0 (lapse_rate in
        'which is stronger').
    population : str
        "paper", of the paper's model; "none", "small constant error", "large constant error",
        "contraction", "repulsion" or "both", of the four models; or a CSV file of
        parameters. By default "paper", or "both" with three answers.
    design : {"reference", "full"} or StudyDesign
        The paper's pairs, all ordered pairs of its stimuli, or pairs of your own.
    batches : int
        Repetitions of the whole set of pairs.
    seed : int, optional
        Root seed; without one, fresh entropy.
    task : Task or str
        "same/different", "2afc" (which of the two is stronger), or "ternary" (three answers).
    carry_over : float
        Share of what is expected after a trial that is carried over to the next.
    conditions : sequence of str
        Levels of a condition within subjects. Each subject meets all pairs at each level. The truth
        is then that of units such as 'S01@left'.
    differ : mapping, optional
        The difference between the first and the last condition in constant_error, contraction and
        noise (its logarithm): {"contraction": 0.2}.

    Raises
    ------
    InputError
        For an unknown word, or a number that is not allowed.

    Examples
    --------
    >>> study, truth = simulate(2, batches=10, seed=1)
    >>> study
    <Study 'simulated, seed 1', synthetic: 2 subjects ('S01', 'S02'), 260 trials>
    >>> simulate({"A": {"noise": 0.2, "q0": 0.95, "contraction": 0.3}}, batches=5).study.names
    ('A',)
    """
    task = task_of(task)
    root = root_seed(seed)
    study_design = make_design(design, batches)
    sizes = dict(differ or {})
    study_conditions = simulated_conditions(conditions, sizes)
    if isinstance(observers, Mapping):
        simulated_observers = _stated_observers(observers, task)
    else:
        require_number("observers", observers)
        if not population:  # the paper's model does not predict three answers
            population = "both" if task.has_three_answers else PAPER
        simulated_observers = draw_population(population, observers, root, study_design, task)

    subjects = []
    truth = {}
    for observer in simulated_observers:
        if study_conditions is None:
            by_condition = {"": observer}  # a single condition without a name
        else:
            by_condition = in_conditions(observer, study_conditions, sizes)
        for condition, unit in by_condition.items():
            answers = answer_trials(unit, study_design, root, carry_over)
            subject = Subject.from_answers(unit.name, answers, task)
            subjects.append(replace(subject, condition=condition))
            truth[unit.name] = dict(unit.parameters)
            if carry_over:
                truth[unit.name]["carry_over"] = carry_over

    study = Study(tuple(subjects), f"simulated, seed {root}", synthetic=True)
    if study_conditions is not None:
        # All conditions of a subject have the same scales, so that their parameters compare.
        study = replace(study, subjects=with_shared_scales(study), conditions=study_conditions)
    return Simulated(study, truth)


def draw_population(
    population: str, size: int, seed: int, design: StudyDesign, task: Task = SAME_DIFFERENT
) -> Sequence[SimulatedObserver]:
    """Observers of a population: 'paper', a kind of observers, or all of a CSV of parameters.

    `size` is their number, except for a file.
    """
    if population == PAPER:
        mean = design.unanswered.mean_first
        # These observers expect stimuli mu1 between about -1 and 2, see `paper_population`. So they
        # suit stimuli near the paper's reference, whose natural log is 0.
        if abs(mean) > 2.0:
            raise InputError(
                f"--observers paper: found stimuli about ln {mean:.3g}, far from those of the "
                "paper, ln 0 to 0.5",
                [Remedy("observers", "both", "observers for any stimuli")],
            )
        return paper_population(size, generator(seed, "population"), task)
    if population not in POPULATIONS:
        return read_observers(population, task)

    # These observers have names of their kind, such as 'both 1', and get the names of subjects.
    observers = assume_observers(population, size, seed, [replace(design, task=task)])
    names = subject_names(size)
    return [replace(observer, name=name) for name, observer in zip(names, observers, strict=True)]


def read_observers(path: str, task: Task) -> Sequence[SimulatedObserver]:
    """Observers of a CSV file with subject and parameters, of the four models or of the paper's."""
    require_file(path, "--observers", POPULATIONS)
    # All columns are optional: what an observer lacks is refused when it is made. Both models have
    # q0.
    names = dict.fromkeys((*natural_names(task), *parameter_names(task)))
    return _stated_observers(read_parameters(path, tuple(names)), task, path)


def read_parameters(path: StrPath, names: Texts, *, gaps: bool = False) -> Truth:
    """Parameters of each subject of a CSV file; those of `names` that the file has are read.

    With `gaps` cells may be empty, and their parameters are left out.
    """
    subjects, columns = read_numbers(path, names=(), key="subject", optional=names, gaps=gaps)
    truth = {}
    for i, subject in enumerate(subjects):
        values = {name: float(column[i]) for name, column in columns.items()}
        # An empty cell is NaN.
        truth[subject] = {name: value for name, value in values.items() if not np.isnan(value)}
    return truth


def _stated_observers(
    truth: Truth, task: Task, source: str = "observers"
) -> Sequence[SimulatedObserver]:
    """Observers of these parameters. With mu1, they are observers of the paper's model.

    `truth` has the parameters by the names of the observers. An error about the paper's model
    begins with the source.
    """
    if not truth:
        raise InputError(f"{source}: found none, allowed: at least one")

    allowed = natural_names(task)
    observers: list[SimulatedObserver] = []
    for name, parameters in truth.items():
        if "mu1" not in parameters:
            observers.append(make_observer(name, "stated", parameters, task))
            continue
        if set(parameters) != set(allowed):
            raise InputError(
                f"observer {name!r}: found {', '.join(parameters)}, allowed: {', '.join(allowed)}, "
                "all four"
            )
        natural = Natural(*(np.asarray(parameters[key], np.float64) for key in allowed))
        try:
            observers.append(PaperObserver(name, natural, task))
        except ArithmeticError as error:
            # The equations call the fourth parameter q0 in every task; in 2AFC it is a lapse rate.
            raise InputError(f"{source}: {str(error).replace('q0', task.lapses)}") from error
    return observers


def require_file(text: str, option: str, words: Iterable[str]) -> None:
    """Refuse a text that names no file; the message says which words are allowed, too."""
    if not os.path.isfile(text):  # a Path refuses names that are too long with an error of its own
        raise InputError(
            f"{option}: found {text!r}, allowed: {', '.join(words)}, or a CSV file that exists"
        )


# --- What the command is told in words and files --------------------------------------------------


def make_design(
    design: str | StudyDesign,
    batches: int,
    trials: int | None = None,
    unit: str | None = None,
) -> StudyDesign:
    """The design of `--design` and `--trials`, with stimuli in this unit.

    `design` is 'reference', 'full', or the name of a CSV file with s1,s2 or s1,s2,n_trials. A pair
    is shown `batches` times, if neither the file nor `trials`, their total, says how often.
    """
    if isinstance(design, StudyDesign):
        return design
    require_number("batches", batches)
    if design in _DESIGNS:
        if unit is not None:
            raise InputError("--unit: allowed with --design FILE.csv")
        study_design = _DESIGNS[design](batches=batches)
    else:
        require_file(design, "--design", _DESIGNS)
        study_design = read_study_design(design, unit=unit, batches=batches)
    return study_design if trials is None else study_design.with_total(trials)


def trial_frame(study: Study, design: StudyDesign, unit: StimulusUnit) -> pd.DataFrame:
    """The trials of a simulated study as a table that `bayes-toe` reads.

    The first batch of a subject comes in one condition after the other, then the second batch, and
    so on. The column `synthetic` marks the trials in every file.
    """
    words = np.array(study.task.answers)  # the counted answer comes first
    batch = np.repeat(np.arange(1, design.n_batches + 1), design.total // design.n_batches)

    frames = []  # of each subject
    for units in units_by_subject(study).values():
        frames_of_conditions = []
        for subject in units:
            answers = cast(Answers, subject.answers)
            columns: Record = {"subject": subject.subject_name}
            if subject.condition:
                columns["condition"] = subject.condition
            # Trials are numbered below, over all conditions; the column has its place here.
            columns |= {"batch": batch, "trial": 0}
            s1, s2 = answers.keys.T
            columns |= stimulus_columns(s1, s2, unit)
            word_index = 1 - answers.n_yes  # in each trial: 0 for the counted answer, else 1
            if answers.n_second is not None:  # 0 is 'equal', 1 'second', and 2 'first'
                word_index = np.where(answers.n_yes == 1, 0, 2 - answers.n_second)
            columns |= {"response": words[word_index], "synthetic": 1}
            frames_of_conditions.append(pd.DataFrame(columns))
        frame = pd.concat(frames_of_conditions)
        frame = frame.sort_values("batch", kind="stable", ignore_index=True)
        frames.append(frame.assign(trial=frame.index + 1))
    return pd.concat(frames, ignore_index=True)
