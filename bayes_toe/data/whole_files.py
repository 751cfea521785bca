"""Results as they go out: every file appears whole, by a rename, or not at all.

An existing file is replaced only where the caller says so. What a failed or interrupted run leaves behind is what was
there before it.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from bayes_toe.errors import OutputError

if TYPE_CHECKING:
    import pandas as pd

MANIFEST = ".bayes_toe_files.json"

_LONGEST_STEM = 60
_HASH_DIGITS = 8
_PLAIN = re.compile(r"[A-Za-z0-9_-](?:[A-Za-z0-9._-]*[A-Za-z0-9_-])?")  # no dot at either end
_FORBIDDEN = re.compile(r"[^A-Za-z0-9._-]+")
_RESERVED = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\..*)?", re.IGNORECASE)


# --- One file -------------------------------------------------------------------------------------


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
        A path that does not exist yet, in the same folder and with the same suffix.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, is a folder, or its folder cannot be made or written to.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with whole_file(Path(folder, "new", "a.txt")) as temporary:
    ...         _ = temporary.write_text("whole", encoding="utf-8")
    ...     Path(folder, "new", "a.txt").read_text(encoding="utf-8")
    'whole'
    """
    target = Path(path)
    _refuse_taken(target, overwrite)
    with ExitStack() as made, ExitStack() as cleanup:
        _make_folders(target.parent, made)
        temporary = _free_name(target.parent, target.suffix)
        cleanup.callback(_remove, temporary)
        _probe(temporary)
        yield temporary
        with _reporting(target):
            _move(temporary, target, overwrite)
        made.pop_all()


def require_writable(path: str | Path, *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_file` would refuse after long work; leaves nothing behind.

    Parameters
    ----------
    path : str or Path
        The file to be.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, is a folder, or its folder cannot be made or written to.

    Examples
    --------
    >>> require_writable(".", overwrite=True)
    Traceback (most recent call last):
        ...
    bayes_toe.errors.OutputError: .: is a folder, choose the name of a file
    """
    target = Path(path)
    _refuse_taken(target, overwrite)
    with ExitStack() as made:
        _make_folders(target.parent, made)
        _probe(_free_name(target.parent, target.suffix))


def write_table(frame: pd.DataFrame, path: str | Path, *, overwrite: bool = False) -> Path:
    """A table as a CSV file: UTF-8, one line per row, numbers that read back to the same bits, missing as empty.

    Parameters
    ----------
    frame : pandas.DataFrame
        Its index is not written.
    path : str or Path
        The file to be.
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        If the file cannot be written, or exists and may not be replaced.

    Examples
    --------
    >>> import tempfile
    >>> import pandas as pd
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     table = write_table(pd.DataFrame({"subject": ["S01"], "q0": [0.1 + 0.2]}), Path(folder, "table.csv"))
    ...     table.read_text(encoding="utf-8").splitlines()
    ['subject,q0', 'S01,0.30000000000000004']
    """
    target = Path(path)
    with whole_file(target, overwrite=overwrite) as temporary, _reporting(target):
        frame.to_csv(temporary, index=False, encoding="utf-8", lineterminator="\n", na_rep="")
    return target


def _refuse_impossible(target: Path) -> None:
    """Refuse names that no file can have here, such as a name that is too long."""
    if "\0" in str(target):
        raise OutputError(f"{_shown(target)}: cannot be written (it has a NUL character), choose another name")
    with _reporting(target), suppress(FileNotFoundError):
        os.lstat(target)


def _refuse_taken(target: Path, overwrite: bool) -> None:
    _refuse_impossible(target)
    if os.path.isdir(target):
        raise OutputError(f"{_shown(target)}: is a folder, choose the name of a file")
    if not overwrite and os.path.lexists(target):
        raise _taken(target)


def _taken(target: Path) -> OutputError:
    return OutputError(f"{_shown(target)}: exists, choose another name or allow to overwrite it")


def _shown(path: Path) -> str:
    return str(path) if str(path).isprintable() else repr(str(path))


@contextmanager
def _reporting(target: Path) -> Iterator[None]:
    """Turn what the operating system says into one line with the path and a way out."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        reason = error.strerror if error.strerror is not None else str(error)
        raise OutputError(f"{_shown(target)}: cannot be written ({reason}), choose another place") from error


def _make_folders(folder: Path, made: ExitStack) -> None:
    """Make what is missing of a folder; closing `made` removes it again where it is empty."""
    missing = [part for part in (folder, *folder.parents) if not os.path.lexists(part)]
    for part in reversed(missing):
        with _reporting(part):
            part.mkdir(exist_ok=True)
        made.callback(_remove_empty, part)


def _free_name(folder: Path, suffix: str) -> Path:
    return folder / f".bayes_toe-{secrets.token_hex(8)}{suffix}"


def _probe(path: Path) -> None:
    """Create and remove a file: the only test of permission that holds on every system."""
    with _reporting(path.parent):
        try:
            path.touch(exist_ok=False)
        finally:
            path.unlink(missing_ok=True)


def _move(new: Path, final: Path, overwrite: bool) -> None:
    """Give a finished file its name; without `overwrite`, never at the cost of a file that appeared meanwhile.

    The temporary name may remain: whoever made it removes it.
    """
    if overwrite:
        os.replace(new, final)
        return
    try:
        os.link(new, final)  # unlike a rename, a link never replaces
    except FileExistsError:
        raise _taken(final) from None
    except OSError:
        _claim(new, final)


def _claim(new: Path, final: Path) -> None:
    """The same on file systems without hard links: take the name first, then replace what is ours."""
    try:
        final.touch(exist_ok=False)
    except FileExistsError:
        raise _taken(final) from None
    try:
        os.replace(new, final)
    except BaseException:
        _remove(final)
        raise


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


# --- A folder -------------------------------------------------------------------------------------


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
        _make_folders(target, made)
        workshop = _free_name(target, "")
        cleanup.callback(shutil.rmtree, workshop, ignore_errors=True)
        for part in (workshop, workshop / "new", workshop / "old"):
            with _reporting(target):
                part.mkdir()
        yield workshop / "new"
        _publish(_Move(workshop / "new", workshop / "old", target, overwrite, undo), names)
        undo.pop_all()
        made.pop_all()


def require_folder(path: str | Path, names: Sequence[str], *, overwrite: bool) -> None:
    """Refuse now what :func:`whole_folder` would refuse after long work; leaves nothing behind.

    Parameters
    ----------
    path : str or Path
        The folder to be; it may exist.
    names : sequence of str
        Everything that may be produced at the top of the folder.
    overwrite : bool
        Whether existing `names` may be replaced.

    Raises
    ------
    OutputError
        If one of `names` exists and may not be replaced, or the folder cannot be made or written to.

    Examples
    --------
    >>> require_folder(".", ["no such file"], overwrite=False)
    """
    target = Path(path)
    _require_plain(names)
    _refuse_taken_folder(target, names, overwrite)
    with ExitStack() as made:
        _make_folders(target, made)
        _probe(_free_name(target, ""))


def _require_plain(names: Sequence[str]) -> None:
    for name in names:
        if name in ("", ".", "..", MANIFEST) or "/" in name or "\\" in name:
            raise ValueError(f"{name!r} cannot be produced: names are plain names of files or subfolders")


def _refuse_taken_folder(target: Path, names: Sequence[str], overwrite: bool) -> None:
    _refuse_impossible(target)
    if os.path.lexists(target) and not os.path.isdir(target):
        raise OutputError(f"{_shown(target)}: is a file, choose the name of a folder")
    taken = [] if overwrite else [name for name in names if os.path.lexists(target / name)]
    if taken:
        more = f" and {len(taken) - 3} more" if len(taken) > 3 else ""
        what = f"already holds {', '.join(taken[:3])}{more}"
        raise OutputError(f"{_shown(target)}: {what}, choose another folder or allow to overwrite")


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
        with _reporting(final):
            _make_folders(final.parent, self.undo)
            if overwrite and os.path.lexists(final):
                kept.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(final, kept, follow_symlinks=False)
                self.undo.callback(_restore, kept, final)
            else:
                self.undo.callback(_remove_same, final, os.lstat(self.new / file))
            _move(self.new / file, final, overwrite)

    def set_aside(self, file: str) -> None:
        """Take a file away, so that it can still be put back."""
        final, kept = self.target / file, self.old / file
        with _reporting(final):
            kept.parent.mkdir(parents=True, exist_ok=True)
            self.undo.callback(_restore, kept, final)
            os.replace(final, kept)
            for folder in final.parents[: len(PurePosixPath(file).parts) - 1]:
                _remove_empty(folder)


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


# --- File names -----------------------------------------------------------------------------------


def file_stems(names: Sequence[str]) -> dict[str, str]:
    """A file name without suffix for each subject, safe and distinct on every system.

    ASCII letters, digits, ``-``, ``_`` and ``.`` only, 60 characters at most. A name that had to be changed, or that
    differs from another one in case only, carries 8 hexadecimal digits of its SHA-256.

    Parameters
    ----------
    names : sequence of str
        Subject identifiers: any text.

    Returns
    -------
    dict of str to str
        The stem of each name.

    Examples
    --------
    >>> file_stems(["S01", "../S02"])
    {'S01': 'S01', '../S02': '_S02-58c1dce7'}
    """
    stems = {name: _safe(name) for name in names}
    while True:
        seen = Counter(stem.lower() for stem in stems.values())
        clashing = [name for name, stem in stems.items() if seen[stem.lower()] > 1 and stem == name]
        if not clashing:
            return stems
        stems.update({name: _marked(name, name) for name in clashing})


def _safe(name: str) -> str:
    """The name itself where every system takes it as a file name, otherwise a changed one with its hash."""
    if len(name) <= _LONGEST_STEM and _PLAIN.fullmatch(name) and not _RESERVED.fullmatch(name):
        return name
    clean = _FORBIDDEN.sub("_", name).lstrip(".")
    return _marked(f"_{clean}" if clean == "" or _RESERVED.fullmatch(clean) else clean, name)


def _marked(stem: str, name: str) -> str:
    digits = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:_HASH_DIGITS]
    return f"{stem[: _LONGEST_STEM - _HASH_DIGITS - 1]}-{digits}"
