"""Are posteriors and evidences of the paper's model calibrated? Observers from the prior.

The steps are those of `bayes-toe sample` and `evidence`, on data from known observers.

Posteriors (simulation-based calibration), --studies a design: a subject drawn from the prior
answers the trials of a design, the answers are analysed, and the true value of each quantity is
ranked among its stored draws. Where everything is right, from the trials to the file, ranks are
uniform.

Evidence, --data-sets a design: data sets from the predictive update (H1) or from free frequencies
(H0), each with probability one half. Where everything is right, of the data sets with posterior
probability P(H1 | data) near p a share p came from H1.

Writes calibration.csv and calibration.md; exit code 3 where something is not calibrated.

Example: python scripts/calibration.py -o docs --studies 1000 --data-sets 500 --seed 1 --overwrite
"""

import sys
import warnings
from argparse import Namespace
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from reference.calibration_statistics import (
    judge_probabilities,
    judged_ranks,
    log_score,
    place,
)
from reference.pages import (
    judgement_page,
    page_parser,
    print_judgements,
    run_rows,
    write_page,
)
from scipy import stats

import bayes_toe as bt
from bayes_toe.answers.evidence_table import subject_evidence
from bayes_toe.classical.fit import SubjectFit, subject_fit
from bayes_toe.design.simulate import PaperObserver, answer_trials
from bayes_toe.design.study_design import PAPER_BATCHES, reference_design
from bayes_toe.inference.subject import EVIDENCE_DRAWS, fit_subject, model_evidence
from bayes_toe.model.paper_equations import NATURAL, Natural, variance_ratio
from bayes_toe.model.paper_model import PaperPosterior, paper_posterior
from bayes_toe.model.prior import DEFAULT as DEFAULT_PRIOR
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator

#: Batches of the paper's 13 pairs that each design has.
DESIGNS = {"paper": PAPER_BATCHES, "sparse": 5}
#: Pairs that no design has, natural-log intensity: their q is predicted, not fitted.
HELD_OUT = {"q(1.15, 1.55)": (1.15, 1.55), "q(1.66, 1.36)": (1.66, 1.36)}
RANKED = (*NATURAL, "gamma", "log_likelihood", *HELD_OUT)
#: Effective draws asked for: four for each one that is used.
DRAWS = 1000
#: Refits of the bootstrap of Appendix C.
REPLICATES = 200
#: Smallest eigenvalue of a correlation matrix that still counts as invertible.
SINGULAR = 1e-10
#: Estimators of the log Bayes factor H1 - H0; the first is the default.
DEFAULT, LAPLACE, APPENDIX_C = "importance sampling", "Laplace", "Appendix C"
ESTIMATORS = (DEFAULT, LAPLACE, APPENDIX_C)
#: Titles of the page, for each part.
TITLES = {
    "rank": {"what": "quantity", "data_sets": "studies", "calibrated": "uniform"},
    "probability": {"what": "estimator"},
}
Row = dict[str, Any]


#: The default prior, with the scales of the design.
PRIOR = DEFAULT_PRIOR.for_subjects(reference_design().unanswered)


# --- One subject ---------------------------------------------------------------------------------


def simulate_h1(
    design: str, name: str, seed: int, truth: Prior = PRIOR
) -> tuple[bt.Subject, PaperPosterior, np.ndarray]:
    """A subject from a prior, the posterior that knows this prior, and the true point."""
    pairs = reference_design(batches=DESIGNS[design])
    drawn = paper_posterior(pairs.unanswered, truth)
    true_point = drawn.sample_prior(generator(seed, name, "observer"), 1)
    parameters = drawn.quantities(true_point[0])
    observer = PaperObserver(name, Natural(*(parameters[key] for key in NATURAL)))
    subject = bt.Subject.from_answers(name, answer_trials(observer, pairs, seed))
    return subject, drawn.for_subject(subject), true_point


def rank_truth(
    design: str, name: str, seed: int, prior: Prior = PRIOR, truth: Prior = PRIOR
) -> Row:
    """The place of each true value among the draws of `sample`, in 0..1, and what did not converge.

    The subject comes from the prior of the analysis, or from another one that is the truth.
    """
    subject, drawn, true_point = simulate_h1(design, name, seed, truth)
    with warnings.catch_warnings(action="ignore", category=bt.ConvergenceWarning):
        draws = bt.sample(bt.Study([subject]), draws=DRAWS, seed=seed, prior=prior, workers=1)
    # Of each walker its last draw: walkers of a converged sample move every few steps, so these are
    # as good as independent.
    last = np.flatnonzero(np.diff(draws.group("posterior")["walker"].values, append=-1))
    points = draws.points(name)[:, last].reshape(-1, len(NATURAL))
    values = ranked_quantities(draws.posterior(name), points)

    true_values = ranked_quantities(drawn, true_point)
    rng = generator(seed, name, "rank")
    row: Row = {"design": design, "subject": name, "shortfall": draws.not_converged.get(name, "")}
    for key in RANKED:
        row[key] = place(true_values[key].item(), values[key], rng)
    return row


def estimate_evidence(design: str, name: str, origin: str, seed: int) -> Row:
    """The log Bayes factors of a subject from H1 or H0, with the streams of `evidence`.

    Under H0, each pair has a uniformly distributed probability.
    """
    if origin == "H1":
        subject, *_ = simulate_h1(design, name, seed)
    else:
        pairs, rng = reference_design(batches=DESIGNS[design]), generator(seed, name, "observer")
        frequencies = rng.uniform(size=pairs.n_pairs)
        subject = pairs.answered(rng.binomial(pairs.n_trials, frequencies), name)
    # H1 and H0 only, without the answer of the four models.
    fitted = fit_subject(paper_posterior(subject, PRIOR), seed)
    evidence = subject_evidence(fitted, model_evidence(fitted, seed, EVIDENCE_DRAWS), None)
    fit = subject_fit(subject, PRIOR, seed=seed, replicates=REPLICATES)
    return {
        "design": design,
        "origin": origin,
        DEFAULT: evidence.log_evidence_h1 - evidence.log_evidence_h0,
        LAPLACE: evidence.log_evidence_h1_laplace - evidence.log_evidence_h0,
        APPENDIX_C: appendix_c_evidence(fit, PRIOR) - evidence.log_evidence_h0_laplace,
    }


def ranked_quantities(posterior: PaperPosterior, x: np.ndarray) -> dict[str, np.ndarray]:
    """The quantities of :data:`RANKED` at points, (points, 4) -> (points,) each.

    In place of q its logarithm, which has the same ranks and does not vanish.
    """
    s1, s2 = np.log(list(HELD_OUT.values())).T
    unseen = bt.Subject("held out", s1, s2, np.zeros(len(s1), int), np.ones(len(s1), int))
    log_q, _ = posterior.for_subject(unseen).log_answers(x)
    log_likelihood = {"log_likelihood": posterior.log_likelihood(x)}
    return posterior.quantities(x) | log_likelihood | dict(zip(HELD_OUT, log_q.T, strict=True))


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
    half_log_det = 0.5 * np.linalg.slogdet(2.0 * np.pi * np.cov(replicates.T))[1]

    mu1, sigma_p, sigma_l, q0 = theta
    gamma = (sigma_l / sigma_p) ** 2
    ratio = variance_ratio(gamma) ** 1.5  # width over sigma_p
    width = stats.lognorm(prior.width_sd, scale=prior.spread_scale)
    log_prior = stats.norm.logpdf(mu1, *prior.mu1_normal)
    log_prior += width.logpdf(sigma_p * ratio) + np.log(ratio)
    log_prior += stats.beta.logpdf(gamma, prior.gamma_a, prior.gamma_b)
    log_prior += stats.beta.logpdf(q0, prior.q0_a, prior.q0_b)
    # |d(sigma_p^2, sigma_l^2) / d(sigma_p, gamma)| = 2 sigma_p^3.
    log_prior -= np.log(2.0) + 3.0 * np.log(sigma_p)
    return fit.log_likelihood + log_prior + half_log_det


# --- All subjects --------------------------------------------------------------------------------


def analysed(options: Namespace) -> tuple[pd.DataFrame, pd.DataFrame]:
    """A row for each study with its ranks, and one for each data set with its evidence.

    In each design, data sets from H1 are the first studies again, as far as these go.
    """
    seed, ranks, evidences = options.seed, [], []
    for design in DESIGNS:
        is_h1 = generator(seed, design, "hypothesis").uniform(size=options.data_sets) < 0.5
        for i in range(options.studies):
            ranks.append(partial(rank_truth, design, f"{design}-h1-{i + 1:04d}", seed))
        for origin, size in (("H1", is_h1.sum()), ("H0", (~is_h1).sum())):
            for i in range(size):
                name = f"{design}-{origin.lower()}-{i + 1:04d}"
                evidences.append(partial(estimate_evidence, design, name, origin, seed))
    return run_rows(ranks, options.workers), run_rows(evidences, options.workers)


def judged_probabilities(rows: pd.DataFrame, seed: int) -> Iterator[Row]:
    """Whether the probabilities P(H1 | data) of each estimator are calibrated in each design."""
    for design, group in rows.groupby("design", sort=False):
        for estimator in ESTIMATORS:
            n_missing = group[estimator].isna().groupby(group["origin"]).sum()
            known = group.dropna(subset=estimator)
            is_h1 = known["origin"] == "H1"
            rng = generator(seed, design, estimator, "reliability")
            shifts = known[estimator] - known[DEFAULT]
            yield {
                "part": "probability",
                "design": design,
                "what": estimator,
                "data_sets": len(group),
                "missing_h1": n_missing.get("H1", 0),
                "missing_h0": n_missing.get("H0", 0),
                **judge_probabilities(known[estimator], is_h1, rng),
                "default_bits": log_score(known[DEFAULT], is_h1),
                "largest_shift": shifts[shifts.abs().idxmax()],
            }


def of_defaults(table: pd.DataFrame) -> pd.DataFrame:
    """The judgements of the draws and of the default estimator."""
    return table[~table["what"].isin((LAPLACE, APPENDIX_C))]


def table_and_page(options: Namespace) -> tuple[pd.DataFrame, str]:
    """All judgements, and the page."""
    ranks, evidences = analysed(options)
    probabilities = judged_probabilities(evidences, options.seed)
    table = pd.DataFrame([*judged_ranks(ranks, RANKED), *probabilities])
    is_unsure = evidences[DEFAULT].abs() < np.log(0.98 / 0.02)
    page = judgement_page(
        __file__,
        table,
        of_defaults(table),
        TITLES,
        not_converged=ranks.loc[ranks["shortfall"] != "", "subject"].tolist(),
        designs=" and ".join(f"{n} times in the design *{name}*" for name, n in DESIGNS.items()),
        draws=DRAWS,
        replicates=REPLICATES,
        unsure=is_unsure.groupby(evidences["design"], sort=False).mean().to_dict(),
        options=options,
    )
    return table, page


def main() -> int:
    """Simulate, analyse, judge, write."""
    parser = page_parser(__doc__, studies=1000, data_sets=500, seed=1)
    options = parser.parse_args()
    if min(options.studies, options.data_sets) < 1:
        parser.error("--studies and --data-sets must be at least 1")
    table = write_page(options, "calibration", partial(table_and_page, options))
    return print_judgements(of_defaults(table))


if __name__ == "__main__":
    sys.exit(main())
