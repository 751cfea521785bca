"""Named subjects on which inference for this model is hard.

Shared by the tests, the benchmark and the documentation.

All are made, none is anybody's data. Counts that come from a model observer are the rounded
expected counts, so a case has no seed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayes_toe.data.study import Subject
from bayes_toe.design.study_design import PAPER_AMPLITUDES, all_pairs, reference_design
from bayes_toe.model.paper_equations import equal_probability


def hard_cases() -> dict[str, Subject]:
    """The collection, by name."""
    design = reference_design()
    apart = np.abs(design.s2 - design.s1)
    one_order = _observer()
    kept = one_order.s1 <= one_order.s2
    columns = np.array([one_order.s1, one_order.s2, one_order.n_yes, one_order.n_trials])
    cases = {
        "all equal": _counts(50),
        "all different": _counts(0),
        "perfect observer": _counts(np.where(apart == 0.0, 50, 0)),
        "guessing at 0.5": _counts(25),
        "reversed answers": _counts(np.rint(50 * (0.2 + 0.7 * apart / apart.max()))),
        "funnel": _observer(mu1=-8.0, gamma=0.004),
        "maximum on gamma = 1": _observer(mu1=-0.7, gamma=0.999),
        "q0 = 1": _observer(q0=1.0),
        "very blunt observer": _observer(mu1=0.3, sigma_p=3.0, q0=0.8),
        "stimuli spanning 10 log units": _observer(
            mu1=3.0, sigma_p=2.0, amplitudes=np.exp(np.linspace(0.0, 10.0, 5))
        ),
        "stimuli offset by 100": _observer(
            mu1=99.5, amplitudes=np.multiply(PAPER_AMPLITUDES, np.exp(100.0))
        ),
        "one batch": _counts([1, 1, 0, 1, 1, 1, 1, 0, 0, 1, 0, 0, 0], n=1),
        "one order missing": Subject("case", *columns[:, kept]),
        "single pair": Subject("case", *np.array([0.0, 0.3, 20, 50])),
        "400 pairs with 3 trials": _many_pairs(),
        "a million trials a pair": _observer(n=10**6),
        "a hundred million trials": _observer(n=10**8 // 13),
    }
    return {name: replace(case, name=name) for name, case in cases.items()}


def _counts(n_equal: npt.ArrayLike, n: int = 50) -> Subject:
    design = reference_design(batches=n)
    return design.answered(np.broadcast_to(n_equal, design.n_pairs).astype(np.int64))


def _observer(
    mu1: float = -0.5,
    sigma_p: float = 0.25,
    gamma: float = 0.3,
    q0: float = 0.9,
    n: int = 50,
    amplitudes: Iterable[float] = PAPER_AMPLITUDES,
) -> Subject:
    design = reference_design(amplitudes, n)
    q = equal_probability(design.s1, design.s2, mu1, sigma_p, sigma_p * np.sqrt(gamma), q0)
    return design.answered(np.rint(q * n).astype(np.int64))


def _many_pairs() -> Subject:
    """20 x 20 pairs, 3 trials each.

    Counts are expected counts rounded by a golden-ratio sequence, so they vary without a seed.
    """
    design = all_pairs(np.linspace(0.0, 0.6, 20))
    q = equal_probability(design.s1, design.s2, -0.4, 0.25, 0.25 * np.sqrt(0.3), 0.9)
    thresholds = (np.arange(3 * len(q)) * (np.sqrt(5.0) - 1) / 2) % 1.0
    n_equal = (thresholds.reshape(-1, 3) < q[:, None]).sum(axis=1)
    return Subject("case", design.s1, design.s2, n_equal, 3 * design.n_trials)


def stored_references(file: str) -> pd.DataFrame:
    """The reference of every case of a file in tests/reference, a column a case."""
    path = Path(__file__).parents[2] / "tests" / "reference" / file
    return pd.DataFrame(json.loads(path.read_text(encoding="utf-8"))["cases"])
