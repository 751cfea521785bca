"""Averages over models: weights, exact zeros, mixtures of answers, what is withheld; and the figure."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.comparison.average import AVERAGED, Average, Averages, mixed
from bayes_toe.inference.prediction import Predictor
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import Wanted, infer
from bayes_toe.model.ladder import posterior_of, require_models

MODELS = ("symmetric", "constant error + sloped", "predictive update", "free weighting")
DRAWS = 800


@pytest.fixture(scope="module")
def drawn(small_study):
    """Draws of one subject under four models, with evidences that give them probabilities of 0.4, 0.3, 0.2 and 0.1."""
    targets = [posterior_of(small_study["A"], model=name) for name in MODELS]
    draws = [infer(target, 2, Wanted(SamplerSettings(draws=DRAWS))).chains.x for target in targets]
    logs = np.log([0.4, 0.3, 0.2, 0.1]) - 700
    return logs, [
        Predictor(target, x.reshape(-1, x.shape[-1]))
        for target, x in zip(targets, draws, strict=True)
    ]


@pytest.fixture(scope="module")
def one(drawn, small_study):
    return mixed(small_study["A"], *drawn, DRAWS)


@pytest.fixture(scope="module")
def table(one):
    return Averages((one,), {}, 1, bt.Prior())


def test_draws_are_shared_out_and_what_a_model_lacks_is_exact(one, drawn):
    assert one.weights == pytest.approx([0.4, 0.3, 0.2, 0.1], rel=1e-12)
    assert [len(part.x) for part in one.drawn] == [320, 240, 160, 80]
    assert {name: round(one.without(name), 12) for name in AVERAGED} == {
        "pull": 0.7,
        "offset": 0.4,
        "gain": 0.7,
    }
    for name, null in AVERAGED.items():
        values = one.values(name)
        assert len(values) == DRAWS
        assert np.mean(values == null) == pytest.approx(one.without(name), abs=1e-12)
    assert one.values("pull") == pytest.approx(1 - one.values("gain"), abs=1e-12)
    assert one.values("offset")[320:560].mean() == pytest.approx(
        one.drawn[1].target.quantities(one.drawn[1].x)["offset"].mean()
    )


def test_answers_are_the_mixture_of_those_of_the_models(one, table, drawn):
    s1, s2 = np.array([0.0, 0.3, 0.1]), np.array([0.3, 0.0, 0.1])
    answers = one.yes(s1, s2)
    parts = np.array([each.yes(s1, s2).mean(axis=0) for each in drawn[1]])
    spread = np.sqrt(
        answers.var(axis=0) / 100
    )  # as if the draws were worth a hundred independent ones
    assert np.all(np.abs(answers.mean(axis=0) - one.weights @ parts) < 4 * spread)
    frame = table.yes("A", [0.0, 0.3], 0.2)
    assert frame["s2"].tolist() == [0.2, 0.2]
    assert frame["mean"].to_numpy() == pytest.approx(
        one.yes([0.0, 0.3], [0.2, 0.2]).mean(axis=0), rel=1e-12
    )
    assert (np.diff(frame[["q05", "q25", "q50", "q75", "q95"]]) >= 0).all()
    with pytest.raises(bt.InputError, match="tested without intervals"):
        one.yes(0.0, 0.3, 1.0)


def test_summary_and_weights(one, table):
    summary = table.summary().set_index("quantity")
    assert summary.columns.tolist() == [
        "subject",
        "mean",
        "q05",
        "q25",
        "q50",
        "q75",
        "q95",
        "value_without",
        "p_without",
    ]
    assert summary.loc["pull", "q50"] == 0.0
    assert summary.loc["gain", "value_without"] == 1.0
    assert summary.loc["pull", "mean"] == pytest.approx(one.values("pull").mean())
    assert table.weights()["probability"].sum() == pytest.approx(1.0)
    assert table.weights()["model"].tolist() == list(MODELS)


def test_through_the_pipeline_with_the_probabilities_of_the_verdict(small_study, three_models):
    study = small_study.select(["C"])
    found = bt.average_models(study, draws=500, seed=4, workers=1)
    said = bt.evidence(study, seed=4, workers=1)["C"].verdict
    assert found["C"].without("offset") == pytest.approx(
        said.p_none, abs=0.01
    )  # but for models far behind, which have no draws
    assert found["C"].without("pull") == pytest.approx(
        said.p_none + said.p_constant_error, abs=0.01
    )
    with pytest.raises(bt.InputError, match="'A': no average, R-hat"):
        Averages((), {"A": "R-hat"}, 1, bt.Prior())["A"]


def averaged(counts):
    """Two models with a few points each, which need not be draws."""
    names = ("symmetric", "constant error + sloped")
    targets = [model.posterior(counts) for model in require_models(names)]
    drawn = tuple(Predictor(target, target.starts()[:20]) for target in targets)
    one = Average(counts, names, np.array([0.7, 0.3]), drawn)
    return one, Averages((one,), {}, 1, bt.Prior(), synthetic=True)


def test_figure(small_study):
    one, table = averaged(small_study["A"])
    figure = bt.plots.plot_average(table, "A")
    figure.draw_without_rendering()
    title = figure._suptitle
    assert title.get_text().startswith(
        "A: average over 2 models (synthetic data)\npull 0.00 (0.00, 0.00), none: 1.00\nconstant error "
    )
    assert title.get_text().endswith("none: 0.70")
    assert 0 < title.get_window_extent().x0 < title.get_window_extent().x1 < figure.bbox.width
    (ax,) = figure.axes
    lines = [line for line in ax.lines if len(line.get_xdata()) == 120]
    x = lines[0].get_xdata()
    expected = [one.yes(*pair).mean(axis=0) for pair in ((0 * x, x), (x, 0 * x), (x, x))]
    assert all(
        line.get_ydata() == pytest.approx(mean) for line, mean in zip(lines, expected, strict=True)
    )


def test_many_stimuli_are_drawn_over_their_difference():
    s1, s2 = (grid.ravel() for grid in np.meshgrid(*[np.linspace(0.0, 0.7, 8)] * 2))
    _, table = averaged(bt.Subject("A", s1, s2, np.full(64, 3), np.full(64, 6)))
    (ax,) = bt.plots.plot_average(table, "A").axes
    assert "difference" in ax.get_xlabel()
    assert sum(len(line.get_xdata()) for line in ax.lines if line.get_marker() == "_") == 64
