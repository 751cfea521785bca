"""Which order effect every subject has, whether the model describes the answers, and H1 against free frequencies (H0): a table, a figure.

Example: python scripts/evidence_table.py study.csv -o evidence.csv --figure evidence.png --seed 1
Without a study the bundled (synthetic) example is compared. All values are natural logs.
"""

import argparse
import sys
from pathlib import Path

import bayes_toe as bt
from bayes_toe.data.whole_files import require_writable
from bayes_toe.errors import OutputError
from bayes_toe.plots.figure_files import require_figure


def main() -> int:
    """Read, compute the evidence, save the table and, where asked for, the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", nargs="?", help="CSV of trials or counts")
    parser.add_argument("-o", "--output", default="evidence.csv")
    parser.add_argument("--figure", help="PNG, PDF or SVG to draw both into")
    parser.add_argument("--seed", type=int, help="without it fresh entropy, printed")
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    try:
        require_writable(options.output, overwrite=options.overwrite)  # before the work, not after it
        if options.figure is not None:
            require_figure(options.figure, overwrite=options.overwrite)
            if Path(options.figure).resolve() == Path(options.output).resolve():
                raise OutputError(f"{options.output}: --output and --figure name the same file")
        study = bt.example_study() if options.study is None else bt.read_study(options.study)
        table = bt.evidence(study, seed=options.seed, workers=options.workers)
        table.save(options.output, overwrite=options.overwrite)
        if options.figure is not None:
            figure = bt.plots.evidence_figure(table, synthetic=study.synthetic)
            bt.plots.save_figure(figure, options.figure, overwrite=options.overwrite)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    columns = ["subject", "p_none", "p_constant_error", "p_update", "predictive_p", "log_bayes_factor", "log_evidence_h1_se"]
    print(table.frame()[columns].round(3).to_string(index=False))
    for row in table:
        for note in (*row.notes, *row.footnotes):
            print(f"{row.subject}: {note}")
    drawn = "" if options.figure is None else f", figure in {options.figure}"
    print(f"{study.source}: seed {table.seed}; table in {options.output}{drawn}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
