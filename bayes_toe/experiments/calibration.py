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

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.classical.bootstrap import bootstrap_evidence, bootstrap_subject
from bayes_toe.comparison.evidence_table import SubjectEvidence, subject_evidence
from bayes_toe.data.study import Study, Subject
from bayes_toe.errors import InputError, NumericalError
from bayes_toe.experiments.simulate import PAPER_BATCHES, reference_design, simulate_trials
from bayes_toe.inference.draws import Draws, assembled
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Fitted, Settings, SubjectResult, Wanted, fitted_result
from bayes_toe.inference.subject_draws import subject_draws
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
_TOGETHER = 10  # data sets of one job: enough to make little of the overhead, few enough to keep all processes busy to the end


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
    done = run_in_order([partial(work, job) for job in jobs], workers, progress, [job.names for job in jobs])
    ranks = tuple(one for found, _ in done for one in found)
    return Outcome(plan, ranks, tuple(one for _, found in done for one in found))


def calibration_settings(seed: int, prior: Prior | None = None) -> Settings:
    """Settings of every analysis: the defaults, but for fewer draws."""
    own = Prior() if prior is None else prior
    return Settings(root_seed(seed), own, SamplerSettings(draws=DRAWS), PREDICTIVE_UPDATE.name)


@dataclass(frozen=True, eq=False)
class Job:
    """Some subjects of one design and one origin, and what is to be computed of them."""

    design: str
    from_h1: bool
    names: tuple[str, ...]
    with_draws: bool
    with_evidence: bool
    settings: Settings
    truth: Prior = field(default_factory=Prior)  # what observers are drawn from; the tests analyse under another prior


def jobs_of(plan: Plan, settings: Settings) -> Iterator[Job]:
    """The plan in portions of a few subjects."""
    for design in DESIGNS:
        h1 = plan.from_h1(design)
        both, most = min(plan.studies, h1), max(plan.studies, h1)
        yield from _portions(design, True, range(both), (True, True), settings)
        yield from _portions(design, True, range(both, most), (plan.studies > h1, h1 > plan.studies), settings)
        yield from _portions(design, False, range(plan.data_sets - h1), (False, True), settings)


def _portions(design: str, from_h1: bool, numbers: range, wanted: tuple[bool, bool], settings: Settings) -> Iterator[Job]:
    names = [f"{design}-{'h1' if from_h1 else 'h0'}-{number + 1:04d}" for number in numbers]
    for first in range(0, len(names), _TOGETHER):
        yield Job(design, from_h1, tuple(names[first : first + _TOGETHER]), *wanted, settings)


def work(job: Job) -> tuple[list[Ranks], list[KnownEvidence]]:
    """Simulate and analyse the subjects of one job as the commands would."""
    seed = job.settings.seed
    made = [_observed(job, name) for name in job.names]
    study = Study(tuple(subject for subject, _ in made), "calibration", synthetic=True)
    draws, rows = _analysed(study, job)
    ranks = [] if draws is None else [_ranks(job.design, draws, subject, theta, seed) for subject, theta in made if theta is not None]
    return ranks, [KnownEvidence(job.design, job.from_h1, row) for row in rows]


def _analysed(study: Study, job: Job) -> tuple[Draws | None, list[SubjectEvidence]]:
    """What is judged of the subjects, and no more: the streams are those of the commands, and so are the numbers."""
    settings = job.settings
    wanted = Wanted(settings.sampler if job.with_draws else None, EVIDENCE_DRAWS if job.with_evidence else 0)
    found = [fitted_result(PREDICTIVE_UPDATE.posterior(subject, settings.prior), settings.seed, wanted) for subject in study]
    draws = assembled(None, study, [subject_draws(result) for result, _ in found], settings, {}) if job.with_draws else None
    return draws, [_row(result, fitted, settings) for result, fitted in found] if job.with_evidence else []


def _row(result: SubjectResult, fitted: Fitted, settings: Settings) -> SubjectEvidence:
    replicates = bootstrap_subject(result.subject, seed=settings.seed, prior=settings.prior)
    return subject_evidence(result, fitted, bootstrap_evidence(replicates, settings.prior))


def _observed(job: Job, name: str) -> tuple[Subject, Natural | None]:
    """A subject's answers and, under H1, the observer that gave them; streams are keyed by seed and name."""
    design, seed = reference_design(batches=DESIGNS[job.design]), job.settings.seed
    rng = generator(seed, name, "observer")
    if job.from_h1:
        theta = job.truth.sample(rng, 1)
        trials = simulate_trials([name], theta, design, seed)[0]
        return Subject.from_trials(name, trials.s1, trials.s2, trials.equal), theta
    counts = rng.binomial(design.batches, rng.uniform(size=len(design.s1)))
    return Subject(name, design.s1, design.s2, counts, np.full(len(counts), design.batches)), None


# --- ranks --------------------------------------------------------------------------------------------------------------------------


def _ranks(design: str, draws: Draws, subject: Subject, theta: Natural, seed: int) -> Ranks:
    name = subject.name
    last = _last_of_walkers(draws)
    stored = Natural(*(values[:, last].ravel() for values in draws.natural(name)))
    truth, among = ranked_quantities(subject, theta), ranked_quantities(subject, stored)
    rng = generator(seed, name, "rank")
    values = tuple(_place(float(truth[key][0]), among[key], rng) for key in RANKED)
    return Ranks(design, name, tuple(float(v[0]) for v in theta), values, draws.not_converged.get(name, ""))


def _last_of_walkers(draws: Draws) -> IndexArray:
    """One draw of each walker, its last: walkers of a converged sample move every few steps, so these are as good as independent."""
    walker = draws.group("posterior")["walker"].values
    return np.flatnonzero(np.diff(walker, append=-1))


def ranked_quantities(subject: Subject, theta: Natural) -> dict[str, FloatArray]:
    """The quantities that :data:`RANKED` names at natural parameters of shape (points,), each of shape (points,).

    In place of q its logarithm, which has the same ranks and does not vanish.
    """
    found = {**theta._asdict(), "gamma": theta.gamma, "log_likelihood": _log_likelihood(subject, theta)}
    for key, amplitudes in HELD_OUT.items():
        s1, s2 = np.log(amplitudes)
        found[key] = log_equal(normalised_distance(s1, s2, *theta[:3]), np.log(theta.q0))
    return {key: np.asarray(found[key], np.float64) for key in RANKED}


def _log_likelihood(subject: Subject, theta: Natural) -> FloatArray:
    columns = Natural(*(values[:, None] for values in theta))
    z = normalised_distance(subject.s1, subject.s2, *columns[:3])
    different = subject.n_trials - subject.n_equal
    with np.errstate(divide="ignore", invalid="ignore"):  # an answer never given contributes 0, also where its probability is 0
        logit_q0 = np.log(columns.q0) - np.log1p(-columns.q0)
        of_equal = np.where(subject.n_equal > 0, subject.n_equal * log_equal(z, np.log(columns.q0)), 0.0)
        of_different = np.where(different > 0, different * log_different(z, logit_q0), 0.0)
    return np.asarray((of_equal + of_different).sum(axis=1))


def _place(truth: float, among: FloatArray, rng: np.random.Generator) -> float:
    """The place of the truth among draws, in 0..1; ties are broken at random, and so is the position within the place."""
    if np.isnan(truth) or np.isnan(among).any():
        raise NumericalError("a ranked quantity is NaN")
    below, tied = int((among < truth).sum()), int((among == truth).sum())
    return float((below + rng.integers(0, tied + 1) + rng.uniform()) / (len(among) + 1))
