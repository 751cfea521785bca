"""The simulated observers of docs/order_effect.md: evidences by two routes, a run that goes on, and the figures of the table."""

from pathlib import Path
from shutil import copy

import numpy as np
import order_effect as story
import pandas as pd
import pytest
from matplotlib.image import imread
from order_effect_figures import SPACES, confusion, draw, groups, log_odds

import bayes_toe as bt
from bayes_toe.inference.subject import Wanted, infer
from bayes_toe.model.parts import compose

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def some():
    return story.observers("sparse", 4, seed=3)


def test_each_model_of_the_space_has_as_many_observers(some):
    assert [row["model"] for row in some.rows] == [
        compose(order=kind, noise=noise, lapses=lapses).name for kind in story.KINDS for noise, lapses in story.CELLS
    ]
    assert {row["model"] for row in some.rows} == {model.name for model in story.COMPOSITIONS}


def test_two_routes_to_an_evidence_agree(some, monkeypatch):
    """False alarm 1e-4 for each of 4 observers, each with the errors of both routes."""
    monkeypatch.setattr(story, "FEW", 0)
    monkeypatch.setattr(story, "MOST", 200_000)
    model = compose(order="constant error", lapses="both ways")
    value, effective = story.by_prior_draws(model, some, np.random.default_rng(1))
    for i in (1, 4, 7, 10):
        own = infer(model.posterior(some.subjects[i], some.prior), 1, Wanted(evidence_draws=4000)).evidence
        assert abs(value[i] - own.value) < 3.9 * np.hypot(own.se, effective[i] ** -0.5)


def test_a_run_goes_on_with_more_observers_but_not_with_others(some, tmp_path):
    found = pd.DataFrame(some.rows).assign(**{"se: symmetric": 0.01, "fitted": 1})
    found.to_csv(tmp_path / "table.csv", index=False)
    more = story.stored(tmp_path / "table.csv", pd.DataFrame(story.observers("sparse", 5, seed=3).rows))
    assert list(more.columns) == list(found.columns)
    assert more["se: symmetric"].isna().tolist() == 3 * [*4 * [False], True]
    assert more["fitted"].tolist() == 3 * [1, 1, 1, 1, 0]
    for others in (story.observers("sparse", 4, seed=4), story.observers("sparse", 3, seed=3)):
        with pytest.raises(bt.InputError, match="other observers"):
            story.stored(tmp_path / "table.csv", pd.DataFrame(others.rows))


def test_the_committed_table_adds_up_and_is_drawn(tmp_path, capsys):
    frame = pd.read_csv(DOCS / story.TABLE)
    for ending, space in (("", "12 compositions"), ("_plain", "three plain models")):
        kinds = [f"p_{kind.replace(' ', '_')}{ending}" for kind in story.KINDS]
        assert frame[kinds].sum(axis=1).to_numpy() == pytest.approx(1.0, abs=1e-4)
        odds = log_odds(frame, space, "update")
        assert 1.0 / (1.0 + np.exp(-odds)) == pytest.approx(frame[kinds[2]].to_numpy(), abs=1e-4)
    assert sum(confusion(part, "12 compositions").sum() for part in groups(frame).values()) == len(frame)
    assert list(SPACES) == ["12 compositions", "three plain models"]
    for name in (story.TABLE, "order_effect_studies.csv"):
        copy(DOCS / name, tmp_path / name)
    draw(tmp_path, overwrite=False)
    assert "| paper | 12 compositions |" in capsys.readouterr().out
    for picture in ("confusion", "reliability", "studies"):
        shown = imread(tmp_path / f"order_effect_{picture}.png")[..., :3]
        assert shown.min() < 0.5 < shown.max()
    with pytest.raises(bt.OutputError, match="exists"):
        draw(tmp_path, overwrite=False)
