"""What users wait for, now and at an earlier commit, against the bars that were set: a table.

User processor time, by the same interpreter, with one worker and one thread a library. Both trees
take turns; of several runs the least counts, because what else a machine does only adds. Commands
are whole processes; calls are timed without their imports. Reading is measured on 10,000 simulated
subjects, all else on the bundled studies.

The bars are those of the step from 48 models a subject (commit ac7c476) to the four models of the
observer. Example: python scripts/before_after.py ac7c476 -o before_after.csv
"""

import argparse
import compileall
import os
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from bayes_toe.design.study_design import reference_design

HERE = Path(__file__).resolve().parents[1]
COLUMNS = ["what", "before_s", "now_s", "ratio", "bar", "met"]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_SEEDED = "--seed 1 --workers 1 --overwrite"
#: A call; what it needs is imported before the clock starts.
_TIMED = """\
import time
import bayes_toe as bt
{imports}
study = bt.read_study({file!r})
began = time.process_time()
{call}
print(time.process_time() - began)
"""
_OLD_VERDICT = (
    "from bayes_toe.comparison.verdict import verdict\nfrom bayes_toe.model.prior import DEFAULT",
    "for subject in study: verdict(subject, DEFAULT.at(subject), 1)",
)
_NEW_ANSWER = (
    "from bayes_toe.answers.order_effect import answer_subject",
    "for subject in study: answer_subject(subject, 1)",
)
_RUN = ("", "bt.run(study, seed=1, workers=1)")
#: Fewer than six subjects at a time, so that no group is fitted.
_RUN_SUBJECTS = (
    "",
    "for i in range(0, 16, 4): bt.run(bt.Study(study.subjects[i : i + 4]), seed=1, workers=1)",
)


@dataclass(frozen=True)
class Bar:
    """What may be spent: seconds, or a ratio to the earlier commit.

    `before` and `now` are what is run in either tree: the words of a command, or code that prints
    its own processor time.
    """

    limit: float
    unit: str
    before: str
    now: str
    is_code: bool = False


def _command(words: str, limit: float, unit: str = "x") -> Bar:
    """The bar of a command."""
    return Bar(limit, unit, words, words)


def _call(file: str, limit: float, before: tuple[str, str], now: tuple[str, str]) -> Bar:
    """The bar of a call on one of the studies of :func:`write_studies`."""
    codes = [
        _TIMED.format(file=file, imports=imports, call=call) for imports, call in (before, now)
    ]
    return Bar(limit, "x", *codes, is_code=True)


BARS = {
    "help": _command("--help", 1.0, "s"),
    "check, 10,000 subjects": _command("check many.csv", 10.0, "s"),
    "answer of 16 subjects, same/different": _call("study.csv", 0.06, _OLD_VERDICT, _NEW_ANSWER),
    "answer of 12 subjects, 2AFC": _call("stronger.csv", 0.3, _OLD_VERDICT, _NEW_ANSWER),
    "bt.run of 16 subjects, four at a time": _call("study.csv", 0.35, _RUN_SUBJECTS, _RUN_SUBJECTS),
    "bt.run of 16 subjects": _call("study.csv", 0.35, _RUN, _RUN),
    "fit": _command(f"fit study.csv -o fit.csv {_SEEDED}", 1.15),
    "evidence": _command(f"evidence study.csv -o evidence.csv {_SEEDED}", 0.35),
    "population": Bar(
        1.15,
        "x",
        f"population study.csv -o population.nc {_SEEDED}",
        "population study.csv -o population.nc --seed 1 --overwrite",
    ),
    "sample": _command(f"sample study.csv -o posterior.nc --draws 10000 {_SEEDED}", 1.1),
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
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        tree = Path(folder, "tree")
        tree.mkdir()
        packed = subprocess.run(
            ["git", "-C", HERE, "archive", options.commit, "bayes_toe"], capture_output=True
        )
        if packed.returncode:
            parser.error(f"commit {options.commit!r}: {packed.stderr.decode().strip()}")
        subprocess.run(["tar", "-x", "-C", tree], input=packed.stdout, check=True)
        for root in (tree, HERE):
            compileall.compile_dir(root / "bayes_toe", quiet=1)
        write_studies(place)
        print(",".join(COLUMNS))
        for name in options.only:
            rows.append(measured(name, BARS[name], tree, place, options.repeats))
            print(*rows[-1], sep=",", flush=True)
    if options.output is not None:
        pd.DataFrame(rows, columns=COLUMNS).to_csv(options.output, index=False)


def measured(name: str, bar: Bar, tree: Path, place: Path, repeats: int) -> tuple[object, ...]:
    """The row of one bar."""
    runs = []
    for _ in range(repeats):
        before = seconds(tree, place, bar.before, bar.is_code)
        now = seconds(HERE, place, bar.now, bar.is_code)
        runs.append((before, now))
    before, now = np.min(runs, axis=0)
    spent = now if bar.unit == "s" else now / before
    return (
        name,
        round(before, 3),
        round(now, 3),
        round(now / before, 3),
        f"{bar.limit:g} {bar.unit}",
        "yes" if spent <= bar.limit else "no",
    )


def write_studies(folder: Path) -> None:
    """The bundled studies, and 10,000 subjects with 50 responses to each of the paper's pairs."""
    data = HERE / "bayes_toe" / "data"
    (folder / "study.csv").write_bytes((data / "example_same_different_study.csv").read_bytes())
    (folder / "stronger.csv").write_bytes((data / "example_study.csv").read_bytes())
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


def seconds(tree: Path, place: Path, text: str, is_code: bool) -> float:
    """User processor time of a command, or what code says of its own."""
    environment = {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": str(tree)}
    words = ["-c", text] if is_code else ["-m", "bayes_toe", *shlex.split(text)]
    before = os.times().children_user
    done = subprocess.run(
        [sys.executable, *words], cwd=place, env=environment, capture_output=True, text=True
    )
    if done.returncode not in (0, 3):  # 3: there is a result, and something to look at
        raise SystemExit(f"{text}: exit code {done.returncode}: {done.stderr}")
    if is_code:
        return float(done.stdout)
    return os.times().children_user - before


if __name__ == "__main__":
    main()
