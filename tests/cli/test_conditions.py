"""A results folder of a study with a condition within subjects."""

import numpy as np
import pandas as pd

import bayes_toe as bt
from bayes_toe.cli.methods import read_methods, write_text
from bayes_toe.cli.results_folder import Drawn, write_results


def test_a_run_has_the_contrast_in_its_folder_report_and_methods(tmp_path):
    rng, s = np.random.default_rng(1), np.array([(a, a + step) for a in (0.0, 0.3, 0.6) for step in (-0.3, 0.3)])
    rows = []
    for level, offset in (("left", 0.12), ("right", -0.12)):
        p = 1.0 / (1.0 + np.exp(-(s[:, 1] - s[:, 0] - offset) / 0.12))
        told = {"subject": "A", "condition": level, "s1": s[:, 0], "s2": s[:, 1], "n_trials": 60}
        rows.append(pd.DataFrame({**told, "n_second": rng.binomial(60, p)}))
    analysis = bt.run(bt.read_study(pd.concat(rows)), draws=100, seed=1, workers=1)
    folder = write_results(analysis, tmp_path / "results", pictures=Drawn("none"), workers=1)
    assert pd.read_csv(folder / "contrast.csv").groupby("quantity")["word"].first()["constant error"] == "differs"
    for name in ("evidence.csv", "summary.csv"):
        assert pd.read_csv(folder / name)[["subject", "condition"]].drop_duplicates().to_numpy().tolist() == [["A", "left"], ["A", "right"]]
    report, methods = ((folder / name).read_text(encoding="utf-8") for name in ("report.html", "methods.md"))
    assert 'id="conditions"' in report
    assert "constant error, of 1 subject: differs 1" in report
    assert "right - left: constant error −0." in report
    assert "**Conditions.**" in methods
    assert "1 subject gave 720 judgements" in methods
    write_text(read_methods(folder), again := tmp_path / "methods.md")
    assert again.read_text(encoding="utf-8") == methods
    draws = bt.load(folder / "posterior.nc")
    assert draws.study.conditions == analysis.study.conditions
    assert draws.subject("A@left").felt == analysis.study["A@left"].felt
