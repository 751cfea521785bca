"""What all figures share: the label of synthetic data, and names as text."""

import bayes_toe as bt
from bayes_toe.plots.style import plain


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
