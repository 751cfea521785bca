"""Optimised designs and the information they are chosen by: against sums over answers, brute force, and designs made anew."""

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pandas as pd
import pytest
from commands import good, refused
from conftest import plain_models_alone

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.model.ladder import model_named
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.planning.information import UTILITIES, exchanged, information
from bayes_toe.planning.observers import observers_from, of_kind
from bayes_toe.planning.optimal import (
    OPTIMISED,
    PAPER,
    DesignGoal,
    grid,
    optimal_design,
    proposed,
    read_levels,
)
from bayes_toe.planning.power import NAMED
from bayes_toe.planning.study_design import StudyDesign, each_once

WIDE = grid(-0.75, 1.25, 0.25)
KEPT = StudyDesign([0.0, 0.33], [0.0, 0.33], [25, 30])


@pytest.fixture(scope="module")
def found():
    with plain_models_alone():
        return optimal_design(WIDE, 650, seed=1, data_sets=1, workers=1)


def test_an_optimised_design_names_updates_and_the_papers_pairs_do_not(found):
    assert found.design.total == 650
    assert found.design.n_pairs <= 25
    assert np.isin(np.round([found.design.s1, found.design.s2], 9), np.round(WIDE, 9)).all()
    assert found.candidates[OPTIMISED].utility > max(
        one.utility for name, one in found.candidates.items() if name != OPTIMISED
    )
    assert found.power[OPTIMISED, 650, "update", NAMED].value == 1.0
    wrong = [
        row.judgement.named
        for row in found.power
        if row.design == OPTIMISED and row.kind != "update"
    ]
    assert "update" not in wrong
    assert (found.worth > 0).all()
    assert found.reasons[0].startswith("first stimuli, of most trials: -0.75 (")


@pytest.mark.parametrize("aim", UTILITIES)
def test_brute_force_finds_nothing_better_than_exchange(aim):
    """Five pairs, ten portions: every way to distribute them."""
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
    made = best(WIDE, 200, DesignGoal("parameters", max_pairs=6, keep=KEPT))[OPTIMISED].design
    counts = dict(zip(made.pairs, made.n_trials.tolist(), strict=True))
    assert (counts[0.0, 0.0] >= 25, counts[0.33, 0.33] >= 30, made.total, made.n_pairs <= 6) == (
        True,
        True,
        200,
        True,
    )


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


def test_the_command(found, tmp_path, monkeypatch):
    asked = []
    replace(KEPT, isi=[0.5, 2.0]).save(tmp_path / "kept.csv")
    monkeypatch.setattr(
        "bayes_toe.planning.optimal_design",
        lambda *given, **options: asked.append((*given, options)) or found,
    )
    words = (
        "--lowest",
        "-0.75",
        "--highest",
        "1.25",
        "--step",
        "0.25",
        "--data-sets",
        1,
        "--list",
        "t.csv",
        "--seed",
        1,
        "--workers",
        1,
    )
    said = good(
        "design",
        "-o",
        "d.csv",
        *words,
        "--max-pairs",
        9,
        "--for",
        "gain",
        "--isi",
        "0.5,2",
        "--keep",
        "kept.csv",
        cwd=tmp_path,
    )
    [(levels, trials, goal, observers, options)] = asked
    assert levels.tolist() == WIDE.tolist()
    assert (trials, goal.aim, goal.max_pairs, goal.isi, goal.keep.total, observers) == (
        650,
        "gain",
        9,
        (0.5, 2.0),
        55,
        None,
    )
    assert (options["data_sets"], options["seed"]) == (1, 1)
    assert sorted(path.name for path in tmp_path.glob("[dt]*")) == [
        "d.csv",
        "d.md",
        "d.png",
        "d_compared.csv",
        "t.csv",
    ]
    assert len(pd.read_csv(tmp_path / "t.csv")) == 650
    assert bt.planning.read_study_design(tmp_path / "d.csv").pairs == found.design.pairs
    assert set(pd.read_csv(tmp_path / "d_compared.csv").design) == {
        OPTIMISED,
        PAPER,
        "full factorial",
        "random pairs",
    }
    text = (tmp_path / "d.md").read_text(encoding="utf-8")
    assert text.startswith("# A design of 650 trials, for: update\n\n* first stimuli")
    assert all(line in " ".join(said.split()) and line in text for line in found.said())


FROM_0, WIDE_RANGE = ("--lowest", "0", "--highest"), ("--lowest", "-0.75", "--highest", "1.25")
REFUSED = [
    (
        (*FROM_0, "0.05", "--step", "0.01", "--trials", "50"),
        "50 trials between 0 and 0.05 tell next to nothing: first stimuli 0.05",
    ),
    ((*FROM_0, "0.05", "--for", "gain"), "(the sd of gain falls from"),
    ((*WIDE_RANGE, "--trials", "3"), "--trials 3: allowed is at least 4 to distribute"),
    (
        ("--lowest", "1", "--highest", "1"),
        "--lowest 1 --highest 1: allowed are finite numbers, the first the smaller one",
    ),
    ((*FROM_0, "1", "--step", "2"), "--step 2: allowed is above 0 and at most the range, 1"),
    ((*FROM_0, "1", "--step", "0.001"), "1001 levels make 1,002,001 pairs: allowed are 20,000"),
    (("--lowest", "0"), "allowed: --lowest and --highest, natural-log intensity, or --levels"),
    ((*FROM_0, "1", "--max-pairs", "3"), "--max-pairs 3: allowed is at least 4"),
    (
        (*FROM_0, "1", "--for", "luck"),
        "--for: found 'luck', allowed: update, gain, mu1, width, parameters",
    ),
    (
        (*FROM_0, "1", "--intensity", "2"),
        "--intensity: allowed with --levels levels.csv, or with --list",
    ),
    (
        ("--levels", "l.csv", "--intensity", "-1"),
        "--intensity: found -1.0, allowed: a positive finite number",
    ),
    (("given.csv",), "given.csv: allowed with --list trials.csv, and without --lowest"),
    ((*FROM_0, "1", "--isi", "-1"), "--isi: found '-1', allowed: positive numbers of seconds"),
]


@pytest.mark.parametrize(("more", "said"), REFUSED)
def test_what_cannot_tell_anything_is_refused_in_one_line_with_the_reason(
    tmp_path, three_models, more, said
):
    assert said in refused(
        "design", "-o", "d.csv", *more, "--data-sets", "1", "--seed", "1", cwd=tmp_path
    )


PAIRS = each_once([-0.5, 0.0, 0.7, 1.1, 0.2], [-0.2, 0.0, 0.5, 0.6, 1.9])


@pytest.fixture(scope="module")
def observers():
    return observers_from(None, 3, seed=2)


def test_information_is_the_expected_product_of_slopes(observers):
    one, design = of_kind(observers, "update")[1], each_once(PAIRS.s1, PAIRS.s2)
    target = Posterior(
        design.unanswered,
        model_named("update + sloped + both ways"),
        Prior(),
        one.centre,
        one.interval,
    )
    known = {"lapse_rate": 0.02, "noise_slope": 0.0, **one.quantities}
    x = target.points({name: np.array([known[name]]) for name in target.names.natural})
    step, k = 1e-5, x.shape[1]
    slopes = [
        (np.stack(target.log_answers(x + e)) - np.stack(target.log_answers(x - e)))[:, 0]
        / (2 * step)
        for e in step * np.eye(k)
    ]
    slopes, q = np.stack(slopes, axis=1), np.exp(target.log_answers(x)[0][0])  # (2, k, pairs)
    pull = target.quantities(x)["pull"][0]
    scale = np.ones(k)
    scale[1] = pull * (1 - pull / 0.3819660112501051)  # the pull itself in the place of its logit
    rows = information(PAIRS, observers, "gain", Prior()).rows[1]
    expected = np.einsum("aj,aij,alj->jil", [q, 1 - q], slopes, slopes) / np.outer(scale, scale)
    assert np.einsum("ji,jl->jil", rows, rows) == pytest.approx(expected, rel=1e-5, abs=1e-9)


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
    pairs = each_once(
        np.repeat([-0.75, 0.25, 1.25], 4),
        [-0.7, -0.4, -0.2, 0.1, 0.0, 0.2, 0.4, 0.7, 0.6, 0.8, 1.0, 1.3],
    )
    found = information(pairs, [one], "gain", Prior())
    n = np.full(12, 60)
    total = found.total(n.astype(float))
    q, rng = one.p_yes(StudyDesign(pairs.s1, pairs.s2, n)), np.random.default_rng(0)
    q = (
        q * (1 - 0.02) + 0.02 * one.quantities["q0"]
    )  # lapses both ways, as the information has them
    counts = rng.binomial(n, q, (20_000, 12))
    scores = (counts - n * q) / np.sqrt(q * (1 - q)) @ found.rows[0]
    data = total[0] - found.prior[0]
    assert scores.T @ scores / 20_000 == pytest.approx(
        data, rel=0.05, abs=0.05 * np.abs(data).max()
    )
    steps = scores @ np.linalg.inv(data) @ found.direction[0]
    alone = found.direction[0] @ np.linalg.inv(data) @ found.direction[0]
    assert steps.var() == pytest.approx(alone, rel=0.05)
    assert found.variance(total)[0] <= alone


def test_who_does_not_update_counts_for_naming_alone(observers):
    gain, update = (
        information(PAIRS, observers, aim, Prior()).updates for aim in ("gain", "update")
    )
    assert (gain.tolist(), update.sum(), len(update)) == ([True] * 3, 3, 9)
    with pytest.raises(InputError, match="found nobody with a predictive update"):
        information(PAIRS, of_kind(observers, "none"), "update", Prior())
