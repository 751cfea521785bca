"""The one sentence that a study supports counts nobody whose answers the model does not describe."""

from types import SimpleNamespace

import pytest

from bayes_toe.cli.headline import NEXT, in_short
from bayes_toe.inference.predictive_checks import FitSummary

EFFECT, NONE, OPEN = (-9.0, -3.0, 0.0), (0.0, -3.0, -2.0), (0.0, -0.5, -0.2)


def fit_of(degrees_of_freedom):
    return FitSummary(9.0, degrees_of_freedom, 0.5, 0.01, 0.5, 0.0, 0.3)


JUDGED = fit_of(9)


def table(*rows, fit=JUDGED):
    return [SimpleNamespace(subject=f"S{i}", log_evidence_orders=found, misfit=misfit, fit=fit) for i, (found, misfit) in enumerate(rows)]


@pytest.mark.parametrize(
    ("rows", "start", "end"),
    [
        (
            [(EFFECT, False), (NONE, False), (OPEN, False), (None, False)],
            "1 of 4 subjects has an order effect, 1 has none, 1 is undecided, 1 has no estimate (",
            "of all",
        ),
        ([(EFFECT, True), (EFFECT, False), (EFFECT, False)], "2 of the 2 subjects whose answers H1 describes have an order effect (", NEXT),
        ([(OPEN, False)], "0 of 1 subject has an order effect, 1 is undecided (", "of all"),
        ([(EFFECT, True)], "H1 describes the answers of none of 1 subject; next: bayes-toe compare", NEXT),
    ],
    ids=["all", "some", "one", "none"],
)
def test_one_sentence(rows, start, end):
    said = in_short(table(*rows))
    assert said.startswith(start)
    assert said.endswith(end)


def test_synthetic_subjects_are_called_so():
    assert in_short(table((EFFECT, False), (EFFECT, False)), synthetic=True).startswith("2 of 2 synthetic subjects have")


@pytest.mark.parametrize("fit", [None, fit_of(0)], ids=["withheld", "as many parameters as pairs"])
def test_where_it_cannot_be_told_whether_h1_describes_the_answers_it_is_not_said(fit):
    judged, not_judged = table((EFFECT, False)), table((EFFECT, False), (EFFECT, False), fit=fit)
    assert in_short(not_judged).endswith("whether H1 describes the answers cannot be told")
    assert in_short([*judged, *not_judged]).endswith("H1 describes the answers of 1, of 2 it cannot be told")
