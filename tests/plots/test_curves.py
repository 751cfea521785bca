"""Curves over the answers, by what is drawn in them."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from conftest import counts, made_subject
from legible import curves_of, require_legible, titles_of
from matplotlib.text import Text
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.inference.prediction import Predictor
from bayes_toe.plots.curves import MOST_PANELS, distance_panel, main_weaker, order_panel
from bayes_toe.plots.report_figure import responses_figure, responses_panel
from bayes_toe.plots.style import STRONGER_FIRST, WEAKER_FIRST, new_figure


def drawn_curves(ax):
    """The curves of a panel by their colour."""
    return {line.get_color(): line.get_data() for line in curves_of(ax, 120)}


def test_curves_show_both_orders_where_the_data_are(analysis):
    figure = bt.plots.curves(analysis.draws, "A")
    require_legible(figure)
    [ax] = figure.axes
    assert ax.get_ylabel() == "P('equal')"
    labels = {container.get_label() for container in ax.containers}
    assert labels == {"weaker first", "stronger first", "equal stimuli"}
    assert bt.plots.curves(analysis.draws, "A", title="").get_suptitle() == ""
    theta = analysis.draws.natural("A")
    responses = {(s1, s2): (k + 1) / (n + 2) for s1, s2, k, n in counts(analysis.study["A"])}
    curves = drawn_curves(ax)
    for colour, weights in ((WEAKER_FIRST, (0, 1)), (STRONGER_FIRST, (1, 0))):
        (*_, x), (*_, share) = curves[colour]
        pair = tuple(np.multiply(weights, x))
        expected = bt.model.equal_probability(*pair, *theta).mean()
        assert share == pytest.approx(expected, abs=0.01)
        assert share == pytest.approx(responses[pair], abs=0.15)


def test_designs_without_a_reference_get_panels_and_wild_ones_the_common_curve():
    s1, s2 = np.log(list(product([1.0, 1.2, 1.5], repeat=2))).T
    three = bt.Subject("three", s1, s2, np.where(s1 == s2, 9, 4), np.full(9, 10))
    study = bt.Study([three, hard_cases()["400 pairs with 3 trials"]])
    draws = bt.sample(study, draws=100, seed=1, workers=1)
    figures = [bt.plots.curves(draws, name) for name in draws.names]
    for figure in figures:
        require_legible(figure)
    panels, [common] = (figure.axes for figure in figures)
    assert titles_of(panels) == ["weaker stimulus 82 %", "weaker stimulus 99 %"]
    assert "normalised distance" in common.get_xlabel()
    assert MOST_PANELS < 19


def test_curves_of_an_analysis_are_averaged_over_the_four_models(analysis):
    figure = bt.plots.curves(analysis, "A")
    require_legible(figure)
    assert figure.get_suptitle() == "A: average of the four models"
    (*_, x), (*_, share) = drawn_curves(figure.axes[0])[WEAKER_FIRST]
    curve, subject = analysis.curve("A"), analysis.study["A"]
    assert len(curve.x) == 400
    p_yes = np.exp(curve.target.log_answers(curve.x).yes)
    [pair] = np.flatnonzero((subject.s1 == 0.0) & (subject.s2 == x))
    assert share == pytest.approx(p_yes[:, pair].mean())
    with pytest.raises(bt.InputError, match="Z"):
        bt.plots.curves(analysis, "Z")


def test_equal_pairs_weaker_than_all_others_are_shown_too():
    subject = made_subject("-0.4 -0.4 40 50, 0 0.3 20 50, 0.3 0 30 50, 0.3 0.3 45 50")
    ax = new_figure(4.0, 3.0).subplots()
    order_panel(ax, subject, lambda s1, s2: np.full((9, len(s1)), 0.5), 0.0)
    places = np.concatenate([container.lines[0].get_xdata() for container in ax.containers])
    assert {-0.4, 0.3} <= set(places.round(1).tolist())
    ends = [line.get_xdata()[[0, -1]] for line in curves_of(ax, 120)]
    expected = [[-0.4, 0.3], [0.0, 0.3], [0.0, 0.3]]
    assert np.sort(ends, axis=0) == pytest.approx(np.array(expected))


def test_marks_of_both_orders_stand_beside_each_other_in_sight():
    subject = made_subject("0 0.3 5 10, 0.3 0 5 10, 0.3 0.3 5 10")
    ax = order_panel(new_figure(6.4, 4.8).subplots(), subject, None, 0.0)
    x = {}
    for container in ax.containers:
        position = container.lines[0].get_transform().transform([0.3, 0.5])
        x[container.get_label()] = position[0]
    step = ax.get_figure().dpi / 72 * 0.7 * 5.5
    assert x["weaker first"] - x["equal stimuli"] == pytest.approx(-step)
    assert x["stronger first"] - x["equal stimuli"] == pytest.approx(step)
    assert ax.get_xlim()[0] < 0.3 < ax.get_xlim()[1]


def test_curves_of_one_weaker_stimulus_are_shares_of_correct_responses():
    rows = "0 0.2 30 40, 0 0.4 38 40, 0.2 0 16 40, 0.4 0 3 40"
    subject = made_subject(rows, task=WHICH_STRONGER)
    ax = new_figure(4.0, 3.0).subplots()
    responses_panel(ax, subject, lambda s1, s2: np.tile(0.5 + s2 - 0.9 * s1, (9, 1)))
    assert ax.get_ylabel() == "share correct"
    weaker_first, stronger_first = curves_of(ax, 40)
    x, share = weaker_first.get_data()
    assert share == pytest.approx(0.5 + x)
    x, share = stronger_first.get_data()
    assert share == pytest.approx(0.5 + 0.9 * x)


def test_both_orders_fall_on_one_curve(analysis):
    ax = new_figure(4.0, 3.0).subplots()
    distance_panel(ax, Predictor.from_draws(analysis.draws, "A"))
    [curve] = curves_of(ax, 200)
    z, share = np.concatenate([bars.lines[0].get_xydata() for bars in ax.containers]).T
    # The counts are rounded expectations: they lie on the curve.
    assert share == pytest.approx(np.interp(z, *curve.get_data()), abs=0.08)
    assert len(share) == analysis.study["A"].n_pairs


def test_the_reference_is_the_weaker_stimulus_that_most_pairs_share():
    shared = made_subject("0 0.1 1 2, 0 0.3 1 2, 0.1 0.3 1 2")
    assert main_weaker(shared) == 0.0
    assert main_weaker(made_subject("0 0 1 2, 0.1 0.1 1 2")) is None


def test_a_model_that_knows_no_intervals_has_the_same_curve_at_each(small_study):
    """Its figure has a panel for each interval and no gain."""
    subject = small_study["A"]
    timed = replace(subject, isi=np.where(np.arange(subject.n_pairs) % 2, 0.5, 2.0))
    draws = bt.sample(bt.Study([timed]), model="both", draws=200, seed=1, workers=1)
    figure = bt.plots.curves(draws, "A")
    require_legible(figure)
    assert [ax.get_ylabel() for ax in figure.axes] == ["P('equal')", ""]
    first, second = bt.predict(draws, "A", 0.0, 0.2, [0.5, 2.0])["mean"]
    assert first == second


def test_labels_of_the_report_have_only_characters_that_can_be_drawn(analysis):
    figure = responses_figure(analysis, 4.0)
    labels = [text.get_text() for text in figure.findobj(Text)]
    assert any("% of the mean" in label for label in labels)
    assert all(label.replace("\n", " ").isprintable() for label in labels)
