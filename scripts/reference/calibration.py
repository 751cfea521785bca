"""Calibration of posteriors and evidences on data from known observers.

The steps are those of `bayes-toe sample` and `evidence`.

Posteriors (simulation-based calibration): a subject drawn from the prior answers the trials of a
design, the answers are analysed, and the true value of each quantity is ranked among its stored
draws. Where everything is right, from the trials to the file, ranks are uniform.

Evidence: data sets from the predictive update (H1) or from free frequencies (H0), each with
probability one half. Where everything is right, of the data sets with posterior probability P(H1 |
data) near p a share p came from H1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
import pandas as pd
from scipy import stats
from scipy.special import logit

from bayes_toe.answers.evidence_table import SubjectEvidence, subject_evidence
from bayes_toe.arrays import BoolArray, FloatArray, Rng
from bayes_toe.classical.fit import SubjectFit, subject_fit
from bayes_toe.data.study import Study, Subject
from bayes_toe.design.simulate import PaperObserver, simulate_trials
from bayes_toe.design.study_design import PAPER_BATCHES, reference_design
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.draws_file import subjects_tree
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import (
    EVIDENCE_DRAWS,
    AnalysisRequest,
    Settings,
    fitted_result,
    subject_draws,
)
from bayes_toe.model.paper_equations import (
    NATURAL,
    Natural,
    log_different,
    log_equal,
    normalised_distance,
    variance_ratio,
)
from bayes_toe.model.paper_model import PAPER_MODEL, paper_posterior
from bayes_toe.model.prior import DEFAULT as DEFAULT_PRIOR
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import Workers, run_in_order
from reference.calibration_statistics import log_score, place, rank_verdict, reliability

#: Batches of the paper's 13 pairs that each design has.
DESIGNS = {"paper": PAPER_BATCHES, "sparse": 5}
#: Pairs that no design has, natural-log intensity: their q is predicted, not fitted.
HELD_OUT = {"q(1.15, 1.55)": (1.15, 1.55), "q(1.66, 1.36)": (1.66, 1.36)}
RANKED = (*NATURAL, "gamma", "log_likelihood", *HELD_OUT)
#: Effective draws asked for: four for each one that is used.
DRAWS = 1000

#: Probability of any false alarm among all ranked quantities of all designs.
FALSE_ALARM = 0.01

#: What the columns of the evidence table are.
_METHODS = {
    "h1": "importance sampling",
    "h1_laplace": "Laplace approximation in scores of the prior",
    "h1_bootstrap": "covariance of bootstrap refits (Appendix C)",
    "h0": "exact",
    "h0_laplace": "Laplace estimator of frequencies (Appendix C)",
}
#: By estimator of the log Bayes factor H1 - H0, its two columns; the first is the default.
ESTIMATORS = {
    "importance sampling": ("h1", "h0"),
    "Laplace": ("h1_laplace", "h0"),
    "bootstrap covariance": ("h1_bootstrap", "h0"),
    "H0 by Laplace": ("h1", "h0_laplace"),
    "Appendix C": ("h1_bootstrap", "h0_laplace"),
}
DEFAULT = next(iter(ESTIMATORS))
ABOUT = {name: (_METHODS[h1], _METHODS[h0]) for name, (h1, h0) in ESTIMATORS.items()}
#: Smallest eigenvalue of a correlation matrix that still counts as invertible.
SINGULAR = 1e-10
#: One row a study: true parameters, and the share of draws below the true value of each quantity,
#: in 0..1, made continuous by drawing within the place that the truth takes among them; what
#: sampling did not reach, empty where it converged.
RANK_COLUMNS = ("design", "subject", *(f"true_{name}" for name in NATURAL), *RANKED, "shortfall")
#: One row a data set: where it came from, and its log Bayes factor by every estimator, nats; NaN
#: where there is none.
SET_COLUMNS = ("design", "data_set", "from", *ESTIMATORS)
Row = dict[str, object]


@dataclass(frozen=True)
class Plan:
    """Numbers to simulate in each design: studies whose true values are ranked, and data sets."""

    studies: int
    data_sets: int  # those from H1 are the same as the studies, as far as these go
    seed: int

    def __post_init__(self) -> None:
        if self.studies < 0 or self.data_sets < 0 or self.studies + self.data_sets == 0:
            raise InputError(
                f"studies={self.studies} and data_sets={self.data_sets} must not be negative, nor "
                "both 0"
            )

    def from_h1(self, design: str) -> int:
        """How many of the data sets for the evidence are from H1.

        A fair coin is thrown for each.
        """
        return int(
            (generator(self.seed, design, "hypothesis").uniform(size=self.data_sets) < 0.5).sum()
        )


@dataclass(frozen=True, eq=False)
class Job:
    """A subject of one design and one origin, and what is to be computed."""

    design: str
    from_h1: bool
    name: str
    with_draws: bool
    with_evidence: bool
    settings: Settings
    truth: Prior | None = (
        # what observers are drawn from, if not the prior of the analysis: tests analyse under
        # another one
        None
    )


@dataclass(frozen=True, eq=False)
class Calibration:
    """Results of a plan, with :data:`RANK_COLUMNS` and :data:`SET_COLUMNS`, and verdicts by row."""

    plan: Plan
    ranks: pd.DataFrame
    data_sets: pd.DataFrame
    rank_verdicts: pd.DataFrame
    evidence_verdicts: pd.DataFrame

    @property
    def failures(self) -> list[str]:
        """Problems, a line each: ranks outside their band, evidences not calibrated."""
        return [
            *(
                f"{row.design} design: ranks of {row.quantity} outside their band (p = "
                f"{row.p_value:.2g})"
                for row in self.rank_verdicts.itertuples()
                if row.verdict != "inside"
            ),
            *(
                f"{row.design} design: probabilities of H1 by {DEFAULT} are not calibrated"
                for row in self.evidence_verdicts.itertuples()
                if row.estimator == DEFAULT and row.verdict != "calibrated"
            ),
        ]


def calibrate(
    *, studies: int = 1000, data_sets: int = 2000, seed: int | None = None, workers: Workers = None
) -> Calibration:
    """Simulate data of known origin, and judge whether posteriors and evidences are calibrated.

    Studies and data sets are those of :class:`Plan`; 0 leaves the ranks, or the evidence, out.
    Without a seed fresh entropy, stored there.
    """
    plan = Plan(studies, data_sets, root_seed(seed))
    jobs = list(jobs_of(plan, calibration_settings(plan.seed)))
    done = run_in_order(
        [partial(work, job) for job in jobs], workers, None, [(job.name,) for job in jobs]
    )
    return judged(
        plan, [ranks for ranks, _ in done if ranks], [found for _, found in done if found]
    )


def calibration_settings(seed: int, prior: Prior | None = None) -> Settings:
    """Settings of every analysis: the defaults, but for fewer draws."""
    design = reference_design()
    shown = Subject(
        "design",
        design.s1,
        design.s2,
        np.zeros(len(design.s1), np.int64),
        np.ones(len(design.s1), np.int64),
    )
    # Observers are drawn from the same numbers.
    numbers = (DEFAULT_PRIOR if prior is None else prior).for_subjects(shown)
    return Settings(root_seed(seed), numbers, SamplerSettings(draws=DRAWS), PAPER_MODEL)


def jobs_of(plan: Plan, settings: Settings) -> Iterator[Job]:
    """The plan subject by subject."""
    for design in DESIGNS:
        h1 = plan.from_h1(design)
        for i in range(max(plan.studies, h1)):
            yield Job(design, True, f"{design}-h1-{i + 1:04d}", i < plan.studies, i < h1, settings)
        for i in range(plan.data_sets - h1):
            yield Job(design, False, f"{design}-h0-{i + 1:04d}", False, True, settings)


def work(job: Job) -> tuple[Row, Row]:
    """Simulate and analyse a subject as the commands would, with their streams.

    Its rows of ranks and of data sets, or empty ones.
    """
    (subject, theta), settings = observed(job), job.settings
    wanted = AnalysisRequest(
        settings.sampler if job.with_draws else None, EVIDENCE_DRAWS if job.with_evidence else 0
    )
    result = fitted_result(paper_posterior(subject, settings.prior), settings.seed, wanted)
    ranks: Row = {}
    known: Row = {}
    if job.with_draws and theta is not None:
        study = Study((subject,), "calibration", synthetic=True)
        draws = Draws(subjects_tree(study, [subject_draws(result)], settings, {}, {}))
        ranks = {"design": job.design, **ranks_of(draws, subject, theta, settings.seed)}
    if job.with_evidence:
        replicates = subject_fit(subject, settings.prior, seed=settings.seed, replicates=1000)
        row = subject_evidence(result)
        by_bootstrap = appendix_c_evidence(replicates, settings.prior.for_subjects(subject))
        known = {
            "design": job.design,
            "data_set": job.name,
            "from": "H1" if job.from_h1 else "H0",
            **log_bayes_factors(row, by_bootstrap),
        }
    return ranks, known


def observed(job: Job) -> tuple[Subject, Natural | None]:
    """The subject's answers and, under H1, the observer that gave them.

    Streams are keyed by seed and name.
    """
    design, seed, name = reference_design(batches=DESIGNS[job.design]), job.settings.seed, job.name
    rng = generator(seed, name, "observer")
    if job.from_h1:
        own_prior = job.settings.prior if job.truth is None else job.truth
        theta = prior_draw(own_prior, design.answered(0 * design.n_trials, name), rng)
        observer = PaperObserver(name, Natural(*(value[0] for value in theta)))
        (trials,) = simulate_trials([observer], design, seed)
        return Subject.from_trials(name, trials.s1, trials.s2, trials.yes), theta
    counts = rng.binomial(design.n_trials, rng.uniform(size=design.n_pairs))
    return design.answered(counts, name), None


def prior_draw(prior: Prior, pairs: Subject, rng: Rng) -> Natural:
    """One draw of the paper's parameters for these pairs, each of shape (1,)."""
    posterior = paper_posterior(pairs, prior)
    values = posterior.quantities(posterior.sample_prior(rng, 1))
    return Natural(*(values[name] for name in NATURAL))


def appendix_c_evidence(fit: SubjectFit, prior: Prior) -> float:
    """Log evidence of H1 by Appendix C, nats; NaN where there is no such number.

    log p(n | theta) + log p(theta) + log det(2 pi Sigma) / 2, with theta the fit and Sigma the
    covariance of the replicates, in (mu1, sigma_p^2, sigma_l^2, q0). Source: Eq. app:evidapprox.
    """
    theta, replicates = fit.parameters, fit.replicates ** np.array([1, 2, 2, 1])
    is_finite = np.isfinite(theta).all() and np.isfinite(replicates).all()
    if not is_finite or theta[1] == 0.0 or np.any(np.ptp(replicates, axis=0) == 0.0):
        return np.nan
    if np.linalg.eigvalsh(np.corrcoef(replicates.T))[0] < SINGULAR:
        return np.nan
    log_prior = log_prior_of_variances(theta, prior)
    half_log_det = 0.5 * float(np.linalg.slogdet(2.0 * np.pi * np.cov(replicates.T))[1])
    return fit.log_likelihood + log_prior + half_log_det


def log_prior_of_variances(theta: FloatArray, prior: Prior) -> float:
    """Log prior density of (mu1, sigma_p^2, sigma_l^2, q0) at the paper's parameters."""
    mu1, sigma_p, sigma_l, q0 = theta
    gamma = (sigma_l / sigma_p) ** 2
    if prior.spread == "width":
        ratio = variance_ratio(gamma) ** 1.5
        of_width = stats.lognorm(prior.width_sd, scale=prior.spread_scale)
        of_sigma_p = of_width.logpdf(sigma_p * ratio) + np.log(ratio)
    else:
        of_sigma_p = stats.halfnorm(scale=prior.spread_scale).logpdf(sigma_p)
    of_gamma = stats.beta.logpdf(gamma, prior.gamma_a, prior.gamma_b)
    of_q0 = stats.beta.logpdf(q0, prior.q0_a, prior.q0_b)
    total = stats.norm.logpdf(mu1, *prior.mu1_normal) + of_sigma_p + of_gamma + of_q0
    # |d(sigma_p^2, sigma_l^2) / d(sigma_p, gamma)| = 2 sigma_p^3.
    return float(total - np.log(2.0) - 3.0 * np.log(sigma_p))


def log_bayes_factors(row: SubjectEvidence, by_bootstrap: float) -> dict[str, float]:
    """By estimator, nats; NaN where a side is withheld."""
    factors = {}
    for name, (h1, h0) in ESTIMATORS.items():
        numerator = by_bootstrap if h1 == "h1_bootstrap" else getattr(row, f"log_evidence_{h1}")
        sides = np.array([numerator, getattr(row, f"log_evidence_{h0}")], np.float64)
        factors[name] = float(sides[0] - sides[1])
    return factors


def ranks_of(draws: Draws, subject: Subject, theta: Natural, seed: int) -> Row:
    """Where the true parameters of a subject lie among its draws."""
    name, rng = subject.name, generator(seed, subject.name, "rank")
    # Of each walker its last draw: walkers of a converged sample move every few steps, so these are
    # as good as independent.
    last = np.flatnonzero(np.diff(draws.group("posterior")["walker"].values, append=-1))
    stored = Natural(*(values[:, last].ravel() for values in draws.natural(name)))
    truth, among = ranked_quantities(subject, theta), ranked_quantities(subject, stored)
    true = {f"true_{key}": float(value[0]) for key, value in theta._asdict().items()}
    places = {key: place(float(truth[key][0]), among[key], rng) for key in RANKED}
    return {"subject": name, **true, **places, "shortfall": draws.not_converged.get(name, "")}


def ranked_quantities(subject: Subject, theta: Natural) -> dict[str, FloatArray]:
    """The quantities of :data:`RANKED` at natural parameters of shape (points,), (points,) each.

    In place of q its logarithm, which has the same ranks and does not vanish.
    """
    columns = Natural(*(values[:, None] for values in theta))
    z, different = (
        normalised_distance(subject.s1, subject.s2, *columns[:3]),
        subject.n_trials - subject.n_yes,
    )
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # an answer never given contributes 0, also where its probability is 0
        of_equal = np.where(
            subject.n_yes > 0, subject.n_yes * log_equal(z, np.log(columns.q0)), 0.0
        )
        of_different = np.where(different > 0, different * log_different(z, logit(columns.q0)), 0.0)
    found = {
        **theta._asdict(),
        "gamma": theta.gamma,
        "log_likelihood": (of_equal + of_different).sum(axis=1),
    }
    for key, amplitudes in HELD_OUT.items():
        s1, s2 = np.log(amplitudes)
        found[key] = log_equal(normalised_distance(s1, s2, *theta[:3]), np.log(theta.q0))
    return {key: np.asarray(found[key], np.float64) for key in RANKED}


def judged(plan: Plan, ranks: list[Row], data_sets: list[Row]) -> Calibration:
    """All verdicts on what a plan gave."""
    of_ranks, of_sets = (
        pd.DataFrame(ranks, columns=RANK_COLUMNS),
        pd.DataFrame(data_sets, columns=SET_COLUMNS),
    )
    threshold = FALSE_ALARM / max(1, len(RANKED) * of_ranks["design"].nunique())
    rank_rows = [
        _rank_row(some, name, threshold)
        for _, some in of_ranks.groupby("design", sort=False)
        for name in RANKED
    ]
    evidence_rows = [
        _evidence_row(some, name, plan.seed)
        for _, some in of_sets.groupby("design", sort=False)
        for name in ESTIMATORS
    ]
    return Calibration(
        plan, of_ranks, of_sets, pd.DataFrame(rank_rows), pd.DataFrame(evidence_rows)
    )


def _rank_row(found: pd.DataFrame, quantity: str, threshold: float) -> Row:
    """Verdict on the ranks of one quantity in one design, by a least p-value (Bonferroni)."""
    verdict = rank_verdict(found[quantity])
    design = found["design"].iloc[0]
    return {
        "design": design,
        "batches": DESIGNS[design],
        "quantity": quantity,
        "studies": len(found),
        "not_converged": int((found["shortfall"] != "").sum()),  # ranked like the others
        **verdict,
        "threshold": threshold,
        "verdict": "inside" if verdict["p_value"] >= threshold else "outside",
    }


def log_odds(found: pd.DataFrame, estimator: str) -> tuple[FloatArray, BoolArray]:
    """Log Bayes factors of the data sets for which there is one, and whether these came from H1."""
    known = found[found[estimator].notna()]
    return known[estimator].to_numpy(np.float64), (known["from"] == "H1").to_numpy()


def _evidence_row(found: pd.DataFrame, estimator: str, seed: int) -> Row:
    """Verdict on the probabilities P(H1 | data) of one estimator in one design; logs in nats."""
    design, missing = found["design"].iloc[0], found["from"][found[estimator].isna()]
    both = found.dropna(subset=[estimator, DEFAULT])
    shifts = (both[estimator] - both[DEFAULT]).to_numpy(np.float64)
    odds, from_h1 = log_odds(found, estimator)
    judged = (
        reliability(odds, from_h1, generator(seed, design, estimator, "reliability"))
        if len(odds)
        else None
    )
    scores = asdict(judged) if judged else {}
    return {
        "design": design,
        "batches": DESIGNS[design],
        "estimator": estimator,
        "data_sets": len(found),
        "missing_h1": int((missing == "H1").sum()),
        "missing_h0": int((missing == "H0").sum()),
        "log_score_default": log_score(*log_odds(both, DEFAULT)) if len(both) else np.nan,
        "median_shift": float(np.median(shifts)) if len(both) else np.nan,
        "largest_shift": float(shifts[np.abs(shifts).argmax()]) if len(both) else np.nan,
        **{
            key: scores.get(key, np.nan)
            for key in ("error", "floor", "p_value", "brier", "log_score", "unsure")
        },
        "verdict": "calibrated" if judged and judged.calibrated else "not calibrated",
    }
