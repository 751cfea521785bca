"""The paper's figures: what is drawn in them, that words stay apart, that files are the same each time."""

import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from legible import require_legible
from matplotlib.colors import to_hex
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.classical.asymmetry import AsymmetryTable
from bayes_toe.errors import ConvergenceWarning, InputError
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.paper_equations import gain
from bayes_toe.plots.asymmetry import asymmetry_height, order_axes
from bayes_toe.plots.curves import distance_panel
from bayes_toe.plots.figure_files import picture
from bayes_toe.plots.paper_figures import (
    CAPTIONS,
    asymmetry_figure,
    captions,
    map_figure,
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
    expected = [one for row in table for one in row.comparisons]
    assert [x for x, *_ in drawn] == pytest.approx([one.asymmetry for one in expected])
    assert [round(y) for _, y, *_ in drawn] == [
        i for i, row in enumerate(table) for _ in row.comparisons
    ]
    segments = [bars.get_segments() for container in ax.containers for bars in container.lines[2]]
    ends = sorted(np.concatenate(segments)[:, :, 0].tolist())
    assert np.array(ends) == pytest.approx(
        np.array(
            sorted(
                [one.asymmetry - one.asymmetry_se, one.asymmetry + one.asymmetry_se]
                for one in expected
            )
        )
    )
    for one, (_, _, edge, face) in zip(expected, drawn, strict=True):
        assert edge == {1.0: STRONGER_FIRST, -1.0: WEAKER_FIRST, 0.0: EQUAL}[np.sign(one.asymmetry)]
        assert (face == edge) == (one.p_adjusted < 0.05)
    assert ax.get_xlim()[0] == -ax.get_xlim()[1]


def test_one_comparison_is_red_for_weaker_first_and_blue_for_stronger_first(table):
    one = table["A"].maximal
    ax = order_axes(replace(one, subject="P-01", s_weak=-0.5))
    assert [(y, edge) for _, y, edge, _ in points_of(ax)] == [
        (pytest.approx(one.q_weak_first), WEAKER_FIRST),
        (pytest.approx(one.q_strong_first), STRONGER_FIRST),
    ]
    assert ax.get_title().startswith("P-01\n$r$ = −0.5")  # a hyphen in a name stays one


@pytest.mark.parametrize(
    "names",
    [["A"], ["a participant with a name", "another participant's name", "yet another participant"]],
    ids=len,
)
def test_the_key_of_asymmetries_is_on_the_page_beside_any_names(small_study, names):
    study = bt.Study(
        [replace(one, name=name) for one, name in zip(small_study, names, strict=False)]
    )
    require_legible(bt.plots.asymmetry(bt.asymmetry(study)).figure)


def test_stars_stand_where_the_orders_differ(analysis, table):
    ax = response_axes(Predictor.of(analysis.draws, "A"), one_panel())
    stars = sorted(text.get_position()[0] for text in ax.texts if text.get_text() == "*")
    assert stars == pytest.approx(
        [
            comparison.s_strong
            for comparison in table["A"].comparisons
            if comparison.p_adjusted < 0.05
        ]
    )
    assert stars


def test_the_prior_is_drawn_at_its_mean_with_the_stimuli(analysis):
    mean = np.median(analysis.draws.values("A", "mu1"))
    ax = prior_axes(analysis.draws, "A", one_panel())
    [thick] = [line for line in ax.lines if line.get_linewidth() == 1.4]
    x, density = thick.get_data()
    assert x[np.argmax(density)] == pytest.approx(mean, abs=0.02)
    [marks] = [line for line in ax.lines if line.get_marker() == "^"]
    counts = analysis.study["A"]
    assert marks.get_xdata() == pytest.approx(np.unique(np.concatenate([counts.s1, counts.s2])))


def test_both_orders_fall_on_one_curve(analysis):
    ax = one_panel()
    distance_panel(ax, Predictor.of(analysis.draws, "A"))
    curve = next(line for line in ax.lines if len(line.get_xdata()) == 200)
    drawn = points_of(ax)
    counts = analysis.study["A"]
    shares = (counts.n_yes + 1) / (counts.n_trials + 2)
    assert sorted(y for _, y, *_ in drawn) == pytest.approx(sorted(shares))
    for z, share, *_ in drawn:  # the counts are rounded expectations: they lie on the curve
        assert share == pytest.approx(np.interp(z, *curve.get_data()), abs=0.08)


def test_bars_of_the_map_reach_over_the_central_60_percent_of_draws_or_of_replicates(analysis):
    replicates = {
        name: tuple(np.random.default_rng(1).normal(0.3, 0.1, (2, 400))) for name in "ABC"
    }
    for values in replicates.values():
        values[0][:40] = np.nan
    for clouds in (posterior_clouds(analysis.draws), replicates):
        ax = map_panel(map_figure(analysis.draws, clouds=clouds))
        ends = [line.get_xydata() for line in ax.lines if len(line.get_xdata()) == 2]
        across = [line for line in ends if line[0, 1] == line[1, 1] and np.ptp(line)]
        for (mu1, sigma_p), line in zip(clouds.values(), across, strict=True):
            known = np.sort(mu1[np.isfinite(mu1)])
            held = np.mean((known >= line[0, 0]) & (known <= line[1, 0]))
            assert held == pytest.approx(0.6, abs=0.01)
            assert line[0, 1] == pytest.approx(np.median(sigma_p), abs=0.01)


def map_panel(figure):
    """The panel of the map, beside the bar of its colours."""
    return figure.axes[0]


def clouds_at(analysis, *places):
    """Replicates of the three subjects that differ by hardly anything."""
    rng = np.random.default_rng(1)
    return {
        name: tuple(rng.normal([[mu1], [0.3]], 0.02, (2, 500)))
        for name, mu1 in zip("ABC", places, strict=True)
    }


def test_the_map_names_everybody(analysis):
    ax = map_panel(map_figure(analysis.draws))
    assert ax.get_title(loc="left") == "bars: 60 %"
    assert {text.get_text() for text in ax.texts} == set("ABC")


def test_a_subject_far_away_is_counted_and_the_others_are_seen(analysis):
    clouds = clouds_at(analysis, 0.1, 300.0, 0.5)
    ax = map_panel(map_figure(analysis.draws, clouds=clouds))
    assert ax.get_xlim()[1] < 10
    assert {text.get_text() for text in ax.texts} == {"A", "C"}
    assert ax.get_title(loc="left") == "bars: 60 %; 1 subject beyond the panel"


def test_names_on_the_map_are_not_written_over_each_other():
    ax = new_figure(2.4, 2.2).subplots()
    ax.set(xlim=(-3.0, 3.0), ylim=(0.0, 0.6))
    places = {"west": -2.0, "east": 2.0} | {f"subject {i:02d}": 0.0 for i in range(20)}
    n_unnamed = write_names(ax, {name: np.array([x, 0.3]) for name, x in places.items()})
    require_legible(ax.figure)
    named = {text.get_text() for text in ax.texts}
    assert len(named) + n_unnamed == len(places)
    assert {"west", "east"} < named < set(places)


def test_the_plane_shows_axis_and_tested_pairs(analysis):
    counts, theta = analysis.study["A"], analysis.draws.natural("A")
    ax = plane_axes(analysis.draws, "A", one_panel())
    axis = next(line for line in ax.lines if line.get_label() == "symmetry axis")
    x, y = axis.get_data()
    assert (y[-1] - y[0]) / (x[-1] - x[0]) == pytest.approx(
        float(np.median(gain(theta.gamma))), abs=0.05
    )
    marks = {line.get_label(): line for line in ax.lines if line.get_marker() != "None"}
    assert set(marks) == {"weaker first", "stronger first", "equal stimuli"}
    for label, sign in (("weaker first", -1), ("stronger first", 1), ("equal stimuli", 0)):
        at = np.sign(counts.s1 - counts.s2) == sign
        assert (
            np.column_stack(marks[label].get_data()).tolist()
            == np.column_stack([counts.s1[at], counts.s2[at]]).tolist()
        )
    assert to_hex(marks["weaker first"].get_mec()) == WEAKER_FIRST.lower()


def test_many_subjects_are_sorted_by_their_largest_asymmetry_in_a_figure_of_one_height(table):
    rows = [replace(table.rows[i % len(table)], subject=f"S{i}") for i in range(200)]
    many = AsymmetryTable((*rows, replace(rows[0], subject="none", comparisons=())))
    ax = bt.plots.asymmetry(many)
    assert (
        asymmetry_height(many)
        == asymmetry_height(AsymmetryTable(tuple(rows[:61])))
        < asymmetry_height(AsymmetryTable(tuple(rows[:60])))
    )
    drawn = sorted(points_of(ax), key=lambda point: point[1])
    assert [x for x, *_ in drawn] == sorted((row.maximal.asymmetry for row in rows), reverse=True)
    assert ax.get_ylabel().endswith("1 without a pair in both orders")
    wild = AsymmetryTable(
        (bt.asymmetry(bt.Study([hard_cases()["400 pairs with 3 trials"]])).rows[0],)
    )
    assert asymmetry_height(wild) > asymmetry_height(AsymmetryTable(table.rows[:1]))


def test_subjects_are_chosen_in_the_roles_of_the_paper(table):
    """Likeliest 'equal' with the weaker first, with the stronger first, and alike."""
    rows = [
        replace(row, subject=f"{row.subject}{i}")
        for i, row in enumerate((table["C"], table["B"], table["A"], table["C"]))
    ]
    assert representative(AsymmetryTable(tuple(rows)))[:2] == ("A2", "B1")


# --- words ---------------------------------------------------------------------------------------


def analysed(study):
    """Few draws: a figure is legible whether or not its quantiles are precise."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return bt.run(study, draws=200, seed=1, workers=1)


@cache
def odd(case):
    return analysed(bt.Study([hard_cases()[case]]))


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
    titles = [ax.get_title() for ax in figures["figure_3_examples"].axes]
    assert [title for title in titles if title.startswith("S")] == [
        f"{name} (synthetic)" for name in names
    ]
    require_legible(figures["figure_3_examples"])
    require_legible(figures["figure_5_plane"])
    for wrong in (["S99"], [], ["S01", "S01"]):
        with pytest.raises(InputError):
            bt.plots.paper_figures(bundled, wrong)


@pytest.mark.parametrize("case", ["single pair", "400 pairs with 3 trials", "all equal"])
def test_figures_of_small_and_odd_studies_are_legible(case):
    drawn = bt.plots.paper_figures(odd(case))
    assert set(drawn) == set(NAMES) - ({"figure_1c_asymmetry"} if case == "single pair" else set())
    for figure in drawn.values():
        require_legible(figure)


def test_figures_of_a_real_study_are_legible(real_data):
    study = bt.read_study(
        real_data / "vibrotactile_rate" / "trials.csv", bt.ReadOptions(equal_code="1")
    )
    for figure in bt.plots.paper_figures(analysed(study.select(study.names[:3]))).values():
        require_legible(figure)


def test_names_of_any_kind_are_drawn(small_study):
    names = ["a$b_{c}", "n" * 80, "主体 ①"]
    study = bt.Study(
        [replace(one, name=name) for name, one in zip(names, small_study, strict=True)]
    )
    assert picture(asymmetry_figure(bt.asymmetry(study)), "pdf").startswith(b"%PDF")
    ax = one_panel()
    write_names(ax, {name: np.array([0.2 * i, 0.5]) for i, name in enumerate(names)})
    assert picture(ax.figure, "pdf").startswith(b"%PDF")


def test_captions_say_what_is_left_out_and_what_did_not_converge(analysis):
    words = captions(odd("single pair"))
    assert "Left out: no pair of different stimuli was presented in both orders" in words
    tree = analysis.draws.tree.copy(deep=True)
    tree["sample_stats"]["converged"][0] = 0
    assert "NOT CONVERGED" in captions(replace(analysis, draws=bt.Draws(tree)))
    assert "A, B, C" in captions(analysis)


# --- files ---------------------------------------------------------------------------------------


def test_files_are_all_there_and_the_same_each_time(analysis, tmp_path):
    files = []
    for name in ("first", "second"):
        write_figures(analysis, tmp_path / name)
        files.append({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()})
    expected = {f"{name}.{suffix}" for name in NAMES for suffix in ("pdf", "png")}
    assert set(files[0]) == {*expected, CAPTIONS}
    assert "of 3 subjects gave more " in files[0][CAPTIONS].decode()
    assert files[0] == files[1]
