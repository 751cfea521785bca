"""Proposals: density, draws and their weights."""

import numpy as np
import pytest
from reference.hard_cases import hard_cases

from bayes_toe.inference.adaptation import fit_proposal
from bayes_toe.inference.proposal import efficiency, importance_draws
from bayes_toe.model.ladder import posterior_of

CASES = hard_cases()


def test_log_proposal_density_integrates_to_one():
    # Importance weights of the proposal's own density against its draws: prior / proposal averages to the prior's mass, 1.
    posterior = posterior_of(CASES["one batch"])
    proposal = fit_proposal(posterior, np.random.default_rng(9)).proposal
    draws = importance_draws(proposal, np.random.default_rng(10), 200_000)
    ratio = np.exp(draws.log_prior - draws.log_proposal)
    assert ratio.mean() == pytest.approx(1.0, abs=5 * ratio.std() / np.sqrt(len(ratio)))


def test_efficiency_of_even_and_of_single_weights():
    assert efficiency(np.full(7, -1e6)) == pytest.approx(1.0)
    assert efficiency(np.array([0.0] + [-1e4] * 9)) == pytest.approx(0.1)
