"""What a trial leaves to the next: told of who does it, not of who does not; seen by the check, in tables, commands and figures."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import good, refused
from conftest import plain_models_alone
from populations import made_up

import bayes_toe as bt
from bayes_toe.comparison.history import HISTORY_COLUMNS
from bayes_toe.comparison.verdict import verdict
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.groups.predictive_check import predictive_check
from bayes_toe.groups.subjects import GroupLikelihood
from bayes_toe.inference.predictive_checks import MISFIT, history_p
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.prior import DEFAULT
from bayes_toe.records import packed

CARRIED = {"offset": 0.02, "pull": 0.4, "width": 0.25, "lapse_rate": 0.03, "carry_over": 0.9}


def observer(name, model, seed, trials=700, **values):
    """Somebody who says which of neighbouring stimuli was stronger, trial by trial, by a model at natural values."""
    rng = np.random.default_rng(seed)
    low, up = rng.integers(0, 5, trials), rng.random(trials) < 0.5
    keys = 0.3 * np.column_stack([low + ~up, low + up])
    answers = Answers(
        keys, np.zeros(trials, int), np.ones(trials, int), None, (), True, np.arange(trials)
    )
    target = posterior_of(Subject.from_answers(name, answers, WHICH_STRONGER), DEFAULT, model=model)
    x = target.points({key: np.array([values[key]]) for key in target.names.natural})
    p = np.empty(trials)
    p[np.lexsort(keys.T[::-1])] = np.exp(target.trial_answers(x)[0])
    return (
        Subject.from_answers(
            name, replace(answers, n_yes=(rng.random(trials) < p).astype(int)), WHICH_STRONGER
        ),
        target,
        x,
    )


@pytest.fixture(scope="module")
def study():
    told = {"carries": ("contraction + carry-over", 1), "relaxes": ("contraction", 2)}
    return bt.Study([observer(name, *of, **CARRIED)[0] for name, of in told.items()])


@pytest.fixture(scope="module")
def short():
    return bt.Study([observer("short", "contraction + carry-over", 1, trials=200, **CARRIED)[0]])


@pytest.fixture(scope="module")
def table(study):
    with plain_models_alone():
        return bt.compare_history(study, seed=1, workers=1)


def test_a_history_is_told_of_who_has_one(table):
    carries, relaxes = table["carries"], table["relaxes"]
    assert carries.depends == "yes"
    assert relaxes.depends not in ("yes", "probably")
    assert carries.lead > 5.0
    for one in (carries, relaxes):  # two levels, of models equally many
        assert one.log_bayes_factor_history == pytest.approx(
            np.log((one.p_carry_over + one.p_running_average) / 2 / one.p_static)
        )
    assert carries.p_static + carries.p_carry_over + carries.p_running_average == pytest.approx(1.0)
    assert carries.p_carry_over_by_time is None, "no times between trials"
    assert carries.log_bayes_factor_previous_answer < 3.0
    assert carries.q05 < CARRIED["carry_over"] < carries.q95
    assert carries.history_p_static < MISFIT < carries.history_p
    assert carries.describe().startswith(
        "answers follow the trials before (P of a history > 0.99; carried over, share: "
    )
    assert table.frame().columns.tolist() == list(HISTORY_COLUMNS)


def test_a_study_is_told_of_in_a_sentence_which_says_where_nothing_tells_of_pauses(table):
    assert table.sentence().startswith("answers follow them, of 2 subjects: yes 1, ")
    assert "tells of pauses" in table.sentence()
    paused = [
        replace(one, answers=replace(one.answers, place=np.arange(700) + (np.arange(700) > 350)))
        for one in table.study
    ]
    assert "pauses" not in replace(table, study=bt.Study(paused)).sentence()
    unordered = bt.Study(
        [table.study["carries"], replace(table.study["relaxes"], answers=None)]
    )  # as `run` has it: a row of the other one
    assert "tells of pauses" in replace(table, study=unordered, rows=table.rows[:1]).sentence()


def test_the_verdict_says_that_answers_seem_to_depend_on_the_trial_before(study, three_models):
    said, _ = verdict(study["carries"], DEFAULT, 1)
    assert said.history_p < MISFIT
    assert any(
        doubt.startswith("answers seem to depend on the trial before (p ")
        for doubt in said.doubts()
    )
    unordered, _ = verdict(replace(study["carries"], answers=None), DEFAULT, 1)
    assert (unordered.history_p, unordered.follows) == (None, False)


def test_the_check_is_even_where_the_model_is_true():
    found = []
    for seed in range(40):
        one, target, x = observer(f"S{seed}", "contraction", seed, trials=200, **CARRIED)
        found.append(history_p(target.for_subject(one), np.repeat(x, 200, axis=0), seed))
    assert 0.35 < np.mean(found) < 0.65
    assert sum(p < 0.05 for p in found) <= 7


def test_what_has_no_order_is_refused_in_one_line(study, tmp_path):
    unordered, said = (
        [replace(one, answers=None) for one in study],
        "a model with a history needs the order of trials, found none",
    )
    with pytest.raises(bt.InputError, match=f"subject 'carries': {said}"):
        bt.compare_history(bt.Study(unordered), seed=1)
    with pytest.raises(
        bt.InputError, match=f"subject 'relaxes': {said}"
    ):  # of a group, of everybody
        bt.population(
            bt.Study([study["carries"], unordered[1]]), model="contraction + carry-over", seed=1
        )
    study.frame().to_csv(tmp_path / "counts.csv", index=False)
    line = refused(
        "history",
        "counts.csv",
        "-o",
        "history.csv",
        "--seed",
        1,
        cwd=tmp_path,
        silent=False,
    )
    assert (
        "needs the order of trials, found none; allowed: rows that are trials, with a column trial"
        in line
    )


def test_a_group_is_of_trials_and_comes_back_with_them(study, tmp_path):
    found = made_up(study, model="contraction + no lapses + carry-over")
    assert found.names == ("offset", "pull", "width", "carry_over")
    again = bt.load(found.save(tmp_path / "population.nc"))
    assert packed(again.table.rows) == packed(found.table.rows)
    eta = found.chains.eta[0, :2]
    value, _ = GroupLikelihood(
        found.model, found.settings.prior, found.study.subjects, found.centre, 2
    )(eta)
    targets = [again.posterior(one.name) for one in again.study]
    alone = [
        [of.log_likelihood(of.from_group(at[None, i])[0])[0] for i, of in enumerate(targets)]
        for at in eta
    ]
    np.testing.assert_allclose(value, alone)
    assert all(0.0 < one.p_value <= 1.0 for one in predictive_check(again, groups=20).statistics)


def test_commands_say_and_draw_it(study, tmp_path, three_models):
    answers = study["carries"].answers
    said = np.where(answers.n_yes > 0, "second", "first")
    trials = {
        "subject": "carries",
        "trial": np.arange(len(said)) + 1,
        "s1": answers.keys[:, 0],
        "s2": answers.keys[:, 1],
        "response": said,
    }
    pd.DataFrame(trials).to_csv(tmp_path / "trials.csv", index=False)
    common = ("--seed", 1, "--workers", 1)
    asked = ("history", "trials.csv", "-o", "history.csv", *common)
    assert "trials before: answers follow them, of 1 subject: yes 1" in " ".join(
        good(*asked, cwd=tmp_path).split()
    )
    assert pd.read_csv(tmp_path / "history.csv").depends.tolist() == ["yes"]
    assert (tmp_path / "history.png").stat().st_size > 10_000
    assert "history.csv: exists" in refused(*asked, cwd=tmp_path)
    sampled = ("--pictures", "none", "--draws", 100, *common)
    good("run", "trials.csv", "-o", "out", *sampled, cwd=tmp_path)
    assert pd.read_csv(tmp_path / "out" / "history.csv").subject.tolist() == ["carries"]
    assert (pd.read_csv(tmp_path / "out" / "evidence.csv").history_p < MISFIT).all()
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "answers follow the trials before" in report
    assert report.count('id="history"') == 1


def test_titles_of_the_figure_stay_within_it(table):
    """Also that of the quantity with the longest name."""
    row = replace(table.rows[0], parameter="carry_over_tau", q50=7.6, q05=3.6, q95=22.1)
    figure = bt.plots.history(replace(table, rows=(row,)))
    figure.draw_without_rendering()
    assert figure.axes[0].title.get_window_extent().x0 >= 0.0
