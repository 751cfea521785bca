"""Results as they go out: every file appears whole, by a rename, or not at all; the files of a new folder appear together.

They are written in a hidden folder beside their places. An existing file is replaced only where the caller says so, and files of others
are never touched. What a failed or interrupted run leaves behind is what was there before it.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from bayes_toe.data.places import HIDDEN, put_in_place, refuse_impossible, remove_empty, reporting, shown, taken, unfinished
from bayes_toe.data.stores import is_store, named_store
from bayes_toe.errors import OutputError

#: In a folder of results, the list of those that are ours.
MANIFEST = ".bayes_toe_files.json"
#: Files and folders that this process has finished, for whoever has to say so when it is stopped.
finished: list[Path] = []


@contextmanager
def whole_file(path: str | Path, *, overwrite: bool = False) -> Iterator[Path]:
    """A temporary path to write to, which becomes `path` when the block ends well and is removed when it does not.

    Parameters
    ----------
    path : str or Path
        The file to be; missing folders are made, and removed again on failure.
    overwrite : bool
        Whether an existing file may be replaced.

    Yields
    ------
    Path
        A path that does not exist yet, of the same name, on the same file system.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, is a folder, or it or its folder cannot be made or written to.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with whole_file(Path(folder, "new", "a.txt")) as temporary:
    ...         _ = temporary.write_text("whole", encoding="utf-8")
    ...     Path(folder, "new", "a.txt").read_text(encoding="utf-8")
    'whole'
    """
    with whole_together(Path(path), overwrite=overwrite) as folder:
        yield folder / Path(path).name


@contextmanager
def whole_together(*files: Path, overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder in which to write files of one folder under their names; they take their places when all are there.

    Raises
    ------
    OutputError
        As :func:`whole_file`, and where one of the files was not written.
    """
    home, names = files[0].parent, [file.name for file in files]
    for file in files:
        _refuse_taken(file, overwrite)
    with unfinished(home) as new:
        with reporting(home, hidden=new), reporting(files[0] if len(files) == 1 else home):
            yield new
            _require_there(new, home, names if len(names) > 1 else ())
        _publish(new, home, names, overwrite)
    _finish(*files)


def require_writable(path: str | Path, *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_file` would refuse after long work, with its arguments and errors; leaves nothing behind.

    Examples
    --------
    >>> require_writable(".", overwrite=True)
    Traceback (most recent call last):
        ...
    bayes_toe.errors.OutputError: .: is a folder, choose the name of a file
    """
    _refuse_taken(Path(path), overwrite)
    with unfinished(Path(path).parent):
        pass


def _refuse_taken(target: Path, overwrite: bool) -> None:
    refuse_impossible(target)
    if os.path.isdir(target) and not is_store(target):
        what = "holds something else than draws, choose another name" if named_store(target) else "is a folder, choose the name of a file"
        raise OutputError(f"{shown(target)}: {what}")
    if not overwrite and os.path.lexists(target):
        raise taken(target)


@contextmanager
def whole_folder(path: str | Path, names: Sequence[str], *, required: Sequence[str] = (), overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder to write to, whose files move into `path` when the block ends well, and vanish when not.

    A folder that does not exist yet takes its name in one rename; into one that exists, files go one by one. Files of the user in `path`
    are never touched. What is produced there is listed in a manifest, so that a later run that may overwrite can also remove what it no
    longer produces.

    Parameters
    ----------
    path : str or Path
        The folder to be; it may exist.
    names : sequence of str
        Everything that may be produced: files and subfolders at the top of the folder.
    required : sequence of str
        Files that must have been produced, also below subfolders.
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
    _refuse_taken_folder(target, names, overwrite)
    with unfinished(target if target.is_dir() else target.parent) as new:
        with reporting(target, hidden=new):
            yield new
            _require_there(new, target, required)
            produced = [file.relative_to(new).as_posix() for file in _pieces(new)]
            earlier = _manifest(target)
            # Other commands may share the folder: what they produced stays listed.
            listed = {*produced, *(file for file in earlier if _top(file) not in names)}
            (new / MANIFEST).write_text(json.dumps({"files": sorted(listed)}, indent=1) + "\n", encoding="utf-8")
        unknown = sorted({_top(file) for file in produced}.difference(names))
        if unknown:
            raise ValueError(f"produced without being named: {', '.join(unknown)}")
        if not os.path.lexists(target):
            put_in_place(new, target, overwrite=False)
        else:
            _publish(new, target, produced, overwrite)
            put_in_place(new / MANIFEST, target / MANIFEST, overwrite=True)
            for file in set(earlier) - listed if overwrite else ():
                _remove(target, file)
    _finish(target)


def require_folder(path: str | Path, names: Sequence[str], *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_folder` would refuse after long work, with its arguments and errors; leaves nothing behind.

    Examples
    --------
    >>> require_folder(".", ["no such file"], overwrite=False)
    """
    target = Path(path)
    _refuse_taken_folder(target, names, overwrite)
    with unfinished(target if target.is_dir() else target.parent):
        pass


def _refuse_taken_folder(target: Path, names: Sequence[str], overwrite: bool) -> None:
    for name in names:
        if name in ("", ".", "..", MANIFEST) or "/" in name or "\\" in name:
            raise ValueError(f"{name!r} cannot be produced: names are plain names of files or subfolders")
    refuse_impossible(target)
    if os.path.lexists(target) and not target.is_dir():
        raise OutputError(f"{shown(target)}: is a file, choose the name of a folder")
    other = [name for name in names if named_store(target / name) and (target / name).is_dir() and not is_store(target / name)]
    if other:
        raise OutputError(f"{shown(target / other[0])}: holds something else than draws, choose another folder")
    there = [] if overwrite else [name for name in names if os.path.lexists(target / name)]
    if there:
        more = f" and {len(there) - 3} more" if len(there) > 3 else ""
        what = f"already holds {', '.join(there[:3])}{more}"
        raise OutputError(f"{shown(target)}: {what}, choose another folder or allow to overwrite")


def _pieces(folder: Path) -> Iterator[Path]:
    """All files below a folder; a store is one."""
    for found in sorted(folder.iterdir()):
        if found.is_dir() and not is_store(found):
            yield from _pieces(found)
        else:
            yield found


def _require_there(new: Path, target: Path, files: Sequence[str]) -> None:
    for file in files:
        if not os.path.lexists(new / file):
            raise OutputError(f"{shown(target)}: cannot be written ({file} is missing, deleted meanwhile), choose another place")


def _publish(new: Path, target: Path, files: Sequence[str], overwrite: bool) -> None:
    """Move files into a folder that exists; what cannot be placed is refused before the first one moves."""
    for final in (target / file for file in files):
        if os.path.lexists(final) and not overwrite:
            raise taken(final)
        with reporting(final):
            if final.is_dir() and not is_store(final):
                raise IsADirectoryError("a folder has that name")
    for file in files:
        with reporting(target / file):
            (target / file).parent.mkdir(parents=True, exist_ok=True)
        put_in_place(new / file, target / file, overwrite=overwrite)


def _finish(*targets: Path) -> None:
    finished.extend(target for target in targets if not any(part.startswith(HIDDEN) for part in target.parts))


def _top(file: str) -> str:
    return PurePosixPath(file).parts[0]


def _manifest(folder: Path) -> list[str]:
    """What earlier runs produced in a folder and is still there; nothing where the manifest is missing or damaged."""
    try:
        listed = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["files"]
        return [file for file in listed if _ours(folder, file)] if isinstance(listed, list) else []
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _ours(folder: Path, file: object) -> bool:
    """Whether a manifest may speak of this file: one that was edited must not make us remove anything above or elsewhere."""
    if not isinstance(file, str) or ".." in PurePosixPath(file).parts or PurePosixPath(file).as_posix() != file:
        return False
    if not os.path.lexists(folder / file) or ((folder / file).is_dir() and not is_store(folder / file)):
        return False
    return (folder / file).parent.resolve().is_relative_to(folder.resolve())


def _remove(folder: Path, file: str) -> None:
    """Remove what an earlier run produced, and subfolders where nothing else is in them."""
    path = folder / file
    with reporting(path):
        shutil.rmtree(path) if is_store(path) else path.unlink()
    for part in path.parents[: len(PurePosixPath(file).parts) - 1]:
        remove_empty(part)
