"""Sessions that stop: they do when all answers so far are judged sure enough, and errors are counted."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.planning.observers import observers_from
from bayes_toe.planning.power import judged
from bayes_toe.planning.stopping import Session, StoppingRule, StoppingTable, session
from bayes_toe.planning.study_design import narrow_study_design
from bayes_toe.seeds import generator

NARROW = narrow_study_design(np.linspace(-0.75, 1.25, 5), np.array([-0.3, -0.15, 0.0, 0.15, 0.3]), 200)


@pytest.mark.parametrize(("certain", "most"), [(0.95, 200), (0.9999999, 60)])
def test_a_session_ends_at_the_first_look_that_is_sure_enough_or_at_its_end(certain, most):
    observer, rule = observers_from(None, 1, seed=1)[-1], StoppingRule(certain, most, 20)
    found = session("d", NARROW, observer, rule, 1, bt.Prior())
    rng = generator(1, observer.name, "session")
    order = rng.permutation(np.repeat(np.arange(NARROW.n_pairs), NARROW.n_trials))
    equal = rng.uniform(size=200) < observer.equal(NARROW)[order]
    for trials in range(20, found.trials + 1, 20):
        subject = bt.Subject.from_trials(observer.name, NARROW.s1[order[:trials]], NARROW.s2[order[:trials]], equal[:trials])
        judgement = judged(subject, 1, bt.Prior())
        assert judgement.named(certain) == (found.named if trials == found.trials else None)
    assert found.probability == judgement.probability
    assert (found.named, found.trials < 200) == (("update", True) if most == 200 else (None, True))


def test_errors_are_counted():
    rows = [Session("d", f"u{i}", "update", 100 * i, named, (0, 0, 1)) for i, named in enumerate(("update", "none", None, "update"), 1)]
    assert StoppingTable(tuple(rows), StoppingRule(), 1, {}).sentences() == [
        "with d, stopping at P > 0.95 or 1000 trials names an update in 50 % of such observers (12 to 88 %), and something else in 1 of 4; "
        "median 250 trials"
    ]


def test_refusals():
    with pytest.raises(InputError, match="allowed is a probability above 1/3 and below 1"):
        StoppingRule(1.5)
    with pytest.raises(InputError, match="--look 2000: allowed is 1 to 1000"):
        StoppingRule(every=2000)
