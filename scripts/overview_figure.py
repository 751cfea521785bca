"""Make the figure that opens the README, from the bundled (synthetic) study.

Example: python scripts/overview_figure.py -o docs/overview.png
"""

import argparse

import bayes_toe as bt


def main() -> None:
    """Sizes of every subject, and of the group."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", default="docs/overview.png")
    output = parser.parse_args().output
    analysis = bt.run(bt.example_study(), seed=1)
    figure = bt.plots.order_effect(analysis.evidence, analysis.group, synthetic=True)
    bt.plots.save_figure(figure, output, overwrite=True, dpi=150)


if __name__ == "__main__":
    main()
