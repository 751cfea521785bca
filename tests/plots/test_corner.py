"""Corner plots, by what is drawn in them and where."""

import os

import numpy as np
import pytest
from commands import run_python
from conftest import five_pairs, refused
from legible import marks_of, require_legible, words_of
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.text import Text
from numpy.random import default_rng

import bayes_toe as bt
from bayes_toe.model.parameters import QUANTITY_BY_NAME
from bayes_toe.plots.corner import OVERLAID, TRUTH, contour_grid

TRUE = {"mu1": -0.7, "sigma_p": 0.25, "sigma_l": 0.17, "q0": 0.92}


def legend_text(figure):
    """The words of the legend, a line each."""
    return "\n".join(words_of(figure.legends[0].findobj(Text)))


def true_values_in(ax):
    """Where true values stand in a panel: abscissae of vertical, ordinates of horizontal lines."""
    abscissae = []
    ordinates = []
    for line in ax.lines:
        if line.get_color() == TRUTH and len(line.get_xdata()) == 2:
            (x, other_x), (y, other_y) = line.get_data()
            if x == other_x:
                abscissae.append(x)
            if y == other_y:
                ordinates.append(y)
    return abscissae, ordinates


def test_corner_shows_the_natural_parameters_with_prior_and_truth(analysis):
    figure = bt.plots.corner(analysis.draws, "A", truths={"A": TRUE}, prior=bt.Prior())
    axes = np.array(figure.axes).reshape(4, 4)  # of four parameters by four
    for ax, name in zip(axes[-1], TRUE, strict=True):
        assert ax.get_xlabel().startswith(QUANTITY_BY_NAME[name].symbol)
    for ax, (name, value) in zip(axes.diagonal(), TRUE.items(), strict=True):
        low, high = ax.get_xlim()
        assert low < value < high
        x_of_lines = [line.get_xdata()[0] for line in ax.lines]
        # Vertical lines stand at the median, the ends of the 95 % interval and the true value.
        quantiles = np.quantile(analysis.draws.values("A", name), [0.025, 0.5, 0.975])
        for x in (*quantiles, value):
            assert np.isclose(x_of_lines, x).any()
    assert high <= 1.0  # The last parameter, q0, is a probability.
    assert "prior\ntrue value" in legend_text(figure)


def shares_inside(areas, points):
    """Share of points within each area: a ring in a ring is a hole."""
    shares = []
    for area in areas:
        is_inside = [Path(ring).contains_points(points) for ring in area.to_polygons()]
        shares.append(np.mean(np.sum(is_inside, axis=0) % 2))
    return shares


def gaussian_points(rng, n):
    return rng.multivariate_normal([1.0, -2.0], [[1.0, 0.3], [0.3, 0.2]], n).T


def points_with_bounds(rng, n):
    return rng.exponential(0.1, n), rng.beta(1.0, 4.0, n)


def points_with_long_tails(rng, n):
    x = rng.standard_t(1.5, n)
    return x, np.exp(-0.5 * np.abs(x)) + rng.normal(0.0, 0.02, n)


@pytest.mark.parametrize("n", [800, 20_000])
@pytest.mark.parametrize("draw", [gaussian_points, points_with_bounds, points_with_long_tails])
def test_contours_hold_their_shares_of_the_draws(draw, n):
    # The contours hold 95 and 50 % of n points, whatever the distribution of the points: normal, at
    # the bounds of both axes, or with a narrow peak. Few points are outside of the spans.
    x, y = draw(default_rng(1), n)
    spans = np.quantile([x, y], [0.005, 0.995], axis=1).T.tolist()
    contours = Figure().subplots().contour(*contour_grid(x, y, *spans)).get_paths()
    assert shares_inside(contours, np.column_stack([x, y])) == pytest.approx([0.95, 0.5], abs=0.01)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"coordinates": "polar"}, "coordinates 'polar', allowed: natural"),
        ({"coordinates": []}, "allowed: natural, identified or some of"),
        ({"truths": {"A": {"mu_1": 0.0}}}, "unknown quantity 'mu_1'"),
        ({"truths": {"A": {"mu1": float("nan")}}}, "mu1=nan"),
        ({"truths": {"A": {"sigma_p": 0.0}}}, "a positive finite number"),
        ({"truths": {"A": {"q0": 2.0}}}, "q0=2.0, allowed: a finite number from 0 to 1"),
        ({"truths": {"A": {"jnd": 800.0}}}, "jnd=800.0, allowed: a finite number from 0 to inf"),
        ({"truths": {"A": {"jnd": "a"}}}, "truths: jnd: found 'a', allowed: a finite number"),
        ({"subject": []}, "allowed: 1 to 4, each once"),
        ({"subject": ["A", "A"]}, "found 'A', 'A'; allowed"),
        ({"truths": TRUE}, "a mapping of each subject's values by its name"),
    ],
)
def test_wrong_options_of_a_corner_plot_are_refused(analysis, options, message):
    # One option of the corner plot of subject A is wrong.
    with refused(message):
        bt.plots.corner(analysis.draws, **{"subject": "A"} | options)


@pytest.mark.parametrize(
    "quantities",
    ["gain", "mu1 width", "mu1 sigma_p sigma_l q0 gain offset pull"],
)
def test_words_and_ticks_are_clear_of_the_panels_and_of_each_other(analysis, quantities):
    names = quantities.split()
    figure = bt.plots.corner(
        analysis.draws, "A", coordinates=names, truths={"A": TRUE}, prior=bt.Prior()
    )
    require_legible(figure)
    axes = np.array(figure.axes).reshape(len(names), len(names))
    legend_box = figure.legends[0].get_window_extent()
    # Panels on and below the diagonal are drawn.
    for ax in axes[np.tril_indices(len(names))]:
        assert not legend_box.overlaps(ax.get_window_extent())
    assert all(2 <= len(ax.get_xticks()) <= 6 for ax in axes[-1])


def test_only_true_values_that_are_known_are_shown(analysis):
    figure = bt.plots.corner(
        analysis.draws, "A", coordinates=["mu1", "gain"], truths={"A": {"mu1": -0.7}}
    )
    # Of two by two panels, the first panel is that of mu1, and the last panel that of the gain.
    panel_of_mu1, *_, panel_of_gain = figure.axes
    assert true_values_in(panel_of_mu1) == ([-0.7], [])
    # The gain follows from sigma_p and sigma_l, not from mu1.
    assert true_values_in(panel_of_gain) == ([], [])
    assert "true value" in legend_text(figure)
    assert "true value" not in legend_text(bt.plots.corner(analysis.draws, "A", coordinates=["q0"]))


def test_a_true_value_far_from_all_draws_is_within_its_panel(analysis):
    figure = bt.plots.corner(analysis.draws, "A", coordinates=["q0"], truths={"A": {"q0": 0.001}})
    low, _ = figure.axes[0].get_xlim()
    assert low < 0.001


# --- several subjects in the same panels ----------------------------------------------------------


def test_several_subjects_share_their_panels(analysis):
    names = ["gain", "offset"]
    options = {"coordinates": names, "prior": bt.Prior(), "truths": {"C": TRUE}}
    figure = bt.plots.corner(analysis.draws, ["A", "C"], **options)
    # In the panel of a quantity, both subjects have a line at their median.
    axes = np.array(figure.axes).reshape(2, 2)
    for ax, name in zip(axes.diagonal(), names, strict=True):
        x_of_lines = [line.get_xdata()[0] for line in ax.lines]
        for subject in "AC":
            median = np.median(analysis.draws.values(subject, name))
            assert np.isclose(x_of_lines, median).any()
            assert ax.get_xlim()[0] < median < ax.get_xlim()[1]
    # A square in the panel of gain and offset marks their true values of C, the second subject.
    # The gain follows from the ratio of sigma_l, .17, and sigma_p, .25.
    *_, square = marks_of(axes[1, 0], "s")
    _, (colour_of_c, _), *_ = OVERLAID
    assert square.get_color() == colour_of_c
    assert square.get_xdata() == pytest.approx([bt.model.gain((0.17 / 0.25) ** 2)])
    assert "A, median\nC, median\n50 and 95 % of the draws\nprior\ntrue values" in legend_text(
        figure
    )


#: Another process has just replaced the file in which ArviZ notes the day of its warning. The first
#: attempt to replace the file fails, and the second attempt succeeds.
_AT_ONCE = """
import pathlib
lost, replace = [], pathlib.Path.replace
def once_lost(path, target):
    lost.append(target)
    if len(lost) == 1:
        raise FileNotFoundError(target)
    return replace(path, target)
pathlib.Path.replace = once_lost
from bayes_toe.plots.corner import corner_package
print(corner_package().__name__, len(lost) in (0, 2))  # ArviZ 1.x notes nothing
"""


def test_two_processes_may_import_arviz_for_the_first_time_of_a_day(tmp_path):
    # In a new cache, ArviZ notes the day at its import. The script imitates a second process.
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path)}
    result = run_python("-c", _AT_ONCE, env=environment)
    assert (result.stdout.split(), result.stderr) == (["corner", "True"], "")


# --- the four models of the observer --------------------------------------------------------------


def test_the_four_models_show_constant_error_contraction_and_jnd(small_study):
    draws = bt.sample(small_study.select(["A", "B"]), model="both", draws=200, seed=1)
    figure = bt.plots.corner(draws, "A", prior=bt.Prior(), truths={"A": {"contraction": 0.1}})
    require_legible(figure)
    labels = [ax.get_xlabel() for ax in figure.axes[-3:]]  # of the lowest row
    assert labels == ["constant error $c$, %", "contraction, %", "JND, %"]
    assert "model 'both'" in legend_text(figure)
    panel_of_contraction = figure.axes[4]  # in the middle of three by three panels
    assert true_values_in(panel_of_contraction) == ([10.0], [])  # .1 is 10 %
    # All seven parameters of the model: 7 by 7 panels.
    assert len(bt.plots.corner(draws, ["A", "B"], coordinates="identified").axes) == 49


def test_offsets_and_powers_of_ten_stand_beside_the_names_of_axes():
    subject = five_pairs(name="A", factor=4e-5, shift=20.72)
    figure = bt.plots.corner(bt.sample(bt.Study([subject]), draws=300, seed=1), "A")
    # Stimuli are near 20.72 and differ by 2e-5: ticks of mu1 have an offset, and ticks of all three
    # parameters in this unit have a power of ten. The last parameter, q0, has no unit.
    mu1, sigma_p, sigma_l = (ax.get_xlabel() for ax in figure.axes[-4:-1])  # of the lowest row
    assert "2.072" in mu1
    for label in (mu1, sigma_p, sigma_l):
        assert "10^{" in label
    require_legible(figure)
