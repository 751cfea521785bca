"""Writing of results: each file appears whole or not at all, and is complete by itself.

`whole_file` writes one file, and `whole_folder` the files of a folder. `under_way` says how much of
a stopped command is saved.

Files are written in a hidden folder beside their places, are flushed to the disk, and then take
their names one by one. An existing file is replaced only if the caller allows it, and no other file
is touched. If the process is killed while files take their names, files of two runs stand side by
side; no command reads two of them.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from bayes_toe.arrays import StrPath
from bayes_toe.data.messages import Texts, format_path, join_names
from bayes_toe.errors import OutputError, OutputExistsError, require_kind

#: Beginning of the name of a folder whose files are not finished.
HIDDEN = ".bayes_toe-"


@contextmanager
def whole_file(path: StrPath, *, overwrite: bool = False) -> Iterator[Path]:
    """A temporary path, which becomes `path` if the block ends well and is removed otherwise.

    Missing folders are made, and removed again on failure.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, is no regular file, or cannot be written.
    """
    require_kind("path", path, (str, Path), "the name of a file")
    target = Path(path)
    _refuse_taken(target, overwrite)
    with unfinished(target.parent) as new:
        temporary = new / target.name
        # An error names the target, and never the hidden folder.
        with reporting(target, hidden=temporary):
            yield temporary
            _flush(temporary)
        _refuse_taken(target, overwrite)  # it may exist by now
        _put_in_place(temporary, target)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole, also in the place of a file that exists."""
    with whole_file(path, overwrite=True) as temporary:
        temporary.write_bytes(content)


def require_writable(path: StrPath, *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_file` would refuse after long work; leave nothing behind."""
    _refuse_taken(Path(path), overwrite)
    with unfinished(Path(path).parent):
        pass


@contextmanager
def whole_folder(path: StrPath, names: Texts, *, overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder, whose files move into `path` if the block ends well and vanish otherwise.

    A folder that does not exist yet takes its name in one rename; files move one by one into a
    folder that exists. Files of the user in `path` are never touched.

    Parameters
    ----------
    path : str or Path
    names : sequence of str
        Files and subfolders that may be produced. A file of these that is there and is not produced
        is removed if the caller may overwrite.
    overwrite : bool

    Raises
    ------
    OutputError
        As :func:`whole_file`, and if the temporary folder was deleted meanwhile.
    """
    target = Path(path)
    _refuse_taken_folder(target, names, overwrite)
    with unfinished(target if target.is_dir() else target.parent) as new:
        with reporting(target, hidden=new):
            yield new
            new.stat()  # an OSError if the folder was deleted meanwhile
            produced = [file for file in sorted(new.rglob("*")) if file.is_file()]
            for file in produced:
                _flush(file)

        if not os.path.lexists(target):
            _put_in_place(new, target)
            return

        names_produced = [file.relative_to(new).as_posix() for file in produced]
        # All files are checked before the first one moves.
        for name in names_produced:
            _refuse_taken(target / name, overwrite)
        for name in names_produced:
            _put_in_place(new / name, target / name)

        if overwrite:
            for name in set(names).difference(names_produced):
                _remove(target, name)  # a file only: a name that is a subfolder stays


def require_folder(path: StrPath, names: Texts, *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_folder` would refuse after long work; leave nothing behind."""
    target = Path(path)
    _refuse_taken_folder(target, names, overwrite)
    with unfinished(target if target.is_dir() else target.parent):
        pass


def refuse_impossible(target: Path) -> None:
    """Refuse names that no file can have here, such as a name that is too long."""
    # The system says so when it looks for the file, which need not exist.
    with reporting(target), suppress(FileNotFoundError):
        os.lstat(target)


def _refuse_taken(target: Path, overwrite: bool) -> None:
    """Refuse a file that exists and may not be replaced, and what is no regular file."""
    refuse_impossible(target)
    if target.is_dir():
        raise OutputError(f"{format_path(target)}: is a folder, choose the name of a file")

    if not os.path.lexists(target):
        return
    if not overwrite:
        raise OutputExistsError(f"{format_path(target)}: exists")
    if not stat.S_ISREG(os.lstat(target).st_mode):
        raise OutputError(f"{format_path(target)}: is a link, pipe or device, choose another name")


def _refuse_taken_folder(target: Path, names: Texts, overwrite: bool) -> None:
    """Refuse a file in the place of a folder, and files in it that may not be replaced."""
    refuse_impossible(target)
    if os.path.lexists(target) and not target.is_dir():
        raise OutputError(f"{format_path(target)}: is a file, choose the name of a folder")

    if overwrite:
        return
    taken = [name for name in names if os.path.lexists(target / name)]
    if taken:
        raise OutputExistsError(
            f"{format_path(target)}: already holds {join_names(taken, max_items=3)}"
        )


def _put_in_place(new: Path, final: Path) -> None:
    """Give a finished file its name, with the permissions of the file that it replaces."""
    with reporting(final):
        final.parent.mkdir(parents=True, exist_ok=True)
        if final.is_file():
            os.chmod(new, stat.S_IMODE(final.stat().st_mode))
        os.replace(new, final)


def _flush(file: Path) -> None:
    """Wait until the content of a file is on the disk."""
    with open(file, "rb+") as content:
        os.fsync(content.fileno())


def _remove(folder: Path, name: str) -> None:
    """Remove a file of an earlier run, and its subfolder where nothing else is in it."""
    file = folder / name
    # A subfolder may be a link to a folder elsewhere.
    is_inside = file.parent.resolve().is_relative_to(folder.resolve())
    if is_inside and file.is_file() and not file.is_symlink():
        with reporting(file):
            file.unlink()
        remove_empty(file.parent)


# --- Places to write to ---------------------------------------------------------------------------


@contextmanager
def reporting(target: Path, hidden: Path | None = None) -> Iterator[None]:
    """Turn an error of the operating system into an OutputError: path, reason and what to do.

    A hidden path in its message becomes the path of the target.
    """
    try:
        yield
    except OSError as error:
        if isinstance(error, OutputError):  # an inner block has made such a message
            message = str(error)
        else:
            reason = error.strerror or error
            message = f"{format_path(target)}: cannot be written ({reason}), choose another place"
        if hidden is not None:
            message = message.replace(format_path(hidden), format_path(target))
        raise OutputError(message) from error


def remove_empty(folder: Path) -> None:
    """Remove a folder where it is empty."""
    with suppress(OSError):
        folder.rmdir()


@contextmanager
def unfinished(home: Path) -> Iterator[Path]:
    """A new hidden folder in `home`, which is made, with its parents, where it is missing.

    In the end the hidden folder vanishes, and so do the folders made if nothing is in them.
    Entering the block shows whether anything can be written there.
    """
    with ExitStack() as cleanup:  # it works backwards: inner folders go before outer ones
        for outer in reversed((home, *home.parents)):
            if not os.path.lexists(outer):
                cleanup.callback(remove_empty, outer)
        with reporting(home):
            home.mkdir(parents=True, exist_ok=True)
            hidden = TemporaryDirectory(prefix=HIDDEN, dir=home, ignore_cleanup_errors=True)
            folder = Path(cleanup.enter_context(hidden), "new")
            folder.mkdir()  # with the permissions of other folders
        yield folder


# --- How far the work of a command is -----------------------------------------------------------


class Standing(NamedTuple):
    """The files of all results that are wanted, and how many existed before."""

    files: Collection[Path]
    taken: int


#: The work of the running command by folder of results; a signal handler reports it.
under_way: dict[Path, Standing] = {}


def describe_stored() -> str:
    """How many subjects are saved that `--resume` need not compute again; empty for no subject."""
    parts = []
    for folder, standing in under_way.items():
        n_stored = sum(map(os.path.exists, standing.files))
        if n_stored:
            parts.append(f"{n_stored} of {len(standing.files)} subjects are saved in {folder}")
    return f"{', '.join(parts)}; type --resume to continue" if parts else ""
