"""Finished work, kept on the disk until all of it is done: an interrupted command goes on where it was.

Every result has a file of its own, named after all that decides it: the job's function with counts, names, model, settings and seed, and
the versions of the libraries. What cannot be read is computed again.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain, compress
from pathlib import Path
from typing import Generic, TextIO, TypeVar

from threadpoolctl import threadpool_info

from bayes_toe.data.messages import shown
from bayes_toe.data.whole_files import (
    Standing,
    make_folders,
    remove_empty,
    reporting,
    sweep,
    under_way,
    whole_file,
)
from bayes_toe.errors import InputError, OutputError, require_kind
from bayes_toe.records import fingerprint, packed, unpacked
from bayes_toe.seeds import root_seed
from bayes_toe.version import library_versions
from bayes_toe.workers import Failed, Progress, Workers, run_jobs, run_or_fail, tell

Result = TypeVar("Result")
_SUFFIX, _SEED, _LOCK = ".kept", "seed", "lock"


@dataclass(frozen=True)
class Done(Generic[Result]):
    """Results of jobs in the jobs' order, without those that failed; read as they are asked for where they are kept on the disk.

    Attributes
    ----------
    failed : mapping of int to Failed
        By the index of the job.
    """

    size: int
    failed: Mapping[int, Failed]
    read: Callable[[int], Result]

    def __iter__(self) -> Iterator[Result]:
        return (self.read(index) for index in range(self.size) if index not in self.failed)


class Kept:
    """A folder of finished results, held by this process, see :func:`keeping`; without one nothing is kept."""

    def __init__(self, folder: Path | None = None, what: str = "subjects") -> None:
        self.folder, self.what = folder, what

    def seed(self, seed: int | None) -> int:
        """The root seed: the one given, or else the one that the results here were made with, or a fresh one."""
        if self.folder is None:
            return root_seed(seed)
        with suppress(OSError, ValueError, InputError):
            seed = int((self.folder / _SEED).read_text(encoding="utf-8")) if seed is None else seed
        root = root_seed(seed)
        _put(self.folder / _SEED, str(root).encode())
        return root

    def work(
        self,
        jobs: Sequence[Callable[[], Result]],
        workers: Workers,
        progress: Progress | None,
        names: Sequence[tuple[str, ...]],
    ) -> Done[Result]:
        """Do the jobs whose results are not here, and keep each as it comes; progress is told a job's names when it is done."""
        if self.folder is None:
            results = run_or_fail(jobs, workers, progress, names)
            failed = {index: one for index, one in enumerate(results) if isinstance(one, Failed)}
            return Done(len(jobs), failed, results.__getitem__)  # type: ignore[arg-type]  # those that failed are left out
        files = [self.folder / f"{fingerprint((versions(), job))}{_SUFFIX}" for job in jobs]
        there = [_can_be_read(file) for file in files]
        missing, failed = [index for index, taken in enumerate(there) if not taken], {}
        standing = under_way[self.folder] = Standing(sum(there), sum(there), len(jobs), self.what)
        tell(progress, chain.from_iterable(compress(names, there)))
        with closing(run_jobs([jobs[index] for index in missing], workers)) as found:
            for at, result in found:
                if isinstance(result, Failed):
                    failed[missing[at]] = result
                else:
                    _put(files[missing[at]], packed(result))
                    standing = under_way[self.folder] = replace(standing, done=standing.done + 1)
                tell(progress, names[missing[at]])
        return Done(len(jobs), failed, lambda index: unpacked(files[index].read_bytes()))


def _put(file: Path, content: bytes) -> None:
    with reporting(file.parent, hidden=file), whole_file(file, overwrite=True) as target:
        target.write_bytes(content)


@contextmanager
def keeping(folder: str | Path | None, what: str = "subjects") -> Iterator[Kept]:
    """Hold a folder of finished results, made where it is missing and removed again where nothing was kept in it.

    An OutputError where another process holds it, or it cannot be written to.
    """
    if folder is None:
        yield Kept()
        return
    require_kind("keep", folder, (str, os.PathLike), "the path of a folder")
    path = Path(folder)
    with ExitStack() as made:
        make_folders(path, made)
        sweep(path)
        with _held(path):
            try:
                yield Kept(path, what)
            except BaseException:
                if not kept_in(path):
                    with suppress(OutputError):
                        discard(path)
                raise
        made.pop_all()


def kept_in(folder: Path) -> int:
    """How many results a folder holds."""
    return sum(1 for _ in folder.glob(f"*{_SUFFIX}"))


def discard(folder: Path) -> None:
    """Remove what is kept, and the folder where nothing else is in it."""
    under_way.pop(folder, None)
    with reporting(folder):
        for file in [*folder.glob(f"*{_SUFFIX}"), *(folder / name for name in (_SEED, _LOCK))]:
            file.unlink(missing_ok=True)
    remove_empty(folder)


def _can_be_read(file: Path) -> bool:
    """Whether a result is there; one that is damaged, or in which there is anything else, is computed again."""
    try:
        unpacked(file.read_bytes())
    except Exception:
        return False
    return True


@cache
def versions() -> tuple[str, ...]:
    """Everything outside a job that decides its result; the last digits also by the kind of processor, for which BLAS has its kernels."""
    kernels = sorted({one["architecture"] for one in threadpool_info() if one.get("architecture")})
    return (*library_versions().values(), platform.python_version(), platform.machine(), *kernels)


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which says who has it; it ends with the process, however that ends."""
    with reporting(folder):
        lock = (folder / _LOCK).open("a+", encoding="utf-8")
    with lock:
        if not _locked(lock):
            lock.seek(0)
            raise OutputError(
                f"{shown(folder)}: in use by {lock.read(1000) or 'another process'}; wait for it"
            )
        with reporting(folder):
            lock.truncate(0)
            lock.write(f"process {os.getpid()} on {platform.node()}")
            lock.flush()
        yield


def _locked(lock: TextIO) -> bool:
    """Whether this process has the lock now; nobody knows where the system has no such locks."""
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
