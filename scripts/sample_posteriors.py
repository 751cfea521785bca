"""Sample every subject's posterior, save the draws and print a summary.

Example: python scripts/sample_posteriors.py study.csv -o posterior.nc --draws 4000 --seed 1
Without a study the bundled (synthetic) example is sampled.
"""

import argparse
import sys
import warnings

import bayes_toe as bt
from bayes_toe.data.whole_files import require_writable


def main() -> int:
    """Read, sample, save, summarise; exit code 3 where a subject's draws did not converge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", nargs="?", help="CSV of trials or counts")
    parser.add_argument("-o", "--output", default="posterior.nc")
    parser.add_argument("--draws", type=int, default=4000, help="effective draws to reach for every parameter")
    parser.add_argument("--seed", type=int, help="without it fresh entropy, printed and stored")
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    warnings.simplefilter("ignore", bt.ConvergenceWarning)  # said below, a line for each subject
    try:
        require_writable(options.output, overwrite=options.overwrite)  # before the work, not after it
        study = bt.example_study() if options.study is None else bt.read_study(options.study)
        draws = bt.sample(study, draws=options.draws, seed=options.seed, workers=options.workers)
        draws.save(options.output, overwrite=options.overwrite)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    print(draws.summary().round(3).to_string(index=False))
    for name, shortfall in draws.not_converged.items():
        print(f"{name} did not converge: {shortfall}", file=sys.stderr)
    print(f"{study.source}: seed {draws.attrs['seed']}; draws in {options.output}")
    return 3 if draws.not_converged else 0


if __name__ == "__main__":
    sys.exit(main())
