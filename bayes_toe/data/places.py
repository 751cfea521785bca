"""Places of outputs: whether one can be written to, its missing folders, and the step by which a finished file takes its name."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from bayes_toe.errors import OutputError

#: Files and folders that this process has finished, for whoever has to say so when it is stopped.
finished: list[Path] = []


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
def reporting(target: Path) -> Iterator[None]:
    """Turn what the operating system says into one line with the path and a way out."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        reason = error.strerror if error.strerror is not None else str(error)
        raise OutputError(f"{shown(target)}: cannot be written ({reason}), choose another place") from error


@contextmanager
def naming(hidden: Path, target: Path) -> Iterator[None]:
    """The same for what is written elsewhere: with the path that a reader knows in place of the other."""
    try:
        with reporting(target):
            yield
    except OutputError as error:
        raise OutputError(str(error).replace(shown(hidden), shown(target))) from error


def make_folders(folder: Path, made: ExitStack) -> None:
    """Make what is missing of a folder; closing `made` removes it again where it is empty."""
    missing = [part for part in (folder, *folder.parents) if not os.path.lexists(part)]
    for part in reversed(missing):
        with reporting(part):
            part.mkdir(exist_ok=True)
        made.callback(remove_empty, part)


def require_room(place: Path, needed: int) -> None:
    """Refuse now what will not fit on the disk, with a tenth to spare; `needed` is an estimate, in bytes."""
    with reporting(place):
        free = shutil.disk_usage(next(part for part in (place.absolute(), *place.absolute().parents) if part.is_dir())).free
    if 1.1 * needed > free:
        sizes = f"about {1.1 * needed / 1e6:.3g} MB are needed, {free / 1e6:.3g} MB are free"
        raise OutputError(f"{shown(place)}: cannot be written ({sizes}), choose another place")


def probe(path: Path) -> None:
    """Create and remove a file, the only test of permission that holds on every system; refuse a disk that is full."""
    require_room(path.parent, 2**16)
    with reporting(path.parent):
        try:
            path.touch(exist_ok=False)
        finally:
            path.unlink(missing_ok=True)


def put_in_place(new: Path, final: Path, overwrite: bool) -> None:
    """Give a finished file, or a store, its name; without `overwrite`, never at the cost of a file that appeared meanwhile.

    The temporary name may remain: whoever made it removes it.
    """
    if overwrite or (new.is_dir() and not os.path.lexists(final)):  # a folder has no second name, and replaces none
        os.replace(new, final)
        return
    try:
        os.link(new, final)  # unlike a rename, a link never replaces
    except FileExistsError:
        raise taken(final) from None
    except OSError:
        _claim(new, final)


def _claim(new: Path, final: Path) -> None:
    """The same on file systems without hard links: take the name first, then replace what is ours."""
    try:
        final.touch(exist_ok=False)
    except FileExistsError:
        raise taken(final) from None
    try:
        os.replace(new, final)
    except BaseException:
        remove(final)
        raise


def remove(path: Path) -> None:
    """Remove a file where that is possible."""
    with suppress(OSError):
        path.unlink()


def remove_empty(folder: Path) -> None:
    """Remove a folder where it is empty."""
    with suppress(OSError):
        folder.rmdir()
