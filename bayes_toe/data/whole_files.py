"""Writing of results: each file appears whole or not at all, and so do the files of a set.

`whole_file` writes one file, `whole_together` a set, and `whole_folder` a folder.
`under_way` says how much of a stopped command is saved.

Files are written in a hidden folder beside their places and then take their names. An existing
file is replaced only if the caller allows it, and no other file is touched. A set of files is
complete in its hidden folder before the first file moves; that folder is then marked as ready. If
the process is killed while files move, the rest stays there: reading a file of the set is refused
(:func:`require_settled`), and the next command that writes to the folder finishes the moves.
"""

from __future__ import annotations

import json
import os
import platform
import re
import secrets
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from bayes_toe.arrays import StrPath
from bayes_toe.data.messages import format_path, join_names
from bayes_toe.errors import InputError, OutputError, OutputExistsError

#: Beginning of the name of a folder whose files are not finished, and of one whose files are
#: complete and about to move; the machine and the process follow.
HIDDEN, READY = ".bayes_toe-", ".bayes_toe_ready-"
#: In a folder of results, the list of the files that are ours.
MANIFEST = ".bayes_toe_files.json"
#: Files and folders that this process has finished; a signal handler reports them.
finished: list[Path] = []


@contextmanager
def whole_file(path: StrPath, *, overwrite: bool = False) -> Iterator[Path]:
    """A temporary path, which becomes `path` if the block ends well and is removed otherwise.

    Missing folders are made, and removed again on failure.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, is no regular file, or cannot be written.
    """
    with whole_together(Path(path), overwrite=overwrite) as folder:
        yield folder / Path(path).name


@contextmanager
def whole_together(*files: Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder for files of one folder, which take their places when all are there.

    Raises
    ------
    OutputError
        As :func:`whole_file`, and if one of the files was not written.
    """
    home, names = files[0].parent, [file.name for file in files]
    for file in files:
        _refuse_taken(file, overwrite)
    with unfinished(home) as new:
        with reporting(home, hidden=new), reporting(files[0] if len(files) == 1 else home):
            yield new
        _publish(new, home, names, overwrite)
    _finish(*files)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole, in the place of one that exists."""
    with whole_file(path, overwrite=True) as temporary:
        temporary.write_bytes(content)


def require_writable(path: StrPath, *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_file` would refuse after long work; leave nothing behind."""
    _refuse_taken(Path(path), overwrite)
    with unfinished(Path(path).parent):
        pass


@contextmanager
def whole_folder(
    path: StrPath, names: Sequence[str], *, required: Sequence[str] = (), overwrite: bool = False
) -> Iterator[Path]:
    """A temporary folder, whose files move into `path` if the block ends well and vanish otherwise.

    A folder that does not exist yet takes its name in one rename; into one that exists, files move
    one by one, the manifest last. Files of the user in `path` are never touched. The manifest lists
    what was produced, so that a later run that may overwrite can remove what it no longer produces.

    Parameters
    ----------
    path : str or Path
    names : sequence of str
        Files and subfolders that may be produced at the top of the folder.
    required : sequence of str
        Files that must be produced, also below subfolders.
    overwrite : bool

    Raises
    ------
    OutputError
        As :func:`whole_file`, and if a required file is missing.
    ValueError
        If a file was produced that `names` does not hold.
    """
    target = Path(path)
    _refuse_taken_folder(target, names, overwrite)
    with unfinished(target if target.is_dir() else target.parent) as new:
        with reporting(target, hidden=new):
            yield new
            _require_there(new, target, required)
            files = [path for path in sorted(new.rglob("*")) if not path.is_dir()]
            produced = [file.relative_to(new).as_posix() for file in files]
            unknown = sorted({file.split("/")[0] for file in produced}.difference(names))
            if unknown:
                raise ValueError(f"produced without being named: {', '.join(unknown)}")
            earlier = _listed_files(target)
            # Other commands may share the folder: what they produced stays listed.
            ours = {*produced, *(file for file in earlier if file.split("/")[0] not in names)}
            (new / MANIFEST).write_text(
                json.dumps({"files": sorted(ours)}, indent=1) + "\n", encoding="utf-8"
            )
        if not os.path.lexists(target):
            _put_in_place(new, target)
        else:
            _publish(new, target, produced, overwrite, last=MANIFEST)
            for file in set(earlier) - ours if overwrite else ():
                _remove(target, file)
    _finish(target)


def require_folder(path: StrPath, names: Sequence[str], *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_folder` would refuse after long work; leave nothing behind."""
    target = Path(path)
    _refuse_taken_folder(target, names, overwrite)
    with unfinished(target if target.is_dir() else target.parent):
        pass


def _refuse_impossible(target: Path) -> None:
    """Refuse names that no file can have here, such as a name that is too long."""
    if "\0" in str(target):
        raise OutputError(
            f"{format_path(target)}: cannot be written (it has a NUL character), choose another "
            "name"
        )
    with reporting(target), suppress(FileNotFoundError):
        os.lstat(target)


def _refuse_taken(target: Path, overwrite: bool) -> None:
    _refuse_impossible(target)
    if target.is_dir():
        raise OutputError(f"{format_path(target)}: is a folder, choose the name of a file")
    if not os.path.lexists(target):
        return
    if not overwrite:
        raise OutputExistsError(f"{format_path(target)}: exists")
    if not stat.S_ISREG(os.lstat(target).st_mode):
        raise OutputError(f"{format_path(target)}: is a link, pipe or device, choose another name")


def _refuse_taken_folder(target: Path, names: Sequence[str], overwrite: bool) -> None:
    _refuse_impossible(target)
    if os.path.lexists(target) and not target.is_dir():
        raise OutputError(f"{format_path(target)}: is a file, choose the name of a folder")
    if overwrite:
        return
    taken = [name for name in names if os.path.lexists(target / name)]
    if taken:
        raise OutputExistsError(f"{format_path(target)}: already holds {join_names(taken, 3)}")


def _require_there(new: Path, target: Path, files: Sequence[str]) -> None:
    for file in files:
        if not os.path.lexists(new / file):
            raise OutputError(
                f"{format_path(target)}: cannot be written ({file} is missing, deleted meanwhile), "
                "choose another place"
            )


def _publish(
    new: Path, target: Path, files: Sequence[str], overwrite: bool, last: str | None = None
) -> None:
    """Move files into a folder that exists, `last` after all others.

    What cannot be placed is refused before the first file moves.
    """
    _require_there(new, target / files[0] if len(files) == 1 else target, files)
    for file in files:
        _refuse_taken(target / file, overwrite)
    if last is not None:
        files = [*files, last]
    if len(files) == 1:
        _put_in_place(new / files[0], target / files[0])
        return
    ready = new.with_name(new.name.replace(HIDDEN, READY))
    with reporting(target):
        (new / _ORDER).write_text(json.dumps(list(files)), encoding="utf-8")
        os.rename(new, ready)
    try:
        _move_all(ready, target)
    except OutputError:
        raise
    except BaseException:
        # A signal that arrives while files move must not leave a set half replaced.
        _move_all(ready, target)
        raise
    finally:
        shutil.rmtree(ready, ignore_errors=True)


#: In a ready folder, the list of its files in the order in which they move.
_ORDER = ".order.json"


def _files_of(ready: Path) -> list[str]:
    """The files of a ready folder in their order; none if its removal has begun."""
    try:
        return json.loads((ready / _ORDER).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return []


def _move_all(ready: Path, target: Path) -> None:
    """Give the files of a ready folder their names, as far as they have not moved yet."""
    for file in _files_of(ready):
        if os.path.lexists(ready / file):
            with reporting(target / file):
                (target / file).parent.mkdir(parents=True, exist_ok=True)
            _put_in_place(ready / file, target / file)


def _put_in_place(new: Path, final: Path) -> None:
    """Give a finished file its name, with the permissions of the file that it replaces."""
    with reporting(final):
        if final.is_file():
            os.chmod(new, stat.S_IMODE(final.stat().st_mode))
        os.replace(new, final)


def require_settled(path: StrPath) -> None:
    """Refuse a file of a set that a killed command has replaced only in part.

    Raises
    ------
    InputError
        If a command that wrote to the folder of the file was killed while its files moved.
    """
    file = Path(path)
    for folder in file.parent.glob(f"{READY}*"):
        if file.name in _files_of(folder) and not _is_of_living_process(folder.name, READY):
            raise InputError(
                f"{format_path(file)}: a command was stopped while it replaced the files of "
                "this folder, and they may be of two runs; run that command again"
            )


def _finish(*targets: Path) -> None:
    for target in targets:
        if not any(part.startswith(HIDDEN) for part in target.parts):
            finished.append(target)


def _listed_files(folder: Path) -> list[str]:
    """Files in a folder that its manifest lists; none if the manifest is missing or damaged."""
    inside = []
    try:
        for name in json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["files"]:
            file = folder / str(name)
            # Not through links, nor by `..`, into another folder.
            if file.is_file() and file.parent.resolve().is_relative_to(folder.resolve()):
                inside.append(str(name))
    except (OSError, ValueError, LookupError, TypeError):
        return []
    return inside


def _remove(folder: Path, file: str) -> None:
    """Remove what an earlier run produced, and subfolders where nothing else is in them."""
    path = folder / file
    with reporting(path):
        path.unlink()
    for part in path.relative_to(folder).parents[:-1]:
        remove_empty(folder / part)


# --- Places to write to ---------------------------------------------------------------------------


@contextmanager
def reporting(target: Path, hidden: Path | None = None) -> Iterator[None]:
    """Turn an error of the operating system into one line with the path and what to do.

    A hidden path in the line becomes the path of the target.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        message = f"{format_path(target)}: cannot be written ({reason}), choose another place"
        if isinstance(error, OutputError):
            message = str(error)
        if hidden is not None:
            message = message.replace(format_path(hidden), format_path(target))
        raise OutputError(message) from error


def make_folders(folder: Path, made: ExitStack) -> None:
    """Make what is missing of a folder; closing `made` removes it again where it is empty."""
    missing = [part for part in (folder, *folder.parents) if not os.path.lexists(part)]
    for part in reversed(missing):
        made.callback(remove_empty, part)
    with reporting(folder):
        folder.mkdir(parents=True, exist_ok=True)


def remove_empty(folder: Path) -> None:
    """Remove a folder where it is empty."""
    with suppress(OSError):
        folder.rmdir()


@contextmanager
def unfinished(home: Path) -> Iterator[Path]:
    """A new hidden folder in another one, which is made where it is missing.

    Both vanish in the end, the outer one only if nothing is in it. Entering the block shows whether
    anything can be written there, and cleans up after processes that were killed.
    """
    with ExitStack() as cleanup:  # left in reverse order
        make_folders(home, cleanup)
        sweep(home)
        folder = home / f"{HIDDEN}{_machine()}-{os.getpid()}-{secrets.token_hex(8)}"
        cleanup.callback(shutil.rmtree, folder, ignore_errors=True)
        with reporting(home):
            folder.mkdir()
        yield folder


def sweep(home: Path) -> None:
    """Clean up after killed processes of this machine: finish what is ready, remove the rest."""
    with suppress(OSError):
        for path in list(home.iterdir()):
            if path.is_symlink() or not path.is_dir():
                continue
            if path.name.startswith(READY) and not _is_of_living_process(path.name, READY):
                with suppress(OSError):
                    _move_all(path, home)
                    shutil.rmtree(path, ignore_errors=True)
            elif path.name.startswith(HIDDEN) and not _is_of_living_process(path.name, HIDDEN):
                shutil.rmtree(path, ignore_errors=True)


def _is_of_living_process(name: str, beginning: str) -> bool:
    """Whether a hidden folder belongs to a process that may still run.

    Folders of other machines, and folders whose names are not ours, count as such.
    """
    pattern = rf"{re.escape(beginning + _machine())}-([0-9]{{1,9}})-[0-9a-f]{{16}}"
    match = re.fullmatch(pattern, name)
    return match is None or _alive(int(match[1]))


def _machine() -> str:
    """The machine, as a part of a name."""
    return re.sub(r"\W", "_", platform.node())


def _alive(pid: int) -> bool:
    """Whether there is such a process; assumed where that cannot be asked without harm."""
    try:
        os.kill(pid, 0) if os.name == "posix" else None
    except OSError as error:
        return not isinstance(error, ProcessLookupError)
    return True


# --- How far the work of a command is -----------------------------------------------------------


@dataclass(frozen=True)
class Standing:
    """Numbers of results of `what`: stored before (`taken`), stored now, and wanted (`jobs`)."""

    taken: int
    done: int
    jobs: int
    what: str


#: By folder of results; a signal handler reports it.
under_way: dict[Path, Standing] = {}


def describe_stored() -> str:
    """The stored results that another call need not compute again; empty if there are none."""
    parts = [
        f"{standing.done} of {standing.jobs} {standing.what} are saved in {folder}"
        for folder, standing in under_way.items()
        if standing.done
    ]
    if not parts:
        return ""
    return f"{', '.join(parts)}; type --resume to continue"
