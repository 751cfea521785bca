"""Finished results on the disk until all of them are there, so that a stopped command can resume.

A store is a folder that carries a mark of ours. Each result has a file of its own, named after the
fingerprint of its job, and the fingerprint is stored inside too: a file that was renamed, damaged
or written by another version is computed again. Files are NumPy archives of arrays and JSON, so
nothing in them can be run.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from functools import cache, partial
from importlib import import_module
from itertools import chain, compress
from pathlib import Path
from types import ModuleType
from typing import IO, Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt
from threadpoolctl import threadpool_info

from bayes_toe.arrays import StrPath
from bayes_toe.data.messages import format_path
from bayes_toe.data.whole_files import (
    Standing,
    make_folders,
    remove_empty,
    reporting,
    sweep,
    under_way,
    write_whole,
)
from bayes_toe.errors import InputError, OutputError, require_kind
from bayes_toe.libraries import library_versions
from bayes_toe.seeds import root_seed
from bayes_toe.workers import Failed, Progress, Workers, report_progress, run_jobs, run_or_fail

Result = TypeVar("Result")
#: In a store: the file that marks it as ours, the seed of its results, and the lock.
MARK, _SEED, _LOCK = ".bayes_toe_store", "seed", "lock"
SUFFIX = ".result"
_OURS = "bayes_toe."


@dataclass(frozen=True)
class StoredResults(Generic[Result]):
    """Results in the order of their jobs, without those that failed.

    Results of a store are read from the disk only when they are asked for.

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


class ResultStore:
    """A folder of finished results, held by this process; without a folder nothing is stored.

    See :func:`open_store`.
    """

    def __init__(self, folder: Path | None = None, what: str = "subjects") -> None:
        self.folder, self.what = folder, what

    def seed(self, seed: int | None) -> int:
        """The root seed: the one given, else the one of the stored results, else a fresh one."""
        if self.folder is None:
            return root_seed(seed)
        if seed is None:
            with suppress(OSError, ValueError, InputError):
                seed = root_seed(int((self.folder / _SEED).read_text(encoding="utf-8")))
        root = root_seed(seed)
        _put(self.folder / _SEED, str(root).encode())
        return root

    def work(
        self,
        jobs: Sequence[Callable[[], Result]],
        workers: Workers,
        progress: Progress | None,
        names: Sequence[tuple[str, ...]],
    ) -> StoredResults[Result]:
        """Do the jobs whose results are not stored, and store each result as it comes.

        `progress` is called with the names of a job when the job is done.
        """
        if self.folder is None:
            results = run_or_fail(jobs, workers, progress, names)
            failed = {
                index: result for index, result in enumerate(results) if isinstance(result, Failed)
            }
            # Results that failed are never read.
            return StoredResults(len(jobs), failed, results.__getitem__)  # type: ignore[arg-type]
        keys = [fingerprint((versions(), job)) for job in jobs]
        files = [self.folder / f"{key}{SUFFIX}" for key in keys]
        is_stored = [_is_result_of(key, file) for key, file in zip(keys, files, strict=True)]
        missing = [index for index, stored in enumerate(is_stored) if not stored]
        failed = {}
        n_stored = sum(is_stored)
        standing = under_way[self.folder] = Standing(n_stored, n_stored, len(jobs), self.what)
        report_progress(progress, chain.from_iterable(compress(names, is_stored)))
        with closing(run_jobs([jobs[index] for index in missing], workers)) as outcomes:
            for position, result in outcomes:
                index = missing[position]
                if isinstance(result, Failed):
                    failed[index] = result
                else:
                    _put(files[index], packed({"job": keys[index], "result": result}))
                    standing = under_way[self.folder] = replace(standing, done=standing.done + 1)
                report_progress(progress, names[index])

        def read(index: int) -> Result:
            result: Result = unpacked(files[index].read_bytes())["result"]
            return result

        return StoredResults(len(jobs), failed, read)


def _is_result_of(key: str, file: Path) -> bool:
    """Whether a file holds the whole result of the job with this fingerprint."""
    try:
        return bool(unpacked(file.read_bytes())["job"] == key)
    except Exception:
        return False  # Whatever is wrong with the file, its job is done again.


def _put(file: Path, content: bytes) -> None:
    with reporting(file.parent, hidden=file):
        write_whole(file, content)


@cache
def versions() -> tuple[str, ...]:
    """All that decides a result besides its job: versions of libraries, and the processor.

    BLAS has different kernels for each kind of processor.
    """
    kernels = {
        library["architecture"] for library in threadpool_info() if "architecture" in library
    }
    python = (platform.python_version(), platform.machine())
    return (*library_versions().values(), *python, *sorted(filter(None, kernels)))


# --- The folder of a store ----------------------------------------------------------------------


@contextmanager
def open_store(folder: StrPath | None, what: str = "subjects") -> Iterator[ResultStore]:
    """Hold a folder of finished results; it is made where it is missing.

    A folder in which nothing was stored is removed again after a failure.

    Raises
    ------
    OutputError
        If another process holds the folder, it is a link or holds files without our mark, or it
        cannot be written to.
    """
    if folder is None:
        yield ResultStore()
        return
    require_kind("keep", folder, (str, os.PathLike), "the path of a folder")
    path = Path(folder)
    require_ours(path)
    with ExitStack() as made:
        make_folders(path, made)
        sweep(path)
        with _held(path):
            _put(path / MARK, b"Results of an unfinished command of bayes_toe.\n")
            try:
                yield ResultStore(path, what)
            except BaseException:
                if count_stored(path) == 0:
                    with suppress(OutputError):
                        discard(path)
                raise
        made.pop_all()


def require_ours(folder: Path) -> None:
    """Refuse a folder that is a link, or that holds anything and does not carry our mark."""
    with reporting(folder):
        is_link = folder.is_symlink() or (folder / _LOCK).is_symlink()
    if is_link:
        raise OutputError(
            f"{format_path(folder)}: is a link; the folder of results must be a real one"
        )
    if not folder.is_dir() or (folder / MARK).is_file():
        return
    with reporting(folder):
        # Only the lock: a process that was killed before it could write the mark.
        is_empty = {path.name for path in folder.iterdir()} <= {_LOCK}
    if not is_empty:
        raise OutputError(
            f"{format_path(folder)}: holds files that this program did not write; choose another "
            "folder"
        )


def count_stored(folder: Path) -> int:
    """The number of results that a folder holds."""
    return len(list(folder.glob(f"*{SUFFIX}")))


def discard(folder: Path) -> None:
    """Remove what is stored, and the folder if nothing else is in it."""
    require_ours(folder)
    under_way.pop(folder, None)
    ours = [*folder.glob(f"*{SUFFIX}"), folder / _SEED, folder / _LOCK, folder / MARK]
    with reporting(folder):
        for file in ours:
            file.unlink(missing_ok=True)
    remove_empty(folder)


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; it names the holder and ends with the process."""
    with reporting(folder):
        lock = open(folder / _LOCK, "a+", encoding="utf-8", opener=open_no_link)  # noqa: SIM115
    with lock:
        if not is_locked(lock):
            lock.seek(0)
            holder = lock.read(1000) or "another process"
            raise OutputError(f"{format_path(folder)}: in use by {holder}; wait for it")
        with reporting(folder):
            lock.truncate(0)
            lock.write(f"process {os.getpid()} on {platform.node()}")
            lock.flush()
        yield


def open_no_link(path: str, flags: int) -> int:
    """Open a file, but not through a symbolic link, where the system can tell."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


def is_locked(lock: IO[str]) -> bool:
    """Whether this process has the lock now; a child that inherits the file keeps it.

    Taken for granted where there are no such locks.
    """
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


# --- Results as bytes ---------------------------------------------------------------------------


def packed(value: object) -> bytes:
    """A record, or a tuple, list or dict of records, as bytes with checksums, exact to the bit.

    Records are the dataclasses and named tuples of this package.

    Raises
    ------
    TypeError
        If something in it is neither a record nor an array, a number, a text or None.

    Examples
    --------
    >>> unpacked(packed({"mean": np.float32(0.1), "draws": np.arange(3.0), "note": None}))
    {'mean': np.float32(0.1), 'draws': array([0., 1., 2.]), 'note': None}
    """
    arrays: list[npt.NDArray[Any]] = []
    text = json.dumps(_plain(value, arrays, _refuse))
    members: dict[str, Any] = {f"a{i}": array for i, array in enumerate(arrays)}
    content = io.BytesIO()
    np.savez(content, text=np.array(text), **members)
    return content.getvalue()


def unpacked(content: bytes) -> Any:
    """The inverse of :func:`packed`.

    Raises
    ------
    InputError
        If the bytes hold something else than records of this package. NumPy raises its own errors
        for bytes that are damaged.
    """
    with np.load(io.BytesIO(content), allow_pickle=False) as members:
        return _rebuilt(json.loads(str(members["text"])), members)


def fingerprint(value: object) -> str:
    """SHA-256, hexadecimal, of all that a value consists of.

    Functions, and partial calls, count by name and arguments.

    Examples
    --------
    >>> fingerprint(partial(max, 1, 2)) == fingerprint(partial(max, 1, 2))
    True
    >>> fingerprint(partial(max, 1, 2)) == fingerprint(partial(max, 1, 3))
    False
    """
    arrays: list[npt.NDArray[Any]] = []
    text = json.dumps(_plain(value, arrays, _call_by_name), sort_keys=True)
    digest = hashlib.sha256(text.encode())
    for array in arrays:
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _plain(
    value: object, arrays: list[npt.NDArray[Any]], other: Callable[[object], object]
) -> object:
    """A value as JSON can hold it; its arrays are appended to `arrays`."""
    inner = partial(_plain, arrays=arrays, other=other)
    is_plain = value is None or isinstance(value, bool | int | float | str)
    if is_plain and not isinstance(value, Enum):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return _array_by_number(value, arrays)
    if isinstance(value, list):
        return [inner(item) for item in value]
    if isinstance(value, Mapping):
        return {"dict": [[inner(key), inner(item)] for key, item in value.items()]}
    type_name = f"{type(value).__module__}:{type(value).__qualname__}"
    if isinstance(value, Enum):
        return {"enum": type_name, "value": value.value}
    names = _field_names(value)
    if names is not None:
        values = {name: inner(getattr(value, name)) for name in names}
        return {"record": type_name, "fields": values}
    if isinstance(value, tuple):
        return {"tuple": [inner(item) for item in value]}
    return inner(other(value))


def _array_by_number(
    value: npt.NDArray[Any] | np.generic[Any], arrays: list[npt.NDArray[Any]]
) -> object:
    """The number that an array, or a number of NumPy, gets in `arrays`."""
    array = np.asarray(value)
    if array.dtype.hasobject:
        return _refuse(value)
    arrays.append(array)
    kind = "array" if isinstance(value, np.ndarray) else "scalar"
    return {kind: len(arrays) - 1}


def _field_names(value: object) -> tuple[str, ...] | None:
    """Names of the fields from which a record can be made again; None for other values."""
    if is_dataclass(value) and not isinstance(value, type):
        return tuple(field.name for field in fields(value) if field.init)
    if isinstance(value, tuple):
        return getattr(value, "_fields", None)
    return None


def _refuse(value: object) -> object:
    raise TypeError(f"{type(value).__name__} cannot be stored")


def _call_by_name(value: object) -> object:
    """A function as its name and, for a method, its object.

    A partial call as what it consists of.
    """
    if isinstance(value, partial):
        return value.func, value.args, value.keywords
    if not callable(value) or "<" in getattr(value, "__qualname__", "<"):
        return _refuse(value)
    name = f"{value.__module__}:{value.__qualname__}"  # type: ignore[attr-defined]
    owner = getattr(value, "__self__", None)
    has_state = not isinstance(owner, type | ModuleType)
    return name, owner if has_state else None


def _rebuilt(plain: Any, members: Mapping[str, npt.NDArray[Any]]) -> Any:
    """The inverse of :func:`_plain`."""
    inner = partial(_rebuilt, members=members)
    match plain:
        case list():
            return [inner(item) for item in plain]
        case {"array": index}:
            return members[f"a{index}"]
        case {"scalar": index}:
            return members[f"a{index}"][()]
        case {"tuple": values}:
            return tuple(map(inner, values))
        case {"dict": pairs}:
            return {inner(key): inner(item) for key, item in pairs}
        case {"enum": name, "value": member}:
            return _record_type(name)(member)
        case {"record": name, "fields": values}:
            arguments = {key: inner(item) for key, item in values.items()}
            return _record_type(name)(**arguments)
    return plain


def _record_type(name: str) -> Any:
    """A record type of this package; anything else is refused."""
    module, _, qualified = name.partition(":")
    found = None
    if module.startswith(_OURS):
        found = getattr(import_module(module), qualified, None)
    if isinstance(found, type):
        is_record = is_dataclass(found) or hasattr(found, "_fields") or issubclass(found, Enum)
        if is_record:
            return found
    raise InputError(f"{name} is not a record of this package")
