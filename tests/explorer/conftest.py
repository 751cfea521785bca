"""One page of the small study for all tests, and the browser that opens it."""

import shutil
from dataclasses import replace

import pytest
from populations import made_population, ordinary

import bayes_toe as bt

pytest.importorskip("bokeh")

TRUTH = {"A": {"mu1": -0.7, "sigma_p": 0.25, "sigma_l": 0.17, "q0": 0.92}}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")


@pytest.fixture(scope="session")
def symmetric(small_study):
    """Draws of two subjects under a model with fewer quantities."""
    return bt.sample(small_study.select(["A", "B"]), model="symmetric", draws=500, seed=3, workers=1)


@pytest.fixture(scope="session")
def group(small_study):
    """A population in which the small study's subjects might be."""
    return replace(made_population(ordinary(3), draws=40), study=small_study)


@pytest.fixture(scope="session")
def explorer(analysis, symmetric):
    return bt.explore([analysis.draws, symmetric], truths=TRUTH)


@pytest.fixture(scope="session")
def browser():
    """Chromium, wherever it is: on the path, or Playwright's own."""
    sync_api = pytest.importorskip("playwright.sync_api")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    with sync_api.sync_playwright() as playwright:
        try:
            opened = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        except sync_api.Error as error:
            pytest.skip(f"no browser: none of {', '.join(BROWSERS)} on the path, nor Playwright's own ({str(error).splitlines()[0]})")
        yield opened
        opened.close()
