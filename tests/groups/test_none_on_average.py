"""A small study of every kind ends in the right words: of its population, none, an effect of either kind, or opposite ones."""

import numpy as np
import pytest
from populations import made_population

from bayes_toe.cli.population import answer

#: Constant error, probit(gain/2), log width and probit q0 at the mean, and sds between subjects.
TYPICAL, SPREAD = np.array([0.0, 0.0, -1.2, 1.4]), np.array([0.01, 0.01, 0.1, 0.2])
KINDS = {
    "none": (TYPICAL, SPREAD, "none on average (P of none ", False),
    "constant error": (TYPICAL + np.eye(4)[0] * 0.15, SPREAD, "one on average: a constant error", True),
    "pull": (TYPICAL - np.eye(4)[1] * 0.25, SPREAD, "one on average: a pull", True),
    "opposite": (TYPICAL, SPREAD + np.eye(4)[0] * 0.25, "on average, but subjects differ, with effects of either sign", False),
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_first_line_says_it(kind):
    """Means known as well as sixteen subjects tell them; those of both signs come in pairs."""
    mean, sd, said, directed = KINDS[kind]
    score = np.random.default_rng(4).standard_normal((8, 4))
    found = made_population(mean + sd * np.concatenate([score, -score]), model="free weighting")
    first, *rest = answer(found)
    assert said in first
    assert bool(rest) == directed
    assert "Bayes factor of none" in first
    assert "16 subjects, the model " in first
