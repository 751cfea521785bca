"""A table and a figure: the order effects of every subject, the fit, and H1 against H0.

Example: python scripts/evidence_table.py study.csv -o evidence.csv --figure evidence.png --seed 1
"""

import argparse
from pathlib import Path

import bayes_toe as bt

COLUMNS = [
    "subject",
    "order_effect",
    "constant_error",
    "contraction",
    "p_order_effect",
    "p_constant_error",
    "p_contraction",
    "log_bayes_factor",
]

if __name__ == "__main__":  # worker processes import this file
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "study",
        nargs="?",
        help="CSV of trials or counts; by default the bundled, synthetic example",
    )
    parser.add_argument("-o", "--output", type=Path, default="evidence.csv")
    parser.add_argument("--figure", type=Path, help="PNG, PDF or SVG to draw it into")
    parser.add_argument("--seed", type=int, help="without it fresh entropy, printed")
    parser.add_argument("--workers", type=int, help="processes; by default one per processor")
    asked = parser.parse_args()
    for path in filter(None, (asked.output, asked.figure)):
        if path.exists():
            parser.error(f"{path}: exists")  # before the work, not after it

    study = bt.example_study() if asked.study is None else bt.read_study(asked.study)
    table = bt.evidence(study, seed=asked.seed, workers=asked.workers)
    table.save(asked.output)
    if asked.figure:
        bt.plots.save_figure(bt.plots.order_effect(table, synthetic=study.synthetic), asked.figure)
    print(table.frame(full=True)[COLUMNS].round(3).to_string(index=False))
    for row in table:
        for note in (*row.notes, *row.footnotes):
            print(f"{row.subject}: {note}")
    print(f"{study.source}: seed {table.seed}; table in {asked.output}")
