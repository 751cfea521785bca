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
    median_by_row = {}
    for line in [*marks_of(ax, "s"), *marks_of(ax, "D")]:
        median_by_row |= zip(line.get_ydata(), line.get_xdata(), strict=True)
    return [median_by_row[row] for row in sorted(median_by_row)]


def intervals(ax):
    """The left and right ends of the lines of a forest in the order of its rows."""
    ends_by_row = {}
    for collection in ax.collections:
        for (low, row), (high, _) in collection.get_segments():
            ends_by_row[row] = (low, high)
    return [ends_by_row[row] for row in sorted(ends_by_row)]


def test_forests_have_sizes_and_words_of_every_subject(analysis):
    errors, contractions = bt.plots.order_effect(analysis.evidence).axes
    assert words_of(errors.get_yticklabels()) == ["A", "B", "C"]
    for ax, question in zip((errors, contractions), QUESTION_STYLES, strict=True):
        lines = [answer.lines[question.name] for answer in analysis.answers]
        assert words_of(ax.texts) == [line.word + line.marks for line in lines]
        # If an effect of a subject cannot be told, the subject has a word, but no size.
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

    # Now as if the pairs did. This is another result, because a result keeps its table.
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
    row_a, row_b, row_c = analysis.evidence
    words = dict.fromkeys(row_b.answer.words, Word.NOT_INTERPRETABLE)
    row_b = row_with_answer(
        row_b, words=words, is_interpretable=False, problems={"swapped blocks": None}
    )
    errors, _ = bt.plots.order_effect(EvidenceTable((row_a, row_b, row_c))).axes
    _, word_of_b, _ = words_of(errors.texts)
    assert word_of_b == "not interpreted"
    assert len(medians(errors)) == 2  # of A and C


@pytest.mark.parametrize("size", [1, 8, 40])
def test_figures_of_any_study_are_legible(analysis, size):
    # `size` is the number of subjects, who have long names.
    table = enlarged_table(analysis.evidence, size, "participant of the study number {}")
    require_legible(bt.plots.order_effect(table, synthetic=True))


def test_a_figure_of_many_subjects_is_sorted_and_no_higher(analysis):
    # Up to 60 subjects have their names beside rows. More subjects are sorted, in a figure whose
    # height does not depend on their number.
    figure_of_60, figure_of_61, figure_of_500 = (
        bt.plots.order_effect(enlarged_table(analysis.evidence, size)) for size in (60, 61, 500)
    )
    assert len(figure_of_60.axes[0].get_yticklabels()) == 60
    assert figure_of_60.get_figheight() > figure_of_61.get_figheight()
    assert figure_of_61.get_figheight() == figure_of_500.get_figheight()
    assert not figure_of_500.axes[0].get_yticklabels()


def test_wide_intervals_do_not_hide_the_others_and_are_counted(analysis):
    row, *other_rows = analysis.evidence
    # The interval of the first subject reaches to 10^9 per cent.
    size = row.answer.sizes["pse_shift_percent"]._replace(q975=1e9)
    row = row_with_answer(row, sizes={**row.answer.sizes, "pse_shift_percent": size})
    errors, _ = bt.plots.order_effect(EvidenceTable((row, *other_rows))).axes
    _, right_end = errors.get_xlim()
    assert right_end < 1e6
    assert "1 interval beyond the panel" in words_of(errors.texts)
