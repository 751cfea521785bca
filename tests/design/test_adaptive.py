"""Adaptive sessions: the posterior, the next pair, and files that bring a session back."""

import itertools
import pickle
from copy import deepcopy

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.special import entr

from bayes_toe.answers.words import Word
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.design.adaptive import Adaptive
from bayes_toe.design.observers import make_observer
from bayes_toe.design.study_design import each_once
from bayes_toe.errors import InputError
from bayes_toe.inference.order_evidence import MODEL_NAMES, order_evidence
from bayes_toe.model.models import OrderModel
from bayes_toe.model.parameters import MODEL_PRIOR

LEVELS = np.linspace(-0.75, 1.25, 9)  # .25 apart
PAIRS = list(itertools.product(LEVELS, repeat=2))
DESIGN = each_once(*np.transpose(PAIRS))
CONTRACTION = make_observer(
    "name",
    "kind",
    {"noise": 0.2, "q0": 0.93, "lapse_rate": 0.03, "contraction": 0.3},
    SAME_DIFFERENT,
)


def answer_pair(session, pair, rng, observer=CONTRACTION):
    """Let an observer answer a pair in a session."""
    [p_yes] = observer.p_questions(*pair, sbar=float(LEVELS.mean()))  # of the only question
    session.answer(pair, bool(rng.uniform() < p_yes))


def start_session(draws=512, **options):
    """A session without answers, with few draws, because they are quick."""
    return Adaptive(PAIRS, seed=1, draws=draws, **options)


@pytest.fixture(scope="module")
def session():
    """A session of 100 trials with an observer who has a contraction."""
    session = start_session(draws=2000)
    rng = default_rng(3)
    for _ in range(100):
        pair = session.next()
        assert pair in PAIRS
        answer_pair(session, pair, rng)
    return session


def test_the_posterior_is_that_of_the_four_models(session):
    """Sbar is the mean of all pairs in a session, and the mean of shown pairs in an evidence."""
    (evidence,) = order_evidence([session.subject], seed=2)
    *_, expected_contraction, expected_both = evidence.probabilities
    assert tuple(session.probabilities) == MODEL_NAMES
    *_, p_contraction, p_both = session.probabilities.values()
    assert sum(session.probabilities.values()) == pytest.approx(1.0)
    # The tolerance is for the Monte Carlo error of 2,000 draws.
    assert p_contraction + p_both == pytest.approx(expected_contraction + expected_both, abs=0.05)
    assert session.order_effect.words["order_effect"] is Word.YES


def test_the_next_pair_is_one_that_tells_most(session):
    worth = session.information()  # of each pair
    assert worth[PAIRS.index(session.next())] == pytest.approx(worth.max())


def entropy(p):
    """The entropy of an answer with this probability, nats."""
    return entr(p) + entr(1 - p)


@pytest.mark.parametrize("aim, error", [("model", 0.002), ("parameters", 0.01)])
def test_information_is_the_expected_fall_of_entropy(aim, error):
    """The definition is computed from 8,000 draws of the prior of each model.

    The errors are Monte Carlo errors: probabilities of models are averages of many draws.
    """
    mean = 0.0
    expected_entropy = 0.0
    for number, (name, probability) in enumerate(MODEL_PRIOR.items()):
        posterior = OrderModel(name).posterior(DESIGN.unanswered)
        x = posterior.sample_prior(default_rng(number), size=8_000)
        p_yes = np.exp(posterior.log_answers(x)[0])  # (draws, pairs)
        model_mean = p_yes.mean(axis=0)
        mean = mean + probability * model_mean
        # The entropy that is left if the model is known, or the parameters, too.
        entropies = entropy(model_mean) if aim == "model" else entropy(p_yes).mean(axis=0)
        expected_entropy = expected_entropy + probability * entropies
    informations = [Adaptive(PAIRS, seed=seed, about=aim).information() for seed in range(3)]
    information = np.mean(informations, axis=0)  # of each pair
    assert information == pytest.approx(entropy(mean) - expected_entropy, abs=error)
    assert information.max() > 0.002  # so that the information differs from 0 by more than `error`


def test_a_file_brings_a_session_back_and_a_copy_goes_on_by_itself(tmp_path):
    pairs = [(0.0, 0.0), (0.0, 0.2), (0.2, 0.0), (0.4, 0.0)]
    session = Adaptive(pairs, seed=5, draws=np.int64(512), about="parameters")
    # Functions that return a copy of a session.
    copiers = (
        deepcopy,
        lambda session: pickle.loads(pickle.dumps(session)),
        lambda session: Adaptive.resume(session.save(tmp_path / "session.json")),
    )
    for n_trials in range(1, 7):
        session.answer((0.0, 0.2), n_trials % 2 == 1)
        copy = copiers[n_trials % 3](session)
        assert (copy.next(), copy.probabilities) == (session.next(), session.probabilities)
        copy.answer((0.4, 0.0), True)
        assert (copy.trials, session.trials) == (n_trials + 1, n_trials)


def test_sessions_of_which_is_stronger_take_true_for_second():
    """With a positive constant error, 'second' is the rarer answer; the PSE shift is positive."""
    parameters = {"noise": 0.2, "lapse_rate": 0.02, "constant_error": 0.3}
    observer = make_observer("name", "kind", parameters, WHICH_STRONGER)
    session = start_session(task="2afc")
    rng = default_rng(1)
    for _ in range(60):
        answer_pair(session, session.next(), rng, observer)
    assert session.order_effect.sizes["pse_shift_percent"].q025 > 0.0
    assert session.subject.task == WHICH_STRONGER


#: Calls, and a part of the message that refuses each.
REFUSED = [
    (lambda: start_session(about="gain"), "about='gain': allowed: model, parameters"),
    (lambda: Adaptive([1.0, 2.0]), "found shape (2,)"),
    (lambda: Adaptive([(0.0, 0.1, 1.0)]), "found shape (1, 3), allowed: (pairs, 2)"),
    (lambda: start_session().answer(PAIRS[0], "yes"), "yes='yes'"),
    (lambda: start_session().answer((0.0, 1.0, 2.0), True), "allowed are s1 and s2"),
    (lambda: start_session().answer((0.0, np.nan), True), "must be finite"),
    (lambda: start_session().subject, "no answers yet"),
    (lambda: Adaptive.resume("old.json"), "old.json: not a session that can be read (format"),
    (lambda: Adaptive.resume("absent.json"), "absent.json: not a session that can be read"),
]


@pytest.mark.parametrize("call, message", REFUSED)
def test_wrong_sessions_and_answers_are_refused(tmp_path, monkeypatch, call, message):
    monkeypatch.chdir(tmp_path)  # where old.json is, a file of an earlier version
    (tmp_path / "old.json").write_text('{"format": "bayes-toe adaptive 1"}')
    with pytest.raises(InputError) as caught:
        call()
    assert message in str(caught.value)
