"""Draw the figure of README and tutorial, from the bundled (synthetic) example.

Example: python scripts/overview_figure.py -o docs/overview.png
"""

import argparse

from matplotlib.figure import Figure

import bayes_toe as bt
from bayes_toe.data.whole_files import whole_file
from bayes_toe.plots.curves import order_panel
from bayes_toe.plots.order_effect import draw_answers
from bayes_toe.plots.style import LETTERS, dress, legend_below


def main() -> None:
    """Curves of three subjects, and the answers of all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", default="docs/overview.png")
    output = parser.parse_args().output
    analysis = bt.run(bt.example_study(), seed=1)
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    grid = figure.add_gridspec(3, 4)
    shown = {
        "S02": "constant error, {pse_shift_percent.q50:+.0f} %",
        "S03": "contraction, p = {contraction_p.q50:.2f}",
        "S09": "repulsion, p = {contraction_p.q50:.2f}",
    }
    answers = {answer.subject: answer for answer in analysis.answers}
    for i, (name, effect) in enumerate(shown.items()):
        ax = figure.add_subplot(grid[i, 0])
        order_panel(ax, analysis.study[name], analysis.curve(name).yes, weaker=0.0, size=4.0)
        title = f"{name}: {effect.format(**answers[name].sizes)}"
        ax.set_title(title, loc="left", fontsize=LETTERS)
        ax.set(ylabel="P('second')", xlabel="$s_2 - s_1$ (ln intensity)" if i == 2 else "")
        dress(ax)
    draw_answers(analysis.evidence, [figure.add_subplot(grid[:, i]) for i in (1, 2, 3)])
    legend_below(figure, size=LETTERS, columns=4)
    figure.suptitle("Which was stronger? Synthetic example study", fontsize=10)
    with whole_file(output, overwrite=True) as path:
        figure.savefig(path, dpi=130)


if __name__ == "__main__":
    main()
