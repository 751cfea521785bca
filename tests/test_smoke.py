"""The whole column on a small study, command by command: each ends well and writes what it promises."""

import pytest
from commands import inside


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study of two synthetic subjects, and all that commands make of it."""
    place = tmp_path_factory.mktemp("column")
    assert inside("simulate", "-o", "study.csv", "--subjects", 2, "--batches", 20, "--seed", 3, cwd=place).returncode == 0
    return place


@pytest.mark.parametrize(
    ("words", "outputs"),
    [
        (["check", "study.csv"], []),
        (
            ["run", "study.csv", "-o", "results", "--pictures", "none", "--draws", 400],
            ["results/report.html", "results/evidence.csv", "results/posterior.nc"],
        ),
        (["sample", "study.csv", "-o", "other.nc", "--model", "constant error", "--draws", 400], ["other.nc"]),
        (["evidence", "study.csv", "-o", "evidence.csv"], ["evidence.csv"]),
        (["compare", "study.csv", "-o", "compare.csv", "--model", "update", "--model", "none", "--draws", 400], ["compare.csv"]),
        (["population", "study.csv", "-o", "population.nc", "--model", "symmetric", "--draws", 20], ["population.nc", "population.csv"]),
        (["asymmetry", "study.csv", "-o", "asymmetry.csv"], ["asymmetry.csv"]),
        (["fit", "study.csv", "-o", "fit.csv", "--replicates", 200], ["fit.csv"]),
        (["explore", "results/posterior.nc", "-o", "explorer.html"], ["explorer.html"]),
        (["corner", "results/posterior.nc", "-o", "corner", "--subject", "S01"], ["corner"]),
        (["predict", "results/posterior.nc", "study.csv", "-o", "predicted.csv"], ["predicted.csv"]),
        (["methods", "results"], []),
    ],
    ids=lambda value: value[0] if value and "." not in value[0] else "",
)
def test_the_column(folder, three_models, words, outputs):
    seeded = words[0] in {"run", "sample", "evidence", "compare", "population", "fit"}
    done = inside(*words, *(["--seed", 1] if seeded else []), cwd=folder)
    assert done.returncode in {0, 3}, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    for name in outputs:
        assert (folder / name).exists()
        if name.endswith(".csv"):
            assert len((folder / name).read_text(encoding="utf-8").splitlines()) >= 3
