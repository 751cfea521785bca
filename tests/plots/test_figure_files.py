"""Figures as files."""

import io

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.image import imread

from bayes_toe.errors import InputError, OutputError
from bayes_toe.plots.figure_files import picture, require_figure
from bayes_toe.plots.style import POSTERIOR, new_figure


def test_a_figure_is_refused_before_it_is_drawn(tmp_path):
    (tmp_path / "old.png").write_text("precious")
    with pytest.raises(InputError, match="suffix 'xyz'"):
        require_figure(tmp_path / "new.xyz")
    with pytest.raises(OutputError, match="exists"):
        require_figure(tmp_path / "old.png")
    require_figure(tmp_path / "old.png", overwrite=True)
    require_figure(tmp_path / "new.pdf")
    assert [path.name for path in tmp_path.iterdir()] == ["old.png"]


def test_a_picture_is_what_the_figure_is_and_the_same_each_time():
    figure = new_figure(3.0, 2.0)
    ax = figure.subplots()
    ax.barh([0, 1], [1, 2], color=POSTERIOR)
    ax.set_title("words")
    image = imread(io.BytesIO(picture(figure, "png", dpi=100)))
    assert image.shape[:2] == (200, 300)
    colours = {to_hex(colour) for colour in np.unique(image.reshape(-1, image.shape[2]), axis=0)}
    assert {"#ffffff", POSTERIOR.lower(), "#000000"} < colours
    for suffix in ("pdf", "png", "svg"):
        assert picture(figure, suffix) == picture(figure, suffix)
