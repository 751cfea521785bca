"""What a maximum-likelihood fit gives: parameters, likelihoods and edges of one or many rows of counts in one design."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import BoolArray, FloatArray
from bayes_toe.model.closed_form import LN2

#: Where a maximum may lie beyond the open domain, in the order in which `at_edge` names them.
EDGES = ("gamma=0", "gamma=1", "q0=0", "q0=1", "sigma_p=0", "sigma_p=inf", "not unique")


@dataclass(frozen=True, eq=False)
class Fits:
    """Maximum-likelihood fits of one design to one or many count vectors.

    Attributes
    ----------
    parameters : array, shape (rows, 4)
        mu1, sigma_p, sigma_l (natural-log intensity) and q0; NaN where the data leave the parameter open ("not unique").
    log_likelihood : array, shape (rows,)
        At the maximum, without binomial coefficients and without the penalty, nats.
    objective : array, shape (rows,)
        Log likelihood minus penalty: what was maximised.
    edges : array of bool, shape (rows, len(EDGES))
        On which edges the maximum lies.
    arrived : array of bool, shape (rows,)
        False where the ascent did not meet its criterion; the row is then the best point found.
    identified : array, shape (rows, 4)
        Offset c, pull p, width w and q0, from which curves follow also where a natural parameter has no value.
    sbar : float
        Mean first stimulus, natural-log intensity; mu1 = sbar + c/p.
    """

    parameters: FloatArray
    log_likelihood: FloatArray
    objective: FloatArray
    edges: BoolArray
    arrived: BoolArray
    identified: FloatArray
    sbar: float

    def __len__(self) -> int:
        return len(self.objective)

    @property
    def at_edge(self) -> tuple[str, ...]:
        """The edges of every row as text, joined with ';', empty for a maximum inside."""
        return tuple(";".join(name for name, here in zip(EDGES, row, strict=True) if here) for row in self.edges)

    def equal_probability(self, s1: npt.ArrayLike, s2: npt.ArrayLike) -> FloatArray:
        """P(equal) of pairs by every row; s1, s2 natural-log intensities of shape (pairs,); returns (rows, pairs).

        Source: Eq. mod:q.
        """
        first, second = np.atleast_1d(np.asarray(s1, np.float64)), np.atleast_1d(np.asarray(s2, np.float64))
        c, p, w, q0 = (column[:, None] for column in self.identified.T)
        z = ((second - first) + p * (first - self.sbar) - c) / w
        return np.asarray(q0 * np.exp(-LN2 * np.square(z)))


def join(parts: Sequence[Fits]) -> Fits:
    """Fits of one design one after the other."""
    names = (field.name for field in fields(Fits) if field.name != "sbar")
    arrays: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return replace(parts[0], **arrays)
