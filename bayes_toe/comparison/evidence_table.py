"""Model evidence of one subject: which order effect, whether the update (H1) describes the answers, and H1 against free frequencies (H0).

Which order effect: three models that differ in it alone, the symmetric one, a constant error, the predictive update (H1). All values are
natural logs and leave binomial coefficients out, so their differences are log Bayes factors.
Source of H1 against H0: Appendix C, with the likelihood (not its log) inside the integral.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.comparison.words import probabilities
from bayes_toe.data.study import Subject
from bayes_toe.data.tables import SubjectTable
from bayes_toe.inference.evidence import Evidence, laplace_evidence, laplace_evidence_natural, said_of_bound, weighed
from bayes_toe.inference.predictive_checks import FitSummary
from bayes_toe.inference.subject import Fitted, SubjectResult
from bayes_toe.model.distributions import LOG_2PI
from bayes_toe.model.free_frequencies import frequency_evidence
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior

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
    *("log_evidence_symmetric", "log_evidence_constant_error", "p_none", "p_constant_error", "p_update", "predictive_p"),
)
_COUNTS = ("n_pairs", "n_trials")
#: Log evidences of the models that differ in their order effect alone.
ORDERS = {"log_evidence_symmetric": "symmetric", "log_evidence_constant_error": "constant error", "log_evidence_h1": "H1"}
_NO_FIT = "H1: goodness of fit withheld with the weights of its draws"
_INTERVALS = (
    "order effect: H1 knows what an inter-stimulus interval does, the other two models ignore it, so that their probabilities also ask "
    "whether intervals matter"
)
_NO_REPLICATES = None, "evidence from the bootstrap's covariance left out: the maximum-likelihood fit knows one interval only (column isi)"


@dataclass(frozen=True)
class SubjectEvidence:
    """Log evidences of one subject, in nats; None where a value does not exist, with the reason in `notes` or `footnotes`.

    Attributes
    ----------
    fit : FitSummary or None
        Goodness of fit of H1.
    without_weight : tuple of str
        Which of the log evidences of orders are withheld but leave their model without weight, by what they are at most.
    notes : tuple of str
        What is withheld, and why; with intervals, what else the probabilities ask.
    footnotes : tuple of str
        The same of the approximations: Laplace's, and Appendix C's recipe.
    """

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
    log_evidence_symmetric: float | None
    log_evidence_constant_error: float | None
    fit: FitSummary | None
    without_weight: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    footnotes: tuple[str, ...] = ()

    @property
    def log_evidence_orders(self) -> tuple[float, float, float] | None:
        """Of the models without order effect, with a constant error, with the update (H1); -inf without weight, None if one may count."""
        none, constant, update = (-np.inf if key in self.without_weight else getattr(self, key) for key in ORDERS)
        return None if none is None or constant is None or update is None else (none, constant, update)

    @property
    def order_probabilities(self) -> tuple[float, ...] | tuple[None, None, None]:
        """Posterior probabilities of these three, which have equal prior probabilities."""
        return (None, None, None) if self.log_evidence_orders is None else probabilities(self.log_evidence_orders)

    @property
    def p_none(self) -> float | None:
        """Posterior probability that the order has no effect, among the three models."""
        return self.order_probabilities[0]

    @property
    def p_constant_error(self) -> float | None:
        """Posterior probability of a constant error, among the three models."""
        return self.order_probabilities[1]

    @property
    def p_update(self) -> float | None:
        """Posterior probability of the predictive update, among the three models."""
        return self.order_probabilities[2]

    @property
    def predictive_p(self) -> float | None:
        """Posterior predictive p-value of H1's deviance."""
        return None if self.fit is None else self.fit.p_overall

    @property
    def misfit(self) -> bool:
        """Whether H1 does not describe the answers, see :attr:`~bayes_toe.inference.predictive_checks.FitSummary.misfit`."""
        return self.fit is not None and self.fit.misfit

    @property
    def log_bayes_factor(self) -> float | None:
        """H1 minus H0; positive where one smooth curve describes the answers better than a free frequency of each pair."""
        return None if self.log_evidence_h1 is None else self.log_evidence_h1 - self.log_evidence_h0

    @property
    def log_bayes_factor_laplace(self) -> float | None:
        """The same by Laplace's approximation on both sides, as in Appendix C."""
        laplace = self.log_evidence_h1_laplace
        return None if laplace is None else laplace - self.log_evidence_h0_laplace


@dataclass(frozen=True)
class EvidenceTable(SubjectTable[SubjectEvidence]):
    """Evidence of every subject of a study, in the study's order, with the seed and the prior that it belongs to.

    Attributes
    ----------
    failed : mapping of str to str
        Subjects without a row because their work was lost, with the reason.
    """

    seed: int | None = None
    prior: Prior | None = None
    failed: Mapping[str, str] = field(default_factory=dict)

    def frame(self) -> pd.DataFrame:
        """The table with the columns of evidence.csv; natural logs, empty where a value does not exist; every row names the prior.

        Subjects that failed come last and have no value.
        """
        import pandas as pd

        frame = pd.DataFrame(self._cells(), columns=list(EVIDENCE_COLUMNS))
        return frame.astype(dict.fromkeys(_COUNTS, "Int64")) if self.failed else frame

    def _cells(self) -> list[list[object]]:
        prior = None if self.prior is None else self.prior.describe_orders()
        rows = [[prior if key == "prior" else getattr(row, key) for key in EVIDENCE_COLUMNS] for row in self.rows]
        of_failed = ({"subject": name, "prior": prior} for name in self.failed)
        return rows + [[row.get(key) for key in EVIDENCE_COLUMNS] for row in of_failed]


def subject_evidence(
    result: SubjectResult,
    fitted: Fitted,
    by_bootstrap: tuple[float | None, str] | None,
    *,
    others: tuple[Evidence, Evidence] | None = None,
    fit: FitSummary | None = None,
) -> SubjectEvidence:
    """Everything the evidence table says of one subject.

    Parameters
    ----------
    result : SubjectResult
        Of the pipeline under H1, with an evidence.
    fitted : Fitted
        What the pipeline found on its way.
    by_bootstrap : (float or None, str), optional
        By Appendix C's recipe, with what is said of it, see :mod:`bayes_toe.classical.fit`; None with intervals.
    others : (Evidence, Evidence), optional
        Of the symmetric model and of the one with a constant error; without them the row is about H1 and H0 alone, and not of the fit.
    fit : FitSummary, optional
        Goodness of fit of H1; None where its draws cannot be trusted.
    """
    posterior, found = fitted.proposal.proposal.posterior, result.evidence
    if not isinstance(posterior, Posterior) or found is None or found.pareto_k is None or found.efficiency is None:
        raise ValueError("the row of an evidence table needs an evidence by importance sampling")
    subject, known = posterior.subject, (*(others or ()), found)
    values = weighed([one.value for one in known], [one.bound for one in known])
    orders = [*zip(ORDERS, known, values, strict=True)] if others else [("log_evidence_h1", found, values[0])]
    laplace, why_no_laplace = laplace_evidence(fitted.maxima)
    natural, why_no_natural = laplace_evidence_natural(posterior, fitted.maxima)
    bootstrap, about_bootstrap = _NO_REPLICATES if by_bootstrap is None else by_bootstrap
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
        log_evidence_symmetric=others[0].value if others else None,
        log_evidence_constant_error=others[1].value if others else None,
        fit=fit,
        without_weight=tuple(key for key, _, value in orders if np.isneginf(value)),
        notes=(
            *(
                f"{ORDERS[key]}: {one.why_not}" + (f"; {said_of_bound(one.bound, values)}" if np.isneginf(value) else "")
                for key, one, value in orders
                if one.why_not
            ),
            *(() if fit or not others else (_NO_FIT,)),
            *(() if subject.isi is None else (_INTERVALS,)),
        ),
        footnotes=tuple(note for note in (why_no_laplace, why_no_natural, about_bootstrap) if note),
    )


def frequency_evidence_laplace(subject: Subject) -> float:
    """Log evidence of H0 by Appendix C's recipe: the Laplace estimator qhat, sigmahat_q of every pair (Eq. e:2b).

    Sum of n_Eq log qhat + n_Diff log(1 - qhat) + log sigmahat_q + log(2 pi) / 2; sigmahat_q^2 = qhat (1 - qhat) / (n + 3).
    """
    k, n = subject.n_equal.astype(np.float64), subject.n_trials.astype(np.float64)
    log_q, log_rest = np.log(k + 1.0) - np.log(n + 2.0), np.log(n - k + 1.0) - np.log(n + 2.0)
    log_sigma = 0.5 * (log_q + log_rest - np.log(n + 3.0))
    return float((k * log_q + (n - k) * log_rest + log_sigma + 0.5 * LOG_2PI).sum())
