"""What cannot be written, by the real command: one line, exit code 2, what was there before is there; no traceback, no crash."""

import os
import resource
import shutil
import signal
import subprocess
import sys

import pytest
from commands import PROGRAM, call, inside

#: The command line, killed when so many files (the first argument) have been put in their places.
KILLED = """
import os, signal, sys
from bayes_toe.cli.app import main
from bayes_toe.data import whole_folders
real, left = whole_folders.put_in_place, int(sys.argv.pop(1))
def put(*given):
    global left
    left -= 1
    if left < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    real(*given)
whole_folders.put_in_place = put
main()
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a study of one subject."""
    folder = tmp_path_factory.mktemp("place")
    assert inside("simulate", "-o", folder / "study.csv", "--subjects", 1, "--seed", 1, "-q").returncode == 0
    return folder


def content(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def one_line(done):
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1, done.stderr
    return done.stderr


@pytest.mark.parametrize(("command", "name"), [("sample", "posterior.nc.partial"), ("run", "out.partial")])
def test_a_full_disk_is_one_line_and_leaves_what_was_there(place, tmp_path, command, name):
    limit = 100_000  # of a file, in bytes
    out = tmp_path / "out"
    out.mkdir()
    (out / "posterior.nc").write_text("old")
    words = [command, place / "study.csv", "-o", out / "posterior.nc" if command == "sample" else out, "--draws", 100, "--seed", 1]
    done = subprocess.run(
        [*PROGRAM, *map(str, words), "--workers", "1", "--overwrite", "-q"],
        capture_output=True,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert f"{name}: cannot be written (File too large)" in one_line(done)
    assert ".bayes_toe" not in done.stderr
    assert content(out) == {"posterior.nc": b"old"}


@pytest.mark.parametrize("command", ["sample", "run", "evidence"])
def test_what_will_not_fit_is_known_before_the_work(place, tmp_path, monkeypatch, command):
    free = 10**6 if command != "evidence" else 10**4
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(free, 0, free))
    monkeypatch.setattr("bayes_toe.analysis._survivors", lambda *_: pytest.fail("the work began"))
    done = inside(command, place / "study.csv", "-o", tmp_path / "out", "-q")
    assert "MB are needed, " in one_line(done)
    assert list(tmp_path.iterdir()) == []


def test_an_output_folder_that_is_deleted_meanwhile_is_no_success(place, tmp_path, monkeypatch):
    from bayes_toe.cli import results_folder

    out, write = tmp_path / "out", results_folder.write_report
    out.mkdir()

    def deleted(*given):
        shutil.rmtree(out)
        write(*given)

    words = ("run", place / "study.csv", "-o", out, "--draws", 100, "--seed", 1, "--workers", 1, "--pictures", "none")
    monkeypatch.setattr(results_folder, "write_report", deleted)
    done = inside(*words)
    assert "cannot be written" in one_line(done)
    assert "results in" not in done.stdout
    monkeypatch.setattr(results_folder, "write_report", lambda *_: None)
    assert "report.html is missing" in one_line(inside(*words, "--resume"))
    monkeypatch.setattr(results_folder, "write_report", write)
    draw = results_folder._draw_subject

    def lost(*given):
        draw(*given)
        given[-2].unlink()

    monkeypatch.setattr(results_folder, "_draw_subject", lost)
    assert "cannot be written" in one_line(inside(*words, "--pictures", "all", "--resume"))


@pytest.mark.parametrize("moved", [0, 1, 2])
def test_killed_between_two_renames_is_all_or_nothing(tmp_path, moved):
    study, truth = tmp_path / "study.csv", tmp_path / "truth.csv"
    study.write_text("old study")
    truth.write_text("old truth")
    words = ["simulate", "-o", study, "--truth", truth, "--subjects", 1, "--batches", 1, "--seed", 1]
    done = subprocess.run([sys.executable, "-c", KILLED, str(moved), *map(str, words), "--overwrite"], capture_output=True)
    assert done.returncode == (0 if moved == 2 else -signal.SIGKILL)
    assert (study.read_text() != "old study") is (moved > 0)
    assert "exists" in one_line(inside(*words))  # and puts back what was there
    news = [text != f"old {name}".encode() for name, text in (("study", study.read_bytes()), ("truth", truth.read_bytes()))]
    assert news == [moved == 2] * 2
    assert sorted(content(tmp_path)) == ["study.csv", "truth.csv"]


@pytest.mark.parametrize(
    "words", [["check", "STUDY"], ["asymmetry", "STUDY", "-o", "OUT", "--overwrite"], ["--help"]], ids=lambda words: words[0]
)
def test_closed_and_full_streams(place, tmp_path, words):
    line = [str({"STUDY": place / "study.csv", "OUT": tmp_path / "asymmetry.csv"}.get(word, word)) for word in words]

    def shell(ending):
        return subprocess.run(["sh", "-c", f'"$@" {ending}', "sh", *PROGRAM, *line], capture_output=True, text=True)

    closed, full, both, read = (shell(ending) for ending in (">&-", ">/dev/full", "<&- >&- 2>&-", "| :"))
    assert [done.returncode for done in (closed, full, both, read)] == [0, 2, 0, 0]
    assert one_line(full) == "error: standard output: cannot be written (No space left on device)\n"
    assert [done.stderr for done in (closed, both, read)] == [""] * 3
    assert (tmp_path / "asymmetry.csv").exists() is ("OUT" in words)  # a log that is full costs no results


def test_a_plain_environment(place, tmp_path):
    plain = {
        "LC_ALL": "C",
        "PYTHONIOENCODING": "ascii",
        "PYTHONUTF8": "0",
        "PYTHONCOERCECLOCALE": "0",
        "HOME": "/nonexistent",
        "TMPDIR": "/no",
    }
    done = call("asymmetry", place / "study.csv", "-o", tmp_path / "a.csv", **plain)
    assert (done.returncode, done.stderr) == (0, "")
    assert r"\xb1" in done.stdout  # the plus-minus sign, which ASCII lacks


def test_no_home_and_no_temporary_folder(place, tmp_path):
    """Libraries that keep a cache at home end in a traceback there, or leave a folder ~ where the command was called."""
    nowhere = place / "study.csv" / "home"
    done = call(
        "sample",
        place / "study.csv",
        "-o",
        "a.nc",
        "--draws",
        100,
        "--workers",
        1,
        "-q",
        cwd=tmp_path,
        HOME=str(nowhere),
        TMPDIR=str(nowhere),
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["a.nc"]


def test_pipes_and_devices_are_refused(place, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        for words in (["check", path], ["check", place / "study.csv", "--prior", path]):
            assert "a pipe or device, not a file" in one_line(inside(*words))
