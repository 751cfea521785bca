"""Calibration by simulation: a correct posterior passes, and wrong densities are caught."""

import sys

import calibration
import numpy as np
import pandas as pd
import pytest
from calibration import RANKED, rank_truth
from reference.calibration_statistics import judged_ranks

import bayes_toe as bt
from bayes_toe.model.posterior_array import PosteriorArray


def ranks_under(prior, n_studies=8):
    """Whether ranks are uniform, by quantity, if observers of the paper's prior get this prior.

    A rank is the share of posterior draws below the true value.
    """
    options = {"seed": 7, "prior": prior, "truth": bt.Prior()}
    names = [f"test-{i}" for i in range(n_studies)]
    rows = pd.DataFrame([rank_truth("sparse", name, **options) for name in names])
    assert not rows["shortfall"].any()  # all samples converged
    return pd.DataFrame(judged_ranks(rows, RANKED)).set_index("what")


@pytest.mark.slow
def test_the_right_density_passes():
    assert ranks_under(bt.Prior()).calibrated.all()


@pytest.mark.slow
def test_a_density_with_a_wrong_jacobian_is_caught(monkeypatch):
    right_densities = PosteriorArray.densities

    def with_jacobian(self, u):
        """Densities with a wrong factor 2 sigma_p^3.

        The factor is the Jacobian that changes (sigma_p, gamma) into (sigma_p^2, sigma_l^2).
        """
        (log_prior, log_posterior) = right_densities(self, u)
        rows = self.likelihood.rows
        if not hasattr(rows, "log_width"):  # a model that the responses are checked with
            return log_prior, log_posterior
        log_sigma_p = rows.log_width(u) + rows.power * np.log1p(-rows.pull(u))
        return log_prior, log_posterior + 3.0 * log_sigma_p

    monkeypatch.setattr(PosteriorArray, "densities", with_jacobian)
    ranks = ranks_under(bt.Prior())
    assert not ranks.calibrated["sigma_p"]
    assert ranks.largest_difference["sigma_p"] > 0  # draws too large: the truth ranks low


@pytest.mark.slow
def test_a_prior_that_is_too_narrow_is_caught():
    # A scale of .3 instead of 1 is so wrong that five studies show it.
    ranks = ranks_under(bt.Prior(mu1_sd=3.0, sigma_p_scale=0.3), n_studies=5)
    assert not ranks.calibrated["sigma_p"]
    assert ranks.largest_difference["sigma_p"] < 0  # draws too small


def test_the_script_writes_and_says_what_was_found(tmp_path, monkeypatch, capsys):
    line = f"calibration.py -o {tmp_path} --studies 2 --data-sets 2 --seed 3"
    monkeypatch.setattr(sys, "argv", line.split())
    monkeypatch.setattr(calibration, "REPLICATES", 20)  # few, so that it takes seconds
    assert calibration.main() == 0
    n_rows = 2 * len(RANKED)  # each quantity in two designs
    assert f"*Ranks*, {n_rows} of {n_rows} rows are calibrated." in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "calibration.csv")
    assert set(table.loc[table.part == "rank", "what"]) == set(RANKED)
    assert "| Appendix C |" in (tmp_path / "calibration.md").read_text()
