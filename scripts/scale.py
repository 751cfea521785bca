"""What a study costs as it grows: wall time, processor time, memory, size of the file, by number of subjects and by engine.

Every line is a process of its own, so that its peak memory is its own. Processor time includes that of workers. Results are those of
`bayes-toe run --pictures none` or of `bt.sample(keep=...)`, as chosen, on simulated observers of the paper's design.

    python scripts/scale.py --subjects 16 100 500 2000 --what sample --workers 2
    python scripts/scale.py --subjects 100 --what sample --dask 1 2 4
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from joblib.externals.loky import get_reusable_executor

import bayes_toe as bt
from bayes_toe.experiments.simulate import reference_design

COLUMNS = ("what", "engine", "subjects", "wall_s", "cpu_s", "cpu_s_per_subject", "parent_peak_mb", "file_mb", "load_s", "one_subject_ms")


def study_of(subjects: int) -> bt.Study:
    """Observers that differ a little, with the answers that are expected of them."""
    design, made = reference_design(), []
    for k in range(subjects):
        shift, spread = 0.4 * ((k * 7) % 11 - 5) / 5, 0.18 + 0.1 * ((k * 3) % 7) / 7
        q = bt.model.equal_probability(design.s1, design.s2, shift, spread, 0.17, 0.92)
        made.append(bt.Subject(f"S{k:05d}", design.s1, design.s2, (50 * q).round().astype(int), [50] * len(q)))
    return bt.Study(made, source="simulated", synthetic=True)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """One study, in this process."""
    (subjects,), workers, dask = options.subjects, options.workers, (options.dask or [0])[0]
    what, study, how = options.what, study_of(subjects), {"draws": options.draws, "seed": 1, "workers": workers}
    with tempfile.TemporaryDirectory() as folder, ExitStack() as held:
        engine = None
        if dask:
            from distributed import Client, LocalCluster

            cluster = held.enter_context(LocalCluster(n_workers=dask, threads_per_worker=1, dashboard_address=None))
            engine = held.enter_context(Client(cluster))
        begun, used = time.perf_counter(), processor_time()
        keep, file = Path(folder, "kept"), Path(folder, "posterior.nc")
        if what == "sample":
            bt.sample(study, model=options.model, engine=engine, keep=keep, **how).save(file)
        else:
            from bayes_toe.cli.results_folder import Drawn, write_results

            analysis = bt.run(study, engine=engine, keep=keep, **how)
            write_results(analysis, folder, workers=workers, pictures=Drawn("none", {}))
        wall = time.perf_counter() - begun
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3  # before anything is read
        held.close()
        cpu = processor_time() - used
        loading = time.perf_counter()
        loaded = bt.load(file)
        reading = time.perf_counter()
        _ = loaded[study.names[0]]  # with the libraries that this loads
        again = time.perf_counter()
        _ = loaded[study.names[-1]]
        read = time.perf_counter()
        size = file.stat().st_size / 1e6
    name = f"dask {dask} workers" if dask else f"local {workers} processes"
    values = (f"{what} {options.model}", name, subjects, wall, cpu, cpu / subjects, peak, size, reading - loading, 1e3 * (read - again))
    return dict(zip(COLUMNS, values, strict=True))


def processor_time() -> float:
    """Of this process and of its workers, which end with it, seconds."""
    get_reusable_executor().shutdown(wait=True)
    return sum(os.times()[:4])


def main() -> None:
    """Measure each case in a process of its own and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--subjects", type=int, nargs="+", default=[16, 100])
    parser.add_argument("--what", choices=["sample", "run"], default="sample")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--dask", type=int, nargs="*", default=[], help="Workers of local Dask clusters, in the place of processes.")
    parser.add_argument("--draws", type=int, default=4000)
    parser.add_argument("--model", default="predictive update", help="Of sample: 'free frequencies' has no chains to wait for.")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measure(options)))
        return
    print(",".join(COLUMNS))
    for subjects in options.subjects:
        for dask in options.dask or [0]:
            one = [
                f"--subjects={subjects}",
                f"--what={options.what}",
                f"--workers={options.workers}",
                f"--draws={options.draws}",
                f"--model={options.model}",
            ]
            words = [sys.executable, __file__, "--one", *one, *([f"--dask={dask}"] if dask else [])]
            found = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
            cells = (f"{value:.4g}" if isinstance(value, float) else str(value) for value in found.values())
            print(",".join(cells), flush=True)


if __name__ == "__main__":
    main()
