"""Are the stated error bars of the log evidence honest? Many seeds for every case whose evidence is known by another route.

For each case of tests/reference the evidence is estimated anew with every seed, fitting included; z = (estimate - reference) / stated
standard error must have standard deviation 1. Writes error_bars.csv and error_bars.md; exit code 3 where an error bar is not honest.

The cases are the paper's model of many subjects, known by deterministic integration. With --verdict they are models that a verdict averages
over, of four subjects, estimated as a verdict does it and known by tempering, where that is precise.

Example: python scripts/error_bars.py -o docs --seeds 100 --overwrite
"""

import argparse
import json
import platform
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from reference.hard_cases import hard_cases
from reference.tempering import PRIOR

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_writable, whole_file
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import Evidence, importance_evidence
from bayes_toe.inference.maxima import find_maxima
from bayes_toe.inference.proposal import FittedProposal
from bayes_toe.inference.space import space_evidence
from bayes_toe.model.ladder import SPACE, model_named
from bayes_toe.workers import run_in_order

REFERENCES = Path(__file__).parents[1] / "tests" / "reference"
BAND, PRECISE = (0.8, 1.25), 0.01
PAGE = """# Are the error bars of {whose} honest?

{seeds} seeds a case, the fit of the proposal included; z = (estimate - reference) / stated standard error. Its standard
deviation should be 1 and must lie in {band[0]} to {band[1]} ({seeds} seeds determine it to about {precision:.0f} %):
{verdict}
{far}
`python scripts/error_bars.py -o docs {option}--overwrite` makes this page again. The references are in `tests/reference`.
In full: [{table}]({table}).
bayes_toe {version}, Python {python}, numpy {numpy}.

| case | withheld | mean z | sd of z | largest z | median s.e. (nat) | largest s.e. | largest k-hat |
|---|--:|--:|--:|--:|--:|--:|--:|
"""
ROW = (
    "| {0.case} | {0.withheld} | {0.mean_z:.2f} | {0.sd_z:.2f} | {0.largest_z:.1f} "
    "| {0.median_se:.4f} | {0.largest_se:.4f} | {0.largest_pareto_k:.2f} |\n"
)


def main() -> int:
    """Estimate, compare, write."""
    subjects = {**{subject.name: subject for subject in bt.example_study()}, **hard_cases()}
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
    parser.add_argument(
        "--cases",
        type=lambda names: names.split(","),
        help="names, separated by commas; by default all",
    )
    parser.add_argument(
        "--verdict",
        action="store_true",
        help="the models of verdicts; writes error_bars_verdict.csv and .md",
    )
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    parser.add_argument("--overwrite", action="store_true")
    asked = parser.parse_args()
    known = json.loads(
        (REFERENCES / ("compositions.json" if asked.verdict else "reference.json")).read_text(
            encoding="utf-8"
        )
    )["cases"]
    cases, models = {}, {"", *(model.name for model in SPACE)}
    for name, one in known.items():
        subject, _, model = name.partition(": ")
        if model in models and one["log_evidence_error"] < PRECISE:
            cases[name] = subjects[subject], model, one["log_evidence"]
    names = list(cases) if asked.cases is None else asked.cases
    for name in names:
        if name not in cases:
            parser.error(f"--cases: no case named {name!r}; there are {', '.join(cases)}")
    stem = "error_bars_verdict" if asked.verdict else "error_bars"
    written = [asked.output / f"{stem}.csv", asked.output / f"{stem}.md"]
    try:
        for path in written:
            require_writable(path, overwrite=asked.overwrite)
        jobs = [partial(z_scores, name, *cases[name], asked.seeds) for name in names]
        table = pd.DataFrame(run_in_order(jobs, asked.workers, print, [(name,) for name in names]))
        write_table(table, written[0], overwrite=asked.overwrite)
        with whole_file(written[1], overwrite=asked.overwrite) as temporary:
            temporary.write_text(page(table, written[0].name, asked.verdict), encoding="utf-8")
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0 if table["honest"].all() else 3


def estimates(subject: bt.Subject, model: str, seeds: int) -> list[tuple[FittedProposal, Evidence]]:
    """The evidence with every seed, and the proposal behind it: of a model as a verdict has it, without a name of the paper's."""
    if model:
        found = (
            space_evidence(subject, PRIOR, [model_named(model)], seed).sampled
            for seed in range(seeds)
        )
        return [(some[0].fitted, some[0].evidence) for some in found if some]
    posterior = bt.model.posterior_of(subject, bt.Prior())
    maxima = find_maxima(posterior)
    fitted = [
        fit_proposal(posterior, np.random.default_rng([seed, 7]), start=maxima)
        for seed in range(seeds)
    ]
    return [(one, importance_evidence(one)) for one in fitted]


def z_scores(
    name: str, subject: bt.Subject, model: str, reference: float, seeds: int
) -> dict[str, object]:
    """The row of one case."""
    found = estimates(subject, model, seeds)
    given = [(one.value, one.se) for _, one in found if one.value is not None]
    values, errors = np.array(given).reshape(-1, 2).T
    z = pd.Series((values - reference) / errors)
    row = {"case": name, "seeds": seeds, "withheld": seeds - len(z)}
    if len(z) > 1:
        row |= {
            "mean_z": z.mean(),
            "sd_z": z.std(),
            "largest_z": z.abs().max(),
            "median_se": np.median(errors),
            "largest_se": errors.max(),
        }
    else:
        row |= dict.fromkeys(("mean_z", "sd_z", "largest_z", "median_se", "largest_se"), np.nan)
    honest = BAND[0] < row["sd_z"] < BAND[1] or len(z) == 0
    return {
        **row,
        "largest_pareto_k": max((fit.pareto_k for fit, _ in found), default=np.nan),
        "honest": bool(honest),
    }


def page(table: pd.DataFrame, file: str, verdict: bool) -> str:
    """The table as Markdown, with what it says, and single estimates further off than chance explains, of which nothing warned."""
    bad, seeds = table.loc[~table["honest"], "case"], int(table["seeds"].iloc[0])
    far = ", ".join(
        f"{row.case} ({row.largest_z:.1f} standard errors, about {row.largest_z * row.median_se:.2f} nat)"
        for row in table[table["largest_z"] > 5.0].itertuples()
    )
    head = PAGE.format(
        table=file,
        whose="a verdict's evidences" if verdict else "the evidence",
        option="--verdict " if verdict else "",
        seeds=seeds,
        band=BAND,
        precision=100 / np.sqrt(2 * (seeds - 1)),
        verdict="every one lies in that range." if bad.empty else f"outside it: {', '.join(bad)}.",
        far=f"Single estimates further than 5 standard errors off, without a warning: {far}.\n"
        if far
        else "",
        version=bt.__version__,
        python=platform.python_version(),
        numpy=np.__version__,
    )
    return head + "".join(map(ROW.format, table.itertuples()))


if __name__ == "__main__":
    sys.exit(main())
