"""Figures, by what is drawn in them."""

import numpy as np
import pytest
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.errors import InputError, OutputError
from bayes_toe.plots.style import STRONGER_FIRST, WEAKER_FIRST, plain, require_figure


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
    from bayes_toe.plots.style import _MAX_PANELS

    grid = np.log([1.0, 1.2, 1.5])
    s1, s2 = (a.ravel() for a in np.meshgrid(grid, grid))
    three = bt.Subject("three", s1, s2, np.where(s1 == s2, 9, 4), np.full(9, 10))
    draws = bt.sample(bt.Study([three, hard_cases()["400 pairs with 3 trials"]]), draws=300, seed=1, workers=1)
    panels = bt.plots.curves(draws, "three").axes
    assert [ax.get_title() for ax in panels] == ["weaker stimulus 0", "weaker stimulus 0.182"]
    [common] = bt.plots.curves(draws, "400 pairs with 3 trials").axes
    assert "normalised distance" in common.get_xlabel()
    assert _MAX_PANELS < 19


def test_evidence_figure_has_a_row_a_subject(analysis):
    figure = bt.plots.evidence_figure(analysis.evidence)
    [ax] = figure.axes
    assert [t.get_text() for t in ax.get_yticklabels()] == ["A", "B", "C"]
    points = ax.containers[0].lines[0].get_xdata()
    assert points == pytest.approx([row.log_bayes_factor for row in analysis.evidence])


def test_evidence_legend_names_the_main_estimate_first(analysis):
    [legend] = bt.plots.evidence_figure(analysis.evidence).legends
    assert legend.get_texts()[0].get_text().startswith("importance sampling")


def test_a_figure_is_refused_before_it_is_drawn(tmp_path):
    (tmp_path / "old.png").write_text("precious")
    with pytest.raises(InputError, match="suffix 'xyz'"):
        require_figure(tmp_path / "new.xyz")
    with pytest.raises(OutputError, match="exists"):
        require_figure(tmp_path / "old.png")
    require_figure(tmp_path / "old.png", overwrite=True)
    require_figure(tmp_path / "new.pdf")
    assert [path.name for path in tmp_path.iterdir()] == ["old.png"]


def test_synthetic_data_are_labelled_wherever_they_are_shown(analysis):
    marked = bt.Draws(analysis.draws.tree.copy())
    marked.tree.attrs["synthetic"] = 1
    for figure in (bt.plots.corner(marked, "A"), bt.plots.curves(marked, "A")):
        words = " ".join(text.get_text() for text in figure.texts) + (figure.get_suptitle() or "")
        assert "synthetic" in words
    figure = bt.plots.evidence_figure(analysis.evidence, synthetic=True)
    assert "synthetic" in figure.axes[0].get_title(loc="right")


def test_names_are_drawn_as_text_not_as_mathematics():
    assert plain("$x_1$") == r"\$x_1\$"
    assert len(plain("n" * 100)) == 32
