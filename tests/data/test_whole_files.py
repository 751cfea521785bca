"""A file appears whole or not at all."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from folder_trees import failing, tree

from bayes_toe.data.places import HIDDEN, unfinished
from bayes_toe.data.whole_files import require_writable, whole_file, whole_folder
from bayes_toe.errors import OutputError


def write(path: Path, text: str | None, *, overwrite: bool = False, meanwhile: Callable[[], object] = int) -> None:
    """Write a file whole; without a text, none."""
    with whole_file(path, overwrite=overwrite) as temporary:
        if text is not None:
            temporary.write_text(text)
        meanwhile()


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_file_appears_whole(tmp_path: Path, overwrite: bool) -> None:
    target = tmp_path / "new" / "deep" / "fit.nc"
    with whole_file(target, overwrite=overwrite) as temporary:
        assert not target.exists()
        assert not temporary.exists()
        assert temporary.parent.parent == target.parent
        assert temporary.name == target.name
        temporary.write_text("whole")
    assert tree(tmp_path) == {"new/deep/fit.nc": "whole"}


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    target = tmp_path / "a.csv"
    target.write_text("mine")
    with pytest.raises(OutputError, match=r"a\.csv: exists, choose another name or allow to overwrite it$"):
        write(target, "new", meanwhile=failing(AssertionError("must be refused before any work")))
    assert tree(tmp_path) == {"a.csv": "mine"}


def test_a_file_that_appears_meanwhile_is_kept(tmp_path: Path) -> None:
    target = tmp_path / "a.csv"
    with pytest.raises(OutputError, match=r"a\.csv: exists"):
        write(target, "new", meanwhile=lambda: target.write_text("someone else's"))
    assert tree(tmp_path) == {"a.csv": "someone else's"}


@pytest.mark.skipif(os.name == "nt", reason="symbolic links need rights on Windows")
def test_a_dangling_link_is_kept(tmp_path: Path) -> None:
    target = tmp_path / "a.csv"
    target.symlink_to(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="exists"):
        write(target, "new")
    assert target.is_symlink()


def test_an_existing_file_is_replaced_on_request(tmp_path: Path) -> None:
    target = tmp_path / "a.csv"
    target.write_text("old")
    with whole_file(target, overwrite=True) as temporary:
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert tree(tmp_path) == {"a.csv": "new"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_failure_leaves_everything_as_it_was(tmp_path: Path, error: type[BaseException]) -> None:
    (tmp_path / "b").write_text("old")
    for name in ("b", "new/deep/a.csv"):
        with pytest.raises(error):
            write(tmp_path / name, "half", overwrite=True, meanwhile=failing(error()))
    assert tree(tmp_path) == {"b": "old"}
    assert not (tmp_path / "new").exists()


def test_folders_that_others_use_meanwhile_stay(tmp_path: Path) -> None:
    def theirs() -> None:
        (tmp_path / "new" / "theirs").write_text("x")
        raise ValueError("stop")

    with pytest.raises(ValueError, match="stop"):
        write(tmp_path / "new" / "deep" / "a.csv", "half", meanwhile=theirs)
    assert tree(tmp_path) == {"new/theirs": "x"}


@pytest.mark.parametrize("overwrite", [False, True])
def test_nothing_written_is_an_error(tmp_path: Path, overwrite: bool) -> None:
    with pytest.raises(OutputError, match=r"a\.csv: cannot be written"):
        write(tmp_path / "a.csv", None, overwrite=overwrite)
    assert tree(tmp_path) == {}


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("", "is a folder"),
        ("folder", "is a folder"),
        ("file.txt/x.csv", "cannot be written"),
        ("file.txt/deep/x.csv", "cannot be written"),
        ("folder/nul\0.csv", "NUL"),
        ("folder/" + "x" * 5000, "cannot be written"),
    ],
    ids=["here", "folder", "below a file", "deep below a file", "NUL", "too long"],
)
@pytest.mark.parametrize("overwrite", [False, True])
def test_impossible_places(tmp_path: Path, name: str, reason: str, overwrite: bool) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file.txt").write_text("x")
    before = tree(tmp_path)
    actions: Sequence[Callable[[], None]] = (
        lambda: write(tmp_path / name, "x", overwrite=overwrite),
        lambda: require_writable(tmp_path / name, overwrite=overwrite),
    )
    for action in actions:
        with pytest.raises(OutputError, match=reason) as caught:
            action()
        assert len(str(caught.value).splitlines()) == 1
        assert ": " in str(caught.value)
    assert tree(tmp_path) == before


def test_places_without_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Path.mkdir

    def mkdir(path: Path, **how: bool) -> None:
        if path.name.startswith(HIDDEN):
            raise PermissionError(13, "Permission denied", str(path))
        real(path, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "mkdir", mkdir)
    message = re.escape(f"{tmp_path / 'new'}: cannot be written (Permission denied), choose another place")
    with pytest.raises(OutputError, match=f"^{message}$"):
        require_writable(tmp_path / "new" / "a.csv", overwrite=False)
    with pytest.raises(OutputError, match=f"^{message}$"):
        write(tmp_path / "new" / "a.csv", "x", meanwhile=failing(AssertionError("must be refused before any work")))
    assert tree(tmp_path) == {}


def test_require_writable_leaves_nothing_behind(tmp_path: Path) -> None:
    require_writable(tmp_path / "new" / "deep" / "a.csv", overwrite=False)
    assert tree(tmp_path) == {}
    assert not (tmp_path / "new").exists()
    (tmp_path / "a.csv").write_text("mine")
    require_writable(tmp_path / "a.csv", overwrite=True)
    with pytest.raises(OutputError, match="exists"):
        require_writable(tmp_path / "a.csv", overwrite=False)
    assert tree(tmp_path) == {"a.csv": "mine"}


def test_relative_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    require_writable("a.csv", overwrite=False)
    with whole_file("a.csv") as temporary:
        temporary.write_text("x")
    with whole_folder(".", ["b"]) as folder:
        (folder / "b").write_text("y")
    assert tree(tmp_path) == {"a.csv": "x", "b": "y"}


KILLED = """
import os, signal, sys
from bayes_toe.data.whole_files import whole_file
with whole_file(sys.argv[1]) as path:
    path.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name == "nt", reason="asks for processes as POSIX does")
def test_what_a_killed_process_has_left_goes_and_all_else_stays(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "a.csv")], check=False)
    (left,) = tmp_path.iterdir()
    assert (left / "a.csv").read_text() == "half"
    elsewhere = left.with_name(left.name.replace(HIDDEN, f"{HIDDEN}elsewhere"))
    elsewhere.mkdir()
    (tmp_path / f"{HIDDEN}mine").write_text("mine")
    with unfinished(tmp_path) as ours:
        require_writable(tmp_path / "a.csv", overwrite=False)
        assert sorted(tmp_path.iterdir()) == sorted([ours, elsewhere, tmp_path / f"{HIDDEN}mine"])
