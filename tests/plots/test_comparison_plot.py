"""The figures of a comparison say what its tables say; what is withheld is shown as withheld."""

from dataclasses import replace

import numpy as np
import pytest
from legible import require_legible
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

import bayes_toe as bt
from bayes_toe.comparison.model_comparison import ModelComparison
from bayes_toe.comparison.model_row import Checks, ModelRow
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.model.ladder import NAMES, models_of
from bayes_toe.plots.comparison import CLASSES, comparison_figure


def made(evidence, models=NAMES, probability=None):
    """A comparison with these log evidences (NaN: withheld), and nothing else in it."""
    evidence = np.asarray(evidence, float)
    subjects = tuple(f"P{i + 1}" for i in range(len(evidence)))
    rows = [
        ModelRow(
            subject,
            model,
            2,
            None if np.isnan(value) else float(value),
            0.0,
            None,
            Checks(),
            (),
            model_probability=probability,
        )
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
    return found, {
        (round(text.get_position()[1], 6), text.get_position()[0]): text.get_text()
        for text in ax.texts
    }


EVIDENCE = np.array(
    [
        [-100.0, -103.04, -100.4, -120.0],
        [-50.0, np.nan, -41.0, -42.0],
        [-60.0, -62.0, -61.0, -260.0],
    ]
)


def test_every_cell_has_its_number_and_its_class_and_what_is_withheld_is_hatched_and_its_subject_grey():
    ax = panels(made(EVIDENCE, NAMES[:4]))[1]
    patches, numbers = cells(ax)
    last = ax.get_yticks()[-1]
    below = [
        ["best", "3.0", "0.4", "20.0"],
        ["9.0", None, "best", "1.0"],
        ["best", "2.0", "1.0", "200"],
        ["best", "5.0", "1.4", "220"],
    ]
    shades = [[0, 2, 1, 4], [3, None, 0, 1], [0, 2, 1, 4]]
    assert [
        [numbers.get((i, j)) for j in range(4)] for i in (0, 1, 2, last)
    ] == below  # the sum is of P1 and P3 only
    drawn = [[to_hex(patches[i, j].get_facecolor()) for j in range(4)] for i in range(3)]
    expected = [
        [drawn[i][j] if one is None else CLASSES[one][2].lower() for j, one in enumerate(row)]
        for i, row in enumerate(shades)
    ]
    assert drawn == expected
    assert [place for place, one in patches.items() if one.get_hatch()] == [(1, 1)]
    assert "withheld: subject not counted" in [
        text.get_text() for text in ax.get_legend().get_texts()
    ]
    names = ax.get_yticklabels()
    assert [label.get_text() for label in names] == ["P1", "P2", "P3", "sum of 2"]
    assert names[0].get_color() == names[2].get_color() == "black" != names[1].get_color()
    assert min(ax.get_ylim()) <= -0.5 < last + 0.5 <= max(ax.get_ylim())
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
    model.name
    for model in models_of(SAME_DIFFERENT).compared
    if not {("curve", "differencing"), ("peak", "sloped peak")} & {*model.levels}
)


def test_bars_and_words_are_those_of_the_table():
    evidence = np.random.default_rng(5).normal(size=(3, 13)) * 2
    evidence[1, 4] = np.nan
    table = made(evidence, SPACE)
    (ax, *_, best), _, _ = panels(table)
    assert [label.get_text() for label in ax.get_yticklabels()] == ["P1", "P2", "P3", "*"]
    bars = {
        at: [one.get_width() for one in ax.patches if round(one.get_y() + 0.41, 6) == at]
        for at in (0, 1, 2, 3.45)
    }
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


def test_a_misfit_is_bold_and_says_so():
    table = made([[0.0, 2.0, *[-9.0] * 11]], SPACE)
    table = replace(
        table, rows=tuple(replace(row, checks=Checks(p_predictive=0.002)) for row in table.rows)
    )
    bold = [text.get_text() for text in panels(table)[0][-1].texts if text.get_weight() == "bold"]
    assert bold == ["misfit 0.002"]


@pytest.mark.parametrize("shape", [(1, 13), (2, 2), (16, 8), (40, 13)])
def test_words_can_be_read_and_numbers_stay_in_their_cells(shape):
    evidence = np.random.default_rng(4).normal(size=shape) * 20
    evidence[1:2, 1] = np.nan
    figure = comparison_figure(
        made(evidence, SPACE if shape[1] == 13 else NAMES[: shape[1]], 1 / shape[1]), synthetic=True
    )
    require_legible(figure, 6.5)
    assert "synthetic data" in figure.get_suptitle()
    *parts, upper, lower = figure.axes
    cell = min(patch.get_window_extent().height for patch in upper.patches)
    assert max(text.get_window_extent().height for text in upper.texts) < cell
    assert lower._left_title.get_window_extent().y1 < upper.patches[-1].get_window_extent().y0
    if parts:
        heads = max(label.get_window_extent().y1 for label in upper.get_xticklabels())
        assert heads < min(patch.get_window_extent().y0 for ax in parts for patch in ax.patches)
