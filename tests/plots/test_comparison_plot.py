"""The figures of a comparison say what its tables say; what is withheld is shown as withheld."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgb
from matplotlib.patches import Rectangle

import bayes_toe as bt
from bayes_toe.comparison.model_comparison import ModelComparison
from bayes_toe.comparison.model_row import Checks, ModelRow
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.model.ladder import NAMES, models_of
from bayes_toe.plots.comparison import CLASSES, ORDER_COLOURS, OTHER_COLOURS, comparison_figure


def made(evidence, models=NAMES, probability=None):
    """A comparison with these log evidences (NaN: withheld), and nothing else in it."""
    evidence = np.asarray(evidence, float)
    subjects = tuple(f"P{i + 1}" for i in range(len(evidence)))
    rows = [
        ModelRow(subject, model, 2, None if np.isnan(value) else float(value), 0.0, None, Checks(), (), model_probability=probability)
        for subject, values in zip(subjects, evidence, strict=True)
        for model, value in zip(models, values, strict=True)
    ]
    return ModelComparison(tuple(rows), subjects, tuple(models), 1, bt.Prior())


def panels(table):
    """Panels of its parts and words, if there are parts, of the cells, and of the frequencies."""
    *parts, upper, lower = comparison_figure(table).axes
    return parts, upper, lower


def cells(ax):
    """Rectangles of a panel as (row, column) -> patch; and the numbers likewise."""
    patches = [one for one in ax.patches if isinstance(one, Rectangle)]
    found = {(round(one.get_y() + 0.5, 6), round(one.get_x() + 0.5, 6)): one for one in patches}
    return found, {(round(text.get_position()[1], 6), text.get_position()[0]): text.get_text() for text in ax.texts}


EVIDENCE = np.array([[-100.0, -103.04, -100.4, -120.0], [-50.0, np.nan, -41.0, -42.0], [-60.0, -62.0, -61.0, -260.0]])


def test_every_cell_has_its_number_and_its_class():
    table = made(EVIDENCE, NAMES[:4])
    ax = panels(table)[1]
    patches, numbers = cells(ax)
    assert len(patches) == 16  # three subjects and the sum
    below = {0: ["best", "3.0", "0.4", "20.0"], 1: ["9.0", None, "best", "1.0"], 2: ["best", "2.0", "1.0", "200"]}
    shades = {0: [0, 2, 1, 4], 1: [3, None, 0, 1], 2: [0, 2, 1, 4]}
    for i in range(3):
        for j in range(4):
            assert numbers.get((i, j)) == below[i][j]
            if shades[i][j] is not None:
                assert to_hex(patches[i, j].get_facecolor()) == CLASSES[shades[i][j]][2].lower()
                assert not patches[i, j].get_hatch()
    assert [label.get_text() for label in ax.get_yticklabels()] == ["P1", "P2", "P3", "sum of 2"]
    last = ax.get_yticks()[-1]
    assert [numbers[last, j] for j in range(4)] == ["best", "5.0", "1.4", "220"]  # P1 and P3 only
    low, high = sorted(ax.get_ylim())
    assert low <= -0.5
    assert last + 0.5 <= high


def test_a_withheld_evidence_is_hatched_named_and_its_subject_grey():
    ax = panels(made(EVIDENCE, NAMES[:4]))[1]
    patches, numbers = cells(ax)
    assert [place for place, one in patches.items() if one.get_hatch()] == [(1, 1)]
    assert (1, 1) not in numbers
    assert "withheld: subject not counted" in [text.get_text() for text in ax.get_legend().get_texts()]
    colours = [label.get_color() for label in ax.get_yticklabels()]
    assert colours[0] == colours[2] == "black" != colours[1]
    whole = panels(made(EVIDENCE[[0, 2]], NAMES[:4]))[1]
    assert "withheld" not in " ".join(text.get_text() for text in whole.get_legend().get_texts())


def test_a_rival_without_weight_counts():
    """Withheld, but bounded far below the best: no hatching, and the subject is one of the sum."""
    table = made(EVIDENCE, NAMES[:4])
    rows = [replace(row, bound=-300.0) if row.log_evidence is None else row for row in table]
    ax = panels(replace(table, rows=tuple(rows)))[1]
    patches, numbers = cells(ax)
    assert not any(one.get_hatch() for one in patches.values())
    assert numbers[1, 1] == numbers[ax.get_yticks()[-1], 1] == "∞"
    assert {label.get_color() for label in ax.get_yticklabels()} == {"black"}


def test_classes_are_told_apart_without_colour():
    grey = [np.dot(to_rgb(colour), [0.299, 0.587, 0.114]) for _, _, colour, _ in CLASSES]
    assert min(np.diff(grey)) > 0.1
    for value, (_, _, _, letters) in zip(grey, CLASSES, strict=True):
        assert abs(value - np.dot(to_rgb(letters), [0.299, 0.587, 0.114])) > 0.4


def lines(ax):
    return {line.get_label(): np.asarray(line.get_ydata(), float) for line in ax.lines}


def test_the_study_panel_shows_model_frequencies():
    table = made(np.random.default_rng(2).normal(size=(9, 4)) * 2, NAMES[:4])
    ax, found = panels(table)[2], table.frequencies()
    shown = lines(ax)
    assert np.array_equal(shown["expected frequency, 95 % interval"], found.expected)
    assert np.array_equal(shown["most frequent (exceedance)"], found.exceedance)
    assert np.array_equal(shown["the same, protected"], found.protected)
    assert set(shown["none preferred"]) == {0.25}
    bars = np.array([[bar[0, 1], bar[1, 1]] for bar in ax.collections[0].get_segments()])
    assert bars == pytest.approx(found.interval(), abs=0)
    title = ax.get_title(loc="left")
    assert "9 of 9 subjects, random effects, sampled" in title
    assert f"equally frequent with probability {found.omnibus_risk:.2f}" in title


def test_one_subject_has_probabilities_and_no_sum():
    table = made(np.zeros((1, 8)), probability=0.125)
    _, upper, lower = panels(table)
    assert [label.get_text() for label in upper.get_yticklabels()] == ["P1"]
    assert lines(lower)["model probability, equal prior odds"].tolist() == [0.125] * 8


@pytest.mark.parametrize(
    ("evidence", "models", "words"),
    [
        ([[np.nan, 0.0], [0.0, np.nan]], NAMES[:2], "no subject has an evidence under every model"),
        ([[0.0], [1.0]], NAMES[:1], "one model only"),
        ([[np.nan, 0.0]], NAMES[:2], "no model probabilities: an evidence is withheld"),
        ([[np.nan, np.nan], [1.0, 2.0]], NAMES[:2], ""),
    ],
)
def test_without_frequencies_the_panel_says_why(evidence, models, words):
    ax = panels(made(evidence, models))[2]
    assert words in " ".join(text.get_text() for text in ax.texts)
    ax.figure.draw_without_rendering()


#: Free frequencies, and of the default space the models with a bell of one peak.
SPACE = tuple(
    model.name for model in models_of(SAME_DIFFERENT).compared if not {("curve", "differencing"), ("peak", "sloped peak")} & {*model.levels}
)


def test_bars_and_words_are_those_of_the_table():
    evidence = np.random.default_rng(5).normal(size=(3, 13)) * 2
    evidence[1, 4] = np.nan
    table = made(evidence, SPACE)
    (ax, *_, best), _, _ = panels(table)
    assert [label.get_text() for label in ax.get_yticklabels()] == ["P1", "P2", "P3", "*"]
    bars = {at: [one.get_width() for one in ax.patches if round(one.get_y() + 0.41, 6) == at] for at in (0, 1, 2, 3.45)}
    order = table.parts[0]
    assert bars[0] == pytest.approx(order.probability[0].tolist())
    assert bars[3.45] == pytest.approx(order.study.tolist())
    assert bars[1] == [1.0]
    assert [one.get_hatch() is not None for one in ax.patches].count(True) == 1
    assert [text.get_text() for text in ax.get_legend().get_texts()] == list(order.levels)
    words = [text.get_text() for text in best.texts]
    for name, (row, against) in table.best_compositions().items():
        assert words[3 * table.subjects.index(name)] == row.model
        assert words[3 * table.subjects.index(name) + 1] == f"{against:+.1f}".replace("-", "−")
    assert "a new subject, random effects over 2 subjects" in words


@pytest.mark.parametrize("colours", [ORDER_COLOURS, OTHER_COLOURS])
def test_levels_are_told_apart_without_colour(colours):
    grey = np.array([np.dot(to_rgb(colour), [0.299, 0.587, 0.114]) for colour, _ in colours])
    assert np.diff(np.sort(grey)).min() > 0.1
    assert min(abs(value - np.dot(to_rgb(letters), [0.299, 0.587, 0.114])) for value, (_, letters) in zip(grey, colours, strict=True)) > 0.4


def test_a_misfit_is_bold_and_says_so():
    table = made([[0.0, 2.0, *[-9.0] * 11]], SPACE)
    table = replace(table, rows=tuple(replace(row, checks=Checks(p_predictive=0.002)) for row in table.rows))
    bold = [text.get_text() for text in panels(table)[0][-1].texts if text.get_weight() == "bold"]
    assert bold == ["misfit 0.002"]


@pytest.mark.parametrize("shape", [(1, 13), (2, 2), (11, 13), (16, 8), (40, 13)])
def test_nothing_leaves_the_figure_or_meets(shape):
    evidence = np.random.default_rng(4).normal(size=shape) * 20
    if shape[0] > 2:
        evidence[1, 1] = np.nan
    table = made(evidence, SPACE if shape[1] == 13 else NAMES[: shape[1]], 1 / shape[1])
    figure = bt.plots.comparison_figure(table, synthetic=True)
    figure.draw_without_rendering()
    assert "synthetic data" in figure.get_suptitle()
    width, height = figure.bbox.size
    *parts, upper, lower = figure.axes
    texts = [
        *(text for ax in parts for text in ax.texts),
        *upper.texts,
        *upper.get_xticklabels(),
        *upper.get_yticklabels(),
        *lower.get_xticklabels(),
        lower.yaxis.label,
    ]
    legends = [*figure.legends, *(ax.get_legend() for ax in figure.axes if ax.get_legend())]
    boxes = [text.get_window_extent() for text in texts] + [legend.get_window_extent() for legend in legends]
    for box in boxes:
        assert box.x0 > -1
        assert box.y0 > -1
        assert box.x1 < width + 1
        assert box.y1 < height + 1
    cell = min(patch.get_window_extent().height for patch in upper.patches)
    assert max(text.get_window_extent().height for text in upper.texts) < cell
    assert lower._left_title.get_window_extent().y1 < upper.patches[-1].get_window_extent().y0
    heads = [label.get_window_extent() for label in upper.get_xticklabels()]
    assert all(one.x1 < two.x0 for one, two in pairwise(heads))
    names = [ax.get_legend().get_window_extent() for ax in parts if ax.get_legend()]
    assert all(one.x1 < two.x0 for one, two in pairwise(names))
    if parts:
        assert max(box.y1 for box in heads) < min(patch.get_window_extent().y0 for ax in parts for patch in ax.patches)
        rows = [text.get_window_extent() for text in parts[-1].texts]
        assert not any(one.overlaps(two) for one, two in pairwise(rows))
