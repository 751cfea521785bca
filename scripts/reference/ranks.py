"""Simulation-based calibration of any model: observers from its prior, answers in the paper's design, ranks of the truth among draws.

Where everything is right every rank is uniform. Ties and the bands: :mod:`reference.calibration_statistics`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.experiments.simulate import reference_design
from bayes_toe.inference.adaptation import adapt_proposal
from bayes_toe.inference.sampling import SamplerSettings, sample_chains
from bayes_toe.model.ladder import model_named
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.model.record import Model
from bayes_toe.seeds import generator
from reference.calibration_statistics import place


def observed(posterior: Posterior, x: FloatArray, rng: np.random.Generator) -> Subject:
    """The subject with new answers of an observer at x, shape (k,); counts are drawn session by session, as its spread has them."""
    equal, _ = posterior.realised_answers(rng, x[None], posterior.log_answers(x[None]))
    return replace(
        posterior.subject, n_yes=rng.binomial(posterior.subject.n_trials, np.exp(equal[0]))
    )


def ranks(
    name: str,
    seed: int,
    *,
    task: Task = SAME_DIFFERENT,
    prior: Prior | None = None,
    truth: Prior | None = None,
    draws: int = 400,
) -> dict[str, float] | None:
    """Place of the truth of one observer among its draws, in 0..1, for every judged quantity and the log likelihood.

    One draw of each walker is used. None where sampling did not converge. `truth` is the prior that the observer comes from, another one
    than the `prior` of the analysis where the test itself is tested.
    """
    model = model_named(name, task)
    assert isinstance(model, Model)
    rng, prior = generator(seed, name, "observer"), DEFAULT if prior is None else prior
    design = reference_design()
    empty = Subject(
        "made",
        design.s1,
        design.s2,
        np.zeros(len(design.s1), int),
        np.full(len(design.s1), design.batches),
        task=task,
    )
    maker = model.posterior(empty, prior if truth is None else truth)
    x = maker.sample_prior(rng, 1)
    target = model.posterior(observed(maker, x[0], rng), prior)
    x = target.points(
        {key: np.asarray(value) for key, value in maker.quantities(x).items()}
    )  # another prior, other coordinates
    settings = SamplerSettings(draws=draws)
    chains = sample_chains(adapt_proposal(target, rng, draws=10_000), settings, seed)
    if not chains.converged:
        return None
    last = chains.x.reshape(len(chains.x), settings.walkers, -1, chains.x.shape[-1])[
        :, :, -1
    ].reshape(-1, chains.x.shape[-1])
    among = {**target.judged(last), "log likelihood": target.log_likelihood(last)}
    known = {**target.judged(x), "log likelihood": target.log_likelihood(x)}
    return {key: place(float(known[key][0]), values, rng) for key, values in among.items()}
