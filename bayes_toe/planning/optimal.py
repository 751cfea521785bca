"""The design that tells most of what is asked, by exchange with closed-form information; it and rivals are judged by simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.validation import read_numbers
from bayes_toe.errors import InputError
from bayes_toe.kept import Kept
from bayes_toe.model.prior import Prior
from bayes_toe.planning.information import UTILITIES, Task, built, exchanged, information, trials_of
from bayes_toe.planning.observers import MIDDLE, UPDATE, Observer, assumed, middle_of, of_kind, prior_of
from bayes_toe.planning.power import WIDTHS, PowerTable, jobs_of, simulated, worked
from bayes_toe.planning.study_design import DESIGN_COLUMNS, StudyDesign, each_once, paper_study_design
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
_HOPELESS, _LITTLE = 0.05, 0.7  # share named below which, and posterior over prior sd above which, a range tells nothing
_LEVELS = 5  # of the full factorial


@dataclass(frozen=True, eq=False)
class Candidate:
    """A design with what the closed form says of it: its utility for the aim, and the posterior sd of what is wanted.

    The sd is a root mean square over observers; of the pull, where the update is to be named.
    """

    design: StudyDesign
    utility: float
    sd: float


def reasons_for(candidates: Mapping[str, Candidate], people: Sequence[Observer], aim: str) -> Iterator[str]:
    """Which pairs the optimised design has and why, and what the closed form says of it and the others."""
    best = candidates[OPTIMISED]
    design = best.design
    share, apart = design.n_trials / design.total, np.abs(design.s2 - design.s1)
    different, place = np.unique(design.s1, return_inverse=True)
    of_first = np.bincount(place, share)
    firsts = ", ".join(f"{different[i]:g} ({100 * of_first[i]:.0f} %)" for i in sorted(np.argsort(-of_first)[:4]))
    yield (
        f"first stimuli, of most trials: {firsts}; a pull moves what is remembered up from below and down from above, a constant error all "
        "of it one way, so that stimuli far apart tell the two from each other"
    )
    q = np.mean([one.equal(design) for one in of_kind(people, UPDATE)], axis=0)
    of_most = partial(np.quantile, q=(0.1, 0.9), weights=share, method="inverted_cdf")
    (low, high), (near, far) = of_most(q), of_most(apart)
    yield (
        f"second stimuli: mostly {near:.2g} to {far:.2g} from the first, where those who update say 'equal' to {100 * low:.0f} to "
        f"{100 * high:.0f} % of the trials: answers that are certain beforehand tell nothing"
    )
    yield f"equal pairs: {int((apart == 0).sum())} of {design.n_pairs}, {100 * share[apart == 0].sum():.0f} % of the trials" + (
        "" if (apart == 0).any() else "; q0 is told by pairs that seem equal, which are others with a pull (to have some: --keep)"
    )
    if MOVED in candidates:
        there = candidates[MOVED].design
        yield f"{MOVED}: as far apart as the paper's, from {there.s1.min():.3g} to {there.s1.max():.3g}, amid what can be shown"
    others = "; ".join(f"{name} {one.utility:.2f}" for name, one in candidates.items() if name != OPTIMISED)
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
    """

    aim: str = "update"
    max_pairs: int = 25
    keep: StudyDesign | None = None
    isi: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.aim not in UTILITIES:
            raise InputError(f"--for: found {self.aim!r}, allowed: {', '.join(UTILITIES)}")
        if self.max_pairs < _FEWEST:
            raise InputError(f"--max-pairs {self.max_pairs}: allowed is at least {_FEWEST}, as many as there are parameters")
        if self.keep is not None and (self.keep.isi is not None) != bool(self.isi):
            raise InputError("--keep: either it has a column isi and --isi names intervals, or neither")


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
        names = DESIGN_COLUMNS if self.design.isi is not None else DESIGN_COLUMNS[:3]
        columns = [getattr(self.design, name).tolist() for name in names]
        rows = [" | ".join(f"{value:g}" for value in row) for row in zip(*columns, strict=True)]
        table = [" | ".join(names), " | ".join("---" for _ in names), *rows]
        said = [f"* {line}" for line in self.said()]
        head = f"# A design of {self.design.total} trials, for: {self.goal.aim}"
        return "\n".join([head, "", *said, "", *(f"| {row} |" for row in table), "", f"Seed {self.seed}.", ""])


def grid(lowest: float, highest: float, step: float) -> FloatArray:
    """Levels from lowest to highest, natural-log intensity.

    Raises
    ------
    InputError
        If the range holds fewer than two.

    Examples
    --------
    >>> grid(-0.1, 0.1, 0.1).tolist()
    [-0.1, 0.0, 0.1]
    """
    if not (np.isfinite([lowest, highest]).all() and lowest < highest):
        raise InputError(f"--lowest {lowest:g} --highest {highest:g}: allowed are finite numbers, the first the smaller one")
    if not 0.0 < step <= highest - lowest:
        raise InputError(f"--step {step:g}: allowed is above 0 and at most the range, {highest - lowest:g}")
    return np.asarray(np.round(lowest + step * np.arange(np.floor((highest - lowest) / step + 1e-9) + 1), 12) + 0.0)


def read_levels(path: str | Path, reference: float | None = None) -> FloatArray:
    """Levels in the column s of a CSV file, natural-log intensity; or amplitudes in the column i where their reference is given.

    Raises
    ------
    InputError
        If there are fewer than two, or a cell holds no number.
    """
    name = "s" if reference is None else "i"
    found = read_numbers(path, (name,))[1][name]
    if reference is not None and (found <= 0).any():
        raise InputError(f"{path}: column i: allowed are positive numbers")
    levels = np.unique(found if reference is None else np.log(found / reference))
    if len(levels) < 2:
        raise InputError(f"{path}: column {name}: found {len(levels)} level, allowed: at least two different ones")
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
    every = {"the pairs that can be shown": _admissible(different, asked)}
    people, judges = (assumed(observers, every, size, root, prior) for size in (ASSUMED, data_sets))
    search = _Search(different, trials, asked, people, root, prior)
    found = search.candidates()
    designs = [(name, one.design) for name, one in found.items()]
    rows, failed = worked(Kept(), jobs_of(simulated, designs, judges, root, prior), workers, progress)
    design, reasons = found[OPTIMISED].design, tuple(reasons_for(found, people, asked.aim))
    worth = search.information.worth(search.information.total(search.counts(design)))
    return OptimalDesign(design, asked, found, PowerTable(rows, root, failed), search.pairs, worth, reasons, root)


def proposed(levels: FloatArray, trials: int, goal: DesignGoal, people: Sequence[Observer], seed: int = 0) -> dict[str, Candidate]:
    """The optimised design and those that it is compared with, by the closed form alone: seconds, where simulation takes minutes.

    Examples
    --------
    >>> from bayes_toe.planning.observers import observers_from
    >>> people = observers_from(None, 2, seed=1)
    >>> found = proposed(grid(-0.75, 1.25, 0.25), 200, DesignGoal("gain", max_pairs=8), people)
    >>> found[OPTIMISED].design.total, found[OPTIMISED].sd < found[PAPER].sd
    (200, True)
    """
    return _Search(np.unique(np.asarray(levels, np.float64)), trials, goal, people, seed, None).candidates()


def paper_amid(shown: StudyDesign) -> StudyDesign:
    """The paper's pairs, moved to the middle of what can be shown where their own place is not amid it.

    Examples
    --------
    >>> [paper_amid(each_once([low], [high])).s1.min().round(9).item() for low, high in ((-0.75, 1.25), (3.3, 4.5))]
    [0.0, 3.65]
    """
    return paper_study_design().moved(middle_of([shown]) - MIDDLE)


# --- Candidates by the closed form ----------------------------------------------------------------


def _admissible(levels: FloatArray, goal: DesignGoal) -> StudyDesign:
    """Ordered pairs of levels, at every interval, and those that are kept."""
    number = len(levels) ** 2 * max(1, len(goal.isi))
    if number > _MOST_PAIRS:
        raise InputError(f"{len(levels)} levels make {number:,} pairs: allowed are {_MOST_PAIRS:,}; a larger --step")
    found, keep = _at_intervals(*_factorial(levels), goal.isi), goal.keep
    return found if keep is None else each_once(*np.unique(np.hstack([found.columns, keep.columns]), axis=1))


def _factorial(levels: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.repeat(levels, len(levels)), np.tile(levels, len(levels))


def _at_intervals(s1: FloatArray, s2: FloatArray, isi: tuple[float, ...]) -> StudyDesign:
    """Pairs, each at every interval, if there are any."""
    return each_once(np.tile(s1, len(isi)), np.tile(s2, len(isi)), np.repeat(isi, len(s1))) if isi else each_once(s1, s2)


class _Search:
    """Admissible pairs, their information, and designs made of them."""

    def __init__(
        self, levels: FloatArray, trials: int, goal: DesignGoal, people: Sequence[Observer], seed: int, prior: Prior | str | None
    ) -> None:
        self.levels, self.trials, self.goal, self.people, self.seed = levels, trials, goal, people, seed
        self.pairs = _admissible(levels, goal)
        self.prior, self.paper = prior_of([self.pairs], prior), paper_amid(self.pairs)
        self.fixed = np.zeros(self.pairs.n_pairs, np.int64) if goal.keep is None else self.counts(goal.keep).astype(np.int64)
        taken, kept = int(self.fixed.sum()), int((self.fixed > 0).sum())
        if trials - taken < _FEWEST:
            said = f", {taken} of which --keep has taken" if taken else ""
            raise InputError(f"--trials {trials}{said}: allowed is at least {_FEWEST} to distribute, for as many parameters")
        most = min(goal.max_pairs, trials - taken + kept)
        if kept >= most:
            raise InputError(f"--max-pairs {goal.max_pairs}: --keep has {kept} already; allowed is more")
        self.information = information(self.pairs, people, goal.aim, self.prior)
        self.task = Task(self.information, trials - taken, most, self.fixed)

    def counts(self, design: StudyDesign) -> FloatArray:
        """Trials of a design by admissible pair."""
        trials = dict(zip(design.pairs, design.n_trials.tolist(), strict=True))
        return np.array([trials.get(pair, 0) for pair in self.pairs.pairs], np.float64)

    def candidates(self) -> dict[str, Candidate]:
        """Designs to compare: the best, then the paper's, a full factorial, random pairs.

        Exchange from pairs at random, or from the paper's, ends within 0.002 of the same score.
        """
        n = trials_of(self.task, exchanged(self.task, built(self.task)))
        s1, s2, *isi = (column[n > 0] for column in self.pairs.columns)
        best = self._candidate(StudyDesign(s1, s2, n[n > 0], *isi))
        self._require_hope(best)
        return {OPTIMISED: best} | {name: self._candidate(design) for name, design in self._rivals()}

    def _candidate(self, design: StudyDesign) -> Candidate:
        own = information(design, self.people, self.goal.aim, self.prior)
        total = own.total(design.n_trials.astype(np.float64))
        return Candidate(design, own.utility(total), float(np.sqrt(own.variance(total)[own.updates].mean())))

    def _rivals(self) -> Iterator[tuple[str, StudyDesign]]:
        """The paper's pairs too where a range is too narrow for them: they say what the range is worth. At all intervals that there are."""
        rng, size = generator(self.seed, "random pairs"), min(self.goal.max_pairs, self.pairs.n_pairs)
        random = rng.choice(self.pairs.n_pairs, size, replace=False)
        some = self.levels[np.linspace(0, len(self.levels) - 1, min(_LEVELS, len(self.levels))).round().astype(int)]
        rivals = {
            PAPER if np.array_equal(self.paper.s1, paper_study_design().s1) else MOVED: (self.paper.s1, self.paper.s2),
            FULL: _factorial(some),
        }
        designs = {name: _at_intervals(s1, s2, self.goal.isi) for name, (s1, s2) in rivals.items()}
        designs[RANDOM] = each_once(*(column[random] for column in self.pairs.columns))
        yield from ((name, one.with_total(self.trials)) for name, one in designs.items() if one.n_pairs <= self.trials)

    def _require_hope(self, best: Candidate) -> None:
        """Refuse a range or a number of trials with which even the best design tells next to nothing."""
        known, updates = self.information, of_kind(self.people, UPDATE)
        start = np.sqrt(known.variance(known.prior)[known.updates].mean())
        targets = [(one, one.target(paper_study_design().unanswered)) for one in updates]
        width = np.mean([target.quantities(one.point(target))["width"][0] for one, target in targets])
        pull, span = known.pull[known.updates].mean(), float(np.ptp(self.levels))
        toward = float(np.median([one.quantities["mu1"] for one in updates if "mu1" in one.quantities]))
        away = pull * max(self.levels[0] - toward, toward - self.levels[-1])  # of the nearest stimulus
        nearer = f", or observers nearer to it than these, whose mu1 is {toward:.3g}" if away > width else ""
        about = (
            f"{self.trials} trials between {self.levels[0]:g} and {self.levels[-1]:g} tell next to nothing: first stimuli {span:g} apart "
            f"are pulled together by {pull * span:.2g}, {pull * span / width:.2g} of a width of {width:.2g}; allowed: a wider range, or "
            f"more trials{nearer}"
        )
        # The closed form is too hopeful where there are few trials.
        if self.goal.aim == "update" and (
            known.named(known.total(self.counts(best.design))) < _HOPELESS
            or all(
                simulated(OPTIMISED, best.design, one, self.seed, self.prior).judgement.verdict.kind != "pull" for one in updates[:_PILOT]
            )
        ):
            raise InputError(f"{about} (of {_PILOT} simulated observers who update the best pairs there name none)")
        if self.goal.aim in WIDTHS and best.sd > _LITTLE * start:
            raise InputError(f"{about} (the sd of {self.goal.aim} falls from {start:.2g} to {best.sd:.2g} at best)")
