"""Adaptive sessions: the posterior is that of `sample`, the next pair is the best one, and a file brings a session back."""

import pickle
from copy import deepcopy

import numpy as np
import pytest
from scipy.special import entr, logsumexp

import bayes_toe as bt
from bayes_toe.data.study import pooled
from bayes_toe.errors import InputError
from bayes_toe.inference.subject import Wanted, fitted_result
from bayes_toe.model.ladder import PREDICTIVE_UPDATE, SYMMETRIC, model_named
from bayes_toe.model.posterior import Posterior
from bayes_toe.planning.adaptive import Adaptive
from bayes_toe.planning.observers import observers_from, prior_of
from bayes_toe.planning.particles import Particles
from bayes_toe.planning.study_design import each_once

LEVELS = np.linspace(-0.75, 1.25, 9)
PAIRS = [(a, b) for a in LEVELS for b in LEVELS]
DESIGN = each_once(*np.transpose(PAIRS))
EACH, PRIOR = DESIGN.unanswered, prior_of([DESIGN], None)
THREE = ("symmetric", "constant bias", "predictive update")


def says_equal(observer, pair):
    return observer.p_yes(each_once([pair[0]], [pair[1]]))[0]


def session(trials, observer, **options):
    made, rng = Adaptive(PAIRS, seed=1, **options), np.random.default_rng(3)
    for _ in range(trials):
        pair = made.next()
        assert pair in PAIRS
        made.answer(pair, bool(rng.uniform() < says_equal(observer, pair)))
    return made


@pytest.fixture(scope="module")
def updates():
    return observers_from(None, 1, seed=1)[-1]


@pytest.fixture(scope="module")
def done(updates):
    return session(120, updates)


def test_the_posterior_is_that_of_sample(done):
    draws = bt.sample(bt.Study((done.subject,)), draws=4000, seed=2, workers=1)
    for name in ("gain", "mu1", "width", "q0"):
        exact = draws.values("adaptive", name).ravel()
        for level, found in zip((0.05, 0.5, 0.95), done.quantiles(name), strict=True):
            # Of 1,000 counting particles and 4,000 draws; 12 comparisons at 4.5 standard errors: false alarm 1 in 10,000.
            error = np.sqrt(level * (1 - level) * (1 / 1000 + 1 / 4000))
            assert abs((exact < found).mean() - level) < 4.5 * error, (name, level)
    assert min(done.effective().values()) > 1000
    assert (done.verdict.effect, done.verdict.kind) == (
        "has",
        "pull",
    )  # over the verdict's own models


def test_probabilities_are_those_of_the_evidences(updates):
    made = session(60, updates, model=THREE)
    logs = []
    for name in THREE:
        posterior = Posterior(made.subject, model_named(name), made.prior)
        logs.append(fitted_result(posterior, 1, Wanted(evidence_draws=4000))[0].evidence.value)
    # A constant error counts from the mean first stimulus shown, the session's from that of the candidates.
    assert np.log(list(made.probabilities.values())) == pytest.approx(
        logs - logsumexp(logs), abs=0.15
    )
    assert sum(made.probabilities.values()) == pytest.approx(1.0)


def test_chosen_pairs_tell_more_than_random_ones():
    gained = 0.0
    for observer in observers_from(None, 4, seed=1)[-2:]:
        rng, random = np.random.default_rng(3), Adaptive(PAIRS, seed=1)
        for _ in range(80):
            pair = PAIRS[int(rng.integers(len(PAIRS)))]
            random.answer(pair, bool(rng.uniform() < says_equal(observer, pair)))
        sizes = [
            [np.ptp(one.quantiles(name)) for name in ("gain", "mu1", "width", "q0")]
            for one in (session(80, observer), random)
        ]
        gained += float(np.diff(np.log(sizes).sum(axis=1))[0])
    assert gained > 1.0  # of other streams 2 to 5 nats


def entropy(q):
    return entr(q) + entr(1 - q)


@pytest.fixture(scope="module")
def of_prior():
    """40,000 draws of the prior, and their P(equal) of every pair."""
    centre = float(np.mean(LEVELS))
    cloud = Particles.of_prior(
        Posterior(EACH, PREDICTIVE_UPDATE, PRIOR, centre, 1.0), 40_000, np.random.default_rng(1)
    )
    target = cloud.target(EACH)
    return target.quantities(cloud.x), np.exp(target.log_answers(cloud.x)[0])


def test_information_is_the_expected_fall_of_entropy_and_not_the_scatter_of_a_few_draws(of_prior):
    """By the definition, over 40 bins of a quantity, whose own scatter is below 0.001: of 512 draws it was up to 1.5 times as large."""
    quantities, equal = of_prior
    for about, off in (("gain", 0.002), ("width", 0.002), ("parameters", 0.003)):
        left = entropy(equal).mean(axis=0)  # where all parameters are known
        if about != "parameters":
            left = np.mean(
                [
                    entropy(equal[one].mean(axis=0))
                    for one in np.array_split(np.argsort(quantities[about]), 40)
                ],
                axis=0,
            )
        expected = entropy(equal.mean(axis=0)) - left
        found = np.mean(
            [Adaptive(PAIRS, seed=seed, about=about).information() for seed in range(5)], axis=0
        )
        assert np.abs(found - expected).mean() < off, about  # 0.002 to 0.004 by 512
        assert found == pytest.approx(expected, abs=4 * off), about


def test_information_about_the_model_is_what_its_answer_tells_of_two(of_prior):
    made = Adaptive(PAIRS, ("symmetric", "predictive update"), seed=1, draws=8000)
    symmetric = Particles.of_prior(
        Posterior(EACH, SYMMETRIC, PRIOR, float(np.mean(LEVELS)), 1.0),
        40_000,
        np.random.default_rng(2),
    )
    q = (
        np.exp(symmetric.target(EACH).log_answers(symmetric.x)[0]).mean(axis=0),
        of_prior[1].mean(axis=0),
    )
    expected = entropy(np.mean(q, axis=0)) - np.mean([entropy(one) for one in q], axis=0)
    assert made.information() == pytest.approx(expected, abs=0.003)
    assert expected.max() > 0.015


def test_information_is_finite_where_an_answer_is_certain():
    """Without lapses identical stimuli are equal: weights times ones add up to 1 only within rounding, in half of all sessions above it."""
    for models in (
        ["none + sloped + no lapses"],
        ["none + sloped + no lapses", "none + no lapses + exponent"],
    ):
        made = Adaptive(PAIRS, models, seed=1)
        for pair, equal in [
            (PAIRS[3], False),
            (PAIRS[10], True),
            (PAIRS[11], True),
            (PAIRS[40], True),
            (PAIRS[2], False),
        ]:
            made.answer(pair, equal)
            told = made.information()
            assert np.isfinite(told).all()
            assert told[[a == b for a, b in PAIRS]] == pytest.approx(0.0, abs=1e-12)


def test_a_model_under_which_an_answer_is_impossible_is_out_and_one_that_none_allows_is_refused():
    made = Adaptive(PAIRS, ["none + sloped + no lapses", "symmetric", "constant bias"], seed=1)
    made.answer((0.25, 0.25), False)
    assert (
        made.probabilities["none + sloped + no lapses"]
        == made.effective()["none + sloped + no lapses"]
        == 0.0
    )
    assert sum(made.probabilities.values()) == pytest.approx(1.0)
    others = Adaptive(PAIRS, ["symmetric", "constant bias"], seed=1)
    others.answer((0.25, 0.25), False)
    for _ in range(30):
        assert made.information() == pytest.approx(others.information(), abs=1e-12)
        pair = made.next()
        for one in (made, others):
            one.answer(pair, False)
    assert made.probabilities["symmetric"] == others.probabilities["symmetric"]
    with pytest.raises(
        InputError,
        match="no lapses': allowed, of this session and its answers: symmetric, constant bias",
    ):
        made.quantiles("width")
    alone = Adaptive(PAIRS, "none + sloped + no lapses", seed=1)
    with pytest.raises(InputError, match="'different' is impossible under none"):
        alone.answer((0.25, 0.25), False)
    assert alone.trials == 0
    assert np.isfinite(alone.information()).all()


def test_a_file_brings_a_session_back_and_a_copy_goes_on_by_itself(tmp_path):
    session = Adaptive(
        [(0.0, level) for level in (0.0, 0.2, 0.4)],
        ["symmetric", "predictive update"],
        seed=5,
        draws=512,
    )
    for at in range(1, 12):
        session.answer((0.0, 0.2), session.trials % 2 == 0)
        ways = (
            deepcopy,
            lambda one: pickle.loads(pickle.dumps(one)),
            lambda one: Adaptive.resume(one.save(tmp_path / "session.json")),
        )
        copied = ways[at % 3](session)
        assert (copied.next(), copied.probabilities) == (session.next(), session.probabilities)
        assert copied.quantiles("width") == session.quantiles("width")
        copied.answer((0.0, 0.4), True)
        assert (copied.trials, session.trials) == (at + 1, at)


def test_draws_made_anew_weigh_what_all_answers_say_and_those_outside_of_the_support_count_for_nothing(
    done,
):
    rule, rng = Posterior(EACH, PREDICTIVE_UPDATE, PRIOR, 0.25, 1.0), np.random.default_rng(2)
    cloud = Particles.of_prior(rule, 2000, np.random.default_rng(1))
    more = bt.Subject.from_trials("one", [0.0], [0.1], [True])
    cloud.add(cloud.gain(done.subject))
    cloud.log_posterior[:3], cloud.log_weight[:3] = -np.inf, -np.inf
    cloud.renew(done.subject, rng)
    cloud.add(cloud.gain(more))
    target = cloud.target(pooled((done.subject, more)))
    assert cloud.log_posterior == pytest.approx(
        target.log_prior(cloud.x) + target.log_likelihood(cloud.x), rel=1e-12, abs=1e-9
    )
    assert not np.isnan(cloud.log_weight).any()
    assert (len(cloud.x), cloud.generation, np.isfinite(cloud.log_evidence), cloud.left > 0.5) == (
        2000,
        1,
        True,
        True,
    )


def test_intervals_are_part_of_a_pair():
    made = Adaptive([(0.0, 0.0, 0.5), (0.0, 0.3, 2.0), (1.0, 0.8, 0.5)], seed=1)
    pair = made.next()
    assert len(pair) == 3
    made.answer(pair, True)
    assert made.subject.intervals == (pair[2],)
    with pytest.raises(InputError, match="allowed are s1 and s2 and isi"):
        made.answer((0.0, 0.0), True)


def started(**options):
    return Adaptive(PAIRS, seed=1, **options)


REFUSED = [
    (
        lambda: started(model="free frequencies"),
        "model 'free frequencies': allowed are models with parameters",
    ),
    (lambda: started(model="update + beta-binomial"), "by which answers are independent"),
    (lambda: started(model=[]), "model: found none, allowed: one or several"),
    (
        lambda: started(about="luck"),
        "about='luck': allowed: parameters, model with at least two models, or of one model: mu1",
    ),
    (
        lambda: started(about="model"),
        "about='model': allowed: parameters, model with at least two models",
    ),
    (lambda: started(draws=10), "draws=10: allowed is at least 512"),
    (lambda: Adaptive([1.0, 2.0]), "found shape (2,)"),
    (lambda: started().answer(PAIRS[0], "yes"), "yes='yes'"),
    (lambda: started().answer((0.0, np.nan), True), "must be finite"),
    (lambda: started().subject, "no answers yet"),
    (
        lambda: started().quantiles("width", model="symmetric"),
        "allowed, of this session and its answers: predictive update",
    ),
    *(
        (
            lambda wrong=wrong: started().quantiles("width", [wrong]),
            "allowed are numbers from 0 to 1",
        )
        for wrong in (1.5, -0.1, np.nan)
    ),
    *(
        (lambda name=name: Adaptive.resume(name), f"{name}: not a session that can be read")
        for name in ("other.json", "absent.json")
    ),
]


@pytest.mark.parametrize(("wish", "said"), REFUSED)
def test_what_is_refused(tmp_path, monkeypatch, wish, said):
    monkeypatch.chdir(tmp_path)
    saved = started().save("session.json").read_text(encoding="utf-8")
    (tmp_path / "other.json").write_text(
        saved.replace("adaptive 1", "adaptive 2"), encoding="utf-8"
    )
    with pytest.raises(InputError) as caught:
        wish()
    assert said in str(caught.value)
