"""Files are read at once, and only where that ends."""

import os
from pathlib import Path

import numpy as np
import pytest
from commands import call
from scipy.io import savemat

import bayes_toe as bt
from bayes_toe.data.read_study import read_study
from bayes_toe.data.text_table import input_bytes
from bayes_toe.errors import InputError


def test_a_file_of_any_size_up_to_the_largest(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"1234")
    assert input_bytes(file, 4) == b"1234"
    with pytest.raises(OSError, match="4 bytes, more than 3"):
        input_bytes(file, 3)


def test_what_may_have_no_end(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(OSError, match="a pipe or device"):
            input_bytes(path)
    with pytest.raises(IsADirectoryError):
        input_bytes(tmp_path)


def test_a_damaged_matlab_file_that_ends_the_process_that_reads_it_is_one_line(tmp_path: Path) -> None:
    columns = {"subject": "M1", "s1": np.array([0.0, 0.3, 0.0]), "s2": np.array([0.3, 0.0, 0.0]), "response": np.array([1, 0, 1])}
    savemat(tmp_path / "trials.mat", columns)
    assert read_study(tmp_path / "trials.mat")["M1"].n_equal.tolist() == [1, 1, 0]
    whole = bytearray((tmp_path / "trials.mat").read_bytes())
    whole[172] = 9  # of the type of a variable's flags: scipy 1.17 reads beyond its memory, and dies of signal 11
    (tmp_path / "trials.mat").write_bytes(whole)
    with pytest.raises(InputError, match=r"^trials\.mat: found a damaged MATLAB file \(.*\), allowed: one that MATLAB has saved"):
        read_study(tmp_path / "trials.mat")


LONG = 300 * "x"


@pytest.mark.parametrize(
    "command",
    [
        ("check", LONG),
        ("check", f"{LONG}.mat"),
        ("check", "example.csv", f"{LONG}.csv"),
        ("simulate", "-o", "out.csv", "--design", LONG),
        ("simulate", "-o", "out.csv", "--population", f"{LONG}.csv"),
        ("methods", LONG),
        ("predict", LONG, "pairs.csv"),
    ],
)
def test_a_name_that_is_too_long_for_a_file_is_one_line(tmp_path: Path, command: tuple[str, ...]) -> None:
    bt.example_study().frame().to_csv(tmp_path / "example.csv", index=False)
    done = call(*command, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stderr.startswith("error: ")
