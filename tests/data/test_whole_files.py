"""Outputs: whole or not at all, and nobody else's files are touched."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayes_toe.data import whole_files as outputs
from bayes_toe.data.whole_files import (
    MANIFEST,
    file_stems,
    require_folder,
    require_writable,
    whole_file,
    whole_folder,
    write_table,
)
from bayes_toe.errors import OutputError

FUZZ = settings(max_examples=200, deadline=None, derandomize=True, database=None)


def tree(folder: Path) -> dict[str, str]:
    """Every file below a folder with its text, every empty folder with none; the manifest left out."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and path.name != MANIFEST:
            found[name] = path.read_text(encoding="utf-8")
        elif path.is_dir() and not any(path.iterdir()):
            found[name + "/"] = ""
    return found


def manifest(folder: Path) -> list[str]:
    listed: list[str] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["files"]
    return listed


@pytest.fixture(params=["links", "no links"])
def links(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """File systems with hard links, and without."""
    if request.param == "no links":

        def link(*_: object) -> None:
            raise OSError(1, "Operation not permitted")

        monkeypatch.setattr(os, "link", link)


def write(path: Path, text: str | None, *, overwrite: bool = False, meanwhile: Callable[[], object] = int) -> None:
    """Write a file whole; without a text, none."""
    with whole_file(path, overwrite=overwrite) as temporary:
        if text is not None:
            temporary.write_text(text)
        meanwhile()


def failing(error: BaseException) -> Callable[[], None]:
    def fail() -> None:
        raise error

    return fail


# --- One file -----------------------------------------------------------------------------------------


@pytest.mark.usefixtures("links")
@pytest.mark.parametrize("overwrite", [False, True])
def test_a_file_appears_whole(tmp_path: Path, overwrite: bool) -> None:
    target = tmp_path / "new" / "deep" / "fit.nc"
    with whole_file(target, overwrite=overwrite) as temporary:
        assert not target.exists()
        assert not temporary.exists()
        assert temporary.parent == target.parent
        assert temporary.suffix == ".nc"
        temporary.write_text("whole")
    assert tree(tmp_path) == {"new/deep/fit.nc": "whole"}


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    target = tmp_path / "a.csv"
    target.write_text("mine")
    with pytest.raises(OutputError, match=r"a\.csv: exists, choose another name or allow to overwrite it$"):
        write(target, "new", meanwhile=failing(AssertionError("must be refused before any work")))
    assert tree(tmp_path) == {"a.csv": "mine"}


@pytest.mark.usefixtures("links")
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


@pytest.mark.usefixtures("links")
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
    def touch(path: Path, **_: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "touch", touch)
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


# --- Tables ---------------------------------------------------------------------------------------------


def test_tables_are_plain_csv(tmp_path: Path) -> None:
    frame = pd.DataFrame(
        {
            "subject": ["01", "NA", 'Zoë, "x"'],
            "q0": [0.1 + 0.2, math.nan, -1e-300],
            "n": [1, 2, 3],
            "note": ["", None, "a"],
        },
        index=[7, 8, 9],
    )
    lines = ["subject,q0,n,note", "01,0.30000000000000004,1,", "NA,,2,", '"Zoë, ""x""",-1e-300,3,a', ""]
    path = write_table(frame, tmp_path / "new" / "t.csv")
    assert path == tmp_path / "new" / "t.csv"
    assert path.read_bytes() == "\n".join(lines).encode()


@FUZZ
@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_numbers_in_tables_keep_every_bit(tmp_path_factory: pytest.TempPathFactory, values: list[float]) -> None:
    path = tmp_path_factory.getbasetemp() / "t.csv"
    write_table(pd.DataFrame({"x": values, "y": 0}), path, overwrite=True)
    texts = [line.split(",")[0] for line in path.read_text(encoding="utf-8").splitlines()[1:]]
    assert np.array_equal(np.array(values).view(np.int64), np.array([float(text) for text in texts]).view(np.int64))


def test_tables_are_not_overwritten_unasked(tmp_path: Path) -> None:
    write_table(pd.DataFrame({"x": [1]}), tmp_path / "t.csv")
    with pytest.raises(OutputError, match="exists"):
        write_table(pd.DataFrame({"x": [2]}), tmp_path / "t.csv")
    assert tree(tmp_path) == {"t.csv": "x\n1\n"}
    write_table(pd.DataFrame({"x": [2]}), tmp_path / "t.csv", overwrite=True)
    assert tree(tmp_path) == {"t.csv": "x\n2\n"}


def test_a_full_disk_is_reported_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_csv", full)
    with pytest.raises(OutputError, match=r"t\.csv: cannot be written \(No space left on device\)"):
        write_table(pd.DataFrame({"x": [1]}), tmp_path / "t.csv")
    assert tree(tmp_path) == {}


# --- Folders ----------------------------------------------------------------------------------------------

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


@pytest.mark.usefixtures("links")
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
    monkeypatch.setattr(Path, "touch", lambda *_, **__: failing(PermissionError(13, "Permission denied"))())
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


@pytest.mark.usefixtures("links")
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("step", range(9))
def test_an_interrupted_move_is_undone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, overwrite: bool, step: int
) -> None:
    """Whichever rename or link fails, what was there before is there again."""
    if overwrite:
        produce(tmp_path, {"table.csv": "1", "corner/a.png": "1", "corner/deep/b.png": "1"})
    (tmp_path / "mine.txt").write_text("m")
    before = tree(tmp_path)
    listed = (tmp_path / MANIFEST).read_text() if overwrite else None
    real, calls = outputs._move, iter(range(100))

    def move(new: Path, final: Path, replace: bool) -> None:
        count = next(calls)
        if count == step // 2 and step % 2 == 0:
            raise error
        real(new, final, replace)
        if count == step // 2:  # as when the interrupt arrives just after the rename
            raise error

    monkeypatch.setattr(outputs, "_move", move)
    expected = OutputError if isinstance(error, OSError) else KeyboardInterrupt
    if step // 2 > 3:  # three files and the manifest
        produce(tmp_path, {"table.csv": "2", "corner/c.png": "2", "corner/d.png": "2"}, overwrite=overwrite)
        return
    with pytest.raises(expected):
        produce(tmp_path, {"table.csv": "2", "corner/c.png": "2", "corner/d.png": "2"}, overwrite=overwrite)
    assert tree(tmp_path) == before
    assert ((tmp_path / MANIFEST).read_text() if overwrite else None) == listed
    assert (tmp_path / MANIFEST).exists() is overwrite


@pytest.mark.usefixtures("links")
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


# --- File names ---------------------------------------------------------------------------------------------


def test_plain_names_stay() -> None:
    names = ["S01", "a.b", "x-1_y", "CONtrol", "nul1", "0", "a" * 60]
    assert file_stems(names) == {name: name for name in names}


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("Zoë", "Zo_-"),
        ("被験者", "_-"),
        ("../up", "_up-"),
        ("a/b", "a_b-"),
        ("a b", "a_b-"),
        ("...", "_-"),
        (".hidden", "hidden-"),
        ("end.", "end.-"),
        ("con", "_con-"),
        ("CON.txt", "_CON.txt-"),
        ("Lpt9", "_Lpt9-"),
        ("a\nb", "a_b-"),
        ("b" * 61, "b" * 51 + "-"),
    ],
)
def test_other_names_carry_their_hash(name: str, start: str) -> None:
    stem = file_stems([name])[name]
    assert re.fullmatch(re.escape(start) + "[0-9a-f]{8}", stem)


def test_the_hash_is_of_the_name() -> None:
    # printf 'a b' | sha256sum
    assert file_stems(["a b"]) == {"a b": "a_b-c8687a08"}


def test_names_that_differ_in_case_are_told_apart() -> None:
    stems = file_stems(["s01", "S01", "S02"])
    assert stems["S02"] == "S02"
    assert len({stem.lower() for stem in stems.values()}) == 3
    assert stems["s01"].startswith("s01-")
    assert stems["S01"].startswith("S01-")


def test_a_name_that_looks_like_another_ones_stem() -> None:
    imitation = file_stems(["a b"])["a b"]
    stems = file_stems([imitation, "a b", imitation.upper()])
    assert stems["a b"] == imitation
    assert len({stem.lower() for stem in stems.values()}) == 3


def test_one_name_twice_is_one_name() -> None:
    assert file_stems(["S01", "S01"]) == {"S01": "S01"}


@FUZZ
@given(st.lists(st.one_of(st.text(max_size=80), st.sampled_from(["a", "A", "a ", "con", "CON", "aux.x", "\ud800"]))))
def test_stems_are_safe_and_distinct(names: list[str]) -> None:
    stems = file_stems(names)
    assert set(stems) == set(names)
    assert len({stem.lower() for stem in stems.values()}) == len(set(names))
    for stem in stems.values():
        assert re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,59}", stem)
        assert not stem.endswith(".")
        assert stem.split(".")[0].lower() not in {"con", "prn", "aux", "nul", *(f"com{i}" for i in range(10))}
