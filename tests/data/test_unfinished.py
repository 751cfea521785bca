"""What was left unfinished goes where its process is dead, and only there."""

import os
import subprocess
import sys

import pytest

from bayes_toe.data.unfinished import free_name, sweep
from bayes_toe.data.whole_folders import put_back


@pytest.fixture
def dead(monkeypatch):
    """Makes names as a process makes them that is dead now."""
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()

    def name(folder, suffix=""):
        with monkeypatch.context() as patch:
            patch.setattr(os, "getpid", lambda: ended.pid)
            return free_name(folder, suffix)

    return name


def test_files_and_folders_of_the_dead_go_and_all_else_stays(tmp_path, dead):
    dead(tmp_path, ".csv").write_text("half")
    work = dead(tmp_path)
    (work / "new").mkdir(parents=True)
    (work / "old").mkdir()
    (work / "new" / "a.txt").write_text("half")
    elsewhere = dead(tmp_path)
    kept = [free_name(tmp_path, ".nc"), tmp_path / ".bayes_toe-mine", elsewhere.with_name(elsewhere.name.replace("toe-", "toe-0"))]
    for path in kept:
        path.write_text("of someone else")
    sweep(tmp_path)
    put_back(tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted(kept)


def test_the_only_copy_of_what_was_being_replaced_stays(tmp_path, dead):
    kept = dead(tmp_path) / "old" / "a.txt"
    kept.parent.mkdir(parents=True)
    kept.write_text("the results before")
    sweep(tmp_path)
    assert kept.exists()


def test_where_there_is_no_folder_nothing_is_swept(tmp_path):
    sweep(tmp_path / "none")
