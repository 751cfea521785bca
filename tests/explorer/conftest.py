"""One page of the small study for all tests."""

import pytest

import bayes_toe as bt

pytest.importorskip("bokeh")


@pytest.fixture(scope="session")
def truth():
    """The true parameters of subject A."""
    return {"mu1": -0.7, "sigma_p": 0.25, "sigma_l": 0.17, "q0": 0.92}


@pytest.fixture(scope="session")
def draws_without_effects(small_study):
    """500 or more draws of A and B under the model without an order effect."""
    return bt.sample(small_study.select(["A", "B"]), model="none", draws=500, seed=3)


@pytest.fixture(scope="session")
def explorer(analysis, draws_without_effects, truth):
    # The page of A, B and C under the paper's model, with the four models averaged, and of A and B
    # without effects, with the true parameters of A.
    return bt.explore([analysis.draws, draws_without_effects], truths={"A": truth})
