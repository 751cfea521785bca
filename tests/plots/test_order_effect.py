"""The figure of the answers, by what is drawn in it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from legible import require_legible, texts_of

import bayes_toe as bt
from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.answers.words import Word
from bayes_toe.plots.order_effect import QUESTIONS, answers_figure, evidence_plane_axes
from bayes_toe.plots.style import panel


def changed(row, **values):
    """A row of the table whose answer has other values."""
    return replace(row, answer=replace(row.answer, **values))


def renamed(table, size, pattern="S{}"):
    """So many rows under other names."""
    rows = [table.rows[i % len(table)] for i in range(size)]
    named = []
    for i, row in enumerate(rows):
        name = pattern.format(i)
        named.append(replace(changed(row, subject=name), subject=name))
    return EvidenceTable(tuple(named))


def words_of(ax):
    return [text.get_text() for text in ax.texts]


def medians(ax):
    """The marks of a forest: markers with a line from the interval's one end to the other."""
    return [line.get_xdata()[0] for line in ax.lines if line.get_marker() in ("s", "D")]


def test_figure_has_sizes_and_words_of_every_subject(analysis):
    factors, errors, contractions, last = bt.plots.order_effect(analysis.evidence).axes
    assert [label.get_text() for label in factors.get_yticklabels()] == ["A", "B", "C"]
    for ax, question in zip((factors, errors, contractions), QUESTIONS, strict=True):
        expected = [answer.marked_word(question.name) for answer in analysis.answers]
        assert words_of(ax) == expected
    for ax, size in ((errors, "pse_shift_percent"), (contractions, "contraction_p")):
        assert medians(ax) == [answer.sizes[size].q50 for answer in analysis.answers]
        ends = [tuple(line.get_segments()[0][:, 0]) for line in ax.collections]
        sizes = [answer.sizes[size] for answer in analysis.answers]
        assert ends == [(interval.q025, interval.q975) for interval in sizes]
    points = last.containers[0].lines[0].get_xdata()
    assert points == pytest.approx([row.log_bayes_factor for row in analysis.evidence])


def test_large_bayes_factors_stand_at_the_end_of_the_axis_as_triangles(analysis):
    first, second, third = analysis.evidence
    factors = {"order_effect": 300.0, "constant_error": np.log(3.0), "contraction": np.log(0.1)}
    table = EvidenceTable((changed(first, log_bayes_factors=factors), second, third))
    ax = answers_figure(table).axes[0]
    drawn = {
        line.get_label(): line.get_xdata()[0] for line in ax.lines if len(line.get_xdata()) == 3
    }
    assert np.isnan(drawn["order effect"])
    assert drawn["constant error"] == pytest.approx(3.0)
    assert np.isnan(drawn["contraction"]), "these pairs cannot show a contraction"
    triangles = [line.get_xdata()[0] for line in ax.lines if line.get_marker() == ">"]
    assert triangles[0] == pytest.approx(ax.get_xlim()[1])


def test_subject_that_is_not_interpreted_has_its_reason_and_no_size(analysis):
    first, second, third = analysis.evidence
    words = dict.fromkeys(second.answer.words, Word.NOT_INTERPRETABLE)
    rejected = changed(
        second, words=words, is_interpretable=False, flags=("responses look swapped",)
    )
    factors, errors, _ = answers_figure(EvidenceTable((first, rejected, third))).axes
    assert words_of(factors)[1] == "not interpreted: responses look swapped"
    assert len(words_of(errors)) == len(medians(errors)) == 2
    assert all(
        np.isnan(line.get_xdata()[1]) for line in factors.lines if len(line.get_xdata()) == 3
    )


def test_poor_fit_and_prior_stand_beside_the_word(analysis):
    first, second, third = analysis.evidence
    flags = ("depends on the prior: constant error",)
    doubtful = changed(first, predictive_p=0.001, deviance_p=0.5, flags=flags)
    _, errors, contractions = answers_figure(EvidenceTable((doubtful, second, third))).axes
    assert words_of(errors)[0].endswith(" ! ?")
    assert words_of(contractions)[0].endswith(" !")


@pytest.mark.parametrize("size", [1, 8, 40])
def test_figure_of_any_study_is_legible(analysis, size):
    table = renamed(analysis.evidence, size, "participant of the study number {}")
    require_legible(bt.plots.order_effect(table))
    require_legible(answers_figure(table, synthetic=True))


def test_figure_of_many_subjects_is_sorted_and_no_higher(analysis):
    figures = [bt.plots.order_effect(renamed(analysis.evidence, size)) for size in (60, 61, 500)]
    named, crowded, more = figures
    assert len(named.axes[0].get_yticklabels()) == 60
    assert named.get_figheight() > crowded.get_figheight() == more.get_figheight()
    factors, errors, _, last = more.axes
    assert not factors.get_yticklabels()
    assert not words_of(errors)
    words = [row.answer.words["constant_error"] for row in renamed(analysis.evidence, 500)]
    counts = f"{words.count(Word.YES)} yes, {words.count(Word.PROBABLY)} probably"
    assert errors.get_title(loc="left") == f"constant error\n{counts}"
    values = last.lines[1].get_xdata()
    assert (np.diff(values) <= 0.0).all()


def test_wide_intervals_do_not_hide_the_others(analysis):
    first, second, third = analysis.evidence
    size = replace(first.answer.sizes["pse_shift_percent"], q975=1e9)
    wide = changed(first, sizes={**first.answer.sizes, "pse_shift_percent": size})
    errors = answers_figure(EvidenceTable((wide, second, third))).axes[1]
    low, high = errors.get_xlim()
    assert high < 1e6
    assert all(low < value < high for value in medians(errors))


def test_table_without_answers_is_refused(analysis):
    table = EvidenceTable((replace(analysis.evidence.rows[0], answer=None),))
    with pytest.raises(bt.InputError, match=r"no answers of order effects; bt\.evidence computes"):
        bt.plots.order_effect(table)


def test_numbers_under_the_plane_of_evidences_have_room_between_them(analysis):
    rows = [
        replace(row, log_evidence_h0=-0.604 * row.n_trials, log_evidence_h1=-0.498 * row.n_trials)
        for row in analysis.evidence
    ]
    # A range with many numbers of three decimals.
    ax = evidence_plane_axes(EvidenceTable(tuple(rows)), panel(None, high=3.4))
    drawn = [text for text in texts_of(ax.figure) if text in ax.get_xticklabels()]
    boxes = sorted((text.get_window_extent().x0, text.get_window_extent().x1) for text in drawn)
    assert len(boxes) > 1
    room = 10.0 * ax.figure.dpi / 72.0
    assert all(after - end > room for (_, end), (after, _) in pairwise(boxes))
