"""What all figures share: the label of synthetic data, and names as text."""

import bayes_toe as bt
from bayes_toe.plots.geometry import plane_figure
from bayes_toe.plots.paper_figures import filter_figure
from bayes_toe.plots.style import plain
from bayes_toe.plots.subject import examples_figure


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


def test_shortened_names_keep_what_tells_them_apart():
    names = [f"participant_of_the_study_{i:03d}" for i in range(40)]
    for limit in (10, 12, 14, 16, 20, 24):
        short = {plain(name, limit) for name in names}
        assert len(short) == len(names)
        assert {len(name) for name in short} == {limit}


def test_figures_of_a_subject_say_that_its_draws_did_not_converge(analysis):
    tree = analysis.draws.tree.copy(deep=True)
    tree["sample_stats"]["converged"][0] = 0
    doubtful = bt.Draws(tree)
    assert "NOT CONVERGED" in bt.plots.curves(doubtful, "A").get_suptitle()
    assert "NOT CONVERGED" not in bt.plots.curves(doubtful, "B").get_suptitle()
    for figure in (examples_figure(doubtful, ["A", "B"]), plane_figure(doubtful, ["A", "B"])):
        first, second = (ax.get_title() for ax in figure.axes[:2])
        assert ("NOT CONVERGED" in first, "NOT CONVERGED" in second) == (True, False)
    assert "NOT CONVERGED" in filter_figure(doubtful, "A").get_suptitle()
