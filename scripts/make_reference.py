"""Evidence and moments of the bundled study and the hard cases by deterministic integration, for the tests to compare with.

With --compositions: evidences of :data:`COMPOSITIONS` of a few subjects by tempering instead.
A case that is stored already, for the same counts, prior and method, is kept.

Example: python scripts/make_reference.py -o tests/reference
"""

import argparse
import hashlib
import json
import platform
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import scipy
from reference.hard_cases import hard_cases
from reference.lattice_quantiles import LEVELS
from reference.quadrature import METHOD, QUANTITIES, integrate
from reference.tempering import METHOD as TEMPERING
from reference.tempering import PRIOR, composed_evidence

import bayes_toe as bt
from bayes_toe.data.whole_files import whole_file
from bayes_toe.model.ladder import SPACE, model_named

#: Order, noise and lapses of the default space of `compare`, and every other level in some composition.
COMPOSITIONS = (
    *(model.name for model in SPACE if {("curve", "bell"), ("peak", "one peak")} <= {*model.levels}),
    "constant error + sloped peak",
    "update + sloped + both ways + differencing + sloped peak",
    "none + exponent",
    "constant error + differencing + both ways",
    "free weighting + sloped + beta-binomial",
    "update + sloped + both ways + exponent + beta-binomial",
)
#: Subjects of these: two of the bundled study and two hard cases.
COMPOSED_SUBJECTS = ("S01", "S09", "one order missing", "guessing at 0.5")


def fingerprint(subject: bt.Subject) -> str:
    """What tells that a stored case belongs to these counts."""
    columns = (subject.s1, subject.s2, subject.n_yes.astype(float), subject.n_trials.astype(float))
    return hashlib.sha256(np.column_stack(columns).tobytes()).hexdigest()


def case(subject: bt.Subject) -> dict[str, object]:
    """One subject's reference as plain numbers."""
    found = integrate(bt.model.posterior_of(subject, bt.Prior()))
    arrays = ("means", "means_error", "sds", "sds_error", "quantiles", "quantiles_error")
    return {
        "counts": fingerprint(subject),
        "prior": bt.Prior().describe(),
        "method": METHOD,
        "log_evidence": found.log_evidence,
        "log_evidence_error": found.log_evidence_error,
        "evaluations": found.evaluations,
        **{key: getattr(found, key).tolist() for key in arrays},
    }


def composed_case(subject: bt.Subject, name: str) -> dict[str, object]:
    """Evidence of one subject under a composition."""
    value, error = composed_evidence(subject, name)
    prior = model_named(name).describe(PRIOR)
    return {"counts": fingerprint(subject), "prior": prior, "method": TEMPERING, "log_evidence": value, "log_evidence_error": error}


def tasks(compositions: bool) -> Iterator[tuple[str, tuple[str, str, str], Callable[[], dict[str, object]]]]:
    """Name, what must not have changed, and the way to a case."""
    subjects = {**hard_cases(), **{subject.name: subject for subject in bt.example_study()}}
    if compositions:
        for subject in map(subjects.__getitem__, COMPOSED_SUBJECTS):
            for model in COMPOSITIONS:
                prior = model_named(model).describe(PRIOR)
                yield f"{subject.name}: {model}", (fingerprint(subject), prior, TEMPERING), partial(composed_case, subject, model)
        return
    for name, subject in subjects.items():
        yield name, (fingerprint(subject), bt.Prior().describe(), METHOD), partial(case, subject)


def main() -> None:
    """Integrate what is missing, one case at a time; the file is whole after each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("tests/reference"))
    parser.add_argument("--compositions", action="store_true", help="compositions of parts, by tempering, into compositions.json")
    parser.add_argument("--only", help="one case by name")
    options = parser.parse_args()
    path = options.output / ("compositions.json" if options.compositions else "reference.json")
    head = {} if options.compositions else {"quantities": QUANTITIES, "levels": LEVELS}
    stored = json.loads(path.read_text(encoding="utf-8"))["cases"] if path.exists() else {}
    for name, key, made in tasks(options.compositions):
        old = stored.get(name, {})
        if options.only not in (None, name) or key == (old.get("counts"), old.get("prior"), old.get("method")):
            continue
        began = time.perf_counter()
        stored[name] = made()
        versions = {"numpy": np.__version__, "scipy": scipy.__version__, "python": platform.python_version()}
        text = json.dumps({**head, "versions": versions, "cases": stored}, indent=1, sort_keys=True)
        with whole_file(path, overwrite=True) as target:
            target.write_text(text + "\n", encoding="utf-8")
        print(
            f"{name}: {stored[name]['log_evidence']:.6f} +- {stored[name]['log_evidence_error']:.1e}, {time.perf_counter() - began:.0f} s"
        )


if __name__ == "__main__":
    main()
