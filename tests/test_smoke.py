"""Commands on a small study: each ends well and writes what it promises.

What takes draws has tests in its own room's files.
"""

import pytest
from commands import good


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study of two synthetic subjects."""
    place = tmp_path_factory.mktemp("column")
    good("simulate", "-o", "study.csv", "--subjects", 2, "--batches", 20, "--seed", 3, cwd=place)
    return place


@pytest.mark.parametrize(
    ("words", "outputs"),
    [
        (["check", "study.csv"], []),
        (["evidence", "study.csv", "-o", "evidence.csv", "--seed", 1], ["evidence.csv"]),
        (["fit", "study.csv", "-o", "fit.csv", "--replicates", 200, "--seed", 1], ["fit.csv"]),
    ],
    ids=lambda value: value[0] if value and "." not in value[0] else "",
)
def test_the_column(folder, words, outputs):
    good(*words, cwd=folder)
    for name in outputs:
        assert len((folder / name).read_text(encoding="utf-8").splitlines()) >= 3
