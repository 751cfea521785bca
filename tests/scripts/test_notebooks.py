"""The notebooks run in a fresh kernel, and are stored without output."""

import base64
import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "notebooks").glob("*.ipynb"))
#: As in the fixture three_models, and at most 500 draws; building the site runs the notebooks as they are.
QUICKER = """
from functools import partial
import bayes_toe.analysis
from bayes_toe.model.ladder import CROSSED, models_of
CROSSED.update({task: {} for task in CROSSED})
models_of.cache_clear()
bayes_toe.analysis.subject_fit = partial(bayes_toe.analysis.subject_fit, replicates=100)
"""
IMAGES = {"compositions": 2, "corner_exploration": 5, "paper": 13, "planning": 2, "quickstart": 3}


def _outputs(notebook):
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def _pictures(notebook):
    found = [output["data"]["image/png"] for output in _outputs(notebook) if "image/png" in output.get("data", {})]
    return [base64.b64decode(picture) for picture in found]


def test_all_notebooks_are_there():
    assert [path.stem for path in NOTEBOOKS] == sorted(IMAGES)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_without_output(path):
    notebook = nbformat.read(path, as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    assert (notebook.nbformat, notebook.nbformat_minor) == (4, 5)
    assert notebook.metadata.kernelspec.name == "python3"
    assert len({cell.id for cell in notebook.cells}) == len(notebook.cells)
    for cell in notebook.cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_says_that_the_data_are_synthetic(path):
    notebook = nbformat.read(path, as_version=4)
    words = " ".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown").split()
    assert "data are synthetic" in " ".join(words)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs_from_any_folder_and_draws(path, tmp_path):
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        cell.source = re.sub(r"draws=[\d_]{4,}", "draws=500", cell.source)
    notebook.cells.insert(0, nbformat.v4.new_code_cell(QUICKER))
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    pictures = _pictures(notebook)
    assert len(pictures) == IMAGES[path.stem]
    assert all(len(picture) > 10_000 for picture in pictures)  # a blank figure of this size has about 3,000 bytes
    assert not [output for output in _outputs(notebook) if output.get("name") == "stderr"]
    assert not list(tmp_path.iterdir())
