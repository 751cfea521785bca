"""Race every method over the same subjects: time, effective draws, error against the reference; CSV, Markdown and figures.

The methods and their efforts are in speed/methods.py, the subjects in speed/cases.py. Other libraries take part where they are
installed: pip install -e ".[peers]". Example: python scripts/speed_vs_error.py -o docs --seed 1 --overwrite
"""

import argparse
import sys
import time
from pathlib import Path

from speed import machine

# Before numpy and the other libraries are imported: they read it once.
THREADS = machine.one_thread()

from reference.hard_cases import hard_cases  # noqa: E402
from speed import figure, markdown, ratios  # noqa: E402
from speed.apart import rows_of  # noqa: E402
from speed.cases import ORDINARY, Case, chosen_cases  # noqa: E402
from speed.race import OK, Rules, warm_up  # noqa: E402
from speed.scaling import scaling  # noqa: E402
from speed.table import Row, frame  # noqa: E402

from bayes_toe.data.example import example_study  # noqa: E402
from bayes_toe.data.tables import write_table  # noqa: E402
from bayes_toe.data.whole_files import require_writable, whole_file  # noqa: E402
from bayes_toe.errors import BayesToeError, InputError  # noqa: E402

SUBJECTS = ("S01", "S05", "S09", "S15")
PEER_HARD_CASES = ("funnel", "perfect observer", "one batch")
FILES = ("speed_vs_error.csv", "speed_vs_error.md", "speed_vs_error.png", "speed_vs_error.svg")
FILES += ("speed_scaling.csv", "speed_scaling.png", "speed_scaling.svg")
ALL, NONE = "all", "none"


def main() -> int:
    """Parse, refuse early, race, write."""
    options = _parser().parse_args()
    try:
        for name in FILES:
            require_writable(options.output / name, overwrite=options.overwrite)
        _run(options)
    except BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to write to; the committed run is in docs")
    parser.add_argument("--overwrite", action="store_true", help="replace earlier files of this program there")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--subjects", default=",".join(SUBJECTS), help="bundled subjects, separated by commas")
    parser.add_argument("--all", action="store_true", help="all 16 bundled subjects")
    parser.add_argument("--hard-cases", default=ALL, help="hard cases, separated by commas; all or none")
    parser.add_argument("--peer-hard-cases", default=",".join(PEER_HARD_CASES), help="hard cases that other libraries run on; all or none")
    parser.add_argument("--no-peers", action="store_true", help="other libraries do not take part")
    parser.add_argument("--shrink", type=int, default=1, help="divide every effort by this: for a quick look")
    parser.add_argument("--most-runs", type=int, default=100, help="upper limit on the runs of every method")
    return parser


def _run(options: argparse.Namespace) -> None:
    began = time.perf_counter()
    ordinary = example_study().names if options.all else _names(options.subjects)
    cases, missing = chosen_cases(ordinary, None if options.hard_cases == ALL else _names(options.hard_cases))
    rules = Rules(options.seed, not options.no_peers, _peer_cases(options.peer_hard_cases, cases), options.shrink, options.most_runs)
    rows = [row for case in cases for row in _told(case, rules)]
    warm_up()
    sizes = scaling(rules.seed, runs=min(5, rules.most_runs), shrink=rules.shrink)
    minutes = (time.perf_counter() - began) / 60.0
    table = frame(rows)
    report = markdown.Report(table, sizes, rules, _command(options), machine.processor(), THREADS, machine.versions(), missing, minutes)
    _write(report, options.output, overwrite=options.overwrite)
    _print_ratios(report)


def _command(options: argparse.Namespace) -> str:
    """What remakes the output; of the folder its name only."""
    given = [word for word in sys.argv[1:] if word not in ("--overwrite", "-o", "--output", str(options.output))]
    return " ".join(["python scripts/speed_vs_error.py -o", options.output.name, *(_quoted(word) for word in given), "--overwrite"])


def _names(text: str) -> list[str]:
    return [] if text == NONE else [name.strip() for name in text.split(",")]


def _peer_cases(text: str, cases: list[Case]) -> tuple[str, ...]:
    if text == ALL:
        return tuple(case.name for case in cases)
    unknown = [name for name in _names(text) if name not in hard_cases()]
    if unknown:
        raise InputError(f"--peer-hard-cases: no hard case {unknown[0]!r}; there are: {', '.join(hard_cases())}")
    return tuple(_names(text))


def _quoted(word: str) -> str:
    return f'"{word}"' if " " in word else word


def _told(case: Case, rules: Rules) -> list[Row]:
    """One line a subject, so that somebody who waits sees it go on."""
    began = time.perf_counter()
    rows = rows_of(case, rules)
    bad = sum(row["status"] != OK for row in rows)
    print(f"{case.kind} {case.name}: {len(rows)} rows, {bad} without a full result, {time.perf_counter() - began:.0f} s", flush=True)
    return rows


def _write(report: markdown.Report, folder: Path, *, overwrite: bool) -> None:
    """Everything is made before anything is written."""
    words = markdown.text(report)
    pictures = {"speed_vs_error": figure.race_figure(report.table), "speed_scaling": figure.scaling_figure(report.sizes)}
    write_table(report.table, folder / "speed_vs_error.csv", overwrite=overwrite)
    write_table(report.sizes, folder / "speed_scaling.csv", overwrite=overwrite)
    for stem, picture in pictures.items():
        for suffix in (".png", ".svg"):
            figure.save(picture, folder / f"{stem}{suffix}", overwrite=overwrite)
    with whole_file(folder / "speed_vs_error.md", overwrite=overwrite) as target:
        target.write_text(words, encoding="utf-8")


def _print_ratios(report: markdown.Report) -> None:
    for ratio in ratios.ratios(report.table, ORDINARY, ratios.HEADLINE // report.rules.shrink):
        if ratio.subjects and (ratio.by != "spread" or ratio.bar is not None):
            bar = "" if ratio.bar is None else f" (asked {ratio.bar:g}: {ratio.verdict})"
            print(f"global move over {ratio.rival}, {ratio.by} ESS/s: {ratio.median:.1f}x, worst {ratio.worst:.1f}x{bar}")


if __name__ == "__main__":
    sys.exit(main())
