"""The paper's figures: what they show, that words stay apart, that files are reproduced."""

import warnings
from dataclasses import replace
from itertools import chain, product

import numpy as np
import pytest
from legible import curves_of, marks_of, require_legible, titles_of, words_of
from matplotlib.colors import to_hex
from numpy.random import default_rng
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.classical.asymmetry import AsymmetryTable
from bayes_toe.errors import ConvergenceWarning, InputError
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.paper_equations import gain
from bayes_toe.plots.asymmetry import asymmetry_height, order_axes
from bayes_toe.plots.curves import distance_panel
from bayes_toe.plots.figure_files import figure_bytes
from bayes_toe.plots.paper_figures import (
    CAPTIONS,
    asymmetry_figure,
    captions,
    map_figure,
    paper_figures,
    plane_axes,
    posterior_clouds,
    prior_axes,
    representative,
    response_axes,
    write_figures,
    write_names,
)
from bayes_toe.plots.style import EQUAL, STRONGER_FIRST, WEAKER_FIRST, new_figure

NAMES = (
    "figure_1c_asymmetry",
    "figure_3_examples",
    "figure_4_map",
    "figure_5_plane",
    "appendix_c_evidence",
)


# --- what is drawn -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def table(small_study):
    return bt.asymmetry(small_study)


def one_panel():
    return new_figure(3.4, 2.6).subplots()


def renamed(study, names):
    """The first subjects of a study under other names."""
    pairs = zip(study, names, strict=False)
    return bt.Study([replace(subject, name=name) for subject, name in pairs])


def points_of(ax):
    """Marks drawn by errorbar: (x, y, colour of the edge, colour of the face)."""
    lines = [container.lines[0] for container in ax.containers if hasattr(container, "lines")]
    return [
        (float(x), float(y), line.get_mec(), line.get_mfc())
        for line in lines
        for x, y in zip(*line.get_data(), strict=True)
    ]


def test_asymmetries_are_where_the_table_has_them(table):
    ax = bt.plots.asymmetry(table)
    drawn = sorted(points_of(ax), key=lambda point: point[1])
    expected = list(chain.from_iterable(row.comparisons for row in table))
    asymmetries = np.array([comparison.asymmetry for comparison in expected])
    errors = np.array([comparison.asymmetry_se for comparison in expected])
    assert [x for x, *_ in drawn] == pytest.approx(asymmetries)
    places = np.repeat(range(len(table)), [len(row.comparisons) for row in table])
    assert [round(y) for _, y, *_ in drawn] == places.tolist()
    bars = chain.from_iterable(container.lines[2] for container in ax.containers)
    ends = np.concatenate([bar.get_segments() for bar in bars])[:, :, 0]
    limits = np.column_stack([asymmetries - errors, asymmetries + errors])
    assert np.sort(ends, axis=0) == pytest.approx(np.sort(limits, axis=0))
    assert ax.get_xlim()[0] == -ax.get_xlim()[1]


def test_asymmetries_have_the_colour_of_the_order_that_is_better(table):
    drawn = sorted(points_of(bt.plots.asymmetry(table)), key=lambda point: point[1])
    comparisons = chain.from_iterable(row.comparisons for row in table)
    colours = {1.0: STRONGER_FIRST, -1.0: WEAKER_FIRST, 0.0: EQUAL}
    for comparison, (_, _, edge, face) in zip(comparisons, drawn, strict=True):
        assert edge == colours[np.sign(comparison.asymmetry)]
        assert (face == edge) == (comparison.p_adjusted < 0.05)


def test_one_comparison_is_red_for_weaker_first_and_blue_for_stronger_first(table):
    maximal = replace(table["A"].maximal, q_weak_first_se=0.02, q_strong_first_se=0.05)
    ax = order_axes(replace(maximal, subject="P-01", s_weak=-0.5))
    weaker, stronger = points_of(ax)
    assert weaker[1:3] == (pytest.approx(maximal.q_weak_first), WEAKER_FIRST)
    assert stronger[1:3] == (pytest.approx(maximal.q_strong_first), STRONGER_FIRST)
    bars = [container.lines[2][0] for container in ax.containers if hasattr(container, "lines")]
    heights = np.ptp([bar.get_segments()[0][:, 1] for bar in bars], axis=1)
    assert heights == pytest.approx([0.04, 0.1])
    assert ax.get_title().startswith("P-01\n$r$ = −0.5")  # a hyphen in a name stays one


@pytest.mark.parametrize("names", [["A"], [f"participant {i} with a name" for i in range(3)]])
def test_the_key_of_asymmetries_is_on_the_page_beside_any_names(small_study, names):
    require_legible(bt.plots.asymmetry(bt.asymmetry(renamed(small_study, names))).figure)


def test_stars_stand_where_the_orders_differ(analysis, table):
    ax = response_axes(Predictor.from_draws(analysis.draws, "A"), one_panel())
    stars = sorted(text.get_position()[0] for text in ax.texts if text.get_text() == "*")
    comparisons = table["A"].comparisons
    assert stars == pytest.approx([row.s_strong for row in comparisons if row.p_adjusted < 0.05])
    assert stars


def test_the_prior_is_drawn_at_its_mean_with_the_stimuli(analysis):
    ax = prior_axes(analysis.draws, "A", one_panel())
    [thick] = [line for line in ax.lines if line.get_linewidth() == 1.4]
    x, density = thick.get_data()
    mean = np.median(analysis.draws.values("A", "mu1"))
    assert x[np.argmax(density)] == pytest.approx(mean, abs=0.02)
    [marks] = marks_of(ax, "^")
    subject = analysis.study["A"]
    assert marks.get_xdata() == pytest.approx(np.union1d(subject.s1, subject.s2))


def test_both_orders_fall_on_one_curve(analysis):
    ax = one_panel()
    distance_panel(ax, Predictor.from_draws(analysis.draws, "A"))
    [curve] = curves_of(ax, 200)
    z, drawn = np.array([point[:2] for point in points_of(ax)]).T
    subject = analysis.study["A"]
    assert sorted(drawn) == pytest.approx(sorted((subject.n_yes + 1) / (subject.n_trials + 2)))
    # The counts are rounded expectations: they lie on the curve.
    assert drawn == pytest.approx(np.interp(z, *curve.get_data()), abs=0.08)


@pytest.mark.parametrize("kind", ["draws", "replicates"])
def test_bars_of_the_map_reach_over_the_central_60_percent(analysis, kind):
    clouds = posterior_clouds(analysis.draws)
    if kind == "replicates":  # some without a maximum
        values = default_rng(1).normal(0.3, 0.1, (2, 400))
        values[0, :40] = np.nan
        clouds = dict.fromkeys("ABC", tuple(values))
    ax = map_panel(map_figure(analysis.draws, clouds=clouds))
    ends = [line.get_xydata() for line in curves_of(ax, 2)]
    across = [line for line in ends if line[0, 1] == line[1, 1] and np.ptp(line)]
    for (mu1, sigma_p), ((low, height), (high, _)) in zip(clouds.values(), across, strict=True):
        finite = mu1[np.isfinite(mu1)]
        assert np.mean((finite >= low) & (finite <= high)) == pytest.approx(0.6, abs=0.01)
        assert height == pytest.approx(np.median(sigma_p), abs=0.01)


def map_panel(figure):
    """The panel of the map, beside the bar of its colours."""
    return figure.axes[0]


def test_the_map_names_everybody(analysis):
    ax = map_panel(map_figure(analysis.draws))
    assert ax.get_title(loc="left") == "bars: 60 %"
    assert set(words_of(ax.texts)) == set("ABC")


def test_a_subject_far_away_is_counted_and_the_others_are_seen(analysis):
    near = default_rng(1).normal(0.3, 0.02, (2, 500))
    far = near + np.array([[300.0], [0.0]])
    clouds = {"A": near, "B": far, "C": near + 0.1}
    ax = map_panel(map_figure(analysis.draws, clouds=clouds))
    assert ax.get_xlim()[1] < 10
    assert set(words_of(ax.texts)) == {"A", "C"}
    assert ax.get_title(loc="left") == "bars: 60 %; 1 subject beyond the panel"


def test_names_on_the_map_are_not_written_over_each_other():
    ax = new_figure(2.4, 2.2).subplots()
    ax.set(xlim=(-3.0, 3.0), ylim=(0.0, 0.6))
    places = {f"subject {i:02d}": np.array([0.0, 0.3]) for i in range(20)}
    places |= {"west": np.array([-2.0, 0.3]), "east": np.array([2.0, 0.3])}
    n_unnamed = write_names(ax, places)
    require_legible(ax.figure)
    labelled = set(words_of(ax.texts))
    assert len(labelled) + n_unnamed == len(places)
    assert {"west", "east"} < labelled < set(places)


def test_the_plane_shows_axis_and_tested_pairs(analysis):
    ax = plane_axes(analysis.draws, "A", one_panel())
    axis = next(line for line in ax.lines if line.get_label() == "symmetry axis")
    (x0, y0), *_, (x1, y1) = axis.get_xydata()
    slope = np.median(gain(analysis.draws.natural("A").gamma))
    assert (y1 - y0) / (x1 - x0) == pytest.approx(slope, abs=0.05)
    marks = {line.get_label(): line for line in ax.lines if line.get_marker() != "None"}
    signs = {"weaker first": -1, "stronger first": 1, "equal stimuli": 0}
    assert set(marks) == set(signs)
    pairs = np.column_stack([analysis.study["A"].s1, analysis.study["A"].s2])
    for label, sign in signs.items():
        expected = pairs[np.sign(pairs[:, 0] - pairs[:, 1]) == sign]
        assert marks[label].get_xydata().tolist() == expected.tolist()
    assert to_hex(marks["weaker first"].get_mec()) == WEAKER_FIRST.lower()


def test_many_subjects_are_sorted_by_their_largest_asymmetry_in_a_figure_of_one_height(table):
    rows = [replace(table.rows[i % len(table)], subject=f"S{i}") for i in range(200)]
    numerous = AsymmetryTable((*rows, replace(rows[0], subject="none", comparisons=())))
    heights = [asymmetry_height(AsymmetryTable(tuple(rows[:n]))) for n in (1, 60, 61)]
    assert asymmetry_height(numerous) == heights[2] < heights[1]
    ax = bt.plots.asymmetry(numerous)
    drawn = sorted(points_of(ax), key=lambda point: point[1])
    assert [x for x, *_ in drawn] == sorted((row.maximal.asymmetry for row in rows), reverse=True)
    assert ax.get_ylabel().endswith("1 without a pair in both orders")
    many_pairs = bt.asymmetry(bt.Study([hard_cases()["400 pairs with 3 trials"]]))
    assert asymmetry_height(many_pairs) > heights[0]


def test_subjects_are_chosen_in_the_roles_of_the_paper(table):
    """Likeliest 'equal' with the weaker first, with the stronger first, and alike."""
    rows = [replace(table[name], subject=f"{name}{i}") for i, name in enumerate("CBAC")]
    assert representative(AsymmetryTable(tuple(rows)))[:2] == ("A2", "B1")


# --- words ---------------------------------------------------------------------------------------


def analysed(study):
    """Few draws: a figure is legible whether or not its quantiles are precise."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return bt.run(study, draws=200, seed=1, workers=1)


@pytest.fixture(scope="module")
def bundled():
    """Some bundled subjects."""
    names = ["S01", "S02", "S05", "S09", "S12", "S16"]
    return analysed(bt.example_study("same/different").select(names))


def test_figures_of_the_bundled_study_are_legible(bundled):
    figures = bt.plots.paper_figures(bundled)
    assert tuple(figures) == NAMES
    for figure in figures.values():
        words = require_legible(figure)
        assert figure.get_size_inches()[0] <= 7.0
        assert any("synthetic" in word for word in words)


def test_any_subjects_can_be_chosen(bundled):
    names = ("S16", "S02", "S09", "S01")
    figures = bt.plots.paper_figures(bundled, names)
    examples = figures["figure_3_examples"]
    titles = [title for title in titles_of(examples.axes) if title.startswith("S")]
    assert titles == [f"{name} (synthetic)" for name in names]
    require_legible(examples)
    require_legible(figures["figure_5_plane"])
    for wrong in (["S99"], [], ["S01", "S01"]):
        with pytest.raises(InputError):
            bt.plots.paper_figures(bundled, wrong)


@pytest.mark.parametrize("case", ["single pair", "400 pairs with 3 trials", "all equal"])
def test_figures_of_small_and_odd_studies_are_legible(case):
    odd = analysed(bt.Study([hard_cases()[case]]))
    drawn = bt.plots.paper_figures(odd)
    left_out = set(NAMES) - set(drawn)
    for figure in drawn.values():
        require_legible(figure)
    assert left_out == ({"figure_1c_asymmetry"} if case == "single pair" else set())
    reason = "Left out: no pair of different stimuli was presented in both orders"
    assert (reason in captions(odd)) == (case == "single pair")


def test_names_of_any_kind_are_drawn(small_study):
    names = ["a$b_{c}", "n" * 80, "主体 ①"]
    table = bt.asymmetry(renamed(small_study, names))
    ax = one_panel()
    write_names(ax, {name: np.array([0.2 * i, 0.5]) for i, name in enumerate(names)})
    for figure in (asymmetry_figure(table), ax.figure):
        assert figure_bytes(figure, "pdf").startswith(b"%PDF")


def test_captions_name_subjects_and_what_did_not_converge(analysis):
    assert "A, B, C" in captions(analysis)
    tree = analysis.draws.tree.copy(deep=True)
    tree["sample_stats"]["converged"][0] = 0
    assert "NOT CONVERGED" in captions(replace(analysis, draws=bt.Draws(tree)))


# --- files ---------------------------------------------------------------------------------------


def test_files_are_all_there_and_the_same_each_time(analysis, tmp_path):
    folder = tmp_path / "figures"
    write_figures(analysis, folder)
    expected = {CAPTIONS, *map(".".join, product(NAMES, ("pdf", "png")))}
    assert {path.name for path in folder.iterdir()} == expected
    assert "of 3 subjects gave more " in (folder / CAPTIONS).read_text(encoding="utf-8")
    name, figure = next(iter(paper_figures(analysis).items()))
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for suffix in ("pdf", "png"):
        assert (folder / f"{name}.{suffix}").read_bytes() == figure_bytes(figure, suffix)
