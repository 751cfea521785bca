"""The last resort of a command that is stopped, and what it says is there."""

import signal
import subprocess
import sys

import pytest

from bayes_toe.data.whole_files import HIDDEN, finished, unfinished, whole_file, whole_folder

DEAF = """
import time
from bayes_toe.cli import stopping
stopping.PATIENCE = 0.5
stopping.listen()
while True:
    try:
        print("ready", flush=True)
        time.sleep(60)
    except BaseException:
        pass
"""
UNDER_NOHUP = """
import signal
from bayes_toe.cli.stopping import listen
signal.signal(signal.SIGTERM, signal.SIG_IGN)
assert signal.SIGTERM not in listen()
signal.raise_signal(signal.SIGTERM)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_library_that_swallows_the_exception_does_not_keep_the_command():
    with subprocess.Popen([sys.executable, "-c", DEAF], stdout=subprocess.PIPE, text=True) as deaf:
        assert deaf.stdout.readline() == "ready\n"
        deaf.send_signal(signal.SIGTERM)
        assert deaf.wait(60) == 128 + signal.SIGTERM


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_signal_that_is_ignored_on_purpose_goes_on_being_ignored():
    assert subprocess.run([sys.executable, "-c", UNDER_NOHUP], timeout=60).returncode == 0


def test_what_has_its_name_already_is_known_and_what_is_inside_an_unfinished_folder_is_not(tmp_path):
    del finished[:]
    with unfinished(tmp_path) as inside, whole_file(inside / "a.csv") as path:
        path.touch()
    with pytest.raises(ValueError, match="not done"), whole_folder(tmp_path / "broken", ["a"]):
        raise ValueError("not done")
    assert finished == []
    with whole_folder(tmp_path / "out", ["b"]) as folder:
        (folder / "b").touch()
    with whole_file(tmp_path / "c.csv") as path:
        path.touch()
    assert finished == [tmp_path / "out", tmp_path / "c.csv"]
    assert not list(tmp_path.glob(f"{HIDDEN}*"))
