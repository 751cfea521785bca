"""The pairs that tell most about the effects of order, beside other designs of as many trials.

`optimal_design` finds them for a `DesignGoal`, and compares the design with others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray, StrPath
from bayes_toe.checks.identification import TYPICAL_TRIALS, contraction_information
from bayes_toe.data.options import ReadOptions
from bayes_toe.data.stimulus_unit import LOG_UNITS, UNKNOWN_UNIT, StimulusUnit
from bayes_toe.data.tasks import SAME_DIFFERENT, Task, task_of
from bayes_toe.data.validation import read_numbers
from bayes_toe.design.information import AIMS, exchange_trials, information
from bayes_toe.design.observers import Observer, assume_observers
from bayes_toe.design.power import PowerTable, observer_prior, simulate_power
from bayes_toe.design.study_design import (
    StudyDesign,
    all_pairs,
    each_once,
    paper_study_design,
)
from bayes_toe.errors import InputError
from bayes_toe.model.observer import DEFAULT_PRIOR
from bayes_toe.model.parameters import CONSTANT_ERROR, ObserverPrior
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd

#: Names of the designs that are compared.
OPTIMISED, PAPER = "optimised", "the paper's pairs"
FULL, RANDOM = "full factorial", "random pairs"
#: Observers of each kind for whom a design is made, and data sets of each by which it is judged.
ASSUMED, SIMULATED = 5, 16
_MOST_PAIRS = 20_000  # that can be shown
_FEWEST = 4  # trials, and pairs
_LEVELS = 5  # of the full factorial


@dataclass(frozen=True, eq=False)
class DesignGoal:
    """The goal of a design.

    Parameters
    ----------
    aim : str
        "order-effect": to know constant error and contraction; "constant-error" or "contraction":
        one of them.
    max_pairs : int
        Different pairs.
    keep : StudyDesign, optional
        Pairs that stay, with at least their trials.
    task : Task
        What is asked; "2afc": which is stronger.
    """

    aim: str = "order-effect"
    max_pairs: int = 26
    keep: StudyDesign | None = None
    task: Task = SAME_DIFFERENT

    def __post_init__(self) -> None:
        object.__setattr__(self, "task", task_of(self.task))
        if self.aim not in AIMS:
            raise InputError(f"--for: found {self.aim!r}, allowed: {', '.join(AIMS)}")
        if self.max_pairs < _FEWEST:
            raise InputError(f"--max-pairs {self.max_pairs}: allowed is at least {_FEWEST}")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A design with what the closed form says of it.

    Attributes
    ----------
    design : StudyDesign
    utility : float
        Half the log determinant of the precision of what is asked about; larger is better.
    sd : mapping of str to float
        Expected posterior sd of each effect asked about, in the unit of the stimuli.
    """

    design: StudyDesign
    utility: float
    sd: Mapping[str, float]

    def errors(self, unit: StimulusUnit) -> dict[str, str]:
        """The size of the error of each effect; of differences in the unit, if it is known."""
        texts = {}
        for name, value in self.sd.items():
            texts[name] = f"{value:.2g}"
            if name == CONSTANT_ERROR.name and unit.of_stimuli:
                texts[name] = f"{float(unit.differences(value)):.2g} {unit.of_differences}"
        return texts

    def describe(self, unit: StimulusUnit = UNKNOWN_UNIT) -> str:
        """The sizes of its errors in words."""
        errors = self.errors(unit)
        return ", ".join(f"{name.replace('_', ' ')} {text}" for name, text in errors.items())


@dataclass(frozen=True, eq=False)
class OptimalDesign:
    """An optimised design beside others.

    Attributes
    ----------
    design : StudyDesign
    goal : DesignGoal
    candidates : mapping of str to Candidate
        The optimised design first, then those it is compared with.
    power : PowerTable
        That of all of them, by simulation.
    plane : StudyDesign
        Every pair that can be shown, once.
    worth : ndarray, shape (pairs of the plane,)
        What one more trial of each adds to the utility.
    seed : int
    unit : StimulusUnit
        The unit in which levels are shown.
    """

    design: StudyDesign
    goal: DesignGoal
    candidates: Mapping[str, Candidate]
    power: PowerTable
    plane: StudyDesign
    worth: FloatArray
    seed: int
    unit: StimulusUnit = UNKNOWN_UNIT

    def reasons(self) -> list[str]:
        """The reasons for these pairs, and what they cannot show, in sentences."""
        share = self.design.n_trials / self.design.total
        first, index = np.unique(self.design.s1, return_inverse=True)
        of_first = np.bincount(index, share)
        frequent = np.sort(np.argsort(-of_first)[:4])
        levels = self.in_unit(first)
        name = f" {self.unit.of_stimuli}".rstrip()
        digits = ".4g" if name else "g"
        firsts = ", ".join(
            f"{levels[i]:{digits}}{name} ({100 * of_first[i]:.0f} %)" for i in frequent
        )
        lines = [
            f"Most trials have these first stimuli: {firsts}. Only first stimuli far apart "
            "distinguish a contraction from a constant error."
        ]
        if contraction_information(self.design.unanswered) < 1.0:
            lines.append(
                f"These pairs cannot show a contraction: {TYPICAL_TRIALS} trials have less "
                "information about it than its prior. Use a wider range of first stimuli."
            )
        return lines

    def in_unit(self, logs: FloatArray) -> FloatArray:
        """Stimuli in their unit; natural logs if it is not known."""
        return self.unit.stimuli(logs) if self.unit.of_stimuli else logs

    def frame(self) -> pd.DataFrame:
        """The design, with the stimuli in their unit in columns i1 and i2, if it is known."""
        frame = self.design.frame()
        if self.unit.of_stimuli:
            for name, logs in (("i1", self.design.s1), ("i2", self.design.s2)):
                frame[name] = [float(f"{value:.6g}") for value in self.in_unit(logs)]
        return frame

    def sentences(self) -> list[str]:
        """The reasons for these pairs, and what this design and others can show, in sentences."""
        lines = self.reasons()
        for name, candidate in self.candidates.items():
            lines.append(f"{name}: expected SD of {candidate.describe(self.unit)}.")
        return [*lines, *self.power.sentences(OPTIMISED)]

    def text(self) -> str:
        """The design, why it is so, and what it and others tell, as a file of Markdown."""
        frame = self.frame()
        if self.unit.of_stimuli:
            heads = {
                "i1": f"first, {self.unit.of_stimuli}",
                "i2": f"second, {self.unit.of_stimuli}",
            }
            frame = frame[["i1", "i2", "n_trials"]].rename(columns=heads)
        table = [" | ".join(frame.columns), " | ".join("---" for _ in frame.columns)]
        for row in frame.itertuples(index=False):
            table.append(" | ".join(f"{value:g}" for value in row))
        lines = [f"# A design of {self.design.total} trials, for: {self.goal.aim}", ""]
        lines += [f"* {sentence}" for sentence in self.sentences()]
        lines += ["", *(f"| {row} |" for row in table), "", f"Seed {self.seed}.", ""]
        return "\n".join(lines)


def grid(lowest: float, highest: float, step: float) -> FloatArray:
    """Levels from lowest to highest, natural-log intensity."""
    if not (np.isfinite([lowest, highest]).all() and lowest < highest):
        raise InputError(
            f"--lowest {lowest:g} --highest {highest:g}: allowed are finite numbers, the first the "
            "smaller one"
        )
    if not 0.0 < step <= highest - lowest:
        raise InputError(
            f"--step {step:g}: allowed is above 0 and at most the range, {highest - lowest:g}"
        )
    n_steps = np.floor((highest - lowest) / step + 1e-9)
    return np.round(lowest + step * np.arange(n_steps + 1), 12) + 0.0


def log_levels(levels: FloatArray, options: ReadOptions) -> FloatArray:
    """Natural logs of levels in the unit of these options."""
    if options.has_intensities:
        return np.log(levels) - options.stimulus_unit.log_reference
    return levels * LOG_UNITS[options.unit or "ln"]


def read_levels(
    path: StrPath, reference: float | None = None, unit: str | None = None
) -> FloatArray:
    """Levels in the column s of a CSV file; or intensities in the column i, with their unit."""
    if reference is not None and not 0.0 < reference < np.inf:
        raise InputError(f"--reference {reference:g}: allowed is a positive number")
    options = ReadOptions(intensity=reference, unit=unit)
    name = "i" if options.has_intensities else "s"
    levels = read_numbers(path, (name,))[1][name]
    if options.has_intensities and (levels <= 0).any():
        raise InputError(f"{path}: column i: allowed are positive numbers")
    levels = np.unique(log_levels(levels, options))
    if len(levels) < 2:
        raise InputError(
            f"{path}: column {name}: found {len(levels)} level, allowed: at least two different "
            "ones"
        )
    return np.asarray(levels)


def optimal_design(
    levels: FloatArray,
    trials: int = 650,
    goal: DesignGoal | None = None,
    observers: StrPath | Sequence[Observer] | None = None,
    *,
    data_sets: int = SIMULATED,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> OptimalDesign:
    """The design of so many trials that is most informative about assumed observers.

    Both orders of two stimuli are equally frequent in it.

    Parameters
    ----------
    levels : array, shape (levels,)
        Intensities that can be shown, natural log; see :func:`grid` and :func:`read_levels`.
    trials : int
    goal : DesignGoal, optional
    observers
        As :func:`bayes_toe.design.power.power` takes them.
    data_sets : int
        Simulated observers of each kind who judge it and its rivals.
    seed, prior, workers, progress
        As there.

    Raises
    ------
    InputError
        If something is not allowed.
    """
    goal, root = DesignGoal() if goal is None else goal, root_seed(seed)
    own_prior = observer_prior(prior)
    levels = np.unique(np.asarray(levels, np.float64))
    plane = _pairs_to_show(levels, goal)
    assumed = assume_observers(observers, ASSUMED, root, [plane], own_prior)
    judges = assume_observers(observers, data_sets, root, [plane], own_prior)
    candidates, worth = compare_designs(levels, trials, goal, assumed, root, own_prior)
    designs = [(name, candidate.design) for name, candidate in candidates.items()]
    table = simulate_power(designs, judges, root, own_prior, workers, progress)
    design = candidates[OPTIMISED].design
    return OptimalDesign(design, goal, candidates, table, plane, worth, root)


def compare_designs(
    levels: FloatArray,
    trials: int,
    goal: DesignGoal,
    observers: Sequence[Observer],
    seed: int = 0,
    prior: ObserverPrior = DEFAULT_PRIOR,
) -> tuple[dict[str, Candidate], FloatArray]:
    """The best design and its rivals, by the closed form.

    The second value is what one more trial of each pair adds.
    """
    plane = _pairs_to_show(levels, goal)
    fixed = np.zeros(plane.n_pairs, np.int64)
    if goal.keep is not None:
        fixed[[plane.pairs.index(pair) for pair in goal.keep.pairs]] = goal.keep.n_trials
    n_left, n_kept = trials - int(fixed.sum()), int((fixed > 0).sum())
    if n_left < _FEWEST:
        part = f", {trials - n_left} of which --keep has taken" if n_kept else ""
        raise InputError(f"--trials {trials}{part}: allowed is at least {_FEWEST} to distribute")
    if n_kept >= goal.max_pairs:
        raise InputError(
            f"--max-pairs {goal.max_pairs}: --keep has {n_kept} already; allowed is more"
        )
    scales = plane.unanswered.scales
    of_plane = information(plane, observers, goal.aim, prior, scales)
    most_pairs = min(goal.max_pairs, n_left + n_kept)
    n_trials = exchange_trials(of_plane, n_left, most_pairs, fixed, _turned(plane))

    def candidate(design: StudyDesign) -> Candidate:
        of_design = information(design, observers, goal.aim, prior, scales)
        total = of_design.total(design.n_trials)
        sd = dict(zip(AIMS[goal.aim], of_design.standard_deviations(total).tolist(), strict=True))
        return Candidate(design, of_design.utility(total), sd)

    chosen = np.flatnonzero(n_trials)
    candidates = {OPTIMISED: candidate(plane.select(chosen, n_trials[chosen]))}
    for name, design in _rivals(levels, plane, goal, seed).items():
        if design.n_pairs <= trials:
            candidates[name] = candidate(design.with_total(trials))
    total = of_plane.total(n_trials)
    return candidates, of_plane.utilities(total, 1.0) - of_plane.utility(total)


def _pairs_to_show(levels: FloatArray, goal: DesignGoal) -> StudyDesign:
    """Ordered pairs of levels, and those that are kept."""
    number = len(levels) ** 2
    if number > _MOST_PAIRS:
        raise InputError(
            f"{len(levels)} levels make {number:,} pairs: allowed are {_MOST_PAIRS:,}; a larger "
            "--step"
        )
    plane = all_pairs(levels, goal.task)
    if goal.keep is None:
        return plane
    pairs = np.unique(plane.pairs + goal.keep.pairs, axis=0)
    return each_once(*pairs.T, task=goal.task)


def _turned(plane: StudyDesign) -> IndexArray:
    """The index of each pair in the other order; its own where that cannot be shown."""
    index = {pair: i for i, pair in enumerate(plane.pairs)}
    return np.array([index.get((s2, s1), i) for (s1, s2), i in index.items()])


def _rivals(
    levels: FloatArray, plane: StudyDesign, goal: DesignGoal, seed: int
) -> dict[str, StudyDesign]:
    """The paper's pairs where they lie in the range, a full factorial, and random pairs."""
    rivals = {}
    paper = paper_study_design(task=goal.task)
    if levels[0] <= paper.s1.min() and paper.s1.max() <= levels[-1]:
        rivals[PAPER] = paper
    index = np.linspace(0, len(levels) - 1, min(_LEVELS, len(levels))).round().astype(int)
    rivals[FULL] = all_pairs(levels[index], goal.task)
    n_pairs = min(goal.max_pairs, plane.n_pairs)
    rng = generator(seed, "random pairs")
    rivals[RANDOM] = plane.select(rng.choice(plane.n_pairs, n_pairs, replace=False))
    return rivals
