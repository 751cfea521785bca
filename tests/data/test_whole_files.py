"""A file appears whole or not at all.

So do the files of a folder, together, and nobody else's files are touched.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bayes_toe.data.whole_files import (
    HIDDEN,
    MANIFEST,
    READY,
    require_folder,
    require_settled,
    require_writable,
    unfinished,
    whole_file,
    whole_folder,
    whole_together,
)
from bayes_toe.errors import InputError, OutputError


def tree(folder):
    """Every file below a folder with its text, every empty folder with none.

    The manifest left out.
    """
    observed = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and path.name != MANIFEST:
            observed[name] = path.read_text(encoding="utf-8")
        elif path.is_dir() and not any(path.iterdir()):
            observed[name + "/"] = ""
    return observed


def manifest(folder):
    return json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["files"]


def failing(error):
    def fail():
        raise error

    return fail


NAMES = ("table.csv", "corner")
BEFORE_WORK = failing(AssertionError("must be refused before any work"))
POSIX = pytest.mark.skipif(
    os.name == "nt",
    reason="links need rights on Windows, and processes are asked for as POSIX does",
)


def write(path, text, *, overwrite=False, meanwhile=int):
    """Write a file whole; without a text, none."""
    with whole_file(path, overwrite=overwrite) as temporary:
        if text is not None:
            temporary.write_text(text)
        meanwhile()


def produce(path, files, *, overwrite=False, names=NAMES, meanwhile=int):
    with whole_folder(path, names, overwrite=overwrite) as folder:
        assert list(folder.iterdir()) == []
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        meanwhile()


# --- A file ---------------------------------------------------------------------------------------


def test_a_file_appears_whole(tmp_path):
    target = tmp_path / "new" / "deep" / "fit.nc"
    for earlier, text in ((None, "whole"), ("whole", "new")):
        with whole_file(target, overwrite=True) as temporary:
            assert (temporary.exists(), temporary.parent.parent, temporary.name) == (
                False,
                target.parent,
                target.name,
            )
            temporary.write_text(text)
            assert (target.read_text() if target.exists() else None) == earlier
        assert tree(tmp_path) == {"new/deep/fit.nc": text}


def test_what_exists_or_appears_meanwhile_is_kept(tmp_path):
    target, link = tmp_path / "a.csv", tmp_path / "link"
    with pytest.raises(OutputError, match=r"a\.csv: exists"):
        write(target, "new", meanwhile=lambda: target.write_text("mine"))
    link.symlink_to(tmp_path / "nowhere")
    for path in (target, link):
        with pytest.raises(
            OutputError,
            match=rf"{path.name}: exists; overwrite=True replaces it$",
        ):
            write(path, "new", meanwhile=BEFORE_WORK)
    link.unlink()
    assert tree(tmp_path) == {"a.csv": "mine"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, GeneratorExit])
def test_failure_leaves_everything_as_it_was(tmp_path, error):
    (tmp_path / "b").write_text("old")
    produce(tmp_path / "out", {"table.csv": "1", "corner/a.png": "1"})
    earlier = tree(tmp_path)
    for name in ("b", "new/deep/a.csv"):
        with pytest.raises(error):
            write(tmp_path / name, "half", overwrite=True, meanwhile=failing(error()))
    for name in ("out", "new/out"):
        with pytest.raises(error):
            produce(
                tmp_path / name, {"table.csv": "half"}, overwrite=True, meanwhile=failing(error())
            )
    assert tree(tmp_path) == earlier
    assert not (tmp_path / "new").exists()


def test_folders_that_others_use_meanwhile_stay(tmp_path):
    def theirs():
        (tmp_path / "new" / "theirs").write_text("x")
        raise ValueError("stop")

    with pytest.raises(ValueError, match="stop"):
        write(tmp_path / "new" / "deep" / "a.csv", "half", meanwhile=theirs)
    assert tree(tmp_path) == {"new/theirs": "x"}


@pytest.mark.parametrize(
    "name, reason",
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
def test_impossible_places(tmp_path, name, reason):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file.txt").write_text("x")
    earlier = tree(tmp_path)
    for action in (
        lambda path: write(path, "x", overwrite=True),
        lambda path: require_writable(path, overwrite=False),
    ):
        with pytest.raises(OutputError, match=reason) as caught:
            action(tmp_path / name)
        assert len(str(caught.value).splitlines()) == 1
    assert tree(tmp_path) == earlier


def test_places_without_permission(tmp_path, monkeypatch):
    real = Path.mkdir

    def mkdir(path, **options):
        if path.name.startswith(HIDDEN):
            raise PermissionError(13, "Permission denied", str(path))
        real(path, **options)

    monkeypatch.setattr(Path, "mkdir", mkdir)
    message = re.escape(
        f"{tmp_path / 'new'}: cannot be written (Permission denied), choose another place"
    )
    for action in (
        lambda: require_writable(tmp_path / "new" / "a.csv", overwrite=False),
        lambda: require_folder(tmp_path / "new" / "out", (), overwrite=False),
        lambda: write(tmp_path / "new" / "a.csv", "x", meanwhile=BEFORE_WORK),
    ):
        with pytest.raises(OutputError, match=f"^{message}$"):
            action()
    assert tree(tmp_path) == {}


def test_a_look_beforehand_leaves_nothing_behind(tmp_path):
    require_writable(tmp_path / "new" / "deep" / "a.csv", overwrite=False)
    require_folder(tmp_path / "new" / "out", NAMES, overwrite=False)
    assert not (tmp_path / "new").exists()


def test_relative_paths(tmp_path, monkeypatch):
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


@POSIX
def test_what_a_killed_process_has_left_goes_and_all_else_stays(tmp_path):
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "a.csv")], check=False)
    (left,) = tmp_path.iterdir()
    assert (left / "a.csv").read_text() == "half"
    elsewhere = left.with_name(left.name.replace(HIDDEN, f"{HIDDEN}elsewhere"))
    elsewhere.mkdir()
    (tmp_path / f"{HIDDEN}mine").write_text("mine")
    with unfinished(tmp_path) as ours:
        require_writable(tmp_path / "a.csv", overwrite=False)
        assert sorted(tmp_path.iterdir()) == sorted([ours, elsewhere, tmp_path / f"{HIDDEN}mine"])


@POSIX
def test_only_regular_files_are_replaced_and_their_permissions_stay(tmp_path):
    pipe, link, private = tmp_path / "pipe", tmp_path / "link", tmp_path / "private.csv"
    os.mkfifo(pipe)
    link.symlink_to(private)
    private.write_text("old")
    private.chmod(0o600)
    for path in (pipe, link, Path("/dev/null")):
        with pytest.raises(OutputError, match="is a link, pipe or device"):
            write(path, "new", overwrite=True, meanwhile=BEFORE_WORK)
    write(private, "new", overwrite=True)
    assert (private.read_text(), private.stat().st_mode & 0o777) == ("new", 0o600)


KILLED_WHILE_FILES_MOVE = """
import os, signal, sys
from pathlib import Path
from bayes_toe.data import whole_files
place = whole_files._put_in_place
def killed(new, final):
    if final.name == sys.argv[3]:
        whole_files._put_in_place = place
        os.kill(os.getpid(), getattr(signal, sys.argv[4]))
    place(new, final)
whole_files._put_in_place = killed
files = [Path(sys.argv[1]), Path(sys.argv[2])]
with whole_files.whole_together(*files, overwrite=True) as folder:
    for file in files:
        (folder / file.name).write_text("new")
"""


def end_while_files_move(folder, signal):
    """Two files of a process that a signal ends while it replaces them."""
    files = [folder / "a.csv", folder / "b.csv"]
    for file in files:
        file.write_text("old")
    words = [sys.executable, "-c", KILLED_WHILE_FILES_MOVE, *map(str, files), "b.csv", signal]
    subprocess.run(words, check=False, capture_output=True)
    return files


@POSIX
@pytest.mark.parametrize("digits", ["", "0123456789abcdef"])
def test_a_set_that_a_killed_process_replaced_in_part_is_refused_and_then_finished(
    tmp_path, digits
):
    first, second = end_while_files_move(tmp_path, "SIGKILL")
    assert (first.read_text(), second.read_text()) == ("new", "old")
    (ready,) = tmp_path.glob(f"{READY}*")
    for digit in digits:  # folders whose removal began
        ready.with_name(ready.name[:-1] + digit).mkdir(exist_ok=True)
    for file in (first, second):
        with pytest.raises(InputError, match="may be of two runs"):
            require_settled(file)
    require_settled(tmp_path / "c.csv")
    require_writable(tmp_path / "c.csv", overwrite=False)
    assert tree(tmp_path) == {"a.csv": "new", "b.csv": "new"}
    assert not list(tmp_path.glob(f"{READY}*"))
    require_settled(first)


@POSIX
def test_a_signal_while_files_move_leaves_the_whole_set(tmp_path):
    end_while_files_move(tmp_path, "SIGINT")
    assert tree(tmp_path) == {"a.csv": "new", "b.csv": "new"}


# --- A folder -------------------------------------------------------------------------------------


def test_a_folder_appears_whole_and_files_of_the_user_stay(tmp_path):
    out = tmp_path / "new" / "out"
    produce(
        out,
        {"table.csv": "t", "corner/a.png": "a"},
        meanwhile=lambda: None if not out.exists() else pytest.fail("too early"),
    )
    assert tree(tmp_path) == {"new/out/table.csv": "t", "new/out/corner/a.png": "a"}
    assert manifest(out) == ["corner/a.png", "table.csv"]
    (out / "corner" / "mine.png").write_text("mine")
    produce(out, {"corner/a.png": "b"}, overwrite=True)
    assert tree(out) == {"corner/a.png": "b", "corner/mine.png": "mine"}


@pytest.mark.parametrize(
    "existing, sentence",
    [
        (["table.csv"], "table.csv"),
        (["corner/"], "corner"),
        ("abc", "a, b, c"),
        ("abcd", "a, b, c, ... and 1 more"),
    ],
)
def test_existing_names_are_refused_before_any_work(tmp_path, existing, sentence):
    for name in existing:
        (tmp_path / name).mkdir() if name.endswith("/") else (tmp_path / name).write_text("mine")
    earlier, message = (
        tree(tmp_path),
        re.escape(f"{tmp_path}: already holds {sentence}; overwrite=True replaces it"),
    )
    with pytest.raises(OutputError, match=f"^{message}$"):
        produce(tmp_path, {}, names=[*NAMES, *"abcd"], meanwhile=BEFORE_WORK)
    assert tree(tmp_path) == earlier


def test_a_file_in_place_of_the_folder(tmp_path):
    (tmp_path / "out").write_text("x")
    refusals = {
        "out": "out: is a file, choose the name of a folder",
        "out/deep": "cannot be written",
        "a\0b": "NUL",
    }
    for name, message in refusals.items():
        with pytest.raises(OutputError, match=message):
            produce(tmp_path / name, {"table.csv": "t"})
    assert tree(tmp_path) == {"out": "x"}


def test_stale_files_of_an_earlier_run_go_as_far_as_the_manifest_tells(tmp_path):
    produce(
        tmp_path,
        {"table.csv": "1", "corner/a.png": "1", "corner/b.png": "1", "corner/deep/c.png": "1"},
    )
    produce(tmp_path, {"table.csv": "2", "corner/b.png": "2"}, overwrite=True)
    assert tree(tmp_path) == {"table.csv": "2", "corner/b.png": "2"}
    assert manifest(tmp_path) == ["corner/b.png", "table.csv"]
    (tmp_path / MANIFEST).unlink()
    produce(tmp_path, {"table.csv": "3"}, overwrite=True)
    assert tree(tmp_path) == {"table.csv": "3", "corner/b.png": "2"}


def test_two_commands_may_share_a_folder(tmp_path):
    produce(tmp_path, {"corner/a.png": "1"})
    produce(tmp_path, {"evidence.csv": "1"}, names=["evidence.csv"])
    produce(tmp_path, {"evidence.csv": "2"}, names=["evidence.csv"], overwrite=True)
    assert tree(tmp_path) == {"corner/a.png": "1", "evidence.csv": "2"}
    assert manifest(tmp_path) == ["corner/a.png", "evidence.csv"]


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            "[]",
            '{"files": 7}',
            '{"files": "table.csv"}',
            "\udcff",
            '{"files": [7, null, ["corner/a.png"]]}',
        ),
        *(
            json.dumps({"files": [name]})
            for name in (
                "../victim",
                "/victim",
                "corner/../../victim",
                "",
                ".",
                "corner",
                "corner/gone.png",
            )
        ),
    ],
)
def test_damaged_manifests_remove_nothing(tmp_path, text):
    out = tmp_path / "out"
    produce(out, {"table.csv": "1", "corner/a.png": "1", "corner/deep/b.png": "1"})
    (tmp_path / "victim").write_text("v")
    (out / MANIFEST).write_bytes(
        text.replace("/victim", f"{tmp_path}/victim").encode("utf-8", "surrogateescape")
    )
    produce(out, {"table.csv": "2"}, overwrite=True)
    stored = {"out/corner/a.png": "1", "out/corner/deep/b.png": "1"}
    assert tree(tmp_path) == {"victim": "v", "out/table.csv": "2", **stored}


@POSIX
def test_stale_files_are_not_sought_through_links(tmp_path):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    produce(out, {"corner/a.png": "1"})
    shutil.move(out / "corner", elsewhere)
    (out / "corner").symlink_to(elsewhere)
    produce(out, {"table.csv": "2"}, overwrite=True)
    assert (elsewhere / "a.png").exists()


def test_what_others_put_there_meanwhile_is_kept(tmp_path):
    files = {"corner/a.png": "new", "table.csv": "new"}
    with pytest.raises(OutputError, match=r"table\.csv: exists"):
        produce(tmp_path, files, meanwhile=lambda: (tmp_path / "table.csv").write_text("theirs"))
    assert tree(tmp_path) == {"table.csv": "theirs"}

    def theirs():
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "mine.txt").write_text("m")

    produce(tmp_path / "out", {"table.csv": "1"}, meanwhile=theirs)
    assert tree(tmp_path / "out") == {"mine.txt": "m", "table.csv": "1"}


@pytest.mark.parametrize("occupied", ["table.csv/mine", "corner"])
def test_a_folder_in_place_of_a_file_and_a_file_in_place_of_a_folder_stay(tmp_path, occupied):
    (tmp_path / occupied).parent.mkdir(exist_ok=True)
    (tmp_path / occupied).write_text("mine")
    with pytest.raises(OutputError, match=occupied.partition("/")[0]):
        produce(tmp_path, {"table.csv": "t", "corner/a.png": "a"}, overwrite=True)
    assert tree(tmp_path) == {occupied: "mine"}


def test_what_is_required_must_be_there_and_only_what_was_named(tmp_path):
    def written(*required, names=NAMES):
        with whole_folder(tmp_path / "out", names, required=required) as folder:
            (folder / "table.csv").write_text("t")

    with pytest.raises(OutputError, match=r"out: cannot be written \(corner/a\.png is missing"):
        written("table.csv", "corner/a.png")
    with pytest.raises(ValueError, match=r"produced without being named: table\.csv$"):
        written(names=["other.csv"])
    assert tree(tmp_path) == {}
    written("table.csv")
    with (
        pytest.raises(OutputError, match=r"b\.csv is missing"),
        whole_together(tmp_path / "a.csv", tmp_path / "b.csv") as folder,
    ):
        (folder / "a.csv").write_text("a")
    with pytest.raises(OutputError, match=r"a\.csv: cannot be written"):
        write(tmp_path / "a.csv", None, overwrite=True)
    assert tree(tmp_path) == {"out/table.csv": "t"}


def test_a_folder_of_a_process_that_lives_is_left_alone(tmp_path):
    def another():
        observed = [path.name for path in tmp_path.iterdir()]
        produce(tmp_path, {"corner/a.png": "1"})
        assert set(observed) <= {path.name for path in tmp_path.iterdir()}

    produce(tmp_path, {"table.csv": "1"}, meanwhile=another)
    assert tree(tmp_path) == {"table.csv": "1", "corner/a.png": "1"}
