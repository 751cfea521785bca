"""Whether posteriors and evidences are calibrated: simulate data of known origin, analyse them as usual, judge, write tables and figures.

Example: python scripts/calibration.py -o calibration --studies 1000 --data-sets 2000 --seed 1
Exit code 3 where something is not calibrated.
"""

import argparse
import platform
import sys
from pathlib import Path

from calibration_figures import differences_figure, ranks_figure, reliability_figure
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from reference.calibration import ABOUT, DEFAULT, DESIGNS, DRAWS, FALSE_ALARM, CalibrationTable, calibrate, calibration_settings
from reference.calibration_statistics import MARGIN

import bayes_toe as bt
from bayes_toe.cli.terminal import number
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_folder, whole_folder
from bayes_toe.version import library_versions

_OF_RANKS = ("calibration.csv", "calibration_ranks.csv", "calibration_ranks.png", "calibration_ranks.pdf")
_OF_EVIDENCE = (
    "evidence_calibration.csv",
    "evidence_data_sets.csv",
    *(f"evidence_{what}.{suffix}" for what in ("reliability", "differences") for suffix in ("png", "pdf")),
)
#: What the folder of a calibration may hold.
PRODUCTS = ("calibration.md", *_OF_RANKS, *_OF_EVIDENCE)


def write_calibration(table: CalibrationTable, folder: str | Path, *, overwrite: bool = False) -> None:
    """Write tables, figures (PNG and PDF) and calibration.md into `folder`, all or none."""
    required = ("calibration.md", *(_OF_RANKS if table.ranks else ()), *(_OF_EVIDENCE if table.evidence else ()))
    with whole_folder(folder, PRODUCTS, required=required, overwrite=overwrite) as target:
        (target / "calibration.md").write_text(_text(table) + "\n", encoding="utf-8")
        figures = {}
        if table.ranks:
            write_table(table.rank_frame(), target / "calibration.csv")
            write_table(table.subject_ranks_frame(), target / "calibration_ranks.csv")
            figures["calibration_ranks"] = ranks_figure(table)
        if table.evidence:
            write_table(table.evidence_frame(), target / "evidence_calibration.csv")
            write_table(table.data_sets_frame(), target / "evidence_data_sets.csv")
            figures |= {"evidence_reliability": reliability_figure(table), "evidence_differences": differences_figure(table)}
        for stem, figure in figures.items():
            for suffix in ("png", "pdf"):
                bt.plots.save_figure(figure, target / f"{stem}.{suffix}")


def _text(table: CalibrationTable) -> str:
    """calibration.md: verdict, tables, figures, how it was made."""
    environment = Environment(loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined, trim_blocks=True)
    environment.filters.update(number=number)
    return environment.get_template("calibration.md").render(
        table=table,
        plan=table.outcome.plan,
        verdict=verdict_lines(table),
        prior=calibration_settings(table.outcome.plan.seed).prior.describe(),
        designs=" and ".join(f"{name} ({batches} batches)" for name, batches in DESIGNS.items()),
        draws=DRAWS,
        about=ABOUT,
        default=DEFAULT,
        false_alarm=f"{FALSE_ALARM:g}",
        margin=f"{MARGIN:g}",
        python=platform.python_version(),
        versions=", ".join(map(" ".join, library_versions().items())),
    )


def verdict_lines(table: CalibrationTable) -> list[str]:
    """The verdict in a few lines: what failed, or that nothing did; what did not converge; what was withheld."""
    lines = [f"NOT calibrated: {failure}" for failure in table.failures]
    if table.ranks:
        inside = sum(row.inside for row in table.ranks)
        lines.append(f"ranks: {inside} of {len(table.ranks)} inside their bands (all of them with {100 * (1 - FALSE_ALARM):g} % if right)")
    for row in (row for row in table.evidence if row.estimator == DEFAULT):
        found = "the default estimator gives no number"
        if row.judged is not None:
            verdict = "calibrated" if row.calibrated else "NOT calibrated"
            found = f"{verdict}, ECE {row.judged.error:.4f}, floor {row.judged.floor:.4f}, allowed {MARGIN:g} more"
        lines.append(f"evidence, {row.design} design: {found}")
    if table.ranks:
        missed = table.not_converged
        named = f": {', '.join(missed)}" if missed else ""
        lines.append(f"not converged, ranked with the others: {len(missed)} of {len(table.outcome.ranks)} studies{named}")
    if table.withheld:
        lines.append(f"evidence withheld by the default estimator: {', '.join(table.withheld)}")
    return lines


def main() -> int:
    """Run the calibration and write its folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", default="calibration", help="folder")
    parser.add_argument("--studies", type=int, default=1000, help="studies a design for the ranks; 0 leaves them out")
    parser.add_argument("--data-sets", type=int, default=2000, help="data sets a design for the evidence; 0 leaves it out")
    parser.add_argument("--seed", type=int, help="without it fresh entropy, printed")
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    try:
        require_folder(options.output, PRODUCTS, overwrite=options.overwrite)  # before the work, not after it
        table = calibrate(studies=options.studies, data_sets=options.data_sets, seed=options.seed, workers=options.workers)
        write_calibration(table, options.output, overwrite=options.overwrite)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    print("\n".join(verdict_lines(table)))
    print(f"seed {table.outcome.plan.seed}; results in {options.output}")
    return 0 if table.passed else 3


if __name__ == "__main__":
    sys.exit(main())
