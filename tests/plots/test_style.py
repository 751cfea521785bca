"""What all figures share: the label of synthetic data, and names as text."""

import io
import json
from functools import partial

import numpy as np
import pytest
from conftest import refused
from legible import words_of
from matplotlib.image import imread
from matplotlib.text import Text

import bayes_toe as bt
from bayes_toe.plots.figure_files import figure_bytes
from bayes_toe.plots.style import grid_panels, label_outer, new_figure, plain


def test_synthetic_data_are_labelled_wherever_they_are_shown(analysis):
    # The draws as if their study were synthetic, which their attribute says in JSON.
    draws = bt.Draws(analysis.draws.tree.copy())
    record = json.loads(draws.tree.attrs["study"])
    draws.tree.attrs["study"] = json.dumps(record | {"synthetic": True})
    for figure in (bt.plots.corner(draws, "A"), bt.plots.curves(draws, "A")):
        assert "synthetic" in " ".join(words_of(figure.findobj(Text)))
    figure = bt.plots.order_effect(analysis.evidence, synthetic=True)
    assert "synthetic" in figure.get_suptitle()


@pytest.mark.parametrize("name", bt.plots.__all__)
def test_an_argument_of_another_kind_is_refused_in_one_line(name):
    arguments = {"curves": ["A"], "corner": ["A"], "save_figure": ["a.png"]}.get(name, [])
    with refused("found NoneType, allowed:"):
        getattr(bt.plots, name)(None, *arguments)


def test_a_file_without_a_name_is_refused_in_one_line(analysis):
    figure = new_figure(1.0, 1.0)
    for save in (
        analysis.evidence.save,
        analysis.draws.save,
        partial(bt.plots.save_figure, figure),
    ):
        with refused("path: found NoneType, allowed: the name of a file"):
            save(None)


def test_names_are_shortened_to_what_tells_them_apart():
    assert len(plain("n" * 100)) == 32  # characters, if no limit is given
    names = [f"participant_of_the_study_{i:03d}" for i in range(40)]
    # The names differ in their last three characters, which stay also in ten characters.
    for limit in (10, 16, 24):
        short_names = {plain(name, limit) for name in names}
        assert len(short_names) == len(names)
        assert {len(name) for name in short_names} == {limit}


def test_figures_of_a_subject_say_that_its_draws_did_not_converge(analysis):
    # The draws are marked as if those of A, the first subject, had not converged.
    tree = analysis.draws.tree.copy(deep=True)
    tree["sample_stats"]["converged"][0] = 0
    tree["sample_stats"]["shortfall"][0] = "too few"
    draws = bt.Draws(tree)
    assert "NOT CONVERGED" in bt.plots.curves(draws, "A").get_suptitle()
    assert "NOT CONVERGED" not in bt.plots.curves(draws, "B").get_suptitle()


def test_the_last_panel_of_each_column_has_a_label():
    # Three panels in two columns: the second panel has no panel below it.
    panels = grid_panels(new_figure(5.0, 3.0), n_panels=3, n_columns=2)
    for panel in panels:
        panel.set_xlabel("x")
    label_outer(panels, n_columns=2)
    assert [panel.get_xlabel() for panel in panels] == ["", "x", "x"]


def test_a_file_of_a_figure_has_its_size_and_is_the_same_each_time():
    figure = new_figure(3.0, 2.0)
    ax = figure.subplots()
    ax.set_title("words")
    # 3 by 2 inches with 100 pixels each, and colours between black and white.
    image = imread(io.BytesIO(figure_bytes(figure, "png", dpi=100)))
    assert image.shape[:2] == (200, 300)
    assert len(np.unique(image)) > 2
    # Files have no time or random number in them.
    for suffix in ("pdf", "png", "svg"):
        assert figure_bytes(figure, suffix) == figure_bytes(figure, suffix)
