"""Check whether posteriors and evidences of the paper's model are calibrated.

The steps are those of `bayes-toe sample` and `evidence`, on data from known observers.

Posteriors (simulation-based calibration): a subject drawn from the prior answers the trials of a
design, the answers are analysed, and the true value of each quantity is ranked among its stored
draws. Where everything is right, from the trials to the file, ranks are uniform.

Evidence: data sets from the predictive update (H1) or from free frequencies (H0), each with
probability one half. Where everything is right, of the data sets with posterior probability P(H1 |
data) near p a share p came from H1.

Example: python scripts/calibration.py -o calibration --studies 1000 --data-sets 2000 --seed 1
Exit code 3 where something is not calibrated.
"""

import argparse
import platform
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from reference.calibration_statistics import (
    MARGIN,
    POINTS,
    band,
    ecdf_difference,
    log_score,
    place,
    rank_verdict,
    reliability,
)
from scipy import stats

import bayes_toe as bt
from bayes_toe.answers.evidence_table import subject_evidence
from bayes_toe.classical.fit import SubjectFit, subject_fit
from bayes_toe.cli.terminal import number
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_folder, whole_folder
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
from bayes_toe.libraries import library_versions
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
#: Probability of any false alarm among all ranked quantities of all designs.
FALSE_ALARM = 0.01
#: Smallest eigenvalue of a correlation matrix that still counts as invertible.
SINGULAR = 1e-10

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
SCORES = ("error", "floor", "p_value", "brier", "log_score", "unsure")
EVIDENCE_COLUMNS = (
    *("design", "batches", "estimator", "data_sets", "missing_h1", "missing_h0"),
    *("log_score_default", "median_shift", "largest_shift", *SCORES, "verdict"),
)
PRODUCTS = (
    "calibration.md",
    "calibration.csv",
    "calibration_ranks.csv",
    "calibration_ranks.png",
    "evidence_calibration.csv",
    "evidence_data_sets.csv",
)
Row = dict[str, Any]


class Calibration(NamedTuple):
    """A row a study and a data set, and verdicts by design and quantity or estimator."""

    ranks: pd.DataFrame
    data_sets: pd.DataFrame
    rank_verdicts: pd.DataFrame
    evidence_verdicts: pd.DataFrame

    def failures(self) -> list[str]:
        """Problems, a line each: ranks outside their band, evidences not calibrated."""
        lines = []
        for row in self.rank_verdicts.itertuples():
            if row.verdict != "inside":
                quantity = f"{row.quantity} outside their band (p = {row.p_value:.2g})"
                lines.append(f"{row.design} design: ranks of {quantity}")
        for row in self.evidence_verdicts.itertuples():
            if row.estimator == DEFAULT and row.verdict != "calibrated":
                lines.append(f"{row.design} design: probabilities of H1 are not calibrated")
        return lines


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
) -> tuple[Row, Row]:
    """Simulate a subject from H1 or H0 and analyse it as the commands would, with their streams.

    Its rows of ranks and of data sets, or empty ones. Observers come from the prior of the
    analysis, or from another one that is the truth.
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

    posterior = paper_posterior(subject, settings.prior)
    result = fitted_result(posterior, seed, request)
    ranks: Row = {}
    if request.chains is not None:
        study = bt.Study((subject,), "calibration", synthetic=True)
        draws = Draws(subjects_tree(study, [subject_draws(result)], settings, {}, {}))
        true_values = ranked_quantities(drawn.for_subject(subject), true_point)
        ranks = {"design": design, "subject": name, **ranks_of(draws, true_values)}
    factors: Row = {}
    if request.evidence_draws:
        replicates = subject_fit(subject, settings.prior, seed=seed, replicates=1000)
        evidences = {"h1_bootstrap": appendix_c_evidence(replicates, settings.prior)}
        row = subject_evidence(result)
        for column in ("h1", "h1_laplace", "h0", "h0_laplace"):
            evidences[column] = getattr(row, f"log_evidence_{column}")
        values = pd.Series(evidences, dtype=float)
        factors = {"design": design, "data_set": name, "from": origin}
        factors |= {key: values[h1] - values[h0] for key, (h1, h0) in ESTIMATORS.items()}
    return ranks, factors


def ranks_of(draws: Draws, true_values: dict[str, np.ndarray]) -> Row:
    """The true parameters, and the place of each true value among the draws, in 0..1."""
    (name,) = draws.names
    rng = generator(draws.seed, name, "rank")
    # Of each walker its last draw: walkers of a converged sample move every few steps, so these are
    # as good as independent.
    last = np.flatnonzero(np.diff(draws.group("posterior")["walker"].values, append=-1))
    points = draws.points(name)[:, last].reshape(-1, len(NATURAL))
    values = ranked_quantities(draws.posterior(name), points)
    row: Row = {f"true_{key}": true_values[key].item() for key in NATURAL}
    for key in RANKED:
        row[key] = place(true_values[key].item(), values[key], rng)
    return row | {"shortfall": draws.not_converged.get(name, "")}


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


def calibrate(*, studies: int, data_sets: int, seed: int, workers: int | None) -> Calibration:
    """Simulate data of known origin, and judge whether posteriors and evidences are calibrated.

    In each design, so many studies for the ranks and data sets for the evidence; those from H1 are
    the same, as far as these go.
    """
    if studies < 0 or data_sets < 0 or studies + data_sets == 0:
        raise bt.InputError(
            f"studies={studies} and data_sets={data_sets} must not be negative, nor both 0"
        )
    settings = calibration_settings(seed)
    jobs = []
    for design in DESIGNS:
        n_h1 = int((generator(seed, design, "hypothesis").uniform(size=data_sets) < 0.5).sum())
        for origin, n_subjects in (("H1", max(studies, n_h1)), ("H0", data_sets - n_h1)):
            for i in range(n_subjects):
                name = f"{design}-{origin.lower()}-{i + 1:04d}"
                is_study, is_data_set = origin == "H1" and i < studies, origin == "H0" or i < n_h1
                sampler = settings.sampler if is_study else None
                request = AnalysisRequest(sampler, EVIDENCE_DRAWS * is_data_set)
                jobs.append(partial(analyse, design, name, origin, request, settings))
    rows = run_in_order(jobs, workers, None, [job.args[1:2] for job in jobs])
    ranks = pd.DataFrame([row for row, _ in rows if row])
    return judged(ranks, pd.DataFrame([row for _, row in rows if row]), seed)


def judged(ranks: pd.DataFrame, data_sets: pd.DataFrame, seed: int) -> Calibration:
    """All verdicts."""
    rank_verdicts = pd.DataFrame(judged_ranks(ranks) if len(ranks) else ())
    evidence_verdicts = pd.DataFrame(judged_evidences(data_sets, seed) if len(data_sets) else ())
    return Calibration(ranks, data_sets, rank_verdicts, evidence_verdicts)


def judged_ranks(ranks: pd.DataFrame) -> Iterator[Row]:
    """Verdicts on the ranks of each quantity in each design, by a least p-value (Bonferroni)."""
    threshold = FALSE_ALARM / (len(RANKED) * ranks["design"].nunique())
    for design, group in ranks.groupby("design", sort=False):
        for quantity in RANKED:
            verdict = rank_verdict(group[quantity])
            yield {
                "design": design,
                "batches": DESIGNS[design],
                "quantity": quantity,
                "studies": len(group),
                "not_converged": int((group["shortfall"] != "").sum()),  # ranked like the others
                **verdict,
                "threshold": threshold,
                "verdict": "inside" if verdict["p_value"] >= threshold else "outside",
            }


def judged_evidences(data_sets: pd.DataFrame, seed: int) -> Iterator[Row]:
    """Verdicts on the probabilities P(H1 | data) of each estimator in each design; nats."""
    for design, group in data_sets.groupby("design", sort=False):
        for estimator in ESTIMATORS:
            missing = group["from"][group[estimator].isna()]
            row = dict.fromkeys(EVIDENCE_COLUMNS, np.nan)
            row |= {"design": design, "batches": DESIGNS[design], "estimator": estimator}
            row |= {"data_sets": len(group), "verdict": "not calibrated"}
            row["missing_h1"], row["missing_h0"] = (missing == "H1").sum(), (missing == "H0").sum()
            known = group.drop(missing.index)
            if len(known):
                rng = generator(seed, design, estimator, "reliability")
                result = reliability(known[estimator], known["from"] == "H1", rng)
                row |= {name: getattr(result, name) for name in SCORES}
                if result.calibrated:
                    row["verdict"] = "calibrated"
            both = known.dropna(subset=DEFAULT)
            if len(both):
                shifts = (both[estimator] - both[DEFAULT]).to_numpy()
                row["log_score_default"] = log_score(both[DEFAULT], both["from"] == "H1")
                row["median_shift"] = np.median(shifts)
                row["largest_shift"] = shifts[np.abs(shifts).argmax()]
            yield row


# --- Files ---------------------------------------------------------------------------------------


def verdict_lines(found: Calibration) -> list[str]:
    """The verdict in a few lines, with what did not converge and what was not reported."""
    lines = [f"NOT calibrated: {failure}" for failure in found.failures()]
    if len(found.ranks):
        n_inside = (found.rank_verdicts["verdict"] == "inside").sum()
        lines.append(
            f"The ranks of {n_inside} of {len(found.rank_verdicts)} rows are inside their bands. "
            "In a correct analysis, all rows are inside with a probability of "
            f"{100 * (1 - FALSE_ALARM):g} %."
        )
    for row in found.evidence_verdicts.itertuples():
        if row.estimator == DEFAULT:
            lines.append(
                f"In the {row.design} design, the probabilities of H1 are "
                f"{row.verdict.replace('not', 'NOT')}. The calibration error is {row.error:.4f}, "
                f"and the limit is {row.floor + MARGIN:.4f}."
            )
    if len(found.ranks):
        missed = found.ranks["subject"][found.ranks["shortfall"] != ""]
        line = f"All {len(found.ranks)} analyses converged."
        if len(missed):
            line = f"These analyses did not converge: {', '.join(missed)}."
        lines.append(line)
    if len(found.data_sets):
        withheld = found.data_sets["data_set"][found.data_sets[DEFAULT].isna()]
        if len(withheld):
            lines.append(f"The default estimator reports no evidence for {', '.join(withheld)}.")
    return lines


def draw_ranks(found: Calibration) -> Any:
    """Distribution functions of ranks minus the uniform one, with the band of each design."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.7), layout="constrained")
    axes = figure.subplots(2, len(RANKED) // 2, sharex=True, sharey=True).ravel()
    for ax, quantity in zip(axes, RANKED, strict=True):
        for design, group in found.ranks.groupby("design", sort=False):
            limits = band(len(group), 1.0 - found.rank_verdicts["threshold"].iloc[0])
            lower, upper = limits.lower / len(group), limits.upper / len(group)
            ax.fill_between(POINTS, lower - POINTS, upper - POINTS, color="0.9")
            ax.plot(POINTS, ecdf_difference(group[quantity]), label=f"{design} design")
        ax.set_title(quantity.replace("_", " "), fontsize="small")
    figure.supxlabel("rank of the true value", fontsize="small")
    figure.supylabel("ECDF difference", fontsize="small")
    figure.legend(handles=axes[0].lines, loc="outside upper right", ncols=2, fontsize="small")
    return figure


def write_calibration(found: Calibration, options: argparse.Namespace) -> None:
    """Write tables, the figure and calibration.md into the folder."""
    tables = {
        "calibration": found.rank_verdicts,
        "calibration_ranks": found.ranks,
        "evidence_calibration": found.evidence_verdicts,
        "evidence_data_sets": found.data_sets,
    }
    folder = Path(__file__).parent
    environment = Environment(
        loader=FileSystemLoader(folder), undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters.update(number=number)
    page = environment.get_template("calibration.md").render(
        ranks=list(found.rank_verdicts.itertuples()),
        evidence=list(found.evidence_verdicts.itertuples()),
        plan=options,
        verdict=verdict_lines(found),
        designs=" and ".join(f"{n} times in the design *{name}*" for name, n in DESIGNS.items()),
        draws=DRAWS,
        about={name: [_METHODS[side] for side in sides] for name, sides in ESTIMATORS.items()},
        default=DEFAULT,
        false_alarm=f"{FALSE_ALARM:g}",
        margin=f"{MARGIN:g}",
        python=platform.python_version(),
        versions=", ".join(map(" ".join, library_versions().items())),
    )
    with whole_folder(options.output, PRODUCTS, overwrite=options.overwrite) as target:
        (target / "calibration.md").write_text(page + "\n", encoding="utf-8")
        for stem, table in tables.items():
            if len(table):
                write_table(table, target / f"{stem}.csv")
        if len(found.ranks):
            bt.plots.save_figure(draw_ranks(found), target / "calibration_ranks.png")


def main() -> int:
    """Run the calibration and write its folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", default="calibration", help="folder")
    parser.add_argument("--studies", type=int, default=1000, help="a design, for the ranks")
    parser.add_argument("--data-sets", type=int, default=2000, help="a design, for the evidence")
    parser.add_argument("--seed", type=int, help="without it fresh entropy, printed")
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    try:
        options.seed = root_seed(options.seed)
        # Before the work, not after it.
        require_folder(options.output, PRODUCTS, overwrite=options.overwrite)
        found = calibrate(
            studies=options.studies,
            data_sets=options.data_sets,
            seed=options.seed,
            workers=options.workers,
        )
        write_calibration(found, options)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    print("\n".join(verdict_lines(found)))
    print(f"seed {options.seed}; results in {options.output}")
    return 3 if found.failures() else 0


if __name__ == "__main__":
    sys.exit(main())
