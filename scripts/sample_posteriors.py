"""Sample every subject's posterior, save the draws and print a summary.

Example: python scripts/sample_posteriors.py study.csv -o posterior.nc --draws 4000 --seed 1
"""

import argparse
from pathlib import Path

import bayes_toe as bt

if __name__ == "__main__":  # worker processes import this file
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "study",
        nargs="?",
        help="CSV of trials or counts; by default the bundled, synthetic example",
    )
    parser.add_argument("-o", "--output", type=Path, default="posterior.nc")
    parser.add_argument(
        "--draws", type=int, default=4000, help="effective draws to reach for every parameter"
    )
    parser.add_argument("--seed", type=int, help="without it fresh entropy, printed and stored")
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    asked = parser.parse_args()
    if asked.output.exists():
        parser.error(f"{asked.output}: exists")  # before the work, not after it

    study = bt.example_study() if asked.study is None else bt.read_study(asked.study)
    draws = bt.sample(
        study, draws=asked.draws, seed=asked.seed, workers=asked.workers
    )  # warns of who did not converge
    draws.save(asked.output)
    print(draws.summary().round(3).to_string(index=False))
    print(f"{study.source}: seed {draws.attrs['seed']}; draws in {asked.output}")
