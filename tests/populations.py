"""A population without a sampler: draws that are made up, so that what is said of them has an answer known beforehand."""

import numpy as np

import bayes_toe as bt
from bayes_toe.groups.chains import GroupChains
from bayes_toe.groups.population import GroupSettings, Population
from bayes_toe.groups.regressors import Regressors
from bayes_toe.inference.diagnostics import convergence

NAMES = ("mu1", "gamma", "width", "q0")
CENTRE = np.array([-0.4, 0.3, -1.2, 1.5])  # of subjects whose prior mean is below the stimuli
SIZE = 16, 50


def made_up(study, who=None, scatter=0.3, kind="normal", seed=0, **parts):
    """With mean, scatter, effects and eta as given, shape (chains, draws, ...), else drawn about :data:`CENTRE`."""
    rng, n, k = np.random.default_rng(seed), len(study), len(NAMES)
    who = Regressors.none(study.names) if who is None else who
    size = parts["mean"].shape[:2] if "mean" in parts else SIZE
    drawn = {
        "mean": CENTRE + 0.1 * rng.standard_normal((*size, k)),
        "scatter": np.full((*size, k), scatter),
        "effects": 0.2 * rng.standard_normal((*size, who.x.shape[1], k)),
        "eta": CENTRE + 0.3 * rng.standard_normal((*size, n, k)),
    } | parts
    shared = {("mean", -1, j): convergence(drawn["mean"][..., j]) for j in range(k)}
    shared |= {("sd", -1, j): convergence(drawn["scatter"][..., j]) for j in range(k)}
    shared |= {("effect", i, j): convergence(drawn["effects"][..., i, j]) for i in range(who.x.shape[1]) for j in range(k)}
    chains = GroupChains(**drawn, shared=shared, members=np.full((n, k, 3), 1.0), gradients=5)
    settings = GroupSettings(seed, "predictive update", bt.Prior(), bt.Hyperprior().for_study(study), scatter=kind)
    alone = CENTRE + 0.5 * rng.standard_normal((400, n, k))
    return Population(study, settings, NAMES, 0.2, who, chains, alone, dict(who.left_out))
