"""A new user reads a study after at most two refusals, by typing what they print."""

import math

import first_hour
import pytest

import bayes_toe as bt


@pytest.mark.parametrize(
    "write",
    [first_hour.psychopy_file, first_hour.psychopy_folder, first_hour.german_file],
    ids=lambda write: write.__name__,
)
def test_a_study_is_read_after_at_most_two_refusals(write, tmp_path):
    refusals, answer = first_hour.first_hour(tmp_path, write(tmp_path))
    assert 1 <= len(refusals) <= first_hour.MOST_REFUSALS, refusals
    assert "6 subjects, 1,439 trials, which was stronger (2AFC), 24" in " ".join(answer.split())
    assert "No subject needs a decision." in answer
    assert "6 rows left out as practice" in answer
    assert "1 trial without a response dropped: VP03 1." in answer


def test_the_trials_that_were_made_are_those_that_are_read(tmp_path):
    """Direction too: 'second' is counted by pair in the order of presentation."""
    columns = {"standard": "amp_standard", "comparison": "amp_comparison"}
    options = bt.ReadOptions(columns=columns, unit="um", standard_interval="order", second_code="j")
    study = bt.read_study(tmp_path / first_hour.psychopy_file(tmp_path), options)
    counts = [0, 0]
    for trial in first_hour.made_up_trials():
        is_counted = trial["part"] == "main" and trial["key"] != "None"
        pair_shown = trial["standard"], trial["comparison"], trial["is_standard_first"]
        if is_counted and pair_shown == (60.0, 0.75 * 60.0, False):
            counts[0] += trial["key"] == "j"
            counts[1] += 1
    frame = study.frame()
    pair = frame[(frame.s1 < math.log(46)) & (frame.s2 > math.log(59)) & (frame.s2 < math.log(61))]
    assert [pair.n_second.sum(), pair.n_trials.sum()] == counts
    assert "trial" in study.reading.read


def test_raw_micrometres_are_refused_with_a_unit(tmp_path):
    refusals, _ = first_hour.first_hour(tmp_path, first_hour.logs_by_mistake(tmp_path))
    (_, message), *_ = refusals
    assert "type:  --unit" in message
