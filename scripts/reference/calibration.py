"""Calibration of posteriors and evidences on data from known observers, by the steps that `bayes-toe sample` and `evidence` take.

Posteriors (simulation-based calibration): a subject drawn from the prior answers the trials of a design, the answers are analysed, and the
true value of each quantity is ranked among its stored draws. Where everything is right, from the trials to the file, ranks are uniform.

Evidence: data sets from the predictive update (H1) or from free frequencies (H0), each with probability one half. Where everything is
right, of the data sets with posterior probability P(H1 | data) near p a share p came from H1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
import pandas as pd
from scipy.special import logit

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.classical.fit import bootstrap_evidence, bootstrap_subject
from bayes_toe.comparison.evidence_table import SubjectEvidence, subject_evidence
from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import InputError
from bayes_toe.experiments.simulate import PAPER_BATCHES, reference_design, simulate_trials
from bayes_toe.inference.draws import Draws, assembled
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Settings, Wanted, fitted_result, subject_draws
from bayes_toe.model.closed_form import log_different, log_equal, normalised_distance
from bayes_toe.model.coordinates import Natural
from bayes_toe.model.ladder import PREDICTIVE_UPDATE
from bayes_toe.model.prior import DEFAULT as DEFAULT_PRIOR
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Workers, run_in_order
from reference.calibration_statistics import POINTS, Reliability, ecdf_difference, log_score, place, reliability, uniformity

#: Batches of the paper's 13 pairs that each design has.
DESIGNS = {"paper": PAPER_BATCHES, "sparse": 5}
#: Pairs that no design has, natural-log intensity: their q is predicted, not fitted.
HELD_OUT = {"q(1.15, 1.55)": (1.15, 1.55), "q(1.66, 1.36)": (1.66, 1.36)}
RANKED = ("mu1", "sigma_p", "sigma_l", "q0", "gamma", "log_likelihood", *HELD_OUT)
#: Effective draws asked for: four for each one that is used.
DRAWS = 1000

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
class Plan:
    """What is to be simulated, in each design: studies of one subject whose true values are ranked, and data sets for the evidence."""

    studies: int
    data_sets: int  # those from H1 are the same as the studies, as far as these go
    seed: int

    def __post_init__(self) -> None:
        if self.studies < 0 or self.data_sets < 0 or self.studies + self.data_sets == 0:
            raise InputError(f"studies={self.studies} and data_sets={self.data_sets} must not be negative, nor both 0")

    def from_h1(self, design: str) -> int:
        """How many of the data sets for the evidence are from H1: a fair coin is thrown for each."""
        return int((generator(self.seed, design, "hypothesis").uniform(size=self.data_sets) < 0.5).sum())

    @property
    def total(self) -> int:
        """Data sets to analyse."""
        return sum(max(self.studies, n) + self.data_sets - n for n in map(self.from_h1, DESIGNS))


@dataclass(frozen=True, eq=False)
class Ranks:
    """Where the true values of one subject lie among its draws."""

    design: str
    subject: str
    truth: tuple[float, ...]  # mu1, sigma_p, sigma_l and q0
    #: For each of :data:`RANKED` the share of draws below the truth, in 0..1, made continuous by drawing within the place that the truth
    #: takes among them; uniform where everything is right.
    values: tuple[float, ...]
    shortfall: str  # what sampling did not reach; empty where it converged


@dataclass(frozen=True, eq=False)
class KnownEvidence:
    """The evidence row of one data set and where its data came from."""

    design: str
    from_h1: bool
    evidence: SubjectEvidence


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a plan, in the order of designs and subjects."""

    plan: Plan
    ranks: tuple[Ranks, ...]
    evidence: tuple[KnownEvidence, ...]


def calibrate(*, studies: int = 1000, data_sets: int = 2000, seed: int | None = None, workers: Workers = None) -> CalibrationTable:
    """Simulate data of known origin, analyse them as usual, and judge whether posteriors and evidences are calibrated.

    Studies and data sets are those of :class:`Plan`; 0 leaves the ranks, or the evidence, out. Without a seed fresh entropy, stored there.
    """
    plan = Plan(studies, data_sets, root_seed(seed))
    jobs = list(jobs_of(plan, calibration_settings(plan.seed)))
    done = run_in_order([partial(work, job) for job in jobs], workers, None, [(job.name,) for job in jobs])
    return judge(Outcome(plan, tuple(ranks for ranks, _ in done if ranks), tuple(found for _, found in done if found)))


def calibration_settings(seed: int, prior: Prior | None = None) -> Settings:
    """Settings of every analysis: the defaults, but for fewer draws."""
    design = reference_design()
    shown = Subject("design", design.s1, design.s2, np.zeros(len(design.s1), np.int64), np.ones(len(design.s1), np.int64))
    numbers = (DEFAULT_PRIOR if prior is None else prior).at(shown)  # which observers are drawn from as well
    return Settings(root_seed(seed), numbers, SamplerSettings(draws=DRAWS), PREDICTIVE_UPDATE.name)


@dataclass(frozen=True, eq=False)
class Job:
    """A subject of one design and one origin, and what is to be computed."""

    design: str
    from_h1: bool
    name: str
    with_draws: bool
    with_evidence: bool
    settings: Settings
    truth: Prior | None = None  # what observers are drawn from, if not the prior of the analysis: tests analyse under another one


def jobs_of(plan: Plan, settings: Settings) -> Iterator[Job]:
    """The plan subject by subject."""
    for design in DESIGNS:
        h1 = plan.from_h1(design)
        for i in range(max(plan.studies, h1)):
            yield Job(design, True, f"{design}-h1-{i + 1:04d}", i < plan.studies, i < h1, settings)
        for i in range(plan.data_sets - h1):
            yield Job(design, False, f"{design}-h0-{i + 1:04d}", False, True, settings)


def work(job: Job) -> tuple[Ranks | None, KnownEvidence | None]:
    """Simulate and analyse a subject as the commands would: what is judged, and no more; the streams are theirs, and so are the numbers."""
    (subject, theta), settings = observed(job), job.settings
    wanted = Wanted(settings.sampler if job.with_draws else None, EVIDENCE_DRAWS if job.with_evidence else 0)
    result, fitted = fitted_result(PREDICTIVE_UPDATE.posterior(subject, settings.prior), settings.seed, wanted)
    ranks, known = None, None
    if job.with_draws and theta is not None:
        draws = assembled(None, Study((subject,), "calibration", synthetic=True), [subject_draws(result)], settings, {})
        ranks = ranks_of(job.design, draws, subject, theta, settings.seed)
    if job.with_evidence:
        replicates = bootstrap_subject(subject, seed=settings.seed, prior=settings.prior)
        known = KnownEvidence(job.design, job.from_h1, subject_evidence(result, fitted, bootstrap_evidence(replicates, settings.prior)))
    return ranks, known


def observed(job: Job) -> tuple[Subject, Natural | None]:
    """The subject's answers and, under H1, the observer that gave them; streams are keyed by seed and name."""
    design, seed, name = reference_design(batches=DESIGNS[job.design]), job.settings.seed, job.name
    rng = generator(seed, name, "observer")
    if job.from_h1:
        theta = (job.settings.prior if job.truth is None else job.truth).sample(rng, 1)
        trials = simulate_trials([name], theta, design, seed)[0]
        return Subject.from_trials(name, trials.s1, trials.s2, trials.yes), theta
    counts = rng.binomial(design.batches, rng.uniform(size=len(design.s1)))
    return Subject(name, design.s1, design.s2, counts, np.full(len(counts), design.batches)), None


# --- ranks --------------------------------------------------------------------------------------------------------------------------


def ranks_of(design: str, draws: Draws, subject: Subject, theta: Natural, seed: int) -> Ranks:
    """Where the true parameters of a subject lie among its draws."""
    name, rng = subject.name, generator(seed, subject.name, "rank")
    # Of each walker its last draw: walkers of a converged sample move every few steps, so these are as good as independent.
    last = np.flatnonzero(np.diff(draws.group("posterior")["walker"].values, append=-1))
    stored = Natural(*(values[:, last].ravel() for values in draws.natural(name)))
    truth, among = ranked_quantities(subject, theta), ranked_quantities(subject, stored)
    values = tuple(place(float(truth[key][0]), among[key], rng) for key in RANKED)
    return Ranks(design, name, tuple(float(v[0]) for v in theta), values, draws.not_converged.get(name, ""))


def ranked_quantities(subject: Subject, theta: Natural) -> dict[str, FloatArray]:
    """The quantities that :data:`RANKED` names at natural parameters of shape (points,), each of shape (points,).

    In place of q its logarithm, which has the same ranks and does not vanish.
    """
    columns = Natural(*(values[:, None] for values in theta))
    z, different = normalised_distance(subject.s1, subject.s2, *columns[:3]), subject.n_trials - subject.n_yes
    with np.errstate(divide="ignore", invalid="ignore"):  # an answer never given contributes 0, also where its probability is 0
        of_equal = np.where(subject.n_yes > 0, subject.n_yes * log_equal(z, np.log(columns.q0)), 0.0)
        of_different = np.where(different > 0, different * log_different(z, logit(columns.q0)), 0.0)
    found = {**theta._asdict(), "gamma": theta.gamma, "log_likelihood": (of_equal + of_different).sum(axis=1)}
    for key, amplitudes in HELD_OUT.items():
        s1, s2 = np.log(amplitudes)
        found[key] = log_equal(normalised_distance(s1, s2, *theta[:3]), np.log(theta.q0))
    return {key: np.asarray(found[key], np.float64) for key in RANKED}


# --- verdicts ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RankRow:
    """Verdict on the ranks of one quantity in one design."""

    design: str
    batches: int
    quantity: str
    studies: int
    not_converged: int  # ranked like the others
    largest_difference: float  # of the ranks' distribution function from the uniform one, signed
    at: float
    p_value: float  # for the whole function, not only there; exact
    threshold: float  # what the p-value must not fall below: the false-alarm probability, shared among quantities and designs (Bonferroni)

    @property
    def inside(self) -> bool:
        """Whether the function stays inside its band."""
        return self.p_value >= self.threshold


@dataclass(frozen=True)
class EvidenceRow:
    """Verdict on the probabilities P(H1 | data) of one estimator in one design; logs in nats."""

    design: str
    batches: int
    estimator: str
    data_sets: int
    missing_h1: int  # data sets from H1 and from H0 for which the estimator gives no number; what follows is about the others
    missing_h0: int
    judged: Reliability | None
    log_score_default: float | None  # the log score of the default estimator on the same data sets, nats
    median_shift: float | None  # of the log Bayes factor against the default estimator's
    largest_shift: float | None  # with its sign

    @property
    def calibrated(self) -> bool:
        """Whether there are numbers and they are calibrated."""
        return self.judged is not None and self.judged.calibrated


@dataclass(frozen=True, eq=False)
class CalibrationTable:
    """All verdicts of a run."""

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
        return pd.DataFrame([{**asdict(row), "verdict": "inside" if row.inside else "outside"} for row in self.ranks])

    def evidence_frame(self) -> pd.DataFrame:
        """Columns of evidence_calibration.csv; empty where a value does not exist."""
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
        truths = ("true_mu1", "true_sigma_p", "true_sigma_l", "true_q0")
        rows = [[one.design, one.subject, *one.truth, *one.values, one.shortfall] for one in self.outcome.ranks]
        return pd.DataFrame(rows, columns=["design", "subject", *truths, *RANKED, "shortfall"])

    def data_sets_frame(self) -> pd.DataFrame:
        """One row a data set: where it came from, and its log Bayes factor by every estimator, nats."""
        rows = [
            [one.design, one.evidence.subject, "H1" if one.from_h1 else "H0", *(of(one.evidence) for of in ESTIMATORS.values())]
            for one in self.outcome.evidence
        ]
        return pd.DataFrame(rows, columns=["design", "data_set", "from", *ESTIMATORS])


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
