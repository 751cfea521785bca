"""An analysis in which something needs action, for results folders and reports."""

from dataclasses import replace

import pytest

from bayes_toe.answers.order_effect import MISFIT_FLAG, QUESTIONS, Problem
from bayes_toe.answers.words import Word
from bayes_toe.inference.goodness_of_fit import PairResidual

SWAPPED = "responses look swapped"


@pytest.fixture(scope="session")
def analysis_with_problems(analysis):
    """The analysis of A, B and C. A does not fit (90 % 'equal' instead of 40 % in a pair).

    B has no problem. C is not interpreted, because responses look swapped in block 2.
    """
    row_a, row_b, row_c = analysis.evidence
    answer_a = replace(
        row_a.answer,
        fit_p=0.001,
        problems={MISFIT_FLAG: Problem("The model does not fit.")},
        worst_pairs=(PairResidual(0.0, 0.3, 0.9, 0.4),),
    )
    answer_c = replace(
        row_c.answer,
        words=dict.fromkeys(QUESTIONS, Word.NOT_INTERPRETABLE),
        is_interpretable=False,
        problems={SWAPPED: Problem("Responses look swapped in block 2.", "--swap C:2")},
    )
    rows = (replace(row_a, answer=answer_a), row_b, replace(row_c, answer=answer_c))
    return replace(analysis, evidence=replace(analysis.evidence, rows=rows))
