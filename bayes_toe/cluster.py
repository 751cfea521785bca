"""Jobs on the workers of a Dask cluster: its scheduler places them, and tries those again whose workers died.

Not through joblib's backend "dask": where the scheduler gives a job up because its workers died, that of joblib 1.6 waits for ever.
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
from bayes_toe.version import library_versions

if TYPE_CHECKING:
    from distributed import Client

Result = TypeVar("Result")
Lost = TypeVar("Lost")
_GONE = "the connection to the Dask scheduler is lost"
PATIENCE = 8.0  # seconds for a scheduler to answer
_one_at_a_time = Lock()


def connect(address: str) -> Client:
    """A client of the scheduler at an address, tcp://HOST:PORT; an InputError without Dask, a WorkerError where no scheduler answers."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("Dask is not installed: pip install 'bayes_toe[dask]'") from None
    try:
        # A client waits without end for something else than a scheduler, and does not go easily where it could not begin. In a thread of
        # its own, because a notebook has an event loop already.
        with ThreadPoolExecutor(1) as asking:
            kind = asking.submit(lambda: asyncio.run(_identity(address))).result()["type"]
        if kind != "Scheduler":
            raise ValueError(f"that is a {kind.lower()}")
        logging.getLogger("distributed.client").setLevel(
            logging.CRITICAL
        )  # what ends the work is said by an error
        return Client(address, timeout=PATIENCE, set_as_default=False)
    except Exception as error:  # whatever the answer of something else is taken for
        raise WorkerError(
            f"no Dask scheduler at {address!r}: {str(error) or f'no answer within {PATIENCE:g} s'}"
        ) from error


async def _identity(address: str) -> dict[str, str]:
    from distributed.core import rpc
    from distributed.security import Security

    async with rpc(address, connection_args=Security().get_connection_args("client")) as there:
        found: dict[str, str] = await asyncio.wait_for(there.identity(), PATIENCE)
        return found


def run_on(
    client: Client, jobs: Sequence[Callable[[], Result]], lost: Callable[[int], Lost]
) -> Generator[tuple[int, Result | Lost]]:
    """Yield (index, what the job returned) as they finish; where the scheduler gives a job up, `lost` of the workers that died of it.

    No more jobs are on the cluster than it has workers: what dies with a worker is what it was at. Results are fetched one by one and
    released there at once. What is left when nobody listens any more is cancelled. An InputError where this is no client, or the scheduler
    or a worker has other versions than this process, or lacks this package; a WorkerError where the client is closed or the scheduler gone.
    """
    _require_fit(client)
    from dask import config
    from distributed import Future, as_completed
    from distributed.scheduler import KilledWorker

    waiting, done = iter(enumerate(jobs)), as_completed(loop=client.loop)
    there: dict[
        str, int
    ] = {}  # every key that may be known there: an interrupt can come between any two lines

    def fill(places: int) -> None:
        for index, job in islice(waiting, max(0, places - len(there))):
            there[key := f"bayes_toe-{uuid4().hex}"] = index
            with config.set(
                {"distributed.admin.large-graph-warning-threshold": "1 TB"}
            ):  # what a job brings along is used once
                done.add(client.submit(_job_there, versions(), job, key=key, pure=False))

    try:
        fill(_places(client))
        for future in done:
            if future.cancelled():
                raise WorkerError(_GONE)
            fill(_places(client) + 1)  # before the result is fetched: nobody there waits for it
            try:
                yield there[future.key], future.result()
            except KilledWorker as error:
                yield there[future.key], lost(error.allowed_failures + 1)
            future.release()
            del there[future.key]
    finally:
        if there and client.status == "running":
            client.cancel([Future(key, client) for key in there])


def _places(client: Client) -> int:
    """How many jobs belong on the cluster now: one a worker. One also where there is none yet: it waits there for the first that comes."""
    try:
        return max(1, len(client.nthreads()))
    except OSError as error:
        raise WorkerError(_GONE) from error


def _job_there(expected: Mapping[str, str], job: Callable[[], Result]) -> Result:
    """In a worker: do a job, with one BLAS thread, and alone, since threads would only wait for each other and drawing minds company."""
    _require_same(
        f"the worker on {platform.node()}", versions(), expected
    )  # which may have come after all were asked
    with _one_at_a_time:
        threadpool_limits(1)  # and for good: the libraries of one job are those of the next
        return job()


@cache
def versions() -> Mapping[str, str]:
    """What has to be the same everywhere, with its version in this process."""
    return {"Python": platform.python_version(), **library_versions("distributed")}


def _require_fit(client: Client) -> None:
    """A client that is open, with our versions at the scheduler, which reads what it hands on, and at the workers that are there."""
    if not hasattr(client, "scheduler_info"):
        raise InputError(
            f"workers={client!r}: allowed is a number of processes from 1, or a distributed.Client"
        )
    if client.status != "running":
        raise WorkerError(f"the Dask client is {client.status}")
    try:
        found = {
            "the scheduler": client.run_on_scheduler(versions),
            **client.run(versions, on_error="return"),
        }
    except (ImportError, AttributeError) as error:
        found = {"the scheduler": error}
    except OSError as error:
        raise WorkerError(_GONE) from error
    for where, theirs in found.items():
        _require_same(where, theirs, versions())


def _require_same(
    where: str, found: Mapping[str, str] | Exception, expected: Mapping[str, str]
) -> None:
    if isinstance(found, Exception):
        raise InputError(f"{where} lacks what this process has: {found}")
    for name, ours in expected.items():
        if found.get(name) != ours:
            raise InputError(
                f"{where} has {name} {found.get(name)}, this process {ours}: they have to be the same"
            )


def aside() -> AbstractContextManager[object]:
    """Do something without the session's cluster: xarray would ask it for a lock by the name of a file, and memory has no name."""
    if "dask" not in sys.modules:
        return nullcontext()
    from dask import config

    setting: AbstractContextManager[object] = config.set(scheduler="synchronous")
    return setting
