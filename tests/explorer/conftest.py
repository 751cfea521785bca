"""One page of the small study for all tests."""

from dataclasses import replace

import pytest
from populations import made_population, ordinary

import bayes_toe as bt

pytest.importorskip("bokeh")

TRUTH = {"A": {"mu1": -0.7, "sigma_p": 0.25, "sigma_l": 0.17, "q0": 0.92}}


@pytest.fixture(scope="session")
def symmetric(small_study):
    """Draws of two subjects under a model with fewer quantities."""
    return bt.sample(small_study.select(["A", "B"]), model="none", draws=500, seed=3, workers=1)


@pytest.fixture(scope="session")
def group(small_study):
    """A population in which the small study's subjects might be."""
    return replace(made_population(ordinary(3), draws=40), study=small_study)


@pytest.fixture(scope="session")
def explorer(analysis, symmetric):
    return bt.explore([analysis.draws, symmetric], truths=TRUTH)
