"""Commands on a small study: each ends well and writes what it promises.

What takes draws has tests in the files of its own subpackage.
"""

import pytest
from commands import good


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study of two synthetic subjects."""
    folder = tmp_path_factory.mktemp("column")
    good("simulate -o study.csv --subjects 2 --batches 20 --seed 3", cwd=folder)
    good("check study.csv", cwd=folder)
    return folder


@pytest.mark.parametrize(
    "line", ["evidence study.csv -o out.csv --seed 1", "fit study.csv -o out.csv --replicates 20"]
)
def test_a_table_has_both_subjects(folder, line):
    good(f"{line} --overwrite", cwd=folder)
    assert len((folder / "out.csv").read_text().splitlines()) == 3
