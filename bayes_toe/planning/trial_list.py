"""The order in which a design is shown: blocks alike, both orders of two stimuli equally often in each, few equal pairs in a row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import logsumexp

from bayes_toe.arrays import FloatArray, IndexArray, IntArray
from bayes_toe.data.tables import write_cells
from bayes_toe.errors import InputError
from bayes_toe.planning.study_design import StudyDesign
from bayes_toe.seeds import generator

#: Equal pairs that may follow each other.
MOST_EQUAL = 3


@dataclass(frozen=True, eq=False)
class TrialList:
    """Trials of one subject in the order in which they are shown; the answers are still to come.

    Attributes
    ----------
    subject : str
    block : array of int, shape (trials,)
        From 1.
    s1, s2 : array, shape (trials,)
        Natural-log intensities.
    isi : array, shape (trials,), optional
        Seconds.
    """

    subject: str
    block: IntArray
    s1: FloatArray
    s2: FloatArray
    isi: FloatArray | None = None

    def cells(self, reference: float | None = None) -> Iterator[list[object]]:
        """Rows of the file, see :func:`save_trials`."""
        columns = [self.block, np.arange(1, len(self.s1) + 1), self.s1, self.s2, *([] if self.isi is None else [self.isi])]
        if reference is not None:
            columns += [reference * np.exp(self.s1), reference * np.exp(self.s2)]
        for row in zip(*(column.tolist() for column in columns), strict=True):
            yield [self.subject, *row, ""]


def trial_list(design: StudyDesign, *, blocks: int = 10, subject: str = "S01", seed: int) -> TrialList:
    """A random order of all trials of a design.

    Every block has its share of every pair, and two stimuli in both orders equally often where the design has them so; no more than three
    equal pairs follow each other, also over the end of a block. Of all orders that are so, each is equally probable.

    Parameters
    ----------
    design : StudyDesign
    blocks : int
    subject : str
        Whose trials; the random stream is keyed by it.
    seed : int

    Raises
    ------
    InputError
        If there are fewer trials than blocks, or too many equal pairs.

    Examples
    --------
    >>> trials = trial_list(StudyDesign([0, 0, 0.3], [0, 0.3, 0], [10, 20, 20]), blocks=5, seed=1)
    >>> np.unique(trials.block, return_counts=True)[1].tolist()
    [10, 10, 10, 10, 10]
    """
    if not 1 <= blocks <= design.total:
        raise InputError(f"--blocks {blocks}: allowed is 1 to {design.total}, the number of trials")
    rng = generator(seed, subject, "order of trials")
    counts, same = _blocks(design, blocks, rng), design.s1 == design.s2
    gaps = _gaps(counts[:, same].sum(axis=1), counts[:, ~same].sum(axis=1), rng)
    order = [_ordered(design, of_block, between, rng) for of_block, between in zip(counts, gaps, strict=True)]
    all_of_them = np.concatenate(order)
    block = np.repeat(np.arange(1, blocks + 1), [len(part) for part in order])
    return TrialList(subject, block, *(column[all_of_them] for column in design.pairs.columns))


def save_trials(lists: list[TrialList], path: str | Path, *, reference: float | None = None, overwrite: bool = False) -> Path:
    """Write trial lists as one CSV file that :func:`bayes_toe.data.read_study.read_study` reads once the column response is filled in.

    Columns: subject, block, trial (over all blocks), s1, s2, isi where there are intervals, i1 and i2 = reference e^s where the reference
    amplitude is given, and response, which is empty.
    """
    some = lists[0].isi is not None
    names = ["subject", "block", "trial", "s1", "s2", *(["isi"] if some else []), *([] if reference is None else ["i1", "i2"]), "response"]
    return write_cells(names, (row for one in lists for row in one.cells(reference)), path, overwrite=overwrite)


# --- Which pairs in which block ---------------------------------------------------------------------


def _blocks(design: StudyDesign, blocks: int, rng: np.random.Generator) -> IntArray:
    """Trials of each pair in each block, shape (blocks, pairs); blocks differ by as little as they can.

    Both orders of two stimuli come before what is single, which then evens out the blocks, where it can also those of its pair.
    """
    counts = np.zeros((blocks, design.n_pairs), np.int64)
    units = [(pairs, times) for pairs, times in _units(design) if times]
    for index in sorted(rng.permutation(len(units)).tolist(), key=lambda index: -len(units[index][0])):
        pairs, times = units[index]
        counts[:, pairs] += times // blocks
        fewest = np.lexsort((rng.uniform(size=blocks), counts[:, pairs].sum(axis=1), counts.sum(axis=1)))[: times % blocks]
        counts[np.ix_(fewest, pairs)] += 1
    return counts


def _units(design: StudyDesign) -> Iterator[tuple[list[int], int]]:
    """What is kept together in a block: both orders of two stimuli as often as both occur, and what is left of either; with how often."""
    isi = np.zeros(design.n_pairs) if design.isi is None else design.isi
    places = {key: i for i, key in enumerate(zip(design.s1.tolist(), design.s2.tolist(), isi.tolist(), strict=True))}
    left = design.n_trials.copy()
    for (s1, s2, seconds), i in places.items():
        other = places.get((s2, s1, seconds), i)
        if other > i:
            both = int(min(left[i], left[other]))
            left[[i, other]] -= both
            yield [i, other], both
    yield from (([i], int(count)) for i, count in enumerate(left))


# --- In which order ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Block:
    """Equal and different pairs of one block, and in how many ways equal ones can stand between its different ones."""

    equal: int
    different: int
    log_ways: FloatArray

    @classmethod
    def of(cls, equal: int, different: int) -> _Block:
        return cls(equal, different, _log_ways(equal, max(different - 1, 0)))

    def log_firsts(self, before: int, last: int) -> FloatArray:
        """Log of the number of orders with 0, 1, ... equal pairs first and `last` at the end, `before` having come before."""
        first = np.arange(MOST_EQUAL - before + 1)
        if not self.different:
            return np.where((first == self.equal) & (before + first == last), 0.0, -np.inf)
        between = self.equal - first - last
        return np.where(between >= 0, self.log_ways[-1][np.maximum(between, 0)], -np.inf)

    def sampled(self, before: int, last: int, rng: np.random.Generator) -> list[int]:
        """How many equal pairs stand before, between and after the different ones; all ways equally probable."""
        found = [_draw(self.log_firsts(before, last), rng)]
        left = self.equal - found[0] - last
        for gaps in range(self.different - 1, 0, -1):
            found.append(_draw(np.array([self.log_ways[gaps - 1, left - size] for size in range(min(left, MOST_EQUAL) + 1)]), rng))
            left -= found[-1]
        return [*found, last] if self.different else found


def _gaps(equal: IntArray, different: IntArray, rng: np.random.Generator) -> list[list[int]]:
    """Of every block, how many equal pairs stand before, between and after the different ones; all ways of all blocks equally probable."""
    blocks = [_Block.of(int(e), int(d)) for e, d in zip(equal, different, strict=True)]
    runs = range(MOST_EQUAL + 1)
    ways = [np.array([[logsumexp(block.log_firsts(before, last)) for last in runs] for before in runs]) for block in blocks]
    ahead = [np.zeros(MOST_EQUAL + 1)]
    for transition in reversed(ways):
        ahead.insert(0, logsumexp(transition + ahead[0], axis=1))
    if np.isneginf(ahead[0][0]):
        worst = int((equal - MOST_EQUAL * different).argmax())
        raise InputError(
            f"block {worst + 1}, of {equal[worst] + different[worst]} trials, has {equal[worst]} equal pairs: more than {MOST_EQUAL} would "
            "follow each other; allowed: a design with fewer equal pairs, or fewer blocks"
        )
    found, run = [], 0
    for block, transition, rest in zip(blocks, ways, ahead[1:], strict=True):
        last = _draw(transition[run] + rest, rng)
        found.append(block.sampled(run, last, rng))
        run = last
    return found


def _draw(log_weights: FloatArray, rng: np.random.Generator) -> int:
    p = np.exp(log_weights - log_weights.max())
    return int(rng.choice(len(p), p=p / p.sum()))


def _ordered(design: StudyDesign, counts: IntArray, gaps: list[int], rng: np.random.Generator) -> IndexArray:
    """Pairs of one block in random order, with so many equal ones before, between and after the different ones."""
    trials = np.repeat(np.arange(len(counts)), counts)
    rng.shuffle(trials)
    same = design.s1[trials] == design.s2[trials]
    equal, different = iter(trials[same].tolist()), iter(trials[~same].tolist())
    order = [next(equal) for _ in range(gaps[0])]
    for size in gaps[1:]:
        order += [next(different), *(next(equal) for _ in range(size))]
    return np.array(order)


def _log_ways(equal: int, gaps: int) -> FloatArray:
    """Log of the number of ways to put 0..equal into 0..gaps gaps, at most three in each, shape (gaps + 1, equal + 1)."""
    ways = np.full((gaps + 1, equal + 1), -np.inf)
    ways[0, 0] = 0.0
    for gap in range(1, gaps + 1):
        for size in range(min(MOST_EQUAL, equal) + 1):
            ways[gap, size:] = np.logaddexp(ways[gap, size:], ways[gap - 1, : equal + 1 - size])
    return ways
