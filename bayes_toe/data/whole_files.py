"""Results as they go out: every file appears whole, by a rename, or not at all; the files of a new folder appear together.

They are written in a hidden folder beside their places. An existing file is replaced only where the caller says so, and files of others
are never touched. What a failed or interrupted run leaves behind is what was there before it.
"""

from __future__ import annotations

import json
import os
import platform
import re
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from bayes_toe.data.messages import shown
from bayes_toe.errors import OutputError

#: How the name of a folder begins whose files are not finished; the machine and the process that writes them follow.
HIDDEN = ".bayes_toe-"
#: In a folder of results, the list of those that are ours.
MANIFEST = ".bayes_toe_files.json"
#: Files and folders that this process has finished, for whoever has to say so when it is stopped.
finished: list[Path] = []


@contextmanager
def whole_file(path: str | Path, *, overwrite: bool = False) -> Iterator[Path]:
    """A temporary path to write to, of the same name, which becomes `path` when the block ends well and is removed when it does not.

    Missing folders are made, and removed again on failure. An OutputError where the file exists and may not be replaced, is a folder, or it
    or its folder cannot be made or written to.
    """
    with whole_together(Path(path), overwrite=overwrite) as folder:
        yield folder / Path(path).name


@contextmanager
def whole_together(*files: Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder in which to write files of one folder under their names; they take their places when all are there.

    Errors as of :func:`whole_file`, and where one of the files was not written.
    """
    home, names = files[0].parent, [file.name for file in files]
    for file in files:
        _refuse_taken(file, overwrite)
    with unfinished(home) as new:
        with reporting(home, hidden=new), reporting(files[0] if len(files) == 1 else home):
            yield new
        _publish(new, home, names, overwrite)
    _finish(*files)


def require_writable(path: str | Path, *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_file` would refuse after long work, with its arguments and errors; leaves nothing behind."""
    _refuse_taken(Path(path), overwrite)
    with unfinished(Path(path).parent):
        pass


@contextmanager
def whole_folder(
    path: str | Path, names: Sequence[str], *, required: Sequence[str] = (), overwrite: bool = False
) -> Iterator[Path]:
    """A temporary folder to write to, whose files move into `path` when the block ends well, and vanish when not.

    A folder that does not exist yet takes its name in one rename; into one that exists, files go one by one. Files of the user in `path`
    are never touched. What is produced there is listed in a manifest, so that a later run that may overwrite can also remove what it no
    longer produces. `names` are all files and subfolders that may be produced at the top of the folder (a ValueError for others),
    `required` the files that must be, also below subfolders. Errors as of :func:`whole_file`, and where something required is missing.
    """
    target = Path(path)
    _refuse_taken_folder(target, names, overwrite)
    with unfinished(target if target.is_dir() else target.parent) as new:
        with reporting(target, hidden=new):
            yield new
            _require_there(new, target, required)
            produced = [file.relative_to(new).as_posix() for file in _pieces(new)]
            unknown = sorted({file.split("/")[0] for file in produced}.difference(names))
            if unknown:
                raise ValueError(f"produced without being named: {', '.join(unknown)}")
            earlier = _manifest(target)
            # Other commands may share the folder: what they produced stays listed.
            ours = {*produced, *(file for file in earlier if file.split("/")[0] not in names)}
            (new / MANIFEST).write_text(
                json.dumps({"files": sorted(ours)}, indent=1) + "\n", encoding="utf-8"
            )
        if not os.path.lexists(target):
            _put_in_place(new, target)
        else:
            _publish(new, target, produced, overwrite)
            _put_in_place(new / MANIFEST, target / MANIFEST)
            for file in set(earlier) - ours if overwrite else ():
                _remove(target, file)
    _finish(target)


def require_folder(path: str | Path, names: Sequence[str], *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_folder` would refuse after long work, with its arguments and errors; leaves nothing behind."""
    target = Path(path)
    _refuse_taken_folder(target, names, overwrite)
    with unfinished(target if target.is_dir() else target.parent):
        pass


def _refuse_impossible(target: Path) -> None:
    """Refuse names that no file can have here, such as a name that is too long."""
    if "\0" in str(target):
        raise OutputError(
            f"{shown(target)}: cannot be written (it has a NUL character), choose another name"
        )
    with reporting(target), suppress(FileNotFoundError):
        os.lstat(target)


def _refuse_taken(target: Path, overwrite: bool) -> None:
    _refuse_impossible(target)
    if target.is_dir():
        raise OutputError(f"{shown(target)}: is a folder, choose the name of a file")
    if not overwrite and os.path.lexists(target):
        raise OutputError(f"{shown(target)}: exists, choose another name or allow to overwrite it")


def _refuse_taken_folder(target: Path, names: Sequence[str], overwrite: bool) -> None:
    _refuse_impossible(target)
    if os.path.lexists(target) and not target.is_dir():
        raise OutputError(f"{shown(target)}: is a file, choose the name of a folder")
    there = [] if overwrite else [name for name in names if os.path.lexists(target / name)]
    if there:
        more = f" and {len(there) - 3} more" if len(there) > 3 else ""
        what = f"already holds {', '.join(there[:3])}{more}"
        raise OutputError(f"{shown(target)}: {what}, choose another folder or allow to overwrite")


def _require_there(new: Path, target: Path, files: Sequence[str]) -> None:
    for file in files:
        if not os.path.lexists(new / file):
            raise OutputError(
                f"{shown(target)}: cannot be written ({file} is missing, deleted meanwhile), choose another place"
            )


def _publish(new: Path, target: Path, files: Sequence[str], overwrite: bool) -> None:
    """Move files into a folder that exists; what cannot be placed is refused before the first one moves."""
    _require_there(new, target / files[0] if len(files) == 1 else target, files)
    for file in files:
        _refuse_taken(target / file, overwrite)
    for file in files:
        with reporting(target / file):
            (target / file).parent.mkdir(parents=True, exist_ok=True)
        _put_in_place(new / file, target / file)


def _put_in_place(new: Path, final: Path) -> None:
    """Give a finished file its name."""
    with reporting(final):
        os.replace(new, final)


def _finish(*targets: Path) -> None:
    finished.extend(
        target for target in targets if not any(part.startswith(HIDDEN) for part in target.parts)
    )


def _pieces(folder: Path) -> Iterator[Path]:
    """All files below a folder."""
    for found in sorted(folder.iterdir()):
        if found.is_dir():
            yield from _pieces(found)
        else:
            yield found


def _manifest(folder: Path) -> list[str]:
    """What earlier runs produced in a folder and is still there, not elsewhere; nothing where the manifest is missing or damaged."""
    try:
        files = [
            str(file)
            for file in json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["files"]
        ]
        there = [file for file in files if (folder / file).is_file()]
        return [
            file
            for file in there
            if (folder / file).parent.resolve().is_relative_to(folder.resolve())
        ]
    except (OSError, ValueError, LookupError, TypeError):
        return []


def _remove(folder: Path, file: str) -> None:
    """Remove what an earlier run produced, and subfolders where nothing else is in them."""
    path = folder / file
    with reporting(path):
        path.unlink()
    for part in path.relative_to(folder).parents[:-1]:
        remove_empty(folder / part)


# --- Places: what they are, whether they can be written to, and what stands there unfinished ---------------


@contextmanager
def reporting(target: Path, hidden: Path | None = None) -> Iterator[None]:
    """Turn what the operating system says into one line with the path and a way out; a hidden path in it becomes that path."""
    try:
        yield
    except OSError as error:
        plain = (
            f"{shown(target)}: cannot be written ({error.strerror or error}), choose another place"
        )
        said = str(error) if isinstance(error, OutputError) else plain
        raise OutputError(
            said if hidden is None else said.replace(shown(hidden), shown(target))
        ) from error


def make_folders(folder: Path, made: ExitStack) -> None:
    """Make what is missing of a folder; closing `made` removes it again where it is empty."""
    for part in reversed([part for part in (folder, *folder.parents) if not os.path.lexists(part)]):
        made.callback(remove_empty, part)
    with reporting(folder):
        folder.mkdir(parents=True, exist_ok=True)


def remove_empty(folder: Path) -> None:
    """Remove a folder where it is empty."""
    with suppress(OSError):
        folder.rmdir()


def require_room(place: Path, needed: int, *, used: Path | None = None) -> None:
    """Refuse now what will not fit on the disk, with a tenth to spare: about `needed` bytes, of which the folder `used` holds some."""
    with reporting(place):
        free = shutil.disk_usage(
            next(part for part in (place.absolute(), *place.absolute().parents) if part.is_dir())
        ).free
        there = (
            sum(file.stat().st_size for file in used.iterdir())
            if used is not None and used.is_dir()
            else 0
        )
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
    ours = re.compile(rf"{re.escape(HIDDEN + _here())}-([0-9]{{1,9}})-[0-9a-f]{{16}}")
    with suppress(OSError):
        for path in list(home.iterdir()):
            match = ours.fullmatch(path.name)
            if match is not None and not path.is_symlink() and not _alive(int(match[1])):
                shutil.rmtree(path, ignore_errors=True)


def _here() -> str:
    """The machine, as a part of a name."""
    return re.sub(r"\W", "_", platform.node())


def _alive(pid: int) -> bool:
    """Whether there is such a process; assumed where that cannot be asked without harm."""
    try:
        os.kill(pid, 0) if os.name == "posix" else None
    except OSError as error:
        return not isinstance(error, ProcessLookupError)
    return True


# --- How far the work is whose results a folder keeps -------------------------------------------------------


@dataclass(frozen=True)
class Standing:
    """How many results of `what` were there before (`taken`), are there (`done`), and will be (`jobs`)."""

    taken: int
    done: int
    jobs: int
    what: str


#: By folder, as far as this process knows: for whoever has to say so when it is stopped.
under_way: dict[Path, Standing] = {}


def said_kept() -> str:
    """What another call need not compute again; empty where that is nothing."""
    said = [
        f"{one.done} of {one.jobs} {one.what} kept in {folder}"
        for folder, one in under_way.items()
        if one.done
    ]
    return f"{', '.join(said)}, go on with --resume" if said else ""
