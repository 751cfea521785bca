"""Curves over the answers, by what is drawn in them."""

import re
from itertools import product

import numpy as np
import pytest
from conftest import made_subject, refused
from legible import curves_of, marks_of, require_legible, titles_of, words_of
from matplotlib.text import Text
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.plots.curves import MOST_PANELS, POINTS, correct_panel, main_weaker
from bayes_toe.plots.style import STRONGER_FIRST, WEAKER_FIRST, new_figure


def drawn_curves(ax):
    """The curves of a panel by their colour, each with its x and y."""
    return {line.get_color(): line.get_data() for line in curves_of(ax, POINTS)}


def test_curves_show_both_orders_where_the_data_are(analysis):
    figure = bt.plots.curves(analysis.draws, "A")
    require_legible(figure)
    [ax] = figure.axes
    assert ax.get_ylabel() == "proportion 'equal'"
    labels = [container.get_label() for container in ax.containers]
    assert labels == ["weaker first", "stronger first", "equal stimuli", "model, 95 % band"]
    # The last points of both curves, where one stimulus is the reference 0 and the other is x.
    theta = analysis.draws.natural("A")
    curves = drawn_curves(ax)
    for colour, weights in ((WEAKER_FIRST, (0, 1)), (STRONGER_FIRST, (1, 0))):
        (*_, x), (*_, share) = curves[colour]
        expected = bt.model.equal_probability(*np.multiply(weights, x), *theta).mean()
        assert share == pytest.approx(expected, abs=0.01)


def test_designs_without_a_reference_have_panels_by_weaker_or_by_first_stimulus():
    s1, s2 = np.log(list(product([1.0, 1.2, 1.5], repeat=2))).T
    # All nine pairs of three levels, and 400 pairs, too many for a panel by each weaker stimulus.
    few_pairs = bt.Subject("few", s1, s2, np.where(s1 == s2, 9, 4), np.full(9, 10))
    many_pairs = hard_cases()["400 pairs with 3 trials"]
    study = bt.Study([few_pairs, many_pairs])
    draws = bt.sample(study, draws=100, seed=1)
    figures = [bt.plots.curves(draws, name) for name in draws.names]
    for figure in figures:
        require_legible(figure)
    weaker_panels, first_panels = (figure.axes for figure in figures)
    # The geometric mean of 1, 1.2 and 1.5 is 1.216: 1/1.216 = .82, and 1.2/1.216 = .99.
    titles = ["weaker stimulus 82 % of mean", "weaker stimulus 99 % of mean"]
    assert titles_of(weaker_panels) == titles
    assert re.fullmatch(r"first stimulus \d+ to \d+ % of mean", titles_of(first_panels)[0])
    assert [len(curves_of(ax, POINTS)) for ax in first_panels] == [1] * MOST_PANELS


def test_curves_of_an_analysis_are_averaged_over_the_four_models(analysis):
    figure = bt.plots.curves(analysis, "A")
    require_legible(figure)
    assert figure.get_suptitle() == "A: average of the four models"
    # The last point of the curve is the mean of all draws at the pair (0, x).
    (*_, x), (*_, share) = drawn_curves(figure.axes[0])[WEAKER_FIRST]
    p_yes = analysis.curve("A").yes(np.zeros(1), np.array([x]))
    assert share == pytest.approx(p_yes.mean())


def test_curves_of_a_subject_that_is_not_there_are_refused(analysis):
    # The subjects are A, B and C.
    with refused("Z"):
        bt.plots.curves(analysis, "Z")


def test_curves_over_the_middle_of_the_pair_are_proportions_correct():
    # Rows of s1, s2, answers 'second' and trials. The weaker stimulus is 0, first or second.
    rows = "0 0.2 30 40, 0 0.4 38 40, 0.2 0 16 40, 0.4 0 3 40"
    subject = made_subject(rows, task=WHICH_STRONGER)
    ax = new_figure(4.0, 3.0).subplots()
    # All nine draws have P('second') = .5 + s2 - .9 s1, which is linear so that it can be checked.
    correct_panel(ax, subject, lambda s1, s2: np.tile(0.5 + s2 - 0.9 * s1, (9, 1)))
    assert ax.get_ylabel() == "proportion correct"
    weaker_first, stronger_first = marks_of(ax, "_")  # no curve joins different differences
    # The stronger stimulus is twice the middle of the pair, because the weaker stimulus is 0.
    middle, share = weaker_first.get_data()
    assert share == pytest.approx(0.5 + 2.0 * middle)  # P('second'), with s2 = 2 middle
    middle, share = stronger_first.get_data()
    assert share == pytest.approx(0.5 + 0.9 * 2.0 * middle)  # 1 - P('second'), with s1 = 2 middle


def test_a_curve_joins_pairs_with_the_same_difference():
    subject = made_subject("0 0.2 30 40, 0.2 0 9 40, 0.2 0.4 25 40", task=WHICH_STRONGER)
    ax = new_figure(4.0, 3.0).subplots()
    correct_panel(ax, subject, lambda s1, s2: np.tile(0.5 + s2 - s1, (9, 1)))
    (middle, share), *_ = [line.get_data() for line in marks_of(ax, "None")]
    assert (middle, share) == (pytest.approx([0.1, 0.3]), pytest.approx([0.7, 0.7]))


def test_the_reference_is_the_weaker_stimulus_that_most_pairs_share():
    # Rows of s1, s2, 'equal' and trials: 0 is the weaker stimulus of two of three pairs.
    assert main_weaker(made_subject("0 0.1 1 2, 0 0.3 1 2, 0.1 0.3 1 2")) == 0.0


# --- 'Which was stronger' -------------------------------------------------------------------------


def test_psychometric_curves_cross_one_half_at_the_point_of_subjective_equality(stronger):
    figure = bt.plots.curves(stronger.draws, "pulled")
    require_legible(figure)
    panels = figure.axes
    draws = stronger.draws
    assert panels[-1].get_xlabel() == "second stimulus,\n% of the first"
    # A panel for each first stimulus. With the offset c, the contraction p and the mean sbar of the
    # first stimuli, second - first = c - p (first - sbar) where both seem equal.
    offset, pull = (draws.values("pulled", name).mean() for name in ("offset", "pull"))
    first_stimuli = np.unique(stronger.study["pulled"].s1)
    shifts = offset - pull * (first_stimuli - draws.posterior("pulled").sbar)
    for shift, ax in zip(shifts, panels, strict=True):
        [curve] = curves_of(ax, POINTS)
        assert np.interp(shift, *curve.get_data()) == pytest.approx(0.5, abs=0.04)
    assert titles_of(panels)[0].endswith(" % of mean")
    assert "equal" not in " ".join(words_of(figure.findobj(Text)))
