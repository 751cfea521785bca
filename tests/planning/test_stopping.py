"""Sessions that stop: they do when all answers so far are judged sure enough, and errors are counted."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.model.ladder import SPACE
from bayes_toe.planning.judging import Judgement, judged
from bayes_toe.planning.observers import observers_from, prior_of
from bayes_toe.planning.power import DataSet
from bayes_toe.planning.stopping import StoppingRule, StoppingTable, session
from bayes_toe.planning.study_design import narrow_study_design
from bayes_toe.seeds import generator

NARROW = narrow_study_design(np.linspace(-0.75, 1.25, 5), np.array([-0.3, -0.15, 0.0, 0.15, 0.3]), 200)


@pytest.mark.parametrize(("words", "most"), [(("has",), 200), (("none",), 60)])
def test_a_session_ends_at_the_first_look_at_which_a_word_is_said_or_at_its_end(words, most):
    observer, rule = observers_from(None, 1, seed=1)[-1], StoppingRule(words, most, 40)
    prior = prior_of([NARROW], None)
    found = session("d", NARROW, observer, rule, 1, prior)
    rng = generator(1, observer.name, "session")
    order = rng.permutation(np.repeat(np.arange(NARROW.n_pairs), NARROW.n_trials))
    equal = rng.uniform(size=200) < observer.p_yes(NARROW)[order]
    for trials in range(40, found.trials + 1, 40):
        subject = bt.Subject.from_trials(observer.name, NARROW.s1[order[:trials]], NARROW.s2[order[:trials]], equal[:trials])
        judgement = judged(subject, 1, prior, SPACE)
        assert rule.ends(judgement.verdict) == (trials == found.trials and most == 200)
    assert found.trials in (60, *range(40, 200, 40))
    assert found.judgement.found == (most == 200) or most == 60


def test_errors_are_counted():
    said = [Judgement(tuple(np.log(p))) for p in ((0.01, 0.01, 0.98), (0.9, 0.05, 0.05), (0.5, 0.25, 0.25), (0.02, 0.49, 0.49))]
    rows = tuple(DataSet("d", 100 * i, f"u{i}", "update", one) for i, one in enumerate(said, 1))
    table = StoppingTable(rows, StoppingRule(("has", "none")), 1, {})
    assert table.sentences() == [
        "with d, stopping at 'has' or 'none', or 1000 trials finds an order effect in 50 % of observers with a pull (12 to 88 %), and "
        "none, or a negligible one, in 1 of 4; median 250 trials"
    ]
    assert table.frame().effect.tolist() == ["has", "probably none", "undecided", "has"]
    assert table.frame().kind_named.tolist() == ["pull", "", "", "open"]


def test_refusals():
    with pytest.raises(InputError, match=r"--stop: found .*, allowed: some of has, probably has"):
        StoppingRule(("0.95",))
    with pytest.raises(InputError, match="--look 2000: allowed is 1 to 1000"):
        StoppingRule(every=2000)
