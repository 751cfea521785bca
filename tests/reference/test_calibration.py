"""Calibration by simulation: a correct posterior passes, and wrong densities are caught."""

import numpy as np
import pytest
from reference.calibration import (
    Job,
    Plan,
    calibration_settings,
    judged,
    work,
)

import bayes_toe as bt
from bayes_toe.model.posterior_array import PosteriorArray

STUDIES, FEWER = 8, 5  # the fewer are enough for a prior as wrong as the one below


def ranks_under(prior, studies=STUDIES):
    """Verdicts where observers come from the default prior and are analysed under this one."""
    settings = calibration_settings(7, prior)
    ranks, evidence = zip(
        *(
            work(Job("sparse", True, f"test-{i}", True, False, settings, bt.Prior()))
            for i in range(studies)
        ),
        strict=True,
    )
    assert not any(evidence)
    assert not any(row["shortfall"] for row in ranks)
    return judged(Plan(studies, 0, 7), ranks, []).rank_verdicts.set_index("quantity")


@pytest.mark.slow
def test_a_right_density_passes_and_wrong_ones_are_caught(monkeypatch):
    assert (ranks_under(bt.Prior()).verdict == "inside").all()
    right = PosteriorArray.densities

    def with_jacobian(self, u):
        """With that of (sigma_p^2, sigma_l^2), 2 sigma_p^3, in the place of (sigma_p, gamma)."""
        (log_prior, log_posterior), rows = right(self, u), self.likelihood.rows
        log_sigma_p = rows.log_width(u) + rows.power * np.log1p(-rows.pull(u))
        return log_prior, log_posterior + 3.0 * log_sigma_p

    with monkeypatch.context() as wrong:
        wrong.setattr(PosteriorArray, "densities", with_jacobian)
        jacobian = ranks_under(bt.Prior())
    assert jacobian.verdict["sigma_p"] == "outside"
    assert jacobian.largest_difference["sigma_p"] > 0  # draws too large: the truth ranks low
    prior = ranks_under(bt.Prior(mu1_sd=3.0, sigma_p_scale=0.3), FEWER)
    assert prior.verdict["sigma_p"] == "outside"
    assert prior.largest_difference["sigma_p"] < 0
