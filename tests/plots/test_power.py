"""Figures of planned studies: what is drawn is what was counted."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.planning.judging import Judgement
from bayes_toe.planning.optimal import OPTIMISED, PAPER, Candidate, DesignGoal, OptimalDesign
from bayes_toe.planning.power import FOUND, DataSet, PowerTable
from bayes_toe.planning.study_design import each_once, paper_study_design


def made_up(designs, trials):
    rng, rows = np.random.default_rng(0), []
    for name in designs:
        for n in trials:
            for kind in ("none", "constant error", "update"):
                for i in range(5):
                    p = rng.dirichlet([1.0, 1.0, 1.0])
                    rows.append(
                        DataSet(
                            name,
                            n,
                            f"{kind} {i}",
                            kind,
                            Judgement(tuple(np.log(p)), None, (0.1, 1.0, 0.05)),
                        )
                    )
    return PowerTable(tuple(rows), 1)


@pytest.fixture(scope="module")
def table():
    return made_up(("a$b", "two"), (100, 400))


def test_a_panel_a_kind_and_a_quantity_with_the_shares_as_lines(table):
    figure = bt.plots.power_figure(table)
    assert [ax.get_title() for ax in figure.axes[:3]] == [
        "observers without order effect",
        "with a constant error",
        "with a pull",
    ]
    assert [ax.get_ylabel() for ax in figure.axes[3:]] == [
        f"90 % interval of {name}" for name in ("gain", "mu1", "width")
    ]
    lines = [bars.lines[0] for bars in figure.axes[2].containers]
    assert lines[0].get_ydata().tolist() == [
        table["a$b", n, "update", FOUND].value for n in (100, 400)
    ]
    assert len(lines) == 4


def test_many_designs_are_told_apart_and_stand_at_their_numbers():
    ax = bt.plots.power_figure(made_up([f"design {i}" for i in range(8)], (300, 325, 350))).axes[2]
    lines = [one.lines[0] for one in ax.containers]
    assert len({(one.get_color(), one.get_marker(), one.get_linestyle()) for one in lines}) == 16
    at = np.array([one.get_xdata() for one in lines])
    assert (np.abs(np.log(at[:, :, None] / [300, 325, 350])).argmin(axis=2) == [0, 1, 2]).all()
    assert ax.get_xlim()[0] < at.min() < at.max() < ax.get_xlim()[1]
    assert (np.diff(at, axis=0) > 0.0).all()


def test_a_design_on_the_plane():
    paper, grid = paper_study_design(), np.linspace(0.0, 0.6, 4)
    s1, s2 = (values.ravel() for values in np.meshgrid(grid, grid, indexing="ij"))
    worth = np.arange(16.0)
    candidates = {OPTIMISED: Candidate(paper, 1.0, 0.1), PAPER: Candidate(paper, 1.0, 0.1)}
    found = OptimalDesign(
        paper,
        DesignGoal(),
        candidates,
        made_up((OPTIMISED, PAPER), (650,)),
        each_once(s1, s2),
        worth,
        (),
        1,
    )
    figure = bt.plots.design_figure(found)
    plane = figure.axes[0]
    assert (
        plane.collections[0].get_array().ravel().tolist()
        == (1000.0 * worth.reshape(4, 4).T).ravel().tolist()
    )
    assert len(plane.collections[1].get_offsets()) == 13
    assert [label.get_text() for label in figure.axes[1].get_yticklabels()] == [
        "this design",
        "the paper's pairs",
    ]
