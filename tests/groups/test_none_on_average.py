"""A small study of every kind ends in the right words: of its population, none, an effect of either kind, or opposite ones."""

import numpy as np
import pytest
from populations import made_population

from bayes_toe.cli.population import answer
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER

#: Constant error, probit(gain/2), log width and probit of q0 or of the lapse rate at the mean, and sds between subjects.
TYPICAL = {SAME_DIFFERENT: np.array([0.0, 0.0, -1.2, 1.4]), WHICH_STRONGER: np.array([0.0, 0.0, -1.2, -1.8])}
SPREAD = np.array([0.01, 0.01, 0.1, 0.2])
#: What is added to the means, and to the sds.
KINDS = {
    "none": (0.0, 0.0, "none on average (P of none ", False),
    "constant error": (np.eye(4)[0] * 0.15, 0.0, "one on average: a constant error", True),
    "pull": (-np.eye(4)[1] * 0.25, 0.0, "one on average: a pull", True),
    "opposite": (0.0, np.eye(4)[0] * 0.25, "on average, but subjects differ, with effects of either sign", False),
}


@pytest.mark.parametrize("task", TYPICAL, ids=lambda task: task.count)
@pytest.mark.parametrize("kind", KINDS)
def test_the_first_line_says_it(kind, task):
    """Means known as well as sixteen subjects tell them; those of both signs come in pairs."""
    mean, sd, said, directed = KINDS[kind]
    score = np.random.default_rng(4).standard_normal((8, 4))
    eta = TYPICAL[task] + mean + (SPREAD + sd) * np.concatenate([score, -score])
    found = made_population(eta, model="free weighting", task=task)
    first, *rest = answer(found)
    assert said in first
    assert bool(rest) == directed
    assert "Bayes factor of none" in first
    assert "16 subjects, the model " in first
    answer_of = {SAME_DIFFERENT: "'equal' is likelier", WHICH_STRONGER: "wrong answers are likelier"}
    assert all(answer_of[task] in line for line in rest)
