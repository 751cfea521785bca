"""Samplers side by side on the hierarchical posterior of one study: time, effective draws, divergences, and the numbers they find.

The model is in population_target.py, the samplers are in population_samplers.py: pip install -e ".[peers]". Example:
python scripts/speed/population.py STUDY.csv --method numpyro --method nutpie -o out.csv --json numbers
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])  # not this folder: its files are not top-level modules
from speed import machine

CORES = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
THREADS = machine.one_thread()  # before numpy and the other libraries are imported: they read it once

import numpy as np  # noqa: E402

import bayes_toe as bt  # noqa: E402
from bayes_toe.data.tables import write_table  # noqa: E402
from bayes_toe.data.whole_files import require_writable, whole_file  # noqa: E402
from bayes_toe.errors import BayesToeError, InputError  # noqa: E402
from speed.population_samplers import METHODS, Sampled, Settings  # noqa: E402
from speed.population_target import NAMES, Counts, counts_of, golden  # noqa: E402

if TYPE_CHECKING:
    import xarray as xr

#: What a method imports, and so needs.
LIBRARIES = {"numpyro": ("jax", "numpyro"), "nutpie": ("nutpie", "pymc"), "nutpie-numpy": ("nutpie",)}
FOUND = ("mean", "sd", "q05", "q50", "q95")
STATISTICS = (*FOUND, *(f"mcse_{key}" for key in FOUND), "ess_bulk", "ess_tail", "r_hat")


def main() -> int:
    """Parse, refuse early, sample with one method after the other, write."""
    options = _parser().parse_args()
    if options.cores > 1 and CORES:
        os.sched_setaffinity(0, CORES)
    try:
        for path in [one for one in (options.output, options.golden) if one is not None]:
            require_writable(path, overwrite=options.overwrite)
        counts = counts_of(bt.read_study(options.study))
        if options.golden is not None:
            with whole_file(options.golden, overwrite=options.overwrite) as path, path.open("wb") as file:
                np.savez_compressed(file, **golden(counts, options.seed))
        rows = [_raced(counts, name, turn, options) for turn in range(options.runs) for name in options.method]
        _write([row for row in rows if row], options)
    except BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", type=Path, help="trials or counts, without intervals")
    parser.add_argument("--method", action="append", choices=list(METHODS), default=[], help="may be given several times")
    parser.add_argument("-o", "--output", type=Path, help="table of times and effective draws")
    parser.add_argument("--json", type=Path, help="folder for the numbers found, a file a study and method")
    parser.add_argument("--golden", type=Path, help="write points with their density and gradient (.npz); needs JAX")
    parser.add_argument("--overwrite", action="store_true", help="replace earlier files")
    parser.add_argument("--seed", type=int, default=1, help="of the first run; the next ones count on")
    parser.add_argument("--runs", type=int, default=1, help="times that every method samples, in turn; numbers are kept of the first")
    parser.add_argument("--chains", type=int, default=2)
    parser.add_argument("--warm-up", type=int, default=1500)
    parser.add_argument("--draws", type=int, default=4000)
    parser.add_argument("--cores", type=int, default=1, help="chains at a time; 1, the default, holds the whole process on one core")
    parser.add_argument("--target", type=float, default=0.95, help="acceptance that the step is adapted to")
    return parser


def _raced(counts: Counts, name: str, turn: int, options: argparse.Namespace) -> dict[str, Any] | None:
    """Compile and sample, each timed; a line instead where a library is absent."""
    settings = Settings(options.chains, options.warm_up, options.draws, options.target, options.cores)
    for library in LIBRARIES.get(name, LIBRARIES.get(name.split("-")[0], ())):
        try:
            importlib.import_module(library)  # not part of what is timed
        except ModuleNotFoundError:
            print(f"{name}: left out, {library} is not installed", file=sys.stderr)
            return None
    began = _clock()
    run = METHODS[name](counts, settings)
    compiled = _clock()
    found = run(options.seed + turn)
    ended = _clock()
    statistics = _statistics(counts, found)
    seconds = {"compile_s": compiled[0] - began[0], "compile_cpu_s": compiled[1] - began[1]}
    seconds |= {"wall_s": ended[0] - compiled[0], "cpu_s": ended[1] - compiled[1]}
    row = (
        {"study": options.study.stem, "method": name, "cores": options.cores, "seed": options.seed + turn}
        | seconds
        | _score(statistics, found)
    )
    print(", ".join(f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}" for key, value in row.items()), flush=True)
    if options.json is not None and not turn:
        _write_numbers(counts, row | vars(settings), statistics, options)
    return row


def _clock() -> tuple[float, float]:
    """Wall and user seconds, with those of processes that have ended."""
    times = os.times()
    return time.perf_counter(), times.user + times.children_user


def _statistics(counts: Counts, found: Sampled) -> dict[str, dict[str, float]]:
    """By name of parameter: m[mu1], tau[mu1], ..., eta[S01,mu1], r[mu1 with probit_gamma]."""
    import arviz as az

    dims = {"m": ["parameter"], "tau": ["parameter"], "eta": ["subject", "parameter"]}
    values = {key: getattr(found, key) for key in dims}
    coords = {"parameter": list(NAMES), "subject": list(counts.names)}
    if found.correlation is not None:
        j, i = np.triu_indices(len(NAMES), 1)
        dims["r"], values["r"] = ["pair"], found.correlation[..., j, i]
        coords["pair"] = [f"{NAMES[a]} with {NAMES[b]}" for a, b in zip(j, i, strict=True)]
    data = az.from_dict(posterior=values, dims=dims, coords=coords).posterior
    quantiles = {"q05": 0.05, "q50": 0.5, "q95": 0.95}
    mean, sd = data.mean(("chain", "draw")), data.std(("chain", "draw"))
    tables = {"mean": mean, "sd": sd, "mcse_sd": az.mcse((data - mean) ** 2) / (2.0 * sd)}  # ArviZ 0.23 has none with NumPy 2.4
    tables |= {key: data.quantile(level, ("chain", "draw")) for key, level in quantiles.items()}
    tables |= {"mcse_mean": az.mcse(data), "r_hat": az.rhat(data)}
    tables |= {f"mcse_{key}": az.mcse(data, method="quantile", prob=level) for key, level in quantiles.items()}
    tables |= {"ess_bulk": az.ess(data), "ess_tail": az.ess(data, method="tail")}
    named = {key: _named(tables[key]) for key in STATISTICS}
    return {name: {key: named[key][name] for key in STATISTICS} for name in named["mean"]}


def _named(table: xr.Dataset) -> dict[str, float]:
    found = {f"{key}[{name}]": float(table[key].sel(parameter=name)) for key in ("m", "tau") for name in NAMES}
    eta = table["eta"]
    if "r" in table:
        found |= {f"r[{pair}]": float(table["r"].sel(pair=pair)) for pair in table["pair"].to_numpy()}
    return found | {f"eta[{i},{k}]": float(eta.sel(subject=i, parameter=k)) for i in eta.subject.to_numpy() for k in NAMES}


def _score(statistics: dict[str, dict[str, float]], found: Sampled) -> dict[str, Any]:
    hyper = [values for name, values in statistics.items() if not name.startswith("eta")]
    return {
        "divergences": found.divergences,
        "largest_r_hat": max(values["r_hat"] for values in statistics.values()),
        "least_ess_bulk": min(values["ess_bulk"] for values in hyper),
        "least_ess_tail": min(values["ess_tail"] for values in hyper),
        "least_ess_bulk_subject": min(values["ess_bulk"] for values in statistics.values()),
        "gradients_per_draw": found.gradients / found.m[..., 0].size,
        "warm_up_gradients": found.warm_up_gradients,
    }


def _write_numbers(counts: Counts, row: dict[str, Any], statistics: dict[str, dict[str, float]], options: argparse.Namespace) -> None:
    """Everything of one run that a comparison needs."""
    prior_mean = dict(zip(NAMES, counts.prior_mean.tolist(), strict=True))
    found = {
        "run": row,
        "prior_mean": prior_mean,
        "versions": machine.versions(),
        "threads": THREADS if options.cores == 1 else "one thread a library",
        "parameters": statistics,
    }
    options.json.mkdir(parents=True, exist_ok=True)
    with whole_file(options.json / f"{row['study']}_{row['method']}.json", overwrite=True) as path:
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _write(rows: list[dict[str, Any]], options: argparse.Namespace) -> None:
    import pandas as pd

    if options.method and not rows:
        raise InputError('no method has its libraries: pip install -e ".[peers]"')
    if options.output is not None:
        write_table(pd.DataFrame(rows), options.output, overwrite=options.overwrite)


if __name__ == "__main__":
    sys.exit(main())
