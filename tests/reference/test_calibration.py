"""Calibration by simulation: a correct posterior passes, and wrong densities are caught."""

import sys

import calibration
import numpy as np
import pandas as pd
import pytest
from calibration import DRAWS, PRODUCTS, analyse, calibrate, calibration_settings, judged

import bayes_toe as bt
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import AnalysisRequest
from bayes_toe.model.posterior_array import PosteriorArray

STUDIES, FEWER = 8, 5  # the fewer are enough for a prior as wrong as the one below


def ranks_under(prior, studies=STUDIES):
    """Verdicts where observers come from the default prior and are analysed under this one."""
    settings = calibration_settings(7, prior)
    request = AnalysisRequest(SamplerSettings(draws=DRAWS))
    rows = []
    for i in range(studies):
        ranks, factors = analyse("sparse", f"test-{i}", "H1", request, settings, bt.Prior())
        assert not factors
        assert not ranks["shortfall"]
        rows.append(ranks)
    return judged(pd.DataFrame(rows), pd.DataFrame(), 7).rank_verdicts.set_index("quantity")


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


def test_the_script_writes_says_and_returns_what_was_found(tmp_path, monkeypatch, capsys):
    table = calibrate(studies=1, data_sets=2, seed=3)
    monkeypatch.setattr(calibration, "calibrate", lambda **_: table)
    monkeypatch.setattr(sys, "argv", ["calibration.py", "-o", str(tmp_path), "--seed", "3"])
    assert calibration.main() == 0
    assert {path.name for path in tmp_path.iterdir()} == set(PRODUCTS)
    assert len(pd.read_csv(tmp_path / "evidence_data_sets.csv")) == 4
    assert calibration.main() == 2  # the folder is taken
    table.rank_verdicts.loc[0, "verdict"] = "outside"
    monkeypatch.setattr(sys, "argv", [*sys.argv, "--overwrite"])
    assert calibration.main() == 3
    message = capsys.readouterr().out
    assert "The ranks of 16 of 16 rows are inside" in message
    assert "NOT calibrated: paper design: ranks of mu1 outside their band" in message
    assert "seed 3; results in" in message
