"""The files of a folder appear together or not at all, and nobody else's files are touched."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from folder_trees import failing, manifest, tree

from bayes_toe.data.whole_files import MANIFEST, require_folder, whole_file, whole_folder, whole_together
from bayes_toe.errors import OutputError

NAMES = ("table.csv", "corner")


def produce(
    path: Path,
    files: dict[str, str],
    *,
    overwrite: bool = False,
    names: Sequence[str] = NAMES,
    meanwhile: Callable[[], object] = int,
) -> None:
    with whole_folder(path, names, overwrite=overwrite) as folder:
        assert list(folder.iterdir()) == []
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        meanwhile()


def test_a_folder_appears_whole(tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    with whole_folder(out, NAMES) as folder:
        (folder / "table.csv").write_text("t")
        (folder / "corner").mkdir()
        (folder / "corner" / "a.png").write_text("a")
        assert not (out / "table.csv").exists()
    assert tree(tmp_path) == {"new/out/table.csv": "t", "new/out/corner/a.png": "a"}
    assert manifest(out) == ["corner/a.png", "table.csv"]


def test_files_of_the_user_stay(tmp_path: Path) -> None:
    before = {"mine.txt": "m", "figures/mine.png": "f"}
    produce(tmp_path, before, names=("mine.txt", "figures"))
    (tmp_path / MANIFEST).unlink()
    produce(tmp_path, {"table.csv": "t"})
    produce(tmp_path, {"corner/a.png": "a"}, overwrite=True)
    assert tree(tmp_path) == {**before, "corner/a.png": "a"}


def test_existing_names_are_refused_before_any_work(tmp_path: Path) -> None:
    for name in ("table.csv", "corner"):
        out = tmp_path / name.replace(".", "_")
        out.mkdir()
        (out / name).mkdir() if name == "corner" else (out / name).write_text("mine")
        before = tree(out)
        message = re.escape(f"{out}: already holds {name}, choose another folder or allow to overwrite")
        with pytest.raises(OutputError, match=f"^{message}$"):
            produce(out, {}, meanwhile=failing(AssertionError("must be refused before any work")))
        assert tree(out) == before


@pytest.mark.parametrize(("count", "end"), [(3, "a, b, c"), (4, "a, b, c and 1 more"), (6, "a, b, c and 3 more")])
def test_three_existing_names_are_shown(tmp_path: Path, count: int, end: str) -> None:
    for name in "abcdef"[:count]:
        (tmp_path / name).write_text("mine")
    with pytest.raises(OutputError, match=f"already holds {end}, choose"):
        produce(tmp_path, {}, names="abcdef")


def test_require_folder_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    require_folder(tmp_path / "new" / "out", NAMES, overwrite=False)
    assert not (tmp_path / "new").exists()
    (tmp_path / "table.csv").write_text("mine")
    require_folder(tmp_path, NAMES, overwrite=True)
    with pytest.raises(OutputError, match=r"already holds table\.csv"):
        require_folder(tmp_path, NAMES, overwrite=False)
    with pytest.raises(OutputError, match="cannot be written"):
        require_folder(tmp_path / "table.csv" / "out", NAMES, overwrite=False)
    with pytest.raises(ValueError, match="names are plain"):
        require_folder(tmp_path, ["a/b"], overwrite=False)
    assert tree(tmp_path) == {"table.csv": "mine"}
    monkeypatch.setattr(Path, "mkdir", lambda *_, **__: failing(PermissionError(13, "Permission denied"))())
    with pytest.raises(OutputError, match="Permission denied"):
        require_folder(tmp_path, (), overwrite=False)


def test_a_file_in_place_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("x")
    refusals = {"out": "out: is a file, choose the name of a folder", "out/deep": "cannot be written", "a\0b": "NUL"}
    for name, message in refusals.items():
        with pytest.raises(OutputError, match=message):
            produce(tmp_path / name, {"table.csv": "t"})
    assert tree(tmp_path) == {"out": "x"}


def test_stale_files_of_an_earlier_run_go(tmp_path: Path) -> None:
    produce(tmp_path, {"table.csv": "1", "corner/a.png": "1", "corner/b.png": "1", "corner/deep/c.png": "1"})
    (tmp_path / "corner" / "mine.png").write_text("mine")
    produce(tmp_path, {"table.csv": "2", "corner/b.png": "2"}, overwrite=True)
    assert tree(tmp_path) == {"table.csv": "2", "corner/b.png": "2", "corner/mine.png": "mine"}
    assert manifest(tmp_path) == ["corner/b.png", "table.csv"]


def test_without_a_manifest_nothing_is_stale(tmp_path: Path) -> None:
    produce(tmp_path, {"corner/a.png": "1", "corner/b.png": "1"})
    (tmp_path / MANIFEST).unlink()
    produce(tmp_path, {"corner/b.png": "2"}, overwrite=True)
    assert tree(tmp_path) == {"corner/a.png": "1", "corner/b.png": "2"}


def test_nothing_is_overwritten_by_default(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("mine")
    with pytest.raises(OutputError, match="exists"), whole_file(tmp_path / "table.csv"):
        pass
    with pytest.raises(OutputError, match="already holds"), whole_folder(tmp_path, NAMES):
        pass
    assert tree(tmp_path) == {"table.csv": "mine"}


def test_two_commands_may_share_a_folder(tmp_path: Path) -> None:
    produce(tmp_path, {"corner/a.png": "1"})
    produce(tmp_path, {"evidence.csv": "1"}, names=["evidence.csv"])
    produce(tmp_path, {"evidence.csv": "2"}, names=["evidence.csv"], overwrite=True)
    assert tree(tmp_path) == {"corner/a.png": "1", "evidence.csv": "2"}
    assert manifest(tmp_path) == ["corner/a.png", "evidence.csv"]


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "[]", "7", '{"files": 7}', '{"files": "table.csv"}', "\udcff", "\0"),
        '{"files": [7, null, ["corner/a.png"], "corner/\\u0000"]}',
        *(json.dumps({"files": [name]}) for name in ("../victim", "/victim", "corner/../../victim", "corner/..")),
        *(json.dumps({"files": [name]}) for name in ("", ".", "corner", "corner/gone.png", "corner//a.png")),
        *(json.dumps({"files": [name]}) for name in ("corner/./a.png", "corner/deep/../a.png")),
    ],
)
def test_damaged_manifests_remove_nothing(tmp_path: Path, text: str) -> None:
    out = tmp_path / "out"
    produce(out, {"table.csv": "1", "corner/a.png": "1", "corner/deep/b.png": "1"})
    (tmp_path / "victim").write_text("v")
    (out / MANIFEST).write_bytes(text.replace("/victim", f"{tmp_path}/victim").encode("utf-8", "surrogateescape"))
    produce(out, {"table.csv": "2"}, overwrite=True)
    kept = {"out/corner/a.png": "1", "out/corner/deep/b.png": "1"}
    assert tree(tmp_path) == {"victim": "v", "out/table.csv": "2", **kept}


@pytest.mark.skipif(os.name == "nt", reason="symbolic links need rights on Windows")
def test_stale_files_are_not_sought_through_links(tmp_path: Path) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    produce(out, {"corner/a.png": "1"})
    shutil.move(out / "corner", elsewhere)
    (out / "corner").symlink_to(elsewhere)
    produce(out, {"table.csv": "2"}, overwrite=True)
    assert (elsewhere / "a.png").exists()


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, GeneratorExit])
@pytest.mark.parametrize("exists", [False, True])
def test_a_failed_block_leaves_everything_as_it_was(tmp_path: Path, error: type[BaseException], exists: bool) -> None:
    out = tmp_path / "new" / "out"
    if exists:
        produce(out, {"table.csv": "1", "corner/a.png": "1"})
    before = tree(tmp_path)
    with pytest.raises(error):
        produce(out, {"table.csv": "half"}, overwrite=True, meanwhile=failing(error()))
    assert tree(tmp_path) == before
    assert (tmp_path / "new").exists() is exists


def test_a_file_that_appears_meanwhile_in_a_folder_is_kept(tmp_path: Path) -> None:
    files = {"corner/a.png": "new", "table.csv": "new"}
    with pytest.raises(OutputError, match=r"table\.csv: exists"):
        produce(tmp_path, files, meanwhile=lambda: (tmp_path / "table.csv").write_text("theirs"))
    assert tree(tmp_path) == {"table.csv": "theirs"}


def test_a_folder_of_the_user_in_place_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "table.csv").mkdir()
    (tmp_path / "table.csv" / "mine").write_text("m")
    with pytest.raises(OutputError, match=r"table\.csv: cannot be written"):
        produce(tmp_path, {"table.csv": "t", "corner/a.png": "a"}, overwrite=True)
    assert tree(tmp_path) == {"table.csv/mine": "m"}


def test_a_file_of_the_user_in_place_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "corner").write_text("mine")
    with pytest.raises(OutputError, match="corner"):
        produce(tmp_path, {"corner/a.png": "a", "table.csv": "t"}, overwrite=True)
    assert tree(tmp_path) == {"corner": "mine"}


def test_only_what_was_named_may_be_produced(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"produced without being named: other\.csv$"):
        produce(tmp_path, {"table.csv": "t", "other.csv": "o"})
    assert tree(tmp_path) == {}


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "../a", "a\\b", MANIFEST])
def test_names_must_be_plain(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="names are plain"):
        produce(tmp_path, {}, names=[name])


def test_a_folder_that_appears_meanwhile_is_filled_file_by_file(tmp_path: Path) -> None:
    out = tmp_path / "out"

    def theirs() -> None:
        out.mkdir()
        (out / "mine.txt").write_text("m")

    produce(out, {"table.csv": "1"}, meanwhile=theirs)
    assert tree(tmp_path) == {"out/mine.txt": "m", "out/table.csv": "1"}


def test_what_is_required_must_be_there(tmp_path: Path) -> None:
    def write(required: Sequence[str]) -> None:
        with whole_folder(tmp_path / "out", NAMES, required=required) as folder:
            (folder / "table.csv").write_text("t")

    with pytest.raises(OutputError, match=r"out: cannot be written \(corner/a\.png is missing"):
        write(["table.csv", "corner/a.png"])
    assert tree(tmp_path) == {}
    write(["table.csv"])
    with pytest.raises(OutputError, match=r"b\.csv is missing"), whole_together(tmp_path / "a.csv", tmp_path / "b.csv") as folder:
        (folder / "a.csv").write_text("a")
    assert tree(tmp_path) == {"out/table.csv": "t"}


def test_a_folder_of_a_process_that_lives_is_left_alone(tmp_path: Path) -> None:
    def another() -> None:
        found = [path.name for path in tmp_path.iterdir()]
        produce(tmp_path, {"corner/a.png": "1"})
        assert set(found) <= {path.name for path in tmp_path.iterdir()}

    produce(tmp_path, {"table.csv": "1"}, meanwhile=another)
    assert tree(tmp_path) == {"table.csv": "1", "corner/a.png": "1"}
