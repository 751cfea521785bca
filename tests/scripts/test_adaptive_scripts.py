"""The scripts about adaptive sessions, without the other programs."""

import sys

import adaptive_peers
import adaptive_session
import numpy as np

import bayes_toe as bt
from bayes_toe.planning.observers import observers_from


def test_a_session_is_saved_goes_on_and_leaves_a_study(tmp_path, monkeypatch, capsys):
    for trials in (3, 6):
        monkeypatch.setattr(sys, "argv", ["x", str(tmp_path / "a.json"), "--trials", str(trials), "--simulate", "--subject", "P7"])
        assert adaptive_session.main() == 0
        assert "P(predictive update) = " in capsys.readouterr().out
        study = bt.read_study(tmp_path / "a.csv")
        assert (study.names, study["P7"].total_trials) == (("P7",), trials)
    assert bt.Adaptive.resume(tmp_path / "a.json").trials == 6


def test_the_comparison_tells_what_was_chosen_and_how_long_it_took():
    observer = observers_from(None, 1, seed=1)[-1]
    row = adaptive_peers.played(adaptive_peers.Chance, observer, 5, seed=1)
    assert (row["program"], row["trials"]) == ("random pairs", 5)
    assert 0.0 < row["median_ms"] <= row["largest_ms"]
    assert adaptive_peers.truth(observer)["mu1"] == observer.quantities["mu1"]
    q = adaptive_peers.p_equal(0.0, 0.2, 0.5, 0.3, 0.3, 0.9)
    assert np.isclose(q, 0.9 * 2.0 ** -(((0.2 - 0.3 * 0.5) / 0.3) ** 2))
