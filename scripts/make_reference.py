"""Evidences and moments by tempering, for the tests to compare with.

By default: H1 for the bundled study and the hard cases, into reference.json. With --order: the
four models of the observer for the cases of scripts/reference/order_cases.py, into
order_models.json. A case that is stored already, for the same counts and prior, stays.

Example: python scripts/make_reference.py -o tests/reference --order
"""

import argparse
import hashlib
import json
import platform
import time
from pathlib import Path

import numpy as np
import scipy
from reference.hard_cases import hard_cases
from reference.order_cases import order_cases
from reference.paper_density import PaperScores
from reference.tempering import (
    METHOD,
    MODELS,
    Observer,
    describe_prior,
    tempered_evidence,
    tempered_points,
)

import bayes_toe as bt
from bayes_toe.arrays import FloatArray
from bayes_toe.data.whole_files import whole_file

LEVELS = (0.05, 0.5, 0.95)


def belongs(subject: bt.Subject, model: str | None) -> dict[str, str]:
    """Counts and prior of a stored case; by these a stale case is noticed."""
    counts = np.column_stack(
        (subject.s1, subject.s2, subject.n_yes.astype(float), subject.n_trials.astype(float))
    )
    return {
        "counts": hashlib.sha256(counts.tobytes()).hexdigest(),
        "prior": bt.Prior().describe() if model is None else describe_prior(),
    }


def case(subject: bt.Subject, model: str | None) -> dict[str, object]:
    """One reference as plain numbers; of the four models it is the evidence alone."""
    if model is None:
        scores = PaperScores(subject)
        points, log_weights = tempered_points(scores, 4, particles=4000, size=100_000)
        theta = np.stack(scores.natural(points.reshape(-1, 4)))
        moments = weighted_moments(theta, np.exp(log_weights.ravel() - log_weights.max()))
    else:
        observer = Observer(subject, model)
        _, log_weights = tempered_points(observer, len(observer.parameters), size=10_000)
        moments = {}
    value, error = tempered_evidence(log_weights)
    return {"method": METHOD, "log_evidence": value, "log_evidence_error": error, **moments}


def weighted_moments(theta: FloatArray, weights: FloatArray) -> dict[str, object]:
    """Means, standard deviations and quantiles of parameters, (parameters, points)."""
    means = np.average(theta, axis=1, weights=weights)
    variances = np.average(np.square(theta - means[:, None]), axis=1, weights=weights)
    quantiles = []
    for values in theta:
        order = np.argsort(values)
        cumulative = np.cumsum(weights[order]) / weights.sum()
        quantiles.append(np.interp(LEVELS, cumulative, values[order]).tolist())
    return {
        "means": means.tolist(),
        "sds": np.sqrt(variances).tolist(),
        "quantiles": quantiles,
    }


def main() -> None:
    """Compute what is missing, one case at a time; the file is whole after each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("tests/reference"))
    parser.add_argument("--order", action="store_true", help="the four models of the observer")
    options = parser.parse_args()
    cases: dict[str, tuple[bt.Subject, str | None]]
    if options.order:
        path, head = options.output / "order_models.json", {}
        cases = {
            f"{name}: {model}": (subject, model)
            for name, subject in order_cases().items()
            for model in MODELS
        }
    else:
        subjects = {
            **hard_cases(),
            **{subject.name: subject for subject in bt.example_study("same/different")},
        }
        path, head = options.output / "reference.json", {"levels": LEVELS}
        cases = {name: (subject, None) for name, subject in subjects.items()}
    head["versions"] = {
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
    }
    stored = json.loads(path.read_text(encoding="utf-8"))["cases"] if path.exists() else {}
    for name, (subject, model) in cases.items():
        key = belongs(subject, model)
        if key.items() <= stored.get(name, {}).items():
            continue
        began = time.perf_counter()
        made = stored[name] = {**key, **case(subject, model)}
        with whole_file(path, overwrite=True) as target:
            target.write_text(
                json.dumps({**head, "cases": stored}, indent=1, sort_keys=True) + "\n",
                encoding="utf-8",
            )
        took = time.perf_counter() - began
        print(
            f"{name}: {made['log_evidence']:.6f} +- {made['log_evidence_error']:.1e}, {took:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
