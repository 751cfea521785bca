"""Simulated subjects and groups for tests, and results of groups without a sampler."""

from dataclasses import replace

import numpy as np
from numpy.random import default_rng
from scipy.special import ndtr
from serial_observers import STEP, neighbouring_pairs

import bayes_toe as bt
from bayes_toe.data.conditions import Conditions
from bayes_toe.data.study import with_shared_scales
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.design.study_design import each_once
from bayes_toe.groups.group_sampler import GroupDraws
from bayes_toe.groups.population import (
    DRAWS,
    GroupSettings,
    PopulationResult,
    group_posterior,
)
from bayes_toe.groups.regressors import regressors
from bayes_toe.model.prior import Hyperprior

#: 2AFC neighbours: six levels .25 apart, the ten ordered pairs of neighbours.
S1, S2 = neighbouring_pairs(WHICH_STRONGER).T


def neighbours(name, c, p, sigma, n_each, rng, **fields):
    """A simulated subject of 2AFC with ten pairs of neighbouring levels, which are natural logs.

    It has the constant error c, the contraction p, the noise sigma, and n_each trials of a pair.
    """
    p_second = ndtr((S2 - S1 - c + p * (S1 - S1.mean())) / sigma)
    n_trials = np.full(len(S1), n_each)
    n_second = rng.binomial(n_trials, p_second)
    return bt.Subject(name, S1, S2, n_second, n_trials, task=WHICH_STRONGER, **fields)


def some_pairs(subject, selected):
    """The subject with some of its pairs, which a slice or an index array selects."""
    columns = ("s1", "s2", *subject.task.counts)
    pairs = {name: getattr(subject, name)[selected] for name in columns}
    return replace(subject, answers=None, **pairs)


def simulated_group(seed, n_subjects=10, n_each=20, mean_c=0.0, sd_c=0.0, mean_p=0.0):
    """A study of simulated subjects who differ in c, in units of D, and in the noise, but not in p.

    Their names are P000, P001, and so on.
    """
    rng = default_rng(seed)
    subjects = []
    for i in range(n_subjects):
        c, p = rng.normal([mean_c, mean_p], [sd_c, 0.0])
        sigma = 0.8 * STEP * np.exp(rng.normal(0.0, 0.35))
        subjects.append(neighbours(f"P{i:03d}", STEP * c, p, sigma, n_each, rng))
    return bt.Study(subjects, source="simulated", synthetic=True)


def with_ages():
    """A study of six simulated subjects, and their ages as a regressor."""
    study = simulated_group(1, n_subjects=6)
    ages = dict(zip(study.names, (20.0, 30.0, 25.0, 33.0, 28.0, 41.0), strict=True))
    return study, regressors({"age": ages}, study.names)


def two_conditions(seed, n_subjects=8, n_each=20, difference=0.5):
    """A study of simulated subjects whose constant errors at left and right differ.

    The difference is in units of D. The units are P000@left, P000@right, and so on.
    """
    rng = default_rng(seed)
    units = []
    for i in range(n_subjects):
        for level, sign in (("left", -0.5), ("right", 0.5)):
            c = STEP * (0.2 + sign * difference)
            name = f"P{i:03d}@{level}"
            units.append(neighbours(name, c, 0.1, 0.2, n_each, rng, condition=level))
    conditions = Conditions("hand", ("left", "right"))
    return bt.Study(with_shared_scales(units), source="two hands", conditions=conditions)


def independent_draws(posterior, n_draws=DRAWS, rng=0):
    """Draws in the place of the sampler's: independent points about the separate fits."""
    n_each = -(-n_draws // 8)  # draws of each of 8 chains, rounded up
    parts = posterior.points(posterior.start(8 * n_each, default_rng(rng)))
    return GroupDraws(*(part.reshape(8, n_each, *part.shape[1:]) for part in parts))


def made_result(study, columns=None, n_divergent=0, n_draws=1600):
    """The result of a group, with independent draws in the place of a sampler's.

    If it has divergent trajectories, it is not reliable.
    """
    settings = GroupSettings(1, Hyperprior(), np.int64(n_draws))
    names = dict.fromkeys(subject.subject_name for subject in study)
    columns = columns or regressors({}, tuple(names))
    posterior = group_posterior(study, settings.hyperprior, columns.x)
    draws = replace(independent_draws(posterior, n_draws), n_divergent=n_divergent)
    return PopulationResult(study, settings, columns, draws)


def grid_design(first, steps, trials):
    """A design of every first stimulus with second stimuli at these steps from it."""
    s1 = np.repeat(first, len(steps))
    return each_once(s1, s1 + np.tile(steps, len(first))).with_total(trials)
