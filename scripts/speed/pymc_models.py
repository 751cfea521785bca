"""The model in PyMC, as its users would write it and in identified coordinates, sampled by nutpie."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.model.coordinates import natural
from bayes_toe.model.posterior import Posterior
from speed.agreement import require_same
from speed.cases import Case
from speed.method import Prepared
from speed.outcome import CHAINS, Outcome, natural_draws
from speed.verdicts import nuts_verdict

CHAIN_COUNT = 4


def natural_model(posterior: Posterior) -> Any:
    """mu1, sigma_p, gamma, q0 with the default prior, binomial counts."""
    import pymc as pm
    from pytensor import tensor as pt

    subject, prior = posterior.subject, posterior.prior
    with pm.Model() as model:
        mu1 = pm.Normal("mu1", prior.mu1_mean, prior.mu1_sd)
        sigma_p = pm.HalfNormal("sigma_p", prior.sigma_p_scale)
        gamma = pm.Uniform("gamma", 0.0, 1.0)
        q0 = pm.Uniform("q0", 0.0, 1.0)
        ratio = 0.5 * (1.0 + pt.sqrt(1.0 + 4.0 * gamma))
        mu2 = subject.s1 + gamma / ratio**2 * (mu1 - subject.s1)
        z = (subject.s2 - mu2) / (sigma_p * ratio**1.5)
        pm.Binomial("n_equal", n=subject.n_trials, p=q0 * 2.0 ** (-(z**2)), observed=subject.n_equal)
    return model


def identified_model(posterior: Posterior) -> Any:
    """offset, logit pull, log width, logit q0, flat, with the same prior times the Jacobian and stable log probabilities."""
    import pymc as pm
    from pytensor import tensor as pt

    subject, prior, sbar = posterior.subject, posterior.prior, posterior.sbar
    equal, different = subject.n_equal.astype(float), (subject.n_trials - subject.n_equal).astype(float)
    with pm.Model() as model:
        c, a, b, top = (pm.Flat(name) for name in ("offset", "logit_pull", "log_width", "logit_q0"))
        p = MAX_PULL * pt.sigmoid(a)
        mu1, sigma_p = sbar + c / p, pt.exp(b) * (1.0 - p) ** 1.5
        fall = np.log(2.0) * ((subject.s2 - subject.s1 - c + p * (subject.s1 - sbar)) * pt.exp(-b)) ** 2
        log_equal = -pt.softplus(-top) - fall
        log_different = pt.log(pt.sigmoid(-top) - pt.sigmoid(top) * pt.expm1(-fall))
        of_normals = pm.logp(pm.Normal.dist(prior.mu1_mean, prior.mu1_sd), mu1)
        of_normals += pm.logp(pm.HalfNormal.dist(prior.sigma_p_scale), sigma_p)
        jacobian = pt.log1p(p) - 1.5 * pt.log1p(-p) - pt.softplus(a) + b - pt.softplus(top) - pt.softplus(-top)
        pm.Potential("log_posterior", of_normals + jacobian + (equal * log_equal + different * log_different).sum())
    return model


def prepare_natural(case: Case) -> Prepared:
    """Check and compile the natural model."""
    posterior = case.posterior
    model = natural_model(posterior)
    log_density = model.compile_logp(jacobian=False)

    def at(x: np.ndarray) -> float:
        theta = natural(x, posterior.sbar)
        gamma, q0 = theta.gamma, theta.q0
        values = {"mu1": theta.mu1, "sigma_p_log__": np.log(theta.sigma_p)}
        values |= {"gamma_interval__": np.log(gamma / (1.0 - gamma)), "q0_interval__": np.log(q0 / (1.0 - q0))}
        return float(log_density(values))

    require_same(posterior, at, natural=True, coefficients=True)
    return _prepared(model, _from_natural)


def prepare_identified(case: Case) -> Prepared:
    """Check and compile the model in identified coordinates."""
    posterior = case.posterior
    model = identified_model(posterior)
    log_density = model.compile_logp()
    names = ("offset", "logit_pull", "log_width", "logit_q0")
    require_same(posterior, lambda x: float(log_density(dict(zip(names, x, strict=True)))), natural=False, coefficients=False)

    def back(draws: Any) -> np.ndarray:
        return natural_draws(*posterior.natural(np.stack([np.asarray(draws[name]) for name in names], axis=-1)))

    return _prepared(model, back)


def _from_natural(draws: Any) -> np.ndarray:
    mu1, sigma_p, gamma, q0 = (np.asarray(draws[name]) for name in ("mu1", "sigma_p", "gamma", "q0"))
    return natural_draws(mu1, sigma_p, sigma_p * np.sqrt(gamma), q0)


def _prepared(model: Any, back: Any) -> Prepared:
    import nutpie

    began = time.perf_counter()
    compiled = nutpie.compile_pymc_model(model)
    compile_s = time.perf_counter() - began

    def run(effort: int, seed: int) -> Outcome:
        trace = nutpie.sample(compiled, draws=effort, chains=CHAIN_COUNT, cores=1, seed=seed, progress_bar=False)
        draws = back(trace["posterior"])
        stats, warm = trace["sample_stats"], trace["warmup_sample_stats"]
        kept, tuned = int(np.sum(stats["n_steps"])), int(np.sum(warm["n_steps"]))
        lost = int(np.sum(stats["diverging"]))
        return Outcome(CHAINS, draws, None, kept + tuned, kept, lost, verdict=nuts_verdict(draws, lost))

    return Prepared(run, compile_s)
