"""Simulated studies: designs, populations, seeds; those that the command writes, and observers of one's own."""

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

import bayes_toe as bt
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.errors import InputError
from bayes_toe.experiments.populations import paper_population, population_from, prior_population
from bayes_toe.experiments.simulate import (
    Design,
    design_from,
    full_design,
    reference_design,
    simulate_trials,
    trial_frame,
)
from bayes_toe.model.coordinates import Natural
from bayes_toe.model.observer import OrderModel
from bayes_toe.model.trial_history import TrialHistory, TrialHistoryPosterior
from bayes_toe.seeds import generator

ONE = {"mu1": -0.7, "sigma_p": 0.2, "sigma_l": 0.1, "q0": 0.95}
TWO = {"mu1": -0.7, "sigma_p": 0.2, "sigma_l": 0.1, "lapse_rate": 0.1}


def test_designs():
    design = reference_design()
    pairs = set(zip(design.s1, design.s2, strict=True))
    assert len(pairs) == len(design.s1) == 13
    assert (design.s1 == design.s2).sum() == 5
    assert all((b, a) in pairs for a, b in pairs)
    assert np.exp(np.unique(design.s1)) == pytest.approx([1.0, 1.15, 1.36, 1.55, 1.66])
    assert design.batches == 50
    full = full_design([1, 2, 3])
    assert len(set(zip(full.s1, full.s2, strict=True))) == 9


def test_every_batch_holds_every_pair_once_in_random_order():
    one = Natural(*(np.array([v]) for v in (0.0, 0.3, 0.1, 0.9)))
    [trials] = simulate_trials(["S"], one, reference_design(batches=20), seed=1)
    orders = {
        tuple(zip(trials.s1[at], trials.s2[at], strict=True))
        for at in (trials.batch == batch for batch in range(1, 21))
    }
    assert len(orders) == 20
    assert all(len(set(order)) == 13 for order in orders)


def test_a_subjects_answers_do_not_depend_on_the_others():
    population = paper_population(4, np.random.default_rng(0))
    together = simulate_trials(
        ["a", "b", "c", "d"], population, reference_design(batches=3), seed=5
    )
    alone = simulate_trials(
        ["c"], Natural(*(v[2:3] for v in population)), reference_design(batches=3), seed=5
    )
    assert np.array_equal(together[2].yes, alone[0].yes)


def test_the_paper_population_shows_its_three_kinds():
    theta = paper_population(400, np.random.default_rng(1))
    assert ((theta.gamma > 0) & (theta.gamma < 1)).all()
    r, c = 0.0, np.log(1.55)
    asymmetry = bt.model.equal_probability(c, r, *theta) - bt.model.equal_probability(r, c, *theta)
    kinds, usual = np.arange(400) % 5, np.arange(400) % 16 != 15
    assert (asymmetry[(kinds == 0) & usual] > 0).all()
    assert (asymmetry[(kinds == 1) & usual] < 0).all()
    assert (
        np.abs(asymmetry[(kinds == 2) & usual]).mean()
        < 0.5 * np.abs(asymmetry[(kinds == 1) & usual]).mean()
    )


@pytest.mark.parametrize(
    ("task", "subjects", "batches"), [("same/different", 16, 50), ("2afc", 12, 40)]
)
def test_the_bundled_study_is_what_simulate_makes(task, subjects, batches):
    # `bayes_toe.data.read_study.COMMANDS` state the seeds: the same numbers come out again, to the last answer.
    study, truth = bt.simulate(subjects, batches=batches, seed=2604, task=task)
    bundled = bt.example_study(task)
    assert all(np.array_equal(study[name].n_yes, bundled[name].n_yes) for name in bundled.names)
    assert all(
        truth[name] == pytest.approx(dict(bt.example_truth(task)[name])) for name in bundled.names
    )
    assert study.synthetic
    assert bundled.synthetic


def test_answers_of_observers_of_ones_own_follow_the_model():
    study, truth = bt.simulate({"A": ONE, "B": {**ONE, "mu1": 0.9}}, batches=4000, seed=1)
    assert truth["B"]["mu1"] == 0.9
    for one in study:  # 5 standard errors of 13 pairs: a false alarm in 60,000
        q = bt.model.equal_probability(one.s1, one.s2, **truth[one.name])
        assert np.all(
            np.abs(one.n_yes / one.n_trials - q) < 5.0 * np.sqrt(q * (1.0 - q) / 4000) + 1e-9
        )
    assert bt.simulate({"A": ONE}, isi=(0.5, 2.0), batches=2, seed=1).study.intervals == (0.5, 2.0)


@pytest.mark.parametrize("isi", [None, (0.5, 2.0)])
def test_answers_to_which_is_stronger_follow_the_observer(isi):
    """Trial by trial: memory decays toward mu1, both stimuli are measured anew and the stored value diffuses (row 3 of the derivation)."""
    study, truth = bt.simulate({"A": TWO}, batches=4000, isi=isi, seed=1, task="2afc")
    assert (study.task.yes, truth["A"]) == ("second", TWO)
    one, t = study["A"], 1.0 if isi is None else study["A"].isi
    gamma = (0.1 / 0.2) ** 2 / t
    ratio = (1 + np.sqrt(1 + 4 * gamma)) / 2
    memory = one.s1 / ratio + (1 - 1 / ratio) * -0.7
    p = 0.05 + 0.9 * ndtr((one.s2 - memory) / (ratio * 0.2 * np.sqrt(t)))
    assert np.all(np.abs(one.n_yes / one.n_trials - p) < 5.0 * np.sqrt(p * (1.0 - p) / 4000))


def test_observers_of_the_prior_of_which_is_stronger_are_those_that_its_posterior_has():
    design = reference_design(batches=1)
    drawn = prior_population(20_000, np.random.default_rng(1), design, task=WHICH_STRONGER)
    pairs = bt.Subject("d", design.s1, design.s2, [0] * 13, [1] * 13, task=WHICH_STRONGER)
    prior = bt.model.prior_for(bt.Study([pairs])).at(pairs)
    assert np.quantile(drawn.q0, [0.1, 0.5, 0.9]) == pytest.approx(
        prior.distribution("lapse_rate").quantile(np.array([0.1, 0.5, 0.9])), rel=0.06
    )
    assert np.median(drawn.gamma) == pytest.approx(0.5, abs=0.02)
    jnd = (
        drawn.sigma_p * (1 + np.sqrt(1 + 4 * drawn.gamma)) / 2
    )  # the width that has the prior is that of P(second)
    assert np.median(jnd) == pytest.approx(prior.distribution("width").quantile(0.5), rel=0.05)


def test_observers_of_the_prior_are_those_that_an_analysis_of_their_study_expects():
    of_prior = {"population": "prior", "batches": 1, "seed": 1}
    own, there = (
        bt.simulate(9, **of_prior, prior="paper", **isi).truth for isi in ({}, {"isi": (2.0, 8.0)})
    )
    at_two = bt.simulate(
        9, **of_prior, isi=(2.0, 8.0), prior=bt.Prior(reference_interval=2.0)
    ).truth
    for name in (
        own
    ):  # the prior is about sigma_p over 4 s, the geometric mean, or over 2 s where it says so
        for truth, seconds in ((there, 4.0), (at_two, 2.0)):
            assert truth[name] == pytest.approx(
                {**own[name], "sigma_p": own[name]["sigma_p"] / seconds**0.5}, rel=1e-14
            )
    prior = bt.Prior(mu1_mean="stimuli", mu1_sd="stimuli", sigma_p_scale="stimuli")
    found = bt.simulate(9, **of_prior, prior=prior)
    numbers = prior.at(*found.study)
    for (
        name,
        values,
    ) in (
        found.truth.items()
    ):  # the paper's prior has mu1 ~ Normal(0, 10) and sigma_p ~ HalfNormal(1)
        assert values["mu1"] == pytest.approx(
            numbers.mu1_mean + numbers.mu1_sd * own[name]["mu1"] / 10.0, rel=1e-12
        )
        assert values["sigma_p"] == pytest.approx(
            numbers.sigma_p_scale * own[name]["sigma_p"], rel=1e-12
        )


def test_designs_and_populations_from_files(tmp_path):
    design, population = tmp_path / "design.csv", tmp_path / "population.csv"
    design.write_text("s1,s2\n0,0\n0,0.5\n")
    population.write_text("subject,mu1,sigma_p,sigma_l,q0\nx,0,0.3,0.1,0.9\n")
    assert design_from(str(design), "", 3).s2.tolist() == [0.0, 0.5]
    names, observers = population_from(str(population), 99, 1, reference_design())
    assert (names, float(observers.q0[0])) == (["x"], 0.9)
    assert (
        trial_frame(simulate_trials(names, observers, design_from(str(design), "", 3), 1))[
            "synthetic"
        ]
        .eq(1)
        .all()
    )


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("subject,mu1,sigma_p,sigma_l\nx,0,0.3,0.1\n", "column q0: missing"),
        ("subject,mu1,sigma_p,sigma_l,q0\nx,0,abc,0.1,0.9\n", "row 2, column sigma_p: found 'abc'"),
        ("subject,mu1,sigma_p,sigma_l,q0\nx,0,-1,0.1,0.9\n", "sigma_p must be finite and positive"),
        (
            "subject,mu1,sigma_p,sigma_l,q0\nx,0,1,0.1,0.9\nx,0,1,0.1,0.9\n",
            "found .x., allowed: each name once, and row 2 has it",
        ),
        ("subject,mu1,sigma_p,sigma_l,q0\n", "row 1: found a header only"),
    ],
)
def test_bad_populations_are_refused(tmp_path, text, named):
    path = tmp_path / "population.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=named):
        population_from(str(path), 1, 1, reference_design())


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: design_from("full", "1,two", 1), "--amplitudes"),
        (lambda: design_from("full", "1,-2", 1), "positive"),
        (lambda: design_from("nowhere.csv", "1,2", 1), "--design"),
        (lambda: Design(np.zeros(1), np.zeros(1), 0), "batches"),
        (
            lambda: bt.simulate({"A": {"mu1": 0.0}}),
            "observer 'A': found mu1, allowed: mu1, sigma_p, sigma_l, q0, all four",
        ),
        (lambda: bt.simulate({"A": {**ONE, "q0": 1.5}}), "observers: q0 must lie in 0..1"),
        (lambda: bt.simulate({}), "found none"),
        (
            lambda: bt.simulate(task="3afc"),
            "--task: found '3afc', allowed: same/different, or 2afc",
        ),
        (
            lambda: bt.simulate({"A": ONE}, task="2afc"),
            "allowed: mu1, sigma_p, sigma_l, lapse_rate, all four",
        ),
        (
            lambda: bt.simulate({"A": {**TWO, "lapse_rate": 2}}, task="2afc"),
            "observers: lapse_rate must lie in 0..1",
        ),
        (lambda: bt.simulate(0), "allowed: a whole number from 1"),
        (lambda: bt.simulate(population="mine"), "allowed: paper, prior; parameters of your own"),
        (lambda: bt.simulate(design="mine"), "--design"),
        (lambda: bt.simulate(batches=0), "batches=0 must be at least 1"),
    ],
)
def test_what_cannot_be_simulated_is_refused(make, named):
    with pytest.raises(InputError, match=named):
        make()


def test_expectations_of_simulated_trials_are_those_of_the_model():
    """The paper's observer has the contraction p and the constant error p (mu1 - sbar)."""
    truth = {"A": {"mu1": 0.3, "sigma_p": 0.2, "sigma_l": 0.15, "lapse_rate": 0.02}}
    study, known = bt.simulate(
        truth, task="2afc", design="full", batches=20, seed=1, carry_over=0.7
    )
    assert known["A"]["carry_over"] == 0.7
    subject = study["A"]
    history = TrialHistory(OrderModel("both"), False, True)
    posterior = TrialHistoryPosterior(subject, history)
    gamma = bt.model.noise_ratio(0.2, 0.15)
    p = float(bt.model.pull(gamma))
    values = {
        "noise": 0.2 * float(bt.model.variance_ratio(gamma)),
        "lapse_rate": 0.02,
        "noise_slope": 0.0,
        "constant_error": p * (0.3 - posterior.observer.sbar),
        "contraction": p,
    }
    order = posterior.observer.points({name: np.array([own]) for name, own in values.items()})
    x = np.column_stack([order, ndtri([0.7])])
    probability = posterior.trial_probabilities(x)[0]
    rng = generator(1, "A", "trials")
    rng.uniform(size=(20, subject.n_pairs))
    drawn = rng.uniform(size=len(probability)) < probability
    assert drawn.tolist() == (subject.answers.n_yes == 1).tolist()


def test_trials_without_an_answer_stay_in_their_order():
    study, known = bt.simulate(1, task="2afc", batches=40, seed=0, missed=0.1)
    (subject,) = study
    assert 0.06 < np.mean(subject.answers.n_trials == 0) < 0.14
    assert "carry_over" not in known[subject.name]
    with pytest.raises(
        bt.InputError, match="--carry-over: found 1, allowed: a number from 0 to below 1"
    ):
        bt.simulate(1, carry_over=1.0)
