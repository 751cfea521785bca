"""Make the picture that opens the README, from the bundled (synthetic) study.

Example: python scripts/overview_figure.py -o docs/overview.png
"""

import argparse

from matplotlib.figure import Figure

import bayes_toe as bt
from bayes_toe.data.whole_files import whole_file
from bayes_toe.plots.curves import fitted_curve, order_panel
from bayes_toe.plots.evidence import order_effect_axes


def main() -> None:
    """Three subjects of the paper's three kinds, and the order effect of all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", default="docs/overview.png")
    output = parser.parse_args().output
    study = bt.example_study()
    analysis = bt.run(study, seed=1)
    figure = Figure(figsize=(11.0, 5.2), layout="constrained")
    figure.get_layout_engine().set(
        w_pad=0.1, h_pad=0.06
    )  # the last axis label ends at the edge otherwise
    grid = figure.add_gridspec(2, 3, width_ratios=(1, 1, 1.15))
    kinds = {"S06": "prior below the stimuli", "S04": "prior above them", "S13": "prior among them"}
    places = (grid[0, 0], grid[0, 1], grid[1, 0])
    for (name, kind), place in zip(kinds.items(), places, strict=True):
        ax = figure.add_subplot(place)
        order_panel(ax, study[name], fitted_curve(analysis.draws, name), weaker=0.0)
        ax.set(title=f"{name}: {kind}", ylabel="P('equal')", ylim=(-0.03, 1.03))
        ax.title.set_fontsize(10)
    key = figure.add_subplot(grid[1, 1])
    key.axis("off")
    key.legend(*ax.get_legend_handles_labels(), loc="center", frameon=False, fontsize=10)
    key.set_title(
        "points: answers; lines: posterior mean;\nbands: central 60 and 95 %", fontsize=9, y=0.78
    )
    last = order_effect_axes(analysis.evidence, figure.add_subplot(grid[:, 2]))
    last.set_title("order effect of every subject", fontsize=10)
    last.set_xlim(0.0, 1.0)
    last.legend(
        loc="upper center",
        bbox_to_anchor=(0.47, -0.1),
        ncols=3,
        frameon=False,
        fontsize=9,
        handlelength=1.2,
        columnspacing=1.2,
    )
    figure.suptitle(
        "Time-order effects in same/different judgements (synthetic example study)", fontsize=12
    )
    with whole_file(output, overwrite=True) as path:
        figure.savefig(path, dpi=130)


if __name__ == "__main__":
    main()
