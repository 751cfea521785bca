"""Index of the paper's equations: from the label of each to the function that computes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from bayes_toe.model.closed_form import (
    equal_probability,
    evolved_mean,
    normalised_distance,
    variance_ratio,
)
from bayes_toe.model.geometry import axis

#: Where an equation has several parts, the function that has them all, or the first; its neighbours in the file name the same label.
EQUATIONS: Mapping[str, Callable[..., object]] = MappingProxyType(
    {
        "mod:update": evolved_mean,
        "mod:q": equal_probability,
        "mod:qdphi": normalised_distance,
        "axis1": variance_ratio,
        "axis2": axis,
    }
)
