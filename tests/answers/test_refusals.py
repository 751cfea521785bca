"""A numerical failure is the refusal of one subject; the others are answered."""

import pytest
from conftest import few_pairs

import bayes_toe as bt
from bayes_toe.errors import NumericalError
from bayes_toe.inference.order_evidence import order_evidence


def test_a_numerical_failure_leaves_the_other_subjects(monkeypatch):
    def fails_for_one(subjects, *rest):
        if subjects[0].name == "B":
            raise NumericalError("subject 'B': the evidence of 'both' is not a finite number")
        return order_evidence(subjects, *rest)

    monkeypatch.setattr("bayes_toe.answers.order_effect.order_evidence", fails_for_one)
    table = bt.evidence(few_pairs("ABC"), seed=1, workers=1)
    assert [row.subject for row in table] == ["A", "C"]
    assert table.failed == {"B": "subject 'B': the evidence of 'both' is not a finite number"}
    frame = table.frame()
    assert frame["subject"].tolist() == ["A", "C", "B"]
    assert frame["p_order_effect"].isna().tolist() == [False, False, True]


def test_where_every_subject_fails_the_call_fails(monkeypatch):
    def fails(*_):
        raise NumericalError("not a finite number")

    monkeypatch.setattr("bayes_toe.answers.order_effect.order_evidence", fails)
    with pytest.raises(bt.BayesToeError, match="A: not a finite number"):
        bt.evidence(few_pairs("A"), seed=1, workers=1)
