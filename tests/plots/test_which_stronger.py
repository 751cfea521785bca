"""Figures of 'which was stronger': psychometric curves and the words of that task."""

import numpy as np
import pytest
from conftest import counts
from legible import curves_of, require_legible, titles_of, words_of
from matplotlib.text import Text

import bayes_toe as bt
from bayes_toe.plots.curves import lines_along


def test_psychometric_curves_cross_one_half_at_the_point_of_subjective_equality(stronger):
    figure = bt.plots.curves(stronger.draws, "pulled")
    require_legible(figure)
    [ax] = figure.axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("second stimulus, % of the first", "P('second')")
    *firsts, half = words_of(figure.legends[0].get_texts())
    assert half == "one half: PSE"
    assert all(words.endswith(" % of mean") for words in firsts), "the legend is in per cent, too"
    draws = stronger.draws
    offset, pull = (draws.values("pulled", name).mean() for name in ("offset", "pull"))
    firsts = np.unique(stronger.study["pulled"].s1)
    shifts = offset - pull * (firsts - draws.posterior("pulled").sbar)
    for shift, curve in zip(shifts, curves_of(ax, 120), strict=True):
        assert np.interp(shift, *curve.get_data()) == pytest.approx(0.5, abs=0.04)


def test_many_first_stimuli_are_taken_together(stronger):
    s1 = np.random.default_rng(1).normal(size=40)
    numerous = bt.Subject("many", s1, s1 + 0.1, [1] * 40, [2] * 40, task=stronger.study.task)
    lines = lines_along(numerous, 0.0, 9)
    assert len(lines) == 6
    assert (np.sum([line.rows for line in lines], axis=0) == 1).all()
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
    for figure in (
        bt.plots.curves(stronger, "pulled"),
        bt.plots.order_effect(stronger.evidence),
        bt.plots.posterior_predictive(stronger),
    ):
        texts = [text for text in figure.findobj(Text) if text.get_visible()]
        words = " ".join(words_of(texts))
        assert "'equal'" not in words
        assert "q_0" not in words


def test_asymmetry_is_of_wrong_answers(stronger):
    table = bt.asymmetry(stronger.study)
    comparison = table["pulled"].comparisons[-1]
    responses = {(s1, s2): (k, n) for s1, s2, k, n in counts(stronger.study["pulled"])}
    n_second, n_trials = responses[1.0, 1.25]
    assert comparison.n_equal_weak_first == n_trials - n_second
    assert comparison.n_equal_strong_first == responses[1.25, 1.0][0]
    # Remembered as weaker, a strong first stimulus seems the weaker one.
    assert comparison.asymmetry > 0.2
    assert "n_wrong_weak_first" in table.frame()


def test_with_intervals_there_are_psychometric_curves_at_each(stronger):
    subject = stronger.study["pulled"]
    columns = subject.s1, subject.s2, subject.n_yes, subject.n_trials
    twice = [np.tile(column, 2) for column in columns]
    isi = np.repeat([0.5, 2.0], subject.n_pairs)
    study = bt.Study([bt.Subject("both", *twice, isi=isi, task=subject.task)])
    figure = bt.plots.curves(bt.sample(study, draws=300, seed=1, workers=1), "both")
    assert titles_of(figure.axes) == ["0.5 s", "2 s", ""]
    assert [ax.get_ylabel() for ax in figure.axes] == ["P('second')", "", "gain K"]
    require_legible(figure)
