"""Fisher information of one trial about the effects of order, for assumed observers.

`information` computes it for each pair. `exchange_trials` distributes trials over pairs so that the
information of all is as large as it can be.

An answer to a pair with P(yes) = q has the information g g' q/(1 - q), g the gradient of log q in
the coordinates of 'both'. With the curvature of the prior and the information of all trials it
makes a normal approximation of the posterior at each observer's true values. A design's utility is
half the log determinant of the precision of what is asked about, once all other parameters are
estimated.

Trials are moved, a portion at a time, to the pair where they tell most, until no move is worth it
(Fedorov 1972).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray, IndexArray, IntArray
from bayes_toe.design.observers import Observer
from bayes_toe.design.study_design import StudyDesign
from bayes_toe.model.answer_curves import times_counts
from bayes_toe.model.models import OrderModel
from bayes_toe.model.parameters import ObserverPrior

#: What a design may be made for, with the coordinates that are asked about.
AIMS = {
    "order-effect": ("constant_error", "contraction"),
    "constant-error": ("constant_error",),
    "contraction": ("contraction",),
}
_GAIN = 1e-7  # by which a move of trials has to raise the utility


@dataclass(frozen=True, eq=False)
class Information:
    """Information of one trial of each pair about each observer, whose model has k coordinates.

    Attributes
    ----------
    rows : ndarray, shape (observers, pairs, answers, k)
        The information of a trial, (k, k), is R'R with the rows R of its pair, (answers, k).
    prior : ndarray, shape (observers, k, k)
        Curvature of the prior.
    is_target : ndarray of bool, shape (k,)
        The coordinates that are asked about.
    """

    rows: FloatArray
    prior: FloatArray
    is_target: BoolArray

    def total(self, n_trials: IntArray) -> FloatArray:
        """Precision after so many trials of each pair, (pairs,) -> (observers, k, k).

        It is the curvature of the prior, plus the information n R'R of the n trials of each pair.
        """
        index = np.flatnonzero(n_trials)  # pairs without trials add nothing, and would cost time
        n_observers, _, n_answers, k = self.rows.shape
        rows = self.rows[:, index].reshape(n_observers, -1, k)  # all answers to all pairs
        n_of_rows = np.repeat(n_trials[index], n_answers)  # the trials of the pair of each row
        return self.prior + np.swapaxes(rows, 1, 2) @ (rows * n_of_rows[:, None])

    def utility(self, n_trials: IntArray) -> float:
        """Half the log determinant of the precision of what is asked about, mean over observers.

        Once the nuisance parameters, all others, are estimated, that precision is a Schur
        complement of the total precision, with the determinant det(total) / det(nuisance block).
        """
        total = self.total(n_trials)
        _, log_total = np.linalg.slogdet(total)  # (observers,)
        _, log_nuisance = np.linalg.slogdet(self._nuisance_block(total))
        return float(0.5 * (log_total - log_nuisance).mean())

    def utilities(self, n_trials: IntArray, n_more: float) -> FloatArray:
        """The utility with `n_more` trials added to one pair, for each pair: (pairs,)."""
        total = self.total(n_trials)
        growth = _log_growth(total, self.rows, n_more)  # (observers, pairs)
        nuisance_rows = self.rows[..., ~self.is_target]
        nuisance_growth = _log_growth(self._nuisance_block(total), nuisance_rows, n_more)
        return self.utility(n_trials) + 0.5 * (growth - nuisance_growth).mean(axis=0)

    def _nuisance_block(self, total: FloatArray) -> FloatArray:
        """The block of a precision, (observers, k, k), of the coordinates not asked about."""
        return total[:, ~self.is_target][:, :, ~self.is_target]


def _log_growth(total: FloatArray, rows: FloatArray, n_more: float) -> FloatArray:
    """Log of the growth of a determinant by n more trials of each pair: (observers, pairs).

    With the total T, (observers, k, k), and the rows R of a pair, det(T + n R'R) = det(T) growth,
    with growth = det(1 + n R T^-1 R').
    """
    solved = rows @ np.linalg.inv(total)[:, None]  # R T^-1, (observers, pairs, answers, k)
    # R T^-1 R', (observers, pairs, answers, answers).
    products = (solved[:, :, :, None] * rows[:, :, None]).sum(axis=-1)
    n_answers = rows.shape[2]
    return np.asarray(np.log(np.linalg.det(np.eye(n_answers) + n_more * products)))


def information(
    pairs: StudyDesign,
    observers: Sequence[Observer],
    aim: str,
    prior: ObserverPrior,
) -> Information:
    """Information of every pair about the observers, for one of :data:`AIMS`.

    The information of a trial is the sum over answers of P g g', with the gradient g of log P. So
    the row of an answer is the root of P times g.

    The constant error is that at the mean first stimulus of the pairs. The utility for
    'order-effect' hardly depends on that mean: another one adds a multiple of the contraction to
    the constant error.
    """
    posterior = OrderModel("both").posterior(pairs.unanswered, prior)
    parameters = {}
    for name in posterior.coordinates:
        parameters[name] = np.array([observer.parameters[name] for observer in observers])
    # At a lapse rate of 0 its information is not defined.
    parameters["lapse_rate"] = np.maximum(parameters["lapse_rate"], 1e-3)
    points = posterior.full_points(posterior.points(parameters))  # (1, observers, k)

    rows = []  # of each answer, (observers, pairs, k)
    # For each answer, log P has the shape (1, observers, pairs), and g (1, observers, k, pairs).
    for log_p, g in zip(*posterior.rows.answer_slopes(points), strict=True):
        # An impossible answer has no slope, and adds nothing.
        scaled_slope = times_counts(np.exp(0.5 * log_p)[..., None, :], g)
        rows.append(np.swapaxes(scaled_slope[0], 1, 2))

    _, curvature = posterior.array.prior_slopes(points)  # (1, observers, k)
    is_target = np.isin(posterior.coordinates, AIMS[aim])
    prior_curvature = curvature[0][:, :, None] * np.eye(len(is_target))  # on the diagonal
    return Information(np.stack(rows, axis=2), prior_curvature, is_target)


# --- Exchange -------------------------------------------------------------------------------------


def exchange_trials(
    information: Information,
    trials: int,
    most_pairs: int,
    fixed: IntArray,
    turned: IndexArray,
) -> IntArray:
    """Distribute trials over pairs, beside the fixed trials, for the largest utility.

    A pair and the same stimuli in the other order share the trials that move.

    Parameters
    ----------
    information : Information
    trials : int
        To distribute.
    most_pairs : int
        Ordered pairs that the design may have: two stimuli in both orders are two of them.
    fixed : ndarray of int, shape (pairs,)
        Trials that stay with their pairs.
    turned : ndarray of int, shape (pairs,)
        The index of each pair in the other order, as :attr:`StudyDesign.turned` has it.

    Returns
    -------
    ndarray of int, shape (pairs,)
        All trials of each pair.
    """
    # The trials are about two portions for each pair. A portion has two halves: trials of a pair,
    # and as many of the same stimuli in the other order.
    n_portions = 2 * most_pairs
    half = max(1, trials // (2 * n_portions))
    portion = 2 * half
    n_trials = fixed
    for _ in range(trials // portion):
        n_trials = _add_trials(information, n_trials, turned, portion, most_pairs)
    n_trials = _moved_trials(information, n_trials, turned, half, most_pairs, fixed)

    # What is left of the last portion goes to pairs that the design has: with `most_pairs=0` no
    # pair may be new. Two trials at a time keep both orders equally frequent, and an odd trial
    # comes last.
    for _ in range(trials % portion // 2):
        n_trials = _add_trials(information, n_trials, turned, size=2, most_pairs=0)
    if trials % 2:
        n_trials = _add_trials(information, n_trials, turned, size=1, most_pairs=0)
    return n_trials


def _moved_trials(
    information: Information,
    n_trials: IntArray,
    turned: IndexArray,
    half: int,
    most_pairs: int,
    fixed: IntArray,
) -> IntArray:
    """The trials of every pair, once no move of a portion from a pair to the best pair is worth it.

    A portion has `half` trials of each order. Fixed trials do not move.
    """
    stands_for_pair = turned >= np.arange(len(turned))  # the first of both orders
    utility = information.utility(n_trials)
    last_utility = -np.inf
    while utility > last_utility + _GAIN:
        last_utility = utility
        for pair in np.flatnonzero(stands_for_pair & (n_trials > fixed)).tolist():
            while n_trials[pair] > fixed[pair]:
                fewer_trials = n_trials.copy()
                fewer_trials[pair] -= half
                fewer_trials[turned[pair]] -= half
                new_trials = _add_trials(information, fewer_trials, turned, 2 * half, most_pairs)
                utility_of_move = information.utility(new_trials)
                if utility_of_move < utility + _GAIN:
                    break
                n_trials = new_trials
                utility = utility_of_move
    return n_trials


def _add_trials(
    information: Information, n_trials: IntArray, turned: IndexArray, size: int, most_pairs: int
) -> IntArray:
    """The trials of every pair, (pairs,), with `size` more where the utility then rises most.

    Half of these trials are in the other order of the pair. The pair may be new if the design then
    has at most `most_pairs` ordered pairs; 0 allows no new pair.
    """
    is_new = n_trials == 0
    # With its other order, which equal stimuli lack, a pair makes 0, 1 or 2 new pairs.
    has_other_order = turned != np.arange(len(turned))
    n_new = is_new + (is_new[turned] & has_other_order).astype(int)
    is_possible = (n_new == 0) | (np.count_nonzero(n_trials) + n_new <= most_pairs)
    utilities = information.utilities(n_trials, size)
    # Half of the trials are in each order, so that the utilities of both count.
    best_pair = int(np.where(is_possible, utilities + utilities[turned], -np.inf).argmax())

    more_trials = n_trials.copy()
    more_trials[turned[best_pair]] += size // 2
    more_trials[best_pair] += size - size // 2
    return more_trials
