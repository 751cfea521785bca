"""Are posteriors and evidences of the paper's model calibrated? Observers from the prior.

The steps are those of `bayes-toe sample` and `evidence`, on data from known observers.

Posteriors (simulation-based calibration): a subject drawn from the prior answers the trials of a
design, the answers are analysed, and the true value of each quantity is ranked among its stored
draws. Where everything is right, from the trials to the file, ranks are uniform.

Evidence: data sets from the predictive update (H1) or from free frequencies (H0), each with
probability one half. Where everything is right, of the data sets with posterior probability P(H1 |
data) near p a share p came from H1.

Writes calibration.csv and calibration.md; exit code 3 where something is not calibrated.

Example: python scripts/calibration.py -o docs --studies 1000 --data-sets 500 --seed 1 --overwrite
"""

import sys
from argparse import Namespace
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import Template
from reference.calibration_statistics import (
    LEAST_P,
    judge_probabilities,
    judge_ranks,
    log_score,
    place,
)
from reference.pages import (
    judgement_lines,
    judgement_tables,
    page_parser,
    versions,
    write_page,
)
from scipy import stats

import bayes_toe as bt
from bayes_toe.answers.evidence_table import subject_evidence
from bayes_toe.classical.fit import SubjectFit, subject_fit
from bayes_toe.design.simulate import PaperObserver, simulate_trials
from bayes_toe.design.study_design import PAPER_BATCHES, reference_design
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
from bayes_toe.model.paper_equations import NATURAL, Natural, variance_ratio
from bayes_toe.model.paper_model import PAPER_MODEL, PaperPosterior, paper_posterior
from bayes_toe.model.prior import DEFAULT as DEFAULT_PRIOR
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator, root_seed
from bayes_toe.workers import run_in_order

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
#: Columns of the page, with their titles, for each part.
COLUMNS = {
    "rank": {"design": "design", "what": "quantity", "data_sets": "studies"}
    | {"largest_difference": "largest difference", "at": "at", "p_value": "p"}
    | {"calibrated": "uniform"},
    "probability": {"design": "design", "what": "estimator", "data_sets": "data sets"}
    | {"missing_h1": "none, H1", "missing_h0": "none, H0", "ece": "ECE", "floor": "floor"}
    | {"p_value": "p", "log_score_bits": "log score", "default_bits": "default's"}
    | {"largest_shift": "largest shift", "calibrated": "calibrated"},
}
Row = dict[str, Any]


# --- One subject ---------------------------------------------------------------------------------


def calibration_settings(seed: int, prior: Prior = DEFAULT_PRIOR) -> Settings:
    """Settings of every analysis: the defaults, but for fewer draws."""
    numbers = prior.for_subjects(reference_design().unanswered)
    return Settings(seed, numbers, SamplerSettings(draws=DRAWS), PAPER_MODEL)


def analyse(
    design: str,
    name: str,
    origin: str,
    request: AnalysisRequest,
    settings: Settings,
    truth: Prior | None = None,
) -> Row:
    """Simulate a subject from H1 or H0 and analyse it as the commands would, with their streams.

    The places of the true values among the draws, and the log Bayes factors, where these are asked
    for. Observers come from the prior of the analysis, or from another one that is the truth.
    """
    pairs, seed = reference_design(batches=DESIGNS[design]), settings.seed
    rng = generator(seed, name, "observer")
    if origin == "H1":
        drawn = paper_posterior(pairs.unanswered, truth or settings.prior)
        true_point = drawn.sample_prior(rng, 1)
        true_parameters = drawn.quantities(true_point[0])
        observer = PaperObserver(name, Natural(*(true_parameters[key] for key in NATURAL)))
        (trials,) = simulate_trials([observer], pairs, seed)
        subject = bt.Subject.from_answers(name, trials.answers)
    else:
        counts = rng.binomial(pairs.n_trials, rng.uniform(size=pairs.n_pairs))
        subject = pairs.answered(counts, name)

    result = fitted_result(paper_posterior(subject, settings.prior), seed, request)
    row: Row = {"design": design, "subject": name}
    if request.chains is not None:
        study = bt.Study((subject,), "calibration", synthetic=True)
        draws = Draws(subjects_tree(study, [subject_draws(result)], settings, {}, {}))
        row |= places(draws, ranked_quantities(drawn.for_subject(subject), true_point))
    if request.evidence_draws:
        evidence = subject_evidence(result)
        fit = subject_fit(subject, settings.prior, seed=seed, replicates=REPLICATES)
        appendix_c = appendix_c_evidence(fit, settings.prior) - evidence.log_evidence_h0_laplace
        row |= {
            "origin": origin,
            DEFAULT: evidence.log_evidence_h1 - evidence.log_evidence_h0,
            LAPLACE: evidence.log_evidence_h1_laplace - evidence.log_evidence_h0,
            APPENDIX_C: appendix_c,
        }
    return row


def places(draws: Draws, true_values: dict[str, np.ndarray]) -> Row:
    """The place of each true value among the draws, in 0..1, and what did not converge."""
    (name,) = draws.names
    rng = generator(draws.seed, name, "rank")
    # Of each walker its last draw: walkers of a converged sample move every few steps, so these are
    # as good as independent.
    last = np.flatnonzero(np.diff(draws.group("posterior")["walker"].values, append=-1))
    points = draws.points(name)[:, last].reshape(-1, len(NATURAL))
    values = ranked_quantities(draws.posterior(name), points)
    row: Row = {"shortfall": draws.not_converged.get(name, "")}
    for key in RANKED:
        row[key] = place(true_values[key].item(), values[key], rng)
    return row


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
    return float(fit.log_likelihood + log_prior + half_log_det)


# --- All subjects --------------------------------------------------------------------------------


def analysed(options: Namespace, seed: int) -> pd.DataFrame:
    """A row for each subject.

    In each design, so many studies for the ranks and data sets for the evidence; those from H1 are
    the same, as far as these go.
    """
    settings = calibration_settings(seed)
    jobs = []
    for design in DESIGNS:
        is_h1 = generator(seed, design, "hypothesis").uniform(size=options.data_sets) < 0.5
        n_evidences = {"H1": int(is_h1.sum()), "H0": int((~is_h1).sum())}
        n_studies = {"H1": options.studies, "H0": 0}
        for origin in ("H1", "H0"):
            for i in range(max(n_studies[origin], n_evidences[origin])):
                sampler = settings.sampler if i < n_studies[origin] else None
                request = AnalysisRequest(sampler, EVIDENCE_DRAWS * (i < n_evidences[origin]))
                name = f"{design}-{origin.lower()}-{i + 1:04d}"
                jobs.append(partial(analyse, design, name, origin, request, settings))

    names = [(name,) for _, name, *_ in (job.args for job in jobs)]
    progress = print if options.progress else None
    return pd.DataFrame(run_in_order(jobs, options.workers, progress, names))


def judged_ranks(rows: pd.DataFrame) -> Iterator[Row]:
    """Whether the ranks of each quantity are uniform in each design."""
    for design, group in rows.groupby("design", sort=False):
        for quantity in RANKED:
            ranks = group[quantity].dropna()
            yield {
                "part": "rank",
                "design": design,
                "what": quantity,
                "data_sets": len(ranks),
                **judge_ranks(ranks),
            }


def judged_probabilities(rows: pd.DataFrame, seed: int) -> Iterator[Row]:
    """Whether the probabilities P(H1 | data) of each estimator are calibrated in each design."""
    for design, group in rows.dropna(subset="origin").groupby("design", sort=False):
        for estimator in ESTIMATORS:
            is_missing = group[estimator].isna()
            row = {"part": "probability", "design": design, "what": estimator}
            row["data_sets"] = len(group)
            for origin in ("H1", "H0"):
                row[f"missing_{origin.lower()}"] = (is_missing & (group["origin"] == origin)).sum()
            known = group[~is_missing]
            is_h1 = known["origin"] == "H1"
            rng = generator(seed, design, estimator, "reliability")
            row |= judge_probabilities(known[estimator], is_h1, rng)
            shifts = (known[estimator] - known[DEFAULT]).to_numpy()
            row["default_bits"] = log_score(known[DEFAULT], is_h1)
            row["largest_shift"] = shifts[np.abs(shifts).argmax()]
            yield row


def judged(rows: pd.DataFrame, seed: int) -> pd.DataFrame:
    """All judgements."""
    return pd.DataFrame([*judged_ranks(rows), *judged_probabilities(rows, seed)])


def of_defaults(table: pd.DataFrame) -> pd.DataFrame:
    """The judgements of the draws and of the default estimator."""
    return table[~table["what"].isin((LAPLACE, APPENDIX_C))]


def table_and_page(options: Namespace, seed: int) -> tuple[pd.DataFrame, str]:
    """All judgements, and the page."""
    rows = analysed(options, seed)
    table = judged(rows, seed)
    known = rows.dropna(subset="origin")
    is_unsure = known[DEFAULT].abs() < np.log(0.98 / 0.02)
    template = Template(Path(__file__).with_suffix(".md").read_text("utf-8"), trim_blocks=True)
    page = template.render(
        conclusion=judgement_lines(of_defaults(table)),
        not_converged=rows.loc[rows["shortfall"].fillna("") != "", "subject"].tolist(),
        designs=" and ".join(f"{n} times in the design *{name}*" for name, n in DESIGNS.items()),
        draws=DRAWS,
        replicates=REPLICATES,
        least_p=LEAST_P,
        unsure=is_unsure.groupby(known["design"], sort=False).mean().to_dict(),
        tables=judgement_tables(table, COLUMNS),
        options=options,
        seed=seed,
        versions=versions(),
    )
    return table, f"{page}\n"


def main() -> int:
    """Simulate, analyse, judge, write."""
    parser = page_parser(__doc__)
    parser.add_argument("--studies", type=int, default=1000, help="a design, for the ranks")
    parser.add_argument("--data-sets", type=int, default=500, help="a design, for the evidence")
    parser.add_argument("--seed", type=int, help="without it fresh entropy, printed")
    parser.add_argument("--progress", action="store_true", help="print the names of done subjects")
    options = parser.parse_args()
    if min(options.studies, options.data_sets) < 1:
        parser.error("--studies and --data-sets must be at least 1")
    seed = root_seed(options.seed)
    table = write_page(options, "calibration", partial(table_and_page, options, seed))
    decisive = of_defaults(table)
    print(*judgement_lines(decisive), f"seed {seed}", sep="\n")
    return 0 if decisive["calibrated"].all() else 3


if __name__ == "__main__":
    sys.exit(main())
