"""Figures as files."""

import io

import pytest
from PIL import Image

from bayes_toe.errors import InputError, OutputError
from bayes_toe.plots.figure_files import png, require_figure
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
    image = Image.open(io.BytesIO(png(figure, dpi=100)))
    assert (image.mode, image.size) == ("RGB", (300, 200))
    colours = {colour for _, colour in image.getcolors(1 << 16)}
    assert {(255, 255, 255), (0x00, 0x72, 0xB2), (0, 0, 0)} < colours
    assert png(figure, dpi=100) == png(figure, dpi=100)
