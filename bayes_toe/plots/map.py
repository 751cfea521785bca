"""Map of the subjects of a study: prior mean, memory diffusion, likelihood noise in colour, curves beside it (Fig. 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox

from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.inference.draws import Draws
from bayes_toe.plots.curves import fitted_curve, main_weaker, which_weaker
from bayes_toe.plots.style import (
    BAND,
    COLUMN,
    EQUAL,
    MOST_NAMED,
    PAGE,
    SMALL,
    any_characters,
    dress,
    dress_bar,
    first_panels,
    legend_below,
    new_figure,
    panel,
    plain,
)
from bayes_toe.plots.subject import answers_axes, central

#: Draws or replicates of (mu_1, sigma_p), each of shape (R,), by subject.
Clouds = Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]]

COLOURS = "viridis"
MOST_INSETS = 8
_ACROSS = 2
_CENTRAL = (0.2, 0.8)  # quantiles at the ends of a subject's bars
#: How many times the range of the stimuli the map reaches beyond them at most; what lies farther out is named at its edge.
_FARTHEST = 4.0
#: Points from its subject beyond which a name is joined to it by a line.
_LEADER = 9.0


def map_axes(
    clouds: Clouds,
    ax: Axes | None = None,
    *,
    sigma_l: Mapping[str, float] | None = None,
    stimuli: npt.ArrayLike | None = None,
    names: Mapping[str, str] | None = None,
    truth: Mapping[str, tuple[float, float]] | None = None,
) -> Axes:
    """Medians of (mu_1, sigma_p), one a subject, with bars over the central 60 % of each. Source: Fig. 4, which has ellipses.

    Parameters
    ----------
    clouds : mapping of str to pair of array_like, shape (R,)
        Posterior draws or bootstrap replicates of mu_1 and sigma_p, natural-log intensity. A subject whose median is too far
        from the stimuli is named at the edge.
    ax : matplotlib Axes, optional
        Drawn into, where given.
    sigma_l : mapping of str to float, optional
        Likelihood noise by subject, shown by colour with a bar beside the map.
    stimuli : array_like, optional
        Natural-log intensities of the stimuli, shown as a grey range with lines.
    names : mapping of str to str, optional
        What to write at each subject; by default its name, and of more than :data:`~bayes_toe.plots.style.MOST_NAMED` subjects those
        of the eight farthest out. Names that find no place are left out and counted above the panel, those in the middle first.
    truth : mapping of str to (float, float), optional
        True mu_1 and sigma_p of synthetic subjects, shown as squares.

    Raises
    ------
    InputError
        If there is no subject.
    """
    if not clouds:
        raise InputError("a map needs at least one subject")
    ax = panel(ax, wide=COLUMN + 0.6, high=COLUMN)
    quantiles = {name: _quantiles(cloud) for name, cloud in clouds.items()}
    centres = {name: values[1] for name, values in quantiles.items()}
    known = (
        {}
        if truth is None
        else {name: np.array(truth[name], np.float64) for name in clouds if name in truth}
    )
    _set_limits(
        ax,
        [*(place for values in quantiles.values() for place in values), *known.values()],
        None if stimuli is None else np.asarray(stimuli, np.float64),
    )
    colours = _colours(ax, clouds, sigma_l)
    for name in clouds:
        _draw_subject(ax, quantiles[name], colours[name], min(1.0, MOST_NAMED / len(clouds)))
    ax.set(
        xlabel=r"prior mean $\mu_1$ (ln intensity)",
        ylabel=r"memory diffusion $\sigma_p$ (ln intensity)",
    )
    dress(ax)
    for name, place in known.items():
        ax.plot(
            *zip(centres[name], place, strict=True), ":", color="black", lw=0.6, zorder=3
        )  # whose square it is
        ax.plot(*place, "s", ms=3.5, color=colours[name], mec="black", mew=0.7, zorder=4)
    said = ["bars: 60 %"]
    if known:
        said.append("squares: true")
    ax.set_title(
        "; ".join(said), fontsize=SMALL, loc="left"
    )  # decides where the panel is, and so the names
    if names is None:
        some = [name for name, centre in centres.items() if np.isfinite(centre).all()]
        if len(centres) > MOST_NAMED:
            some = [
                some[i] for i in farthest([float(centres[name][0]) for name in some], MOST_INSETS)
            ]
        names = {name: plain(name, 12) for name in some}
    with any_characters():
        unnamed = _write_names(ax, centres, names)
    if unnamed:
        ax.set_title("; ".join([*said, f"no room for {unnamed} names"]), fontsize=SMALL, loc="left")
    return ax


def map_figure(
    draws: Draws,
    *,
    clouds: Clouds | None = None,
    truth: Mapping[str, Mapping[str, float]] | None = None,
) -> Figure:
    """:func:`study_map_axes`, and the answers of up to eight subjects beside it: those whose prior means lie farthest out.

    Letters go up with the prior mean, and are the same in map and panels.
    """
    mu1 = [central(draws, name)["mu1"] for name in draws.names]
    chosen = farthest(mu1, MOST_INSETS)
    order = sorted(range(len(mu1)) if len(mu1) <= MOST_NAMED else chosen, key=lambda i: mu1[i])
    letters = {draws.names[i]: _letter(rank) for rank, i in enumerate(order)}
    names = {
        name: (f"{letters[name]}: " if name in letters else "") + plain(name, 12)
        for name in draws.names
    }
    figure = new_figure(PAGE, 4.4)
    grid = figure.add_gridspec(1, 2, width_ratios=(1.3, 1.0))
    _draw_insets(figure, grid[1], draws, {draws.names[i]: letters[draws.names[i]] for i in chosen})
    study_map_axes(draws, figure.add_subplot(grid[0]), names=names, clouds=clouds, truth=truth)
    return figure


def _letter(rank: int) -> str:
    """A to Z, then AA, AB and so on."""
    return (_letter(rank // 26 - 1) if rank > 25 else "") + chr(ord("A") + rank % 26)


def study_map_axes(
    draws: Draws,
    ax: Axes,
    *,
    names: Mapping[str, str] | None = None,
    clouds: Clouds | None = None,
    truth: Mapping[str, Mapping[str, float]] | None = None,
) -> Axes:
    """:func:`map_axes` of a study's draws, or of replicates in their place: likelihood noise at medians of the identified coordinates."""
    subjects = [draws.subject(name) for name in draws.names]
    if draws.synthetic:
        ax.set_title("synthetic data", fontsize=SMALL, loc="right")  # before names are placed
    return map_axes(
        posterior_clouds(draws) if clouds is None else clouds,
        ax,
        sigma_l={name: central(draws, name)["sigma_l"] for name in draws.names},
        stimuli=np.concatenate(
            [values for counts in subjects for values in (counts.s1, counts.s2)]
        ),
        names=names,
        truth=None
        if truth is None
        else {
            name: (of["mu1"], of["sigma_p"])
            for name, of in truth.items()
            if {"mu1", "sigma_p"} <= set(of)
        },
    )


def posterior_clouds(draws: Draws) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Posterior draws of (mu_1, sigma_p) by subject, as :func:`map_axes` takes them."""
    return {
        name: (draws.values(name, "mu1").ravel(), draws.values(name, "sigma_p").ravel())
        for name in draws.names
    }


def farthest(values: Sequence[float], count: int) -> list[int]:
    """Indices of the `count` values nearest to both ends, in the order of the values.

    Examples
    --------
    >>> farthest([0.1, 5.0, -3.0, 0.2, 0.3], 3)
    [2, 0, 1]
    """
    order = sorted(range(len(values)), key=lambda i: values[i])
    low = -(-min(count, len(order)) // 2)
    return order[:low] + order[max(low, len(order) - (count - low)) :]


def _draw_insets(
    figure: Figure, place: SubplotSpec, draws: Draws, letters: Mapping[str, str]
) -> None:
    """Small panels in the order of their letters, at least three rows high so that they stay small."""
    down = max(-(-len(letters) // _ACROSS), 3)
    panels = first_panels(place.subgridspec(down, _ACROSS), len(letters), sharey=True)
    for i, (name, letter) in enumerate(letters.items()):
        counts = draws.subject(name)
        ax, about = (
            answers_axes(counts, fitted_curve(draws, name), panels[i], size=2.8),
            which_weaker(counts, main_weaker(counts)),
        )
        ax.set_title(
            f"{letter}: {plain(name, 12)}" + (about and f"\n{about}"),
            fontsize=SMALL,
            pad=7.0 if about else 2.0,
        )
        last = i + _ACROSS >= len(letters)
        ax.set_xlabel(
            ax.get_xlabel().replace(" (ln intensity)", "") if last else "", fontsize=SMALL
        )
        ax.set_ylabel("" if i % _ACROSS else ax.get_ylabel(), fontsize=SMALL)
    legend_below(figure, size=SMALL)


def _set_limits(
    ax: Axes,
    places: Sequence[FloatArray],
    stimuli: FloatArray | None,
) -> None:
    """Room for all places, but not too far from the stimuli, which are drawn behind them."""
    points = np.array(places)
    points = points[np.isfinite(points).all(axis=1)]
    low, high = (
        (float(points[:, 0].min()), float(points[:, 0].max())) if len(points) else (-1.0, 1.0)
    )
    if stimuli is not None:
        first, last, different = float(stimuli.min()), float(stimuli.max()), np.unique(stimuli)
        reach = _FARTHEST * max(last - first, 0.5)
        low, high = min(max(low, first - reach), first), max(min(high, last + reach), last)
        ax.axvspan(first, last, color=BAND, lw=0, zorder=0)
        for s in different if len(different) <= 12 else ():
            ax.axvline(s, color="#CFCFCF", lw=0.6, zorder=0)
    inside = points[(points[:, 0] >= low) & (points[:, 0] <= high), 1]
    up = inside if len(inside) else points[:, 1] if len(points) else np.array([0.0, 1.0])
    pad_x, bottom, top = 0.06 * (high - low) + 1e-9, float(up.min()), float(up.max())
    pad_y = 0.09 * (top - bottom) + 1e-3 * abs(top) + 1e-12
    ax.set(xlim=(low - pad_x, high + pad_x), ylim=(max(0.0, bottom - pad_y), top + pad_y))


def _colours(ax: Axes, clouds: Clouds, sigma_l: Mapping[str, float] | None) -> dict[str, Any]:
    """Colour of each subject; with likelihood noise the bar that explains it."""
    if sigma_l is None:
        return dict.fromkeys(clouds, EQUAL)
    values = [sigma_l[name] for name in clouds]
    scale = ScalarMappable(
        Normalize(min(0.0, *values) if len(values) > 1 else 0.0, max(values)), COLOURS
    )
    bar = ax.figure.colorbar(scale, ax=ax, fraction=0.05, pad=0.02, aspect=30)
    dress_bar(bar, r"likelihood noise $\sigma_\ell$ (ln intensity)")
    return {
        name: scale.to_rgba(np.array([value]))[0]
        for name, value in zip(clouds, values, strict=True)
    }


def _quantiles(cloud: tuple[npt.ArrayLike, npt.ArrayLike]) -> FloatArray:
    """Lower end, median and upper end of both coordinates, shape (3, 2); missing points are left out."""
    low, high = _CENTRAL
    points = np.stack([np.ravel(np.asarray(values, np.float64)) for values in cloud], axis=-1)
    # Infinite points keep their order only where no two quantiles are averaged.
    return np.asarray(
        np.nanquantile(points, [low, 0.5, high], axis=0, method="closest_observation")
    )


def _draw_subject(ax: Axes, quantiles: FloatArray, colour: Any, weight: float) -> None:
    """A dot at the medians with a bar along each axis; fainter where `weight`, at most 1, is less."""
    (left, bottom), (x, y), (right, top) = quantiles
    style: dict[str, Any] = {"color": colour, "lw": 1.1 * weight, "alpha": 0.75 * weight**0.5}
    ax.plot([left, right], [y, y], **style)
    ax.plot([x, x], [bottom, top], **style)
    ax.plot(x, y, "o", ms=2.5 + weight, color=colour)


# --- names at their subjects ------------------------------------------------------------------------------------------------------


def _write_names(ax: Axes, centres: Mapping[str, FloatArray], labels: Mapping[str, str]) -> int:
    """Each name beside its centre, at the first place free of other names and centres; beyond the edge, at the edge with its mu_1.

    Those farthest to either side come first. Returns how many found no place: names over each other cannot be read.
    """
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()  # decides where the panel is
    within, (low, high), (bottom, top) = ax.get_window_extent(), ax.get_xlim(), ax.get_ylim()
    shown = {
        name: np.clip(centre, [low, bottom], [high, top])
        for name, centre in centres.items()
        if np.isfinite(centre).all()
    }
    marks = {name: ax.transData.transform(point) for name, point in shown.items()}
    taken = [Bbox([mark - 2.0, mark + 2.0]) for mark in marks.values()]
    middle, unnamed = float(np.median([mark[0] for mark in marks.values()])) if marks else 0.0, 0
    for name in sorted(
        (one for one in marks if one in labels),
        key=lambda n: (-abs(marks[n][0] - middle), marks[n][1]),
    ):
        beyond = bool(np.any(shown[name] != centres[name]))
        words = labels[name] + (
            f" ($\\mu_1$ = {centres[name][0]:.2g})".replace("-", "−") if beyond else ""
        )
        text = ax.annotate(
            words,
            tuple(shown[name]),
            (0.0, 0.0),
            textcoords="offset points",
            fontsize=SMALL,
            zorder=6,
        )
        text.set_path_effects(
            [withStroke(linewidth=1.6, foreground="white")]
        )  # legible over bars too
        if beyond:
            ax.plot(
                *shown[name],
                "<" if centres[name][0] < low else ">",
                ms=4.0,
                color=EQUAL,
                clip_on=False,
            )
        for place, (across, up) in _PLACES:
            text.set(
                position=place,
                ha=("right", "center", "left")[across + 1],
                va=("top", "center", "bottom")[up + 1],
            )
            box = text.get_window_extent()
            inside = all(map(within.contains, (box.x0, box.x1), (box.y0, box.y1)))
            if inside and not any(box.overlaps(other) for other in taken):
                break
        else:
            text.remove()
            unnamed += 1
            continue
        if np.hypot(*place) > _LEADER:
            line = {"arrowstyle": "-", "lw": 0.5, "color": EQUAL, "shrinkA": 0.0, "shrinkB": 0.0}
            ax.annotate(
                "", tuple(shown[name]), place, textcoords="offset points", arrowprops=line, zorder=5
            )
        taken.append(box)
    return unnamed


#: Offsets in points with their sides: right, left, above, below and between, then farther out.
_PLACES = [
    ((away * across * scale, away * up * scale), (across, up))
    for away in (3.0, 7.0, 12.0, 18.0, 26.0, 36.0, 48.0, 62.0, 78.0, 96.0)
    for across, up, scale in (
        (1, 0, 1.0),
        (-1, 0, 1.0),
        (0, 1, 1.0),
        (0, -1, 1.0),
        (1, 1, 0.7),
        (1, -1, 0.7),
        (-1, 1, 0.7),
        (-1, -1, 0.7),
    )
]
