"""Model evidence of one subject: the predictive-update model (H1) against one free frequency per pair (H0).

All values are natural logs and leave binomial coefficients out on both sides, so their difference is the log Bayes factor.
Source: Appendix C, with the likelihood (not its log) inside the integral.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.classical.bootstrap import Bootstrap, bootstrap_evidence
from bayes_toe.data.study import Subject
from bayes_toe.data.tables import SubjectTable
from bayes_toe.inference.laplace import laplace_evidence, laplace_evidence_natural
from bayes_toe.inference.modes import Maxima
from bayes_toe.inference.subject import SubjectResult
from bayes_toe.model.free_frequencies import frequency_evidence
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


def subject_evidence(posterior: Posterior, result: SubjectResult, maxima: Maxima, replicates: Bootstrap | None) -> SubjectEvidence:
    """Everything the evidence table says of one subject.

    Parameters
    ----------
    posterior : Posterior
        Under H1.
    result : SubjectResult
        Of the pipeline, with an evidence.
    maxima : Maxima
        Of the posterior.
    replicates : Bootstrap, optional
        Those of Appendix C's recipe; None with intervals.
    """
    subject, found = posterior.subject, result.evidence
    if found is None or found.pareto_k is None or found.efficiency is None:
        raise ValueError("the row of an evidence table needs an evidence by importance sampling")
    laplace, why_no_laplace = laplace_evidence(maxima)
    natural, why_no_natural = laplace_evidence_natural(posterior)
    bootstrap, about_bootstrap = _NO_REPLICATES if replicates is None else bootstrap_evidence(replicates, posterior.prior)
    return SubjectEvidence(
        subject=subject.name,
        n_pairs=subject.n_pairs,
        n_trials=subject.total_trials,
        log_evidence_h1=found.value,
        log_evidence_h1_se=found.se,
        log_evidence_h0=frequency_evidence(subject),
        log_evidence_h1_laplace=laplace,
        log_evidence_h0_laplace=frequency_evidence_laplace(subject),
        log_evidence_h1_laplace_natural=natural,
        log_evidence_h1_bootstrap=bootstrap,
        efficiency=found.efficiency,
        pareto_k=found.pareto_k,
        notes=tuple(note for note in (found.why_not and f"H1: {found.why_not}", why_no_laplace, why_no_natural, about_bootstrap) if note),
    )


def frequency_evidence_laplace(subject: Subject) -> float:
    """Log evidence of H0 by Appendix C's recipe: the Laplace estimator qhat, sigmahat_q of every pair (Eq. e:2b).

    Sum of n_Eq log qhat + n_Diff log(1 - qhat) + log sigmahat_q + log(2 pi) / 2; sigmahat_q^2 = qhat (1 - qhat) / (n + 3).
    """
    k, n = subject.n_equal.astype(np.float64), subject.n_trials.astype(np.float64)
    log_q, log_rest = np.log(k + 1.0) - np.log(n + 2.0), np.log(n - k + 1.0) - np.log(n + 2.0)
    log_sigma = 0.5 * (log_q + log_rest - np.log(n + 3.0))
    return float((k * log_q + (n - k) * log_rest + log_sigma + 0.5 * LOG_2PI).sum())
