"""Files are read at once, and only where that ends."""

import os
from pathlib import Path

import pytest

from bayes_toe.data.input_bytes import input_bytes


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
