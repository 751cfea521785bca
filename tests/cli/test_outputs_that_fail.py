"""What cannot be written, by the real command.

One line, exit code 2, what was there before is there; no traceback, no crash.
"""

import errno
import os
import resource
import subprocess

import pytest
from commands import PROGRAM, call, on_one_line, output_of, run_command, run_ok
from conftest import each_row, quick_study, write_counts


@pytest.fixture(scope="module")
def study_folder(tmp_path_factory):
    """A folder with study.csv, a simulated study of one subject, and nothing else."""
    folder = tmp_path_factory.mktemp("study_folder")
    run_ok("simulate -o study.csv --subjects 1 --seed 1", cwd=folder)
    return folder


def error_line(finished):
    """The one line of stderr of a command that must end with exit code 2."""
    assert finished.returncode == 2, finished.stderr
    assert finished.stderr.startswith("error: ")
    assert finished.stderr.count("\n") == 1, finished.stderr
    return finished.stderr


def run_in_shell(script, line, cwd=None):
    """Run a command in a shell, by a script in which "$@" stands for it, such as '"$@" | :'."""
    words = ["sh", "-c", script, "sh", *PROGRAM, *line.split()]
    return subprocess.run(words, capture_output=True, text=True, cwd=cwd)


def test_a_full_disk_is_one_line_and_leaves_what_was_there(study_folder, tmp_path):
    file = tmp_path / "out" / "posterior.nc"
    file.parent.mkdir()
    file.write_text("old")
    # No file may have more than 100,000 bytes, and the draws need more.
    soft_limit, hard_limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard_limit))
    try:
        options = "--draws 100 --seed 1 --overwrite -q"
        finished = run_command(f"run {study_folder}/study.csv -o {file.parent} {options}")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft_limit, hard_limit))
    assert "out.partial: cannot be written (File too large)" in error_line(finished)
    assert ".bayes_toe" not in finished.stderr  # the name of a temporary folder
    assert file.read_text() == "old"
    assert list(file.parent.iterdir()) == [file]


def test_if_one_of_two_files_cannot_be_written_none_is_replaced(tmp_path, monkeypatch):
    # There is room for the first file, a.csv, and none for the second one.
    def write_table_on_full_disk(frame, path):
        if path.name == "b.csv":
            raise OSError(errno.ENOSPC, "No space left on device")
        path.write_text("new")

    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for file in files:
        file.write_text("old")
    monkeypatch.setattr("bayes_toe.data.tables.write_table", write_table_on_full_disk)
    finished = run_command("simulate -o a.csv --truth b.csv --overwrite", cwd=tmp_path)
    assert "error: b.csv: cannot be written (No space left on device)" in error_line(finished)
    assert [file.read_text() for file in files] == ["old", "old"]
    assert sorted(tmp_path.iterdir()) == files


def test_results_with_closed_streams_also_of_workers_are_those_with_open_ones(tmp_path):
    write_counts(tmp_path / "study.csv", quick_study("AB"))
    line = "fit study.csv --seed 1 --replicates 5"
    run_ok(f"{line} -o open.csv", cwd=tmp_path)
    closed = '"$@" <&- >&- 2>&-'
    output_of(run_in_shell(closed, f"{line} -o closed.csv --workers 2", cwd=tmp_path))
    assert (tmp_path / "closed.csv").read_bytes() == (tmp_path / "open.csv").read_bytes()


def test_a_full_standard_output_is_one_line_and_the_results_stay(tmp_path):
    line = "simulate -o full.csv --subjects 1 --seed 1"
    error = error_line(run_in_shell('"$@" >/dev/full', line, cwd=tmp_path))
    assert error.startswith("error: standard output: cannot be written (No space left")
    assert (tmp_path / "full.csv").exists()


def test_output_into_a_program_that_reads_nothing_is_no_error():
    output_of(run_in_shell('"$@" | :', "--help"))


def test_run_needs_no_home_no_temporary_folder_and_no_letters_beyond_ascii(study_folder, tmp_path):
    """Libraries with a cache at home fail there, or leave a folder ~ in the working folder.

    The folders for these are below a file, so that nobody can make them, and text is ASCII.
    """
    plain = {"LC_ALL": "C", "PYTHONIOENCODING": "ascii"}
    plain |= dict.fromkeys(["PYTHONUTF8", "PYTHONCOERCECLOCALE"], "0")
    plain |= dict.fromkeys(["HOME", "TMPDIR"], str(study_folder / "study.csv" / "home"))
    write_counts(tmp_path / "study.csv", quick_study(["\xe9"]))
    line = "run study.csv -o out --figures none --draws 100 --seed 1"  # the report has figures
    finished = call(line, cwd=tmp_path, **plain)
    # Matplotlib says so on a slow machine, since it has no place for what it knows of fonts.
    slow = "Matplotlib is building the font cache; this may take a moment.\n"
    assert (finished.returncode, finished.stderr.replace(slow, "")) == (0, "")
    assert r"\xe9" in finished.stdout  # a letter that ASCII lacks
    assert sorted(os.listdir(tmp_path)) == ["out", "study.csv"]


def test_pipes_and_devices_are_refused(study_folder, tmp_path):
    # Neither as a study nor as a prior file.
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        for line in (f"check {path}", f"check {study_folder}/study.csv --prior {path}"):
            assert "a pipe or device, not a file" in error_line(run_command(line))


def test_a_working_folder_that_is_gone_is_refused_in_one_line(tmp_path):
    # The shell removes its working folder and then starts the command.
    removed = tmp_path / "gone"
    removed.mkdir()
    finished = run_in_shell(f'cd "{removed}" && rmdir "{removed}" && "$@"', "check study.csv")
    assert "the working folder cannot be used" in error_line(finished)


def test_python_without_docstrings_is_refused_in_one_line():
    # Python at the optimisation level 2 has no docstrings, from which the help is made.
    finished = call("check study.csv", PYTHONOPTIMIZE="2", PYTHONDONTWRITEBYTECODE="1")
    assert "unset the variable" in error_line(finished)


LONG = "y" * 250
#: A name that leaves no room for its partial folder, folders, names that are no file, and a name
#: that is given twice.
REFUSED_NAMES = f"""
    sample study.csv -o {LONG} | File name too long
    run study.csv -o {LONG} | File name too long
    evidence study.csv -o {LONG} | File name too long
    evidence study.csv -o '' | allowed: the name of a file
    sample study.csv -o . | allowed: the name of a file
    fit study.csv -o .. | is a folder
    fit --example -o - | allowed: the name of a file
    fit --example -o new/ | allowed: the name of a file
    run --example -o - | allowed: the name of a file
    fit --example --asymmetry - | allowed: the name of a file
    fit --example --asymmetry new/ | allowed: the name of a file
    simulate -o a.csv --truth new/ | allowed: the name of a file
    simulate -o a.csv --truth a.csv | error: a.csv: named for two outputs. Use two names.
    history study.csv -o a.png | error: a.png: named for two outputs. Use two names.
"""


@each_row("line, message", REFUSED_NAMES)
def test_names_that_no_output_can_have_are_refused(study_folder, line, message):
    # Such as 'fit --example -o new/', with the message that the name of a file is allowed.
    finished = run_command(line, cwd=study_folder)
    assert (finished.returncode, finished.stdout) == (2, "")
    assert message in on_one_line(finished.stderr)
    assert os.listdir(study_folder) == ["study.csv"]
