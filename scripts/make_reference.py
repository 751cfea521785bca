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

#: Order, noise and lapses of the space over which verdicts average, and every other level in some composition.
COMPOSITIONS = (
    *(
        model.name
        for model in SPACE
        if {("curve", "bell"), ("peak", "one peak")} <= {*model.levels}
    ),
    "constant error + sloped peak",
    "update + sloped + both ways + differencing + sloped peak",
    "none + exponent",
    "constant error + differencing + both ways",
    "free weighting + sloped + beta-binomial",
    "update + sloped + both ways + exponent + beta-binomial",
)
#: Subjects of these: two of the bundled study and two hard cases.
COMPOSED_SUBJECTS = ("S01", "S09", "one order missing", "guessing at 0.5")


def belongs(subject: bt.Subject, model: str | None) -> dict[str, str]:
    """What tells that a stored case is of these counts, this prior and the method as it is."""
    counts = np.column_stack(
        (subject.s1, subject.s2, subject.n_yes.astype(float), subject.n_trials.astype(float))
    )
    prior = bt.Prior().describe() if model is None else model_named(model).describe(PRIOR)
    return {
        "counts": hashlib.sha256(counts.tobytes()).hexdigest(),
        "prior": prior,
        "method": METHOD if model is None else TEMPERING,
    }


def case(subject: bt.Subject, model: str | None) -> dict[str, object]:
    """One subject's reference as plain numbers; the evidence alone of a composition."""
    if model is not None:
        return dict(
            zip(
                ("log_evidence", "log_evidence_error"),
                composed_evidence(subject, model),
                strict=True,
            )
        )
    found = vars(integrate(bt.model.posterior_of(subject, bt.Prior())))
    return {
        key: value.tolist() if isinstance(value, np.ndarray) else value
        for key, value in found.items()
    }


def main() -> None:
    """Integrate what is missing, one case at a time; the file is whole after each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("tests/reference"))
    parser.add_argument(
        "--compositions",
        action="store_true",
        help="compositions of parts, by tempering, into compositions.json",
    )
    parser.add_argument("--only", help="one case by name")
    asked = parser.parse_args()
    subjects = {**hard_cases(), **{subject.name: subject for subject in bt.example_study()}}
    if asked.compositions:
        path, head = asked.output / "compositions.json", {}
        cases = {
            f"{name}: {model}": (subjects[name], model)
            for name in COMPOSED_SUBJECTS
            for model in COMPOSITIONS
        }
    else:
        path, head = asked.output / "reference.json", {"quantities": QUANTITIES, "levels": LEVELS}
        cases = {name: (subject, None) for name, subject in subjects.items()}
    head["versions"] = {
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
    }
    stored = json.loads(path.read_text(encoding="utf-8"))["cases"] if path.exists() else {}
    for name, of in cases.items():
        if asked.only not in (None, name) or belongs(*of).items() <= stored.get(name, {}).items():
            continue
        began = time.perf_counter()
        made = stored[name] = {**belongs(*of), **case(*of)}
        with whole_file(path, overwrite=True) as target:
            target.write_text(
                json.dumps({**head, "cases": stored}, indent=1, sort_keys=True) + "\n",
                encoding="utf-8",
            )
        took = time.perf_counter() - began
        print(
            f"{name}: {made['log_evidence']:.6f} +- {made['log_evidence_error']:.1e}, {took:.0f} s"
        )


if __name__ == "__main__":
    main()
