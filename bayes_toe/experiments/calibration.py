"""Calibration of posteriors and evidences on data from known observers, by the steps that `bayes-toe sample` and `evidence` take.

Posteriors (simulation-based calibration): a subject drawn from the prior answers the trials of a design, the answers are analysed, and the
true value of each quantity is ranked among its stored draws. Where everything is right, from the trials to the file, ranks are uniform.

Evidence: data sets from the predictive update (H1) or from free frequencies (H0), each with probability one half. Where everything is
right, of the data sets with posterior probability P(H1 | data) near p a share p came from H1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.special import logit

from bayes_toe.arrays import FloatArray
from bayes_toe.classical.fit import bootstrap_evidence, bootstrap_subject
from bayes_toe.comparison.evidence_table import SubjectEvidence, subject_evidence
from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import InputError, NumericalError
from bayes_toe.experiments.simulate import PAPER_BATCHES, reference_design, simulate_trials
from bayes_toe.inference.draws import Draws, assembled
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Settings, Wanted, fitted_result, subject_draws
from bayes_toe.model.closed_form import log_different, log_equal, normalised_distance
from bayes_toe.model.coordinates import Natural
from bayes_toe.model.ladder import PREDICTIVE_UPDATE
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Progress, Workers, run_in_order

#: Batches of the paper's 13 pairs that each design has.
DESIGNS = {"paper": PAPER_BATCHES, "sparse": 5}
#: Pairs that no design has, natural-log intensity: their q is predicted, not fitted.
HELD_OUT = {"q(1.15, 1.55)": (1.15, 1.55), "q(1.66, 1.36)": (1.66, 1.36)}
RANKED = ("mu1", "sigma_p", "sigma_l", "q0", "gamma", "log_likelihood", *HELD_OUT)
#: Effective draws asked for: four for each one that is used.
DRAWS = 1000


@dataclass(frozen=True)
class Plan:
    """What is to be simulated.

    Parameters
    ----------
    studies : int
        Studies of one subject whose true values are ranked, in each design.
    data_sets : int
        Data sets for the evidence, in each design; those from H1 are the same as the studies, as far as these go.
    seed : int
    """

    studies: int
    data_sets: int
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
    """Where the true values of one subject lie among its draws.

    Attributes
    ----------
    design, subject : str
    truth : tuple of float
        True mu1, sigma_p, sigma_l and q0.
    values : tuple of float
        For each of :data:`RANKED`, a number in 0..1: the share of draws below the truth, made continuous by drawing within the place that
        the truth takes among them. Uniform where everything is right.
    shortfall : str
        What sampling did not reach; empty where it converged.
    """

    design: str
    subject: str
    truth: tuple[float, ...]
    values: tuple[float, ...]
    shortfall: str


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


def simulate_and_analyse(plan: Plan, *, workers: Workers = None, progress: Progress | None = None) -> Outcome:
    """Make and analyse every data set of a plan; workers and progress as in :func:`bayes_toe.analysis.run`."""
    jobs = list(jobs_of(plan, calibration_settings(plan.seed)))
    done = run_in_order([partial(work, job) for job in jobs], workers, progress, [(job.name,) for job in jobs])
    return Outcome(plan, tuple(ranks for ranks, _ in done if ranks), tuple(found for _, found in done if found))


def calibration_settings(seed: int, prior: Prior | None = None) -> Settings:
    """Settings of every analysis: the defaults, but for fewer draws."""
    return Settings(root_seed(seed), Prior() if prior is None else prior, SamplerSettings(draws=DRAWS), PREDICTIVE_UPDATE.name)


@dataclass(frozen=True, eq=False)
class Job:
    """A subject of one design and one origin, and what is to be computed."""

    design: str
    from_h1: bool
    name: str
    with_draws: bool
    with_evidence: bool
    settings: Settings
    truth: Prior = field(default_factory=Prior)  # what observers are drawn from; the tests analyse under another prior


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
        theta = job.truth.sample(rng, 1)
        trials = simulate_trials([name], theta, design, seed)[0]
        return Subject.from_trials(name, trials.s1, trials.s2, trials.equal), theta
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
    values = tuple(_place(float(truth[key][0]), among[key], rng) for key in RANKED)
    return Ranks(design, name, tuple(float(v[0]) for v in theta), values, draws.not_converged.get(name, ""))


def ranked_quantities(subject: Subject, theta: Natural) -> dict[str, FloatArray]:
    """The quantities that :data:`RANKED` names at natural parameters of shape (points,), each of shape (points,).

    In place of q its logarithm, which has the same ranks and does not vanish.
    """
    columns = Natural(*(values[:, None] for values in theta))
    z, different = normalised_distance(subject.s1, subject.s2, *columns[:3]), subject.n_trials - subject.n_equal
    with np.errstate(divide="ignore", invalid="ignore"):  # an answer never given contributes 0, also where its probability is 0
        of_equal = np.where(subject.n_equal > 0, subject.n_equal * log_equal(z, np.log(columns.q0)), 0.0)
        of_different = np.where(different > 0, different * log_different(z, logit(columns.q0)), 0.0)
    found = {**theta._asdict(), "gamma": theta.gamma, "log_likelihood": (of_equal + of_different).sum(axis=1)}
    for key, amplitudes in HELD_OUT.items():
        s1, s2 = np.log(amplitudes)
        found[key] = log_equal(normalised_distance(s1, s2, *theta[:3]), np.log(theta.q0))
    return {key: np.asarray(found[key], np.float64) for key in RANKED}


def _place(truth: float, among: FloatArray, rng: np.random.Generator) -> float:
    """The place of the truth among draws, in 0..1; ties are broken at random, and so is the position within the place."""
    if np.isnan(truth) or np.isnan(among).any():
        raise NumericalError("a ranked quantity is NaN")
    below, tied = int((among < truth).sum()), int((among == truth).sum())
    return float((below + rng.integers(0, tied + 1) + rng.uniform()) / (len(among) + 1))
