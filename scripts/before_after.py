"""What every command costs now and at an earlier commit, against the bars that were set: a table, printed and written.

User processor time of whole processes, by the same interpreter, with one worker and one thread a library, on the bundled study. Both
trees take turns; of several runs the least counts, because what else a machine does only adds. Effective draws a second against other
samplers are in speed_vs_error.py. Example: python scripts/before_after.py a3b95d4 -o docs/before_after.csv --overwrite
"""

from __future__ import annotations

import argparse
import compileall
import io
import os
import pty
import signal
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from speed.machine import THREADS

from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_writable
from bayes_toe.errors import BayesToeError, InputError

HERE = Path(__file__).resolve().parents[1]
STUDY, ONE = "study.csv", "one_subject.csv"
COLUMNS = ("what", "unit", "before", "now", "ratio", "bar", "met")
_SAMPLE = ("sample", STUDY, "-o", "posterior.nc", "--draws", "10000", "--seed", "1", "--workers", "1")
_SUBJECTS = 16


@dataclass(frozen=True)
class Place:
    """One of the two trees, and the folder in which its commands run."""

    tree: Path
    folder: Path

    @property
    def environment(self) -> dict[str, str]:
        """Its package first, one thread."""
        return {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": str(self.tree), "TERM": "xterm"}


@dataclass(frozen=True)
class Bar:
    """What is measured, and what it is held against.

    Attributes
    ----------
    measure : callable
        From a place to a number.
    unit : str
    faster : float or None
        How many times less it has to be.
    below, above : float or None
        What it has to be below, or at least.
    """

    measure: Callable[[Place], float]
    unit: str = "s"
    faster: float | None = None
    below: float | None = None
    above: float | None = None

    def row(self, name: str, before: float, now: float) -> tuple[object, ...]:
        """The row of the table; the ratio is above 1 where it is better now."""
        better = now / before if self.above is not None else before / now
        if self.faster is not None:
            said, met = f"{self.faster:g}x less", better >= self.faster
        elif self.below is not None:
            said, met = f"below {self.below:g} {self.unit}", now < self.below
        else:
            said, met = f"at least {self.above:g}", self.above is not None and now >= self.above
        return name, self.unit, before, now, better, said, "yes" if met else "no"


def whole_process(*words: str, earlier: tuple[str, ...] | None = None) -> Callable[[Place], float]:
    """User CPU seconds of a command from start to end; `earlier` are its words at a commit that refuses these."""

    def measure(place: Place) -> float:
        try:
            return _ended(place, "-m", "bayes_toe", *words)[0]
        except InputError:
            if earlier is None:
                raise
            return _ended(place, "-m", "bayes_toe", *earlier)[0]

    return measure


def each_subject(place: Place) -> float:
    """User CPU seconds that a further subject costs `sample`."""
    one = tuple(ONE if word == STUDY else word for word in _SAMPLE)
    return (whole_process(*_SAMPLE)(place) - whole_process(*one)(place)) / (_SUBJECTS - 1)


def first_progress(place: Place) -> float:
    """User CPU seconds of `sample` until its progress bar is on the terminal."""
    ours, theirs = pty.openpty()
    with tempfile.TemporaryDirectory(dir=place.folder) as folder:
        words = [sys.executable, "-m", "bayes_toe", *(f"../{word}" if word == STUDY else word for word in _SAMPLE)]
        running = subprocess.Popen(
            words, cwd=folder, env=place.environment, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True
        )
        os.close(theirs)
        shown = b""
        try:
            while b"sampling" not in shown and (more := os.read(ours, 4096)):
                shown += more
        except OSError:
            raise InputError(f"sample: ended without a progress bar: {shown.decode()}") from None
        finally:
            running.send_signal(signal.SIGKILL)
            used = os.wait4(running.pid, 0)[2].ru_utime
            running.returncode = -signal.SIGKILL
            os.close(ours)
    return used


def effective_draws(place: Place) -> float:
    """Effective draws for each likelihood evaluation."""
    return float(_ended(place, "-P", str(HERE / "scripts" / "speed" / "evaluations.py"), STUDY)[1].splitlines()[-1])


#: The bars of the table, by what they are about.
BARS: Mapping[str, Bar] = {
    "help": Bar(whole_process("--help"), below=0.5),
    "check": Bar(whole_process("check", STUDY), below=0.5),
    "first draw of the progress bar": Bar(first_progress, below=0.5),
    "sample, a subject": Bar(each_subject, faster=3.0),
    "sample": Bar(whole_process(*_SAMPLE), faster=3.0),
    "run": Bar(whole_process("run", STUDY, "-o", "results", "--seed", "1", "--workers", "1"), faster=3.0),
    "evidence": Bar(whole_process("evidence", STUDY, "-o", "evidence.csv", "--seed", "1", "--workers", "1"), faster=3.0),
    "compare": Bar(
        whole_process(
            *(compare := ("compare", STUDY, "-o", "compare.csv", "--seed", "1", "--workers", "1")), "--space", "ladder", earlier=compare
        ),
        faster=2.5,
    ),
    "calibrate": Bar(
        whole_process("calibrate", "-o", "c", "--studies", "200", "--data-sets", "200", "--seed", "1", "--workers", "1"), faster=2.5
    ),
    "effective draws an evaluation": Bar(effective_draws, unit="1", above=0.4),
}


def main() -> int:
    """Parse, refuse early, measure, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit", help="what to compare with")
    parser.add_argument("-o", "--output", type=Path, help="table to write; the committed one is docs/before_after.csv")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier one")
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=BARS, default=list(BARS), help="of: " + ", ".join(BARS))
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
        earlier = _tree_of(commit, Path(folder, "tree"))
        places = [_place(tree, Path(folder, name)) for tree, name in ((earlier, "before"), (HERE, "now"))]
        print(",".join(COLUMNS))
        rows = []
        for name in names:
            runs = [[BARS[name].measure(place) for place in places] for _ in range(repeats)]
            least = max if BARS[name].above is not None else min
            rows.append(BARS[name].row(name, *map(least, zip(*runs, strict=True))))
            print(",".join(f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in rows[-1]), flush=True)
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _tree_of(commit: str, folder: Path) -> Path:
    """The package as it was at a commit."""
    try:
        words = ["git", "-C", str(HERE), "archive", f"{commit}^{{commit}}", "bayes_toe"]
        packed = subprocess.run(words, check=True, capture_output=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        said = getattr(error, "stderr", None) or str(error).encode()
        raise InputError(f"commit {commit!r}: {said.decode().strip()}") from error
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        archive.extractall(folder, filter="data")
    return folder


def _place(tree: Path, folder: Path) -> Place:
    """A folder with the study, and the same with its first subject alone; modules are compiled before anything is measured."""
    compileall.compile_dir(tree / "bayes_toe", quiet=1)
    lines = (HERE / "bayes_toe" / "data" / "example_study.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    start = next(i for i, line in enumerate(lines) if not line.startswith("#")) + 1
    folder.mkdir()
    (folder / STUDY).write_text("".join(lines), encoding="utf-8")
    first = [line for line in lines[start:] if line.split(",")[0] == lines[start].split(",")[0]]
    (folder / ONE).write_text("".join([*lines[:start], *first]), encoding="utf-8")
    return Place(tree, folder)


def _ended(place: Place, *words: str) -> tuple[float, str]:
    """User CPU seconds of a process of this interpreter, in a folder of its own, and what it printed."""
    with tempfile.TemporaryDirectory(dir=place.folder) as folder:
        given = [sys.executable, *(f"../{word}" if word in (STUDY, ONE) else word for word in words)]
        with tempfile.TemporaryFile() as printed:
            running = subprocess.Popen(given, cwd=folder, env=place.environment, stdout=printed, stderr=subprocess.STDOUT)
            _, status, used = os.wait4(running.pid, 0)
            running.returncode = os.waitstatus_to_exitcode(status)
            printed.seek(0)
            said = printed.read().decode()
    if running.returncode not in (0, 3):  # 3: there is a result, and something to look at
        raise InputError(f"{' '.join(words)}: exit code {running.returncode}: {said.strip()}")
    return used.ru_utime, said


if __name__ == "__main__":
    sys.exit(main())
