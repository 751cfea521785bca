"""Are the standard errors of log evidences right? Many seeds for every case known by another route.

For each case of tests/reference the evidence is estimated anew with every seed, fitting included;
z = (estimate - reference) / stated standard error must have standard deviation 1. Writes
error_bars.csv and error_bars.md; exit code 3 where a standard error is not right.

The cases are the paper's model of many subjects, known by deterministic integration. With --order
they are the four models of the observer, known by tempering; models far below a subject's best
one are left out, because they get few draws on purpose.

Example: python scripts/error_bars.py -o docs --seeds 100 --overwrite
"""

import sys
from argparse import Namespace
from functools import partial
from itertools import chain

import numpy as np
import pandas as pd
from reference.hard_cases import hard_cases, stored_references
from reference.order_cases import order_cases
from reference.pages import markdown, page_parser, render, write_page

import bayes_toe as bt
from bayes_toe.inference.fitted import fit_posterior, importance_evidence
from bayes_toe.inference.order_evidence import MODEL_NAMES, order_evidence
from bayes_toe.workers import run_in_order

BAND, PRECISE = (0.8, 1.25), 0.012
#: Nats below the best model of a subject from which on a model is left out.
FAR = 6.0
#: The worst value of each number that judges an estimate.
QUALITIES = {"largest_pareto_k": "max", "least_effective_draws": "min"}
#: Titles of the columns on the page.
TITLES = {
    "withheld": "not reported",
    "mean_z": "mean z",
    "sd_z": "SD of z",
    "largest_z": "largest absolute z",
    "median_se": "median s.e. (nats)",
    "largest_se": "largest s.e.",
    "largest_pareto_k": "largest k-hat",
    "least_effective_draws": "least effective draws",
}


def main() -> int:
    """Estimate, compare, write."""
    parser = page_parser(__doc__, seeds=100)
    parser.add_argument("--subjects", nargs="+", metavar="NAME", help="by default all")
    parser.add_argument("--order", action="store_true", help="the four models of the observer")
    options = parser.parse_args()
    estimate, subjects, stem = paper_estimates, paper_subjects(), "error_bars"
    if options.order:
        estimate, subjects, stem = order_estimates, order_cases(), "error_bars_order"
    names = options.subjects or list(subjects)
    unknown = set(names) - subjects.keys()
    if unknown:
        parser.error(f"--subjects: no {'; '.join(unknown)}; there are {'; '.join(subjects)}")

    def work() -> tuple[pd.DataFrame, str]:
        jobs = [partial(estimate, subjects[name], options.seeds) for name in names]
        rows = run_in_order(jobs, options.workers, print, [(name,) for name in names])
        table = judged(pd.DataFrame(chain.from_iterable(rows)))
        return table, page(table, stem, options)

    return 0 if write_page(options, stem, work)["honest"].all() else 3


def paper_subjects() -> dict[str, bt.Subject]:
    """The subjects whose evidence under the paper's model is known."""
    subjects = [*bt.example_study("same/different"), *hard_cases().values()]
    references = stored_references("reference.json")
    return {subject.name: subject for subject in subjects if subject.name in references}


def paper_estimates(subject: bt.Subject, seeds: int) -> list[dict[str, object]]:
    """A row a seed for the paper's model; a number is None where the evidence is not reported."""
    reference = stored_references("reference.json")[subject.name]["log_evidence"]
    posterior = bt.model.paper_posterior(subject, bt.Prior())
    rows = []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 7])
        evidence = importance_evidence(fit_posterior(posterior, rng).fresh(rng, 20_000))
        row = {"case": subject.name, "reference": reference, "value": evidence.value}
        rows.append(row | {"se": evidence.se, "largest_pareto_k": evidence.pareto_k})
    return rows


def order_estimates(subject: bt.Subject, seeds: int) -> list[dict[str, object]]:
    """A row a seed and model, without the models far below the best one."""
    cases = [f"{subject.name}: {model}" for model in MODEL_NAMES]
    references = stored_references("order_models.json")[cases]
    known = references.loc["log_evidence"].to_numpy(float)
    is_used = known > known.max() - FAR
    is_used &= references.loc["log_evidence_error"].to_numpy(float) < PRECISE
    rows = []
    for seed in range(seeds):
        (evidence,) = order_evidence([subject], seed)
        rows += pd.DataFrame(
            {
                "case": cases,
                "reference": known,
                "value": evidence.log_evidence,
                "se": evidence.standard_error,
                "least_effective_draws": [draws.effective_number for draws in evidence.draws],
            }
        )[is_used].to_dict("records")
    return rows


def judged(estimates: pd.DataFrame) -> pd.DataFrame:
    """A row a case: how far the estimates are from the reference in standard errors."""
    errors = estimates["se"].astype(float)
    z = (estimates["value"].astype(float) - estimates["reference"]) / errors
    groups = estimates.assign(se=errors, z=z, distance=z.abs()).groupby("case", sort=False)
    table = groups.agg(
        seeds=("z", "size"),
        withheld=("z", "count"),
        mean_z=("z", "mean"),
        sd_z=("z", "std"),
        largest_z=("distance", "max"),
        median_se=("se", "median"),
        largest_se=("se", "max"),
        **{name: (name, worst) for name, worst in QUALITIES.items() if name in estimates},
    )
    n_reported = table["withheld"]
    table["honest"] = (n_reported == 0) | table["sd_z"].between(*BAND, inclusive="neither")
    table["withheld"] = table["seeds"] - n_reported
    return table.reset_index()


def page(table: pd.DataFrame, stem: str, options: Namespace) -> str:
    """The table as Markdown, what it shows, and single estimates that are far off."""
    columns = table.drop(columns=["seeds", "honest"]).round({"least_effective_draws": 0})
    return render(
        __file__,
        stem=stem,
        options=options,
        band=BAND,
        bad=table.loc[~table["honest"], "case"].tolist(),
        far=table[table["largest_z"] > 5.0].to_dict("records"),
        rows=markdown(columns.convert_dtypes().rename(columns=TITLES)),
    )


if __name__ == "__main__":
    sys.exit(main())
