"""What is said of a subject in a word or two: numbers agree with the limits beside them, and who must be looked at is named."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_toe.cli.headline import flagged, p_value, told
from bayes_toe.inference.predictive_checks import MISFIT

LIMITS = (0.05, 0.25, 0.75, 0.95)


@given(st.one_of(st.floats(0.0, 1.0), st.builds(lambda limit, off: limit + off, st.sampled_from(LIMITS), st.floats(-1e-3, 1e-3))))
def test_a_probability_is_printed_on_its_side_of_every_limit(p):
    shown = told(p)
    assert abs(float(shown) - p) <= 0.005 + 1e-12
    assert all((float(shown) > one) == (p > one) for one in LIMITS if abs(p - one) > 1e-14)


@pytest.mark.parametrize("value", [0.00951, 0.00999, 0.0099999, MISFIT, 0.01001, 0.0149])
def test_a_p_value_below_the_limit_of_a_misfit_looks_so(value):
    assert (float(p_value(value)) < MISFIT) == (value < MISFIT)


def test_who_must_be_looked_at_and_why(marked):
    assert flagged(marked.evidence) == {"A": ("not described", "data in doubt"), "C": ("no verdict",)}
    assert flagged(marked.evidence, {"B": "few draws"})["B"] == ("not converged",)
