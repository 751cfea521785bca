"""Curves over the answers, by what is drawn in them."""

import numpy as np
import pytest
from legible import require_legible
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.plots.curves import MOST_PANELS, main_weaker, order_panel
from bayes_toe.plots.style import STRONGER_FIRST, WEAKER_FIRST, new_figure


def test_curves_show_both_orders_where_the_data_are(analysis):
    figure = bt.plots.curves(analysis.draws, "A")
    [ax] = figure.axes
    lines = {line.get_color(): line for line in ax.lines if len(line.get_xdata()) == 120}
    subject = analysis.study["A"]
    for colour, forward in ((WEAKER_FIRST, True), (STRONGER_FIRST, False)):
        x, q = lines[colour].get_data()
        s1, s2 = (0.0, x[-1]) if forward else (x[-1], 0.0)
        theta = analysis.draws.natural("A")
        assert q[-1] == pytest.approx(
            float(bt.model.equal_probability(s1, s2, *theta).mean()), abs=0.01
        )
        at = np.flatnonzero((subject.s1 == s1) & (subject.s2 == s2))[0]
        qhat = (subject.n_yes[at] + 1) / (subject.n_trials[at] + 2)
        assert q[-1] == pytest.approx(qhat, abs=0.15)
    require_legible(figure)
    assert ax.get_ylabel() == "P('equal')"
    assert bt.plots.curves(analysis.draws, "A", title="").get_suptitle() == ""
    assert {c.get_label() for c in ax.containers} == {
        "weaker first",
        "stronger first",
        "equal stimuli",
    }


def test_designs_without_a_reference_get_panels_and_wild_ones_the_common_curve():
    grid = np.log([1.0, 1.2, 1.5])
    s1, s2 = (a.ravel() for a in np.meshgrid(grid, grid))
    three = bt.Subject("three", s1, s2, np.where(s1 == s2, 9, 4), np.full(9, 10))
    draws = bt.sample(
        bt.Study([three, hard_cases()["400 pairs with 3 trials"]]), draws=100, seed=1, workers=1
    )
    figures = [bt.plots.curves(draws, name) for name in draws.names]
    for figure in figures:
        require_legible(figure)
    panels, [common] = (figure.axes for figure in figures)
    assert [ax.get_title() for ax in panels] == ["weaker stimulus 82 %", "weaker stimulus 99 %"]
    assert "normalised distance" in common.get_xlabel()
    assert MOST_PANELS < 19


def test_curves_of_an_analysis_are_averaged_over_the_four_models(analysis):
    figure = bt.plots.curves(analysis, "A")
    require_legible(figure)
    assert figure.get_suptitle() == "A: average of the four models"
    lines = {
        line.get_color(): line for line in figure.axes[0].lines if len(line.get_xdata()) == 120
    }
    x, q = lines[WEAKER_FIRST].get_data()
    draws = analysis.curve("A").x
    assert len(draws) == 400
    log_p = analysis.curve("A").target.log_answers(draws).yes
    subject = analysis.study["A"]
    at = np.flatnonzero((subject.s1 == 0.0) & (subject.s2 == x[-1]))[0]
    assert q[-1] == pytest.approx(np.exp(log_p[:, at]).mean())
    with pytest.raises(bt.InputError, match="Z"):
        bt.plots.curves(analysis, "Z")


def test_equal_pairs_weaker_than_all_others_are_shown_too():
    counts = bt.Subject(
        "S", [-0.4, 0.0, 0.3, 0.3], [-0.4, 0.3, 0.0, 0.3], [40, 20, 30, 45], [50] * 4
    )
    ax = order_panel(
        new_figure(4.0, 3.0).subplots(), counts, lambda s1, s2: np.full((9, len(s1)), 0.5), 0.0
    )
    places = {float(x) for container in ax.containers for x in container.lines[0].get_xdata()}
    curves = [line.get_xdata() for line in ax.lines if len(line.get_xdata()) == 120]
    assert {-0.4, 0.3} <= {round(x, 1) for x in places}
    assert sorted((round(x[0], 9), round(x[-1], 9)) for x in curves) == [
        (-0.4, 0.3),
        (0.0, 0.3),
        (0.0, 0.3),
    ]


def test_marks_of_both_orders_stand_beside_each_other_in_sight():
    counts = bt.Subject("x", [0.0, 0.3, 0.3], [0.3, 0.0, 0.3], [5, 5, 5], [10, 10, 10])
    ax = order_panel(new_figure(6.4, 4.8).subplots(), counts, None, 0.0)
    x = {
        one.get_label(): one.lines[0].get_transform().transform([0.3, 0.5])[0]
        for one in ax.containers
    }
    step = ax.get_figure().dpi / 72 * 0.7 * 5.5
    assert [
        x[one] - x["equal stimuli"] for one in ("weaker first", "stronger first")
    ] == pytest.approx([-step, step])
    assert ax.get_xlim()[0] < 0.3 < ax.get_xlim()[1]


def test_the_reference_is_the_weaker_stimulus_that_most_pairs_share():
    assert (
        main_weaker(bt.Subject("x", [0.0, 0.0, 0.1], [0.1, 0.3, 0.3], [1, 1, 1], [2, 2, 2])) == 0.0
    )
    assert main_weaker(bt.Subject("x", [0.0, 0.1], [0.0, 0.1], [1, 1], [2, 2])) is None


def test_a_model_that_knows_no_intervals_has_the_same_curve_at_each(small_study):
    """Its figure has a panel for each interval and no gain."""
    one = small_study["A"]
    isi = np.where(np.arange(one.n_pairs) % 2, 0.5, 2.0)
    timed = bt.Subject("A", one.s1, one.s2, one.n_yes, one.n_trials, isi=isi)
    draws = bt.sample(bt.Study([timed]), model="both", draws=200, seed=1, workers=1)
    figure = bt.plots.curves(draws, "A")
    require_legible(figure)
    assert [ax.get_ylabel() for ax in figure.axes] == ["P('equal')", ""]
    found = bt.predict(draws, "A", 0.0, 0.2, [0.5, 2.0])
    assert found["mean"][0] == found["mean"][1]
