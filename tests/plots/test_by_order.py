"""Responses and curves by order, posterior predictive checks and JND by order, by what is drawn."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import made_subject
from legible import curves_of, marks_of, require_legible
from matplotlib.colors import to_hex
from scipy.stats import binom

import bayes_toe as bt
from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.answers.words import Word
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.observer import OrderModel
from bayes_toe.plots.by_order import jnds_by_order, predictive_interval
from bayes_toe.plots.style import STRONGER_FIRST, WEAKER_FIRST

FIGURES = (bt.plots.curves_by_order, bt.plots.posterior_predictive, bt.plots.jnd_by_order)


def numerous(analysis, size):
    """The analysis with so many subjects under other names."""
    index = np.arange(size) % len(analysis.study)
    subjects, rows = [], []
    for i, j in enumerate(index):
        name = f"participant number {i}"
        row = analysis.evidence.rows[j]
        rows.append(replace(row, subject=name, answer=replace(row.answer, subject=name)))
        subjects.append(replace(analysis.study.subjects[j], name=name))
    study = bt.Study(subjects, synthetic=True)
    curves = tuple(analysis.curves[j] for j in index)
    return replace(analysis, study=study, evidence=EvidenceTable(tuple(rows)), curves=curves)


def at_point(subject, **values):
    """A predictor with one draw, without slopes and lapses."""
    target = OrderModel("both").posterior(subject)
    point = dict.fromkeys(target.coordinates, 0.0)
    point |= {"noise": 0.2, "lapse_rate": 1e-9, **values}
    return Predictor(target, target.points(point)[None])


@pytest.mark.parametrize("contraction", [-0.3, 0.0, 0.4])
def test_the_jnd_of_each_order_leads_from_50_to_75_percent(stronger, contraction):
    fitted = at_point(stronger.study["pulled"], contraction=contraction)
    first, second = jnds_by_order(fitted)
    standard = np.full(1, fitted.target.sbar)
    assert fitted.yes(standard, standard + first) == pytest.approx(0.75)
    assert fitted.yes(standard + second, standard) == pytest.approx(0.25)
    assert second / first == pytest.approx(1.0 / (1.0 - contraction))


def test_the_predictive_interval_of_one_draw_is_that_of_the_binomial_distribution(stronger):
    counts = replace(stronger.study["pulled"], n_trials=np.full(10, 400))
    fitted = at_point(counts, contraction=0.2)
    # The same draw many times, so that the ends are precise.
    fitted = replace(fitted, x=np.repeat(fitted.x, 2000, axis=0))
    share = fitted.yes(counts.s1, counts.s2)[0]
    ends = predictive_interval(fitted, seed=1)
    assert 400 * ends == pytest.approx(binom.ppf([[0.025], [0.975]], 400, share), abs=1.0)


def test_observed_shares_stand_in_the_colour_of_their_order(analysis):
    ax = bt.plots.posterior_predictive(analysis, ["B"]).axes[0]
    subject = analysis.study["B"]
    shares = subject.n_yes / subject.n_trials
    direction = np.sign(subject.s1 - subject.s2)
    lines = {line.get_label(): line for line in ax.lines}
    for label, colour, sign in (
        ("weaker first", WEAKER_FIRST, -1),
        ("stronger first", STRONGER_FIRST, 1),
    ):
        expected = np.sort(shares[direction == sign])
        assert np.sort(lines[label].get_ydata()) == pytest.approx(expected)
        assert to_hex(lines[label].get_color()) == colour.lower()
    low, high = predictive_interval(analysis.curve("B"), analysis.settings.seed)
    order = np.lexsort((subject.s1 + subject.s2, direction))
    bars = np.array([(bar.get_y(), bar.get_height()) for bar in ax.patches])
    assert bars == pytest.approx(np.column_stack([low, high - low])[order])


def test_curves_of_one_weaker_stimulus_are_shares_of_correct_responses(analysis, stronger):
    labels = [
        bt.plots.curves_by_order(source).axes[0].get_ylabel() for source in (analysis, stronger)
    ]
    assert labels == ["share 'equal'", "share correct"]
    rows = "0 0.2 30 40, 0 0.4 38 40, 0.2 0 16 40, 0.4 0 3 40"
    subject = made_subject(rows, task=stronger.study.task)
    fitted = at_point(subject, contraction=0.2)
    one_subject = replace(numerous(stronger, 1), study=bt.Study([subject]), curves=(fitted,))
    [ax] = bt.plots.curves_by_order(one_subject).axes
    weaker_first, stronger_first = curves_of(ax, 40)
    x, share = weaker_first.get_data()
    assert share == pytest.approx(fitted.yes(0.0 * x, x)[0])
    x, share = stronger_first.get_data()
    assert share == pytest.approx(1.0 - fitted.yes(x, 0.0 * x)[0])


def test_a_subject_without_an_estimate_of_contraction_is_counted(analysis):
    first, second, third = analysis.evidence
    words = {**second.answer.words, "contraction": Word.YES}
    rows = [replace(first, answer=replace(first.answer, is_interpretable=False))]
    for row in (second, third):
        rows.append(replace(row, answer=replace(row.answer, words=words)))
    doubtful = replace(analysis, evidence=EvidenceTable(tuple(rows)))
    titles = [ax.get_title(loc="left") for ax in bt.plots.curves_by_order(doubtful).axes]
    assert titles == ["A\nnot interpreted", "B", "C"]
    [ax] = bt.plots.jnd_by_order(doubtful).axes
    assert len([mark for mark in marks_of(ax, "D") if len(mark.get_xdata())]) == 2
    assert ax.texts[0].get_text().startswith("1 subject")


@pytest.mark.parametrize("draw", FIGURES)
@pytest.mark.parametrize("size", [1, 8, 40])
def test_figures_are_legible_and_as_wide_as_a_column_or_a_page(analysis, stronger, draw, size):
    for source in (analysis, stronger):
        figure = draw(numerous(source, size))
        require_legible(figure)
        width = 25.4 * figure.get_figwidth()
        assert width == pytest.approx(85.0) or width == pytest.approx(175.0)
        assert 25.4 * figure.get_figheight() < 240.0
        assert figure.get_suptitle() == "synthetic data"


def test_what_cannot_be_drawn_is_refused(analysis):
    with pytest.raises(bt.InputError, match="found 41, allowed: 1 to 40"):
        bt.plots.curves_by_order(numerous(analysis, 41))
    with pytest.raises(bt.InputError, match="Z"):
        bt.plots.posterior_predictive(analysis, ["Z"])
    element = analysis.study["A"]
    timed = replace(element, isi=np.where(np.arange(element.n_pairs) % 2, 0.5, 2.0))
    with pytest.raises(bt.InputError, match="curves by order"):
        bt.plots.curves_by_order(replace(numerous(analysis, 1), study=bt.Study([timed])))
