"""The script of an adaptive session."""

import sys

import adaptive_session

import bayes_toe as bt


def test_a_session_is_saved_goes_on_and_leaves_a_study(tmp_path, monkeypatch, capsys):
    for trials in (3, 6):
        monkeypatch.setattr(sys, "argv", ["x", str(tmp_path / "a.json"), "--trials", str(trials), "--simulate", "--subject", "P7"])
        assert adaptive_session.main() == 0
        assert "P(predictive update) = " in capsys.readouterr().out
        study = bt.read_study(tmp_path / "a.csv")
        assert (study.names, study["P7"].total_trials) == (("P7",), trials)
    assert bt.planning.Adaptive.resume(tmp_path / "a.json").trials == 6
