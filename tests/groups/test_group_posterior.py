"""The joint posterior of a group against its definition, written down without its coordinates."""

import definitions
import numpy as np
import pytest
from conftest import made_subject
from numpy.random import default_rng
from populations import simulated_group, two_conditions
from scipy import stats

import bayes_toe as bt
from bayes_toe.groups.group_posterior import PLAIN_UNITS
from bayes_toe.groups.population import group_posterior, study_scales
from bayes_toe.model.models import ObserverPosterior, OrderModel
from bayes_toe.model.prior import Hyperprior

#: Two covariates of three subjects.
X = np.array([[1.0, -0.5], [0.0, 1.2], [1.0, 0.3]])


def posterior_of(study, x):
    """The posterior of a group with covariates x under the default hyperprior."""
    return group_posterior(study, Hyperprior(), x)


def log_likelihood(subject, scales, w):
    """Log likelihood of a 2AFC subject, by the observer of one subject.

    `w` has the coefficients that the group shares and then the other parameters. c and noise count
    in D, other parameters in their own units.
    """
    # The first stimuli count from their mean in this subject, and the prior is not used.
    sbar = float(np.average(subject.s1, weights=subject.n_trials))
    own_scales = scales._replace(sbar=sbar, first_spread=0.0)
    observer = ObserverPosterior(subject, OrderModel("both"), PLAIN_UNITS, own_scales)
    shared_names = ["constant_error", "contraction", "noise"]
    other_names = [name for name in observer.coordinates if name not in shared_names]
    values = dict(zip(shared_names + other_names, w, strict=True))
    return observer.log_likelihood([values[name] for name in observer.coordinates])[0]


def log_joint(study, scales, mean, sd, effects, points):
    """Log density at one point: means, scores of SDs, effects and parameters of the subjects.

    Coefficients are c/D, p and log noise/D. c has Student's t densities with 3 degrees of freedom,
    and the other coefficients have normal densities. The numbers are those of the default
    hyperprior; effects of covariates have the scales of the SDs.
    """
    sd_scales = np.array([0.3, 0.15, 0.4])
    total = stats.t.logpdf(mean[0], 3, scale=0.5)
    total += stats.norm.logpdf(mean[1:], scale=[0.2, 0.6]).sum()
    total += np.log(2.0) + stats.t.logpdf(sd[0], 3, scale=sd_scales[0])  # half a t density
    total += stats.halfnorm.logpdf(sd[1:], scale=sd_scales[1:]).sum()
    # From the density of u = sd / scale to that of its score, which is a factor d u / d score.
    # Phi(score) is the probability that a half-normal variable is below u.
    u = sd / sd_scales
    score = stats.norm.ppf(stats.halfnorm.cdf(u))
    total += (stats.norm.logpdf(score) - stats.halfnorm.logpdf(u)).sum()
    total += stats.norm.logpdf(effects, 0.0, sd_scales).sum()
    # The lapse rate and the slope of the noise have the prior of a single subject.
    for subject, x, w in zip(study, X, points, strict=True):
        total += stats.norm.logpdf(w[:3], mean + x @ effects, sd).sum()
        total += stats.norm.logpdf(w[3]) + stats.t.logpdf(w[4:], 3).sum()
        total += log_likelihood(subject, scales, w)
    return total


def log_volume(posterior, theta):
    """Log determinant of the map from coordinates theta to the subjects' coefficients.

    Each coefficient depends on a coordinate of its own and on the coordinates that all subjects
    share, so that the determinant is a product of slopes. The slopes are computed by differences.
    """
    rows = posterior.rows
    steps = 1e-6 * np.eye(theta.shape[1])
    total = np.zeros(len(theta))
    for i in range(rows.n_subjects):
        for j in range(rows.n_coefficients):
            step = steps[posterior.n_shared + i * rows.n_coordinates + j]
            # Parameters of the subjects come last, (points, subjects, coordinates).
            *_, points_above = posterior.points(theta + step)
            *_, points_below = posterior.points(theta - step)
            total += np.log((points_above - points_below)[:, i, j] / 2e-6)
    return total


@pytest.fixture(scope="module")
def study():
    return simulated_group(3, n_subjects=3, n_each=12, mean_c=0.4, mean_p=0.1)


def test_density_is_that_of_the_definition(study):
    scales = study_scales(study)
    posterior = posterior_of(study, X)
    theta = posterior.start(4, default_rng(2))
    # Behind three means and three SDs are three effects of each covariate, which start at 0.
    theta[:, 6 : posterior.n_shared] = default_rng(3).normal(0.0, 0.2, (4, 6))
    points = zip(*posterior.points(theta), strict=True)
    expected = np.array([log_joint(study, scales, *point) for point in points])
    log_density_of_theta, _ = posterior(theta)
    log_density = log_density_of_theta - log_volume(posterior, theta)
    # Constants of the coordinates' scores are left out, so that both differ by the same number at
    # all points. The tolerance is that of the differences in `log_volume`.
    assert np.ptp(log_density - expected) < 1e-5


@pytest.mark.parametrize("kind", ["covariates", "conditions", "same or different"])
def test_gradient_is_the_derivative(kind, study):
    example = bt.example_study("same/different").select(["S01", "S02", "S03"])
    studies = {"conditions": two_conditions(1, n_subjects=3), "same or different": example}
    # Other studies than the first have no covariates, X[:, :0].
    posterior = posterior_of(studies.get(kind, study), X if kind == "covariates" else X[:, :0])
    theta = posterior.start(3, default_rng(1))
    slopes = definitions.slopes(lambda theta: posterior(theta)[0], theta)
    _, gradient = posterior(theta)
    # Differences of a log density of hundreds of nats have few digits.
    assert gradient == pytest.approx(slopes, rel=1e-4, abs=1e-3)


def test_roved_first_stimuli_narrow_the_prior_of_the_contraction():
    """The prior narrows by 4 D over the SD of the first stimuli: here D is .1 and the SD is 2."""
    subject = made_subject("-2 -2.1 1 3, -2 -1.9 2 3, 2 1.9 1 3, 2 2.1 2 3")
    scales = study_scales(bt.Study([subject]))
    assert scales.roving_share == pytest.approx(4.0 * 0.1 / 2.0)
