"""The figure of the evidence, by what is drawn in it."""

import pytest

import bayes_toe as bt


def test_evidence_figure_has_a_row_a_subject(analysis):
    figure = bt.plots.evidence_figure(analysis.evidence)
    [ax] = figure.axes
    assert [t.get_text() for t in ax.get_yticklabels()] == ["A", "B", "C"]
    points = ax.containers[0].lines[0].get_xdata()
    assert points == pytest.approx([row.log_bayes_factor for row in analysis.evidence])


def test_evidence_legend_names_the_main_estimate_first(analysis):
    [legend] = bt.plots.evidence_figure(analysis.evidence).legends
    assert legend.get_texts()[0].get_text().startswith("importance sampling")
