"""Sample a study on a SLURM cluster: each job of the queue brings as many workers as it has cores.

Example: python scripts/slurm_example.py study.csv -o posterior.nc --jobs 4 --cores 8 --memory 16GB
--walltime 02:00:00 --seed 1 With --show the batch script of a job is printed, and nothing is
submitted. Needs pip install 'bayes_toe[dask]' dask-jobqueue, in an environment that all nodes see.
"""

import argparse
from pathlib import Path

import dask
from dask_jobqueue import SLURMCluster
from distributed import Client

import bayes_toe as bt


def main() -> None:
    """Ask for jobs, sample on what comes, save."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", type=Path, help="CSV of trials or counts")
    parser.add_argument("-o", "--output", default="posterior.nc")
    parser.add_argument(
        "--draws", type=int, default=4000, help="effective draws to reach for every parameter"
    )
    parser.add_argument("--seed", type=int, help="without it fresh entropy, stored with the draws")
    parser.add_argument("--jobs", type=int, default=4, help="jobs in SLURM's queue")
    parser.add_argument("--cores", type=int, default=8, help="of each job; a worker on each")
    parser.add_argument("--memory", default="16GB", help="of each job; 1 GB a worker will do")
    parser.add_argument("--walltime", default="02:00:00")
    parser.add_argument("--queue", help="SLURM's partition")
    parser.add_argument(
        "--interface", help="network interface that nodes reach each other by, such as ib0"
    )
    parser.add_argument("--show", action="store_true", help="print the batch script only")
    options = parser.parse_args()
    dask.config.set(
        {"distributed.scheduler.allowed-failures": 1}
    )  # a subject whose worker dies is tried once more
    keys = ("cores", "memory", "walltime", "queue", "interface")
    with SLURMCluster(
        processes=options.cores, **{key: getattr(options, key) for key in keys}
    ) as cluster:
        if options.show:
            print(cluster.job_script())
            return
        cluster.scale(jobs=options.jobs)  # work begins with the first worker
        with Client(cluster) as client:
            draws = bt.sample(
                bt.read_study(options.study),
                draws=options.draws,
                seed=options.seed,
                workers=client,
                progress=print,
            )
    draws.save(options.output)


if __name__ == "__main__":
    main()
