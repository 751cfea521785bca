"""An analysis in which something must be looked at, for results folders and reports."""

from dataclasses import replace

import pytest

from bayes_toe.comparison.verdict import Doubt

SWAPPED = Doubt("swapped blocks", "--turn A:2")


@pytest.fixture(scope="session")
def marked(analysis):
    """The analysis of three subjects: no model describes the first, whose data are in doubt, and the last lacks an evidence."""
    first, second, third = analysis.evidence
    wrong = replace(
        first.verdict,
        best_fit=replace(first.verdict.best_fit, p_overall=0.001),
        p_none_scattered=0.5,
        data=(SWAPPED,),
    )
    unknown = replace(third.verdict, p_orders=None, varied=(), size_q50=None, p_larger=None)
    rows = (replace(first, verdict=wrong), second, replace(third, verdict=unknown))
    return replace(analysis, evidence=replace(analysis.evidence, rows=rows))
