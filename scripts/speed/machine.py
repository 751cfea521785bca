"""What the numbers were measured on: processor, versions; neither paths nor names of the machine."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

LIBRARIES = ("bayes_toe", "numpy", "scipy", "emcee", "arviz", "nutpie", "pymc", "numba", "numpyro", "jax", "dynesty", "nautilus-sampler")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def one_thread() -> str:
    """Ask every library for one thread and the system for one core; before any of them is imported.

    Returns
    -------
    str
        What was done, for the report.
    """
    for name in THREADS:
        os.environ[name] = "1"
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
    if not hasattr(os, "sched_setaffinity"):
        return "one thread a library, chains one after the other"
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    return "every process on the same core, one thread a library, chains one after the other"


def processor() -> str:
    """Model name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def versions() -> dict[str, str]:
    """Python and the libraries, those absent as such."""
    return {"Python": platform.python_version()} | {name: _version(name) for name in LIBRARIES}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
