"""Are the standard errors of log evidences right? Many seeds for every case known by another route.

For each case of tests/reference the evidence is estimated anew with every seed, fitting included;
z = (estimate - reference) / stated standard error must have standard deviation 1. Writes
error_bars.csv and error_bars.md; exit code 3 where a standard error is not right.

The cases are the paper's model of many subjects, known by deterministic integration. With --order
they are the four models of the observer, known by tempering; models far below a subject's best
one are left out, because they get few draws on purpose.

Example: python scripts/error_bars.py -o docs --seeds 100 --overwrite
"""

import argparse
import json
import platform
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from reference.hard_cases import hard_cases
from reference.order_cases import order_cases

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_writable, whole_file
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


@dataclass(frozen=True)
class Estimates:
    """Log evidences of one case with every seed; NaN where none is reported.

    `quality` is the largest k-hat, or of the four models the least number of effective draws.
    """

    values: np.ndarray
    errors: np.ndarray
    quality: float


def main() -> int:
    """Estimate, compare, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        help="folder to write to; the committed run is in docs",
    )
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--subjects", nargs="+", metavar="NAME", help="by default all")
    parser.add_argument(
        "--order",
        action="store_true",
        help="the four models of the observer; writes error_bars_order.csv and .md",
    )
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    stem = "error_bars_order" if options.order else "error_bars"
    written = [options.output / f"{stem}.csv", options.output / f"{stem}.md"]
    jobs = order_jobs(options.seeds) if options.order else paper_jobs(options.seeds)
    names = list(jobs) if options.subjects is None else options.subjects
    for name in names:
        if name not in jobs:
            parser.error(f"--subjects: no subject named {name!r}; there are {'; '.join(jobs)}")
    try:
        for path in written:
            require_writable(path, overwrite=options.overwrite)
        tables = run_in_order(
            [jobs[name] for name in names], options.workers, print, [(name,) for name in names]
        )
        table = pd.DataFrame([row for rows in tables for row in rows])
        write_table(table, written[0], overwrite=options.overwrite)
        with whole_file(written[1], overwrite=options.overwrite) as temporary:
            temporary.write_text(page(table, written[0].name, options.order), encoding="utf-8")
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0 if table["honest"].all() else 3


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
    values, errors, pareto_k = [], [], []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 7])
        evidence = importance_evidence(fit_posterior(posterior, rng).fresh(rng, 20_000))
        values.append(np.nan if evidence.value is None else evidence.value)
        errors.append(np.nan if evidence.se is None else evidence.se)
        pareto_k.append(evidence.pareto_k)
    estimates = Estimates(np.array(values), np.array(errors), max(pareto_k))
    return [row(subject.name, estimates, reference, "largest_pareto_k")]


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
        estimates = Estimates(values[:, i], errors[:, i], float(effective[:, i].min()))
        name = f"{subject.name}: {model}"
        rows.append(row(name, estimates, reference, "least_effective_draws"))
    return rows


def row(name: str, estimates: Estimates, reference: float, quality: str) -> dict[str, object]:
    """The row of one case."""
    seeds = len(estimates.values)
    reported = ~np.isnan(estimates.values)
    errors = estimates.errors[reported]
    z = pd.Series((estimates.values[reported] - reference) / errors)
    entries: dict[str, object] = {"case": name, "seeds": seeds, "withheld": seeds - len(z)}
    if len(z) > 1:
        entries |= {
            "mean_z": z.mean(),
            "sd_z": z.std(),
            "largest_z": z.abs().max(),
            "median_se": np.median(errors),
            "largest_se": errors.max(),
        }
    else:
        entries |= dict.fromkeys(("mean_z", "sd_z", "largest_z", "median_se", "largest_se"), np.nan)
    honest = len(z) == 0 or bool(BAND[0] < z.std() < BAND[1])
    return {**entries, quality: estimates.quality, "honest": honest}


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
        version=bt.__version__,
        python=platform.python_version(),
        numpy=np.__version__,
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
