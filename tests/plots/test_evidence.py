"""The figure of the evidence, by what is drawn in it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from legible import require_legible, texts_of

import bayes_toe as bt
from bayes_toe.answers.evidence_table import EvidenceTable
from bayes_toe.plots.evidence import (
    evidence_plane_axes,
    order_effect_axes,
    sorted_by_kind,
    stacked_shares,
)
from bayes_toe.plots.style import panel


def undescribed(row):
    return replace(
        row, verdict=replace(row.verdict, best_fit=replace(row.verdict.best_fit, p_overall=0.001))
    )


def unknown(row):
    return replace(row, verdict=replace(row.verdict, p_orders=None))


def test_evidence_figure_leads_with_the_order_effect_of_every_subject(analysis):
    left, right = bt.plots.evidence_figure(analysis.evidence).axes
    assert [t.get_text() for t in left.get_yticklabels()] == ["A", "B", "C"]
    assert [bars.get_label() for bars in left.containers] == ["none", "constant error", "pull"]
    for i, bars in enumerate(left.containers):
        assert [bar.get_width() for bar in bars] == pytest.approx(
            [one.p_orders[i] for one in analysis.verdicts]
        )
        assert [bar.get_x() for bar in bars] == pytest.approx(
            [sum(one.p_orders[:i]) for one in analysis.verdicts]
        )
    points = right.containers[0].lines[0].get_xdata()
    assert points == pytest.approx([row.log_bayes_factor for row in analysis.evidence])
    said = [text.get_text() for text in left.figure.legends[0].get_texts()]
    assert said.index("importance sampling, 2 s.e.") < said.index("Laplace (both models)")


def test_subjects_whom_no_model_describes_are_hatched_and_missing_estimates_said(analysis):
    first, second, third = analysis.evidence
    left = bt.plots.evidence_figure(
        EvidenceTable((first, undescribed(second), unknown(third)))
    ).axes[0]
    [hatched] = [
        bars for bars in left.containers if bars.get_label() == "no model describes the answers"
    ]
    assert [(bar.get_width(), round(bar.get_y() + bar.get_height() / 2, 9)) for bar in hatched] == [
        (1.0, 1.0)
    ]
    assert [(text.get_text(), text.get_position()[1]) for text in left.texts] == [
        ("no reliable estimate", 2)
    ]


def test_long_names_leave_room_for_all_words(analysis):
    table = EvidenceTable(
        tuple(
            replace(row, subject=f"participant of the study number {i}")
            for i, row in enumerate(analysis.evidence)
        )
    )
    require_legible(bt.plots.evidence_figure(table))
    require_legible(order_effect_axes(table).figure)


def test_numbers_under_the_plane_of_evidences_have_room_between_them(analysis):
    rows = [
        replace(row, log_evidence_h0=-0.604 * row.n_trials, log_evidence_h1=-0.498 * row.n_trials)
        for row in analysis.evidence
    ]
    ax = evidence_plane_axes(
        EvidenceTable(tuple(rows)), panel(None, high=3.4)
    )  # a range with many numbers of three decimals
    drawn = [text for text in texts_of(ax.figure) if text in ax.get_xticklabels()]
    boxes = sorted((text.get_window_extent().x0, text.get_window_extent().x1) for text in drawn)
    assert len(boxes) > 1
    assert all(
        after - end > 10.0 * ax.figure.dpi / 72.0 for (_, end), (after, _) in pairwise(boxes)
    )


def many(table, size):
    """A table of so many subjects: the rows of another one under other names: the last without an estimate, the one before undescribed."""
    rows = [replace(table.rows[i % len(table)], subject=f"S{i}") for i in range(size)]
    rows[-2], rows[-1] = (
        undescribed(rows[-2]),
        replace(unknown(rows[-1]), log_evidence_h1=None, log_evidence_h1_se=None),
    )
    return EvidenceTable(tuple(rows))


def test_a_figure_of_many_subjects_is_sorted_and_no_higher(analysis):
    named, crowded, more = (
        bt.plots.evidence_figure(many(analysis.evidence, size)) for size in (60, 61, 500)
    )
    assert len(named.axes[0].get_yticklabels()) == 60
    assert named.get_figheight() > crowded.get_figheight() == more.get_figheight()
    left, right = more.axes
    assert not left.get_yticklabels()
    values = right.lines[1].get_xdata()
    assert sum(values != values) == 1
    assert (values[:-1][1:] <= values[:-1][:-1]).all()
    said = [text.get_text() for text in more.legends[0].get_texts()]
    assert {
        "no model describes the answers: 1",
        "no reliable estimate: 1",
        "importance sampling, above 0 for 499 of 499",
    } < set(said)
    assert sum(int(text.rsplit(" ", 1)[1]) for text in said if "likeliest for" in text) == 499


def test_stacked_shares_of_many_subjects_lie_in_the_order_of_their_kinds():
    share = np.array(
        [[0.2, 0.1, 0.7], [0.6, 0.3, 0.1], [np.nan] * 3, [0.9, 0.1, 0.0], [0.1, 0.0, 0.9]]
    )
    order, kind = sorted_by_kind(share)
    assert order.tolist() == [3, 1, 4, 0, 2]
    assert kind.tolist() == [2, 0, -1, 0, 2]
    ax = panel(None)
    stacked_shares(
        ax,
        share,
        {"a": "red", "b": "green", "c": "blue"},
        np.array([False, True, False, False, False]),
    )
    areas = [one for one in ax.collections if str(one.get_label())[1] == ":"]
    assert [one.get_label() for one in areas] == [
        "a: likeliest for 2",
        "b: likeliest for 0",
        "c: likeliest for 2",
    ]
    corners = {(x, y) for x, y in areas[0].get_paths()[0].vertices.round(6).tolist() if x > 0}
    assert corners >= {(0.9, -0.5), (0.9, 0.5), (0.6, 0.5), (0.6, 1.5), (0.1, 1.5), (0.2, 3.5)}
    [marks] = [
        one for one in ax.collections if one.get_label() == "no model describes the answers: 1"
    ]
    assert marks.get_segments()[0][0, 1] == 1
