"""Simulated studies: designs, populations, seeds."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.experiments.recipes import design_from, population_from, trial_frame
from bayes_toe.experiments.simulate import Design, full_design, paper_population, reference_design, simulate_trials
from bayes_toe.model.coordinates import Natural


def test_the_papers_design():
    design = reference_design()
    assert len(design.s1) == 13
    assert (design.s1 == design.s2).sum() == 5
    pairs = set(zip(design.s1, design.s2, strict=True))
    assert len(pairs) == 13
    assert all((b, a) in pairs for a, b in pairs)
    assert np.exp(np.unique(design.s1)) == pytest.approx([1.0, 1.15, 1.36, 1.55, 1.66])
    assert design.batches == 50


def test_full_design_has_every_ordered_pair():
    assert len(set(zip(*(lambda d: (d.s1, d.s2))(full_design([1, 2, 3])), strict=True))) == 9


def test_every_batch_holds_every_pair_once_in_random_order():
    one = Natural(*(np.array([v]) for v in (0.0, 0.3, 0.1, 0.9)))
    [trials] = simulate_trials(["S"], one, reference_design(batches=20), seed=1)
    orders = set()
    for batch in range(1, 21):
        at = trials.batch == batch
        pairs = list(zip(trials.s1[at], trials.s2[at], strict=True))
        assert len(set(pairs)) == 13
        orders.add(tuple(pairs))
    assert len(orders) == 20


def test_answers_follow_the_model():
    observer = Natural(*(np.array([v]) for v in (-0.6, 0.25, 0.15, 0.9)))
    [trials] = simulate_trials(["S"], observer, reference_design(batches=20_000), seed=2)
    subject = bt.Subject.from_trials("S", trials.s1, trials.s2, trials.equal)
    q = bt.model.equal_probability(subject.s1, subject.s2, -0.6, 0.25, 0.15, 0.9)
    z = (subject.n_equal / 20_000 - q) / np.sqrt(q * (1 - q) / 20_000)
    assert np.abs(z).max() < 4.2  # 13 normals: false alarms below 4 in 10,000


def test_a_subjects_answers_do_not_depend_on_the_others():
    population = paper_population(4, np.random.default_rng(0))
    together = simulate_trials(["a", "b", "c", "d"], population, reference_design(batches=3), seed=5)
    alone = simulate_trials(["c"], Natural(*(v[2:3] for v in population)), reference_design(batches=3), seed=5)
    assert np.array_equal(together[2].equal, alone[0].equal)


def test_the_paper_population_shows_its_three_kinds():
    theta = paper_population(400, np.random.default_rng(1))
    assert ((theta.gamma > 0) & (theta.gamma < 1)).all()
    r, c = 0.0, np.log(1.55)
    asymmetry = bt.model.equal_probability(c, r, *theta) - bt.model.equal_probability(r, c, *theta)
    kinds = np.arange(400) % 5
    usual = np.arange(400) % 16 != 15
    assert (asymmetry[(kinds == 0) & usual] > 0).all()
    assert (asymmetry[(kinds == 1) & usual] < 0).all()
    assert np.abs(asymmetry[(kinds == 2) & usual]).mean() < 0.5 * np.abs(asymmetry[(kinds == 1) & usual]).mean()


def _asymmetry_sign(subject):
    """Sign of the largest difference between 'equal' answers to (c, r) and to (r, c)."""
    equal = {(a, b): k / n for a, b, k, n in zip(subject.s1, subject.s2, subject.n_equal, subject.n_trials, strict=True)}
    return np.sign(max((equal[b, a] - equal[a, b] for a, b in equal if a < b), key=abs))


def test_the_bundled_study_looks_like_the_papers():
    # Paper, Results: overall accuracy from 59 % to 78 %; 6 of 16 with positive maximal asymmetry, 10 with negative.
    signs = []
    for subject in bt.example_study():
        right = np.where(subject.s1 == subject.s2, subject.n_equal, subject.n_trials - subject.n_equal)
        assert 0.55 < right.sum() / subject.total_trials < 0.87
        signs.append(_asymmetry_sign(subject))
    assert 5 <= sum(sign > 0 for sign in signs) <= 11


def test_the_bundled_files_are_what_simulate_makes():
    # `bayes_toe.data.read_study.COMMAND` states the seed: the same numbers come out again, to the last answer.
    names, observers = population_from("paper", 16, 2604, reference_design())
    truth = bt.example_truth()
    assert {n: tuple(t.values()) for n, t in truth.items()} == {
        n: pytest.approx(tuple(float(v[i]) for v in observers)) for i, n in enumerate(names)
    }
    study = bt.example_study()
    for one in simulate_trials(names, observers, reference_design(), 2604):
        assert int(one.equal.sum()) == int(study[one.subject].n_equal.sum())
    assert study.synthetic


def test_designs_and_populations_from_files(tmp_path):
    design = tmp_path / "design.csv"
    design.write_text("s1,s2\n0,0\n0,0.5\n")
    assert design_from(str(design), "", 3).s2.tolist() == [0.0, 0.5]
    population = tmp_path / "population.csv"
    population.write_text("subject,mu1,sigma_p,sigma_l,q0\nx,0,0.3,0.1,0.9\n")
    names, observers = population_from(str(population), 99, 1, reference_design())
    assert (names, float(observers.q0[0])) == (["x"], 0.9)
    assert trial_frame(simulate_trials(names, observers, design_from(str(design), "", 3), 1))["synthetic"].eq(1).all()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("subject,mu1,sigma_p,sigma_l\nx,0,0.3,0.1\n", "column q0: missing"),
        ("subject,mu1,sigma_p,sigma_l,q0\nx,0,abc,0.1,0.9\n", "row 2, column sigma_p: found 'abc'"),
        ("subject,mu1,sigma_p,sigma_l,q0\nx,0,-1,0.1,0.9\n", "sigma_p must be finite and positive"),
        ("subject,mu1,sigma_p,sigma_l,q0\nx,0,1,0.1,0.9\nx,0,1,0.1,0.9\n", "found .x., allowed: each name once, and row 2 has it"),
        ("subject,mu1,sigma_p,sigma_l,q0\n", "row 1: found a header only"),
    ],
)
def test_bad_populations_are_refused(tmp_path, text, named):
    path = tmp_path / "population.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=named):
        population_from(str(path), 1, 1, reference_design())


def test_bad_designs_are_refused():
    with pytest.raises(InputError, match="--amplitudes"):
        design_from("full", "1,two", 1)
    with pytest.raises(InputError, match="positive"):
        design_from("full", "1,-2", 1)
    with pytest.raises(InputError, match="--design"):
        design_from("nowhere.csv", "1,2", 1)
    with pytest.raises(InputError, match="batches"):
        Design(np.zeros(1), np.zeros(1), 0)
