"""Sessions that stop: their probabilities are those of the evidences, they stop when the rule says so, and errors are counted."""

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


def test_a_session_that_goes_on_to_the_end_says_what_the_analysis_of_all_its_answers_says():
    observer, rule = observers_from(None, 1, seed=1)[1], StoppingRule(0.9999999, 200, 50)
    found = session("d", NARROW, observer, rule, 1, bt.Prior())
    rng = generator(1, observer.name, "session")
    order = rng.permutation(np.repeat(np.arange(NARROW.n_pairs), NARROW.n_trials))
    equal = rng.uniform(size=200) < observer.equal(NARROW)[order]
    subject = bt.Subject.from_trials("s", NARROW.s1[order], NARROW.s2[order], equal)
    evidence = judged(subject, 1, bt.Prior()).log_evidence
    assert (found.trials, found.named) == (200, None)
    assert np.diff(np.log(found.probability)) == pytest.approx(np.diff(evidence), abs=0.15)


def test_an_update_is_named_before_the_last_trial():
    found = session("d", NARROW, observers_from(None, 1, seed=1)[-1], StoppingRule(0.95, 200, 20), 1, bt.Prior())
    assert found.named == "update"
    assert found.trials < 200
    assert found.trials % 20 == 0


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
