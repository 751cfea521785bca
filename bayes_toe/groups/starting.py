"""Where chains of a group start, and on which scales: about the population that the members' answers suggest, roughly."""

from __future__ import annotations

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.groups.joint import Joint
from bayes_toe.groups.told import moments

_APART = 2.0  # how many times farther apart than the posterior would have them


def starts(joint: Joint, chains: int, rng: np.random.Generator) -> FloatArray:
    """Points, what is shared wider apart than the posterior has it, shape (chains, D)."""
    theta, k = rng.standard_normal((chains, joint.dimension)) * scales(joint), joint.told.place.shape[1]
    theta[:, : joint.size] *= _APART
    theta[:, k : 2 * k] += np.log(moments(joint.plainly, joint.hyperprior)[1])
    return theta


def scales(joint: Joint) -> FloatArray:
    """About the standard deviation of every coordinate, shape (D,): of what tells of scatters it goes with the number of members."""
    found, (n, k) = np.ones(joint.dimension), joint.told.place.shape
    found[k : 2 * k] = (2.0 * n) ** -0.5
    found[k * (2 + joint.x.shape[1]) : joint.size] = n**-0.5
    return found
