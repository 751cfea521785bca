"""The order in which a design's trials are shown, and the file that an experiment reads.

Blocks are alike, both orders of two stimuli are equally frequent in each, and few equal pairs follow
each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from bayes_toe.arrays import BoolArray, FloatArray, IntArray
from bayes_toe.data.tables import write_table
from bayes_toe.design.study_design import StudyDesign
from bayes_toe.errors import InputError
from bayes_toe.seeds import generator

#: Equal pairs that may follow each other.
MOST_EQUAL = 3


@dataclass(frozen=True, eq=False)
class TrialList:
    """Trials of one subject in the order in which they are shown; the answers are still to come.

    Blocks count from 1; s1 and s2 are natural-log intensities, isi is in seconds, conditions are names; shape (trials,) each.
    """

    subject: str
    block: IntArray
    s1: FloatArray
    s2: FloatArray
    isi: FloatArray | None = None
    condition: npt.NDArray[np.str_] | None = field(default=None, kw_only=True)


def trial_list(
    design: StudyDesign,
    *,
    blocks: int = 10,
    subject: str = "S01",
    seed: int,
    conditions: Sequence[str] = (),
) -> TrialList:
    """A random order of all trials of a design, under each of the conditions, mixed within blocks, where there are some.

    Every block has its share of every pair, and two stimuli in both orders equally often where the design has them so; no more than three
    equal pairs follow each other, also over the end of a block. Of all orders that are so, each is equally probable.

    Parameters
    ----------
    design : StudyDesign
    blocks : int
    subject : str
        Whose trials; the random stream is keyed by it.
    seed : int
    conditions : sequence of str
        Levels of a condition within subjects, each of which has all trials of the design.

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
    levels = max(1, len(conditions))
    counts, same = (
        np.hstack([_blocks(design, blocks, rng) for _ in range(levels)]),
        np.tile(design.s1 == design.s2, levels),
    )
    order = [rng.permutation(np.repeat(np.arange(len(same)), of_block)) for of_block in counts]
    for trials, equal in zip(
        order,
        _places_of_equals(counts[:, same].sum(axis=1), counts[:, ~same].sum(axis=1), rng),
        strict=True,
    ):
        trials[equal], trials[~equal] = trials[same[trials]], trials[~same[trials]]
    block = np.repeat(np.arange(1, blocks + 1), counts.sum(axis=1))
    level, pair = np.divmod(np.concatenate(order), design.n_pairs)
    found = TrialList(subject, block, *(column[pair] for column in design.columns))
    return replace(found, condition=np.array(conditions)[level]) if conditions else found


def save_trials(
    lists: list[TrialList],
    path: str | Path,
    *,
    reference: float | None = None,
    overwrite: bool = False,
) -> Path:
    """Write trial lists as one CSV file that :func:`bayes_toe.data.read_study.read_study` reads once the column response is filled in.

    Columns: subject, condition where there are some, block, trial (over all blocks), s1, s2, isi where there are intervals, i1 and i2 =
    reference e^s where the reference amplitude is given, and response, which is empty.
    """
    import pandas as pd

    parts = []
    for one in lists:
        columns: dict[str, Any] = {"subject": one.subject} | (
            {} if one.condition is None else {"condition": one.condition}
        )
        columns |= {
            "block": one.block,
            "trial": np.arange(1, len(one.s1) + 1),
            "s1": one.s1,
            "s2": one.s2,
        }
        columns |= {} if one.isi is None else {"isi": one.isi}
        columns |= (
            {}
            if reference is None
            else {"i1": reference * np.exp(one.s1), "i2": reference * np.exp(one.s2)}
        )
        parts.append(pd.DataFrame({**columns, "response": ""}))
    return write_table(pd.concat(parts), path, overwrite=overwrite)


# --- Which pairs in which block, and where the equal ones ---------------------------------------------


def _blocks(design: StudyDesign, blocks: int, rng: np.random.Generator) -> IntArray:
    """Trials of each pair in each block, shape (blocks, pairs); blocks differ by as little as they can.

    Both orders of two stimuli come before what is single, which then evens out the blocks, where it can also those of its pair.
    """
    counts = np.zeros((blocks, design.n_pairs), np.int64)
    units = [(pairs, times) for pairs, times in _units(design) if times]
    for index in sorted(
        rng.permutation(len(units)).tolist(), key=lambda index: -len(units[index][0])
    ):
        pairs, times = units[index]
        counts[:, pairs] += times // blocks
        fewest = np.lexsort(
            (rng.uniform(size=blocks), counts[:, pairs].sum(axis=1), counts.sum(axis=1))
        )[: times % blocks]
        counts[np.ix_(fewest, pairs)] += 1
    return counts


def _units(design: StudyDesign) -> Iterator[tuple[list[int], int]]:
    """What is kept together in a block: both orders of two stimuli as often as both occur, and what is left of either; with how often."""
    places = {pair: i for i, pair in enumerate(design.pairs)}
    left = design.n_trials.copy()
    for (s1, s2, *isi), i in places.items():
        other = places.get((s2, s1, *isi), i)
        if other > i:
            both = int(min(left[i], left[other]))
            left[[i, other]] -= both
            yield [i, other], both
    yield from (([i], int(count)) for i, count in enumerate(left))


def _places_of_equals(
    equal: IntArray, different: IntArray, rng: np.random.Generator
) -> list[BoolArray]:
    """Of every block with so many pairs, which of its trials are equal ones: all ways with no more than three in a row equally probable.

    Ways are counted from the end: of each block by how many different and equal pairs are to come where a different one was last, and of
    all blocks from one on by the run of equal ones before it.
    """
    tables, from_here = [], np.zeros(MOST_EQUAL + 1)
    for e, d in zip(equal[::-1], different[::-1], strict=True):
        log_ways = np.full((d + 1, e + 1), -np.inf)
        log_ways[0, : MOST_EQUAL + 1] = from_here[: e + 1]
        for left in range(1, d + 1):
            for size in range(min(MOST_EQUAL, e) + 1):
                log_ways[left, size:] = np.logaddexp(
                    log_ways[left, size:], log_ways[left - 1, : e + 1 - size]
                )
        tables.append(log_ways)
        runs = range(MOST_EQUAL + 1)
        if d:
            from_here = np.array(
                [logsumexp(log_ways[d - 1, max(0, e - MOST_EQUAL + run) :]) for run in runs]
            )
        else:
            from_here = np.array(
                [from_here[run + e] if run + e <= MOST_EQUAL else -np.inf for run in runs]
            )
    if np.isneginf(from_here[0]):
        worst = int((equal - MOST_EQUAL * different).argmax())
        raise InputError(
            f"block {worst + 1}, of {equal[worst] + different[worst]} trials, has {equal[worst]} equal pairs: more than {MOST_EQUAL} would "
            "follow each other; allowed: a design with fewer equal pairs, or fewer blocks"
        )
    found, run = [], 0
    for log_ways in reversed(tables):
        d, e = (size - 1 for size in log_ways.shape)
        sizes = []  # of runs of equal ones before each different one
        for left in range(d - 1, -1, -1):
            fewest = max(0, e - MOST_EQUAL + run)
            p = np.exp(log_ways[left, fewest : e + 1] - logsumexp(log_ways[left, fewest : e + 1]))
            sizes.append(e - fewest - int(rng.choice(len(p), p=p)))
            e, run = e - sizes[-1], 0
        found.append(
            np.insert(
                np.ones(log_ways.shape[1] - 1, np.bool_), np.cumsum(sizes, dtype=np.int64), False
            )
        )
        run += e
    return found
