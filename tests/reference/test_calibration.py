"""Calibration: a correct posterior passes, wrong densities are caught, files say what was found."""

import sys

import calibration as calibration_script
import numpy as np
import pandas as pd
import pytest
from calibration import PRODUCTS
from reference import calibration
from reference.calibration import (
    DEFAULT,
    DRAWS,
    ESTIMATORS,
    Job,
    Plan,
    calibrate,
    calibration_settings,
    judged,
    log_bayes_factors,
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


@pytest.fixture(scope="module")
def table():
    return calibrate(studies=1, data_sets=2, seed=3, workers=1)


def test_what_is_judged_is_what_the_commands_say():
    """The same seed and subjects through the public verbs, which compute more.

    The numbers that the verdicts use are the same.
    """
    job = Job("sparse", True, "sparse-h1-0001", True, True, calibration_settings(3))
    subject, theta = calibration.observed(job)
    ranks, known_value = work(job)
    joint = bt.run(bt.Study((subject,)), draws=DRAWS, seed=3, workers=1)
    row = joint.evidence.rows[0]
    (fitted,) = bt.fit(bt.Study((subject,)), replicates=1000, seed=3, workers=1)
    by_bootstrap = calibration.appendix_c_evidence(fitted, job.settings.prior.for_subjects(subject))
    assert {key: known_value[key] for key in ESTIMATORS} == pytest.approx(
        log_bayes_factors(row, by_bootstrap), abs=1e-6, nan_ok=True
    )
    assert known_value[DEFAULT] == pytest.approx(row.log_bayes_factor, abs=1e-6)
    assert known_value["H0 by Laplace"] == pytest.approx(
        row.log_evidence_h1 - row.log_evidence_h0_laplace, abs=1e-6
    )
    assert ranks == {"design": "sparse", **calibration.ranks_of(joint.draws, subject, theta, 3)}


def test_the_script_writes_says_and_returns_what_was_found(table, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(calibration_script, "calibrate", lambda **_: table)
    monkeypatch.setattr(sys, "argv", ["calibration.py", "-o", str(tmp_path), "--seed", "3"])
    assert calibration_script.main() == 0
    assert {path.name for path in tmp_path.iterdir()} == set(PRODUCTS)
    assert {path.read_bytes()[:4] for path in tmp_path.glob("*.png")} == {b"\x89PNG"}
    verdicts = set(pd.read_csv(tmp_path / "calibration.csv").verdict)
    sets = pd.read_csv(tmp_path / "evidence_data_sets.csv")
    assert (verdicts, len(sets), sets[DEFAULT].notna().all()) == ({"inside"}, 4, True)
    assert "--studies 1 --data-sets 2 --seed 3" in (tmp_path / "calibration.md").read_text(
        encoding="utf-8"
    )
    assert calibration_script.main() == 2  # the folder is taken
    monkeypatch.setattr(type(table), "failures", ["made to fail"])
    monkeypatch.setattr(
        calibration_script, "write_calibration", lambda *_, overwrite: None
    )  # nor need all be drawn again
    monkeypatch.setattr(sys, "argv", [*sys.argv, "--overwrite"])
    assert calibration_script.main() == 3
    message = capsys.readouterr().out
    assert "The ranks of 16 of 16 rows are inside" in message
    assert "NOT calibrated: made to fail" in message
    assert "seed 3; results in" in message
