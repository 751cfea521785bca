"""Are the stated error bars of the log evidence honest? Many seeds for every case whose evidence is known from deterministic integration.

For each case of tests/reference the evidence is estimated anew with every seed, fitting included; z = (estimate - reference) / stated
standard error must have standard deviation 1. Writes error_bars.csv and error_bars.md.

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

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_writable, whole_file
from bayes_toe.errors import BayesToeError, InputError, WorkerError
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.inference.maxima import find_maxima
from bayes_toe.workers import Failed, run_jobs

REFERENCE = Path(__file__).parents[1] / "tests" / "reference" / "reference.json"
FILES = ("error_bars.csv", "error_bars.md")
BAND = (0.8, 1.25)


@dataclass(frozen=True)
class Case:
    """A subject, the reference's log evidence and the number of seeds."""

    subject: bt.Subject
    log_evidence: float
    seeds: int


def main() -> int:
    """Estimate, compare, write; exit code 3 where an error bar is not honest."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to write to; the committed run is in docs")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--cases", help="names, separated by commas; by default all")
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    try:
        for name in FILES:
            require_writable(options.output / name, overwrite=options.overwrite)
        names = None if options.cases is None else options.cases.split(",")
        table = measure(options.seeds, names, options.workers)
        write_table(table, options.output / FILES[0], overwrite=options.overwrite)
        with whole_file(options.output / FILES[1], overwrite=options.overwrite) as temporary:
            temporary.write_text(page(table), encoding="utf-8")
    except BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0 if table["honest"].all() else 3


def measure(seeds: int, names: list[str] | None, workers: int | None) -> pd.DataFrame:
    """One row a case."""
    subjects = {**{subject.name: subject for subject in bt.example_study()}, **hard_cases()}
    stored = json.loads(REFERENCE.read_text(encoding="utf-8"))["cases"]
    unknown = [name for name in names or [] if name not in subjects]
    if unknown:
        raise InputError(f"--cases: no case named {unknown[0]!r}; there are {', '.join(subjects)}")
    cases = [Case(subjects[name], stored[name]["log_evidence"], seeds) for name in names or subjects]
    rows = {}
    for index, row in run_jobs([partial(z_scores, case) for case in cases], workers):
        if isinstance(row, Failed):
            raise WorkerError(f"{cases[index].subject.name}: {row.reason}")
        rows[index] = row
        print(f"{row['case']:32s} sd of z {row['sd_z']:.2f}, {row['withheld']} withheld", flush=True)
    return pd.DataFrame([rows[index] for index in range(len(cases))])


def z_scores(case: Case) -> dict[str, object]:
    """The row of one case."""
    posterior = bt.model.posterior_of(case.subject, bt.Prior())
    maxima = find_maxima(posterior)
    fitted = [fit_proposal(posterior, np.random.default_rng([seed, 7]), start=maxima) for seed in range(case.seeds)]
    given = [(one.value, one.se) for one in map(importance_evidence, fitted) if one.value is not None]
    values, errors = np.array(given).reshape(-1, 2).T
    z = (values - case.log_evidence) / errors
    enough = len(z) > 1
    return {
        "case": case.subject.name,
        "seeds": case.seeds,
        "withheld": case.seeds - len(z),
        "mean_z": z.mean() if enough else np.nan,
        "sd_z": z.std(ddof=1) if enough else np.nan,
        "largest_z": np.abs(z).max() if enough else np.nan,
        "median_se": np.median(errors) if enough else np.nan,
        "largest_se": errors.max() if enough else np.nan,
        "largest_pareto_k": max(fit.pareto_k for fit in fitted),
        "honest": bool(enough and BAND[0] < z.std(ddof=1) < BAND[1]) or len(z) == 0,
    }


def far_off(table: pd.DataFrame) -> list[str]:
    """A sentence on single estimates that are further off than chance explains: where neither k-hat nor the error bar warned."""
    far = table[table["largest_z"] > 5.0]
    named = ", ".join(
        f"{row.case} ({row.largest_z:.1f} standard errors, about {row.largest_z * row.median_se:.2f} nat)" for row in far.itertuples()
    )
    return [f"Single estimates further than 5 standard errors off, without a warning: {named}."] if named else []


def page(table: pd.DataFrame) -> str:
    """The table as Markdown, with what it says."""
    bad = table.loc[~table["honest"], "case"]
    verdict = "every one lies in that range." if bad.empty else f"outside it: {', '.join(bad)}."
    seeds = int(table["seeds"].iloc[0])
    precision = 100 / np.sqrt(2 * (seeds - 1))
    lines = [
        "# Are the error bars of the evidence honest?",
        "",
        f"{seeds} seeds a case, the fit of the proposal included; z = (estimate - reference) / stated standard error. Its standard",
        f"deviation should be 1 and must lie in {BAND[0]} to {BAND[1]} ({seeds} seeds determine it to about {precision:.0f} %):",
        verdict,
        *far_off(table),
        "",
        "`python scripts/error_bars.py -o docs --overwrite` makes this page again. The references are in `tests/reference`.",
        "In full: [error_bars.csv](error_bars.csv).",
        f"bayes_toe {bt.__version__}, Python {platform.python_version()}, numpy {np.__version__}.",
        "",
        "| case | withheld | mean z | sd of z | largest z | median s.e. (nat) | largest s.e. | largest k-hat |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in table.itertuples():
        numbers = f"{row.mean_z:.2f} | {row.sd_z:.2f} | {row.largest_z:.1f} | {row.median_se:.4f} | {row.largest_se:.4f}"
        lines.append(f"| {row.case} | {row.withheld} | {numbers} | {row.largest_pareto_k:.2f} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
