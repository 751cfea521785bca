"""The figure of a population: its subjects alone and in the group, a new subject's curves, what covariates do, whether its form fits."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from itertools import zip_longest
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bayes_toe.groups.population import Population
from bayes_toe.groups.predictive_check import PredictiveCheck, predictive_check
from bayes_toe.plots.effects import ASYMMETRY, direction, effects_axes
from bayes_toe.plots.forest import LONGEST, MOST_NAMED_IN_GROUP, Marked, forest_axes, forest_height, main_quantities, marked
from bayes_toe.plots.group_check import predictive_check_axes
from bayes_toe.plots.new_subject import new_subject_axes
from bayes_toe.plots.said_interval import said_interval
from bayes_toe.plots.style import BAD, LETTERS, MARKED, PAGE, SMALL, even_columns, new_figure, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ACROSS = 4
#: Inches of the key over the forests, and of the strip of a new subject and the predictive check.
_KEY, _NEW_HEIGHT = 0.25, 3.1


def population_figure(found: Population, check: PredictiveCheck | None = None) -> Figure:
    """Everybody's parameters alone and in the group, :func:`new_subject_axes`, :func:`predictive_check_axes`, :func:`effects_axes`.

    Parameters
    ----------
    found : Population
    check : PredictiveCheck, optional
        Made here where it is not given.
    """
    values, title = marked(found), heading(found)
    blocks = [partial(_draw_forests, found, values), partial(_draw_new, found, check)]
    heights = [_forests_height(found), _NEW_HEIGHT]
    if found.regressors.columns:
        blocks.append(partial(_draw_effects, found))
        heights.append(_effects_height(found))
    over = 0.08 + 0.155 * len(title.splitlines())
    figure = new_figure(PAGE, over + sum(heights), layout=None)
    figure.suptitle(
        title, fontsize=LETTERS + 1.0, color="black" if found.converged else BAD, y=1.0 - 0.06 / (over + sum(heights)), va="top"
    )
    for block, height in zip(blocks, heights, strict=True):
        block(_Block(figure, over, height))
        over += height
    return figure


class _Block(NamedTuple):
    """A strip of a figure: so many inches from its top, so many high."""

    figure: Figure
    top: float
    height: float

    def panels(self, rows: int, columns: int, *, left: float, over: float, under: float, apart: float, right: float = 0.12) -> list[Axes]:
        """Panels with so many inches left of all, over and under each, and between two, row by row."""
        wide, high = self.figure.get_size_inches()
        each = (wide - left - right - (columns - 1) * apart) / columns, self.height / rows - over - under
        grid = self.figure.add_gridspec(
            rows,
            columns,
            left=left / wide,
            right=1.0 - right / wide,
            top=1.0 - (self.top + over) / high,
            bottom=1.0 - (self.top + self.height - under) / high,
            wspace=apart / each[0],
            hspace=(over + under) / each[1],
        )
        return list(grid.subplots(squeeze=False).ravel())

    def say(self, words: str, under: float) -> None:
        """Words in the middle, so many inches below the top."""
        self.figure.text(0.5, 1.0 - (self.top + under) / self.figure.get_figheight(), words, ha="center", va="center", fontsize=SMALL)

    def legend(self, ax: Axes, under: float) -> None:
        """What is in a panel, so many inches below the top."""
        high = self.figure.get_figheight()
        handles, labels = ax.get_legend_handles_labels()
        self.figure.legend(
            handles,
            labels,
            loc="center",
            bbox_to_anchor=(0.5, 1.0 - (self.top + under) / high),
            ncols=4,
            frameon=False,
            fontsize=SMALL,
            handletextpad=0.4,
            columnspacing=1.4,
        )


def heading(found: Population) -> str:
    """How many subjects under which model, whether to believe it, how they answer in both orders, and where a typical subject is."""
    model = found.settings.model + (" (synthetic data)" if found.study.synthetic else "")
    mean = found.quantities(found.chains.mean.reshape(-1, len(found.names)))
    said = [f"{name} {said_interval(np.quantile(mean[name], MARKED))}" for name in main_quantities(found)[:2]]
    badge = "" if found.converged else "NOT CONVERGED, not to be reported as it stands\n"
    return f"{badge}Population of {len(found.study)} subjects: {model}\n{'; '.join([*_order_effect(found), *said])}"


def _order_effect(found: Population) -> list[str]:
    """The population's asymmetry and its direction, where it can be seen."""
    if found.asymmetries is None:
        return []
    draws = found.asymmetries.draws[:, :, 0, 0]
    return [f"asymmetry {said_interval(np.quantile(draws, MARKED))}, {direction(float((draws > 0.0).mean()))}"]


def _grid(panels: int, most: int) -> tuple[int, int]:
    """Rows, and panels across."""
    across = even_columns(panels, most)
    return -(-panels // across), across


def _forest_grid(found: Population) -> tuple[int, int]:
    return _grid(len(main_quantities(found)), _ACROSS)


def _forests_height(found: Population) -> float:
    return _KEY + _forest_grid(found)[0] * forest_height(found)


def _draw_forests(found: Population, values: Mapping[str, Marked], block: _Block) -> None:
    (rows, across), crowded = _forest_grid(found), len(found.study) > MOST_NAMED_IN_GROUP
    inner = block._replace(top=block.top + _KEY, height=block.height - _KEY)
    longest = max(len(plain(name, LONGEST)) for name in found.study.names)
    axes = inner.panels(rows, across, left=0.4 if crowded else 0.2 + 0.06 * max(longest, 4), over=0.2, under=0.5, apart=0.2)
    for i, (name, ax) in enumerate(zip_longest(main_quantities(found), axes)):
        if name is None:
            ax.remove()
            continue
        forest_axes(found, name, ax, values=values[name])
        if i % across:
            ax.tick_params(labelleft=False)
        elif crowded:
            ax.set_ylabel(f"{len(found.study):,} subjects, sorted in each panel", fontsize=LETTERS)
    block.legend(axes[0], 0.5 * _KEY)


def _draw_new(found: Population, check: PredictiveCheck | None, block: _Block) -> None:
    left, right = block.panels(1, 2, left=0.55, over=0.55, under=0.5, apart=1.4)
    new_subject_axes(found, left)
    predictive_check_axes(predictive_check(found) if check is None else check, right)


def _effects_grid(found: Population) -> tuple[int, int]:
    return _grid(len(found.names) + (found.asymmetries is not None), _ACROSS + 1)


def _effects_height(found: Population) -> float:
    return _effects_grid(found)[0] * (0.85 + 0.4 * len(found.regressors.columns))


def _draw_effects(found: Population, block: _Block) -> None:
    (rows, across), names = _effects_grid(found), (*found.names, *([] if found.asymmetries is None else [ASYMMETRY]))
    axes = block.panels(rows, across, left=1.35, over=0.3, under=0.45, apart=0.15)
    block.say("effects of covariates on the population's mean, 5, 50 and 95 %, on the scales on which subjects scatter", 0.12)
    for i, (name, ax) in enumerate(zip_longest(names, axes)):
        if name is None:
            ax.remove()
            continue
        effects_axes(found, name, ax)
        ax.tick_params(labelleft=i % across == 0)
