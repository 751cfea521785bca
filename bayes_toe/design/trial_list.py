"""The order in which a design's trials are shown, and the file that an experiment reads.

Blocks are alike, both orders of two stimuli are equally frequent in each, and few equal pairs
follow each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from numbers import Integral

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayes_toe.arrays import BoolArray, IndexArray, IntArray, Rng
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit
from bayes_toe.design.simulate import simulated_conditions
from bayes_toe.design.study_design import StudyDesign, stimulus_columns
from bayes_toe.errors import InputError, require_kind
from bayes_toe.seeds import generator

#: The most equal pairs that may follow each other.
MOST_EQUAL = 3


def trial_list(
    design: StudyDesign,
    *,
    blocks: int = 10,
    subject: str = "S01",
    seed: int,
    conditions: Sequence[str] = (),
    unit: StimulusUnit = UNKNOWN_UNIT,
) -> pd.DataFrame:
    """List all trials of a design in random order, with an empty column of responses.

    Every block has its share of every pair, and two stimuli in both orders equally often where the
    design has them so. No more than three equal pairs follow each other, also over the end of a
    block.

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
    unit : StimulusUnit
        Of the columns of the stimuli.

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
    # Nobody is simulated, so that nothing differs between the conditions.
    study_conditions = simulated_conditions(conditions, sizes={})
    levels = () if study_conditions is None else study_conditions.levels
    rng = generator(seed, subject, "order of trials")
    n_levels = max(1, len(levels))
    is_equal = np.tile(design.s1 == design.s2, n_levels)
    order = _shuffled(_blocks(design, blocks, n_levels, rng), is_equal, rng)

    # A trial is the number level * n_pairs + pair; level and pair have the shape (trials,).
    level, pair = np.divmod(np.concatenate(order), design.n_pairs)
    columns: dict[str, npt.ArrayLike] = {"subject": subject}
    if levels:
        columns["condition"] = np.array(levels)[level]
    columns["block"] = np.repeat(np.arange(1, blocks + 1), list(map(len, order)))
    columns["trial"] = np.arange(1, len(pair) + 1)
    for name, values in stimulus_columns(design.s1, design.s2, unit).items():
        columns[name] = values[pair]
    return pd.DataFrame({**columns, "response": ""})


def _blocks(design: StudyDesign, blocks: int, n_levels: int, rng: Rng) -> list[IndexArray]:
    """The trials of each block, as numbers level * n_pairs + pair, dealt out to the blocks in turn.

    Two stimuli in both orders are dealt together, before the trials that are left. The trials of a
    pair are dealt one after the other, and so come to different blocks.
    """
    n_left = design.n_trials.copy()
    # Pairs that stay together in a block, and how often they come, as in ([3, 7], 20), where pair 7
    # is pair 3 in the other order.
    both_orders = []
    for i, turned in enumerate(design.turned.tolist()):
        if turned > i:  # the other order, seen from the first of the two
            n_common = int(min(n_left[i], n_left[turned]))
            n_left[[i, turned]] -= n_common
            both_orders.append(([i, turned], n_common))
    one_order = [([i], count) for i, count in enumerate(n_left.tolist())]

    # The order of dealing is random, but for both orders that come before one order. An array has
    # the one or two trials that come to the same block.
    dealt = []
    for pairs_and_counts in (both_orders, one_order):
        to_deal = list(product(range(n_levels), pairs_and_counts))
        for i in rng.permutation(len(to_deal)).tolist():
            level, (pairs, n_times) = to_deal[i]
            dealt += [np.add(level * design.n_pairs, pairs)] * n_times

    require_kind("--blocks", blocks, Integral, "a whole number")
    if not 1 <= blocks <= len(dealt):
        raise InputError(
            f"--blocks {blocks}: allowed is 1 to {len(dealt)}, so that every block has a trial and "
            "both orders of it"
        )
    # Block 0 gets the arrays 0, n, 2 n and so on; then the n blocks come in a random order.
    return [np.concatenate(dealt[start::blocks]) for start in rng.permutation(blocks).tolist()]


def _shuffled(blocks: Sequence[IndexArray], is_equal: BoolArray, rng: Rng) -> list[IndexArray]:
    """The trials of each block in a random order, without too many equal pairs in a row.

    The first equal pair that is one too many changes places with a random different pair of its
    block, until no equal pair is too many. `is_equal` says of each number of a trial, see
    :func:`_blocks`, whether its stimuli are equal.
    """
    order = []  # the trials of each block
    n_last = 0  # equal pairs in a row at the end of the block before
    for i, trials in enumerate(blocks):
        shuffled = rng.permutation(trials)
        for _ in range(10_000):  # usually a few changes are enough; there may be no solution
            lengths = _run_lengths(is_equal[shuffled], n_last)
            surplus = np.flatnonzero(lengths > MOST_EQUAL)  # positions in the block
            different = np.flatnonzero(~is_equal[shuffled])
            if not len(surplus) or not len(different):
                break
            index = [surplus[0], rng.choice(different)]
            shuffled[index] = shuffled[index[::-1]]  # both change places

        if lengths.max() > MOST_EQUAL:
            raise InputError(
                f"block {i + 1}, of {len(trials)} trials, has {is_equal[trials].sum()} equal "
                f"pairs: more than {MOST_EQUAL} would follow each other; allowed: a design with "
                "fewer equal pairs, or fewer blocks"
            )
        order.append(shuffled)
        n_last = lengths[-1]
    return order


def _run_lengths(is_equal: BoolArray, length: int) -> IntArray:
    """Number of equal pairs in a row that end with each trial; 0 where its pair is different.

    `length` equal pairs come before the first trial.
    """
    lengths = []
    for equal in is_equal.tolist():
        length = length + 1 if equal else 0
        lengths.append(length)
    return np.array(lengths)
