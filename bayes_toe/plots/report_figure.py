"""Figure 1 of the report.

`responses_figure` shows a few subjects, which `shown_subjects` chooses; `sizes_figure` shows the
sizes of all subjects and of the group. `inline_svg` makes SVG for a page.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from matplotlib.figure import Figure

from bayes_toe.analysis import Analysis
from bayes_toe.answers.order_effect import OrderEffect
from bayes_toe.data.messages import visible
from bayes_toe.groups.population import PopulationResult
from bayes_toe.plots.curves import finish_panels, responses_panel
from bayes_toe.plots.figure_files import figure_bytes
from bayes_toe.plots.order_effect import forest_height, forests
from bayes_toe.plots.style import (
    LETTERS,
    grid_panels,
    grid_rows,
    legend_outside,
    new_figure,
    plain,
)

#: Largest number of subjects whose responses are shown.
MAX_SUBJECTS = 6


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
    figure = new_figure(3.6, height)
    panels = grid_panels(figure, len(names), n_columns)
    for ax, name in zip(panels, names, strict=True):
        responses_panel(ax, analysis.study[name], analysis.curve(name))
        ax.set_title(plain(name, limit=24), loc="left", fontsize=LETTERS)
    finish_panels(panels, n_columns)
    legend_outside(figure, side="upper")
    return figure


def sizes_figure(
    analysis: Analysis, group: PopulationResult | None, height: float, *, is_narrow: bool = False
) -> Figure:
    """Draw the sizes of all subjects, and of the group.

    `height` is the height of a panel, inches. A narrow figure has one panel below the other.
    """
    if is_narrow:
        figure = new_figure(3.6, 2.0 * height)
        panels = figure.subplots(2, 1, sharey=True)
    else:
        figure = new_figure(5.6, height)
        panels = figure.subplots(1, 2, sharey=True)
    forests(panels, analysis.evidence, group)
    return figure


def report_height(analysis: Analysis) -> float:
    """Inches of the responses and of the sizes, which stand side by side, at least 2.6."""
    # 1.2 for each row of panels, and 1.0 for legend and labels.
    responses_height = 1.0 + 1.2 * grid_rows(len(shown_subjects(analysis.answers)), n_columns=2)
    return max(responses_height, forest_height(len(analysis.answers)), 2.6)


def shown_subjects(answers: Sequence[OrderEffect]) -> list[str]:
    """Names of the subject with the least evidence of an order effect and the five with the most.

    They are in the order of the study, without subjects that are not interpreted.
    """
    ranking = [answer for answer in answers if answer.is_interpretable]
    ranking.sort(key=lambda answer: answer.log_bayes_factors["order_effect"])
    # The least evidence is first. The first subject and the last MAX_SUBJECTS - 1 subjects are
    # shown, which overlap if there are fewer than MAX_SUBJECTS.
    names = {answer.subject for answer in (*ranking[:1], *ranking[1 - MAX_SUBJECTS :])}
    return [answer.subject for answer in answers if answer.subject in names]


# --- As part of a page ---------------------------------------------------------------------------


def inline_svg(figure: Figure, label: str) -> str:
    """A figure as SVG for a page, whose ink and background follow the page's colours."""
    figure.patch.set_alpha(0.0)
    for ax in figure.axes:
        ax.patch.set_alpha(0.0)
    text = figure_bytes(figure, "svg").decode("utf-8")
    text = text[text.index("<svg") :]  # without the head of a file
    # Names of subjects may hold characters that a browser would obey.
    text = "\n".join(map(visible, text.split("\n")))
    # The colours of the page take the place of black and white.
    text = text.replace("#000000", "var(--ink)").replace("#ffffff", "var(--page)")
    # Letters without a colour of their own would be black.
    text = text.replace("<svg ", f'<svg role="img" aria-label="{label}" fill="currentColor" ', 1)
    # Figures of a page have the same names of groups, as in '<g id="axes_1"'.
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    text = re.sub(r"font-family: [^;\"]*", "font-family: 'DejaVu Sans', sans-serif", text)
    text = re.sub(r"\n +", "\n", text)
    # Numbers keep two decimals, and one decimal in paths such as ' d="M 1.23 4.56"': the file is a
    # third of the size.
    text = re.sub(r"(\.\d{2})\d+", r"\1", text)
    return re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d)\d+", r"\1", path[0]), text)
