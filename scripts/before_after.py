"""What every command costs now and at an earlier commit, against the bars that were set: a table, printed and written.

User processor time of whole processes, by the same interpreter, with one worker and one thread a library. Both trees take turns; of several
runs the least counts, because what else a machine does only adds. Reading is measured on 10,000 simulated subjects, all else on the bundled
study. Example: python scripts/before_after.py 869a979 -o before_after.csv
"""

import argparse
import compileall
import os
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from bayes_toe.experiments.simulate import reference_design

HERE = Path(__file__).resolve().parents[1]
COLUMNS = ["what", "before_s", "now_s", "ratio", "bar", "met"]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_SEEDED = "--seed 1 --workers 1 --overwrite"
#: By name: the command, and what it may cost, as a ratio to the earlier commit or in seconds.
BARS = {
    "help": ("--help", 1.0, "s"),
    "check, 10,000 subjects": ("check many.csv", 10.0, "s"),
    "asymmetry, 10,000 subjects": ("asymmetry many.csv -o asymmetry.csv --overwrite", 10.0, "s"),
    "fit": (f"fit study.csv -o fit.csv {_SEEDED}", 1.15, "x"),
    "evidence": (f"evidence study.csv -o evidence.csv {_SEEDED}", 1.15, "x"),
    "population": (f"population study.csv -o population.nc {_SEEDED}", 1.15, "x"),
    "sample": (f"sample study.csv -o posterior.nc --draws 10000 {_SEEDED}", 1.5, "x"),
    "run": (f"run study.csv -o results {_SEEDED}", 1.8, "x"),
}


def main() -> None:
    """Measure; each row is printed as soon as it is known."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("commit", help="what to compare with")
    parser.add_argument("-o", "--output", type=Path, help="table to write")
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="NAME",
        choices=BARS,
        default=list(BARS),
        help="of: " + "; ".join(BARS),
    )
    parser.add_argument(
        "--repeats", type=int, default=3, help="runs of either tree, of which the least counts"
    )
    asked = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        tree, place = Path(folder, "tree"), Path(folder)
        tree.mkdir()
        packed = subprocess.run(
            ["git", "-C", HERE, "archive", asked.commit, "bayes_toe"], capture_output=True
        )
        if packed.returncode:
            parser.error(f"commit {asked.commit!r}: {packed.stderr.decode().strip()}")
        subprocess.run(["tar", "-x", "-C", tree], input=packed.stdout, check=True)
        for one in (tree, HERE):
            compileall.compile_dir(one / "bayes_toe", quiet=1)
        write_studies(place)
        print(",".join(COLUMNS))
        for name in asked.only:
            words, bar, unit = BARS[name]
            runs = [
                [seconds(one, place, words) for one in (tree, HERE)] for _ in range(asked.repeats)
            ]
            before, now = np.min(runs, axis=0)
            met = (now if unit == "s" else now / before) <= bar
            rows.append(
                (
                    name,
                    round(before, 3),
                    round(now, 3),
                    round(now / before, 3),
                    f"{bar:g} {unit}",
                    "yes" if met else "no",
                )
            )
            print(*rows[-1], sep=",", flush=True)
    if asked.output is not None:
        pd.DataFrame(rows, columns=COLUMNS).to_csv(asked.output, index=False)


def write_studies(folder: Path) -> None:
    """The bundled study, and one of 10,000 subjects who answer the paper's pairs 50 times each."""
    (folder / "study.csv").write_bytes(
        (HERE / "bayes_toe" / "data" / "example_study.csv").read_bytes()
    )
    design, rng, subjects = reference_design(), np.random.default_rng(1), 10_000
    pairs = len(design.s1)
    frame = {
        "subject": np.repeat([f"S{i:05d}" for i in range(subjects)], pairs),
        "s1": np.tile(design.s1, subjects),
    }
    frame |= {
        "s2": np.tile(design.s2, subjects),
        "n_equal": rng.binomial(50, rng.uniform(size=subjects * pairs)),
        "n_trials": 50,
    }
    pd.DataFrame(frame).to_csv(folder / "many.csv", index=False)


def seconds(tree: Path, place: Path, words: str) -> float:
    """User processor time of a command."""
    environment = {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": str(tree)}
    before = os.times().children_user
    done = subprocess.run(
        [sys.executable, "-m", "bayes_toe", *shlex.split(words)],
        cwd=place,
        env=environment,
        capture_output=True,
        text=True,
    )
    if done.returncode not in (0, 3):  # 3: there is a result, and something to look at
        raise SystemExit(f"{words}: exit code {done.returncode}: {done.stderr}")
    return os.times().children_user - before


if __name__ == "__main__":
    main()
