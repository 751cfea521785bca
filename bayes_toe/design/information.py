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
    """Information of one trial of each pair about each observer.

    Attributes
    ----------
    rows : ndarray, shape (observers, pairs, questions, k)
        The information of a trial is the sum of the outer products of its rows with themselves.
    prior : ndarray, shape (observers, k, k)
        Curvature of the prior.
    is_target : ndarray of bool, shape (k,)
        The coordinates that are asked about.
    """

    rows: FloatArray
    prior: FloatArray
    is_target: BoolArray

    def total(self, n_trials: IntArray) -> FloatArray:
        """Information of so many trials of each pair, (pairs,), and the prior.

        The shape is (observers, k, k).
        """
        index = np.flatnonzero(n_trials)
        n_observers, _, n_questions, k = self.rows.shape
        rows = self.rows[:, index].reshape(n_observers, -1, k)
        weighted = rows * np.repeat(n_trials[index], n_questions)[:, None]
        return self.prior + np.swapaxes(rows, 1, 2) @ weighted

    def utility(self, total: FloatArray) -> float:
        """Half the log determinant of the precision of what is asked about, mean over observers."""
        log_nuisance = np.linalg.slogdet(self._nuisance_block(total))[1]
        return float(0.5 * (np.linalg.slogdet(total)[1] - log_nuisance).mean())

    def utilities(self, total: FloatArray, n_more: float) -> FloatArray:
        """The same with so many trials more of each pair, one pair after the other: (pairs,)."""
        growth = _log_growth(total, self.rows, n_more)
        nuisance_rows = self.rows[..., ~self.is_target]
        nuisance_growth = _log_growth(self._nuisance_block(total), nuisance_rows, n_more)
        return self.utility(total) + 0.5 * (growth - nuisance_growth).mean(axis=0)

    def _nuisance_block(self, total: FloatArray) -> FloatArray:
        """The block of all other coordinates."""
        return total[:, ~self.is_target][:, :, ~self.is_target]


def _log_growth(total: FloatArray, rows: FloatArray, n_more: float) -> FloatArray:
    """Log of the growth of the determinant by n more trials of a pair: (observers, pairs)."""
    spread = rows @ np.linalg.inv(total)[:, None]
    products = (spread[:, :, :, None] * rows[:, :, None]).sum(axis=-1)
    return np.asarray(np.log(np.linalg.det(np.eye(rows.shape[2]) + n_more * products)))


def information(
    pairs: StudyDesign,
    observers: Sequence[Observer],
    aim: str,
    prior: ObserverPrior,
) -> Information:
    """Information of every pair about the observers, for one of :data:`AIMS`.

    The constant error is that at the mean first stimulus of the pairs. The utility for
    'order-effect' hardly depends on that mean: another one adds a multiple of the contraction to
    the constant error.
    """
    posterior = OrderModel("both").posterior(pairs.unanswered, prior)
    n_questions = len(pairs.task.questions)
    arrays = {}
    for name in posterior.coordinates:
        arrays[name] = np.array([observer.parameters[name] for observer in observers])
    # At a lapse rate of 0 its information is not defined.
    arrays["lapse_rate"] = np.maximum(arrays["lapse_rate"], 1e-3)
    points = posterior.full_points(posterior.points(arrays))

    answers, yes_slopes, _ = posterior.rows.answer_slopes(points)
    # A trial asks the second question as often as the answer to the first one is not 'equal'.
    of_trial = posterior.rows.expected_trials(answers)[0] / np.tile(pairs.n_trials, n_questions)
    odds_root = np.exp(0.5 * (answers.yes - answers.no))[0] * np.sqrt(of_trial)
    scaled_slopes = np.swapaxes(yes_slopes[0], 1, 2) * odds_root[..., None]
    slopes = np.stack(np.split(scaled_slopes, n_questions, axis=1), axis=2)

    curvature = posterior.array.prior_slopes(points)[1][0]
    is_target = np.isin(posterior.coordinates, AIMS[aim])
    return Information(slopes, curvature[:, :, None] * np.eye(len(is_target)), is_target)


# --- Exchange -------------------------------------------------------------------------------------


def exchange_trials(
    information: Information,
    trials: int,
    most_pairs: int,
    fixed: IntArray,
    turned: IndexArray,
) -> IntArray:
    """Trials of every pair, (pairs,): so many beside those that are fixed, over few enough pairs.

    A pair and the same stimuli in the other order share the trials that move.

    Parameters
    ----------
    information : Information
    trials : int
    most_pairs : int
        Different pairs.
    fixed : ndarray of int, shape (pairs,)
    turned : ndarray of int, shape (pairs,)
        The place of each pair in the other order; both are shown equally often.
    """
    movable = np.zeros_like(fixed)
    has_turn = turned != np.arange(len(turned))

    def present_trials() -> IntArray:
        """Trials of every pair: half of those that move are of the pair in the other order."""
        return fixed + (movable + movable[turned]) // 2

    def best_pair(size: int, most_pairs: int) -> int:
        """The pair where so many trials more tell most, among those that are still allowed."""
        n_trials = present_trials()
        utilities = information.utilities(information.total(n_trials), size)
        is_new = n_trials == 0
        n_new = is_new + (is_new[turned] & has_turn).astype(int)
        is_possible = (n_new == 0) | (np.count_nonzero(n_trials) + n_new <= most_pairs)
        both_orders = utilities + utilities[turned]
        return int(np.where(is_possible, both_orders, -np.inf).argmax())

    # About two portions for each pair.
    portion = 2 * max(1, trials // (4 * most_pairs))
    for _ in range(trials // portion):
        movable[best_pair(portion, most_pairs)] += portion

    utility, last_utility = information.utility(information.total(present_trials())), -np.inf
    while utility > last_utility + _GAIN:
        last_utility = utility
        for pair in np.flatnonzero(movable).tolist():
            # Portions of the pair move elsewhere as long as that is worth it.
            while movable[pair]:
                movable[pair] -= portion
                target = best_pair(portion, most_pairs)
                movable[target] += portion
                moved = information.utility(information.total(present_trials()))
                if moved < utility + _GAIN:
                    movable[target] -= portion
                    movable[pair] += portion
                    break
                utility = moved

    # What is left goes to pairs that there are.
    for _ in range(trials % portion // 2):
        movable[best_pair(2, 0)] += 2
    n_trials = present_trials()
    if (n_trials - fixed).sum() < trials:
        n_trials[best_pair(1, 0)] += 1
    return n_trials
