"""What a calibration run says: a verdict for the ranks of every quantity, and one for the probabilities of every evidence estimator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.comparison.evidence_table import SubjectEvidence
from bayes_toe.experiments.calibration import DESIGNS, RANKED, KnownEvidence, Outcome, Plan, Ranks, simulate_and_analyse
from bayes_toe.experiments.calibration_statistics import POINTS, Reliability, ecdf_difference, log_score, reliability, uniformity
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Progress, Workers

if TYPE_CHECKING:
    import pandas as pd


#: Probability of any false alarm among all ranked quantities of all designs.
FALSE_ALARM = 0.01


def _minus(first: float | None, second: float | None) -> float | None:
    return None if first is None or second is None else first - second


#: Log Bayes factor H1 - H0 by each estimator, from a row of the evidence table; the first is the default.
ESTIMATORS: Mapping[str, Callable[[SubjectEvidence], float | None]] = {
    "importance sampling": lambda row: row.log_bayes_factor,
    "Laplace, identified": lambda row: _minus(row.log_evidence_h1_laplace, row.log_evidence_h0),
    "Laplace, paper's": lambda row: _minus(row.log_evidence_h1_laplace_natural, row.log_evidence_h0),
    "bootstrap covariance": lambda row: _minus(row.log_evidence_h1_bootstrap, row.log_evidence_h0),
    "H0 by Laplace": lambda row: _minus(row.log_evidence_h1, row.log_evidence_h0_laplace),
    "Appendix C": lambda row: _minus(row.log_evidence_h1_bootstrap, row.log_evidence_h0_laplace),
}
DEFAULT = next(iter(ESTIMATORS))
#: What each estimator takes for H1 and for H0.
ABOUT = {
    "importance sampling": "the default: H1 by importance sampling, H0 exactly",
    "Laplace, identified": "H1 by Laplace in identified coordinates, H0 exactly",
    "Laplace, paper's": "H1 by Laplace in (mu1, sigma_p^2, sigma_l^2, q0), H0 exactly",
    "bootstrap covariance": "H1 from the fit and the covariance of bootstrap refits (Appendix C), H0 exactly",
    "H0 by Laplace": "H1 by importance sampling, H0 by the Laplace estimator of frequencies (Appendix C)",
    "Appendix C": "both sides as in Appendix C: bootstrap covariance and Laplace estimator of frequencies",
}


@dataclass(frozen=True)
class RankRow:
    """Verdict on the ranks of one quantity in one design.

    Attributes
    ----------
    design, quantity : str
    batches, studies, not_converged : int
        Studies that did not converge are ranked like the others.
    largest_difference, at : float
        The largest distance of the ranks' distribution function from the uniform one, signed, and where.
    p_value : float
        For the whole function, not only there; exact.
    threshold : float
        What the p-value must not fall below: the stated false-alarm probability, shared among all quantities and designs (Bonferroni).
    """

    design: str
    batches: int
    quantity: str
    studies: int
    not_converged: int
    largest_difference: float
    at: float
    p_value: float
    threshold: float

    @property
    def inside(self) -> bool:
        """Whether the function stays inside its band."""
        return self.p_value >= self.threshold


@dataclass(frozen=True)
class EvidenceRow:
    """Verdict on the probabilities P(H1 | data) of one estimator in one design.

    Attributes
    ----------
    design, estimator : str
    batches, data_sets : int
    missing_h1, missing_h0 : int
        Data sets from H1 and from H0 for which the estimator gives no number; what follows is about the others.
    judged : Reliability or None
        None where there is no number at all.
    log_score_default : float or None
        The log score of the default estimator on the same data sets, nats.
    median_shift, largest_shift : float or None
        Of the log Bayes factor against the default estimator's, nats; the largest keeps its sign.
    """

    design: str
    batches: int
    estimator: str
    data_sets: int
    missing_h1: int
    missing_h0: int
    judged: Reliability | None
    log_score_default: float | None
    median_shift: float | None
    largest_shift: float | None

    @property
    def calibrated(self) -> bool:
        """Whether there are numbers and they are calibrated."""
        return self.judged is not None and self.judged.calibrated


@dataclass(frozen=True, eq=False)
class CalibrationTable:
    """All verdicts of a run.

    Attributes
    ----------
    outcome : Outcome
    ranks : tuple of RankRow
    evidence : tuple of EvidenceRow
    """

    outcome: Outcome
    ranks: tuple[RankRow, ...]
    evidence: tuple[EvidenceRow, ...]

    @property
    def passed(self) -> bool:
        """Whether all ranks are inside and the default evidence is calibrated."""
        return not self.failures

    @property
    def failures(self) -> tuple[str, ...]:
        """What is not as it should be, one line each."""
        outside = [row for row in self.ranks if not row.inside]
        uncalibrated = [row for row in self.evidence if row.estimator == DEFAULT and not row.calibrated]
        return (
            *(f"{row.design} design: ranks of {row.quantity} outside their band (p = {row.p_value:.2g})" for row in outside),
            *(f"{row.design} design: probabilities of H1 by {DEFAULT} are not calibrated" for row in uncalibrated),
        )

    @property
    def not_converged(self) -> dict[str, str]:
        """Subjects whose draws missed the convergence criteria, with what was missed."""
        return {one.subject: one.shortfall for one in self.outcome.ranks if one.shortfall}

    @property
    def withheld(self) -> tuple[str, ...]:
        """Data sets whose evidence the default estimator withholds."""
        return tuple(one.evidence.subject for one in self.outcome.evidence if one.evidence.log_bayes_factor is None)

    def rank_frame(self) -> pd.DataFrame:
        """Columns of calibration.csv."""
        import pandas as pd

        return pd.DataFrame([{**asdict(row), "verdict": "inside" if row.inside else "outside"} for row in self.ranks])

    def evidence_frame(self) -> pd.DataFrame:
        """Columns of evidence_calibration.csv; empty where a value does not exist."""
        import pandas as pd

        rows = []
        for row in self.evidence:
            cells = asdict(row)
            judged = cells.pop("judged")
            keys = ("error", "floor", "p_value", "brier", "log_score", "unsure")
            scores = {key: None if judged is None else judged[key] for key in keys}
            rows.append({**cells, **scores, "verdict": "calibrated" if row.calibrated else "not calibrated"})
        return pd.DataFrame(rows)

    def subject_ranks_frame(self) -> pd.DataFrame:
        """One row a study: true parameters and the place of every true value among its draws, in 0..1."""
        import pandas as pd

        truths = ("true_mu1", "true_sigma_p", "true_sigma_l", "true_q0")
        rows = [[one.design, one.subject, *one.truth, *one.values, one.shortfall] for one in self.outcome.ranks]
        return pd.DataFrame(rows, columns=["design", "subject", *truths, *RANKED, "shortfall"])

    def data_sets_frame(self) -> pd.DataFrame:
        """One row a data set: where it came from, and its log Bayes factor by every estimator, nats."""
        import pandas as pd

        rows = [
            [one.design, one.evidence.subject, "H1" if one.from_h1 else "H0", *(of(one.evidence) for of in ESTIMATORS.values())]
            for one in self.outcome.evidence
        ]
        return pd.DataFrame(rows, columns=["design", "data_set", "from", *ESTIMATORS])


def calibrate(
    *,
    studies: int = 1000,
    data_sets: int = 2000,
    seed: int | None = None,
    workers: Workers = None,
    progress: Progress | None = None,
) -> CalibrationTable:
    """Simulate data of known origin, analyse them as usual, and judge whether posteriors and evidences are calibrated.

    Parameters
    ----------
    studies : int
        Studies of one subject whose true values are ranked, in each of the designs `paper` and `sparse`; 0 leaves the ranks out.
    data_sets : int
        Data sets for the evidence, in each design; 0 leaves it out.
    seed : int, optional
        Root seed; without it fresh entropy, stored in the plan.
    workers, progress
        As in :func:`bayes_toe.analysis.run`.

    Raises
    ------
    InputError
        If a number is negative, or both are 0.

    Examples
    --------
    >>> table = calibrate(studies=2, data_sets=0, seed=1, workers=1)
    >>> len(table.ranks), table.passed
    (16, True)
    """
    return judge(simulate_and_analyse(Plan(studies, data_sets, root_seed(seed)), workers=workers, progress=progress))


def judge(outcome: Outcome) -> CalibrationTable:
    """All verdicts on what a plan gave."""
    of_ranks = {design: [one for one in outcome.ranks if one.design == design] for design in DESIGNS}
    tests = len(RANKED) * sum(bool(found) for found in of_ranks.values())
    ranks = [row for design, found in of_ranks.items() if found for row in rank_rows(design, found, FALSE_ALARM / tests)]
    of_evidence = {design: [one for one in outcome.evidence if one.design == design] for design in DESIGNS}
    seed = outcome.plan.seed
    evidence = [_evidence_row(design, name, found, seed) for design, found in of_evidence.items() if found for name in ESTIMATORS]
    return CalibrationTable(outcome, tuple(ranks), tuple(evidence))


def rank_rows(design: str, found: Sequence[Ranks], threshold: float) -> list[RankRow]:
    """Verdicts on the ranks of one design."""
    missed = sum(bool(one.shortfall) for one in found)
    rows = []
    for quantity, values in rank_columns(found).items():
        difference = ecdf_difference(values)
        far = int(np.abs(difference).argmax())
        at, p_value = float(POINTS[far]), uniformity(values)
        rows.append(RankRow(design, DESIGNS[design], quantity, len(found), missed, float(difference[far]), at, p_value, threshold))
    return rows


def rank_columns(found: Sequence[Ranks]) -> dict[str, FloatArray]:
    """Ranks by quantity, each of shape (studies,)."""
    columns = np.array([one.values for one in found]).T
    return dict(zip(RANKED, columns, strict=True))


def log_odds(found: Sequence[KnownEvidence], estimator: str) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Log Bayes factors of the data sets for which there is one, whether these came from H1, and which of all they are."""
    values = np.array([ESTIMATORS[estimator](one.evidence) for one in found], np.float64)  # None becomes NaN
    known = ~np.isnan(values)
    return values[known], np.array([one.from_h1 for one in found])[known], known


def _evidence_row(design: str, estimator: str, found: Sequence[KnownEvidence], seed: int) -> EvidenceRow:
    values, defaults = (np.array([ESTIMATORS[name](one.evidence) for one in found], np.float64) for name in (estimator, DEFAULT))
    from_h1, known = np.array([one.from_h1 for one in found]), ~np.isnan(values)
    both = known & ~np.isnan(defaults)
    shifts = (values - defaults)[both]
    return EvidenceRow(
        design=design,
        batches=DESIGNS[design],
        estimator=estimator,
        data_sets=len(found),
        missing_h1=int((from_h1 & ~known).sum()),
        missing_h0=int((~from_h1 & ~known).sum()),
        judged=reliability(values[known], from_h1[known], generator(seed, design, estimator, "reliability")) if known.any() else None,
        log_score_default=log_score(defaults[both], from_h1[both]) if both.any() else None,
        median_shift=float(np.median(shifts)) if both.any() else None,
        largest_shift=float(shifts[np.abs(shifts).argmax()]) if both.any() else None,
    )
