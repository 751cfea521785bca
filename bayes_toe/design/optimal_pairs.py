"""The pairs that tell most about the effects of order, beside an even design of as many trials.

`optimal_design` finds them for a `DesignGoal`, and compares both designs by simulation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray, StrPath
from bayes_toe.checks.identification import TYPICAL_TRIALS, contraction_information
from bayes_toe.data.messages import join_words
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.stimulus_unit import LOG_UNITS, UNKNOWN_UNIT, StimulusUnit
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.data.validation import number
from bayes_toe.design.information import AIMS, exchange_trials, information
from bayes_toe.design.observers import Observer, assume_observers
from bayes_toe.design.power import PowerTable, power
from bayes_toe.design.study_design import (
    StudyDesign,
    all_pairs,
    each_once,
    log_levels,
    read_stimuli,
    to_logs,
)
from bayes_toe.errors import InputError, Remedy, require_number
from bayes_toe.model.observer import DEFAULT_PRIOR
from bayes_toe.model.parameters import ObserverPrior
from bayes_toe.model.prior import Prior
from bayes_toe.model.prior_file import preset_or_file
from bayes_toe.seeds import root_seed
from bayes_toe.workers import Progress, Workers

#: Names of the two designs that are compared.
OPTIMISED = "optimised"
EVEN = "even"
#: Most pairs that can be shown, and the levels that make so many: 141^2 = 19,881.
_MOST_PAIRS = 20_000
_MOST_LEVELS = 141
#: Fewest trials to distribute, and fewest different pairs of a design.
_FEWEST = 4


@dataclass(frozen=True, eq=False)
class DesignGoal:
    """The effect that a design must show, and the limits of its pairs.

    Parameters
    ----------
    aim : str
        "order-effect": to know constant error and contraction; "constant-error" or "contraction":
        one of them.
    max_pairs : int
        Different pairs.
    keep : StudyDesign, optional
        Pairs that stay, with at least their trials.
    task : Task or str
        What is asked; "2afc": which is stronger.
    is_even : bool
        Whether the design spreads the trials evenly over the range: each of the first stimuli with
        itself and its neighbours.
    """

    aim: str = "order-effect"
    max_pairs: int = 26
    keep: StudyDesign | None = None
    task: Task = SAME_DIFFERENT
    is_even: bool = False

    def __post_init__(self) -> None:
        if self.aim not in AIMS:
            raise InputError(f"--for: found {self.aim!r}, allowed: {', '.join(AIMS)}")
        require_number("--max-pairs", self.max_pairs, _FEWEST)
        if self.keep is not None and self.is_even:
            raise InputError("--even and --keep exclude each other.")


@dataclass(frozen=True, eq=False)
class OptimalDesign:
    """An optimised design, and an even design to compare it with.

    Attributes
    ----------
    designs : mapping of str to StudyDesign
        Both designs by name, first the one that is asked for.
    power : PowerTable
        The power of both designs, by simulation.
    unit : StimulusUnit
        The unit in which levels are shown.
    """

    designs: Mapping[str, StudyDesign]
    power: PowerTable
    unit: StimulusUnit = UNKNOWN_UNIT

    @property
    def name(self) -> str:
        """The name of the design that is asked for, which comes first."""
        return next(iter(self.designs))

    @property
    def design(self) -> StudyDesign:
        """The design that is asked for."""
        return self.designs[self.name]

    def reasons(self) -> list[str]:
        """The most frequent first stimuli, and what these pairs cannot show, in sentences."""
        stimuli, index = np.unique(self.design.s1, return_inverse=True)
        share = np.bincount(index, self.design.n_trials / self.design.total)  # (stimuli,)
        frequent = np.sort(np.argsort(-share)[:4])  # indices of four, in the order of intensity
        if self.unit.stimulus_unit:
            levels, unit_name = self.unit.numbers(stimuli[frequent], stimuli.mean())
        else:
            levels = [f"{value:g}" for value in stimuli[frequent]]
            unit_name = "ln"
        first_stimuli = ", ".join(
            f"{level} {unit_name} ({percent:.0f} %)"
            for level, percent in zip(levels, 100 * share[frequent], strict=True)
        )

        lines = []
        if self.name == OPTIMISED:
            lines.append(
                f"Most trials have these first stimuli: {first_stimuli}. Only first stimuli "
                "far apart distinguish a contraction from a constant error."
            )
        if contraction_information(self.design.unanswered) < 1.0:  # less than the prior has
            lines.append(
                f"These pairs cannot show a contraction: {TYPICAL_TRIALS} trials have less "
                "information about it than its prior. Use a wider range of first stimuli."
            )
        return lines

    @property
    def learnable(self) -> str:
        """A sentence on regularities that subjects may learn, which the model lacks, or ''.

        A regularity is that more than a third of the trials have equal pairs, or begin at an end of
        the range.
        """
        if self.name == EVEN:  # the design that the warning proposes
            return ""
        design = self.design
        ends = [design.s1.min(), design.s1.max()]
        regularities = {
            "have equal pairs": design.s1 == design.s2,
            "begin with the weakest or strongest stimulus": np.isin(design.s1, ends),
        }

        frequent = []
        for words, is_regular in regularities.items():  # is_regular has the shape (pairs,)
            n_trials = design.n_trials[is_regular].sum()
            if 3 * n_trials > design.total:
                frequent.append(f"{n_trials} of {design.total} trials {words}")
        if not frequent:
            return ""
        return f"{join_words(frequent)}. Subjects may learn this; the model does not include it."


def grid(lowest: float, highest: float, step: float) -> FloatArray:
    """Levels from lowest to highest; the highest is a level if whole steps lead to it.

    Examples
    --------
    >>> grid(-0.5, 0.6, 0.25).tolist()
    [-0.5, -0.25, 0.0, 0.25, 0.5]
    """
    n_steps = np.floor((highest - lowest) / step + 1e-9)  # rounding may make 3 steps 2.999...
    # Without the rounding errors of the steps, so that equal levels are equal. The sum turns -0.0
    # into 0.0.
    return np.round(lowest + step * np.arange(n_steps + 1), 12) + 0.0


def levels_between(
    lowest: float, highest: float, step: str | None, options: ReadOptions
) -> FloatArray:
    """Natural logs of levels, from the lowest to the highest stimulus in the unit of the options.

    A step such as '10' is a number in this unit. A step such as '5%' is per cent of intensity; it
    is adjusted so that both ends are levels. The default is 5 per cent, and in a log unit 0.05
    natural logs with one digit. Intensities have four digits at most.

    Examples
    --------
    >>> np.exp(levels_between(45.0, 213.0, "50%", ReadOptions(unit="um"))).round(6).tolist()
    [45.0, 66.37, 97.9, 144.4, 213.0]
    >>> levels_between(0.0, 20.0, "10", ReadOptions(unit="dB")).round(3).tolist()
    [0.0, 1.151, 2.303]
    """
    ends = f"--lowest {lowest:g} --highest {highest:g}"
    if not -np.inf < lowest < highest < np.inf:
        raise InputError(f"{ends}: allowed are finite numbers, the first the smaller one")
    log_ends = np.concatenate(to_logs(ends, [np.array([lowest]), np.array([highest])], options))

    if not step:
        step = "5%" if options.has_intensities else f"{0.05 / LOG_UNITS[options.unit or 'ln']:.1g}"
    size, is_percent = _read_step(step)
    width = np.ptp(log_ends) if is_percent else highest - lowest  # in the unit of the size
    smallest_size = width / (_MOST_LEVELS - 1)
    if not smallest_size <= size <= width:
        proposed = 1.01 * smallest_size  # still allowed when rounded to three digits
        remedy = f"{100.0 * np.expm1(proposed):.3g}%" if is_percent else f"{proposed:.3g}"
        raise InputError(
            f"--step {step}: allowed is a step that makes 2 to {_MOST_LEVELS} levels from "
            f"{lowest:g} to {highest:g}",
            [Remedy("step", remedy, "or a larger one")],
        )

    if is_percent:
        levels = np.linspace(log_ends[0], log_ends[1], round(width / size) + 1)
    else:
        levels = log_levels(grid(lowest, highest, size), options)
    # Intensities get four digits, such as 66.37. Two equal levels then become one level.
    if options.has_intensities:
        stimuli = [float(f"{value:.4g}") for value in options.stimulus_unit.to_stimuli(levels)]
        levels = np.unique(log_levels(np.array(stimuli), options))
    return levels


def _read_step(step: str) -> tuple[float, bool]:
    """The size of a step, and whether it is per cent of intensity: then a size in natural logs."""
    size = number(step.removesuffix("%"))
    if not size > 0.0:  # also NaN, which a text that is no number gives
        raise InputError(
            f"--step {step}: allowed is a number above 0 in the unit of the levels, or per cent of "
            "intensity, such as 5%"
        )
    if step.endswith("%"):
        return float(np.log1p(0.01 * size)), True
    return size, False


def read_levels(path: StrPath, options: ReadOptions) -> FloatArray:
    """Levels in the column s or i of a CSV file, in the unit of these options, as natural logs."""
    (column,), logs = read_stimuli(path, options, s_names=("s",), i_names=("i",))
    levels = np.unique(logs["s"])  # the logs of a column i have this name, too
    if len(levels) < 2:
        raise InputError(
            f"{path}: column {column}: found {len(levels)} level, allowed: at least two different "
            "ones"
        )
    return levels


def optimal_design(
    levels: FloatArray,
    trials: int = 650,
    goal: DesignGoal | None = None,
    observers: StrPath | Sequence[Observer] | None = None,
    *,
    data_sets: int = 32,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> OptimalDesign:
    """Find the design that is most informative about assumed observers.

    Both orders of two stimuli are equally frequent in the design. An even design of as many trials
    is compared with it by simulation.

    Parameters
    ----------
    levels : array, shape (levels,)
        Intensities that can be shown, natural log; see :func:`grid` and :func:`read_levels`.
    trials : int
    goal : DesignGoal, optional
    observers
        As :func:`bayes_toe.design.power.power` takes them.
    data_sets : int
        Simulated observers of each kind, by whom both designs are compared.
    seed, prior, workers, progress
        As :func:`bayes_toe.design.power.power` takes them.

    Raises
    ------
    InputError
        If something is not allowed.
    """
    goal = goal or DesignGoal()
    root = root_seed(seed)
    observer_prior = preset_or_file(prior).observer
    levels = np.unique(levels)
    plane = pairs_to_show(levels, goal)  # every pair that can be shown

    # Five observers of each kind are enough for the information, which changes smoothly with their
    # parameters. The power is a share of simulated answers, and needs more.
    assumed_observers = assume_observers(
        observers, size=5, seed=root, designs=[plane], prior=observer_prior
    )
    power_observers = assume_observers(
        observers, size=data_sets, seed=root, designs=[plane], prior=observer_prior, is_even=True
    )

    best = best_design(levels, trials, goal, assumed_observers, observer_prior)
    designs = {OPTIMISED: best}
    even = even_design(levels, goal, assumed_observers)
    if even.n_pairs <= trials:
        designs[EVEN] = even.with_total(trials)
    if goal.is_even:  # the design that is asked for comes first
        designs = dict(reversed(designs.items()))
    table = power(
        designs,
        [trials],
        power_observers,
        seed=root,
        prior=prior,
        workers=workers,
        progress=progress,
    )
    return OptimalDesign(designs, table)


def best_design(
    levels: FloatArray,
    trials: int,
    goal: DesignGoal,
    observers: Sequence[Observer],
    prior: ObserverPrior = DEFAULT_PRIOR,
) -> StudyDesign:
    """Find the most informative design of pairs of levels, without simulation."""
    require_number("--trials", trials)
    plane = pairs_to_show(levels, goal)  # every pair that can be shown
    fixed = np.zeros(plane.n_pairs, np.int64)  # trials of each pair that must be kept, (pairs,)
    if goal.keep is not None:
        fixed[[plane.pairs.index(pair) for pair in goal.keep.pairs]] = goal.keep.n_trials
    n_left = trials - int(fixed.sum())
    n_kept_pairs = int((fixed > 0).sum())
    if n_left < _FEWEST:
        keep_part = f", {fixed.sum()} of which --keep has taken" if n_kept_pairs else ""
        raise InputError(
            f"--trials {trials}{keep_part}: allowed is at least {_FEWEST} to distribute"
        )
    if n_kept_pairs >= goal.max_pairs:
        raise InputError(
            f"--max-pairs {goal.max_pairs}: --keep has {n_kept_pairs} already; allowed is more"
        )

    plane_information = information(plane, observers, goal.aim, prior)
    most_pairs = min(goal.max_pairs, n_left + n_kept_pairs)
    n_trials = exchange_trials(plane_information, n_left, most_pairs, fixed, plane.turned)
    chosen_pairs = np.flatnonzero(n_trials)
    return plane.select(chosen_pairs, n_trials[chosen_pairs])


def even_design(levels: FloatArray, goal: DesignGoal, observers: Sequence[Observer]) -> StudyDesign:
    """A design with first stimuli evenly over the range, each with itself and its neighbours, once.

    Neighbours differ by the mean noise of the observers if so many pairs are allowed.
    """
    noise = np.mean([observer.parameters["noise"] for observer in observers])
    n_steps = round(np.ptp(levels) / noise)
    # n first stimuli have n equal pairs, and n - 1 pairs of neighbours in each order: 3 n - 2.
    n_first = max(2, min(n_steps + 1, (goal.max_pairs + 2) // 3, len(levels)))
    targets = np.linspace(levels[0], levels[-1], n_first)
    # The index of the level nearest to each target. Where levels are uneven, two targets may have
    # the same nearest level, which then counts once.
    nearest = np.unique(np.abs(levels[:, None] - targets).argmin(axis=0))
    stimuli = levels[nearest]

    i, j = np.indices((len(stimuli), len(stimuli)))
    is_near = np.abs(i - j) <= 1  # equal stimuli and neighbours
    return each_once(stimuli[i[is_near]], stimuli[j[is_near]], task=goal.task)


def pairs_to_show(levels: FloatArray, goal: DesignGoal) -> StudyDesign:
    """The pairs that can be shown, once each: all ordered pairs of levels, and those to keep."""
    n = len(levels)
    if n**2 > _MOST_PAIRS:  # their information takes memory and time
        raise InputError(f"{n} levels make {n**2:,} pairs: allowed are {_MOST_PAIRS:,}")
    plane = all_pairs(levels, goal.task)
    if goal.keep is None:
        return plane
    pairs = np.unique(plane.pairs + goal.keep.pairs, axis=0)
    return each_once(*pairs.T, task=goal.task)
