"""Places of outputs: whether one can be written to, what stands there unfinished, and the step by which a finished file takes its name."""

from __future__ import annotations

import os
import platform
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from bayes_toe.data.stores import is_store
from bayes_toe.errors import OutputError

#: How the name of a folder begins whose files are not finished; the machine and the process that writes them follow.
HIDDEN = ".bayes_toe-"


def refuse_impossible(target: Path) -> None:
    """Refuse names that no file can have here, such as a name that is too long."""
    if "\0" in str(target):
        raise OutputError(f"{shown(target)}: cannot be written (it has a NUL character), choose another name")
    with reporting(target), suppress(FileNotFoundError):
        os.lstat(target)


def taken(target: Path) -> OutputError:
    """What is raised where a file exists that may not be replaced."""
    return OutputError(f"{shown(target)}: exists, choose another name or allow to overwrite it")


def shown(path: Path) -> str:
    """A path as messages show it: on one line."""
    return str(path) if str(path).isprintable() else repr(str(path))


@contextmanager
def reporting(target: Path, hidden: Path | None = None) -> Iterator[None]:
    """Turn what the operating system says into one line with the path and a way out; a hidden path in it becomes that path."""
    try:
        yield
    except OSError as error:
        if isinstance(error, OutputError):
            said = str(error)
        else:
            said = f"{shown(target)}: cannot be written ({error.strerror or error}), choose another place"
        raise OutputError(said if hidden is None else said.replace(shown(hidden), shown(target))) from error


def make_folders(folder: Path, made: ExitStack) -> None:
    """Make what is missing of a folder; closing `made` removes it again where it is empty."""
    missing = [part for part in (folder, *folder.parents) if not os.path.lexists(part)]
    for part in reversed(missing):
        with reporting(part):
            part.mkdir(exist_ok=True)
        made.callback(remove_empty, part)


def remove_empty(folder: Path) -> None:
    """Remove a folder where it is empty."""
    with suppress(OSError):
        folder.rmdir()


def require_room(place: Path, needed: int, *, used: Path | None = None) -> None:
    """Refuse now what will not fit on the disk, with a tenth to spare: about `needed` bytes, of which the folder `used` holds some."""
    with reporting(place):
        free = shutil.disk_usage(next(part for part in (place.absolute(), *place.absolute().parents) if part.is_dir())).free
        there = sum(file.stat().st_size for file in used.iterdir()) if used is not None and used.is_dir() else 0
    wanted = 1.1 * needed - there
    if wanted > free:
        sizes = f"about {wanted / 1e6:.3g} MB are needed, {free / 1e6:.3g} MB are free"
        raise OutputError(f"{shown(place)}: cannot be written ({sizes}), choose another place")


@contextmanager
def unfinished(home: Path) -> Iterator[Path]:
    """A new folder in another one, which is made where it is missing; both vanish in the end, the latter where nothing is in it.

    Entering it tells whether anything can be written there, and sweeps what processes that were killed have left.
    """
    with ExitStack() as cleanup:  # left in reverse order
        make_folders(home, cleanup)
        require_room(home, 2**16)
        sweep(home)
        folder = home / f"{HIDDEN}{_here()}-{os.getpid()}-{secrets.token_hex(8)}"
        cleanup.callback(shutil.rmtree, folder, ignore_errors=True)
        with reporting(home):
            folder.mkdir()
        yield folder


def sweep(home: Path) -> None:
    """Remove what processes of this machine that were killed have left unfinished in a folder, if it is one."""
    ours = re.compile(rf"{re.escape(HIDDEN + _here())}-([0-9]+)-[0-9a-f]{{16}}")
    with suppress(OSError):
        for path in list(home.iterdir()):
            match = ours.fullmatch(path.name)
            if match is not None and not path.is_symlink() and not _alive(int(match[1])):
                shutil.rmtree(path, ignore_errors=True)


def put_in_place(new: Path, final: Path, *, overwrite: bool) -> None:
    """Give a finished file, or a store, its name."""
    with reporting(final):
        if os.path.lexists(final) and not overwrite:
            raise taken(final)
        if is_store(final):  # a folder cannot be replaced, but goes with the unfinished ones
            os.replace(final, new.with_name(f"{new.name}.old"))
        os.replace(new, final)


def _here() -> str:
    """The machine, as a part of a name."""
    return re.sub(r"\W", "_", platform.node())


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
