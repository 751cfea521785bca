"""Fitted mixtures of every hard case, and what their draws average to."""

import pytest
from numpy.random import default_rng
from reference.hard_cases import hard_cases

from bayes_toe.design.study_design import reference_design
from bayes_toe.inference.fitted import fit_posterior
from bayes_toe.model.models import OrderModel
from bayes_toe.model.paper_model import paper_posterior
from bayes_toe.seeds import generator

CASES = hard_cases()


@pytest.mark.parametrize("name", list(CASES))
def test_mixtures_fit_every_hard_case_under_the_default_prior(name):
    """Under the paper's prior, reference/test_reference fits the hard cases.

    Efficiency is the share of effective draws. If it is .3, the log evidence of 4,000 draws has a
    standard error of about .02.
    """
    fitted = fit_posterior(paper_posterior(CASES[name]), default_rng(7))
    assert fitted.is_trusted
    assert fitted.fresh(default_rng(8), 4000).efficiency > 0.3


@pytest.mark.parametrize("model", ["none", "both"])
def test_mixtures_fit_the_smallest_and_the_largest_of_the_four_models(model):
    """Efficiency is the share of effective draws; these models have no funnel, and reach .6."""
    fitted = fit_posterior(OrderModel(model).posterior(CASES["funnel"]), default_rng(7))
    assert fitted.fresh(default_rng(8), 4000).efficiency > 0.6


def test_a_fit_survives_sparse_answers():
    """A pair has five trials, so that Laplace's normal reaches far beyond the posterior.

    These counts and this random stream are those of a simulated subject whose fit once failed.
    """
    n_equal = [0, 5, 1, 5, 5, 2, 3, 2, 1, 3, 3, 2, 1]
    posterior = paper_posterior(reference_design(batches=5).answered(n_equal, "any"))
    fitted = fit_posterior(posterior, generator(1, "sparse-h0-0291", "proposal"))
    assert fitted.is_trusted
    assert fitted.draws.efficiency > 0.5
