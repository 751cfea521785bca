"""Ranks and sufficient models by routes of their own: exact algebra of random points, and refits of predictions by the smaller model."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.hard_cases import hard_cases
from scipy.optimize import least_squares
from scipy.special import expit

import bayes_toe as bt
from bayes_toe.experiments.checks import check_study
from bayes_toe.experiments.identifiability import identifiability
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.prior import Prior

STEPS = (0.0, 0.13, 0.31, 0.42, 0.55)
ALL = ("offset", "pull", "width", "q0", "mu1", "sigma_p", "sigma_l")
#: Pairs, rank, smallest model, and what can be told where that is known from the algebra.
CASES = {
    "one pair": ([(0.0, 0.3)], 1, "symmetric", None),
    "one equal pair": ([(0.2, 0.2)], 1, "symmetric", ()),
    "both orders of one pair": ([(0.0, 0.3), (0.3, 0.0)], 2, "constant bias", None),
    "two equal pairs": ([(0.0, 0.0), (0.3, 0.3)], 2, "no lapses", None),
    "only equal pairs": (
        [(s, s) for s in STEPS],
        3,
        "predictive update",
        ("q0", "mu1"),
    ),  # z = -p (mu1 - s1)/w is zero at mu1
    "one difference": ([(s, s + 0.2) for s in STEPS], 3, "predictive update", ("q0",)),
    "one first stimulus": (
        [(0.1, s) for s in STEPS],
        3,
        "constant bias",
        ("offset", "width", "q0"),
    ),
    "one second stimulus": ([(s, 0.1) for s in STEPS], 3, "constant bias", ("q0",)),
    "another line": ([(s, 0.4 * s + 0.1) for s in STEPS], 3, "constant bias", None),
    "three pairs": ([(0.0, 0.0), (0.0, 0.3), (0.3, 0.0)], 3, "constant bias", None),
    "three pairs with two differences": (
        [(0.0, 0.0), (0.3, 0.3), (0.0, 0.3)],
        3,
        "predictive update",
        None,
    ),
    "four pairs": ([(0.0, 0.0), (0.0, 0.3), (0.3, 0.0), (0.3, 0.3)], 4, "predictive update", ALL),
    "one order only": (
        [(a, b) for a in STEPS for b in STEPS if a < b],
        4,
        "predictive update",
        ALL,
    ),
}
DESIGNS, EXPECTED = (
    {name: case[0] for name, case in CASES.items()},
    {name: case[1:3] for name, case in CASES.items()},
)


def made(pairs, shift=0.0, scale=1.0):
    s1, s2 = (scale * np.array(side) + shift for side in zip(*pairs, strict=True))
    return bt.Subject("S", s1, s2, np.full(len(s1), 4), np.full(len(s1), 10))


@pytest.mark.parametrize("name", DESIGNS)
def test_rank_and_model_of_common_designs(name):
    found = identifiability(made(DESIGNS[name]))
    assert (found.rank, found.model) == EXPECTED[name]
    assert set(found.told).isdisjoint(found.open)
    assert len(found.told) + len(found.open) == 7
    assert CASES[name][3] in (None, found.told)


@pytest.mark.parametrize("name", DESIGNS)
def test_units_and_origin_do_not_matter(name):
    plain = identifiability(made(DESIGNS[name]))
    assert identifiability(made(DESIGNS[name], shift=1000.0)) == plain
    assert identifiability(made(DESIGNS[name], scale=1e-3)) == plain
    assert identifiability(made(DESIGNS[name], scale=20.0)).rank == plain.rank


def test_swapping_the_stimuli_of_a_line_keeps_the_rank():
    for name, pairs in DESIGNS.items():
        assert identifiability(made([(b, a) for a, b in pairs])).rank == EXPECTED[name][0]


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(
    st.lists(st.tuples(st.integers(-4, 4), st.integers(-4, 4)), min_size=1, max_size=9, unique=True)
)
def test_rank_is_that_of_the_closed_form(pairs):
    # min(n, dimensions + 2), the dimensions from exact integers
    points = np.array([(a, b - a) for a, b in pairs])
    dimensions = np.linalg.matrix_rank(points - points[0]) if len(points) > 1 else 0
    assert identifiability(made(pairs, scale=0.1)).rank == min(len(pairs), dimensions + 2)


def differences_rank(subject):
    """Rank of the Jacobian of P(equal) by central differences."""
    posterior = posterior_of(subject, Prior())
    x, h = np.array([0.07, 0.3, -1.1, 1.2]), 1e-5
    sides = [
        np.exp(posterior.log_answers(np.stack([x + h * axis, x - h * axis]))[0])
        for axis in np.eye(4)
    ]
    values = np.linalg.svd(
        np.stack([(up - down) / (2 * h) for up, down in sides], axis=1), compute_uv=False
    )
    return np.count_nonzero(values > 1e-7 * values[0])


SMALLER = {  # offset, pull, log width, logit q0 of each model from its own free parameters
    "symmetric": (2, lambda v: (0.0, 0.0, v[0], expit(v[1]))),
    "constant bias": (3, lambda v: (v[0], 0.0, v[1], expit(v[2]))),
    "no lapses": (3, lambda v: (v[0], MAX_PULL * expit(v[1]), v[2], 1.0)),
}


def predicted(subject, c, p, log_width, q0):
    lever = subject.s1 - np.average(subject.s1, weights=subject.n_trials)
    return q0 * 2.0 ** -np.square((subject.s2 - subject.s1 - c + p * lever) * np.exp(-log_width))


def reproduces(subject, target, model, rng, error):
    """Whether a model reproduces the probabilities within this error from one of many starts; the first that does ends the search."""
    size, full = SMALLER[model]
    fits = (
        least_squares(
            lambda v: predicted(subject, *full(np.clip(v, -40, 40))) - target,
            rng.normal(0.0, 1.5, size),
            xtol=1e-14,
            ftol=1e-14,
        )
        for _ in range(30)
    )
    return any(np.abs(fit.fun).max() < error for fit in fits)


def test_a_sufficient_model_reproduces_every_prediction_and_the_next_smaller_one_does_not():
    rng = np.random.default_rng(8)
    for name, pairs in DESIGNS.items():
        subject, model = made(pairs), EXPECTED[name][1]
        targets = [
            predicted(
                subject,
                rng.normal(0, 0.1),
                rng.uniform(0.05, 0.35),
                np.log(rng.uniform(0.2, 0.6)),
                rng.uniform(0.6, 0.95),
            )
            for _ in range(20)
        ]
        if model in SMALLER:
            assert all(reproduces(subject, target, model, rng, 1e-5) for target in targets[:5]), (
                name
            )
        for smaller in [
            m for m in SMALLER if model == "predictive update" or SMALLER[m][0] < SMALLER[model][0]
        ]:
            # The first prediction that is out of reach from every start is enough.
            assert not all(reproduces(subject, target, smaller, rng, 1e-4) for target in targets), (
                name,
                smaller,
            )


def test_the_finding_names_the_model_and_what_stays_open():
    (message,) = [
        f.message
        for f in check_study(bt.Study([made(DESIGNS["one first stimulus"])]))
        if f.code == "design_rank"
    ]
    assert "3 of 4 combinations" in message
    assert (
        "offset, width, q0 can be told, pull, mu1, sigma_p, sigma_l depend on the prior" in message
    )
    assert "smaller model 'constant bias' carries all the information" in message


def test_hard_cases_and_the_papers_design():
    cases = hard_cases()
    deficient = {name for name, subject in cases.items() if identifiability(subject).rank < 4}
    assert deficient == {"single pair"}


def test_many_pairs_cost_little_memory():
    grid = np.linspace(0.0, 1.0, 20_000)
    assert identifiability(made(list(zip(grid, grid, strict=True)))).rank == 3


@pytest.mark.parametrize(
    "pairs",
    [[(0.0, 0.3)], [(0.0, 0.0), (0.3, 0.0)], [(s, s) for s in STEPS], [(0.1, s) for s in STEPS]],
)
def test_intervals_rank_is_that_of_finite_differences(pairs):
    isi = np.tile([0.5, 1.0, 4.0], len(pairs))
    s1, s2 = (np.repeat(side, 3) for side in zip(*pairs, strict=True))
    subject = bt.Subject("S", s1, s2, np.full(len(s1), 4), np.full(len(s1), 10), isi)
    found = identifiability(subject)
    assert found.rank == differences_rank(subject)
    assert (found.rank == 4) == (found.reason == "")


def test_one_interval_tells_what_no_interval_does():
    for name, pairs in DESIGNS.items():
        plain = made(pairs)
        timed = bt.Subject(
            "S", plain.s1, plain.s2, plain.n_yes, plain.n_trials, np.full(plain.n_pairs, 2.5)
        )
        assert identifiability(timed) == identifiability(plain), name
