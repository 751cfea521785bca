"""Maximum likelihood against a general optimiser, at bounds, and the bootstrap."""

import numpy as np
import pytest
from conftest import hard_and_ordinary_subjects, made_subject
from definitions import paper_log_likelihood
from numpy.random import default_rng
from scipy.optimize import minimize
from scipy.stats import betabinom

import bayes_toe as bt
from bayes_toe.classical.fit import PenalisedLikelihood, SubjectFit, resample, subject_fit
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.model.prior import Prior

SUBJECTS = hard_and_ordinary_subjects()
STRONGER = bt.example_study(WHICH_STRONGER)
PAPER, NARROW = Prior(), Prior(mu1_mean=0.8, mu1_sd=0.3)
HARD_CASES = (
    "funnel",
    "perfect observer",
    "stimuli offset by 100",
    "one batch",
    "maximum on gamma = 1",
)
#: Subjects and priors of mu1: hard cases, ordinary subjects of both tasks, and a narrow prior.
FITTED = [(SUBJECTS[name], PAPER) for name in (*HARD_CASES, "S01", "S06")]
FITTED += [(STRONGER[name], PAPER) for name in ("S01", "S08")]
FITTED += [(SUBJECTS["S07"], NARROW)]


def minus_objective(subject, prior):
    """The function that fitting minimises: a normal penalty of mu1 minus the log likelihood.

    Its argument is (mu1, sigma_p, gamma, q0 or lapse rate). It is computed without the package.
    """

    def value(theta):
        log_likelihood = paper_log_likelihood(subject, *theta)
        penalty = 0.5 * ((theta[0] - prior.mu1_mean) / prior.mu1_sd) ** 2
        objective = penalty - log_likelihood
        # Nelder and Mead's method compares values, and cannot compare NaN.
        return objective if np.isfinite(objective) else 1e300

    return value


def best_of_random_starts(subject, prior):
    """The highest value that a general optimiser finds inside the bounds of the model."""
    rng = default_rng(0)
    objective = minus_objective(subject, prior)
    scale = max(np.ptp(subject.stimuli), 0.1)  # a subject with one pair may have no range
    bounds = [(-200, 200), (1e-6, 1e6), (0, 1), (0, 1)]
    lowest = np.inf
    for _ in range(3):
        mu1 = subject.s1.mean() + 3 * scale * rng.normal()
        sigma_p = scale * np.exp(rng.normal())
        start = [mu1, sigma_p, rng.uniform(), rng.uniform(0.3, 1)]
        result = minimize(objective, start, method="Nelder-Mead", bounds=bounds)
        lowest = min(lowest, result.fun)
    return -lowest


@pytest.mark.parametrize("subject, prior", FITTED, ids=lambda value: getattr(value, "name", ""))
def test_the_maximum_is_that_of_a_general_optimiser_and_the_parameters_reach_it(subject, prior):
    fit = subject_fit(subject, prior, seed=1, replicates=1)
    mu1, sigma_p, sigma_l, q0_or_lapse_rate = fit.parameters
    likelihood = PenalisedLikelihood(subject, *prior.mu1_normal)
    starts = likelihood.starts(subject.n_yes[None])[0]
    highest = likelihood.search(subject.n_yes, starts).value.max()
    # The search has bounds of its own for widths and shares, which cost less than 0.001 nat.
    assert highest >= best_of_random_starts(subject, prior) - 1e-3
    # At a bound, or where the answers leave a parameter open, the parameters are a limit.
    if np.isfinite(fit.parameters).all() and not fit.at_edge:
        theta = (mu1, sigma_p, (sigma_l / sigma_p) ** 2, q0_or_lapse_rate)
        assert highest == pytest.approx(-minus_objective(subject, prior)(theta))
        penalty = 0.5 * ((mu1 - prior.mu1_mean) / prior.mu1_sd) ** 2
        assert fit.log_likelihood == pytest.approx(highest + penalty, rel=1e-12)


@pytest.mark.parametrize(
    # A subject, the bound at which the maximum lies, and a parameter that the answers leave open.
    "subject, edge, open_parameter",
    [
        (SUBJECTS["S01"], "", ""),
        (SUBJECTS["all equal"], "q0=1", ""),
        (SUBJECTS["all different"], "q0=0", "q0"),
        (SUBJECTS["perfect observer"], "q0=1", ""),
        (SUBJECTS["single pair"], "", "sigma_p"),
        (STRONGER["S03"], "lapse_rate=0", ""),
        (made_subject("0 0 45 50, 0 0.3 20 50, 0.3 0 20 50"), "gamma=0", ""),
    ],
    ids=str,
)
def test_a_fit_names_its_bounds_and_what_answers_leave_open(subject, edge, open_parameter):
    fit = subject_fit(subject, Prior(), seed=1, replicates=5)
    assert edge in fit.at_edge.split(";")

    is_open = np.isnan(fit.parameters)
    names = ", ".join(np.array(fit.names)[is_open])
    assert bool(names) == bool(open_parameter)
    assert open_parameter in names
    if open_parameter:
        assert f"not determined by these answers: {names}" in fit.notes
    has_no_interval = np.isnan(fit.intervals()).any(axis=1)  # (parameters, 2 ends)
    assert has_no_interval.tolist() == is_open.tolist()


def test_resampled_counts_are_beta_binomial():
    """P(equal) of a pair is drawn from its posterior, Beta(a, b), and then a count of n trials."""
    subject = made_subject("0 0 50 50, 0 0.3 20 50, 0.3 0 0 10")  # s1, s2, 'equal', trials
    counts = resample(subject, default_rng(1), 20_000)  # (replicates, pairs)
    n = subject.n_trials
    mean, variance = betabinom.stats(n, subject.n_yes + 1, n - subject.n_yes + 1)
    # Four standard errors of each of three means: a false alarm in 5,000 runs.
    z = (counts.mean(axis=0) - mean) / np.sqrt(variance / 20_000)
    assert np.abs(z).max() < 4
    # A variance of 20,000 normal numbers has an error of 1 %; these counts have longer tails.
    assert counts.var(axis=0) == pytest.approx(variance, rel=0.06)
    assert ((counts >= 0) & (counts <= n)).all()


def test_a_study_of_which_is_stronger_has_a_lapse_rate_and_curves_about_half():
    study = bt.example_study(WHICH_STRONGER).select(["S01", "S08"])
    table = bt.fit(study, replicates=50, seed=1)
    frame = table.frame(full=True).set_index("subject")
    names = ["mu1", "sigma_p", "sigma_l", "lapse_rate"]
    assert list(frame.columns[:6]) == [*names, "log_likelihood", "at_edge"]
    assert frame.loc["S08", names].tolist() == table["S08"].parameters.tolist()
    # P(second) is below a half if the second stimulus is weaker, and above if it is stronger.
    p_second = table["S08"].yes([0.0, 0.0], [-0.3, 0.3])  # (replicates, pairs)
    median_if_weaker, median_if_stronger = np.quantile(p_second, 0.5, axis=0)
    assert median_if_weaker < 0.5 < median_if_stronger


@pytest.fixture
def fit():
    """A fit of mu1, sigma_p, sigma_l and q0; the fitted mu1 is far from its 400 replicates."""
    centre = np.array([0.1, 0.3, 0.1, 0.9])
    replicates = centre + default_rng(2).uniform(-0.1, 0.1, size=(400, 4))
    parameters = np.array([9.0, 0.3, 0.1, 0.9])
    return SubjectFit(
        "x", SAME_DIFFERENT, parameters, -5.0, at_edge="", replicates=replicates, n_failed=2
    )


def test_95_percent_of_replicates_lie_in_their_interval(fit):
    low, high = fit.intervals().T
    is_inside = (fit.replicates >= low) & (fit.replicates <= high)
    # The ends of an interval lie between two of 400 replicates.
    assert is_inside.mean(axis=0) == pytest.approx(np.full(4, 0.95), abs=0.01)


def test_failed_searches_and_a_fit_far_from_its_replicates_are_noted(fit):
    note_on_searches, note_on_mu1 = fit.notes
    # 401 searches are those of 400 replicates and of the fit itself.
    assert note_on_searches == "2 of 401 searches did not converge"
    assert note_on_mu1.startswith("outside the 95 % interval: mu1, because")
