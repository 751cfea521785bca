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
from functools import cache
from itertools import islice
from threading import Lock
from typing import TYPE_CHECKING, TypeVar
from uuid import uuid4

from threadpoolctl import threadpool_limits

from bayes_toe.errors import InputError, WorkerError
from bayes_toe.libraries import library_versions

if TYPE_CHECKING:
    from distributed import Client

Result = TypeVar("Result")
Failure = TypeVar("Failure")
_NO_CONNECTION = "the connection to the Dask scheduler is lost"
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
            kind = thread.submit(lambda: asyncio.run(_identity(address))).result()["type"]
        if kind != "Scheduler":
            raise ValueError(f"that is a {kind.lower()}")
        # An error says what ends the work, not a log.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        return Client(address, timeout=PATIENCE, set_as_default=False)
    except Exception as error:  # Whatever listens there may answer with anything.
        reason = str(error) or f"no answer within {PATIENCE:g} s"
        raise WorkerError(f"no Dask scheduler at {address!r}: {reason}") from error


async def _identity(address: str) -> dict[str, str]:
    from distributed.core import rpc
    from distributed.security import Security

    arguments = Security().get_connection_args("client")
    async with rpc(address, connection_args=arguments) as remote:
        identity: dict[str, str] = await asyncio.wait_for(remote.identity(), PATIENCE)
        return identity


def run_on(
    client: Client, jobs: Sequence[Callable[[], Result]], failure: Callable[[int], Failure]
) -> Generator[tuple[int, Result | Failure]]:
    """Yield the index of each job with its result, in the order in which jobs finish.

    The cluster has no more jobs than workers, so that a worker that dies takes only its own job
    along. A result is fetched alone and released at once. Jobs that are left when the caller stops
    are cancelled.

    Parameters
    ----------
    client : distributed.Client
    jobs : sequence of callable
    failure : callable
        Makes the result of a job that the scheduler gave up, from the number of workers that died.

    Raises
    ------
    InputError
        If `client` is no client, or a worker has other versions than this process.
    WorkerError
        If the client is closed, or the scheduler cannot be reached any more.
    """
    _require_open(client)
    from dask import config
    from distributed import Future, as_completed
    from distributed.scheduler import KilledWorker

    waiting = iter(enumerate(jobs))
    futures = as_completed(loop=client.loop)
    # Every key that the scheduler may know: an interrupt can come between any two lines.
    index_of_key: dict[str, int] = {}

    def submit_up_to(n_jobs: int) -> None:
        for index, job in islice(waiting, max(0, n_jobs - len(index_of_key))):
            key = f"bayes_toe-{uuid4().hex}"
            index_of_key[key] = index
            # What a job brings along is used once; Dask would warn of its size.
            with config.set({"distributed.admin.large-graph-warning-threshold": "1 TB"}):
                futures.add(client.submit(_run_there, versions(), job, key=key, pure=False))

    try:
        # With no worker a job waits on the cluster for the first that comes.
        submit_up_to(max(1, _n_workers(client)))
        for future in futures:
            if future.cancelled():
                raise WorkerError(_NO_CONNECTION)
            # Before the result is fetched, so that no worker waits.
            submit_up_to(max(1, _n_workers(client)) + 1)
            try:
                yield index_of_key[future.key], future.result()
            except ImportError as error:
                raise InputError(f"a Dask worker lacks what is here: {error}") from error
            except KilledWorker as error:
                yield index_of_key[future.key], failure(error.allowed_failures + 1)
            future.release()
            del index_of_key[future.key]
    finally:
        if index_of_key and client.status == "running":
            client.cancel([Future(key, client) for key in index_of_key])


def _n_workers(client: Client) -> int:
    try:
        return len(client.nthreads())
    except OSError as error:
        raise WorkerError(_NO_CONNECTION) from error


def _run_there(expected: Mapping[str, str], job: Callable[[], Result]) -> Result:
    """Run a job alone in a worker, with one BLAS thread.

    Matplotlib is not made for threads.
    """
    _require_same(expected)
    with _one_at_a_time:
        threadpool_limits(1)  # For good: the libraries of one job are those of the next.
        return job()


@cache
def versions() -> Mapping[str, str]:
    """The programs whose versions must agree, with their versions in this process."""
    return {"Python": platform.python_version(), **library_versions("distributed")}


def _require_open(client: Client) -> None:
    """Require a client, and that it is open."""
    if not hasattr(client, "scheduler_info"):
        raise InputError(
            f"workers={client!r}: allowed is a number of processes from 1, or a distributed.Client"
        )
    if client.status != "running":
        raise WorkerError(f"the Dask client is {client.status}")


def _require_same(expected: Mapping[str, str]) -> None:
    """Refuse to work with other versions of the programs on which results depend."""
    for name, version in expected.items():
        version_here = versions().get(name)
        if version_here != version:
            raise InputError(
                f"the worker on {platform.node()} has {name} {version_here}, this process "
                f"{version}: they have to be the same"
            )


def without_cluster() -> AbstractContextManager[object]:
    """Without the session's cluster: xarray would ask it to lock a file that is in memory."""
    if "dask" not in sys.modules:
        return nullcontext()
    from dask import config

    setting: AbstractContextManager[object] = config.set(scheduler="synchronous")
    return setting
