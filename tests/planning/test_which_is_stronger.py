"""Planning of 'which is stronger?': observers answer by the closed form, kinds are recovered, designs have both orders, sessions go on."""

import numpy as np
import pytest
from commands import good, refused
from scipy.stats import norm

from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.errors import InputError
from bayes_toe.planning.adaptive import Adaptive
from bayes_toe.planning.observers import SHARED, observers_from, of_kind
from bayes_toe.planning.optimal import OPTIMISED, DesignGoal, proposed
from bayes_toe.planning.power import FOUND, NAMED, WRONG, power
from bayes_toe.planning.study_design import StudyDesign, all_pairs, each_once

LEVELS = np.linspace(-0.75, 0.75, 6)
NEIGHBOURS = StudyDesign(
    np.r_[LEVELS[:-1], LEVELS[1:]], np.r_[LEVELS[1:], LEVELS[:-1]], np.full(10, 65), task="2afc"
)


@pytest.fixture(scope="module")
def people():
    return observers_from(None, 3, seed=1, task=WHICH_STRONGER)


def test_observers_answer_by_the_closed_form(people):
    """P(second) = lambda/2 + (1 - lambda) Phi((s2 - s1 + p (s1 - mu1)) / (G sigma_p))."""
    one = of_kind(people, "update")[1]
    mu1, sigma_p, sigma_l, lapses = (
        one.quantities[name] for name in ("mu1", "sigma_p", "sigma_l", "lapse_rate")
    )
    gamma = (sigma_l / sigma_p) ** 2
    gain = 2.0 / (1.0 + np.sqrt(1.0 + 4.0 * gamma))  # K, with gamma = (1 - K)/K^2
    s1, s2 = NEIGHBOURS.s1, NEIGHBOURS.s2
    width = sigma_p / gain
    expected = 0.5 * lapses + (1 - lapses) * norm.cdf((s2 - s1 + (1 - gain) * (s1 - mu1)) / width)
    assert one.p_yes(NEIGHBOURS) == pytest.approx(expected, rel=1e-10)
    assert SHARED[WHICH_STRONGER]["width"][0] < width < SHARED[WHICH_STRONGER]["width"][1]
    assert 0.30 < 1 - gain < 0.38


def test_kinds_are_recovered_from_neighbouring_pairs_and_no_pull_is_said_of_who_has_none(
    three_models,
):
    """Of 60 observers of each kind 57, 48 and 48 were right by the largest probability; those here are clear ones."""
    table = power(NEIGHBOURS, data_sets=3, trials=[650], seed=1, workers=1)
    kinds = table.different("observers")
    assert [table["these pairs", 650, kind, FOUND].value for kind in kinds] == [0.0, 1.0, 1.0]
    assert [table["these pairs", 650, kind, WRONG].value for kind in kinds] == [0.0] * 3
    assert table["these pairs", 650, "update", NAMED].value == 1.0
    assert table["these pairs", 650, "constant error", NAMED].value >= 0.6
    assert sum(np.argmax(row.judgement.probability) == kinds.index(row.kind) for row in table) >= 8


@pytest.mark.parametrize("aim", ["update", "gain", "parameters"])
def test_an_optimised_design_has_both_orders_equally_often(people, aim):
    found, worth = proposed(LEVELS, 305, DesignGoal(aim, max_pairs=9, task="2afc"), people, 1)
    design = found[OPTIMISED].design
    trials = dict(zip(design.pairs, design.n_trials.tolist(), strict=True))
    assert (design.total, design.n_pairs <= 9, len(worth)) == (305, True, 36)
    assert all(abs(n - trials[b, a]) <= 1 for (a, b), n in trials.items())
    assert found[OPTIMISED].utility > max(
        one.utility for name, one in found.items() if name != OPTIMISED
    )


def test_a_session_takes_true_for_second_and_goes_on_from_its_file(people, tmp_path):
    observer, rng = people[-1], np.random.default_rng(1)
    session = Adaptive(
        all_pairs(LEVELS, task=WHICH_STRONGER), ["symmetric", "predictive update"], seed=1
    )
    for _ in range(60):
        s1, s2 = session.next()
        session.answer(
            (s1, s2), rng.uniform() < observer.p_yes(each_once([s1], [s2], task=WHICH_STRONGER))[0]
        )
    assert session.subject.task == WHICH_STRONGER
    assert session.probabilities["predictive update"] > 0.99
    low, high = session.quantiles("gain", (0.0005, 0.9995), model="predictive update")
    gamma = (observer.quantities["sigma_l"] / observer.quantities["sigma_p"]) ** 2
    assert low < 2.0 / (1.0 + np.sqrt(1.0 + 4.0 * gamma)) < high
    again = Adaptive.resume(session.save(tmp_path / "session.json"))
    assert (again.pairs.task, again.next(), again.probabilities) == (
        WHICH_STRONGER,
        session.next(),
        session.probabilities,
    )
    with pytest.raises(InputError, match="'both ways' is of the task 'same/different'"):
        Adaptive([(0.0, 0.1)], "update + both ways", task="2afc", seed=1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[none]\nwidth = 0.3\nq0 = 0.9\n",
            "[none]: key 'q0': unknown, allowed: lapse_rate, noise_slope, share, width",
        ),
        (
            "[update]\npull = 0.3\nmu1 = 40\nwidth = 0.2\n",
            "P(second) of all observers of the kind 'update' is below 0.01, even of",
        ),
    ],
)
def test_observers_that_are_of_another_task_or_always_answer_alike_are_refused(
    tmp_path, text, said
):
    (tmp_path / "people.toml").write_text(text, encoding="utf-8")
    NEIGHBOURS.save(tmp_path / "d.csv")
    assert said in refused(
        "power",
        "d.csv",
        "--task",
        "2afc",
        "--observers",
        "people.toml",
        "--trials",
        "130",
        "-o",
        "out",
        cwd=tmp_path,
    )


def test_the_command(tmp_path, three_models, blank_figure):
    asked = (
        "--task",
        "2afc",
        "--trials",
        "130",
        "--data-sets",
        "1",
        "--subjects",
        "2",
        "--seed",
        "1",
        "--workers",
        "1",
        "-o",
        "out",
    )
    assert "with the paper's pairs 130 trials find an order effect in" in good(
        "power", *asked, cwd=tmp_path
    )
