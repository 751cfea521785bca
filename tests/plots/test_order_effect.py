"""Figures of the answer, by what is drawn in them."""

from dataclasses import replace

import pytest
from conftest import enlarged_table
from legible import marks_of, require_legible, words_of
from populations import made_result

import bayes_toe as bt
from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.answers.order_effect import SIZE_OF
from bayes_toe.answers.words import Word
from bayes_toe.plots.order_effect import QUESTION_STYLES


def row_with_answer(row, **values):
    """A row of the evidence table whose answer has other values in these fields."""
    return replace(row, answer=replace(row.answer, **values))


def medians(ax):
    """The x of the squares and diamonds of a forest in the order of its rows: the medians."""
    by_row = {}
    for line in [*marks_of(ax, "s"), *marks_of(ax, "D")]:
        by_row |= zip(line.get_ydata(), line.get_xdata(), strict=True)
    return [by_row[row] for row in sorted(by_row)]


def intervals(ax):
    """The left and right ends of the lines of a forest in the order of its rows."""
    by_row = {}
    for collection in ax.collections:
        for (low, row), (high, _) in collection.get_segments():
            by_row[row] = (low, high)
    return [by_row[row] for row in sorted(by_row)]


def test_forests_have_sizes_and_words_of_every_subject(analysis):
    errors, contractions = bt.plots.order_effect(analysis.evidence).axes
    assert words_of(errors.get_yticklabels()) == ["A", "B", "C"]
    for ax, question in zip((errors, contractions), QUESTION_STYLES, strict=True):
        lines = [answer.lines[question.name] for answer in analysis.answers]
        assert words_of(ax.texts) == [line.word + line.marks for line in lines]
        # Subjects of whom an effect cannot be told have a word, but no size.
        sizes = []
        for answer in analysis.answers:
            if answer.words[question.name] is not Word.CANNOT_BE_TOLD:
                sizes.append(answer.sizes[SIZE_OF[question.name]])
        assert medians(ax) == [size.q50 for size in sizes]
        assert intervals(ax) == [(size.q025, size.q975) for size in sizes]


def test_the_group_stands_in_the_last_row(analysis, small_study, monkeypatch):
    # The pairs of this study identify no contraction of the group, which then has no mark "d".
    _, contractions = bt.plots.order_effect(analysis.evidence, made_result(small_study)).axes
    assert marks_of(contractions, "d") == []

    # As if they did: another result, because a result keeps its table.
    group = made_result(small_study)
    monkeypatch.setattr(type(group), "identified", {"constant_error", "contraction"})
    errors, contractions = bt.plots.order_effect(analysis.evidence, group).axes
    *_, last_name = words_of(errors.get_yticklabels())
    assert "group of" in last_name
    for ax, quantity in ((errors, "pse_shift_percent"), (contractions, "contraction")):
        low, median, high = group.table.row("mean", quantity).interval
        [mark] = marks_of(ax, "d")
        assert mark.get_xdata() == pytest.approx([median])
        *_, last_interval = intervals(ax)
        assert last_interval == pytest.approx((low, high))


def test_a_subject_that_is_not_interpreted_has_no_size(analysis):
    first, second, third = analysis.evidence
    words = dict.fromkeys(second.answer.words, Word.NOT_INTERPRETABLE)
    rejected = row_with_answer(
        second, words=words, is_interpretable=False, problems={"swapped blocks": None}
    )
    table = EvidenceTable((first, rejected, third))
    errors, _ = bt.plots.order_effect(table).axes
    _, second_word, _ = words_of(errors.texts)
    assert second_word == "not interpreted"
    assert len(medians(errors)) == 2  # of the first and the third subject


@pytest.mark.parametrize("size", [1, 8, 40])
def test_figures_of_any_study_are_legible(analysis, size):
    # `size` is the number of subjects, who have long names.
    table = enlarged_table(analysis.evidence, size, "participant of the study number {}")
    require_legible(bt.plots.order_effect(table, synthetic=True))


def test_a_figure_of_many_subjects_is_sorted_and_no_higher(analysis):
    figures = [
        bt.plots.order_effect(enlarged_table(analysis.evidence, size)) for size in (60, 61, 500)
    ]
    # Up to 60 subjects have their names beside rows; more are sorted in a figure of one height.
    of_60, of_61, of_500 = figures
    assert len(of_60.axes[0].get_yticklabels()) == 60
    assert of_60.get_figheight() > of_61.get_figheight() == of_500.get_figheight()
    assert not of_500.axes[0].get_yticklabels()


def test_wide_intervals_do_not_hide_the_others_and_are_counted(analysis):
    first, second, third = analysis.evidence
    # The interval of the first subject reaches to 10^9 per cent.
    size = first.answer.sizes["pse_shift_percent"]._replace(q975=1e9)
    wide = row_with_answer(first, sizes={**first.answer.sizes, "pse_shift_percent": size})
    errors, _ = bt.plots.order_effect(EvidenceTable((wide, second, third))).axes
    _, right_end = errors.get_xlim()
    assert right_end < 1e6
    assert "1 interval beyond the panel" in words_of(errors.texts)
