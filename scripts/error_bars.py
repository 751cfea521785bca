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
from functools import partial
from itertools import chain

import numpy as np
import pandas as pd
from reference.hard_cases import hard_cases, stored_references
from reference.order_cases import order_cases
from reference.pages import markdown, page_parser, versions, write_page

import bayes_toe as bt
from bayes_toe.inference.fitted import fit_posterior, importance_evidence
from bayes_toe.inference.order_evidence import MODEL_NAMES, order_evidence
from bayes_toe.workers import run_in_order

BAND, PRECISE = (0.8, 1.25), 0.012
#: Nats below the best model of a subject from which on a model is left out.
FAR = 6.0
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
PAGE = """# Are the standard errors of {evidences} right?

We estimate each case with {seeds} seeds. The number z is the difference between an estimate and the reference, divided by
the reported standard error. If the standard errors are right, the standard deviation of z is 1. Chance
changes this standard deviation by about {precision:.0f} %, because the seeds are few. We accept values between {band[0]} and {band[1]}.
{conclusion}
{far}
`python scripts/error_bars.py -o docs --seeds {seeds} {option}--overwrite` writes this page and [{table}]({table}). The references are in
`tests/reference`. The versions were bayes_toe {version}, Python {python} and numpy {numpy}.

{rows}
"""


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
    estimate, subjects, stem = paper_estimates, paper_subjects(), "error_bars"
    if options.order:
        estimate, subjects, stem = order_estimates, order_cases(), "error_bars_order"
    names = options.subjects or list(subjects)
    for name in names:
        if name not in subjects:
            parser.error(f"--subjects: no subject named {name!r}; there are {'; '.join(subjects)}")

    def work() -> tuple[pd.DataFrame, str]:
        jobs = [partial(estimate, subjects[name], options.seeds) for name in names]
        rows = run_in_order(jobs, options.workers, print, [(name,) for name in names])
        table = judged(pd.DataFrame(chain.from_iterable(rows)), options.order)
        return table, page(table, f"{stem}.csv", options.order)

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
        rows.append(row | {"se": evidence.se, "quality": evidence.pareto_k})
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
        for i in np.flatnonzero(is_used):
            row = {"case": cases[i], "reference": known[i], "value": evidence.log_evidence[i]}
            row |= {"se": evidence.standard_error[i], "quality": evidence.effective_draws[i]}
            rows.append(row)
    return rows


def judged(estimates: pd.DataFrame, is_order: bool) -> pd.DataFrame:
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
    )
    n_reported = table["withheld"]
    table["withheld"] = table["seeds"] - n_reported
    if is_order:
        table["least_effective_draws"] = groups["quality"].min()
    else:
        table["largest_pareto_k"] = groups["quality"].max()
    table["honest"] = (n_reported == 0) | table["sd_z"].between(*BAND, inclusive="neither")
    return table.reset_index()


def page(table: pd.DataFrame, file: str, is_order: bool) -> str:
    """The table as Markdown, what it shows, and single estimates that are far off."""
    bad, seeds = table.loc[~table["honest"], "case"], int(table["seeds"].iloc[0])
    far = []
    for row in table[table["largest_z"] > 5.0].itertuples():
        nats = row.largest_z * row.median_se
        far.append(f"`{row.case}` ({row.largest_z:.1f} standard errors, about {nats:.2f} nat)")
    far_line = ""
    if far:
        far_line = (
            "In these cases, the largest error of an estimate exceeds 5 standard errors without a "
            f"warning: {'; '.join(far)}.\n"
        )
    conclusion = "All cases lie in this range."
    if not bad.empty:
        conclusion = f"These cases lie outside this range: `{'`, `'.join(bad)}`."
    shown = table.drop(columns=["seeds", "honest"]).round({"least_effective_draws": 0})
    return PAGE.format(
        table=file,
        evidences="the four models' evidences" if is_order else "the evidence",
        option="--order " if is_order else "",
        seeds=seeds,
        band=BAND,
        precision=100 / np.sqrt(2 * (seeds - 1)),
        conclusion=conclusion,
        far=far_line,
        rows=markdown(shown.convert_dtypes().rename(columns=TITLES)),
        **versions(),
    )


if __name__ == "__main__":
    sys.exit(main())
