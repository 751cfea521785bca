"""Fitted proposals: every hard case, and draws that are independent of the fit."""

import numpy as np
import pytest
from numpy.random import default_rng
from reference.hard_cases import hard_cases

from bayes_toe.data.study import Subject
from bayes_toe.design.study_design import reference_design
from bayes_toe.inference.adaptation import adapt_proposal, fit_proposal, with_fresh_draws
from bayes_toe.inference.evidence import importance_evidence
from bayes_toe.model.paper_model import paper_posterior
from bayes_toe.seeds import generator

CASES = hard_cases()


@pytest.mark.parametrize("name", list(CASES))
def test_proposals_fit_every_hard_case(name):
    """Evidences of the same cases: reference/test_reference."""
    fitted = fit_proposal(paper_posterior(CASES[name]), default_rng(7))
    assert fitted.trusted == (fitted.pareto_k < 0.7 and fitted.efficiency > 0.02)
    assert (fitted.trusted, fitted.efficiency > 0.55) == (True, True)


def test_a_fit_survives_starting_components_of_enormous_scale():
    # With these answers the Laplace approximation reaches where levelled offsets are of the order
    # 1e10.
    design = reference_design(batches=5)
    order = np.lexsort((design.s2, design.s1))
    answers = [0, 2, 3, 2, 1, 3, 5, 3, 1, 2, 5, 1, 5]
    posterior = paper_posterior(
        Subject("any", design.s1[order], design.s2[order], answers, [5] * 13)
    )
    fitted = fit_proposal(posterior, generator(1, "sparse-h0-0291", "proposal"))
    assert fitted.trusted
    assert fitted.efficiency > 0.5


def test_draws_that_chose_the_proposal_give_no_evidence():
    chosen = adapt_proposal(
        paper_posterior(CASES["all different"]), default_rng(7)
    )  # refitted to the draws that judged it
    assert not chosen.independent
    with pytest.raises(ValueError, match="helped to choose"):
        importance_evidence(chosen)
    again = with_fresh_draws(chosen, default_rng(4))
    assert again.independent
    assert len(again.draws.x) == 2 * len(chosen.draws.x)
    assert not set(again.draws.log_posterior) & set(chosen.draws.log_posterior)
