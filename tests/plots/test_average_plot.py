"""The figure of an average over models shows the average, and its words fit."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.comparison.average import Average, Averages
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.ladder import require_models


def averaged(counts):
    """Two models with a few points each, which need not be draws."""
    targets = [model.posterior(counts) for model in require_models(["symmetric", "constant error + sloped"])]
    drawn = tuple(Predictor(target, target.starts()[:20]) for target in targets)
    one = Average(counts, ("symmetric", "constant error + sloped"), np.array([0.7, 0.3]), drawn)
    return one, Averages((one,), {}, 1, bt.Prior(), synthetic=True)


def test_figure(small_study):
    one, table = averaged(small_study["A"])
    figure = bt.plots.plot_average(table, "A")
    figure.draw_without_rendering()
    title = figure._suptitle
    assert title.get_text().startswith("A: average over 2 models (synthetic data)\npull 0.00 (0.00, 0.00), none: 1.00\nconstant error ")
    assert title.get_text().endswith("none: 0.70")
    box = title.get_window_extent()
    assert box.x0 > 0
    assert box.x1 < figure.bbox.width
    (ax,) = figure.axes
    lines = [line for line in ax.lines if len(line.get_xdata()) == 120]
    x = lines[0].get_xdata()
    expected = [one.yes(*pair).mean(axis=0) for pair in ((0 * x, x), (x, 0 * x), (x, x))]
    assert all(line.get_ydata() == pytest.approx(mean) for line, mean in zip(lines, expected, strict=True))


def test_many_stimuli_are_drawn_over_their_difference():
    s1, s2 = (grid.ravel() for grid in np.meshgrid(*[np.linspace(0.0, 0.7, 8)] * 2))
    _, table = averaged(bt.Subject("A", s1, s2, np.full(64, 3), np.full(64, 6)))
    (ax,) = bt.plots.plot_average(table, "A").axes
    assert "difference" in ax.get_xlabel()
    assert sum(len(line.get_xdata()) for line in ax.lines if line.get_marker() == "_") == 64
