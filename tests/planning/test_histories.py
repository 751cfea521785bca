"""Planning for histories: who answers how, and what is counted."""

import numpy as np
import pytest
from commands import refused

from bayes_toe.planning.observers import observers_from
from bayes_toe.planning.power import Outcome
from bayes_toe.planning.power_of_histories import (
    NOTHING,
    Carrying,
    HistoryPower,
    answers_in_order,
    said_of,
)
from bayes_toe.planning.study_design import narrow_study_design

WIDE = narrow_study_design(np.linspace(-0.75, 1.25, 5), np.linspace(-0.3, 0.3, 5), 5000)


def of_stimuli_before(subject, observer):
    """By how many standard errors 'equal' is more frequent than without history after a strong trial where the second is strong."""
    answers, q = subject.answers, dict(zip(WIDE.pairs, observer.p_yes(WIDE), strict=True))
    surprise = answers.n_yes - np.array([q[pair] for pair in map(tuple, answers.keys.tolist())])
    step, before = np.diff(answers.keys, axis=1)[1:, 0], answers.keys[:-1].mean(axis=1)
    moved = surprise[1:] * (before - before.mean()) * np.sign(step)
    return moved.mean() / (moved.std() / np.sqrt(len(moved)))


def test_what_was_felt_draws_the_next_answer_of_those_who_carry_it_over_alone():
    """Expecting more, the first stimulus is remembered as stronger: 'equal' is rarer where the second is weaker still."""
    one = observers_from(None, 1, seed=1)[-1]
    answers = (
        answers_in_order(Carrying("A", one, share), WIDE, np.random.default_rng(2))
        for share in (0.0, 0.95)
    )
    static, carried = (of_stimuli_before(each, one) for each in answers)
    assert abs(static) < 3.5, "a false alarm in 2,000"
    assert carried > 5.0


def test_words_are_counted():
    words = {
        NOTHING: ("no", "no pull", "undecided", "probably"),
        "0.6 carried over": ("yes", "yes", "probably", "no"),
    }
    rows = [
        Outcome("d", 400, kind, 1, said_of(depends))
        for kind, said in words.items()
        for depends in said
    ]
    table = HistoryPower(tuple(rows), 1)
    assert table.counted["d", 400, "0.6 carried over", 1, "said: yes"].value == 0.5
    assert table.sentences()[0].startswith(
        "with d and 400 trials, answers are said to follow the trials before, for sure or probably, of 75 % of observers with 0.6 carried"
    )
    assert table.sentences()[0].endswith(", and wrongly of 1 of 4 without")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--carry-over", "1"), "--carry-over: found 1, allowed: a number above 0 and below 1"),
        (
            ("--carry-over", "0.5", "--observers", "observers.toml"),
            "--carry-over: found observers without a pull",
        ),
    ],
)
def test_what_is_refused_before_the_work(tmp_path, more, said):
    (tmp_path / "observers.toml").write_text(
        '["constant error"]\noffset = 0.1\nwidth = 0.3\nq0 = 0.9\n', encoding="utf-8"
    )
    assert refused(
        "power", "--trials", "26", "--data-sets", "1", "-o", "o", *more, cwd=tmp_path
    ).startswith(f"error: {said}")
