"""Work shared on a real Dask cluster: two worker processes of this machine."""

import asyncio
import os
import socket
from _thread import interrupt_main
from contextlib import closing
from functools import partial
from threading import Timer

import pytest
import xarray as xr
from commands import refusal_of, run_ok
from conftest import quick_study, refused, results_of, write_counts
from processes import blas_threads, kill_this_worker, raise_input_error, return_slowly, wait_until

import bayes_toe as bt
from bayes_toe import cluster
from bayes_toe.errors import WorkerError
from bayes_toe.workers import run_in_order

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def dask():
    """A cluster of two workers on this machine, which tries a job again once if its worker died."""
    from dask import config

    with config.set({"distributed.scheduler.allowed-failures": 1}):
        threads = dict.fromkeys(
            ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "2"
        )  # as where Dask's own setting of 1 is not in force
        built = distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0", memory_limit=0, env=threads
        )
    with built:
        yield built


@pytest.fixture
def client(dask):
    """A client of the cluster, when both workers are there."""
    with distributed.Client(dask) as built:
        built.wait_for_workers(2, timeout=120)  # a cluster gives up a worker that starts too slowly
        yield built


TWO_SUBJECTS = quick_study("AB")


def n_tasks_on(client):
    # The number of jobs that the scheduler still knows: results that nobody needs are tasks, too.
    return client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks))


def test_draws_of_a_cluster_are_those_of_this_process(dask, tmp_path):
    # The cluster's draws are the same to the bit as those that this process samples.
    write_counts(tmp_path / "study.csv", TWO_SUBJECTS)
    line = "sample study.csv --model none --draws 100 --seed 1"
    screen = run_ok(f"{line} -o remote.nc --dask {dask.scheduler_address}", cwd=tmp_path)
    assert f"Workers: 2 at {dask.scheduler_address}" in screen

    run_ok(f"{line} -o local.nc", cwd=tmp_path)
    remote, local = (bt.load(tmp_path / name) for name in ("remote.nc", "local.nc"))
    for group in ("posterior", "sample_stats"):
        xr.testing.assert_identical(remote.group(group), local.group(group))


@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_an_interrupt_cancels_all_jobs(client, delay):
    """It comes after 0 or 0.05 s of the first result: while jobs are sent, waited for or fetched.

    The 500 jobs would need longer, and none is left on the cluster.
    """
    interrupt_later = Timer(delay, interrupt_main)
    reported = []

    def progress(name):
        reported.append(name)
        if len(reported) == 1:
            interrupt_later.start()

    jobs = [partial(return_slowly, k, 0.05) for k in range(500)]
    with pytest.raises(KeyboardInterrupt) as error:
        run_in_order(jobs, client, progress, names=[("",)] * 500)
    wait_until(lambda: n_tasks_on(client) == 0)
    # The traceback keeps the jobs alive up to here, as in a session. They ended all the same.
    assert error.tb is not None


def test_workers_have_one_blas_thread_take_large_jobs_and_keep_no_results(client):
    # Dask warns of jobs of more than 10 MiB, such as the third one.
    jobs = [blas_threads, blas_threads, partial(len, bytes(11_000_000))]
    first, second, size = results_of(jobs, client)
    assert {*first, *second} == {1}
    assert size == 11_000_000
    wait_until(lambda: n_tasks_on(client) == 0)


def test_a_worker_refuses_work_of_another_version(client, monkeypatch):
    # As if this process had another version than the workers.
    other = {**cluster.versions(), "bayes_toe": "9.9"}
    monkeypatch.setattr(cluster, "versions", lambda: other)
    message = (
        r"^the worker on \S+ has bayes_toe [\d.]+, this process 9\.9: they have to be the same$"
    )
    with refused(message):
        results_of([partial(return_slowly, 1, 0.1)], client)


def test_errors_of_a_job_are_those_of_this_process(client):
    # The job raises InputError('no') in a worker.
    with refused(r"^no$"):
        results_of([raise_input_error], client)


def test_a_closed_client_is_refused(dask):
    with distributed.Client(dask, set_as_default=False) as closed:
        pass  # it is closed at the end of the block
    with refused(r"^the Dask client is closed$", WorkerError):
        bt.sample(TWO_SUBJECTS, workers=closed)


# --- commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options, message",
    [
        ("tcp://127.0.0.1:1 --workers 2", "--workers 2 and --dask exclude each other."),
        ("nonsense", "no Dask scheduler at 'nonsense': missing port number in address 'nonsense'"),
        (
            "tcp://127.0.0.1:1",
            "no Dask scheduler at 'tcp://127.0.0.1:1': no answer within 0.5 s",
        ),
    ],
)
def test_a_cluster_that_cannot_be_used_is_refused_in_one_line(
    tmp_path, options, message, monkeypatch
):
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)  # seconds
    line = f"fit --example -o fit.csv --dask {options}"
    assert refusal_of(line, cwd=tmp_path, silent=False) == f"error: {message}\n"


def test_an_address_that_is_no_scheduler_is_refused(client, monkeypatch):
    # The first address is of a socket that accepts and never answers, the second of a worker.
    with (
        closing(socket.create_server(("127.0.0.1", 0))) as silent,
        monkeypatch.context() as patch,
        refused(r"no answer within 0\.5 s$", WorkerError),
    ):
        patch.setattr(cluster, "PATIENCE", 0.5)  # seconds
        cluster.connect(f"tcp://127.0.0.1:{silent.getsockname()[1]}")
    worker = next(iter(client.nthreads()))
    with refused(f"^no Dask scheduler at '{worker}': that is a worker$", WorkerError):
        cluster.connect(worker)


def test_a_client_connects_where_an_event_loop_runs_already_as_in_a_notebook(client):
    async def cell():
        return cluster.connect(client.scheduler.address)

    assert asyncio.run(cell()).nthreads() == client.nthreads()


# --- deaths, last: a fresh worker loads everything anew -------------------------------------------


def test_a_job_whose_workers_die_ends_the_work_in_one_line(client):
    # The first of nine jobs kills each worker that runs it.
    jobs = [partial(kill_this_worker, os.getpid()), *[partial(return_slowly, 1, 0.1)] * 8]
    with pytest.raises(WorkerError, match=r"^a worker died \(killed, or out of memory\)"):
        results_of(jobs, client)
    wait_until(lambda: n_tasks_on(client) == 0)
