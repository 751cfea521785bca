"""One page of the small study for all tests."""

import pytest

import bayes_toe as bt

pytest.importorskip("bokeh")


@pytest.fixture(scope="session")
def truth():
    """The true parameters of subject A."""
    return {"mu1": -0.7, "sigma_p": 0.25, "sigma_l": 0.17, "q0": 0.92}


@pytest.fixture(scope="session")
def symmetric(small_study):
    """Draws of two subjects under a model with fewer quantities."""
    return bt.sample(small_study.select(["A", "B"]), model="none", draws=500, seed=3)


@pytest.fixture(scope="session")
def explorer(analysis, symmetric, truth):
    return bt.explore([analysis.draws, symmetric], truths={"A": truth})
