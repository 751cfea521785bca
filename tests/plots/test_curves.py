"""Curves over the answers, by what is drawn in them."""

import numpy as np
import pytest
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.plots.curves import _MAX_PANELS
from bayes_toe.plots.style import STRONGER_FIRST, WEAKER_FIRST


def test_curves_show_both_orders_where_the_data_are(analysis):
    figure = bt.plots.curves(analysis.draws, "A")
    [ax] = figure.axes
    lines = {line.get_color(): line for line in ax.lines if len(line.get_xdata()) == 120}
    subject = analysis.study["A"]
    for colour, forward in ((WEAKER_FIRST, True), (STRONGER_FIRST, False)):
        x, q = lines[colour].get_data()
        s1, s2 = (0.0, x[-1]) if forward else (x[-1], 0.0)
        theta = analysis.draws.natural("A")
        assert q[-1] == pytest.approx(float(bt.model.equal_probability(s1, s2, *theta).mean()), abs=0.01)
        at = np.flatnonzero((subject.s1 == s1) & (subject.s2 == s2))[0]
        qhat = (subject.n_equal[at] + 1) / (subject.n_trials[at] + 2)
        assert q[-1] == pytest.approx(qhat, abs=0.15)
    assert {c.get_label() for c in ax.containers} == {"weaker first", "stronger first", "equal stimuli"}


def test_designs_without_a_reference_get_panels_and_wild_ones_the_common_curve():
    grid = np.log([1.0, 1.2, 1.5])
    s1, s2 = (a.ravel() for a in np.meshgrid(grid, grid))
    three = bt.Subject("three", s1, s2, np.where(s1 == s2, 9, 4), np.full(9, 10))
    draws = bt.sample(bt.Study([three, hard_cases()["400 pairs with 3 trials"]]), draws=300, seed=1, workers=1)
    panels = bt.plots.curves(draws, "three").axes
    assert [ax.get_title() for ax in panels] == ["weaker stimulus 0", "weaker stimulus 0.182"]
    [common] = bt.plots.curves(draws, "400 pairs with 3 trials").axes
    assert "normalised distance" in common.get_xlabel()
    assert _MAX_PANELS < 19
