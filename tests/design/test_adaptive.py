"""Adaptive sessions: the posterior, the next pair, and files that bring a session back."""

import itertools
import pickle
from copy import deepcopy

import numpy as np
import pytest
from scipy.special import entr

import bayes_toe as bt
from bayes_toe.answers.words import Word
from bayes_toe.data.study import pooled
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.design.adaptive import Adaptive, Particles
from bayes_toe.design.observers import make_observer
from bayes_toe.design.study_design import each_once
from bayes_toe.errors import InputError
from bayes_toe.inference.order_evidence import MODEL_NAMES, order_evidence
from bayes_toe.model.observer import OrderModel
from bayes_toe.model.parameters import MODEL_PRIOR, ORDER_MODELS

LEVELS = np.linspace(-0.75, 1.25, 9)
PAIRS = list(itertools.product(LEVELS, repeat=2))
DESIGN = each_once(*np.transpose(PAIRS))
CONTRACTION = make_observer(
    "O", "k", {"noise": 0.2, "q0": 0.93, "lapse_rate": 0.03, "contraction": 0.3}, SAME_DIFFERENT
)


def answer_pair(session, pair, rng, observer=CONTRACTION):
    p_yes = observer.p_yes(*pair, sbar=float(LEVELS.mean()))
    session.answer(pair, bool(rng.uniform() < p_yes))


def begun(**options):
    return Adaptive(PAIRS, seed=1, **options)


@pytest.fixture(scope="module")
def done():
    session, rng = begun(draws=2000), np.random.default_rng(3)
    for _ in range(100):
        pair = session.next()
        assert pair in PAIRS
        answer_pair(session, pair, rng)
    return session


def test_the_posterior_is_that_of_the_four_models(done):
    """Sessions count from the mean of all pairs, evidences from that of pairs that were shown."""
    (evidence,) = order_evidence([done.subject], seed=2)
    expected = evidence.probabilities(np.array([MODEL_PRIOR[name] for name in MODEL_NAMES]))
    assert list(done.probabilities) == list(MODEL_NAMES)
    assert sum(done.probabilities.values()) == pytest.approx(1.0)
    with_contraction = np.array([False, False, True, True])
    found = np.array(list(done.probabilities.values()))[with_contraction].sum()
    assert found == pytest.approx(expected[with_contraction].sum(), abs=0.05)
    assert min(done.effective().values()) > 500
    answer = done.order_effect
    assert answer.words["order_effect"] is Word.YES
    low, middle, high = done.quantiles("contraction")
    assert low < 0.3 < high
    assert middle == pytest.approx(answer.sizes["contraction_p"].q50, abs=0.04)


def test_the_next_pair_is_one_that_tells_most(done):
    worth = done.information()
    assert worth[PAIRS.index(done.next())] == pytest.approx(worth.max())


def entropy(p):
    return entr(p) + entr(1 - p)


@pytest.mark.parametrize("about", ["model", "parameters"])
def test_information_is_the_expected_fall_of_entropy(about):
    """By the definition, over 8,000 draws of the prior of each model."""
    p_yes = {}
    for number, name in enumerate(ORDER_MODELS):
        posterior = OrderModel(name).posterior(DESIGN.unanswered)
        x = posterior.sample_prior(np.random.default_rng(number), 8_000)
        p_yes[name] = np.exp(posterior.log_answers(x).yes)
    mean = sum(MODEL_PRIOR[name] * p.mean(axis=0) for name, p in p_yes.items())
    left = 0.0
    for name, p in p_yes.items():
        known = entropy(p.mean(axis=0)) if about == "model" else entropy(p).mean(axis=0)
        left = left + MODEL_PRIOR[name] * known
    found = np.mean(
        [Adaptive(PAIRS, seed=seed, about=about).information() for seed in range(3)], axis=0
    )
    off = 0.002 if about == "model" else 0.01
    assert found == pytest.approx(entropy(mean) - left, abs=off)
    assert found.max() > 0.002


def test_a_file_brings_a_session_back_and_a_copy_goes_on_by_itself(tmp_path):
    pairs = [(0.0, 0.0), (0.0, 0.2), (0.2, 0.0), (0.4, 0.0)]
    session = Adaptive(pairs, seed=5, draws=512, about="parameters")
    ways = (
        deepcopy,
        lambda one: pickle.loads(pickle.dumps(one)),
        lambda one: Adaptive.resume(one.save(tmp_path / "session.json")),
    )
    for at in range(1, 10):
        session.answer((0.0, 0.2), session.trials % 2 == 0)
        copied = ways[at % 3](session)
        assert (copied.next(), copied.probabilities) == (session.next(), session.probabilities)
        assert copied.quantiles("noise") == session.quantiles("noise")
        copied.answer((0.4, 0.0), True)
        assert (copied.trials, session.trials) == (at + 1, at)


def test_sessions_of_which_is_stronger_take_true_for_second(tmp_path):
    parameters = {"noise": 0.2, "lapse_rate": 0.02, "constant_error": 0.3}
    observer = make_observer("O", "k", parameters, WHICH_STRONGER)
    session, rng = begun(task="2afc", draws=512), np.random.default_rng(1)
    for _ in range(60):
        answer_pair(session, session.next(), rng, observer)
    assert session.quantiles("constant_error")[0] > 0.0
    again = Adaptive.resume(session.save(tmp_path / "s.json"))
    assert again.subject.task == WHICH_STRONGER
    assert again.probabilities == session.probabilities


def test_draws_made_anew_weigh_what_all_answers_say(done):
    rule = OrderModel("both").posterior(DESIGN.unanswered)
    particles = Particles.from_prior(rule, 2000, np.random.default_rng(1))
    more = bt.Subject.from_trials("one", [0.0], [0.1], [True])
    particles.add(done.subject)
    particles.renew(done.subject, np.random.default_rng(2))
    particles.add(more)
    posterior = rule.for_subject(pooled((done.subject, more)))
    expected = posterior.log_density(particles.x)
    assert particles.log_posterior == pytest.approx(expected, rel=1e-12, abs=1e-9)
    assert not np.isnan(particles.log_weight).any()
    assert (len(particles.x), particles.generation) == (2000, 1)
    assert particles.left > 0.5


REFUSED = [
    (lambda: begun(about="gain"), "about='gain': allowed: model, parameters"),
    (lambda: begun(draws=10), "draws=10: allowed is at least 512"),
    (lambda: Adaptive([1.0, 2.0]), "found shape (2,)"),
    (lambda: Adaptive([(0.0, 0.1, 1.0)]), "found shape (1, 3), allowed: (pairs, 2)"),
    (lambda: begun().answer(PAIRS[0], "yes"), "yes='yes'"),
    (lambda: begun().answer((0.0, 1.0, 2.0), True), "allowed are s1 and s2"),
    (lambda: begun().answer((0.0, np.nan), True), "must be finite"),
    (lambda: begun().subject, "no answers yet"),
    (lambda: begun().quantiles("gain"), "quantity 'gain': allowed: noise, q0"),
    (lambda: begun().quantiles("noise", [1.5]), "allowed are numbers from 0 to 1"),
    (lambda: Adaptive.resume("old.json"), "old.json: not a session that can be read (format"),
    (lambda: Adaptive.resume("absent.json"), "absent.json: not a session that can be read"),
]


@pytest.mark.parametrize(("call", "message"), REFUSED)
def test_what_is_refused(tmp_path, monkeypatch, call, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.json").write_text('{"format": "bayes-toe adaptive 1"}', encoding="utf-8")
    with pytest.raises(InputError) as caught:
        call()
    assert message in str(caught.value)
