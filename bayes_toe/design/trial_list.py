"""The order in which a design's trials are shown, and the file that an experiment reads.

`trial_list` makes it.

Blocks are alike, both orders of two stimuli are equally frequent in each, and few equal pairs
follow each other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.special import logsumexp

from bayes_toe.arrays import BoolArray, FloatArray, IntArray, Rng
from bayes_toe.data.messages import join_names
from bayes_toe.design.study_design import StudyDesign
from bayes_toe.errors import InputError
from bayes_toe.seeds import generator

#: Equal pairs that may follow each other.
MOST_EQUAL = 3


def trial_list(
    design: StudyDesign,
    *,
    blocks: int = 10,
    subject: str = "S01",
    seed: int,
    conditions: Sequence[str] = (),
    reference: float | None = None,
) -> pd.DataFrame:
    """A random order of all trials of a design, a row a trial; the responses are still to come.

    Every block has its share of every pair, and two stimuli in both orders equally often where the
    design has them so; no more than three equal pairs follow each other, also over the end of a
    block. Of all such orders each is equally probable.

    Parameters
    ----------
    design : StudyDesign
    blocks : int
    subject : str
        Whose trials; the random stream is keyed by it.
    seed : int
    conditions : sequence of str
        Levels of a condition within subjects, each of which has all trials of the design; they are
        mixed within blocks.
    reference : float, optional
        With it raw amplitudes i1 and i2 stand beside the natural-log intensities.

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
    if len(set(conditions)) < len(conditions):
        raise InputError(f"--conditions: found {join_names(conditions)}, allowed: each level once")
    rng = generator(seed, subject, "order of trials")
    n_levels = max(1, len(conditions))
    counts = _block_counts(design, blocks, n_levels, rng)
    is_equal = np.tile(design.s1 == design.s2, n_levels)
    n_equal, n_different = counts[:, is_equal].sum(axis=1), counts[:, ~is_equal].sum(axis=1)
    order = [rng.permutation(np.repeat(np.arange(len(is_equal)), row)) for row in counts]
    masks = _masks_of_equals(n_equal, n_different, rng)
    for trials, mask in zip(order, masks, strict=True):
        equal, different = trials[is_equal[trials]], trials[~is_equal[trials]]
        trials[mask], trials[~mask] = equal, different
    level, pair = np.divmod(np.concatenate(order), design.n_pairs)
    columns: dict[str, npt.ArrayLike] = {"subject": subject}
    if conditions:
        columns["condition"] = np.array(conditions)[level]
    columns["block"] = np.repeat(np.arange(1, blocks + 1), counts.sum(axis=1))
    columns["trial"] = np.arange(1, len(pair) + 1)
    for name, values in zip(("s1", "s2", "isi"), design.columns, strict=False):
        columns[name] = values[pair]
    if reference is not None:
        for name, logs in (("i1", design.s1), ("i2", design.s2)):
            # Without the rounding of logarithms: 45, not 44.99999999999997.
            amplitudes = [float(f"{value:.12g}") for value in reference * np.exp(logs)]
            columns[name] = np.array(amplitudes)[pair]
    return pd.DataFrame({**columns, "response": ""})


# --- Which pairs in which block -------------------------------------------------------------------


def _block_counts(design: StudyDesign, blocks: int, n_levels: int, rng: Rng) -> IntArray:
    """Trials of each pair at each level in each block, shape (blocks, levels * pairs).

    Both orders of two stimuli come first; single pairs then even out the blocks, those of one
    level before those of all levels.
    """
    counts = np.zeros((n_levels, blocks, design.n_pairs), np.int64)
    units = _units(design)
    for of_level in counts:
        shuffled = [units[i] for i in rng.permutation(len(units)).tolist()]
        for pairs, times in sorted(shuffled, key=lambda unit: -len(unit[0])):
            of_level[:, pairs] += times // blocks
            in_block = counts.sum(axis=(0, 2))
            keys = (rng.uniform(size=blocks), of_level[:, pairs].sum(axis=1), in_block)
            fewest = np.lexsort((*keys, of_level.sum(axis=1)))[: times % blocks]
            of_level[np.ix_(fewest, pairs)] += 1
    return np.hstack(list(counts))


def _units(design: StudyDesign) -> list[tuple[list[int], int]]:
    """The units that stay together in a block, and how often each comes.

    Both orders of two stimuli, and what is left.
    """
    index = {pair: i for i, pair in enumerate(design.pairs)}
    n_left = design.n_trials.copy()
    units = []
    for (s1, s2, *isi), i in index.items():
        turned = index.get((s2, s1, *isi), i)
        if turned > i:
            n_common = int(min(n_left[i], n_left[turned]))
            n_left[[i, turned]] -= n_common
            units.append(([i, turned], n_common))
    units += [([i], count) for i, count in enumerate(n_left.tolist())]
    return [(pairs, times) for pairs, times in units if times]


# --- Where the equal pairs stand ------------------------------------------------------------------


def _masks_of_equals(n_equal: IntArray, n_different: IntArray, rng: Rng) -> list[BoolArray]:
    """The trials of every block that are equal pairs, (trials,) each.

    All ways are equally probable.
    """
    masks = []
    run = 0  # equal pairs that came last
    for log_ways in _count_ways(n_equal, n_different):
        n_left = log_ways.shape[1] - 1  # equal pairs of the block that are still to come
        run_sizes = []
        for different_after in range(log_ways.shape[0] - 2, -1, -1):
            fewest_left = max(0, n_left - (MOST_EQUAL - run))
            log_p = log_ways[different_after, fewest_left : n_left + 1]
            p = np.exp(log_p - logsumexp(log_p))
            next_left = fewest_left + int(rng.choice(len(p), p=p))
            run_sizes.append(n_left - next_left)
            n_left, run = next_left, 0
        mask: list[bool] = []
        for size in run_sizes:
            mask += [True] * size + [False]
        masks.append(np.array(mask + [True] * n_left, np.bool_))
        run += n_left
    return masks


def _count_ways(n_equal: IntArray, n_different: IntArray) -> list[FloatArray]:
    """Log numbers of ways with no more than three equal pairs in a row, a table for each block.

    An entry, (different, equal) pairs that are still to come in the block, counts the ways from
    there to the end of the last block, where a different pair came last.
    """
    tables = []
    from_next = np.zeros(MOST_EQUAL + 1)  # ways from the next block on, by the run before it
    for e, d in zip(n_equal[::-1].tolist(), n_different[::-1].tolist(), strict=True):
        log_ways = np.full((d + 1, e + 1), -np.inf)
        log_ways[0, : MOST_EQUAL + 1] = from_next[: e + 1]
        for left in range(1, d + 1):
            for size in range(min(MOST_EQUAL, e) + 1):
                with_run = log_ways[left - 1, : e + 1 - size]
                log_ways[left, size:] = np.logaddexp(log_ways[left, size:], with_run)
        tables.append(log_ways)
        from_block = np.full(MOST_EQUAL + 1, -np.inf)
        for run in range(MOST_EQUAL + 1):
            if d:
                fewest = max(0, e - MOST_EQUAL + run)
                from_block[run] = logsumexp(log_ways[d - 1, fewest:])
            elif run + e <= MOST_EQUAL:
                from_block[run] = from_next[run + e]
        from_next = from_block
    if np.isneginf(from_next[0]):
        worst = int((n_equal - MOST_EQUAL * n_different).argmax())
        n_trials = n_equal[worst] + n_different[worst]
        raise InputError(
            f"block {worst + 1}, of {n_trials} trials, has {n_equal[worst]} equal pairs: more than "
            f"{MOST_EQUAL} would follow each other; allowed: a design with fewer equal pairs, or "
            "fewer blocks"
        )
    return tables[::-1]
