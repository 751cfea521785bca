"""Which composition describes the subjects of real studies, and is there an order effect? One row a subject and model.

The 12 compositions of the default space, and the best of them with another curve or another spread. The predictive p-value is that of the
deviance, over draws from the proposal behind the evidence, resampled by their weights. The table is written after each subject.

Example: python scripts/order_effect_studies.py trials.csv dots.csv -o docs/order_effect_studies.csv --misfits 873,1012
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from order_effect import COMPOSITIONS, DIGITS, resampled
from order_effect_figures import misfit_figure

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_writable
from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.inference.predictive_checks import summarise_fit
from bayes_toe.model.free_frequencies import FREE_FREQUENCIES
from bayes_toe.model.parts import compose
from bayes_toe.model.posterior import Model
from bayes_toe.plots.figure_files import save_figure
from bayes_toe.seeds import generator

#: What else is tried on the best of the 12.
MORE = ({"curve": "exponent"}, {"curve": "differencing"}, {"spread": "beta-binomial"})
RESAMPLED = 4000


def main() -> int:
    """Analyse every subject of the files; write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("studies", nargs="+", help="CSV files")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--misfits", help="subjects whose answers are drawn beside the best composition, separated by commas")
    parser.add_argument("--overwrite", action="store_true")
    parser.add_argument("--resume", action="store_true", help="subjects that are in the table are kept")
    options = parser.parse_args()
    try:
        picture = options.output.with_name("order_effect_misfits.png")
        require_writable(options.output, overwrite=options.overwrite or options.resume)
        if options.misfits:
            require_writable(picture, overwrite=options.overwrite or options.resume)
        subjects = [subject for path in options.studies for subject in bt.read_study(path)]
        there = options.resume and options.output.exists()
        rows = pd.read_csv(options.output, dtype={"subject": str}).to_dict("records") if there else []
        for subject in subjects:
            if subject.name not in {row["subject"] for row in rows}:
                rows += (found := analysed(subject, options.seed))
                write_table(pd.DataFrame(rows).round(DIGITS), options.output, overwrite=True)
                print(summary(found), flush=True)
        if options.misfits:
            drawn = [subject for name in options.misfits.split(",") for subject in subjects if subject.name == name]
            save_figure(misfit_figure(drawn, pd.DataFrame(rows)), picture, overwrite=True)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def analysed(subject: bt.Subject, seed: int) -> list[dict[str, object]]:
    """The rows of one subject, best of the 12 first."""
    free = FREE_FREQUENCIES.posterior(subject, bt.Prior()).log_evidence
    rows = sorted((row(subject, model, free, seed) for model in COMPOSITIONS), key=lambda found: (np.isnan(found["lead"]), -found["lead"]))
    best = next(model for model in COMPOSITIONS if model.name == rows[0]["model"])
    return rows + [row(subject, compose(**{**dict(best.levels), **levels}), free, seed) for levels in MORE]


def row(subject: bt.Subject, model: Model, free: float, seed: int) -> dict[str, object]:
    """Lead over free frequencies in nats, and goodness of fit, of one model."""
    posterior, rng = model.posterior(subject), generator(seed, subject.name, model.name, "study")
    fitted = fit_proposal(posterior, rng)
    evidence = importance_evidence(fitted)
    x = resampled(fitted, rng, RESAMPLED)
    fit = summarise_fit(posterior, x, seed, most=RESAMPLED)
    medians = {name: float(np.median(values)) for name, values in posterior.quantities(x).items()}
    return {
        "subject": subject.name,
        "model": model.name,
        **{part: level for part, level in model.levels},
        "lead": np.nan if evidence.value is None else evidence.value - free,
        "lead_se": evidence.se,
        "predictive_p": fit.p_overall,
        "deviance": fit.deviance,
        "degrees_of_freedom": fit.degrees_of_freedom,
        **{
            f"median: {name}": medians.get(name)
            for name in ("offset", "gain", "width", "q0", "noise_slope", "lapse_rate", "exponent", "icc")
        },
    }


def summary(rows: list[dict[str, object]]) -> str:
    """The best of the 12 in a line."""
    best = rows[0]
    return f"{best['subject']}: {best['model']}, lead {best['lead']:+.1f}, predictive p {best['predictive_p']:.3f}"


if __name__ == "__main__":
    sys.exit(main())
