"""What one run of one method returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray

#: Whether a method calls its own result good, and what it says.
Verdict = Callable[[], tuple[bool, str]]

CHAINS, WEIGHTED, APPROXIMATION = "chains", "weighted", "approximation"


class DoesNotExistError(Exception):
    """The method has no result for this subject, and says so; not a defect."""


def _content() -> tuple[bool, str]:
    return True, ""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Draws in natural coordinates and what the method claims about them.

    Attributes
    ----------
    kind : str
        CHAINS: draws of independent chains, one ESS each; WEIGHTED: draws with weights; APPROXIMATION: draws of an approximate density.
    draws : array, shape (chains, draws, 4)
        mu1, sigma_p, sigma_l, q0.
    log_weights : array, shape (draws,), optional
        Of the only chain, where kind is WEIGHTED.
    evaluations, sampling_evaluations : int, optional
        Points at which the likelihood (or its gradient) was computed, in all and after fitting.
    verdict : callable
        Asked after the clock has stopped.
    """

    kind: str
    draws: FloatArray
    log_weights: FloatArray | None = None
    evaluations: int | None = None
    sampling_evaluations: int | None = None
    divergences: int | None = None
    log_evidence: float | None = None
    log_evidence_se: float | None = None
    verdict: Verdict = _content


def natural_draws(*columns: npt.ArrayLike) -> FloatArray:
    """mu1, sigma_p, sigma_l, q0, each of shape (chains, draws) or (draws,), as one array (chains, draws, 4)."""
    stacked = np.stack([np.atleast_2d(np.asarray(column, np.float64)) for column in columns], axis=-1)
    return np.asarray(stacked, np.float64)
