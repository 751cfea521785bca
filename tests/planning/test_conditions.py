"""Planning for conditions within subjects: what is simulated, what is counted, and how trials are split."""

import numpy as np
import pandas as pd
from commands import good, refused

from bayes_toe.planning.study_design import narrow_study_design

WIDE = narrow_study_design(np.linspace(-0.75, 1.25, 5), np.linspace(-0.3, 0.3, 5), 650)


def test_every_condition_has_every_trial_and_both_orders_in_every_block(tmp_path):
    WIDE.save(tmp_path / "design.csv")
    asked = (
        "design",
        "design.csv",
        "--list",
        "trials.csv",
        "--blocks",
        "5",
        "--seed",
        "1",
        "--conditions",
    )
    assert "1300 trials each in 5 blocks (650 in each of left, right, mixed" in " ".join(
        good(*asked, "left,right", cwd=tmp_path).split()
    )
    trials = pd.read_csv(tmp_path / "trials.csv")
    counts = trials[["block", "condition", "s1", "s2"]].value_counts()
    assert counts.groupby(["condition", "s1", "s2"]).sum().tolist() == [26] * 50
    assert set(counts.groupby(["block", "condition"]).sum()) <= set(range(120, 141))
    assert len(set(counts)) <= 2, "a pair is as often in one block as in another, up to one"
    assert len(set(trials.condition[:20])) > 1, "conditions are mixed"
    assert "--conditions: allowed with --list" in refused(
        "design", "design.csv", "--conditions", "a,b", cwd=tmp_path
    )
