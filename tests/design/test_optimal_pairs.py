"""Optimised designs and their information, against finite differences and brute force."""

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pandas as pd
import pytest
from commands import refusal_of, run_ok
from conftest import columns, each_row

import bayes_toe as bt
from bayes_toe.data.tasks import SAME_DIFFERENT, THREE_ANSWERS
from bayes_toe.design.information import AIMS, exchange_trials, information
from bayes_toe.design.observers import assume_observers, make_observer
from bayes_toe.design.optimal_pairs import (
    EVEN,
    OPTIMISED,
    DesignGoal,
    best_design,
    grid,
    optimal_design,
    read_levels,
)
from bayes_toe.design.study_design import StudyDesign, each_once
from bayes_toe.model.observer import DEFAULT_PRIOR

WIDE = grid(-0.75, 1.25, 0.25)
FIXED_PAIRS = StudyDesign([0.0, 0.33], [0.0, 0.33], [25, 30])
PAIRS = each_once([-0.75, -0.75, 0.25, 1.25, 1.25], [-0.6, -0.3, 0.5, 0.9, 1.25])
#: Two observers, because the calculation is quick, and designs hardly depend on their number.
OBSERVERS = assume_observers("both", size=2, seed=1, designs=[PAIRS])


def information_about(aim, observers=OBSERVERS, pairs=PAIRS):
    """The information of trials of the pairs about what a design is made for."""
    return information(pairs, observers, aim, DEFAULT_PRIOR)


@pytest.fixture(scope="module")
def result():
    """A design of 650 trials that is optimised for observers with a contraction."""
    return optimal_design(WIDE, 650, observers="contraction", data_sets=2, seed=1)


def test_information_is_the_expected_square_of_the_slopes():
    """The outer products of rows add up to the information: a row is dP/d parameter / sqrt(P).

    Each pair has a row for each answer, whose probability is P. The slopes are computed by
    differences. P(different) is 1 - P(equal), and has the opposite
    slopes. The last two columns of a row are those of c, in units of D/2, and of p, in units of
    1/4.
    """
    base = {"noise": 0.2, "q0": 0.9, "lapse_rate": 0.04, "constant_error": 0.1, "contraction": 0.2}
    task = PAIRS.task
    sbar = float(PAIRS.s1.mean())

    def p_equal_with(name, change):
        """P(equal) of each pair where a parameter is larger by `change`."""
        changed = make_observer("name", "kind", {**base, name: base[name] + change}, task)
        [p_of_question] = changed.p_questions(PAIRS.s1, PAIRS.s2, sbar)  # of the only question
        return p_of_question

    observer = make_observer("name", "kind", base, task)
    # The rows of the only observer for PAIRS: (pairs, answers, coordinates).
    [rows] = information_about("order-effect", [observer], PAIRS).rows
    p_equal = p_equal_with("noise", 0.0)  # of the unchanged observer
    units = {"constant_error": PAIRS.unanswered.scales.step / 2, "contraction": 0.25}
    by_parameter = rows[:, :, -2:].T  # (c and p, answers, pairs)
    for (name, unit), (equal, different) in zip(units.items(), by_parameter, strict=True):
        slope = (p_equal_with(name, 1e-6) - p_equal_with(name, -1e-6)) / 2e-6 * unit
        assert equal == pytest.approx(slope / np.sqrt(p_equal), rel=1e-5)
        assert different == pytest.approx(-slope / np.sqrt(1 - p_equal), rel=1e-5)


@pytest.mark.parametrize("task", [SAME_DIFFERENT, THREE_ANSWERS])
@pytest.mark.parametrize("aim", AIMS)
def test_more_trials_of_a_pair_are_worth_what_the_changed_design_is(aim, task):
    observers = [replace(observer, task=task) for observer in OBSERVERS]
    aim_information = information_about(aim, observers, replace(PAIRS, task=task))
    n = np.array([30, 40, 20, 10, 5])  # trials of each pair
    utilities = aim_information.utilities(n, n_more=7)  # of each pair in turn
    changed = [aim_information.utility(n + added) for added in 7 * np.eye(5, dtype=int)]
    assert utilities == pytest.approx(changed, rel=1e-9)


@pytest.mark.parametrize("aim", AIMS)
def test_brute_force_finds_nothing_better_than_exchange(aim):
    """Five pairs, ten portions of four trials: every way to distribute them."""
    aim_information = information_about(aim)
    turned_index = np.arange(5)  # No pair has its other order: each pair stands for itself.
    n_trials = exchange_trials(
        aim_information,
        trials=40,
        most_pairs=5,
        fixed=np.zeros(5, np.int64),
        turned=turned_index,
    )
    assert n_trials.sum() == 40
    utilities = []
    for portions in combinations_with_replacement(range(5), 10):
        counts = 4 * np.bincount(portions, minlength=5)
        utilities.append(aim_information.utility(counts))
    # Exchange may stop at a local maximum. A utility lower by .02 nat costs 2 % of precision.
    assert aim_information.utility(n_trials) == pytest.approx(max(utilities), abs=0.02)


def test_an_optimised_design_shows_a_contraction(result):
    design = result.design
    assert design.total == 650
    assert design.n_pairs <= 26  # the default of max_pairs
    assert list(result.designs) == [OPTIMISED, EVEN]
    # The share of observers with a contraction whose contraction is detected.
    share = result.power[OPTIMISED, 650, "contraction", "contraction", "yes or probably"]
    assert share.value == 1.0
    # Both orders have as many trials.
    n_by_pair = dict(zip(design.pairs, design.n_trials.tolist(), strict=True))
    for (s1, s2), n_trials in n_by_pair.items():
        assert n_by_pair[s2, s1] == n_trials
    assert result.reasons()[0].startswith("Most trials have these first stimuli: -0.75 ln (")


def test_pairs_that_cannot_show_a_contraction_are_named():
    levels = grid(0, 0.1, 0.05)  # half of the noise of the observers
    result = optimal_design(levels, 100, observers="none", data_sets=1, seed=1)
    assert any("cannot show a contraction" in line for line in result.reasons())


def test_pairs_that_are_kept_stay_and_there_are_no_more_than_asked():
    # Two pairs of equal stimuli are kept.
    goal = DesignGoal("contraction", max_pairs=6, keep=FIXED_PAIRS)
    design = best_design(WIDE, 200, goal, OBSERVERS)
    n_by_pair = dict(zip(design.pairs, design.n_trials.tolist(), strict=True))
    for pair, n_trials in zip(FIXED_PAIRS.pairs, FIXED_PAIRS.n_trials, strict=True):
        assert n_by_pair[pair] >= n_trials
    assert design.total == 200
    assert design.n_pairs <= 6


def test_pairs_that_are_kept_in_one_order_leave_room_for_few_others():
    """Four pairs are kept, and the design may have five or six."""
    keep = StudyDesign(*columns("0 0.2 2, 0 0.4 2, 0 0.6 2, 0.2 0.4 2"))  # s1, s2, trials
    levels = np.array([0.0, 0.2, 0.4, 0.6])
    for max_pairs in (5, 6):
        goal = DesignGoal(max_pairs=max_pairs, keep=keep)
        design = best_design(levels, 60, goal, OBSERVERS)
        assert design.total == 60
        assert design.n_pairs <= max_pairs


def test_a_design_of_which_is_stronger_may_have_an_odd_number_of_trials_and_has_its_task():
    # With an even number both orders of each pair could have equally many trials.
    goal = DesignGoal(task="2afc")
    pairs = each_once([0, 0.3], [0.3, 0], task=goal.task)
    observers = assume_observers("both", size=2, seed=1, designs=[pairs])
    design = best_design(WIDE, 201, goal, observers)
    assert design.total == 201
    assert design.task.yes == "second"


def test_levels_of_a_file_are_sorted_logs_over_the_reference_each_once(tmp_path):
    (tmp_path / "levels.csv").write_text("i\n2\n1\n4\n2\n")
    levels = read_levels(tmp_path / "levels.csv", bt.ReadOptions(intensity=2.0))
    assert levels == pytest.approx(np.log([0.5, 1.0, 2.0]))


def test_a_grid_has_both_ends_and_round_numbers():
    # A sum of 15 floats .05 is not .75 to the bit, so that 0 would have an error.
    assert grid(-0.75, 1.25, 0.05)[[0, 15, -1]].tolist() == [-0.75, 0.0, 1.25]


def test_the_command_writes_the_design_and_its_power(tmp_path):
    # The range has five levels, and two pairs are kept.
    FIXED_PAIRS.save(tmp_path / "kept.csv")
    screen = run_ok(
        "design -o d.csv --lowest -0.75 --highest 1.25 --step 0.5 --trials 200 --max-pairs 9 "
        "--for contraction --keep kept.csv --observers contraction --simulated 1 --seed 1",
        cwd=tmp_path,
    )
    assert "Optimised: observers with 'yes' or 'probably'" in screen
    files = {path.name for path in tmp_path.glob("d*")}
    assert files == {"d.csv", "d_compared.csv"}
    assert bt.design.read_study_design(tmp_path / "d.csv").total == 200


#: Options of `design`, and the message that refuses them. raw.csv has intensities without a unit,
#: and given.csv is a design.
REFUSED = """
    --lowest -1 --highest 1 --trials 3 | --trials 3: allowed is at least 4
    --lowest 1 --highest 1 | --lowest 1 --highest 1: allowed are finite numbers
    --lowest 0 --highest 1 --step 2 | --step 2: allowed is a step that makes 2 to 141 levels
    --lowest 0 --highest 1 --step 0.001 | type:  --step 0.00721  or a larger one
    --lowest 45 --highest 213 --unit um --step 0.5% | type:  --step 1.13%  or a larger one
    --lowest 0 --highest 1 --step five | --step five: allowed is a number above 0 in the unit
    --lowest 45 --highest 60 | type:  --unit a.u.
    --levels raw.csv | raw.csv: columns i are intensities without a unit
    --lowest 0 --highest 1 --even --keep given.csv | --even and --keep exclude each other.
    --lowest 0 | No range of stimuli is given. Use --lowest and --highest
    --lowest 0 --highest 1 --max-pairs 3 | --max-pairs: found 3, allowed: a whole number from 4
    --lowest 0 --highest 1 --for gain | --for: found 'gain', allowed: order-effect, constant
    given.csv | given.csv: a given design needs --list trials.csv, without options of the
    given.csv --list t.csv --max-pairs 4 | without options of the search such as --lowest
    given.csv --list t.csv --observers nobody | without options of the search such as --lowest
    given.csv --list t.csv --prior absent.toml | without options of the search such as --lowest
    given.csv --list t.csv --trials 60 | without options of the search such as --lowest, --trials
    --lowest 0 --highest 1 --list t.csv | need a design, as in bayes-toe design design.csv --list
"""


@each_row("options, message", REFUSED)
def test_what_cannot_be_designed_is_refused_in_one_line(tmp_path, options, message):
    (tmp_path / "raw.csv").write_text("i\n45\n60\n")
    FIXED_PAIRS.save(tmp_path / "given.csv")
    assert message in refusal_of(f"design -o d.csv {options} --simulated 1 --seed 1", cwd=tmp_path)


def test_a_study_in_um_is_planned_simulated_and_read_in_um(tmp_path):
    """One option says the unit in design, power, simulate and check."""
    options = "--unit um --seed 1 --overwrite"
    quick = f"{options} --simulated 2 --observers both"
    run_ok(f"design -o d.csv --lowest 45 --highest 213 --trials 60 --even {quick}", cwd=tmp_path)
    frame = pd.read_csv(tmp_path / "d.csv")
    assert (frame.i1.min(), frame.i1.max()) == (45.0, 213.0)
    # Pairs to keep and a list of trials have the same intensities.
    run_ok(
        f"design -o kept.csv --keep d.csv --trials 80 --lowest 45 --highest 213 {quick}",
        cwd=tmp_path,
    )
    run_ok("design kept.csv --list l.csv --unit um", cwd=tmp_path)
    assert pd.read_csv(tmp_path / "l.csv").i1.max() == 213.0
    # A file that is typed by hand has intensities alone, without their logarithms s1 and s2.
    frame[["i1", "i2", "n_trials"]].to_csv(tmp_path / "raw.csv", index=False)
    run_ok(f"power raw.csv --trials 60 -o power {quick}", cwd=tmp_path)
    line = f"simulate -o s.csv --design raw.csv --subjects 2 --trials 120 {options}"
    run_ok(f"{line} --observers both", cwd=tmp_path)
    screen = run_ok("check s.csv --unit um", cwd=tmp_path)
    assert "2 subjects, 240 trials" in screen
    assert "um" in screen


def test_other_observers_are_proposed_for_stimuli_far_from_those_of_the_paper(tmp_path):
    (tmp_path / "far.csv").write_text("s1,s2,n_trials\n4,4.2,60\n4.2,4,60\n")
    line = "simulate -o s.csv --design far.csv --observers paper --subjects 2 --seed 1"
    assert "type:  --observers both" in refusal_of(line, cwd=tmp_path)


def test_an_even_design_has_neighbours_over_the_whole_range():
    goal = DesignGoal(task="2afc", is_even=True)
    optimal = optimal_design(WIDE, 100, goal, "both", data_sets=1, seed=1)
    design = optimal.design
    levels = np.unique(design.s1)
    assert (levels[0], levels[-1]) == (-0.75, 1.25)
    assert set(design.pairs) == {(s2, s1) for s1, s2 in design.pairs}  # both orders
    assert np.abs(design.s2 - design.s1).max() == pytest.approx(np.diff(levels).max())
    assert not optimal.learnable  # no warning of regularities that subjects may learn


def test_an_even_design_of_uneven_levels_has_each_pair_once(tmp_path):
    """Otherwise the command that the screen proposes would refuse the file."""
    line = "design -o d.csv --lowest 45 --highest 213 --step 40 --unit um --even --trials 130"
    screen = run_ok(f"{line} --simulated 1 --seed 1", cwd=tmp_path)
    proposed = "power d.csv --task 2afc,same/different,ternary --trials 130"
    assert f"bayes-toe {proposed}" in " ".join(screen.split())
    run_ok(f"{proposed} --observers none --simulated 1 --seed 1", cwd=tmp_path)
