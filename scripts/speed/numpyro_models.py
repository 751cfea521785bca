"""The model in NumPyro, as its users would write it and in identified coordinates, sampled by its NUTS in double precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.coordinates import UNCONSTRAINED
from bayes_toe.model.posterior import Posterior
from speed.agreement import require_same
from speed.cases import Case
from speed.method import Prepared
from speed.outcome import CHAINS, Outcome, natural_draws
from speed.verdicts import nuts_verdict

CHAIN_COUNT, WARM_UP = 4, 1000
_FIELDS = ("num_steps", "diverging")
Model = Callable[[], None]
#: Draws by name, each (chains, draws), and what NUTS tells of every draw.
Sampler = Callable[[int, int], tuple[Any, Any]]
SamplerOf = Callable[[Model], Sampler]


def natural_model(posterior: Posterior) -> Model:
    """mu1, sigma_p, gamma, q0 with the default prior, binomial counts."""
    import numpyro
    from jax import numpy as jnp
    from numpyro import distributions as dist

    subject, prior = posterior.subject, posterior.prior

    def model() -> None:
        mu1 = numpyro.sample("mu1", dist.Normal(prior.mu1_mean, prior.mu1_sd))
        sigma_p = numpyro.sample("sigma_p", dist.HalfNormal(prior.sigma_p_scale))
        gamma = numpyro.sample("gamma", dist.Uniform(0.0, 1.0))
        q0 = numpyro.sample("q0", dist.Uniform(0.0, 1.0))
        ratio = 0.5 * (1.0 + jnp.sqrt(1.0 + 4.0 * gamma))
        mu2 = subject.s1 + gamma / ratio**2 * (mu1 - subject.s1)
        z = (subject.s2 - mu2) / (sigma_p * ratio**1.5)
        numpyro.sample("n_equal", dist.Binomial(subject.n_trials, q0 * 2.0 ** (-(z**2))), obs=subject.n_equal)

    return model


def identified_model(posterior: Posterior) -> Model:
    """offset, logit pull, log width, logit q0, flat, with the same prior times the Jacobian and stable log probabilities."""
    import numpyro
    from jax import nn
    from jax import numpy as jnp
    from numpyro import distributions as dist

    subject, prior, sbar = posterior.subject, posterior.prior, posterior.sbar
    equal, different = subject.n_equal.astype(float), (subject.n_trials - subject.n_equal).astype(float)

    def model() -> None:
        flat = dist.ImproperUniform(dist.constraints.real, (), ())
        c, a, b, top = (numpyro.sample(name, flat) for name in UNCONSTRAINED)
        p = MAX_PULL * nn.sigmoid(a)
        mu1, sigma_p = sbar + c / p, jnp.exp(b) * (1.0 - p) ** 1.5
        fall = jnp.log(2.0) * ((subject.s2 - subject.s1 - c + p * (subject.s1 - sbar)) * jnp.exp(-b)) ** 2
        log_different = jnp.log(nn.sigmoid(-top) - nn.sigmoid(top) * jnp.expm1(-fall))
        of_normals = dist.Normal(prior.mu1_mean, prior.mu1_sd).log_prob(mu1)
        of_normals += dist.HalfNormal(prior.sigma_p_scale).log_prob(sigma_p)
        jacobian = jnp.log1p(p) - 1.5 * jnp.log1p(-p) + nn.log_sigmoid(-a) + b + nn.log_sigmoid(top) + nn.log_sigmoid(-top)
        log_likelihood = equal * (nn.log_sigmoid(top) - fall) + different * log_different
        numpyro.factor("log_posterior", of_normals + jacobian + log_likelihood.sum())

    return model


def prepare_natural(sampler_of: SamplerOf) -> Callable[[Case], Prepared]:
    """Check and compile the natural model."""

    def prepare(case: Case) -> Prepared:
        posterior = case.posterior
        model = natural_model(posterior)

        def values(x: np.ndarray) -> dict[str, Any]:
            theta = posterior.natural(x)
            return {"mu1": theta.mu1, "sigma_p": theta.sigma_p, "gamma": theta.gamma, "q0": theta.q0}

        require_same(posterior, _log_density(model, values), natural=True, coefficients=True)
        return _prepared(sampler_of(model), _from_natural)

    return prepare


def prepare_identified(sampler_of: SamplerOf) -> Callable[[Case], Prepared]:
    """Check and compile the model in identified coordinates."""

    def prepare(case: Case) -> Prepared:
        posterior = case.posterior
        model = identified_model(posterior)
        same = _log_density(model, lambda x: dict(zip(UNCONSTRAINED, x, strict=True)))
        require_same(posterior, same, natural=False, coefficients=False)

        def back(draws: Any) -> np.ndarray:
            return natural_draws(*posterior.natural(np.stack([np.asarray(draws[name]) for name in UNCONSTRAINED], axis=-1)))

        return _prepared(sampler_of(model), back)

    return prepare


def called(model: Model) -> Sampler:
    """`MCMC.run` as the documentation calls it: one object, run again and again; every call after the first still traces the model."""
    samplers: dict[int, Any] = {}

    def sample(effort: int, seed: int) -> tuple[Any, Any]:
        from jax import random

        sampler = samplers.setdefault(effort, _mcmc(model, effort))
        sampler.run(random.PRNGKey(seed), extra_fields=_FIELDS)
        return sampler.get_samples(group_by_chain=True), sampler.get_extra_fields()

    return sample


def jitted(model: Model) -> Sampler:
    """The same run inside one `jax.jit`: the fastest form known, nothing left in a call but the sampling."""
    import jax

    compiled: dict[int, Any] = {}

    def sample(effort: int, seed: int) -> tuple[Any, Any]:
        def whole(key: Any) -> tuple[Any, Any]:
            sampler = _mcmc(model, effort)
            sampler.run(key, extra_fields=_FIELDS)
            return sampler.get_samples(group_by_chain=True), sampler.get_extra_fields()

        return compiled.setdefault(effort, jax.jit(whole))(jax.random.PRNGKey(seed))

    return sample


def _mcmc(model: Model, effort: int) -> Any:
    from numpyro.infer import MCMC, NUTS

    # One device: chains run one after the other, as they do for a user who asks for nothing else.
    many = {"num_chains": CHAIN_COUNT, "chain_method": "sequential", "progress_bar": False}
    return MCMC(NUTS(model), num_warmup=WARM_UP, num_samples=effort, **many)


def _log_density(model: Model, values: Callable[[np.ndarray], dict[str, Any]]) -> Callable[[np.ndarray], float]:
    import numpyro
    from numpyro.infer.util import log_density

    numpyro.enable_x64()
    return lambda x: float(log_density(model, (), {}, values(x))[0])


def _from_natural(draws: Any) -> np.ndarray:
    mu1, sigma_p, gamma, q0 = (np.asarray(draws[name]) for name in ("mu1", "sigma_p", "gamma", "q0"))
    return natural_draws(mu1, sigma_p, sigma_p * np.sqrt(gamma), q0)


def _prepared(sample: Sampler, back: Callable[[Any], np.ndarray]) -> Prepared:
    """The first run compiles: it is made apart."""

    def run(effort: int, seed: int) -> Outcome:
        values, fields = sample(effort, seed)
        draws = back(values)
        lost = int(np.sum(fields["diverging"]))
        # Steps of the warm-up are not kept by the library: only those after it can be counted.
        return Outcome(CHAINS, draws, None, None, int(np.sum(fields["num_steps"])), lost, verdict=nuts_verdict(draws, lost))

    return Prepared(run, first_run=True)
