"""Results as they go out: the files of a folder appear together, by renames, or not at all.

Files of others are never touched. What a failed or interrupted run leaves behind is what was there before it.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from bayes_toe.data.places import free_name, make_folders, probe, put_in_place, refuse_impossible, remove_empty, reporting, shown
from bayes_toe.errors import OutputError

MANIFEST = ".bayes_toe_files.json"


@contextmanager
def whole_folder(path: str | Path, names: Sequence[str], *, overwrite: bool = False) -> Iterator[Path]:
    """A temporary folder to write to, whose files move into `path` when the block ends well, and vanish when not.

    Files of the user in `path` are never touched. What is produced there is listed in a manifest, so that a later run
    that may overwrite can also remove what it no longer produces.

    Parameters
    ----------
    path : str or Path
        The folder to be; it may exist.
    names : sequence of str
        Everything that may be produced: files and subfolders at the top of the folder.
    overwrite : bool
        Whether existing `names` may be replaced.

    Yields
    ------
    Path
        An empty folder inside `path`, so that moving the files never crosses a file system.

    Raises
    ------
    OutputError
        If one of `names` exists and may not be replaced, or the folder cannot be made or written to.
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
    _refuse_taken_folder(target, names, overwrite)
    with ExitStack() as made, ExitStack() as cleanup, ExitStack() as undo:  # left in reverse order
        make_folders(target, made)
        workshop = free_name(target, "")
        cleanup.callback(shutil.rmtree, workshop, ignore_errors=True)
        for part in (workshop, workshop / "new", workshop / "old"):
            with reporting(target):
                part.mkdir()
        yield workshop / "new"
        _publish(_Move(workshop / "new", workshop / "old", target, overwrite, undo), names)
        undo.pop_all()
        made.pop_all()


def require_folder(path: str | Path, names: Sequence[str], *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_folder` would refuse after long work, with its arguments and errors; leaves nothing behind.

    Examples
    --------
    >>> require_folder(".", ["no such file"], overwrite=False)
    """
    target = Path(path)
    _require_plain(names)
    _refuse_taken_folder(target, names, overwrite)
    with ExitStack() as made:
        make_folders(target, made)
        probe(free_name(target, ""))


def _require_plain(names: Sequence[str]) -> None:
    for name in names:
        if name in ("", ".", "..", MANIFEST) or "/" in name or "\\" in name:
            raise ValueError(f"{name!r} cannot be produced: names are plain names of files or subfolders")


def _refuse_taken_folder(target: Path, names: Sequence[str], overwrite: bool) -> None:
    refuse_impossible(target)
    if os.path.lexists(target) and not os.path.isdir(target):
        raise OutputError(f"{shown(target)}: is a file, choose the name of a folder")
    taken = [] if overwrite else [name for name in names if os.path.lexists(target / name)]
    if taken:
        more = f" and {len(taken) - 3} more" if len(taken) > 3 else ""
        what = f"already holds {', '.join(taken[:3])}{more}"
        raise OutputError(f"{shown(target)}: {what}, choose another folder or allow to overwrite")


@dataclass(frozen=True)
class _Move:
    """From where to where finished files go, and the stack that puts everything back when it is closed."""

    new: Path
    old: Path
    target: Path
    overwrite: bool
    undo: ExitStack

    def put(self, file: str, *, overwrite: bool) -> None:
        """Give a new file its place, keeping a copy of what it replaces."""
        final, kept = self.target / file, self.old / file
        with reporting(final):
            make_folders(final.parent, self.undo)
            if overwrite and os.path.lexists(final):
                kept.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(final, kept, follow_symlinks=False)
                self.undo.callback(_restore, kept, final)
            else:
                self.undo.callback(_remove_same, final, os.lstat(self.new / file))
            put_in_place(self.new / file, final, overwrite)

    def set_aside(self, file: str) -> None:
        """Take a file away, so that it can still be put back."""
        final, kept = self.target / file, self.old / file
        with reporting(final):
            kept.parent.mkdir(parents=True, exist_ok=True)
            self.undo.callback(_restore, kept, final)
            os.replace(final, kept)
            for folder in final.parents[: len(PurePosixPath(file).parts) - 1]:
                remove_empty(folder)


def _publish(move: _Move, names: Sequence[str]) -> None:
    """Move all that is new into place, and what an earlier run left there and this one did not produce out of it."""
    produced = [found.relative_to(move.new).as_posix() for found in sorted(move.new.rglob("*")) if not found.is_dir()]
    unknown = sorted({_top(file) for file in produced}.difference(names))
    if unknown:
        raise ValueError(f"produced without being named: {', '.join(unknown)}")
    earlier = _manifest(move.target)
    for file in earlier:
        if move.overwrite and _top(file) in names and file not in produced:
            move.set_aside(file)
    for file in produced:
        move.put(file, overwrite=move.overwrite)
    # Other commands may share the folder: what they produced stays listed.
    listed = [*(file for file in earlier if _top(file) not in names), *produced]
    (move.new / MANIFEST).write_text(json.dumps({"files": sorted(listed)}, indent=1) + "\n", encoding="utf-8")
    move.put(MANIFEST, overwrite=True)


def _top(file: str) -> str:
    return PurePosixPath(file).parts[0]


def _restore(kept: Path, final: Path) -> None:
    if os.path.lexists(kept):
        final.parent.mkdir(parents=True, exist_ok=True)
        os.replace(kept, final)


def _remove_same(path: Path, status: os.stat_result) -> None:
    """Remove a file that we put there, not one that someone else was quicker to put there."""
    with suppress(OSError):
        if os.path.samestat(os.lstat(path), status):
            path.unlink()


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
    if not os.path.lexists(folder / file) or os.path.isdir(folder / file):
        return False
    return (folder / file).parent.resolve().is_relative_to(folder.resolve())
