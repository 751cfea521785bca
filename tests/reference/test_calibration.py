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

STUDIES, FEWER = 8, 5  # the fewer are enough for a prior as wrong as the one below


def ranks_under(prior, studies=STUDIES):
    """Verdicts where observers come from the default prior and are analysed under this one."""
    names = [f"test-{i}" for i in range(studies)]
    rows = pd.DataFrame([rank_truth("sparse", name, 7, prior, bt.Prior()) for name in names])
    assert not rows["shortfall"].any()
    return pd.DataFrame(judged_ranks(rows, RANKED)).set_index("what")


@pytest.mark.slow
def test_a_right_density_passes_and_wrong_ones_are_caught(monkeypatch):
    assert ranks_under(bt.Prior()).calibrated.all()
    right = PosteriorArray.densities

    def with_jacobian(self, u):
        """Densities with a wrong factor 2 sigma_p^3.

        It is the Jacobian that changes (sigma_p, gamma) into (sigma_p^2, sigma_l^2).
        """
        (log_prior, log_posterior), rows = right(self, u), self.likelihood.rows
        if not hasattr(rows, "log_width"):  # a model that the responses are checked with
            return log_prior, log_posterior
        log_sigma_p = rows.log_width(u) + rows.power * np.log1p(-rows.pull(u))
        return log_prior, log_posterior + 3.0 * log_sigma_p

    with monkeypatch.context() as wrong:
        wrong.setattr(PosteriorArray, "densities", with_jacobian)
        jacobian = ranks_under(bt.Prior())
    assert not jacobian.calibrated["sigma_p"]
    assert jacobian.largest_difference["sigma_p"] > 0  # draws too large: the truth ranks low
    prior = ranks_under(bt.Prior(mu1_sd=3.0, sigma_p_scale=0.3), FEWER)
    assert not prior.calibrated["sigma_p"]
    assert prior.largest_difference["sigma_p"] < 0


def test_the_script_writes_and_says_what_was_found(tmp_path, monkeypatch, capsys):
    line = f"calibration.py -o {tmp_path} --studies 2 --data-sets 2 --seed 3"
    monkeypatch.setattr(sys, "argv", line.split())
    monkeypatch.setattr(calibration, "REPLICATES", 20)
    assert calibration.main() == 0
    assert "*Ranks*, 16 of 16 rows are calibrated." in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "calibration.csv")
    assert set(table.loc[table.part == "rank", "what"]) == set(RANKED)
    assert "| Appendix C |" in (tmp_path / "calibration.md").read_text()
