"""Figure 1 of the report.

`responses_figure` shows a few subjects, which `shown_subjects` chooses; `sizes_figure` shows the
sizes of all subjects and of the group. `responses_panel` draws responses and curves of one subject.
`inline_svg` makes SVG for a page.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_toe.analysis import Analysis
from bayes_toe.answers.order_effect import OrderEffect
from bayes_toe.classical.frequencies import presentation_order
from bayes_toe.data.messages import visible
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.groups.population import PopulationResult
from bayes_toe.plots.curves import (
    Curve,
    draw_shares,
    has_several_weaker,
    label_along,
    main_weaker,
    mean_first,
    order_panel,
)
from bayes_toe.plots.figure_files import figure_bytes
from bayes_toe.plots.order_effect import forest_height, forests
from bayes_toe.plots.style import (
    EQUAL,
    LETTERS,
    ORDERS,
    SMALL,
    Style,
    draw_band,
    grid_panels,
    label_outer,
    legend_below,
    n_rows,
    new_figure,
    plain,
    rows_by_order,
    stimulus_axis,
    write_note,
)

#: Subjects whose responses are shown.
MAX_SUBJECTS = 6
_POINTS = 40  # along a curve
_RESPONSES_WIDE, _SIZES_WIDE, _SIZES_NARROW = 3.6, 5.6, 3.6  # inches
_BAND = ((0.025, 0.975, 0.2),)
#: Colours of a page in the place of those of a printed figure.
_PAGE_COLOURS = {
    "#000000": "var(--ink)",
    "#1c1c1c": "var(--ink)",
    "#ffffff": "var(--page)",
    "#bdbdbd": "var(--line)",
}


def responses_figure(analysis: Analysis, height: float) -> Figure:
    """Draw responses and model-averaged curves of up to six subjects.

    Parameters
    ----------
    analysis : Analysis
    height : float
        Inches.
    """
    names = shown_subjects(analysis.answers)
    n_columns = min(2, len(names))
    figure = new_figure(_RESPONSES_WIDE, height)
    panels = grid_panels(figure, len(names), n_columns, sharey=True)
    for ax, name in zip(panels, names, strict=True):
        curve = analysis.curve(name).yes
        responses_panel(ax, analysis.study[name], curve)
        ax.set_title(plain(name, 24), loc="left", fontsize=LETTERS)
    label_outer(panels, n_columns)
    legend_below(figure, size=SMALL, columns=3)
    return figure


def sizes_figure(
    analysis: Analysis, group: PopulationResult | None, height: float, *, is_narrow: bool = False
) -> Figure:
    """Draw the sizes of all subjects, and of the group; narrow ones one below the other."""
    if is_narrow:
        figure = new_figure(_SIZES_NARROW, 2.0 * height)
        panels = figure.subplots(2, 1, sharey=True)
    else:
        figure = new_figure(_SIZES_WIDE, height)
        panels = figure.subplots(1, 2)
    forests(panels, analysis.evidence, group)
    return figure


def report_height(analysis: Analysis) -> float:
    """Inches of both figures."""
    responses_height = 1.0 + 1.2 * n_rows(len(shown_subjects(analysis.answers)), 2)
    return max(responses_height, forest_height(len(analysis.answers)), 2.6)


def has_curves(analysis: Analysis) -> bool:
    """Whether the figure shows responses: those of a subject that is interpreted."""
    return any(answer.is_interpretable for answer in analysis.answers)


def shown_subjects(answers: Sequence[OrderEffect]) -> list[str]:
    """Names of up to six subjects: one without an order effect, and the surest effects.

    If six or more subjects have an effect, the largest shifts below and above 0 are chosen. No
    subject without an effect takes the place of a subject that has one.
    """
    interpretable = [answer for answer in answers if answer.is_interpretable]
    if len(interpretable) <= MAX_SUBJECTS:
        return [answer.subject for answer in interpretable]
    interpretable.sort(key=lambda answer: answer.log_bayes_factors["order_effect"])
    least_probable, *candidates = interpretable
    n_places = MAX_SUBJECTS - 1
    selected = candidates[-n_places:]
    positive = [answer for answer in candidates if answer.words["order_effect"].is_positive]
    if len(positive) > n_places:
        positive.sort(key=lambda answer: answer.sizes["pse_shift_percent"].q50)
        n_low = n_places // 2
        n_high = n_places - n_low
        selected = [*positive[:n_low], *positive[-n_high:]]
    names = {answer.subject for answer in (least_probable, *selected)}
    return [answer.subject for answer in answers if answer.subject in names]


# --- Responses of a subject ----------------------------------------------------------------------


def responses_panel(ax: Axes, counts: Subject, curve: Curve) -> None:
    """Draw responses and curves by order, with the axis in the unit of the stimuli.

    Without a unit, it is in per cent of the mean first stimulus.

    In 'which was stronger', designs with one or two sizes of step show the share of
    correct responses over the middle of the pair, and designs with one weaker stimulus over the
    stronger one; other designs show P('second').
    """
    middle = mean_first(counts)
    weaker = _only_weaker(counts)
    along: Style = {"size": 3.5, "points": _POINTS, "bands": _BAND}
    if counts.task == WHICH_STRONGER and weaker is not None:
        _correct_panel(ax, counts, curve, weaker)
        stimulus_axis(ax, "stronger stimulus", counts.unit, middle)
    elif counts.task == WHICH_STRONGER and not is_by_first(counts):
        _correct_panel(ax, counts, curve)
        stimulus_axis(ax, "middle of the pair", counts.unit, middle)
    elif counts.task == WHICH_STRONGER:
        order_panel(ax, counts, curve, 0.0, **along)
        label_along(ax, counts)
        ax.set_ylabel("share 'second'")
    else:
        reference = main_weaker(counts)
        order_panel(ax, counts, curve, 0.0 if reference is None else reference, **along)
        stimulus_axis(ax, "stronger stimulus", counts.unit, middle)
        ax.set_ylabel("share 'equal'")
        if has_several_weaker(counts):
            write_note(ax, "pairs with other weaker stimuli are not shown")


def is_by_first(counts: Subject) -> bool:
    """Whether a panel has a curve for each first stimulus, not for each order."""
    if counts.task != WHICH_STRONGER or _only_weaker(counts) is not None:
        return False
    return len(_steps(counts)) > 2


def _steps(counts: Subject) -> list[float]:
    """The different distances between the stimuli of a pair."""
    steps = np.abs(counts.steps)
    largest = float(steps.max())
    return sorted(set(np.round(steps[steps > 0.0] / largest, 6) * largest))


def _only_weaker(counts: Subject) -> float | None:
    """The weaker stimulus of all pairs of different stimuli that were met, if it is one."""
    is_unequal = counts.s1 != counts.s2
    weaker = np.unique(np.minimum(counts.s1, counts.s2)[is_unequal])
    return float(weaker[0]) if len(weaker) == 1 and is_unequal.sum() > 2 else None


def _correct_panel(ax: Axes, counts: Subject, curve: Curve, weaker: float | None = None) -> None:
    """The share of correct responses, a curve for each order.

    Over the stronger stimulus if all pairs have one weaker stimulus, else over the middle.
    """
    position = 0.5 * (counts.s1 + counts.s2)
    if weaker is not None:
        position = np.maximum(counts.s1, counts.s2)
    for mark, rows in rows_by_order(presentation_order(counts)):
        if mark is ORDERS[0]:
            continue
        is_weaker_first = mark is ORDERS[-1]
        n_trials, n_correct = counts.n_trials[rows], counts.n_yes[rows]
        if not is_weaker_first:
            n_correct = n_trials - n_correct
        draw_shares(ax, position[rows], n_correct, n_trials, mark, size=3.5)
        x = np.linspace(position[rows].min(), position[rows].max(), _POINTS)
        pairs = [(x - 0.5 * step, x + 0.5 * step) for step in _steps(counts)]
        if weaker is not None:
            pairs = [(np.full_like(x, weaker), x)]
        for weak, strong in pairs:
            p_correct = curve(weak, strong) if is_weaker_first else 1.0 - curve(strong, weak)
            draw_band(ax, x, p_correct, mark.colour, 1.2, _BAND)
    ax.axhline(0.5, color=EQUAL, lw=0.6, ls=":", zorder=0)
    ax.set(ylim=(-0.03, 1.03), yticks=[0.0, 0.5, 1.0], ylabel="share correct")


# --- As part of a page ---------------------------------------------------------------------------


def inline_svg(figure: Figure, label: str) -> str:
    """A figure as SVG for a page, whose ink and background follow the page's colours."""
    figure.patch.set_alpha(0.0)
    for ax in figure.axes:
        ax.patch.set_alpha(0.0)
    text = figure_bytes(figure, "svg").decode("utf-8")
    # Names of subjects may hold characters that a browser would obey.
    text = "\n".join(map(visible, text[text.index("<svg") :].split("\n")))
    for printed, variable in _PAGE_COLOURS.items():
        text = text.replace(printed, variable)
    # Letters without a colour of their own are black.
    text = text.replace("<svg ", f'<svg role="img" aria-label="{label}" fill="currentColor" ', 1)
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    text = re.sub(r"font-family: [^;\"]*", "font-family: 'DejaVu Sans', sans-serif", text)
    text = re.sub(r"\n +", "\n", text)
    # Curves need one decimal, other coordinates two: the file is a third of the size.
    text = re.sub(r"(\.\d{2})\d+", r"\1", text)
    return re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d)\d+", r"\1", path[0]), text)
