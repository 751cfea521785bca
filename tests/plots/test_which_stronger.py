"""Figures of 'which is stronger': the same functions, psychometric curves and words of that task."""

import numpy as np
import pytest
from legible import require_legible
from matplotlib.text import Text

import bayes_toe as bt
from bayes_toe.plots.curves import lines_along
from bayes_toe.plots.paper_figures import captions


def test_psychometric_curves_cross_one_half_at_the_point_of_subjective_equality(stronger):
    figure = bt.plots.curves(stronger.draws, "pulled")
    [ax] = figure.axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("second stimulus, % of the first", "P('second')")
    counts, [offset, pull] = (
        stronger.study["pulled"],
        [stronger.draws.values("pulled", name).mean() for name in ("offset", "pull")],
    )
    sbar, curves = (
        stronger.draws.posterior("pulled").sbar,
        [line for line in ax.lines if len(line.get_xdata()) == 120],
    )
    firsts = np.unique(counts.s1)
    assert len(curves) == len(firsts) == 6
    for s1, line in zip(firsts, curves, strict=True):
        x, q = line.get_data()
        shift = offset - pull * (s1 - sbar)
        assert np.interp(shift, x, q) == pytest.approx(0.5, abs=0.04)
    assert {"one half: PSE", "$s_1$ = 0.25"} <= {
        text.get_text() for text in figure.legends[0].get_texts()
    }
    require_legible(figure)


def test_many_first_stimuli_are_taken_together(stronger):
    rng = np.random.default_rng(1)
    s1 = rng.normal(size=40)
    many = bt.Subject(
        "many", s1, s1 + 0.1, np.ones(40, int), np.full(40, 2), task=stronger.study.task
    )
    lines = lines_along(many, 0.0, 9)
    assert len(lines) == 6
    assert (np.sum([line.at for line in lines], axis=0) == 1).all()
    assert " to " in lines[0].mark.label


def test_a_corner_plot_has_the_four_parameters_under_their_symbols(stronger):
    axes = bt.plots.corner(stronger.draws, "pulled", prior=stronger.draws.prior).axes
    assert [ax.get_xlabel() for ax in axes[-4:]] == [
        r"$\mu_1$",
        r"$\sigma_p$",
        r"$\sigma_\ell$",
        r"lapse rate $\lambda$",
    ]


def test_no_figure_speaks_of_another_task(stronger):
    table = bt.asymmetry(stronger.study)
    drawn = {
        **bt.plots.paper_figures(stronger),
        "order effect": bt.plots.order_effect(stronger.evidence),
        "asymmetry": bt.plots.asymmetry(table).figure,
    }
    said = [
        text.get_text()
        for figure in drawn.values()
        for text in figure.findobj(Text)
        if text.get_visible()
    ]
    assert [text for text in said if "'equal'" in text or "q_0" in text] == []
    assert len(drawn) == 7


def test_captions_speak_of_it_too(stronger):
    said = captions(stronger)
    assert "'equal'" not in said
    assert "q0" not in said
    assert "P('second')" in said
    assert "P(wrong) of the comparison" in said
    assert "point of subjective equality" in said


def test_asymmetry_is_of_wrong_answers(stronger):
    counts, one = stronger.study["pulled"], bt.asymmetry(stronger.study)["pulled"].comparisons[-1]
    first, second = ((counts.s1 == a) & (counts.s2 == b) for a, b in ((1.0, 1.25), (1.25, 1.0)))
    wrong = counts.n_trials[first] - counts.n_yes[first], counts.n_yes[second]
    assert (one.n_equal_weak_first, one.n_equal_strong_first) == wrong
    assert one.asymmetry > 0.2  # remembered as weaker, a strong first stimulus seems the weaker one
    assert "n_wrong_weak_first" in bt.asymmetry(stronger.study).frame()


def test_with_intervals_there_are_psychometric_curves_at_each(stronger):
    counts = stronger.study["pulled"]
    both = [np.tile(getattr(counts, name), 2) for name in ("s1", "s2", "n_yes", "n_trials")]
    one = bt.Subject("both", *both, isi=np.repeat([0.5, 2.0], counts.n_pairs), task=counts.task)
    figure = bt.plots.curves(bt.sample(bt.Study([one]), draws=300, seed=1, workers=1), "both")
    assert [ax.get_title() for ax in figure.axes] == ["0.5 s", "2 s", ""]
    assert [ax.get_ylabel() for ax in figure.axes] == ["P('second')", "", "gain K"]
    require_legible(figure)
