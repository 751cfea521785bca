"""Whether presets conclude alike: re-weighted evidences against fresh ones, words, and a study without scale."""

import pytest

import bayes_toe as bt
from bayes_toe.comparison.reweighting import UnderPresets, say_presets


@pytest.fixture(scope="module")
def study():
    return bt.example_study().select(["S01", "S05"])


@pytest.fixture(scope="module")
def analysis(study):
    return bt.run(study, draws=300, seed=2, workers=1)


def test_each_preset_gives_what_a_run_with_it_gives(study, analysis):
    fresh = bt.evidence(study, prior="stimuli", seed=9, workers=1)
    for one in analysis.presets:
        assert one.orders["paper"] == pytest.approx(analysis.evidence[one.subject].log_evidence_orders, abs=0.01)  # smoothed, else the same
        # Standard errors are below 0.005 each; a re-weighted one may have a few times as much.
        assert one.orders["stimuli"] == pytest.approx(fresh[one.subject].log_evidence_orders, abs=0.06)


def test_who_differs_is_said():
    same, other = (
        UnderPresets(name, {"paper": (0.0, -3.0, -3.0), "stimuli": found}) for name, found in (("A", (0.0, -2.0, -9.0)), ("B", None))
    )
    assert not same.differ
    assert say_presets([same]) == ("the presets --prior paper and --prior stimuli say the same of everybody's order effect",)
    assert say_presets([same, other]) == ("B: no order effect (P = 0.91) under --prior paper, no estimate under --prior stimuli",)


def test_a_study_of_equal_pairs_has_no_scale_and_is_analysed_all_the_same():
    one = bt.Subject("E", [0.0, 0.3], [0.0, 0.3], [40, 38], [50, 50])
    assert bt.run(bt.Study([one]), draws=300, seed=1, workers=1).presets == ()
