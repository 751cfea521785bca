"""Results as they go out: the files of a folder appear together, or not at all, also where the process is killed meanwhile.

A folder that does not exist yet takes its name in one rename. Into a folder that exists, files go one by one under a journal: an error
puts back what was there; where the process was killed, the next one that writes to this folder does. Files of others are never touched.
A store (:mod:`bayes_toe.data.stores`) goes as one file does.
"""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from bayes_toe.data.places import finished, make_folders, naming, probe, put_in_place, refuse_impossible, remove_empty, reporting, shown
from bayes_toe.data.stores import is_store, named_store
from bayes_toe.data.unfinished import HIDDEN, flocked, free_name
from bayes_toe.data.whole_files import require_writable
from bayes_toe.errors import OutputError

MANIFEST = ".bayes_toe_files.json"
_JOURNAL = "journal.json"
_WORKSHOP = re.compile(rf"{re.escape(HIDDEN)}[0-9a-f-]+")


@contextmanager
def whole_folder(path: str | Path, names: Sequence[str], *, required: Sequence[str] = (), overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder to write to, whose files move into `path` when the block ends well, and vanish when not.

    Files of the user in `path` are never touched. What is produced there is listed in a manifest, so that a later run
    that may overwrite can also remove what it no longer produces.

    Parameters
    ----------
    path : str or Path
        The folder to be; it may exist.
    names : sequence of str
        Everything that may be produced: files and subfolders at the top of the folder.
    required : sequence of str
        Files that must have been produced, also below subfolders, and be in their places in the end.
    overwrite : bool
        Whether existing `names` may be replaced.

    Yields
    ------
    Path
        An empty folder beside or inside `path`, so that moving the files never crosses a file system.

    Raises
    ------
    OutputError
        If one of `names` exists and may not be replaced, the folder cannot be made or written to, or something required is missing,
        as when someone deleted the folder meanwhile.
    ValueError
        If a name is not a plain name, or something else than `names` was produced.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with whole_folder(Path(folder, "results"), ["a.txt"]) as temporary:
    ...         _ = (temporary / "a.txt").write_text("whole", encoding="utf-8")
    ...     sorted(found.name for found in Path(folder, "results").iterdir())
    ['.bayes_toe_files.json', 'a.txt']
    """
    target = Path(path)
    _require_plain(names)
    put_back(target)
    _refuse_taken_folder(target, names, overwrite)
    with _workshop(target) as workshop:
        with naming(workshop / "new", target):
            yield workshop / "new"
        produced = _produced(workshop, target, names, required)
        earlier = _manifest(target)
        # Other commands may share the folder: what they produced stays listed.
        listed = [*(file for file in earlier if _top(file) not in names), *produced]
        with reporting(target):
            (workshop / "new" / MANIFEST).write_text(json.dumps({"files": sorted(listed)}, indent=1) + "\n", encoding="utf-8")
        stale = [file for file in earlier if overwrite and _top(file) in names and file not in produced]
        _publish(_Move(workshop, target, (*produced, MANIFEST), tuple(stale)), overwrite)
        _require_there(target, required)
    finished.append(target)


@contextmanager
def whole_together(*files: Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder in which to write files of one folder under their names; they take their places together, or none does.

    Raises
    ------
    OutputError
        As :func:`whole_folder`, and where one of the files was not written.
    """
    target, names = files[0].parent, [file.name for file in files]
    put_back(target)
    for file in files:
        require_writable(file, overwrite=overwrite)
    with ExitStack() as made:
        make_folders(target, made)
        with _workshop(target) as workshop:
            with naming(workshop / "new", target):
                yield workshop / "new"
            _publish(_Move(workshop, target, tuple(_produced(workshop, target, names, names)), ()), overwrite)
            _require_there(target, names)
        made.pop_all()
    finished.extend(files)


def require_folder(path: str | Path, names: Sequence[str], *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_folder` would refuse after long work, with its arguments and errors; leaves nothing behind.

    What processes that were killed have left unfinished there is swept.

    Examples
    --------
    >>> require_folder(".", ["no such file"], overwrite=False)
    """
    target = Path(path)
    _require_plain(names)
    put_back(target)
    _refuse_taken_folder(target, names, overwrite)
    with ExitStack() as made:
        make_folders(target, made)
        probe(free_name(target, ""))


def _require_plain(names: Sequence[str]) -> None:
    for name in names:
        if name in ("", ".", "..", MANIFEST) or "/" in name or "\\" in name:
            raise ValueError(f"{name!r} cannot be produced: names are plain names of files or subfolders")


def _refuse_taken_folder(target: Path, names: Sequence[str], overwrite: bool) -> None:
    if os.path.lexists(target) and not os.path.isdir(target):
        raise OutputError(f"{shown(target)}: is a file, choose the name of a folder")
    other = [name for name in names if named_store(target / name) and os.path.isdir(target / name) and not is_store(target / name)]
    if other:
        raise OutputError(f"{shown(target / other[0])}: holds something else than draws, choose another folder")
    taken = [] if overwrite else [name for name in names if os.path.lexists(target / name)]
    if taken:
        more = f" and {len(taken) - 3} more" if len(taken) > 3 else ""
        what = f"already holds {', '.join(taken[:3])}{more}"
        raise OutputError(f"{shown(target)}: {what}, choose another folder or allow to overwrite")


# --- A place to work in, and who works there ------------------------------------------------------


@contextmanager
def _workshop(target: Path) -> Iterator[Path]:
    """A folder beside the target, or inside one that exists; held by a lock, so that the next process knows whether it is in use."""
    with ExitStack() as made, ExitStack() as cleanup:  # left in reverse order
        home = target if os.path.isdir(target) else target.parent
        make_folders(home, made)
        workshop = free_name(home, "")
        cleanup.callback(_clear, workshop)
        with reporting(target):
            for part in (workshop, workshop / "new", workshop / "old"):
                part.mkdir()
                if part == workshop:
                    _lock(part, cleanup)
        yield workshop
        made.pop_all()


def _lock(folder: Path, held: ExitStack) -> bool:
    """Whether this process now holds the folder."""
    with suppress(OSError):
        opened = os.open(folder, os.O_RDONLY)
        held.callback(os.close, opened)
        return flocked(opened) is True  # without locks nothing is known of other processes, and nothing of theirs is swept
    return False


def put_back(target: Path) -> None:
    """Put back and remove what processes that were killed have left beside or inside a folder."""
    refuse_impossible(target)
    for home in {target, target.parent}:
        with suppress(OSError):
            for found in sorted(home.iterdir()):
                if _WORKSHOP.fullmatch(found.name) and found.is_dir() and not found.is_symlink():
                    with ExitStack() as held:
                        if _lock(found, held):
                            _roll_back(found)
                            _clear(found)


def _clear(workshop: Path) -> None:
    """Remove what is no longer needed; what could not be put back yet is."""
    if not os.path.lexists(workshop / _JOURNAL):
        shutil.rmtree(workshop, ignore_errors=True)


# --- From there into place ------------------------------------------------------------------------


def _produced(workshop: Path, target: Path, names: Sequence[str], required: Sequence[str]) -> list[str]:
    """The files that were produced, all that are required among them."""
    new = workshop / "new"
    produced = [found.relative_to(new).as_posix() for found in _pieces(new)]
    unknown = sorted({_top(file) for file in produced}.difference(names))
    if unknown:
        raise ValueError(f"produced without being named: {', '.join(unknown)}")
    _require_there(new, required, target)
    if not (workshop / "old").is_dir():  # the writer may have made new/ again
        raise _gone(target, "its temporary folder")
    return produced


def _pieces(folder: Path) -> Iterator[Path]:
    """All files below a folder; a store is one."""
    for found in sorted(folder.iterdir()):
        if found.is_dir() and not is_store(found):
            yield from _pieces(found)
        else:
            yield found


def _require_there(folder: Path, files: Sequence[str], target: Path | None = None) -> None:
    for file in files:
        if not os.path.lexists(folder / file):
            raise _gone(folder if target is None else target, file)


def _gone(target: Path, what: str) -> OutputError:
    return OutputError(f"{shown(target)}: cannot be written ({what} is missing, deleted meanwhile), choose another place")


@dataclass(frozen=True)
class _Move:
    """From where to where finished files go, and which files of an earlier run go out."""

    workshop: Path
    target: Path
    produced: tuple[str, ...]
    stale: tuple[str, ...]

    def put(self, file: str, *, overwrite: bool) -> None:
        """Give a new file its place, keeping what it replaces: under a second name, never a copy, which may be large."""
        new, final, kept = (folder / file for folder in (self.workshop / "new", self.target, self.workshop / "old"))
        with reporting(final):
            final.parent.mkdir(parents=True, exist_ok=True)
            if overwrite and os.path.lexists(final):
                if final.is_dir() and not final.is_symlink() and not is_store(final):
                    raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
                kept.parent.mkdir(parents=True, exist_ok=True)
                try:
                    os.link(final, kept, follow_symlinks=False)  # so that there is never no file
                except OSError:
                    os.replace(final, kept)
            put_in_place(new, final, overwrite)

    def set_aside(self, file: str) -> None:
        """Take a file away, so that it can still be put back."""
        final, kept = self.target / file, self.workshop / "old" / file
        with reporting(final):
            kept.parent.mkdir(parents=True, exist_ok=True)
            os.replace(final, kept)
            for folder in final.parents[: len(PurePosixPath(file).parts) - 1]:
                remove_empty(folder)


def _publish(move: _Move, overwrite: bool) -> None:
    """Move all that is new into place, and what is stale out of it."""
    if not os.path.lexists(move.target):
        with suppress(OSError):  # someone was quicker: file by file, then
            os.rename(move.workshop / "new", move.target)
            return
    try:
        _write_journal(move)
        for file in move.stale:
            move.set_aside(file)
        for file in move.produced:
            move.put(file, overwrite=overwrite or file == MANIFEST)
        with reporting(move.target):
            (move.workshop / _JOURNAL).unlink()  # from here on, what is in place stays
    except BaseException:
        _roll_back(move.workshop)
        raise


def _write_journal(move: _Move) -> None:
    """What is about to be moved: enough to put everything back, whatever happens to this process."""
    parents = {parent for file in move.produced for parent in PurePosixPath(file).parents}
    journal = {
        "folder": os.path.relpath(move.target, move.workshop.parent),
        "put": {file: _mark(move.workshop / "new" / file) for file in move.produced},
        "aside": move.stale,
        "made": [str(part) for part in sorted(parents, reverse=True) if not os.path.lexists(move.target / part)],
    }
    with reporting(move.target):
        (move.workshop / "journal").write_text(json.dumps(journal), encoding="utf-8")
        os.replace(move.workshop / "journal", move.workshop / _JOURNAL)


def _roll_back(workshop: Path) -> None:
    """Put back what a journal speaks of; may be repeated, and takes up where it was killed. What is not ours any more stays as it is."""
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        journal = json.loads((workshop / _JOURNAL).read_text(encoding="utf-8"))
        target = workshop.parent / _plain_below(journal["folder"])
        put: Mapping[str, list[int]] = journal["put"]
        for file in map(_plain_below, [*put, *journal["aside"]]):
            final, kept = target / file, workshop / "old" / file
            free = not os.path.lexists(final)
            # Empty: the name that is taken first where there are no hard links.
            ours = not free and file in put and (_mark(final) == put[file] or _mark(final)[0] == 0)
            if ours and is_store(final):  # no folder can replace it
                os.replace(final, workshop / "new" / file)
                free, ours = True, False
            if os.path.lexists(kept) and (free or ours):
                final.parent.mkdir(parents=True, exist_ok=True)
                os.replace(kept, final)
            elif ours:
                final.unlink()
        for folder in map(_plain_below, journal["made"]):
            remove_empty(target / folder)
        (workshop / _JOURNAL).unlink()


def _plain_below(name: str) -> str:
    """A name that leads to nothing above or elsewhere: a journal that was edited must not make us touch anything else."""
    if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
        raise ValueError(name)
    return name


def _mark(path: Path) -> list[int]:
    """Size and time of change, which a rename keeps: how a file that we put somewhere is told from another."""
    status = os.lstat(path)
    return [status.st_size, status.st_mtime_ns]


def _top(file: str) -> str:
    return PurePosixPath(file).parts[0]


def _manifest(folder: Path) -> list[str]:
    """What earlier runs produced in a folder and is still there; nothing where the manifest is missing or damaged."""
    try:
        listed = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["files"]
        return [file for file in listed if _inside(folder, file)] if isinstance(listed, list) else []
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _inside(folder: Path, file: object) -> bool:
    """Whether a manifest may speak of this file: a manifest that was edited must not make us remove anything else."""
    if not isinstance(file, str) or ".." in PurePosixPath(file).parts or PurePosixPath(file).as_posix() != file:
        return False
    if not os.path.lexists(folder / file) or (os.path.isdir(folder / file) and not is_store(folder / file)):
        return False
    return (folder / file).parent.resolve().is_relative_to(folder.resolve())
