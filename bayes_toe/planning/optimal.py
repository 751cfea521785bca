"""The design that tells most of what is asked, by exchange with closed-form information; it and rivals are judged by simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.tasks import SAME_DIFFERENT, Task, task_of
from bayes_toe.data.validation import read_numbers
from bayes_toe.errors import InputError
from bayes_toe.model.prior import Prior
from bayes_toe.planning.information import UTILITIES, Information, exchanged, information
from bayes_toe.planning.observers import (
    MIDDLE,
    UPDATE,
    Observer,
    assumed,
    middle_of,
    of_kind,
    prior_of,
)
from bayes_toe.planning.power import WIDTHS, PowerTable, simulated, simulation
from bayes_toe.planning.study_design import (
    StudyDesign,
    all_pairs,
    each_once,
    nobody,
    paper_study_design,
)
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Progress, Workers

#: Names of the designs that are compared; the paper's pairs are moved to a range that does not lie about them.
OPTIMISED, PAPER, FULL, RANDOM = "optimised", "the paper's pairs", "full factorial", "random pairs"
MOVED = "the paper's pairs, moved"
#: Observers of each kind for whom a design is made, and data sets of each kind by which it is judged.
ASSUMED, JUDGED = 20, 20
_MOST_PAIRS = 20_000  # admissible ones
_FEWEST = 4  # trials, and pairs, without which four parameters cannot be told
_PILOT = 10  # simulated observers who update, of whom a design has to name one
_LITTLE = 0.7  # posterior over prior sd above which a range tells nothing
_LEVELS = 5  # of the full factorial


@dataclass(frozen=True, eq=False)
class Candidate:
    """A design with what the closed form says of it: its utility for the aim, and the posterior sd of what is wanted.

    The sd is a root mean square over observers; of the pull, where the update is to be named.
    """

    design: StudyDesign
    utility: float
    sd: float


def reasons_for(
    candidates: Mapping[str, Candidate], people: Sequence[Observer], aim: str
) -> Iterator[str]:
    """Which pairs the optimised design has and why, and what the closed form says of it and the others."""
    best = candidates[OPTIMISED]
    design = best.design
    share, apart = design.n_trials / design.total, np.abs(design.s2 - design.s1)
    different, place = np.unique(design.s1, return_inverse=True)
    of_first = np.bincount(place, share)
    firsts = ", ".join(
        f"{different[i]:g} ({100 * of_first[i]:.0f} %)" for i in sorted(np.argsort(-of_first)[:4])
    )
    yield (
        f"first stimuli, of most trials: {firsts}; a pull moves what is remembered up from below and down from above, a constant error all "
        "of it one way, so that stimuli far apart tell the two from each other"
    )
    q, task = np.mean([one.p_yes(design) for one in of_kind(people, UPDATE)], axis=0), design.task
    of_most = partial(np.quantile, q=(0.1, 0.9), weights=share, method="inverted_cdf")
    (low, high), (near, far) = of_most(q), of_most(apart)
    yield (
        f"second stimuli: mostly {near:.2g} to {far:.2g} from the first, where those who update say '{task.yes}' to {100 * low:.0f} to "
        f"{100 * high:.0f} % of the trials: answers that are certain beforehand tell nothing"
    )
    told = (
        ""
        if (apart == 0).any() or task != SAME_DIFFERENT
        else "; q0 is told by pairs that seem equal, which are others with a pull"
    )
    kept = " (to have some: --keep)" if told else ""
    yield f"equal pairs: {int((apart == 0).sum())} of {design.n_pairs}, {100 * share[apart == 0].sum():.0f} % of the trials{told}{kept}"
    if MOVED in candidates:
        there = candidates[MOVED].design
        yield f"{MOVED}: as far apart as the paper's, from {there.s1.min():.3g} to {there.s1.max():.3g}, amid what can be shown"
    others = "; ".join(
        f"{name} {one.utility:.2f}" for name, one in candidates.items() if name != OPTIMISED
    )
    yield f"utility ({UTILITIES[aim]}), lapses and sloped noise being unknown: {best.utility:.2f}; {others}"
    more = [name for name, one in candidates.items() if one.utility > best.utility]
    if more:
        yield f"{more[0]}: tell more, but are not among the admissible pairs"


# --- The design -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class DesignGoal:
    """What a design is for.

    Parameters
    ----------
    aim : str
        "update": to name the order effect; "gain", "mu1", "width": to know it narrowly; "parameters": all four.
    max_pairs : int
        Different pairs.
    keep : StudyDesign, optional
        Pairs that stay, with at least their trials.
    isi : tuple of float
        Inter-stimulus intervals to choose from, seconds; empty where there is one, which is then the unit.
    task : Task
        Or "2afc", which is stronger: the design then has both orders of two stimuli equally often, without which a pull is not told.
    """

    aim: str = "update"
    max_pairs: int = 25
    keep: StudyDesign | None = None
    isi: tuple[float, ...] = ()
    task: Task = SAME_DIFFERENT

    def __post_init__(self) -> None:
        object.__setattr__(self, "task", task_of(self.task))
        if self.aim not in UTILITIES:
            raise InputError(f"--for: found {self.aim!r}, allowed: {', '.join(UTILITIES)}")
        if self.max_pairs < _FEWEST:
            raise InputError(
                f"--max-pairs {self.max_pairs}: allowed is at least {_FEWEST}, as many as there are parameters"
            )
        if self.keep is not None and (self.keep.isi is not None) != bool(self.isi):
            raise InputError(
                "--keep: either it has a column isi and --isi names intervals, or neither"
            )


@dataclass(frozen=True, eq=False)
class OptimalDesign:
    """An optimised design beside others.

    Attributes
    ----------
    candidates : mapping of str to Candidate
        The optimised design first, then those it was compared with; `power` is that of all of them, by simulation.
    plane : StudyDesign
        Every admissible pair, once; `worth`, shape (pairs of the plane,), is what one more trial of each adds to the score.
    reasons : tuple of str
        Why these pairs, in words.
    """

    design: StudyDesign
    goal: DesignGoal
    candidates: Mapping[str, Candidate]
    power: PowerTable
    plane: StudyDesign
    worth: FloatArray
    reasons: tuple[str, ...]
    seed: int

    def said(self) -> list[str]:
        """Why these pairs, and what they and others would name, a line each."""
        return [*self.reasons, *self.power.sentences()]

    def text(self) -> str:
        """The design, why it is so, and what it and others would name, as a file of Markdown."""
        frame = self.design.frame()
        rows = [" | ".join(f"{value:g}" for value in row) for row in frame.itertuples(index=False)]
        table = [" | ".join(map(str, frame)), " | ".join("---" for _ in frame), *rows]
        said = [f"* {line}" for line in self.said()]
        head = f"# A design of {self.design.total} trials, for: {self.goal.aim}"
        return "\n".join(
            [head, "", *said, "", *(f"| {row} |" for row in table), "", f"Seed {self.seed}.", ""]
        )


def grid(lowest: float, highest: float, step: float) -> FloatArray:
    """Levels from lowest to highest, natural-log intensity; a range that holds fewer than two is refused."""
    if not (np.isfinite([lowest, highest]).all() and lowest < highest):
        raise InputError(
            f"--lowest {lowest:g} --highest {highest:g}: allowed are finite numbers, the first the smaller one"
        )
    if not 0.0 < step <= highest - lowest:
        raise InputError(
            f"--step {step:g}: allowed is above 0 and at most the range, {highest - lowest:g}"
        )
    return np.asarray(
        np.round(lowest + step * np.arange(np.floor((highest - lowest) / step + 1e-9) + 1), 12)
        + 0.0
    )


def read_levels(path: str | Path, reference: float | None = None) -> FloatArray:
    """Levels in the column s of a CSV file, natural-log intensity; or amplitudes in the column i where their reference is given."""
    name = "s" if reference is None else "i"
    found = read_numbers(path, (name,))[1][name]
    if reference is not None and (found <= 0).any():
        raise InputError(f"{path}: column i: allowed are positive numbers")
    levels = np.unique(found if reference is None else np.log(found / reference))
    if len(levels) < 2:
        raise InputError(
            f"{path}: column {name}: found {len(levels)} level, allowed: at least two different ones"
        )
    return np.asarray(levels)


def optimal_design(
    levels: FloatArray,
    trials: int = 650,
    goal: DesignGoal | None = None,
    observers: str | Path | Sequence[Observer] | None = None,
    *,
    data_sets: int = JUDGED,
    seed: int | None = None,
    prior: Prior | str | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> OptimalDesign:
    """The design of so many trials that tells most of what is asked for about assumed observers.

    Parameters
    ----------
    levels : array, shape (levels,)
        Intensities that can be shown, natural log; see :func:`grid` and :func:`read_levels`.
    trials : int
    goal : DesignGoal, optional
    observers
        As :func:`bayes_toe.planning.power.power` takes them.
    data_sets : int
        Simulated observers of each kind who judge it and its rivals.
    seed, prior, workers, progress
        As there.

    Raises
    ------
    InputError
        If trials, levels or observers are such that no design tells anything: with the reason.
    """
    asked, root = DesignGoal() if goal is None else goal, root_seed(seed)
    different = np.unique(np.asarray(levels, np.float64))
    plane = _admissible(different, asked)
    people, judges = (
        assumed(observers, {"the pairs that can be shown": plane}, size, root, prior)
        for size in (ASSUMED, data_sets)
    )
    found, worth = proposed(different, trials, asked, people, root, prior)
    design = found[OPTIMISED].design
    if asked.aim == "update":  # the closed form is too hopeful where there are few trials
        pilot = (
            simulated(OPTIMISED, design, one, root, prior_of([plane], prior))
            for one in of_kind(people, UPDATE)[:_PILOT]
        )
        if all(one.judgement.verdict.kind != "pull" for one in pilot):
            raise _hopeless(
                different,
                trials,
                people,
                f"of {_PILOT} simulated observers who update the best pairs there name none",
            )
    designs = [(name, one.design) for name, one in found.items()]
    table = PowerTable(
        *simulation(
            simulated, "data sets", designs, lambda _: judges, root, prior, workers, progress
        )
    )
    return OptimalDesign(
        design,
        asked,
        found,
        table,
        plane,
        worth,
        tuple(reasons_for(found, people, asked.aim)),
        root,
    )


def paper_amid(shown: StudyDesign) -> StudyDesign:
    """The paper's pairs, moved to the middle of what can be shown where their own place is not amid it.

    Examples
    --------
    >>> [paper_amid(each_once([low], [high])).s1.min().round(9).item() for low, high in ((-0.75, 1.25), (3.3, 4.5))]
    [0.0, 3.65]
    """
    return paper_study_design().moved(middle_of([shown]) - MIDDLE)


# --- Candidates by the closed form ----------------------------------------------------------------


def proposed(
    levels: FloatArray,
    trials: int,
    goal: DesignGoal,
    people: Sequence[Observer],
    seed: int = 0,
    prior: Prior | str | None = None,
) -> tuple[dict[str, Candidate], FloatArray]:
    """Designs to compare: the best, the paper's, a full factorial, random pairs; and what one more trial of each admissible pair adds.

    By the closed form alone: seconds, where simulation takes minutes. Exchange from pairs at random, or from the paper's, ends within 0.002
    of the same score.
    """
    plane = _admissible(levels, goal)
    fixed = np.zeros(plane.n_pairs, np.int64)
    if goal.keep is not None:
        fixed[[plane.pairs.index(pair) for pair in goal.keep.pairs]] = goal.keep.n_trials
    left, kept = trials - int(fixed.sum()), int((fixed > 0).sum())
    if left < _FEWEST:
        said = f", {trials - left} of which --keep has taken" if kept else ""
        raise InputError(
            f"--trials {trials}{said}: allowed is at least {_FEWEST} to distribute, for as many parameters"
        )
    if kept >= goal.max_pairs:
        raise InputError(
            f"--max-pairs {goal.max_pairs}: --keep has {kept} already; allowed is more"
        )
    numbers, most = prior_of([plane], prior), min(goal.max_pairs, left + kept)
    known = information(plane, people, goal.aim, numbers)
    partner = np.arange(plane.n_pairs)
    if (
        goal.task != SAME_DIFFERENT
    ):  # a preference for one answer is told from a pull by both orders
        places = {pair: place for place, pair in enumerate(plane.pairs)}
        partner = np.array(
            [places.get((s2, s1, *isi), place) for (s1, s2, *isi), place in places.items()]
        )
    n = exchanged(known, left, most, fixed, partner)

    def candidate(design: StudyDesign) -> Candidate:
        own = information(design, people, goal.aim, numbers)
        total = own.total(design.n_trials)
        return Candidate(design, own.utility(total), _sd(own, total))

    best = candidate(plane.some(np.flatnonzero(n), n[n > 0]))
    begun = _sd(known, known.prior)
    if goal.aim in WIDTHS and best.sd > _LITTLE * begun:
        raise _hopeless(
            levels,
            trials,
            people,
            f"the sd of {goal.aim} falls from {begun:.2g} to {best.sd:.2g} at best",
        )
    rivals = {
        name: candidate(one.with_total(trials))
        for name, one in _rivals(levels, plane, goal, seed)
        if one.n_pairs <= trials
    }
    total = known.total(n)
    return {OPTIMISED: best, **rivals}, known.scores(total, 1.0) - known.score(total)


def _admissible(levels: FloatArray, goal: DesignGoal) -> StudyDesign:
    """Ordered pairs of levels, at every interval, and those that are kept."""
    number = len(levels) ** 2 * max(1, len(goal.isi))
    if number > _MOST_PAIRS:
        raise InputError(
            f"{len(levels)} levels make {number:,} pairs: allowed are {_MOST_PAIRS:,}; a larger --step"
        )
    found, keep = all_pairs(levels, goal.isi, goal.task), goal.keep
    return (
        found
        if keep is None
        else each_once(*np.unique(np.hstack([found.columns, keep.columns]), axis=1), task=goal.task)
    )


def _rivals(
    levels: FloatArray, plane: StudyDesign, goal: DesignGoal, seed: int
) -> Iterator[tuple[str, StudyDesign]]:
    """At all intervals that there are; the paper's too where a range is too narrow for them: they say what the range is worth."""
    paper, rng = paper_amid(plane), generator(seed, "random pairs")
    isi = [np.repeat(goal.isi, paper.n_pairs)] if goal.isi else []
    timed = (np.tile(column, max(1, len(goal.isi))) for column in (paper.s1, paper.s2))
    there = np.array_equal(paper.s1, paper_study_design().s1)
    yield PAPER if there else MOVED, each_once(*timed, *isi, task=goal.task)
    some = levels[np.linspace(0, len(levels) - 1, min(_LEVELS, len(levels))).round().astype(int)]
    yield FULL, all_pairs(some, goal.isi, goal.task)
    yield (
        RANDOM,
        plane.some(rng.choice(plane.n_pairs, min(goal.max_pairs, plane.n_pairs), replace=False)),
    )


def _sd(known: Information, total: FloatArray) -> float:
    """Of the wanted quantity, a root mean square over observers who update."""
    return float(np.sqrt(known.variance(total)[known.updates].mean()))


def _hopeless(levels: FloatArray, trials: int, people: Sequence[Observer], why: str) -> InputError:
    """What is said of a range or a number of trials with which even the best design tells next to nothing."""
    updates, span = of_kind(people, UPDATE), float(np.ptp(levels))
    targets = [(one, one.target(nobody(one.task))) for one in updates]
    known = [target.quantities(one.point(target)) for one, target in targets]
    pull, width, toward = (
        float(np.mean([one[name] for one in known])) for name in ("pull", "width", "mu1")
    )
    away = pull * max(levels[0] - toward, toward - levels[-1])  # of the nearest stimulus
    nearer = (
        f", or observers nearer to it than these, whose mu1 is {toward:.3g}" if away > width else ""
    )
    return InputError(
        f"{trials} trials between {levels[0]:g} and {levels[-1]:g} tell next to nothing: first stimuli {span:g} apart are pulled together "
        f"by {pull * span:.2g}, {pull * span / width:.2g} of a width of {width:.2g}; allowed: a wider range, or more trials{nearer} ({why})"
    )
