"""Planning for histories: who answers how, and what is counted."""

import numpy as np
import pytest
from commands import refused
from conftest import plain_models_alone

import bayes_toe as bt
from bayes_toe.planning.observers import observers_from
from bayes_toe.planning.power import Outcome
from bayes_toe.planning.power_of_histories import NOTHING, Carrying, HistoryPower, answers_in_order, power_of_histories, said_of
from bayes_toe.planning.study_design import narrow_study_design

WIDE = narrow_study_design(np.linspace(-0.75, 1.25, 5), np.linspace(-0.3, 0.3, 5), 5000)


def of_stimuli_before(subject, observer):
    """By how many standard errors 'equal' is more frequent than without history after a strong trial where the second is strong."""
    answers, target = subject.answers, observer.target(WIDE.unanswered)
    q = dict(
        zip(zip(WIDE.s1.tolist(), WIDE.s2.tolist(), strict=True), np.exp(target.log_answers(observer.point(target))[0][0]), strict=True)
    )
    surprise = answers.n_yes - np.array([q[pair] for pair in map(tuple, answers.keys.tolist())])
    step, before = np.diff(answers.keys, axis=1)[1:, 0], answers.keys[:-1].mean(axis=1)
    moved = surprise[1:] * (before - before.mean()) * np.sign(step)
    return moved.mean() / (moved.std() / np.sqrt(len(moved)))


def test_what_was_felt_draws_the_next_answer_of_those_who_carry_it_over_alone():
    """Expecting more, the first stimulus is remembered as stronger: 'equal' is rarer where the second is weaker still."""
    one = observers_from(None, 1, seed=1)[-1]
    static, carried = (
        of_stimuli_before(answers_in_order(Carrying("A", one, share), WIDE, np.random.default_rng(2)), one) for share in (0.0, 0.95)
    )
    assert abs(static) < 3.5, "a false alarm in 2,000"
    assert carried > 5.0


def test_every_observer_is_judged_with_and_without():
    with plain_models_alone():
        found = power_of_histories(0.9, WIDE, [100], data_sets=1, seed=1, workers=1)
    assert [(one.trials, one.kind) for one in found] == [(100, NOTHING), (100, "0.9 carried over")]
    assert found.frame().set_index("quantity").loc["yes or probably", "data_sets"].tolist() == [1, 1]


def test_words_are_counted():
    words = {NOTHING: ("no", "no pull", "undecided", "probably"), "0.6 carried over": ("yes", "yes", "probably", "no")}
    rows = [Outcome("d", 400, kind, 1, said_of(depends)) for kind, said in words.items() for depends in said]
    table = HistoryPower(tuple(rows), 1)
    assert table.counted["d", 400, "0.6 carried over", 1, "said: yes"].value == 0.5
    [line] = table.sentences()
    assert line.startswith(
        "with d and 400 trials, answers are said to follow the trials before, for sure or probably, of 75 % of observers"
    )
    assert line.endswith(", and wrongly of 1 of 4 without")


def test_what_is_refused(tmp_path):
    with pytest.raises(bt.InputError, match="--carry-over: found 1, allowed: a number above 0 and below 1"):
        power_of_histories(1.0)
    asked = ("power", "--trials", "26", "--data-sets", "1", "-o", "o", "--carry-over")
    assert refused(*asked, "2", cwd=tmp_path).startswith("error: --carry-over: found 2, allowed")
    (tmp_path / "observers.toml").write_text('["constant error"]\noffset = 0.1\nwidth = 0.3\nq0 = 0.9\n', encoding="utf-8")
    assert refused(*asked, "0.5", "--observers", "observers.toml", cwd=tmp_path).startswith(
        "error: --carry-over: found observers without a pull"
    )
