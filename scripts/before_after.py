"""What every command costs now and at an earlier commit, against the bars that were set: a table, printed and written.

User processor time of whole processes, by the same interpreter, with one worker and one thread a library. Both trees take turns; of several
runs the least counts, because what else a machine does only adds. Reading is measured on 10,000 simulated subjects, all else on the bundled
study. Example: python scripts/before_after.py 869a979 -o docs/before_after.csv --overwrite
"""

from __future__ import annotations

import argparse
import compileall
import io
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_writable
from bayes_toe.errors import BayesToeError, InputError
from bayes_toe.experiments.simulate import reference_design

HERE = Path(__file__).resolve().parents[1]
COLUMNS = ("what", "before_s", "now_s", "ratio", "bar", "met")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_SEEDED = ("--seed", "1", "--workers", "1")
#: By name: the command, and what it may cost, as a ratio to the earlier commit or in seconds.
BARS: dict[str, tuple[tuple[str, ...], float, str]] = {
    "help": (("--help",), 1.0, "s"),
    "check, 10,000 subjects": (("check", "many.csv"), 10.0, "s"),
    "asymmetry, 10,000 subjects": (("asymmetry", "many.csv", "-o", "asymmetry.csv"), 10.0, "s"),
    "fit": (("fit", "study.csv", "-o", "fit.csv", *_SEEDED), 1.15, "x"),
    "evidence": (("evidence", "study.csv", "-o", "evidence.csv", *_SEEDED), 1.15, "x"),
    "compare": (("compare", "study.csv", "-o", "compare.csv", *_SEEDED), 1.15, "x"),
    "population": (("population", "study.csv", "-o", "population.nc", *_SEEDED), 1.15, "x"),
    "sample": (("sample", "study.csv", "-o", "posterior.nc", "--draws", "10000", *_SEEDED), 1.5, "x"),
    "run": (("run", "study.csv", "-o", "results", *_SEEDED), 1.8, "x"),
}


def main() -> int:
    """Parse, refuse early, measure, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit", help="what to compare with")
    parser.add_argument("-o", "--output", type=Path, help="table to write; the committed one is docs/before_after.csv")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier one")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=BARS, default=list(BARS), help="of: " + "; ".join(BARS))
    parser.add_argument("--repeats", type=int, default=3, help="runs of either tree, of which the least counts")
    options = parser.parse_args()
    try:
        if options.output is not None:
            require_writable(options.output, overwrite=options.overwrite)
        table = measured(options.commit, options.only, options.repeats)
        if options.output is not None:
            write_table(table, options.output, overwrite=options.overwrite)
    except BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def measured(commit: str, names: list[str], repeats: int) -> pd.DataFrame:
    """The table; each row is printed as soon as it is known."""
    with tempfile.TemporaryDirectory() as folder:
        place, rows = Path(folder), []
        trees = (_tree_of(commit, place / "tree"), HERE)
        _write_studies(place)
        print(",".join(COLUMNS))
        for name in names:
            words, bar, unit = BARS[name]
            runs = [[_seconds(tree, place, words) for tree in trees] for _ in range(repeats)]
            before, now = (min(times) for times in zip(*runs, strict=True))
            met = (now if unit == "s" else now / before) <= bar
            rows.append((name, round(before, 3), round(now, 3), round(now / before, 3), f"{bar:g} {unit}", "yes" if met else "no"))
            print(",".join(map(str, rows[-1])), flush=True)
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _tree_of(commit: str, folder: Path) -> Path:
    """The package as it was at a commit."""
    words = ["git", "-C", str(HERE), "archive", f"{commit}^{{commit}}", "bayes_toe"]
    try:
        packed = subprocess.run(words, check=True, capture_output=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        said = getattr(error, "stderr", None) or str(error).encode()
        raise InputError(f"commit {commit!r}: {said.decode().strip()}") from error
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        archive.extractall(folder, filter="data")
    for tree in (folder, HERE):
        compileall.compile_dir(tree / "bayes_toe", quiet=1)
    return folder


def _write_studies(folder: Path) -> None:
    """The bundled study, and one of 10,000 subjects who answer the paper's pairs 50 times each."""
    bundled = HERE / "bayes_toe" / "data" / "example_study.csv"
    (folder / "study.csv").write_bytes(bundled.read_bytes())
    design, rng, subjects = reference_design(), np.random.default_rng(1), 10_000
    pairs = len(design.s1)
    frame = {"subject": np.repeat([f"S{i:05d}" for i in range(subjects)], pairs), "s1": np.tile(design.s1, subjects)}
    frame |= {"s2": np.tile(design.s2, subjects), "n_equal": rng.binomial(50, rng.uniform(size=subjects * pairs)), "n_trials": 50}
    pd.DataFrame(frame).to_csv(folder / "many.csv", index=False)


def _seconds(tree: Path, place: Path, words: tuple[str, ...]) -> float:
    """User processor time of a command in a fresh folder."""
    environment = {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": str(tree)}
    with tempfile.TemporaryDirectory(dir=place) as folder, tempfile.TemporaryFile() as printed:
        given = [sys.executable, "-m", "bayes_toe", *(f"../{word}" if word in {"study.csv", "many.csv"} else word for word in words)]
        running = subprocess.Popen(given, cwd=folder, env=environment, stdout=printed, stderr=subprocess.STDOUT)
        _, status, used = os.wait4(running.pid, 0)
        running.returncode = os.waitstatus_to_exitcode(status)
        printed.seek(0)
        if running.returncode not in (0, 3):  # 3: there is a result, and something to look at
            raise InputError(f"{' '.join(words)}: exit code {running.returncode}: {printed.read().decode().strip()}")
    return used.ru_utime


if __name__ == "__main__":
    sys.exit(main())
