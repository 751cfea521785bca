"""The fit of both tasks: never below a general optimiser, known edges, invariances, agreement with a probit regression."""

import mpmath
import numpy as np
import pytest
from random_starts import best_of_random_starts
from reference.hard_cases import hard_cases
from scipy.optimize import root
from scipy.special import log_ndtr, ndtr

import bayes_toe as bt
from bayes_toe.classical.maximum_likelihood import fit_counts
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.model.prior import Prior

CASES = hard_cases()
SUBJECTS = {**CASES, **{subject.name: subject for subject in bt.example_study("same/different")}}
STRONGER = {subject.name: subject for subject in bt.example_study(WHICH_STRONGER)}
GRID = [side.ravel() for side in np.meshgrid(np.linspace(-0.5, 0.5, 5), np.linspace(-0.5, 0.5, 5))]
#: Random starts of the general optimiser in a routine run, one of each of its methods; 50 were run
#: once for every subject of both studies.
STARTS = 3


@pytest.mark.parametrize("name", [*CASES, "S01", "S02", "S06", "S07"])
def test_never_below_a_general_optimiser(name):
    found, other = (
        fit_counts(SUBJECTS[name], Prior()),
        best_of_random_starts(SUBJECTS[name], STARTS),
    )
    assert found.arrived[0]
    assert found.objective[0] >= other - 1e-9 * (1 + 1e-5 * abs(other))


@pytest.mark.parametrize("name", ["S01", "S03", "S08", "S12"])
def test_never_below_a_general_optimiser_where_one_is_stronger(name):
    found, other = (
        fit_counts(STRONGER[name], Prior()),
        best_of_random_starts(STRONGER[name], STARTS),
    )
    assert found.arrived[0]
    assert found.objective[0] >= other - 1e-9


@pytest.mark.parametrize(
    ("pull", "mu1", "sd"), [(0.2, 0.1, 0.3), (0.05, 3.0, 0.3), (0.3, -0.4, 0.5)]
)
def test_without_lapses_and_penalty_it_is_a_probit_regression(pull, mu1, sd):
    """P(second) = Phi(b0 + b1 s1 + b2 s2): K = -b1/b2, sigma_d = 1/b2, and the offset is K sbar less where the curve crosses one half."""
    s1, s2 = GRID
    z = (s2 - s1 + pull * (s1 - mu1)) / sd
    n_yes = np.rint(100 * ndtr(z * (1 + 0.02 * z * z))).astype(
        int
    )  # somewhat steeper far out: no lapses

    def score(b):
        z = b @ [np.ones(25), s1, s2]
        rise, fall = (
            np.exp(-0.5 * z * z - log_ndtr(side)) / np.sqrt(2 * np.pi) for side in (z, -z)
        )
        return np.array([np.ones(25), s1, s2]) @ (n_yes * rise - (100 - n_yes) * fall)

    b0, b1, b2 = root(score, [0.0, -1.0 / sd, 1.0 / sd], tol=1e-13).x
    gain = -b1 / b2
    found = fit_counts(
        Subject("x", s1, s2, n_yes, np.full(25, 100), task=WHICH_STRONGER), Prior(mu1_sd=1e7)
    )
    assert found.at_edge == ("lapse_rate=0",)
    expected = [-b0 / b2 / (1 - gain), gain / b2, np.sqrt(1 - gain) / b2, 0.0]
    assert found.parameters[0] == pytest.approx(expected, rel=1e-8)


def test_answers_exchanged_mirror_the_fit():
    s1, s2, n, k = (
        -STRONGER["S05"].s1,
        -STRONGER["S05"].s2,
        STRONGER["S05"].n_trials,
        STRONGER["S05"].n_yes,
    )
    plain = fit_counts(STRONGER["S05"], Prior())
    order = np.lexsort((s2, s1))
    mirrored = fit_counts(
        Subject("x", s1[order], s2[order], (n - k)[order], n[order], task=WHICH_STRONGER), Prior()
    )
    assert mirrored.objective == pytest.approx(plain.objective, rel=1e-12)
    assert mirrored.parameters[0] == pytest.approx(plain.parameters[0] * [-1, 1, 1, 1], rel=1e-5)


@pytest.mark.parametrize(
    ("answers", "parameters", "edge"),
    [
        (
            lambda apart: np.where(apart > 0, 50, np.where(apart < 0, 0, 25)),
            (0, 0, 0, 0),
            "gamma=0;lapse_rate=0;sigma_p=0",
        ),
        (lambda apart: 25 + 0 * apart, (0, np.nan, np.nan, 1), "lapse_rate=1;not unique"),
    ],
)
def test_degenerate_answers_which_is_stronger_are_said_to_be_so(answers, parameters, edge):
    s1, s2 = GRID
    n_yes = answers(np.round(s2 - s1, 9)).astype(int)
    found = fit_counts(Subject("x", s1, s2, n_yes, np.full(25, 50), task=WHICH_STRONGER), Prior())
    assert found.at_edge == (edge,)
    # mu1 hardly matters where sigma_p is 0; its last digits depend on the processor.
    assert found.parameters[0] == pytest.approx(np.array(parameters, float), abs=1e-4, nan_ok=True)


def test_never_below_a_general_optimiser_on_real_studies(real_data):
    for file in ("vibrotactile_rate/trials.csv", "morse_rothkopf_1957/dots.csv"):
        for subject in bt.read_study(real_data / file, bt.ReadOptions(equal_code="1")):
            assert (
                fit_counts(subject, Prior()).objective[0]
                >= best_of_random_starts(subject, 4) - 1e-9
            )


@pytest.mark.parametrize("name", ["S01", "S07", "S12", "funnel", "stimuli offset by 100"])
def test_value_and_stationarity_with_fifty_digits(name):
    subject, found = SUBJECTS[name], fit_counts(SUBJECTS[name], Prior())
    with mpmath.workdps(50):

        def objective(mu1, log_sigma_p, gamma, q0):
            big = (1 + mpmath.sqrt(1 + 4 * gamma)) / 2
            total = -(mu1**2) / 200
            for s1, s2, k, n in zip(
                subject.s1, subject.s2, subject.n_yes, subject.n_trials, strict=True
            ):
                z = (mpmath.mpf(float(s2)) - mpmath.mpf(float(s1)) / big - (1 - 1 / big) * mu1) / (
                    mpmath.exp(log_sigma_p) * big**1.5
                )
                q = q0 * mpmath.power(2, -z * z)
                total += int(k) * mpmath.log(q) + int(n - k) * mpmath.log(1 - q)
            return total

        mu1, sigma_p, sigma_l, q0 = (mpmath.mpf(float(v)) for v in found.parameters[0])
        at = (mu1, mpmath.log(sigma_p), (sigma_l / sigma_p) ** 2, q0)
        assert found.objective[0] == pytest.approx(float(objective(*at)), rel=1e-13)
        slopes = [
            float(mpmath.diff(objective, at, tuple(int(i == j) for j in range(4))))
            for i in range(4)
        ]
    assert found.log_likelihood[0] == pytest.approx(
        found.objective[0] + found.parameters[0, 0] ** 2 / 200, rel=1e-13
    )
    if found.at_edge[0] == "gamma=1":
        assert slopes.pop(2) > 0
    assert (
        np.abs(slopes).max() < 1e-3
    )  # against curvatures of hundreds: less than 1e-8 nat below the maximum


@pytest.mark.parametrize(
    ("name", "parameters", "edge"),
    [
        ("all equal", (0, np.inf, np.inf, 1), "q0=1;sigma_p=inf"),
        ("all different", (0, np.nan, np.nan, 0), "q0=0;not unique"),
        ("perfect observer", (0, 0, 0, 1), "gamma=0;q0=1;sigma_p=0"),
        ("guessing at 0.5", (0, np.inf, np.inf, 0.5), "sigma_p=inf"),
        ("very blunt observer", (0, np.inf, np.inf, 0.8), "sigma_p=inf"),
        ("single pair", (0, np.nan, np.nan, np.nan), "not unique"),
    ],
)
def test_degenerate_answers_are_said_to_be_so(name, parameters, edge):
    found, subject = fit_counts(CASES[name], Prior()), CASES[name]
    assert found.at_edge == (edge,)
    # mu1 hardly matters where sigma_p is 0; its last digits depend on the processor.
    assert found.parameters[0] == pytest.approx(np.array(parameters, float), abs=1e-4, nan_ok=True)
    k = subject.n_yes.sum() / subject.n_trials.sum()
    pooled = subject.total_trials * (
        np.log(np.maximum(k, 1e-300)) * k + np.log(np.maximum(1 - k, 1e-300)) * (1 - k)
    )
    expected = 0.0 if name == "perfect observer" else pooled
    assert found.log_likelihood[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("s1", "s2", "n_equal", "edge", "open_"),
    [
        (
            [0, 0.1, 0.3, 0.5],
            [0, 0.1, 0.3, 0.5],
            [48, 40, 30, 20],
            "q0=1;not unique",
            [False, True, True, False],
        ),
        ([0, 0], [0, 0.3], [45, 20], "not unique", [False, True, True, False]),
        ([0], [0], [50], "q0=1;not unique", [False, True, True, False]),
        ([0, 0, 0.3], [0, 0.3, 0], [45, 20, 20], "gamma=0", [False] * 4),
        ([0, 0.3, 0, 0.3], [0, 0.3, 0.3, 0], [45, 30, 0, 0], "gamma=0;sigma_p=0", [False] * 4),
    ],
)
def test_small_designs_say_what_they_leave_open(s1, s2, n_equal, edge, open_):
    found = fit_counts(Subject("x", s1, s2, n_equal, [50] * len(s1)), Prior())
    assert found.at_edge == (edge,)
    assert np.isnan(found.parameters[0]).tolist() == open_
    assert np.isfinite(found.objective[0])


@pytest.mark.parametrize("name", ["S02", "S07", "one batch"])
def test_shifting_and_scaling_the_stimuli_with_the_penalty(name):
    s, plain = SUBJECTS[name], fit_counts(SUBJECTS[name], Prior())
    up = fit_counts(Subject("up", s.s1 + 3.0, s.s2 + 3.0, s.n_yes, s.n_trials), Prior(mu1_mean=3.0))
    assert up.objective == pytest.approx(plain.objective, rel=1e-12)
    assert up.parameters[0] == pytest.approx(plain.parameters[0] + [3, 0, 0, 0], abs=1e-5)
    wide = fit_counts(
        Subject("wide", s.s1 * 7.0, s.s2 * 7.0, s.n_yes, s.n_trials), Prior(mu1_sd=70.0)
    )
    assert wide.objective == pytest.approx(plain.objective, rel=1e-12)
    assert wide.parameters[0] == pytest.approx(plain.parameters[0] * [7, 7, 7, 1], rel=1e-4)
    assert wide.at_edge == up.at_edge == plain.at_edge


def test_rows_together_are_rows_alone():
    subject = SUBJECTS["S03"]
    rng = np.random.default_rng(4)
    equal = np.concatenate(
        [
            rng.binomial(subject.n_trials, 0.5, size=(6, 13)),
            [subject.n_yes],
            [subject.n_trials],
            [0 * subject.n_trials],
        ]
    )
    together = fit_counts(subject, Prior(), equal)
    for i, row in enumerate(equal):
        alone = fit_counts(subject, Prior(), row)
        assert alone.objective[0] == pytest.approx(together.objective[i], rel=1e-12, abs=1e-10)
        assert alone.at_edge[0] == together.at_edge[i]


@pytest.mark.parametrize("name", sorted(CASES))
def test_curves_have_the_likelihood_that_is_claimed(name):
    subject, found = CASES[name], fit_counts(CASES[name], Prior())
    q = found.curves.yes(subject.s1, subject.s2)[0]
    assert ((q >= 0) & (q <= 1)).all()
    with np.errstate(divide="ignore", invalid="ignore"):
        k, d = subject.n_yes, subject.n_trials - subject.n_yes
        total = np.where(k > 0, k * np.log(q), 0).sum() + np.where(d > 0, d * np.log1p(-q), 0).sum()
    assert total == pytest.approx(found.log_likelihood[0], rel=1e-9, abs=1e-7)
    assert found.edges.shape == (1, len(found.edge_names))
