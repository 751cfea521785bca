"""The answers of the example agree with its truth."""

import numpy as np
import pandas as pd
import pytest

import bayes_toe as bt


@pytest.fixture(scope="module")
def analysis():
    """The bundled example, analysed as the documents do."""
    return bt.run(bt.example_study(), draws=100, seed=1, workers=1)


# --- The example's truth --------------------------------------------------------------------------

SIZES = {"constant_error": "pse_shift_percent", "contraction": "contraction_p"}


@pytest.fixture(scope="module")
def truth():
    """True effects in the unit of the answers, a row per subject."""
    effects = pd.DataFrame(bt.example_truth()).T[[*SIZES]]
    return effects.assign(constant_error=100.0 * np.expm1(effects["constant_error"]))


@pytest.mark.parametrize("effect", SIZES)
def test_words_and_sizes_of_the_example_agree_with_its_truth(analysis, truth, effect):
    answers = analysis.evidence.frame().set_index("subject")
    n_covered = 0
    for subject, true in truth[effect].items():
        answer = answers.loc[subject]
        low, median, high = (answer[f"{SIZES[effect]}_{q}"] for q in ("q025", "q50", "q975"))
        word = answer[effect].partition(" ")[0]
        if true == 0.0:
            assert answer[effect] in {"undecided", "probably not", "no"}, subject
        else:
            assert word in {"yes", "probably", "undecided"}, subject
            assert word == "undecided" or median * true > 0.0, subject
        n_covered += low <= true <= high
    assert n_covered >= 11


def test_the_order_effects_of_the_example_agree_with_its_truth(analysis, truth):
    words = analysis.evidence.frame().set_index("subject")["order_effect"]
    has_effect = (truth != 0.0).any(axis=1)
    assert set(words[has_effect]) <= {"yes", "probably", "undecided"}
    assert set(words[~has_effect]) <= {"undecided", "probably not", "no"}
    assert (words == "yes").sum() >= 8


def test_the_group_of_the_example_agrees_with_its_truth(analysis):
    group = analysis.group
    units = {"constant_error": group.scales.step, "contraction": 1.0}
    for effect, true in pd.DataFrame(bt.example_truth()).T[[*SIZES]].items():
        found = group.effect(effect)
        assert found.mean.low < true.mean() / units[effect] < found.mean.high
        assert found.sd.low < true.std() / units[effect] < found.sd.high
