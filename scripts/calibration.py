"""Check whether posteriors and evidences are calibrated.

It simulates data of known origin, analyses them as usual, and writes tables and figures.

Example: python scripts/calibration.py -o calibration --studies 1000 --data-sets 2000 --seed 1
Exit code 3 where something is not calibrated.
"""

import argparse
import platform
import sys
from pathlib import Path

import numpy as np
from calibration_figures import ranks_figure, reliability_figure
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from reference.calibration import (
    ABOUT,
    DEFAULT,
    DESIGNS,
    DRAWS,
    FALSE_ALARM,
    Calibration,
    calibrate,
)
from reference.calibration_statistics import MARGIN

import bayes_toe as bt
from bayes_toe.cli.terminal import number
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_folder, whole_folder
from bayes_toe.libraries import library_versions

#: What the folder of a calibration may hold.
PRODUCTS = (
    "calibration.md",
    "calibration.csv",
    "calibration_ranks.csv",
    "calibration_ranks.png",
    "evidence_calibration.csv",
    "evidence_data_sets.csv",
    "evidence_reliability.png",
)


def write_calibration(found: Calibration, folder: str | Path, *, overwrite: bool = False) -> None:
    """Write tables, figures and calibration.md into `folder`."""
    tables, figures = {}, {}
    if len(found.ranks):
        tables |= {"calibration": found.rank_verdicts, "calibration_ranks": found.ranks}
        figures["calibration_ranks"] = ranks_figure(found)
    if len(found.data_sets):
        tables["evidence_calibration"] = found.evidence_verdicts
        tables["evidence_data_sets"] = found.data_sets
        figures["evidence_reliability"] = reliability_figure(found)
    with whole_folder(folder, PRODUCTS, overwrite=overwrite) as target:
        (target / "calibration.md").write_text(_text(found) + "\n", encoding="utf-8")
        for stem, table in tables.items():
            write_table(table, target / f"{stem}.csv")
        for stem, figure in figures.items():
            bt.plots.save_figure(figure, target / f"{stem}.png")


def _text(found: Calibration) -> str:
    """calibration.md: verdict, tables, figures, how it was made."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters.update(number=number)
    return environment.get_template("calibration.md").render(
        ranks=list(found.rank_verdicts.itertuples()),
        evidence=list(found.evidence_verdicts.itertuples()),
        plan=found.plan,
        verdict=verdict_lines(found),
        designs=" and ".join(f"{n} times in the design *{name}*" for name, n in DESIGNS.items()),
        draws=DRAWS,
        about=ABOUT,
        default=DEFAULT,
        false_alarm=f"{FALSE_ALARM:g}",
        margin=f"{MARGIN:g}",
        python=platform.python_version(),
        versions=", ".join(map(" ".join, library_versions().items())),
    )


def verdict_lines(found: Calibration) -> list[str]:
    """The verdict in a few lines, with what did not converge and what was not reported."""
    lines = [f"NOT calibrated: {failure}" for failure in found.failures]
    if len(found.ranks):
        inside = (found.rank_verdicts["verdict"] == "inside").sum()
        lines.append(
            f"The ranks of {inside} of {len(found.rank_verdicts)} rows are inside their bands. In "
            "a correct analysis, all rows are inside with a probability of "
            f"{100 * (1 - FALSE_ALARM):g} %."
        )
    for row in found.evidence_verdicts.itertuples():
        if row.estimator != DEFAULT:
            continue
        if np.isnan(row.error):
            lines.append(f"In the {row.design} design, the default estimator has no result.")
            continue
        lines.append(
            f"In the {row.design} design, the probabilities of H1 are "
            f"{row.verdict.replace('not', 'NOT')}. The calibration error is {row.error:.4f}, and "
            f"the limit is {row.floor + MARGIN:.4f}."
        )
    if len(found.ranks):
        missed = found.ranks["subject"][found.ranks["shortfall"] != ""]
        line = f"All {len(found.ranks)} analyses converged."
        if len(missed):
            line = f"These analyses did not converge: {', '.join(missed)}."
        lines.append(line)
    withheld = found.data_sets["data_set"][found.data_sets[DEFAULT].isna()]
    if len(withheld):
        lines.append(f"The default estimator reports no evidence for {', '.join(withheld)}.")
    return lines


def main() -> int:
    """Run the calibration and write its folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", default="calibration", help="folder")
    parser.add_argument(
        "--studies",
        type=int,
        default=1000,
        help="studies a design for the ranks; 0 leaves them out",
    )
    parser.add_argument(
        "--data-sets",
        type=int,
        default=2000,
        help="data sets a design for the evidence; 0 leaves it out",
    )
    parser.add_argument("--seed", type=int, help="without it fresh entropy, printed")
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    try:
        require_folder(
            options.output, PRODUCTS, overwrite=options.overwrite
        )  # before the work, not after it
        found = calibrate(
            studies=options.studies,
            data_sets=options.data_sets,
            seed=options.seed,
            workers=options.workers,
        )
        write_calibration(found, options.output, overwrite=options.overwrite)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    print("\n".join(verdict_lines(found)))
    print(f"seed {found.plan.seed}; results in {options.output}")
    return 3 if found.failures else 0


if __name__ == "__main__":
    sys.exit(main())
