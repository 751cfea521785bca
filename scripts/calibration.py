"""Whether posteriors and evidences are calibrated: simulate data of known origin, analyse them as usual, judge, write tables and figures.

Example: python scripts/calibration.py -o calibration --studies 1000 --data-sets 2000 --seed 1
Exit code 3 where something is not calibrated.
"""

import argparse
import sys

import bayes_toe as bt
from bayes_toe.cli.synthetic import PRODUCTS, verdict_lines, write_calibration
from bayes_toe.data.whole_files import require_folder


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
        table = bt.calibrate(studies=options.studies, data_sets=options.data_sets, seed=options.seed, workers=options.workers)
        write_calibration(table, options.output, overwrite=options.overwrite)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    print("\n".join(verdict_lines(table)))
    print(f"seed {table.outcome.plan.seed}; results in {options.output}")
    return 0 if table.passed else 3


if __name__ == "__main__":
    sys.exit(main())
