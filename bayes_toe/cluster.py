"""Jobs on the workers of a Dask cluster, whose scheduler places and repeats them.

`connect` gives a client, `run_on` runs jobs.

joblib's own backend "dask" is not used: with joblib 1.6 it waits for ever for a job that the
scheduler gives up because its workers died.
"""

from __future__ import annotations

import asyncio
import logging
import platform
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from functools import cache, partial
from threading import Lock
from typing import TYPE_CHECKING, TypeVar

from threadpoolctl import threadpool_limits

from bayes_toe.errors import InputError, WorkerError
from bayes_toe.libraries import library_versions

if TYPE_CHECKING:
    from distributed import Client

Result = TypeVar("Result")
Jobs = Sequence[Callable[[], Result]]
#: Results with the indices of their jobs.
Outcomes = Generator[tuple[int, Result]]
#: The error where a process of this machine, or of the cluster, is gone.
DEAD_WORKER = "a worker died (killed, or out of memory): use fewer workers"
#: Seconds for a scheduler to answer.
PATIENCE = 8.0
_one_at_a_time = Lock()


def connect(address: str) -> Client:
    """Return a client of the scheduler at an address, tcp://HOST:PORT.

    Raises
    ------
    InputError
        If Dask is not installed.
    WorkerError
        If no scheduler answers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError("Dask is not installed: pip install 'bayes_toe[dask]'") from None

    try:
        # A client waits without end for a program that is no scheduler, so that the program is
        # asked first; in a thread of its own, because a notebook has an event loop already.
        with ThreadPoolExecutor(1) as thread:
            program = thread.submit(asyncio.run, _identity(address)).result()["type"]
        if program != "Scheduler":
            raise ValueError(f"that is a {program.lower()}")
        # When the scheduler ends, run_on raises an error. The client would log it too.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        return Client(address, timeout=PATIENCE, set_as_default=False)
    except Exception as error:  # Whatever listens there may answer with anything.
        reason = str(error) or f"no answer within {PATIENCE:g} s"
        raise WorkerError(f"no Dask scheduler at {address!r}: {reason}") from error


async def _identity(address: str) -> dict[str, str]:
    """The record by which a program of Dask answers at an address: {'type': 'Scheduler', ...}."""
    from distributed.core import rpc
    from distributed.security import Security

    arguments = Security().get_connection_args("client")
    async with rpc(address, connection_args=arguments) as remote:
        return await asyncio.wait_for(remote.identity(), PATIENCE)


def count_workers(client: Client) -> int:
    """The number of workers of a cluster."""
    _require_open(client)
    return len(client.nthreads())


def run_on(client: Client, jobs: Jobs[Result]) -> Outcomes[Result]:
    """Yield the index of each job with its result, in the order in which jobs finish.

    A result is released when it is fetched. Jobs that are left when the caller stops are cancelled.

    Raises
    ------
    InputError
        If `client` is no client, or a worker has other versions than this process.
    WorkerError
        If the client is closed, the scheduler cannot be reached any more, or it gives up a job
        because its workers died.
    """
    _require_open(client)

    from dask import config
    from distributed import KilledWorker, as_completed

    # Dask warns of arguments over 10 MB, which should be sent once for all jobs. The
    # arguments of a job are used by this job only.
    with config.set({"distributed.admin.large-graph-warning-threshold": "1 TB"}):
        futures = client.map(partial(_run_there, versions()), jobs, pure=False)
    index_of_key = {future.key: index for index, future in enumerate(futures)}

    try:
        for future in as_completed(futures, loop=client.loop):
            if future.cancelled():  # Nobody else cancels a job that is waited for.
                raise WorkerError("the connection to the Dask scheduler is lost")
            yield index_of_key[future.key], future.result()
            future.release()
    except ImportError as error:  # from reading the job at the worker
        raise InputError(f"a Dask worker lacks what is here: {error}") from error
    except KilledWorker as error:
        raise WorkerError(DEAD_WORKER) from error
    finally:
        if client.status == "running":
            client.cancel(futures)


def _run_there(expected: Mapping[str, str], job: Callable[[], Result]) -> Result:
    """Run a job in a worker, which must have the expected versions; with one BLAS thread.

    Dask may start several jobs as threads of a worker. They run one after the other, because
    Matplotlib is not made for threads.
    """
    for name, version in expected.items():
        version_here = versions().get(name)
        if version_here != version:
            raise InputError(
                f"the worker on {platform.node()} has {name} {version_here}, this process "
                f"{version}: they have to be the same"
            )
    with _one_at_a_time:
        threadpool_limits(1)  # The limit stays for the next jobs of this worker.
        return job()


@cache
def versions() -> Mapping[str, str]:
    """The programs whose versions must agree, with their versions in this process."""
    return {"Python": platform.python_version(), **library_versions("distributed")}


def _require_open(client: Client) -> None:
    """Refuse what is no client, and a client that is not open."""
    if not hasattr(client, "scheduler_info"):
        raise InputError(
            f"workers={client!r}: allowed is a number of processes from 1, or a distributed.Client"
        )
    if client.status != "running":
        raise WorkerError(f"the Dask client is {client.status}")


def without_cluster() -> AbstractContextManager[object]:
    """A context in which Dask computes in this process, even if the session has a cluster.

    Otherwise xarray asks the cluster for a lock when it writes a file, also one in memory.
    """
    if "dask" not in sys.modules:  # Without Dask there is no cluster.
        return nullcontext()
    from dask import config

    return config.set(scheduler="synchronous")
