"""Compare the predictive-update model (H1) with free frequencies (H0) for every subject: a table and a figure.

Example: python scripts/evidence_table.py study.csv -o evidence.csv --figure evidence.png --seed 1
Without a study the bundled (synthetic) example is compared.
"""

import argparse
import sys

import bayes_toe as bt


def main() -> int:
    """Read, compute the evidence, save the table and, where asked for, the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", nargs="?", help="CSV of trials or counts")
    parser.add_argument("-o", "--output", default="evidence.csv")
    parser.add_argument("--figure", help="PNG, PDF or SVG to draw the log Bayes factors into")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    try:
        study = bt.example_study() if options.study is None else bt.read_study(options.study)
        table = bt.evidence(study, seed=options.seed)
        table.save(options.output, overwrite=options.overwrite)
        if options.figure is not None:
            figure = bt.evidence_figure(table, synthetic=study.synthetic)
            bt.save_figure(figure, options.figure, overwrite=options.overwrite)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    print(table.frame().round(3).to_string(index=False))
    for row in table:
        for note in row.notes:
            print(f"{row.subject}: {note}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
