"""Model evidence of one subject: the predictive-update model (H1) against one free frequency per pair (H0).

All values are natural logs and leave binomial coefficients out on both sides, so their difference is the log Bayes factor.
Source: Appendix C, with the likelihood (not its log) inside the integral.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import betaln, logsumexp

from bayes_toe.classical.bootstrap import Bootstrap, bootstrap_evidence
from bayes_toe.data.study import Subject
from bayes_toe.data.tables import SubjectTable
from bayes_toe.inference.laplace import laplace_evidence, laplace_evidence_natural
from bayes_toe.inference.modes import Maxima
from bayes_toe.inference.proposal import FittedProposal
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import LOG_2PI, Prior

if TYPE_CHECKING:
    import pandas as pd


#: Columns of evidence.csv. New ones are appended only: scripts that read by position go on working.
EVIDENCE_COLUMNS = (
    "subject",
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
    "log_evidence_h1_laplace_natural",
    "log_evidence_h1_bootstrap",
    "prior",
)


_NO_REPLICATES = None, "evidence from the bootstrap's covariance left out: the maximum-likelihood fit knows one interval only (column isi)"


@dataclass(frozen=True)
class SubjectEvidence:
    """Log evidences of one subject, in nats; None where a value does not exist, with the reason in `notes`."""

    subject: str
    n_pairs: int
    n_trials: int
    log_evidence_h1: float | None
    log_evidence_h1_se: float | None
    log_evidence_h0: float
    log_evidence_h1_laplace: float | None
    log_evidence_h0_laplace: float
    log_evidence_h1_laplace_natural: float | None
    log_evidence_h1_bootstrap: float | None
    efficiency: float
    pareto_k: float
    notes: tuple[str, ...] = ()

    @property
    def log_bayes_factor(self) -> float | None:
        """H1 minus H0; positive favours the predictive-update model."""
        return None if self.log_evidence_h1 is None else self.log_evidence_h1 - self.log_evidence_h0

    @property
    def log_bayes_factor_laplace(self) -> float | None:
        """The same by Laplace's approximation on both sides, as in Appendix C."""
        laplace = self.log_evidence_h1_laplace
        return None if laplace is None else laplace - self.log_evidence_h0_laplace


@dataclass(frozen=True)
class EvidenceTable(SubjectTable[SubjectEvidence]):
    """Evidence of every subject of a study, in the study's order, with the seed and the prior that it belongs to."""

    seed: int | None = None
    prior: Prior | None = None

    def frame(self) -> pd.DataFrame:
        """The table with the columns of evidence.csv; natural logs, empty where a value does not exist; every row names the prior."""
        import pandas as pd

        prior = None if self.prior is None else self.prior.describe()
        cells = [[getattr(row, key) for key in EVIDENCE_COLUMNS[:-1]] + [prior] for row in self.rows]
        return pd.DataFrame(cells, columns=list(EVIDENCE_COLUMNS))


def subject_evidence(posterior: Posterior, maxima: Maxima, fitted: FittedProposal, replicates: Bootstrap | None) -> SubjectEvidence:
    """Everything the evidence table says of one subject; the replicates are those of Appendix C's recipe, None with intervals."""
    subject = posterior.subject
    value, error, why_not = importance_evidence(fitted)
    laplace, why_no_laplace = laplace_evidence(maxima)
    natural, why_no_natural = laplace_evidence_natural(posterior)
    bootstrap, about_bootstrap = _NO_REPLICATES if replicates is None else bootstrap_evidence(replicates, posterior.prior)
    return SubjectEvidence(
        subject=subject.name,
        n_pairs=subject.n_pairs,
        n_trials=subject.total_trials,
        log_evidence_h1=value,
        log_evidence_h1_se=error,
        log_evidence_h0=frequency_evidence(subject),
        log_evidence_h1_laplace=laplace,
        log_evidence_h0_laplace=frequency_evidence_laplace(subject),
        log_evidence_h1_laplace_natural=natural,
        log_evidence_h1_bootstrap=bootstrap,
        efficiency=fitted.efficiency,
        pareto_k=fitted.pareto_k,
        notes=tuple(note for note in (why_not, why_no_laplace, why_no_natural, about_bootstrap) if note),
    )


def importance_evidence(fitted: FittedProposal) -> tuple[float | None, float | None, str]:
    """Log evidence of H1 and its standard error by importance sampling from the fitted proposal.

    The estimate is the log mean weight of independent draws; its standard error is that of the mean, relative to it.
    Withheld, with a reason, where the weights' Pareto k-hat says that neither can be trusted.

    Raises
    ------
    ValueError
        If the draws had a say in the choice of the proposal: the estimate would be biased.
    """
    if not fitted.independent:
        raise ValueError("these draws helped to choose the proposal: use bayes_toe.inference.adaptation.with_fresh_draws first")
    if not fitted.trusted:
        return (
            None,
            None,
            (
                f"evidence of H1 withheld: importance weights are unreliable (Pareto k-hat {fitted.pareto_k:.2f}, "
                f"efficiency {fitted.efficiency:.3f})"
            ),
        )
    n = len(fitted.draws.log_weights)
    value = float(logsumexp(fitted.draws.log_weights) - np.log(n))
    return value, float(np.sqrt((1.0 / fitted.efficiency - 1.0) / n)), ""


def frequency_evidence(subject: Subject) -> float:
    """Exact log evidence of H0: one frequency per pair, uniform prior; sum of ln B(n_Eq + 1, n_Diff + 1).

    Examples
    --------
    >>> round(frequency_evidence(Subject("S01", [0.0], [0.3], [1], [1])), 12) == round(float(np.log(0.5)), 12)
    True
    """
    return float(betaln(subject.n_equal + 1.0, subject.n_trials - subject.n_equal + 1.0).sum())


def frequency_evidence_laplace(subject: Subject) -> float:
    """Log evidence of H0 by Appendix C's recipe: the Laplace estimator qhat, sigmahat_q of every pair (Eq. e:2b).

    Sum of n_Eq log qhat + n_Diff log(1 - qhat) + log sigmahat_q + log(2 pi) / 2; sigmahat_q^2 = qhat (1 - qhat) / (n + 3).
    """
    k, n = subject.n_equal.astype(np.float64), subject.n_trials.astype(np.float64)
    log_q, log_rest = np.log(k + 1.0) - np.log(n + 2.0), np.log(n - k + 1.0) - np.log(n + 2.0)
    log_sigma = 0.5 * (log_q + log_rest - np.log(n + 3.0))
    return float((k * log_q + (n - k) * log_rest + log_sigma + 0.5 * LOG_2PI).sum())
