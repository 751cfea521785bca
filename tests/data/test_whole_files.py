"""A file appears whole or not at all, and nobody else's files are touched."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bayes_toe.data.whole_files import (
    HIDDEN,
    require_folder,
    require_writable,
    unfinished,
    whole_file,
    whole_folder,
)
from bayes_toe.errors import OutputError


def tree(folder):
    """Every file below a folder with its text, every empty folder with none."""
    observed = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file():
            observed[name] = path.read_text(encoding="utf-8")
        elif path.is_dir() and not any(path.iterdir()):
            observed[name + "/"] = ""
    return observed


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


KILLED_BETWEEN_REPLACEMENTS = """
import os, signal, sys
from pathlib import Path
from bayes_toe.data import whole_files
place = whole_files._put_in_place
def killed(new, final):
    if final.name == "b.csv":
        os.kill(os.getpid(), signal.SIGKILL)
    place(new, final)
whole_files._put_in_place = killed
with whole_files.whole_folder(sys.argv[1], ["a.csv", "b.csv"], overwrite=True) as folder:
    for name in ("a.csv", "b.csv"):
        (folder / name).write_text("new")
"""


@POSIX
def test_each_file_is_whole_after_a_kill_between_two_replacements(tmp_path):
    names = ("a.csv", "b.csv")
    produce(tmp_path, dict.fromkeys(names, "old"), names=names)
    words = [sys.executable, "-c", KILLED_BETWEEN_REPLACEMENTS, str(tmp_path)]
    assert subprocess.run(words, check=False).returncode == -signal.SIGKILL
    assert [(tmp_path / name).read_text() for name in names] == ["new", "old"]
    produce(tmp_path, dict.fromkeys(names, "next"), names=names, overwrite=True)
    assert tree(tmp_path) == dict.fromkeys(names, "next")


def test_content_is_on_the_disk_before_a_file_takes_its_name(tmp_path, monkeypatch):
    steps = []

    def replace(new, final):
        steps.append("replace")
        new.rename(final)

    monkeypatch.setattr(os, "fsync", lambda _: steps.append("fsync"))
    monkeypatch.setattr(os, "replace", replace)
    write(tmp_path / "a.csv", "1")
    produce(tmp_path / "out", {"table.csv": "1", "corner/a.png": "1"})
    assert steps == ["fsync", "replace", "fsync", "fsync", "replace"]


# --- A folder -------------------------------------------------------------------------------------


def test_a_folder_appears_whole_and_files_of_the_user_stay(tmp_path):
    out = tmp_path / "new" / "out"
    produce(
        out,
        {"table.csv": "t", "corner/a.png": "a"},
        meanwhile=lambda: None if not out.exists() else pytest.fail("too early"),
    )
    assert tree(tmp_path) == {"new/out/table.csv": "t", "new/out/corner/a.png": "a"}
    (out / "corner" / "mine.png").write_text("mine")
    produce(out, {"corner/a.png": "b"}, overwrite=True)
    assert tree(out) == {"corner/a.png": "b", "corner/mine.png": "mine"}  # no longer table.csv


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


def test_what_is_named_and_no_longer_produced_goes_and_all_else_stays(tmp_path):
    names = ("table.csv", "corner", "corner/a.png", "link.csv", "folder.csv")
    produce(tmp_path, {"table.csv": "1", "corner/a.png": "1", "corner/b.png": "1"}, names=names)
    (tmp_path / "link.csv").symlink_to(tmp_path / "corner" / "b.png")
    (tmp_path / "folder.csv").mkdir()
    produce(tmp_path, {}, names=names, overwrite=True)
    left = {"corner/b.png": "1", "folder.csv/": "", "link.csv": "1"}
    assert tree(tmp_path) == left
    (tmp_path / "link.csv").unlink()
    produce(tmp_path, {"table.csv": "2"}, names=["corner/b.png", "table.csv"], overwrite=True)
    assert tree(tmp_path) == {"folder.csv/": "", "table.csv": "2"}  # without the empty folder


@POSIX
def test_what_is_no_longer_produced_is_not_sought_through_links(tmp_path):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    names = ("table.csv", "corner/a.png")
    produce(out, {"corner/a.png": "1"}, names=names)
    (out / "corner").rename(elsewhere)
    (out / "corner").symlink_to(elsewhere)
    produce(out, {"table.csv": "2"}, names=names, overwrite=True)
    assert (elsewhere / "a.png").exists()


def test_two_commands_may_share_a_folder(tmp_path):
    produce(tmp_path, {"corner/a.png": "1"})
    produce(tmp_path, {"evidence.csv": "1"}, names=["evidence.csv"])
    produce(tmp_path, {"evidence.csv": "2"}, names=["evidence.csv"], overwrite=True)
    assert tree(tmp_path) == {"corner/a.png": "1", "evidence.csv": "2"}


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


def test_what_is_required_must_be_there(tmp_path):
    def written(*required):
        with whole_folder(tmp_path / "out", NAMES, required=required) as folder:
            (folder / "table.csv").write_text("t")

    with pytest.raises(OutputError, match=r"out: cannot be written \(corner/a\.png is missing"):
        written("table.csv", "corner/a.png")
    assert tree(tmp_path) == {}
    written("table.csv")
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
