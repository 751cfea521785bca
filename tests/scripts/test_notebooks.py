"""The notebooks run from the first cell, each by itself, and are stored without output."""

import base64
import re
from itertools import chain
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "notebooks").glob("*.ipynb"))
EACH_CASE = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
#: The first cell that each notebook gets here: examples have four subjects, and pictures are drawn
#: once. The site runs the notebooks as they are.
SMALL_EXAMPLES = """
from functools import partial
import bayes_toe
def fewer(whole, task="2afc", few=("S02", "S05", "S06", "S16")):
    return whole(task).select([name for name in few if name in whole(task).names])
bayes_toe.example_study = partial(fewer, bayes_toe.example_study)
get_ipython().run_line_magic("config", "InlineBackend.print_figure_kwargs = {'bbox_inches': None}")
"""
#: Patterns of numbers in the stored cells, and the smaller numbers that run here.
SMALLER_NUMBERS = {
    r"replicates=\d+": "replicates=20",
    r"draws=[\d_]{4,}": "draws=2_000",
    r"0\.6, 60\)": "0.6, 12)",
}
N_FIGURES = {"corner_exploration": 4, "paper": 8}


@pytest.fixture(scope="module")
def run():
    """A function that runs cells and returns them with their outputs.

    One kernel serves all notebooks, because most of the time is the import of the libraries.
    """
    client = NotebookClient(nbformat.v4.new_notebook(), timeout=300, kernel_name="python3")

    def executed(*cells):
        client.nb = nbformat.v4.new_notebook(cells=list(cells))
        return [client.execute_cell(cell, i) for i, cell in enumerate(cells)]

    with client.setup_kernel():
        executed(nbformat.v4.new_code_cell(SMALL_EXAMPLES))
        yield executed


@EACH_CASE
def test_stored_without_output_and_says_that_the_data_are_synthetic(path):
    notebook = nbformat.read(path, as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in notebook.cells)
    words = " ".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown").split()
    assert "data are synthetic" in " ".join(words)


@EACH_CASE
def test_runs_from_any_folder_and_draws(path, run, tmp_path):
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        for stored, fewer in SMALLER_NUMBERS.items():
            cell.source = re.sub(stored, fewer, cell.source)
    # Without the variables of the notebook before.
    fresh = nbformat.v4.new_code_cell(f"%reset -f\nimport os\nos.chdir({str(tmp_path)!r})")
    cells = run(fresh, *notebook.cells)
    outputs = list(chain.from_iterable(cell.get("outputs", []) for cell in cells))
    pictures = [
        base64.b64decode(element["data"]["image/png"])
        for element in outputs
        if "image/png" in element.get("data", {})
    ]
    assert len(pictures) == N_FIGURES[path.stem]
    # A blank figure of this size has about 3,000 bytes.
    assert min(map(len, pictures)) > 10_000
    assert not [output for output in outputs if output.get("name") == "stderr"]
    assert not list(tmp_path.iterdir())


def test_all_notebooks_are_there():
    assert [path.stem for path in NOTEBOOKS] == sorted(N_FIGURES)
