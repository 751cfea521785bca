"""Compare every command's tables on a study with those of an earlier commit.

Differences must be within Monte Carlo error.

Three words: `run` makes the tables, a folder a study and seed; `freeze` takes centre and tolerance
of every number; `check` says what lies outside, exit code 3 where that is more than chance.

    STUDY=bundled=bayes_toe/data/example_same_different_study.csv
    python scripts/frozen.py run made --study $STUDY --seeds 1 2 3
    python scripts/frozen.py freeze made tests/reference/frozen.csv.gz
    python scripts/frozen.py check made tests/reference/frozen.csv.gz

A number's tolerance is six times the root sum of squares of its standard deviation over the seeds,
the median one of its column, and the Monte Carlo error that its own table states; and a millionth,
of a probability that depends on the seed 0.002. Up to one number in a thousand may lie outside,
none by more than three tolerances.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

#: Under which all was made: H1's is the paper's, nothing depends on the unit of intensity.
PRIOR = "[paper]\nlapse_rate_b = 1.0\n"
#: By command: its words, and of every table it writes what names a row.
COMMANDS: dict[str, tuple[tuple[str, ...], dict[str, tuple[str, ...]]]] = {
    "run": (
        ("-o", "results", "--figures", "none", "--prior", "prior.toml"),
        {"results/evidence.csv": ("subject",), "results/summary.csv": ("subject", "parameter")},
    ),
    "fit": (
        (
            *("-o", "fit.csv", "--prior", "prior.toml", "--asymmetry", "asymmetry.csv"),
            *("--replicates", "1000"),
        ),
        {"fit.csv": ("subject",), "asymmetry.csv": ("subject", "s_weak", "s_strong")},
    ),
}
#: Numbers that say how well others are known, or are not numbers of the study.
LEFT_OUT = ("ess_bulk", "ess_tail", "r_hat", "pareto_k", "p_worst_pair", "is_maximal")
_KEY = ["study", "table", "row", "column"]


def main() -> int:
    """Run, freeze or check."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("run", "freeze", "check"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("table", type=Path, nargs="?", help="of frozen numbers")
    parser.add_argument(
        "--study", action="append", default=[], help="NAME=FILE.csv; repeat for more"
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    options = parser.parse_args()
    if options.what == "run":
        for name, file in (study.split("=", 1) for study in options.study):
            for seed in options.seeds:
                run(options.folder / f"{name}-{seed}", Path(file).resolve(), seed)
        return 0
    if options.what == "freeze":
        frozen(options.folder).to_csv(options.table, index=False, float_format="%.9g")
        return 0
    numbers, outside = check(
        options.folder, pd.read_csv(options.table, keep_default_na=False, na_values=[""])
    )
    print(f"{numbers} numbers held against {options.table}; {len(outside)} outside")
    print(outside.to_string(index=False) if len(outside) else "")
    return 3 if too_far(numbers, outside) else 0


def run(
    folder: Path,
    study: Path,
    seed: int,
    commands: Sequence[str] = tuple(COMMANDS),
) -> None:
    """All commands on one study."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "prior.toml").write_text(PRIOR, encoding="utf-8")
    for command in commands:
        seeded = ["--seed", str(seed), "--workers", "1"]
        words = [command, str(study), *COMMANDS[command][0], *seeded, "--overwrite"]
        done = call(*words, cwd=folder)
        if done.returncode not in (0, 3):
            raise SystemExit(f"{' '.join(words)}: exit code {done.returncode}: {done.stderr}")


def call(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A command, as a user calls it."""
    return subprocess.run(
        [sys.executable, "-m", "bayes_toe", *words], cwd=cwd, capture_output=True, text=True
    )


def _numbers(folder: Path) -> Iterator[pd.DataFrame]:
    """Every number of the tables in a folder, by study, seed, table, row and column."""
    tables = {table: key for _, written in COMMANDS.values() for table, key in written.items()}
    for place in sorted(path for path in folder.iterdir() if path.is_dir()):
        study, seed = place.name.rsplit("-", 1)
        for table, key in tables.items():
            if not (place / table).exists():
                continue
            wide = pd.read_csv(
                place / table,
                dtype=dict.fromkeys(key, str),
                keep_default_na=False,
                na_values=["", "nan", "NaN"],
            )
            row = wide[list(key)].fillna("").agg(" / ".join, axis=1)
            values = wide.select_dtypes("number").drop(columns=[*LEFT_OUT], errors="ignore")
            errors = {
                name: values.get(f"mcse_{name}", values.get(f"{name}_se", 0.0 * values[name]))
                for name in values.columns
            }
            for name in values.columns:
                if not name.startswith("mcse_") and not (
                    name.endswith("_se") and table != "asymmetry.csv"
                ):
                    mc = 0.0 if table == "asymmetry.csv" else errors[name].fillna(0.0)
                    yield pd.DataFrame(
                        {
                            "study": study,
                            "seed": seed,
                            "table": table,
                            "row": row,
                            "column": name,
                            "value": values[name],
                            "error": mc,
                        }
                    )


def frozen(folder: Path) -> pd.DataFrame:
    """Centre and tolerance of every number over the seeds."""
    every = pd.concat(_numbers(folder), ignore_index=True).dropna(subset=["value"])
    found = (
        every.groupby(_KEY, sort=False)
        .agg(centre=("value", "mean"), sd=("value", "std"), error=("error", "mean"))
        .reset_index()
    )
    found["sd"] = found["sd"].fillna(0.0)
    kind = (
        found["row"]
        .where(found["table"].str.contains("summary"), "")
        .str.rsplit(" / ", n=1)
        .str[-1]
    )  # a quantity's own scale
    typical = found.groupby([found["study"], found["table"], found["column"], kind], sort=False)[
        "sd"
    ].transform("median")
    spread = np.sqrt(found["sd"] ** 2 + typical**2 + found["error"] ** 2)
    probability = found["column"].str.contains("prob") | found["column"].str.startswith("p_")
    least = np.where(probability & (spread > 0.0), 2e-3, 0.0) + 1e-6 * (1.0 + found["centre"].abs())
    return found[_KEY].assign(centre=found["centre"], tolerance=6.0 * spread + least)


def check(folder: Path, table: pd.DataFrame) -> tuple[int, pd.DataFrame]:
    """The number of compared numbers, and those outside with their distances, the worst first."""
    every = pd.concat(_numbers(folder), ignore_index=True).fillna({"row": ""})
    merged = every.merge(table.fillna({"row": ""}), on=_KEY, how="inner")
    merged["distance"] = (merged["value"] - merged["centre"]).abs() / merged["tolerance"]
    outside = merged[~(merged["distance"] <= 1.0)].sort_values("distance", ascending=False)
    return len(merged), outside[[*_KEY, "seed", "value", "centre", "tolerance", "distance"]]


def too_far(numbers: int, outside: pd.DataFrame) -> bool:
    """Whether more lies outside than chance explains."""
    return len(outside) > numbers / 1000 or not (outside["distance"] <= 3.0).all()


if __name__ == "__main__":
    sys.exit(main())
