"""An analysis in which something needs action, for results folders and reports."""

from dataclasses import replace

import pytest

from bayes_toe.answers.order_effect import MISFIT_FLAG, QUESTIONS, Problem
from bayes_toe.answers.words import Word
from bayes_toe.inference.goodness_of_fit import PairResidual

SWAPPED = "responses look swapped"


@pytest.fixture(scope="session")
def marked(analysis):
    """The analysis of three subjects: the first does not fit, the last is not interpreted."""
    first, second, third = analysis.evidence
    bent = replace(
        first.answer,
        fit_p=0.001,
        problems={MISFIT_FLAG: Problem("The model does not fit.")},
        worst_pairs=(PairResidual(0.0, 0.3, 0.9, 0.4),),
    )
    swapped = replace(
        third.answer,
        words=dict.fromkeys(QUESTIONS, Word.NOT_INTERPRETABLE),
        is_interpretable=False,
        problems={SWAPPED: Problem("Responses look swapped in block 2.", "--swap C:2")},
    )
    rows = (replace(first, answer=bent), second, replace(third, answer=swapped))
    return replace(analysis, evidence=replace(analysis.evidence, rows=rows))
