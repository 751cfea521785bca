"""The rows of evidence.csv.

`subject_evidence` makes the row of one subject, and `EvidenceTable` has the rows of a study. A row
has the answer of the subject. It also compares the paper's model (H1) with one free probability
for each pair (H0).

All log evidences are natural logs and leave binomial coefficients out, so their differences are log
Bayes factors. Source of H1 against H0: Appendix C, with the likelihood (not its log) inside the
integral.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from scipy.special import betaln

from bayes_toe.answers.order_effect import ANSWER_COLUMNS, OrderEffect
from bayes_toe.arrays import Texts
from bayes_toe.classical.frequencies import laplace_error, laplace_estimate
from bayes_toe.data.study import Subject
from bayes_toe.data.tables import SubjectTable
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.inference.fitted import Evidence, Fitted
from bayes_toe.inference.goodness_of_fit import GoodnessOfFit
from bayes_toe.inference.maxima import laplace
from bayes_toe.model.densities import LOG_2PI
from bayes_toe.model.prior import Prior

_COMPARISON_COLUMNS = (
    "n_pairs",
    "n_trials",
    "log_evidence_h1",
    "log_evidence_h1_se",
    "log_evidence_h0",
    "log_bayes_factor",
    "log_evidence_h1_laplace",
    "log_evidence_h0_laplace",
    "log_bayes_factor_laplace",
    "pareto_k",
)
#: Columns of evidence.csv: the answer, then the paper's comparison.
EVIDENCE_COLUMNS = (*ANSWER_COLUMNS, *_COMPARISON_COLUMNS, "prior")


@dataclass(frozen=True)
class SubjectEvidence:
    """The answer and log evidences (nats) of one subject.

    A value that does not exist is None. The Laplace approximation of H1 does not exist if the
    Hessian at the maximum is not negative definite.

    Attributes
    ----------
    answer : OrderEffect
    fit : GoodnessOfFit or None
        Goodness of fit of the paper's model (H1), from chains; None without chains.
    notes : tuple of str
        Values that are not reported, and why.
    """

    subject: str
    n_pairs: int
    n_trials: int
    log_evidence_h1: float | None
    log_evidence_h1_se: float | None
    log_evidence_h0: float
    log_evidence_h1_laplace: float | None
    log_evidence_h0_laplace: float
    pareto_k: float
    answer: OrderEffect
    fit: GoodnessOfFit | None
    notes: Texts

    @property
    def cells(self) -> Mapping[str, object]:
        """The entries of evidence.csv by column, without the prior; an empty entry is None."""
        cells = dict(self.answer.cells)
        for column in _COMPARISON_COLUMNS:
            cells[column] = getattr(self, column)
        return cells

    @property
    def log_bayes_factor(self) -> float | None:
        """`log_evidence_h1` minus `log_evidence_h0`; None if H1 has no value.

        If the value is positive, one smooth curve predicts the responses better than one free
        probability per pair.
        """
        return None if self.log_evidence_h1 is None else self.log_evidence_h1 - self.log_evidence_h0

    @property
    def log_bayes_factor_laplace(self) -> float | None:
        """The log Bayes factor of H1 over H0 by Laplace's approximation of both, Appendix C."""
        h1 = self.log_evidence_h1_laplace
        return None if h1 is None else h1 - self.log_evidence_h0_laplace


@dataclass(frozen=True)
class EvidenceTable(SubjectTable[SubjectEvidence]):
    """Evidence of every subject of a study, in the study's order.

    Attributes
    ----------
    seed : int or None
    prior : Prior or None
    failed : mapping of str to str
        Subjects without a row because their work was lost, with the reason.
    task : Task
        The task of the subjects.
    """

    seed: int | None = None
    prior: Prior | None = None
    failed: Mapping[str, str] = field(default_factory=dict)
    task: Task = SAME_DIFFERENT

    def frame(self, *, full: bool = False) -> pd.DataFrame:
        """A row per subject: the words with their sizes; with `full` all columns of evidence.csv.

        The short table has the marks `!` and `?` of the screen. Subjects that failed come last.
        """
        if full:
            return self._full_frame()
        rows = [answer.texts for answer in self.answers]
        rows += [{"subject": name} for name in self.failed]
        return pd.DataFrame(rows)

    def _full_frame(self) -> pd.DataFrame:
        """The table with the columns of evidence.csv.

        Natural logs, empty where a value does not exist; every row names the prior.

        Subjects that failed come last and have no value.
        """
        prior = None if self.prior is None else self.prior.describe_all(self.task)
        rows = [row.cells for row in self.rows]
        rows += [{"subject": name} for name in self.failed]
        frame = pd.DataFrame(rows, columns=EVIDENCE_COLUMNS).assign(prior=prior)
        # A column of counts in which some are missing would be written as decimals, as in 400.0.
        return frame.astype({"n_pairs": "Int64", "n_trials": "Int64"}) if self.failed else frame

    @property
    def answers(self) -> tuple[OrderEffect, ...]:
        """The answers of the subjects."""
        return tuple(row.answer for row in self.rows)


def subject_evidence(fitted: Fitted, estimate: Evidence, answer: OrderEffect) -> SubjectEvidence:
    """The row of one subject in the evidence table, from mixture and evidence of H1."""
    subject = fitted.target.subject
    # H1 predicts only the counted response. To be compared with H0, it gets the part of H0 for
    # 'second' and 'first', which is 0 with two answers.
    direction_part = direction_evidence(subject)
    # The array has one posterior; NaN where the approximation does not exist.
    _, laplace_evidence = laplace(fitted.target.array, [fitted.ends])
    laplace_h1 = float(laplace_evidence[0])

    return SubjectEvidence(
        subject=subject.name,
        n_pairs=subject.n_pairs,
        n_trials=subject.total_trials,
        log_evidence_h1=None if estimate.value is None else estimate.value + direction_part,
        log_evidence_h1_se=estimate.se,
        log_evidence_h0=frequency_evidence(subject),
        log_evidence_h1_laplace=None if np.isnan(laplace_h1) else laplace_h1 + direction_part,
        log_evidence_h0_laplace=frequency_evidence_laplace(subject),
        pareto_k=estimate.pareto_k,
        answer=answer,
        fit=None,  # chains are drawn later, if at all
        notes=(f"H1: {estimate.why_withheld}",) if estimate.why_withheld else (),
    )


def frequency_evidence(subject: Subject) -> float:
    """Exact log evidence of H0, nats: one free probability per pair, with a uniform prior.

    It is the sum of ln B(n_yes + 1, n_no + 1) over the pairs, and over the questions of the task.
    """
    n_no = subject.n_trials - subject.n_yes
    return float(betaln(subject.n_yes + 1.0, n_no + 1.0).sum()) + direction_evidence(subject)


def direction_evidence(subject: Subject) -> float:
    """Exact log evidence, nats, of a free probability of 'second' per pair, among unequal answers.

    Both H0 and H1 include it, so that they predict all three answers: H1 alone says nothing of
    'first' and 'second'. With two answers it is 0.
    """
    if subject.n_second is None:
        return 0.0
    return float(betaln(subject.n_second + 1.0, subject.n_first + 1.0).sum())


def frequency_evidence_laplace(subject: Subject) -> float:
    """Log evidence of H0, nats, by Appendix C's recipe.

    It is the sum over pairs of n_Eq log qhat + n_Diff log(1 - qhat) + log sigmahat_q + log(2 pi)/2,
    with the estimate qhat and the error sigmahat_q of :mod:`bayes_toe.classical.frequencies`.
    """
    n_yes = subject.n_yes
    n_trials = subject.n_trials
    n_no = n_trials - n_yes
    log_q = np.log(laplace_estimate(n_yes, n_trials))  # (pairs,), as all numbers of a pair
    log_complement = np.log(laplace_estimate(n_no, n_trials))
    log_sigma = np.log(laplace_error(n_yes, n_trials))
    log_evidence = n_yes * log_q + n_no * log_complement + log_sigma + 0.5 * LOG_2PI
    # Three answers have a further question, whose part H0 and H1 have in common.
    return float(log_evidence.sum()) + direction_evidence(subject)
