"""Identification: the questions that a subject's pairs and order of trials can answer.

`identify` answers for one subject.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bayes_toe.arrays import FloatArray, Texts, run_starts
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import THREE_ANSWERS, WHICH_STRONGER
from bayes_toe.model.models import OrderModel
from bayes_toe.model.parameters import NOISE, PARAMETERS

QUESTIONS = ("order_effect", "constant_error", "contraction")
#: Share of the largest difference, or of the extent of all pairs, up to which a difference is an
#: error of rounding.
ROUNDING = 1e-6
#: Mean number of trials in blocks of one order from which a shift between blocks looks like an
#: effect of order. In shorter blocks, shifts average out.
_FEWEST_IN_STRETCH = 8
#: Trials of a typical observer in which pairs must say more about p than its prior says.
TYPICAL_TRIALS = 300

NO_DIFFERENCE = "no pair has two different stimuli"
ONE_FIRST_STIMULUS = (
    "the first stimulus is always the same, so a contraction looks like a constant error"
)
ONE_LINE = "s2 is a linear function of s1, so a contraction looks like noise and a constant error"
IMITATION = "these pairs cannot distinguish a contraction from noise that changes with intensity"
CRITERION_NOTES = {
    WHICH_STRONGER: "in 2AFC, a constant error and a response bias predict the same responses",
    THREE_ANSWERS: (
        "with three answers, a constant error and shifted criteria predict the same responses"
    ),
}


@dataclass(frozen=True)
class Identification:
    """The questions that the design of a subject can answer, whatever the responses are.

    Attributes
    ----------
    reasons : mapping
        A reason for each question that cannot be told, by its name in :data:`QUESTIONS`. The design
        can answer the other questions.
    notes : tuple of str
        What a reader of the words must know.
    """

    reasons: Mapping[str, str]
    notes: Texts = ()

    @property
    def contraction_adds_to_error(self) -> bool:
        """Whether these pairs cannot distinguish a contraction from a constant error.

        What looks like a constant error then is the whole order effect.
        """
        return self.reasons.get("contraction") in (ONE_FIRST_STIMULUS, ONE_LINE)


def identify(subject: Subject) -> Identification:
    """The questions that a subject's pairs and order of trials can answer.

    Examples
    --------
    >>> subject = Subject("S01", [0, 0, 0], [-0.2, 0.2, 0.4], [2, 5, 8], [9, 9, 9])
    >>> identify(subject).reasons["contraction"]
    'the first stimulus is always the same, so a contraction looks like a constant error'
    """
    notes = (CRITERION_NOTES[subject.task],) if subject.task in CRITERION_NOTES else ()

    # A reason why the design shows no order effect at all; empty if it can show one.
    order = _order_sign(subject.s1, subject.s2)
    if not order.any():
        reason = NO_DIFFERENCE
    elif order.min() >= 0 or order.max() <= 0:
        reason = "unequal stimuli were presented in one order only"
    elif subject.answers is not None and _order_fills_blocks(subject.answers.answered):
        reason = "each block has one order, so a change between blocks looks like an effect"
    else:
        reason = ""
    if reason:
        return Identification(dict.fromkeys(QUESTIONS, reason), notes)

    reason = _why_no_contraction(subject)
    return Identification({"contraction": reason} if reason else {}, notes)


def _order_sign(s1: FloatArray, s2: FloatArray) -> FloatArray:
    """1 where the second stimulus is larger, -1 where the first is, 0 where both are equal.

    Stimuli that differ by rounding are equal. All shapes are (pairs,), or (rows,).
    """
    difference = s2 - s1
    is_equal = np.abs(difference) <= ROUNDING * np.abs(difference).max()
    return np.where(is_equal, 0.0, np.sign(difference))


def _why_no_contraction(subject: Subject) -> str:
    """The reason why a contraction cannot be identified; empty if it can be."""
    stimuli = np.column_stack([subject.s1, subject.s2])
    deviations = stimuli - stimuli.mean(axis=0)  # (pairs, 2)
    if np.ptp(subject.s1) <= ROUNDING * np.abs(deviations).max():
        return ONE_FIRST_STIMULUS
    # The extents of the pairs along and across the line that is nearest to them.
    largest, smallest = np.linalg.svd(deviations, compute_uv=False)
    if smallest <= ROUNDING * largest:
        return ONE_LINE

    # A few missed trials must not change the verdict, so that numbers of trials are rounded to a
    # power of two times the largest number. Only ratios count: the largest number becomes 1e6.
    shares = subject.n_trials / subject.n_trials.max()
    n_trials = np.ceil(1e6 * 2.0 ** np.rint(np.log2(shares)))
    # A subject needs counts of answers, which do not change the expected information.
    design = replace(subject, n_yes=n_trials, n_trials=n_trials, n_second=None, answers=None)
    if contraction_information(design) < 1.0:  # less than the prior has
        return IMITATION
    return ""


# --- Order of trials -----------------------------------------------------------------------------


def _order_fills_blocks(answers: Answers) -> bool:
    """Whether each block, or each stretch of trials, has only one order, and is long.

    A change between blocks, or stretches, then looks like an effect of order. Equal stimuli do not
    count. Blocks are long if their mean length is at least :data:`_FEWEST_IN_STRETCH` trials.
    """
    order_of_row = _order_sign(*answers.keys.T)
    is_unequal = order_of_row != 0
    order = order_of_row[is_unequal]
    # The most blocks, or stretches, that are long: if there are more, their mean length is shorter.
    most_long_blocks = answers.n_trials[is_unequal].sum() / _FEWEST_IN_STRETCH
    if answers.block is not None:
        blocks, index = np.unique(answers.block[is_unequal], return_inverse=True)
        has_rising = np.bincount(index, order > 0) > 0  # (blocks,)
        has_falling = np.bincount(index, order < 0) > 0
        if len(blocks) <= most_long_blocks and not (has_rising & has_falling).any():
            return True
    # A stretch is a run of rows of one order. Rows are in their order in time if their places are
    # known.
    return answers.place is not None and bool(len(run_starts(order)) <= most_long_blocks)


# --- What the pairs say about p ------------------------------------------------------------------


def contraction_information(subject: Subject) -> float:
    """Fisher information about p of :data:`TYPICAL_TRIALS` trials, in units of the prior's.

    It is what remains once the other parameters are estimated with their priors. Below 1, the prior
    says more than the answers. The observer is typical: no order effect, few lapses, and noise of
    half the step D between stimuli.
    """
    posterior = OrderModel("both").posterior(subject)
    quantities = {parameter.name: np.asarray(parameter.typical) for parameter in PARAMETERS}
    quantities[NOISE.name] *= posterior.scales.step  # typical numbers are in units of D
    point = posterior.full_points(posterior.points(quantities)[None])  # (1, 1, k)
    _, _, informations = posterior.rows.scoring(point)  # (1, 1, k, k)
    information = informations[0, 0] * TYPICAL_TRIALS / subject.total_trials
    _, curvature = posterior.array.prior_slopes(point)  # (1, 1, k)

    # p is the last coordinate, in units of its prior. What remains of its information is a Schur
    # complement: I_pp - I_po (I_oo + prior)^-1 I_op, with o for the others.
    others_precision = information[:-1, :-1] + np.diag(curvature[0, 0, :-1])
    shared = information[-1, :-1]  # I_po
    return float(information[-1, -1] - shared @ np.linalg.solve(others_precision, shared))
