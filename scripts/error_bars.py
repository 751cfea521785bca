"""Are the standard errors of log evidences right? Many seeds for every case known by another route.

For each case of tests/reference the evidence is estimated anew with every seed, fitting included;
z = (estimate - reference) / stated standard error must have standard deviation 1. Writes
error_bars.csv and error_bars.md; exit code 3 where a standard error is not right.

The cases are the paper's model of many subjects, known by deterministic integration. With --order
they are the four models of the observer, known by tempering; models far below a subject's best
one are left out, because they get few draws on purpose.

Example: python scripts/error_bars.py -o docs --seeds 100 --overwrite
"""

import json
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from reference.hard_cases import hard_cases
from reference.order_cases import order_cases
from reference.pages import page_parser, versions, write_page

import bayes_toe as bt
from bayes_toe.inference.fitted import fit_posterior, importance_evidence
from bayes_toe.inference.order_evidence import MODEL_NAMES, order_evidence
from bayes_toe.workers import run_in_order

REFERENCES = Path(__file__).parents[1] / "tests" / "reference"
BAND, PRECISE = (0.8, 1.25), 0.012
#: Nats below the best model of a subject from which on a model is left out.
FAR = 6.0
PAGE = """# Are the standard errors of {evidences} right?

We estimate each case with {seeds} seeds. The number z is the difference between an estimate and the reference, divided by
the reported standard error. If the standard errors are right, the standard deviation of z is 1. Chance
changes this standard deviation by about {precision:.0f} %, because the seeds are few. We accept values between {band[0]} and {band[1]}.
{conclusion}
{far}
`python scripts/error_bars.py -o docs --seeds {seeds} {option}--overwrite` writes this page and [{table}]({table}). The references are in
`tests/reference`. The versions were bayes_toe {version}, Python {python} and numpy {numpy}.

| case | not reported | mean z | SD of z | largest absolute z | median s.e. (nats) | largest s.e. | {quality} |
|---|--:|--:|--:|--:|--:|--:|--:|
"""
ROW = (
    "| {0.case} | {0.withheld} | {0.mean_z:.2f} | {0.sd_z:.2f} | {0.largest_z:.1f} "
    "| {0.median_se:.4f} | {0.largest_se:.4f} | {1} |\n"
)


def main() -> int:
    """Estimate, compare, write."""
    parser = page_parser(__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--subjects", nargs="+", metavar="NAME", help="by default all")
    parser.add_argument(
        "--order",
        action="store_true",
        help="the four models of the observer; writes error_bars_order.csv and .md",
    )
    options = parser.parse_args()
    jobs = order_jobs(options.seeds) if options.order else paper_jobs(options.seeds)
    names = list(jobs) if options.subjects is None else options.subjects
    for name in names:
        if name not in jobs:
            parser.error(f"--subjects: no subject named {name!r}; there are {'; '.join(jobs)}")
    stem = "error_bars_order" if options.order else "error_bars"

    def work() -> tuple[pd.DataFrame, str]:
        chosen = [jobs[name] for name in names]
        tables = run_in_order(chosen, options.workers, print, [(name,) for name in names])
        table = pd.DataFrame([row for rows in tables for row in rows])
        return table, page(table, f"{stem}.csv", options.order)

    return 0 if write_page(options, stem, work)["honest"].all() else 3


def _references(file: str) -> dict[str, dict[str, float]]:
    """The stored cases by name."""
    return json.loads((REFERENCES / file).read_text(encoding="utf-8"))["cases"]


def paper_jobs(seeds: int) -> dict[str, partial]:
    """By subject, the rows of the paper's model."""
    subjects = {
        **{subject.name: subject for subject in bt.example_study("same/different")},
        **hard_cases(),
    }
    return {
        name: partial(paper_rows, subjects[name], case["log_evidence"], seeds)
        for name, case in _references("reference.json").items()
    }


def order_jobs(seeds: int) -> dict[str, partial]:
    """By subject, the rows of the four models."""
    known = _references("order_models.json")
    jobs = {}
    for name, subject in order_cases().items():
        cases = {model: known[f"{name}: {model}"] for model in MODEL_NAMES}
        best = max(case["log_evidence"] for case in cases.values())
        references = {
            model: case["log_evidence"]
            for model, case in cases.items()
            if case["log_evidence"] > best - FAR and case["log_evidence_error"] < PRECISE
        }
        jobs[name] = partial(order_rows, subject, references, seeds)
    return jobs


def paper_rows(subject: bt.Subject, reference: float, seeds: int) -> list[dict[str, object]]:
    """The row of the paper's model."""
    posterior = bt.model.paper_posterior(subject, bt.Prior())
    evidences = []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 7])
        evidences.append(importance_evidence(fit_posterior(posterior, rng).fresh(rng, 20_000)))
    # NaN where an evidence is not reported.
    values = np.array([evidence.value for evidence in evidences], np.float64)
    errors = np.array([evidence.se for evidence in evidences], np.float64)
    largest = max(evidence.pareto_k for evidence in evidences)
    return [row(subject.name, values - reference, errors, largest_pareto_k=largest)]


def order_rows(
    subject: bt.Subject, references: dict[str, float], seeds: int
) -> list[dict[str, object]]:
    """The rows of a subject's models, by the names of their references."""
    evidences = [order_evidence([subject], seed)[0] for seed in range(seeds)]
    values = np.array([evidence.log_evidence for evidence in evidences])
    errors = np.array([evidence.standard_error for evidence in evidences])
    effective = np.array([evidence.effective_draws for evidence in evidences])
    rows = []
    for model, reference in references.items():
        i = MODEL_NAMES.index(model)
        differences, least = values[:, i] - reference, float(effective[:, i].min())
        name = f"{subject.name}: {model}"
        rows.append(row(name, differences, errors[:, i], least_effective_draws=least))
    return rows


def row(
    name: str, differences: np.ndarray, errors: np.ndarray, **quality: float
) -> dict[str, object]:
    """The row of one case: differences from the reference, NaN where none is reported."""
    is_reported = ~np.isnan(differences)
    z = pd.Series(differences[is_reported] / errors[is_reported])
    return {
        "case": name,
        "seeds": len(differences),
        "withheld": len(differences) - len(z),
        "mean_z": z.mean(),
        "sd_z": z.std(),
        "largest_z": z.abs().max(),
        "median_se": pd.Series(errors[is_reported]).median(),
        "largest_se": pd.Series(errors[is_reported]).max(),
        **quality,
        "honest": len(z) == 0 or bool(BAND[0] < z.std() < BAND[1]),
    }


def page(table: pd.DataFrame, file: str, is_order: bool) -> str:
    """The table as Markdown, what it shows, and single estimates that are far off."""
    bad, seeds = table.loc[~table["honest"], "case"], int(table["seeds"].iloc[0])
    far = "; ".join(
        f"`{row.case}` ({row.largest_z:.1f} standard errors, about "
        f"{row.largest_z * row.median_se:.2f} nat)"
        for row in table[table["largest_z"] > 5.0].itertuples()
    )
    far_line = ""
    if far:
        far_line = (
            "In these cases, the largest error of an estimate exceeds 5 standard errors without a "
            f"warning: {far}.\n"
        )
    conclusion = "All cases lie in this range."
    if not bad.empty:
        conclusion = f"These cases lie outside this range: `{'`, `'.join(bad)}`."
    head = PAGE.format(
        table=file,
        evidences="the four models' evidences" if is_order else "the evidence",
        option="--order " if is_order else "",
        seeds=seeds,
        band=BAND,
        precision=100 / np.sqrt(2 * (seeds - 1)),
        conclusion=conclusion,
        far=far_line,
        quality="least effective draws" if is_order else "largest k-hat",
        **versions(),
    )
    rows = []
    for entries in table.itertuples():
        if is_order:
            quality = f"{entries.least_effective_draws:.0f}"
        else:
            quality = f"{entries.largest_pareto_k:.2f}"
        rows.append(ROW.format(entries, quality))
    return head + "".join(rows)


if __name__ == "__main__":
    sys.exit(main())
