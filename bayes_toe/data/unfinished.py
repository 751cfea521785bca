"""What is not finished yet: its hidden name, which says whose it is, its lock, how what was left of it goes, and how far the work is."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import secrets
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

HIDDEN = ".bayes_toe-"


@dataclass(frozen=True)
class Standing:
    """How far the work is whose results a folder keeps.

    Attributes
    ----------
    taken : int
        Results that were there before.
    done, jobs : int
        Results that are there, and how many there will be.
    what : str
        What they are of.
    """

    taken: int
    done: int
    jobs: int
    what: str


#: By folder, as far as this process knows: for whoever has to say so when it is stopped.
under_way: dict[Path, Standing] = {}


def said_kept() -> str:
    """What another call need not compute again; empty where that is nothing."""
    said = [f"{one.done} of {one.jobs} {one.what} kept in {folder}" for folder, one in under_way.items() if one.done]
    return f"{', '.join(said)}, go on with --resume" if said else ""


def free_name(folder: Path, suffix: str) -> Path:
    """A path in a folder that nothing has, for what is not finished yet; it says whose it is, for :func:`sweep`."""
    return folder / f"{HIDDEN}{_here()}-{os.getpid()}-{secrets.token_hex(8)}{suffix}"


def sweep(folder: Path) -> None:
    """Remove files that processes of this machine that were killed have left unfinished in a folder, if it is one.

    Folders are put back or removed by :func:`bayes_toe.data.whole_folders.put_back`, which knows what they may still hold.
    """
    ours = re.compile(rf"{re.escape(HIDDEN)}{_here()}-([0-9]+)-[0-9a-f]{{16}}(\..*)?")
    with suppress(OSError):
        for path in list(folder.iterdir()):
            match = ours.fullmatch(path.name)
            if match is None or _alive(int(match[1])):
                continue
            if path.is_symlink() or not path.is_dir():
                path.unlink()


def flocked(opened: int) -> bool | None:
    """Whether this process now has the lock of an open file or folder, until it ends. None where the system has no such locks."""
    try:
        import fcntl
    except ImportError:
        return None
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


@cache
def _here() -> str:
    """Where process numbers mean what they mean to this process: the machine and, where there is one, the container."""
    space = ""
    with suppress(OSError):
        space = os.readlink("/proc/self/ns/pid")
    return hashlib.blake2s(f"{platform.node()} {space}".encode(), digest_size=4).hexdigest()


def _alive(pid: int) -> bool:
    """Whether there is such a process; assumed where that cannot be asked without harm."""
    if os.name != "posix":
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        pass
    return True
