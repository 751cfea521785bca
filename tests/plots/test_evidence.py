"""The figure of the evidence, by what is drawn in it."""

from dataclasses import replace

import pytest

import bayes_toe as bt


def test_evidence_figure_leads_with_the_order_effect_of_every_subject(analysis):
    left, right = bt.plots.evidence_figure(analysis.evidence).axes
    assert [t.get_text() for t in left.get_yticklabels()] == ["A", "B", "C"]
    for bars, key in zip(left.containers, ("p_none", "p_constant_error", "p_update"), strict=True):
        assert [bar.get_width() for bar in bars] == pytest.approx([getattr(row, key) for row in analysis.evidence])
    points = right.containers[0].lines[0].get_xdata()
    assert points == pytest.approx([row.log_bayes_factor for row in analysis.evidence])
    said = [text.get_text() for text in left.figure.legends[0].get_texts()]
    assert said.index("importance sampling, 2 s.e.") < said.index("Laplace (both models)")


def test_misfits_and_missing_estimates_are_marked(analysis):
    first, second, third = analysis.evidence
    bad = replace(second, fit=replace(second.fit, p_overall=0.001))
    table = bt.EvidenceTable((first, bad, replace(third, log_evidence_symmetric=None)))
    left = bt.plots.evidence_figure(table).axes[0]
    [crosses] = left.lines
    assert list(crosses.get_ydata()) == [1]
    assert [(text.get_text(), text.get_position()[1]) for text in left.texts] == [("no reliable estimate", 2)]
