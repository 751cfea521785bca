"""The corner plot without Axes, against the one that the corner package draws."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D
from matplotlib.path import Path

import bayes_toe as bt
from bayes_toe.model.coordinates import NATURAL
from bayes_toe.plots.corner_content import BINS, BOTTOM, GAP, LEFT, MARKED, PANEL, TRUTH
from bayes_toe.plots.corner_sheet import corner_sheet
from bayes_toe.plots.density import Density
from bayes_toe.plots.style import POSTERIOR

TRUE = {"mu1": -0.7, "sigma_p": 0.25, "sigma_l": 0.17, "q0": 0.001}


@pytest.fixture(scope="module")
def pair(analysis):
    return [draw(analysis.draws, "A", truths=TRUE, prior=bt.Prior()) for draw in (bt.plots.corner, corner_sheet)]


def share(points, i, j):
    """Where points of the sheet, inches, lie in a panel."""
    return (points - (LEFT + j * (PANEL + GAP), BOTTOM + (3 - i) * (PANEL + GAP))) / PANEL


def inside(points):
    return {tuple(point) for point in points.round(5).tolist() if min(point) > 0 and max(point) < 1}


def lines(figure, colour):
    return [one.get_segments() for one in figure.artists if isinstance(one, LineCollection) and to_hex(one.get_colors()[0]) == colour]


def test_contours_are_those_of_the_figure_with_axes(pair):
    theirs, ours = pair
    axes = np.array(theirs.axes).reshape(4, 4)
    drawn = [one.get_paths() for one in ours.artists if isinstance(one, PathCollection)]
    assert len(drawn) == 6
    for (j, i), areas in zip([(0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3)], drawn, strict=True):
        contours = axes[i, j].collections[-1].get_paths()
        assert len(contours) == len(areas) == 2
        for contour, area in zip(contours, areas, strict=True):
            there = axes[i, j].transLimits.transform(contour.vertices)
            assert inside(there) == inside(share(area.vertices, i, j))
            assert len(inside(there)) > 10


def test_histograms_and_quantiles_are_of_all_draws(analysis, pair):
    theirs, ours = pair
    axes = np.array(theirs.axes).reshape(4, 4)
    bars, marked = lines(ours, POSTERIOR.lower())
    for i, name in enumerate(NATURAL):
        low, high = axes[i, i].get_xlim()
        values = analysis.draws.values("A", name).ravel()
        counts = np.histogram(values, np.linspace(low, high, BINS + 1))[0]
        assert share(bars[i], i, i)[::2, 1] * axes[i, i].get_ylim()[1] == pytest.approx(counts)
        at = [low + (high - low) * share(line, i, i)[0, 0] for line in marked[3 * i : 3 * i + 3]]
        assert at == pytest.approx(np.quantile(values, MARKED))
    [grey] = lines(ours, "#999999")
    [prior] = [patch.get_data().values for patch in axes[1, 1].patches if patch.get_label() == "prior"]
    assert share(grey[1], 1, 1)[::2, 1] * axes[1, 1].get_ylim()[1] == pytest.approx(prior)


def test_true_values_are_drawn_where_they_lie_inside(pair):
    theirs, ours = pair
    [red] = lines(ours, TRUTH.lower())
    upright = [line for line in red if line[0, 0] == line[1, 0]]
    assert (len(upright), len(red) - len(upright)) == (4 + 3 + 2, 1 + 2)  # none of q0, which lies outside
    squares = [one.get_xydata()[0] for one in ours.artists if isinstance(one, Line2D)]
    places = [share(square, i, j) for square, (i, j) in zip(squares, [(1, 0), (2, 0), (2, 1)], strict=True)]
    limits = [theirs.axes[5 * k].get_xlim() for k in range(4)]
    at = [(TRUE[name] - low) / (high - low) for name, (low, high) in zip(NATURAL, limits, strict=True)]
    assert np.array(places) == pytest.approx(np.array([(at[0], at[1]), (at[0], at[2]), (at[1], at[2])]))
    said = [text.get_text() for text in theirs.texts]
    assert said == [text.get_text() for text in ours.texts[-len(said) :]]
    assert "true value outside: $q_0$ = 0.001" in said


def test_words_are_clear_of_the_panels_and_of_each_other(pair):
    _, ours = pair
    ours.draw_without_rendering()
    boxes = [text.get_window_extent() for text in ours.texts if text.get_rotation() != 45]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    around = [text.get_window_extent() for text in ours.texts]
    assert all(ours.bbox.x0 <= box.x0 < box.x1 <= ours.bbox.x1 and ours.bbox.y0 <= box.y0 < box.y1 <= ours.bbox.y1 for box in around)


def held(areas, points):
    """Share of points within each area."""
    rings = [[Path(ring) for ring in area.to_polygons()] for area in areas]  # a ring in a ring is a hole
    return [np.mean(np.sum([ring.contains_points(points) for ring in within], axis=0) % 2) for within in rings]


def test_areas_hold_their_shares_of_a_narrow_peak_with_long_tails():
    rng = np.random.default_rng(1)
    x = rng.standard_t(1.5, 20_000)
    y = np.exp(-0.5 * np.abs(x)) + rng.normal(0.0, 0.02, x.size)
    spans = [tuple(np.quantile(values, [0.005, 0.995]).tolist()) for values in (x, y)]
    found = Density.of(x, y, *spans).areas(*spans)
    assert held(found, np.column_stack([x, y])) == pytest.approx([0.9, 0.5], abs=0.01)


def test_draws_that_are_one_point_have_an_area_of_nothing():
    x = np.full(100, 0.5 / BINS)  # the middle of the first bin, where the density is largest
    wide, narrow = Density.of(x, x, (0.0, 1.0), (0.0, 1.0)).areas((0.0, 1.0), (0.0, 1.0))
    assert len(wide.vertices) == len(narrow.vertices) == 0
