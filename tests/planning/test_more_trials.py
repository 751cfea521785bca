"""What more trials would decide: fewer of the pairs that tell, none of those that tell nothing, and who is decided is not asked about."""

import numpy as np
import pytest
from commands import good

import bayes_toe as bt
from bayes_toe.model.ladder import ORDERS, SPACE
from bayes_toe.planning.judging import Weighed
from bayes_toe.planning.more_trials import ENOUGH, REPETITIONS, MoreTrials, Tried, likeliest
from bayes_toe.planning.observers import observers_from
from bayes_toe.planning.study_design import each_once, paper_study_design
from bayes_toe.seeds import generator


@pytest.fixture(scope="module")
def few():
    """A subject of 65 trials, of whom nothing is known yet."""
    design = paper_study_design(65)
    return observers_from(None, 1, seed=1)[0].answers(design, generator(1, "few"))


def test_an_undecided_subject_is_told_how_many_trials_of_which_pairs(few, tmp_path, monkeypatch):
    study = bt.Study((few,))
    [found] = bt.planning.more_trials(study, seed=1, workers=1)
    assert found.subject == few.name
    for one in (found.same, found.telling):
        assert one.design.total == one.trials >= few.total_trials // 2
        assert 0 <= one.decided <= REPETITIONS
    assert found.same.design.pairs == list(zip(few.s1, few.s2, strict=True))
    shown = {*few.s1, *few.s2}
    assert found.telling.design.n_pairs == 6
    assert shown.issuperset({level for pair in found.telling.design.pairs for level in pair})
    study.frame().to_csv(tmp_path / "few.csv", index=False)
    asked = []
    monkeypatch.setattr("bayes_toe.planning.more_trials", lambda _, names, **__: asked.append(names) or (found,))  # not once more
    said = good("evidence", "few.csv", "--more-trials", "--seed", "1", "--workers", "1", cwd=tmp_path)
    assert asked == [[few.name]]
    assert found.sentence() in " ".join(said.split())


def test_who_is_decided_is_left_out(few):
    clear = observers_from(None, 1, seed=1)[-1].answers(paper_study_design(20_000), generator(1, "many"))
    assert bt.planning.more_trials(bt.Study((clear,)), seed=1, workers=1) == ()
    with pytest.raises(bt.InputError):
        bt.planning.more_trials(bt.Study((few,)), ["nobody"], seed=1)


def test_the_sentence():
    one = each_once([0.0, 0.5], [0.5, 0.0])
    assert MoreTrials("S", Tried(one, 1040, ENOUGH - 1), Tried(one, 325, ENOUGH)).sentence() == (
        "even 1,000 more trials of the same pairs would decide in 7 of 10 simulated repetitions only; about 320 more trials of the pairs "
        "0 then 0.5, 0.5 then 0 would decide (in 8 of 10 simulated repetitions)"
    )


def test_repetitions_are_judged_by_every_order_of_the_likeliest_shape_of_each_curve():
    values = np.array([3.0 if "sloped +" in f"{model.name} +" and "both ways" in model.name else 0.0 for model in SPACE])
    chosen = [dict(model.levels) for model in likeliest(Weighed(SPACE, values, {}))]
    assert sorted((one["order"], one["curve"]) for one in chosen) == sorted((a, b) for a in ORDERS for b in ("bell", "differencing"))
    assert {(one["noise"], one["lapses"]) for one in chosen} == {("sloped", "both ways")}
