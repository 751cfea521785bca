"""The paper's map of subjects: prior mean against memory diffusion (Fig. 4)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox

from bayes_toe.arrays import FloatArray
from bayes_toe.data.messages import counted
from bayes_toe.inference.draws import Draws
from bayes_toe.plots.style import (
    BAND,
    COLUMN,
    MOST_NAMED,
    SMALL,
    any_characters,
    dress,
    dress_bar,
    new_figure,
    plain,
)
from bayes_toe.plots.subject import central

#: Draws or replicates of (mu_1, sigma_p), each of shape (R,), by subject.
Clouds = Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]]

#: Without the lightest colours, which are lost on paper.
COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.85, 256)))
_CENTRAL = (0.2, 0.5, 0.8)  # the ends of a subject's bars, and its dot
#: How many times the range of the stimuli the map reaches beyond them at most.
_FARTHEST = 4.0
#: Places of a name beside its dot, points, with the sides of its letters that are there.
_PLACES = (
    ((3.0, 0.0), "left", "center"),
    ((-3.0, 0.0), "right", "center"),
    ((0.0, 3.0), "center", "bottom"),
    ((0.0, -3.0), "center", "top"),
    ((5.0, 6.0), "left", "bottom"),
    ((5.0, -6.0), "left", "top"),
    ((-5.0, 6.0), "right", "bottom"),
    ((-5.0, -6.0), "right", "top"),
)


def map_figure(
    draws: Draws,
    *,
    clouds: Clouds | None = None,
    truth: Mapping[str, Mapping[str, float]] | None = None,
) -> Figure:
    """Medians of (mu_1, sigma_p), a dot a subject, with bars over the central 60 % of each.

    Source: Fig. 4, which has ellipses. The colour is the likelihood noise, at the medians of the
    identified coordinates. Names that find no place, and subjects too far from the stimuli, are
    counted above the panel.

    Parameters
    ----------
    draws : Draws
        Of the paper's model.
    clouds : mapping of str to pair of array_like, shape (R,), optional
        Bootstrap replicates of mu_1 and sigma_p in the place of the draws, natural-log intensity.
    truth : mapping, optional
        True parameters of synthetic subjects, shown as squares.
    """
    if clouds is None:
        clouds = posterior_clouds(draws)
    stimuli = np.concatenate([np.concatenate([subject.s1, subject.s2]) for subject in draws.study])
    figure = new_figure(1.4 * COLUMN, COLUMN + 0.2)
    ax = figure.subplots()
    places = {name: _quantiles(cloud) for name, cloud in clouds.items()}
    colours = _colours(ax, {name: central(draws, name)["sigma_l"] for name in clouds})
    weight = min(1.0, MOST_NAMED / len(places))
    for name, ((left, bottom), (x, y), (right, top)) in places.items():
        style: dict[str, Any] = {"color": colours[name], "lw": 1.1 * weight}
        ax.plot([left, right], [y, y], **style)
        ax.plot([x, x], [bottom, top], **style)
        ax.plot(x, y, "o", ms=2.5 + weight, color=colours[name])
    notes = ["bars: 60 %"]
    known = {} if truth is None else _known_places(truth, places)
    if known:
        notes.append("squares: true")
    for name, place in known.items():
        # A line shows whose square it is.
        ax.plot(*zip(places[name][1], place, strict=True), ":", color="black", lw=0.6)
        ax.plot(*place, "s", ms=3.5, color=colours[name], mec="black", mew=0.7)
    points = np.array([*(row for rows in places.values() for row in rows), *known.values()])
    _set_limits(ax, points, stimuli)
    ax.set(
        xlabel=r"prior mean $\mu_1$ (ln intensity)",
        ylabel=r"memory diffusion $\sigma_p$ (ln intensity)",
    )
    dress(ax)
    if draws.synthetic:
        ax.set_title("synthetic data", fontsize=SMALL, loc="right")
    ax.set_title("; ".join(notes), fontsize=SMALL, loc="left")  # decides where the panel is
    low, high = ax.get_xlim()
    centres = {name: rows[1] for name, rows in places.items() if low <= rows[1][0] <= high}
    n_unnamed = write_names(ax, centres)
    if n_unnamed:
        notes.append(f"no room for {counted(n_unnamed, 'name')}")
    if len(centres) < len(places):
        notes.append(f"{counted(len(places) - len(centres), 'subject')} beyond the panel")
    ax.set_title("; ".join(notes), fontsize=SMALL, loc="left")
    return figure


def posterior_clouds(draws: Draws) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Posterior draws of (mu_1, sigma_p) by subject."""
    return {
        name: (draws.values(name, "mu1").ravel(), draws.values(name, "sigma_p").ravel())
        for name in draws.names
    }


def _known_places(
    truth: Mapping[str, Mapping[str, float]], places: Mapping[str, FloatArray]
) -> dict[str, tuple[float, float]]:
    """True mu_1 and sigma_p of the subjects of whom both are known."""
    return {
        name: (values["mu1"], values["sigma_p"])
        for name, values in truth.items()
        if name in places and {"mu1", "sigma_p"} <= set(values)
    }


def _quantiles(cloud: tuple[npt.ArrayLike, npt.ArrayLike]) -> FloatArray:
    """Lower end, median and upper end of both coordinates, shape (3, 2), of finite points."""
    points = np.stack([np.ravel(np.asarray(values, np.float64)) for values in cloud], axis=-1)
    # Infinite points keep their order only where no two quantiles are averaged.
    ends = np.nanquantile(points, _CENTRAL, axis=0, method="closest_observation")
    return np.asarray(ends)


def _set_limits(ax: Axes, points: FloatArray, stimuli: FloatArray) -> None:
    """Room for all points, but not too far from the stimuli, which are drawn behind them."""
    first, last = float(stimuli.min()), float(stimuli.max())
    reach = _FARTHEST * max(last - first, 0.5)
    finite = points[np.isfinite(points).all(axis=1)]
    shown = finite[(finite[:, 0] >= first - reach) & (finite[:, 0] <= last + reach)]
    x = np.append(shown[:, 0], [first, last])
    y = shown[:, 1] if len(shown) else np.array([0.0, 1.0])
    pad_x = 0.08 * float(np.ptp(x)) + 1e-9
    pad_y = 0.08 * float(np.ptp(y)) + 1e-3 * float(y.max()) + 1e-12
    ax.axvspan(first, last, color=BAND, lw=0, zorder=0)
    for level in np.unique(stimuli):
        ax.axvline(level, color="#CFCFCF", lw=0.4, zorder=0)
    ax.set(xlim=(x.min() - pad_x, x.max() + pad_x))
    ax.set(ylim=(max(0.0, y.min() - pad_y), y.max() + pad_y))


def _colours(ax: Axes, noise: Mapping[str, float]) -> dict[str, Any]:
    """The colour of each subject's noise, with the bar that explains it."""
    scale = ScalarMappable(Normalize(0.0, max(noise.values())), COLOURS)
    bar = ax.figure.colorbar(scale, ax=ax, fraction=0.05, pad=0.02, aspect=30)
    dress_bar(bar, r"likelihood noise $\sigma_\ell$ (ln intensity)")
    return {name: scale.to_rgba(np.array([value]))[0] for name, value in noise.items()}


@any_characters()
def write_names(ax: Axes, centres: Mapping[str, FloatArray]) -> int:
    """Write each name beside its dot where no other name or dot is; return how many have none."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()  # decides where the panel is
    panel = ax.get_window_extent()
    marks = {name: ax.transData.transform(centre) for name, centre in centres.items()}
    taken = [Bbox([mark - 2.0, mark + 2.0]) for mark in marks.values()]
    n_unnamed = 0
    for name in sorted(marks, key=lambda name: float(marks[name][0])):
        centre = tuple(centres[name])
        text = ax.annotate(plain(name, 12), centre, (0.0, 0.0), textcoords="offset points")
        text.set(fontsize=SMALL, zorder=6)
        text.set_path_effects([withStroke(linewidth=1.6, foreground="white")])
        for place, horizontal, vertical in _PLACES:
            text.set(position=place, ha=horizontal, va=vertical)
            box = text.get_window_extent()
            is_inside = panel.contains(box.x0, box.y0) and panel.contains(box.x1, box.y1)
            if is_inside and not any(box.overlaps(other) for other in taken):
                taken.append(box)
                break
        else:
            text.remove()
            n_unnamed += 1
    return n_unnamed
