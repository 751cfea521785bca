"""Populations without a sampler.

Either draws are made up, so that what is said of them has an answer known beforehand; or subjects with known parameters answer, and draws
are scattered about what these say of mean and spread.
"""

import numpy as np

import bayes_toe as bt
from bayes_toe.data.tasks import SAME_DIFFERENT
from bayes_toe.experiments.simulate import reference_design
from bayes_toe.groups.chains import GroupChains, with_convergence
from bayes_toe.groups.hyperprior import Hyperprior
from bayes_toe.groups.population import GroupSettings, Population
from bayes_toe.groups.regressors import Regressors
from bayes_toe.groups.subjects import GroupLikelihood
from bayes_toe.model.ladder import model_named

NAMES = ("mu1", "gamma", "width", "q0")
CENTRE = np.array([-0.4, 0.3, -1.2, 1.5])  # of subjects whose prior mean is below the stimuli
SIZE = 16, 50


def made_up(
    study,
    who=None,
    scatter=0.3,
    kind="normal",
    seed=0,
    model="predictive update",
    hyperprior=None,
    **parts,
):
    """With mean, scatter, effects and eta as given, shape (chains, draws, ...), else drawn about :data:`CENTRE`."""
    rng, n, k = np.random.default_rng(seed), len(study), len(NAMES)
    who = Regressors.none(study.names) if who is None else who
    size = parts["mean"].shape[:2] if "mean" in parts else SIZE
    drawn = {
        "mean": CENTRE + 0.1 * rng.standard_normal((*size, k)),
        "scatter": np.full((*size, k), scatter),
        "effects": 0.2 * rng.standard_normal((*size, who.x.shape[1], k)),
        "eta": CENTRE + 0.3 * rng.standard_normal((*size, n, k)),
        "z": np.empty((*size, 0)),
    } | parts
    chains = with_convergence(
        GroupChains(**drawn, convergence={}, subject_convergence=np.full((n, k, 3), 1.0))
    )
    hyperprior = (bt.Hyperprior() if hyperprior is None else hyperprior).for_study(study)
    settings = GroupSettings(
        seed, model, bt.Prior(), hyperprior, scatter=kind, correlations="z" in parts
    )
    alone = CENTRE + 0.5 * rng.standard_normal((400, n, k))
    return Population(
        study,
        settings,
        model_named(model, study.task).group,
        0.2,
        who,
        chains,
        alone,
        dict(who.left_out),
    )


#: Mean and sd of mu1, probit gamma, log w and probit q0 of ordinary subjects.
MEAN, SD = np.array([0.1, -0.5, -1.3, 1.3]), np.array([0.3, 0.3, 0.15, 0.3])


def ordinary(subjects, seed=1):
    """Parameters on their group scales, shape (subjects, 4)."""
    return MEAN + SD * np.random.default_rng(seed).standard_normal((subjects, 4))


def made_population(
    eta,
    *,
    model="predictive update",
    task=SAME_DIFFERENT,
    columns=(),
    x=None,
    reason="",
    isi=None,
    draws=150,
    seed=2,
):
    """A population in which subjects with parameters eta, shape (N, k), gave 40 answers to each pair."""
    rng, (n, k) = np.random.default_rng(seed), eta.shape
    record, design = model_named(model, task), reference_design(batches=40)
    count, more = (
        np.full(len(design.s1), 40),
        {"isi": None if isi is None else 0 * design.s1 + isi, "task": task},
    )
    asked = [
        bt.Subject(f"P{i:03d}", design.s1, design.s2, 0 * count, count, **more) for i in range(n)
    ]
    answered = GroupLikelihood(record, bt.Prior(), asked, 0.2, 1).repeated(eta[None], rng)[0]
    study = bt.Study(
        [
            bt.Subject(one.name, one.s1, one.s2, k, one.n_trials, **more)
            for one, k in zip(asked, answered, strict=True)
        ]
    )
    spread = eta.std(axis=0, ddof=1)

    def noise(*shape):
        return rng.standard_normal((4, draws, *shape))

    scatter = spread * np.exp(noise(k) / np.sqrt(2 * n))
    effects = 0.5 * spread + spread * noise(len(columns), k) / np.sqrt(n)
    mean, near = eta.mean(axis=0) + spread * noise(k) / np.sqrt(n), eta + 0.1 * spread * noise(n, k)
    chains = with_convergence(
        GroupChains(
            mean,
            scatter,
            effects,
            near,
            np.empty((4, draws, 0)),
            {},
            np.ones((n, k, 3)),
            reason=reason,
        )
    )
    who = Regressors(study.names, np.zeros((n, 0)) if x is None else x, tuple(columns))
    settings = GroupSettings(1, model, bt.Prior(), Hyperprior().for_study(study))
    return Population(
        study,
        settings,
        record.group,
        0.2,
        who,
        chains,
        (eta + spread * noise(n, k)).reshape(-1, n, k),
        {},
    )


def drawn(joint, names, members, draws, rng, **fields):
    """Chains of a group in the place of those of its sampler: independent draws."""
    size, k, r = (16, 40), len(names), joint.x.shape[1]
    mean, scatter, effects, eta = (
        rng.standard_normal((*size, *shape)) for shape in ((k,), (k,), (r, k), (len(members), k))
    )
    empty, ones = np.empty((*size, 0)), np.ones((len(members), k, 3))
    return with_convergence(
        GroupChains(mean, np.abs(scatter), effects, eta, empty, {}, ones, **fields)
    )
