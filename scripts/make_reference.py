"""Evidences and moments by tempering, for the tests to compare with.

By default: H1 for the bundled study and the hard cases, into reference.json. With --order: the
four models of the observer for the cases of scripts/reference/order_cases.py, into
order_models.json. A case that is stored there already, for the same counts and prior, stays.

Example: python scripts/make_reference.py -o tests/reference --order
"""

import hashlib
import json
from itertools import product
from pathlib import Path

import numpy as np
from reference.hard_cases import hard_cases
from reference.order_cases import order_cases
from reference.pages import number_parser
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
from bayes_toe.libraries import library_versions

LEVELS = (0.05, 0.5, 0.95)


def belongs(subject: bt.Subject, model: str | None) -> dict[str, str]:
    """Counts and prior of a stored case; by these a stale case is noticed."""
    counts = np.column_stack([subject.s1, subject.s2, subject.n_yes, subject.n_trials])
    return {
        "counts": hashlib.sha256(counts.tobytes()).hexdigest(),
        "prior": bt.Prior().describe() if model is None else describe_prior(),
    }


def case(subject: bt.Subject, model: str | None) -> dict[str, object]:
    """One reference as plain numbers; of the four models it is the evidence alone."""
    moments = {}
    if model is None:
        scores = PaperScores(subject)
        points, log_weights = tempered_points(scores, 4, particles=4000, size=100_000)
        theta = np.stack(scores.natural(points.reshape(-1, 4)))
        options = {"axis": 1, "weights": np.exp(log_weights.ravel() - log_weights.max())}
        means = np.average(theta, **options)
        variances = np.average(np.square(theta - means[:, None]), **options)
        quantiles = np.quantile(theta, LEVELS, method="inverted_cdf", **options)
        moments = {"means": means, "sds": np.sqrt(variances), "quantiles": quantiles.T}
    else:
        observer = Observer(subject, model)
        _, log_weights = tempered_points(observer, len(observer.parameters), size=10_000)
    value, error = tempered_evidence(log_weights)
    numbers = {name: values.tolist() for name, values in moments.items()}
    return {"method": METHOD, "log_evidence": value, "log_evidence_error": error, **numbers}


def main() -> None:
    """Compute what is missing, one case at a time."""
    parser = number_parser(__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("tests/reference"))
    parser.add_argument("--order", action="store_true", help="the four models of the observer")
    options = parser.parse_args()
    path = options.output / "reference.json"
    subjects = [*hard_cases().values(), *bt.example_study("same/different")]
    cases = {subject.name: (subject, None) for subject in subjects}
    if options.order:
        path = options.output / "order_models.json"
        pairs = product(order_cases().values(), MODELS)
        cases = {f"{subject.name}: {model}": (subject, model) for subject, model in pairs}

    stored = json.loads(path.read_text(encoding="utf-8"))
    for name, (subject, model) in cases.items():
        key = belongs(subject, model)
        if key.items() <= stored["cases"].get(name, {}).items():
            continue
        new_case = stored["cases"][name] = {**key, **case(subject, model)}
        stored["versions"] = library_versions()
        path.write_text(json.dumps(stored, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        print(name, new_case["log_evidence"], "+-", new_case["log_evidence_error"], flush=True)


if __name__ == "__main__":
    main()
