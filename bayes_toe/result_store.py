"""Results of subjects in a folder until all are finished, so that a stopped command can resume.

Each result is a file of its own. Its name, and an entry in it, is the hash of its job: of the
counts, the settings, the seed and the versions of the libraries. The result of a file that is
damaged, or of another job, is computed again. Files are written by pickle, but reading makes only
arrays and records of this package, so nothing in a file can be run.
"""

from __future__ import annotations

import io
import os
import pickle
import platform
import shutil
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import is_dataclass
from enum import Enum
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import joblib
from threadpoolctl import threadpool_info

from bayes_toe.arrays import Record, StrPath, Texts
from bayes_toe.data.messages import format_path
from bayes_toe.data.whole_files import (
    HIDDEN,
    Standing,
    refuse_impossible,
    remove_empty,
    reporting,
    require_writable,
    under_way,
    write_whole,
)
from bayes_toe.errors import InputError, NumericalError, require_kind
from bayes_toe.libraries import library_versions
from bayes_toe.seeds import root_seed
from bayes_toe.workers import Progress, Workers, in_batches, report_progress, run_jobs

Job = TypeVar("Job")
Result = TypeVar("Result")
SUFFIX = ".result"
#: Besides records of this package, what arrays and numbers of NumPy are made of.
_NUMPY_NAMES = ("_frombuffer", "_reconstruct", "dtype", "ndarray", "scalar")


def resumed_seed(seed: int | None, folder: StrPath | None) -> int:
    """The given seed, else that of the newest result in the folder, else a fresh seed.

    `folder` is None where no results are stored.
    """
    if folder is not None:
        require_kind("keep", folder, (str, os.PathLike), "the path of a folder")
        if seed is None:
            newest_first = sorted(stored_files(Path(folder)), key=os.path.getmtime, reverse=True)
            for file in newest_first:
                stored = _read(file)
                if stored is not None:  # a damaged file has no seed
                    return root_seed(stored["seed"])
    return root_seed(seed)


def run_stored(
    work: Callable[[Sequence[Job]], Sequence[Result | NumericalError]],
    jobs: Sequence[Job],
    names: Sequence[str],
    *,
    seed: int,
    folder: StrPath | None,
    workers: Workers,
    progress: Progress | None,
    batch: int = 1,
) -> list[Result | Path | NumericalError]:
    """Do the jobs whose results are not in the folder, and store each result.

    Parameters
    ----------
    work : callable
        Does some jobs together, with a result or an error for each. Processes import this function.
    jobs : sequence
        All that decides each result.
    names : sequence of str
        The name of each job, with which `progress` is called when the job is done.
    seed : int
        The root seed of the jobs, which each file stores.
    folder : path, optional
        Without a folder nothing is stored.
    workers, progress
        As in :func:`bayes_toe.workers.run_jobs`.
    batch : int
        The largest number of jobs that a worker does together.

    Returns
    -------
    list
        The results in the order of the jobs. In the place of a result that is stored stands its
        file, for :func:`load_result`. An error is not stored.

    Raises
    ------
    OutputError
        If the folder cannot be written to.
    """
    results: dict[int, Result | Path | NumericalError] = {}  # by the index of the job
    files = {}  # by the index of the job; empty without a folder
    if folder is not None:
        path = Path(folder)
        require_writable(path / SUFFIX, overwrite=True)  # as any file there, before the work
        for index, job in enumerate(jobs):
            job_hash = joblib.hash((versions(), work, job))
            files[index] = path / f"{job_hash}{SUFFIX}"
            if _read(files[index]) is not None:
                results[index] = files[index]
                report_progress(progress, [names[index]])
        # If the command is stopped, its message says how many results the folder has.
        under_way[path] = Standing(files.values(), len(results))

    missing_indices = [index for index in range(len(jobs)) if index not in results]
    batches = in_batches(missing_indices, batch, workers)
    batch_jobs = []
    for indices in batches:
        batch_jobs.append(partial(work, [jobs[index] for index in indices]))

    with closing(run_jobs(batch_jobs, workers)) as outcomes:
        for position, batch_results in outcomes:
            for index, result in zip(batches[position], batch_results, strict=True):
                is_error = isinstance(result, NumericalError)  # an error is tried again next time
                if index in files and not is_error:
                    file = files[index]
                    stored = {"job": file.stem, "seed": seed, "result": result}
                    with reporting(file.parent, hidden=file):
                        write_whole(file, pickle.dumps(stored))
                    results[index] = file
                else:
                    results[index] = result
                report_progress(progress, [names[index]])
    return [results[index] for index in sorted(results)]


def load_result(result: Result | Path) -> Result:
    """A result of :func:`run_stored`, which is read if it stands in a file."""
    if not isinstance(result, Path):
        return result
    stored = _read(result)
    if stored is None:
        raise InputError(f"{format_path(result)}: this result is missing or damaged by now")
    return stored["result"]


@cache
def versions() -> Texts:
    """All that decides a result besides its job: versions of libraries, and the processor.

    BLAS has different kernels for each kind of processor.
    """
    kernels = {library.get("architecture", "") for library in threadpool_info()}
    python = (platform.python_version(), platform.machine())
    return (*library_versions().values(), *python, *sorted(kernels))


def stored_files(folder: Path) -> list[Path]:
    """The files of results in a folder; an empty list without such a folder."""
    # A glob would find nothing, without an error, under a name that no folder can have.
    refuse_impossible(folder)
    with reporting(folder):
        return sorted(folder.glob(f"{'[0-9a-f]' * 32}{SUFFIX}"))  # a hash has 32 digits


def discard(folder: Path) -> None:
    """Remove the results in a folder, and the folder if nothing else is in it."""
    under_way.pop(folder, None)  # no message will name these results
    with reporting(folder):
        for file in stored_files(folder):
            file.unlink(missing_ok=True)
        # A command that was killed while it wrote a file has left its temporary folder.
        for unfinished_folder in folder.glob(f"{HIDDEN}*"):
            shutil.rmtree(unfinished_folder)
    remove_empty(folder)


def _read(file: Path) -> Record | None:
    """The seed and the result in a file; None if the file is missing, damaged or of another job."""
    with suppress(Exception):  # A damaged file can raise anything.
        stored = _RecordReader(io.BytesIO(file.read_bytes())).load()
        if stored["job"] == file.stem:
            return {"seed": root_seed(stored["seed"]), "result": stored["result"]}
    return None


class _RecordReader(pickle.Unpickler):
    """Reads records of this package and arrays; refuses anything else."""

    def find_class(self, module: str, name: str) -> Any:
        """The class of a record, or a function with which NumPy makes arrays."""
        library = module.partition(".")[0]
        if library == "numpy" and name in _NUMPY_NAMES:
            return super().find_class(module, name)
        if library == "bayes_toe":
            record = super().find_class(module, name)
            # Not a function, which a damaged file could call with any arguments.
            is_class = isinstance(record, type)
            if is_class and (is_dataclass(record) or issubclass(record, (tuple, Enum))):
                return record
        raise InputError(f"{module}.{name} is not a record of this package")
