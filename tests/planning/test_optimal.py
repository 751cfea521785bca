"""Optimised designs and the information they are chosen by: against sums over answers, brute force, and designs made anew."""

import numpy as np
import pandas as pd
import pytest
from commands import good, refused
from conftest import plain_models_alone

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.model.prior import Prior
from bayes_toe.planning.information import UTILITIES, exchanged, information
from bayes_toe.planning.observers import observers_from, of_kind
from bayes_toe.planning.optimal import OPTIMISED, PAPER, DesignGoal, grid, optimal_design, proposed, read_levels
from bayes_toe.planning.power import NAMED
from bayes_toe.planning.study_design import StudyDesign, each_once

WIDE = grid(-0.75, 1.25, 0.25)


@pytest.fixture(scope="module")
def found():
    with plain_models_alone():
        return optimal_design(WIDE, 650, seed=1, data_sets=1, workers=1)


def test_an_optimised_design_names_updates_and_the_papers_pairs_do_not(found):
    assert found.design.total == 650
    assert found.design.n_pairs <= 25
    assert np.isin(np.round([found.design.s1, found.design.s2], 9), np.round(WIDE, 9)).all()
    assert found.candidates[OPTIMISED].utility > max(one.utility for name, one in found.candidates.items() if name != OPTIMISED)
    assert found.power[OPTIMISED, 650, "update", NAMED].value == 1.0
    wrong = [row.judgement.named for row in found.power if row.design == OPTIMISED and row.kind != "update"]
    assert "update" not in wrong
    assert found.reasons[0].startswith("first stimuli, of most trials: -0.75 (")


@pytest.mark.parametrize("aim", UTILITIES)
def test_brute_force_finds_nothing_better_than_exchange(aim):
    """Five pairs, ten portions: every way to distribute them."""
    from itertools import combinations_with_replacement

    pairs = each_once([-0.75, -0.75, 0.25, 1.25, 1.25], [-0.6, -0.3, 0.5, 0.9, 1.25])
    known = information(pairs, observers_from(None, 4, seed=1), aim, Prior())
    found = exchanged(known, 50, 5, np.zeros(5, np.int64), np.arange(5))  # in portions of 5
    assert found.sum() == 50
    ways = (np.bincount(way, minlength=5) for way in combinations_with_replacement(range(5), 10))
    score = [known.score(known.total(counts)) for counts in (found, *(5 * way for way in ways))]
    assert score[0] == pytest.approx(max(score[1:]), abs=0.02)


def best(levels, trials, goal):
    return proposed(levels, trials, goal, observers_from(None, 3, seed=1), seed=1)[0]


def test_pairs_that_are_kept_stay_and_there_are_no_more_than_asked():
    keep = bt.planning.StudyDesign([0.0, 0.33], [0.0, 0.33], [25, 30])
    made = best(WIDE, 200, DesignGoal("parameters", max_pairs=6, keep=keep))[OPTIMISED].design
    counts = {(a, b): n for a, b, n in zip(made.s1.tolist(), made.s2.tolist(), made.n_trials.tolist(), strict=True)}
    assert (counts[0.0, 0.0] >= 25, counts[0.33, 0.33] >= 30, made.total, made.n_pairs <= 6) == (True, True, 200, True)


def test_the_papers_own_range_is_never_worse_than_the_papers_pairs():
    levels = np.log([1.0, 1.15, 1.36, 1.55, 1.66])
    for aim in ("gain", "update", "parameters"):
        made = best(levels, 650, DesignGoal(aim))
        assert made[OPTIMISED].utility >= made[PAPER].utility - 1e-9


def test_intervals_may_be_chosen():
    found = best(grid(-0.75, 1.25, 0.5), 200, DesignGoal("gain", isi=(0.5, 2.0)))
    made = found[OPTIMISED].design
    assert set(made.isi) <= {0.5, 2.0}
    rivals = [one.design for name, one in found.items() if name != OPTIMISED]
    assert len(rivals) == 3
    assert all(set(one.isi) == {0.5, 2.0} for one in rivals)


def test_levels_of_hardware(tmp_path):
    (tmp_path / "levels.csv").write_text("i\n2\n1\n4\n2\n", encoding="utf-8")
    assert read_levels(tmp_path / "levels.csv", 2.0) == pytest.approx(np.log([0.5, 1.0, 2.0]))
    with pytest.raises(InputError, match="column s: missing"):
        read_levels(tmp_path / "levels.csv")
    assert grid(-0.75, 1.25, 0.05)[[0, 15, -1]].tolist() == [-0.75, 0.0, 1.25]


def test_the_command(tmp_path, three_models):
    range_ = ("--lowest", "-0.75", "--highest", "1.25", "--step", "0.25")
    asked = ("--trials", 100, "--data-sets", 1, "--list", "t.csv", "--seed", 1, "--workers", 1)
    good("design", "-o", "d.csv", *range_, *asked, cwd=tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["d.csv", "d.md", "d.png", "d_compared.csv", "t.csv"]
    assert len(pd.read_csv(tmp_path / "t.csv")) == 100
    assert bt.planning.read_study_design(tmp_path / "d.csv").total == 100
    assert set(pd.read_csv(tmp_path / "d_compared.csv").design) >= {OPTIMISED, PAPER, "full factorial", "random pairs"}
    assert (tmp_path / "d.md").read_text(encoding="utf-8").startswith("# A design of 100 trials, for: update\n\n* first stimuli")


FROM_0, WIDE_RANGE = ("--lowest", "0", "--highest"), ("--lowest", "-0.75", "--highest", "1.25")
REFUSED = [
    ((*FROM_0, "0.05", "--step", "0.01"), "650 trials between 0 and 0.05 tell next to nothing: first stimuli 0.05"),
    ((*FROM_0, "0.05", "--for", "gain"), "(the sd of gain falls from"),
    ((*WIDE_RANGE, "--trials", "3"), "--trials 3: allowed is at least 4 to distribute"),
    (("--lowest", "1", "--highest", "1"), "--lowest 1 --highest 1: allowed are finite numbers, the first the smaller one"),
    ((*FROM_0, "1", "--step", "2"), "--step 2: allowed is above 0 and at most the range, 1"),
    ((*FROM_0, "1", "--step", "0.001"), "1001 levels make 1,002,001 pairs: allowed are 20,000"),
    (("--lowest", "0"), "allowed: --lowest and --highest, natural-log intensity, or --levels"),
    ((*FROM_0, "1", "--max-pairs", "3"), "--max-pairs 3: allowed is at least 4"),
    ((*FROM_0, "1", "--for", "luck"), "--for: found 'luck', allowed: update, gain, mu1, width, parameters"),
    ((*FROM_0, "1", "--intensity", "2"), "--intensity: allowed with --levels levels.csv, or with --list"),
    (("--levels", "l.csv", "--intensity", "-1"), "--intensity: found -1.0, allowed: a positive finite number"),
    (("given.csv",), "given.csv: allowed with --list trials.csv, and without --lowest"),
    ((*FROM_0, "1", "--isi", "-1"), "--isi: found '-1', allowed: positive numbers of seconds"),
]


@pytest.mark.parametrize(("more", "said"), REFUSED)
def test_what_cannot_tell_anything_is_refused_in_one_line_with_the_reason(tmp_path, more, said):
    assert said in refused("design", "-o", "d.csv", *more, "--data-sets", "1", "--seed", "1", cwd=tmp_path)


PAIRS = each_once([-0.5, 0.0, 0.7, 1.1, 0.2], [-0.2, 0.0, 0.5, 0.6, 1.9])


@pytest.fixture(scope="module")
def observers():
    return observers_from(None, 3, seed=2)


def test_information_is_the_expected_product_of_slopes(observers):
    from bayes_toe.model.ladder import model_named
    from bayes_toe.model.posterior import Posterior

    found = information(PAIRS, observers, "gain", Prior())
    one = of_kind(observers, "update")[1]
    design = StudyDesign(PAIRS.s1, PAIRS.s2, np.ones(5, int))
    target = Posterior(design.unanswered, model_named("update + sloped + both ways"), Prior(), one.centre, one.interval)
    x = target.points({name: np.array([{"lapse_rate": 0.02, "noise_slope": 0.0, **one.quantities}[name]]) for name in target.names.natural})
    step, k = 1e-5, x.shape[1]
    slopes = np.stack([(target.log_answers(x + e)[0] - target.log_answers(x - e)[0])[0] / (2 * step) for e in step * np.eye(k)])
    rest = np.stack([(target.log_answers(x + e)[1] - target.log_answers(x - e)[1])[0] / (2 * step) for e in step * np.eye(k)])
    q = np.exp(target.log_answers(x)[0][0])
    pull = target.quantities(x)["pull"][0]
    scale = np.ones(k)
    scale[1] = pull * (1 - pull / 0.3819660112501051)  # the pull itself in the place of its logit
    for j, place in enumerate(np.lexsort((PAIRS.s2, PAIRS.s1))):
        expected = q[j] * np.outer(slopes[:, j], slopes[:, j]) + (1 - q[j]) * np.outer(rest[:, j], rest[:, j])
        rows = found.rows[1, place]
        assert np.outer(rows, rows) == pytest.approx(expected / np.outer(scale, scale), rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("aim", UTILITIES)
def test_a_change_is_worth_what_the_changed_design_is(observers, aim):
    found = information(PAIRS, observers, aim, Prior())
    n = np.array([30.0, 40.0, 20.0, 10.0, 5.0])
    more = found.scores(found.total(n), 7.0)
    anew = [found.score(found.total(n + 7.0 * np.eye(5)[j])) for j in range(5)]
    assert more == pytest.approx(anew, rel=1e-9)


def test_the_expected_sd_is_that_of_maximum_likelihood_over_simulated_data(observers):
    """The mean square of Newton's first steps from the truth: scores whitened by the information, a brute-force variance."""
    one = of_kind(observers, "update")[0]
    pairs = each_once(np.repeat([-0.75, 0.25, 1.25], 4), [-0.7, -0.4, -0.2, 0.1, 0.0, 0.2, 0.4, 0.7, 0.6, 0.8, 1.0, 1.3])
    found = information(pairs, [one], "gain", Prior())
    n = np.full(12, 60)
    total = found.total(n.astype(float))
    q, rng = one.p_yes(StudyDesign(pairs.s1, pairs.s2, n)), np.random.default_rng(0)
    q = q * (1 - 0.02) + 0.02 * one.quantities["q0"]  # lapses both ways, as the information has them
    counts = rng.binomial(n, q, (20_000, 12))
    scores = (counts - n * q) / np.sqrt(q * (1 - q)) @ found.rows[0]
    data = total[0] - found.prior[0]
    assert scores.T @ scores / 20_000 == pytest.approx(data, rel=0.05, abs=0.05 * np.abs(data).max())
    steps = scores @ np.linalg.inv(data) @ found.direction[0]
    alone = found.direction[0] @ np.linalg.inv(data) @ found.direction[0]
    assert steps.var() == pytest.approx(alone, rel=0.05)
    assert found.variance(total)[0] <= alone


def test_who_does_not_update_counts_for_naming_alone(observers):
    assert information(PAIRS, observers, "gain", Prior()).updates.tolist() == [True] * 3
    assert information(PAIRS, observers, "update", Prior()).updates.sum() == 3
    assert len(information(PAIRS, observers, "update", Prior()).updates) == 9


def test_refusals(observers):
    with pytest.raises(InputError, match="found nobody with a predictive update"):
        information(PAIRS, of_kind(observers, "none"), "update", Prior())
