"""The subjects that are raced over, each with its deterministic reference."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from reference.hard_cases import hard_cases

import bayes_toe as bt
from bayes_toe.arrays import FloatArray
from bayes_toe.errors import InputError
from bayes_toe.model.coordinates import NATURAL

REFERENCE = Path(__file__).resolve().parents[2] / "tests" / "reference" / "reference.json"
ORDINARY, HARD = "ordinary", "hard"
LEVELS = (0.05, 0.5, 0.95)


@dataclass(frozen=True, eq=False)
class Reference:
    """Deterministic results: means and sds (4,), quantiles (4, 3) of the natural parameters; log evidence in nats."""

    means: FloatArray
    sds: FloatArray
    quantiles: FloatArray
    log_evidence: float


@dataclass(frozen=True, eq=False)
class Case:
    """One subject, whether it is ordinary or hard, and what is known about its posterior."""

    kind: str
    posterior: bt.Posterior
    reference: Reference

    @property
    def name(self) -> str:
        """The subject's name."""
        return self.posterior.subject.name


def chosen_cases(ordinary: Sequence[str], hard: Sequence[str] | None) -> tuple[list[Case], list[str]]:
    """Cases by name (all hard ones where hard is None), and the names of hard ones that have no stored reference yet.

    Raises
    ------
    InputError
        If a name is unknown, or an ordinary subject has no reference.
    """
    stored = json.loads(REFERENCE.read_text(encoding="utf-8"))
    if (tuple(stored["quantities"][:4]), tuple(stored["levels"])) != (NATURAL, LEVELS):
        raise InputError(f"{REFERENCE.name}: other quantities or levels than this program knows; make the file again")
    study, collection = bt.example_study(), hard_cases()
    names = list(collection) if hard is None else list(hard)
    unknown = [name for name in names if name not in collection]
    if unknown:
        raise InputError(f"no hard case {unknown[0]!r}; there are: {', '.join(collection)}")
    subjects = [(ORDINARY, study[name]) for name in ordinary] + [(HARD, collection[name]) for name in names]
    ready = [(kind, subject) for kind, subject in subjects if subject.name in stored["cases"]]
    missing = [subject.name for kind, subject in subjects if subject.name not in stored["cases"]]
    return [Case(kind, bt.posterior_of(subject), _reference(stored["cases"][subject.name], subject)) for kind, subject in ready], missing


def _reference(case: dict[str, object], subject: bt.Subject) -> Reference:
    from make_reference import fingerprint

    if (case["counts"], case["prior"]) != (fingerprint(subject), bt.Prior().describe()):
        raise InputError(f"subject {subject.name!r}: its stored reference is of other counts or another prior; make it again")
    means, sds, quantiles = (np.asarray(case[key], np.float64)[:4] for key in ("means", "sds", "quantiles"))
    return Reference(means, sds, quantiles, float(str(case["log_evidence"])))
