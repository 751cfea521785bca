"""Figures of single subjects, one column each: answers and curves, the fitted prior among the stimuli, the collapse (Fig. 3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.arrays import FloatArray
from bayes_toe.classical.asymmetry import LEVEL, subject_asymmetry
from bayes_toe.classical.frequencies import collapse
from bayes_toe.data.study import Subject, refuse_intervals
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.inference.draws import Draws
from bayes_toe.model.paper_equations import noise_ratio, variance_ratio
from bayes_toe.model.paper_model import PaperPosterior
from bayes_toe.plots.curves import (
    Curve,
    fitted_curve,
    lines_along,
    main_weaker,
    order_panel,
    over_panel,
    which_weaker,
)
from bayes_toe.plots.style import (
    BELIEF,
    COLUMN,
    LETTERS,
    ORDERS,
    PAGE,
    SMALL,
    chance,
    dress,
    even_columns,
    legend_below,
    new_figure,
)

_ACROSS = 3  # columns of one block of rows
_OF_PRIOR = ("mu1", "sigma_p", "sigma_l")
_CROWDED = 60  # pairs, beyond which marks are small
_SHADOWS = 40  # draws whose priors are shown behind the central one


def central(draws: Draws, subject: str) -> Mapping[str, float]:
    """One point in the middle of a subject's draws: medians of the identified coordinates, as quantities by name.

    Medians of the natural parameters themselves need not lie together where mu_1 and gamma trade
    off.
    """
    points = draws.points(subject)
    found = draws.posterior(subject).quantities(
        np.median(points.reshape(-1, points.shape[-1]), axis=0)
    )
    return {name: float(value) for name, value in found.items()}


def answers_axes(counts: Subject, curve: Curve, ax: Axes, *, size: float = 4.0) -> Axes:
    """Answers in both orders over the stronger stimulus, with fitted curves: posterior mean, central 50 % and 95 % bands.

    Points, of so many points: Laplace estimator and its standard deviation (Eq. e:2b). Stars: the
    orders differ (exact test, Holm over the subject's comparisons). Source: Fig. 3, upper row;
    colours as in the text and Fig. 1C, those of the caption's circles are swapped. Of 'which is
    stronger' over s2 - s1 by the first stimulus, without stars.
    """
    reference = main_weaker(counts)
    low = float(min(counts.s1.min(), counts.s2.min())) if reference is None else reference
    order_panel(ax, counts, curve, low, size=size)
    places = np.concatenate([line.x[[0, -1]] for line in lines_along(counts, low, 2)])
    pad = max(0.06 * float(np.ptp(places)), 0.05)
    ax.set(
        xlim=(places.min() - pad, places.max() + pad),
        ylim=(-0.03, 1.14),
        yticks=[0.0, 0.5, 1.0],
        ylabel=chance(counts.task),
    )
    for one in subject_asymmetry(counts).comparisons if counts.task == SAME_DIFFERENT else ():
        if one.s_weak == reference and one.p_adjusted < LEVEL:
            ax.text(one.s_strong, 1.09, "*", ha="center", va="center_baseline", fontsize=2.5 * size)
    return dress(ax)


def prior_axes(draws: Draws, subject: str, ax: Axes) -> Axes:
    """Fitted prior of a subject, Normal(mu_1, sigma_1^2), among the stimuli.

    Source: Fig. 3, middle row. Thick in their middle, see :func:`central`, thin at some of the
    draws; triangles: stimuli; bar: likelihood noise, 2 sigma_l wide.
    """
    counts, middle = draws.subject(subject), central(draws, subject)
    refuse_intervals([counts], "panel of the prior")
    stimuli = np.unique(np.concatenate([counts.s1, counts.s2]))
    mean, sd = middle["mu1"], float(_prior_sd(middle["sigma_p"], middle["sigma_l"]))
    low, high = _reach(stimuli, mean, sd)
    x = np.linspace(low, high, 400)
    drawn = [np.ravel(draws.values(subject, name)) for name in _OF_PRIOR]
    every = max(1, drawn[0].size // _SHADOWS)
    means, sigma_p, sigma_l = (values[every // 2 :: every, None] for values in drawn)
    sds = _prior_sd(sigma_p, sigma_l)
    # Densities are in units of the peak of the central prior.
    shadows = sd / sds * np.exp(-0.5 * ((x - means) / sds) ** 2)
    density = np.exp(-0.5 * ((x - mean) / sd) ** 2)
    ax.plot(x, np.minimum(shadows, 1.6).T, color=BELIEF, lw=0.4, alpha=0.25)
    ax.fill_between(x, 0.0, density, color=BELIEF, alpha=0.18, lw=0)
    ax.plot(x, density, color=BELIEF, lw=1.4)
    ax.plot(stimuli, np.full_like(stimuli, -0.12), "^", ms=4.0, color="black", mec="white", mew=0.4)
    centre, noise = float(stimuli.mean()), middle["sigma_l"]
    ax.hlines(-0.3, centre - noise, centre + noise, color="#333333", lw=2.2)
    ax.text(centre + noise, -0.3, r" $\sigma_\ell$", va="center", fontsize=SMALL)
    ax.set(xlim=(low, high), ylim=(-0.42, 1.5), yticks=[])
    ax.set(xlabel="stimulus (ln intensity)", ylabel="prior density")
    ax.set_title(rf"$\mu_1$ = {mean:.2f}, $\sigma_1$ = {sd:.2f}".replace("-", "−"))
    dress(ax)
    ax.title.set_fontsize(SMALL)
    ax.spines["left"].set_visible(False)
    return ax


def _prior_sd(sigma_p: npt.ArrayLike, sigma_l: npt.ArrayLike) -> FloatArray:
    """Standard deviation of the self-consistent prior, sigma_p sqrt(G). Source: Eq. axis1."""
    ratio = variance_ratio(noise_ratio(sigma_p, sigma_l))
    return np.asarray(np.asarray(sigma_p, np.float64) * np.sqrt(ratio))


def _reach(stimuli: FloatArray, mean: float, sd: float) -> tuple[float, float]:
    """Stimuli and prior, but no farther from the stimuli than keeps them apart on paper."""
    first, last = float(stimuli.min()), float(stimuli.max())
    span = max(last - first, 1.5 * sd)
    low = np.clip(mean - 2.5 * sd, first - 4.0 * span, first - 0.15 * span)
    high = np.clip(mean + 2.5 * sd, last + 0.15 * span, last + 4.0 * span)
    return float(low), float(high)


def collapse_axes(draws: Draws, subject: str, ax: Axes) -> Axes:
    """Both orders over the normalised distance (s2 - mu_2)/w: one curve q/q0 = 2^(-z^2).

    Source: Fig. 3, lower row. Horizontal bars hold 60 % of the draws; vertical ones are the
    standard deviation of the Laplace estimator over q0. The curve is that of the medians; of 'which
    is stronger' nothing is divided.
    """
    posterior, points = draws.posterior(subject), np.concatenate(list(draws.points(subject)))
    assert isinstance(posterior, PaperPosterior)
    counts = posterior.subject
    refuse_intervals([counts], "collapse of both orders")
    found = collapse(posterior, points, mass=0.6)
    reach = max(1.5, 1.08 * float(np.abs([found.z_low, found.z_high]).max()))
    x = np.linspace(-reach, reach, 300)
    curve = posterior.yes_at_distance(np.median(points, axis=0, keepdims=True), x)[0]
    ax.plot(x, curve / found.top, color="#333333", lw=1.2)
    style: dict[str, Any] = {"ms": 4.0, "elinewidth": 0.8, "mec": "white", "mew": 0.4}
    if counts.n_pairs > _CROWDED:
        style |= {"ms": 2.2, "alpha": 0.4, "elinewidth": 0.3}
    for order, mark in ORDERS.items():
        at = found.order == order
        if at.any():
            across = np.stack([found.z - found.z_low, found.z_high - found.z])[:, at]
            z, ratio, error = found.z[at], found.ratio[at], found.error[at]
            ax.errorbar(z, ratio, error, across, fmt=mark.marker, color=mark.colour, **style)
    top = max(1.14, 1.04 * float((found.ratio + found.error).max()))
    divided = "$/q_0$" if found.top < 1.0 else ""
    ax.set(xlim=(-reach, reach), ylim=(-0.03, top))
    ax.set(xlabel=r"$(s_2 - \mu_2)/w$", ylabel=chance(counts.task) + divided)
    return dress(ax)


def examples_figure(draws: Draws, subjects: Sequence[str]) -> Figure:
    """For each subject a column of :func:`answers_axes`, :func:`prior_axes`, :func:`collapse_axes`.

    After three columns it starts anew.
    """
    across = even_columns(len(subjects), _ACROSS)
    blocks = -(-len(subjects) // across)
    figure = new_figure({1: COLUMN, 2: 5.0}.get(across, PAGE), 5.6 * blocks + 0.3)
    grid = figure.add_gridspec(3 * blocks, across, height_ratios=(1.25, 0.85, 1.1) * blocks)
    for i, subject in enumerate(subjects):
        block, column = divmod(i, across)
        panels = [figure.add_subplot(grid[3 * block + row, column]) for row in range(3)]
        counts = draws.subject(subject)
        answers_axes(counts, fitted_curve(draws, subject), panels[0])
        prior_axes(draws, subject, panels[1])
        collapse_axes(draws, subject, panels[2])
        about = which_weaker(counts, main_weaker(counts))
        title = over_panel(draws, subject)
        panels[0].set_title(f"{title}\n{about}" if about else title, fontsize=LETTERS)
        for ax in panels if column else ():
            ax.set_ylabel("")
    legend_below(figure, size=SMALL)
    return figure
