"""Samplers of other people for the hierarchical model: NumPyro, nutpie with PyMC's model, nutpie with a gradient written by hand.

A method takes counts and settings, makes and compiles its model, and returns a function of the seed that does nothing but sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import bayes_toe as bt
from speed.population_target import PRIOR_SD, TAU_SCALE, Counts, jax_log_likelihood, log_likelihood


@dataclass(frozen=True)
class Settings:
    """How long, and how careful."""

    chains: int
    warm_up: int
    draws: int
    target: float
    cores: int


@dataclass(frozen=True, eq=False)
class Sampled:
    """m, tau (chains, draws, 4), eta (chains, draws, subjects, 4); gradients of the draws, and of the warm-up where the library tells.

    With correlations these too, (chains, draws, 4, 4).
    """

    m: np.ndarray
    tau: np.ndarray
    eta: np.ndarray
    divergences: int
    gradients: int
    warm_up_gradients: int | None = None
    correlation: np.ndarray | None = None


_ENOUGH = 1900  # effective draws
Run = Callable[[int], Sampled]
Method = Callable[[Counts, Settings], Run]


def numpyro_method(centred: Sequence[int] = (0, 0, 0, 0), *, vectorised: bool = False, correlated: bool = False) -> Method:
    """NumPyro in double precision; one `jax.jit` holds a whole chain, of which every core runs one at a time, or all chains in one array.

    Centred says of each parameter whether its coordinates are eta (1) or (eta - m)/tau (0); where correlated,
    (eta - m)/tau are L times independent scores, L of LKJ(2).
    """

    def prepare(counts: Counts, settings: Settings) -> Run:
        import jax
        import numpyro
        from numpyro.infer import MCMC, NUTS, init_to_median

        numpyro.enable_x64()
        model = _numpyro_correlated(counts) if correlated else _numpyro_model(counts, np.array(centred, float))
        at_a_time = settings.chains if vectorised else 1
        many = {"num_chains": at_a_time, "chain_method": "vectorized", "progress_bar": False}

        def whole(key: Any) -> tuple[Any, Any]:
            kernel = NUTS(model, target_accept_prob=settings.target, init_strategy=init_to_median)
            sampler = MCMC(kernel, num_warmup=settings.warm_up, num_samples=settings.draws, **many)
            sampler.run(key, extra_fields=("num_steps", "diverging"))
            return sampler.get_samples(group_by_chain=True), sampler.get_extra_fields()

        compiled = jax.jit(whole).lower(jax.random.PRNGKey(0)).compile()

        def one(key: Any) -> tuple[Any, Any]:
            return jax.tree.map(np.asarray, compiled(key))

        def run(seed: int) -> Sampled:
            keys = jax.random.split(jax.random.PRNGKey(seed), settings.chains // at_a_time)
            with ThreadPoolExecutor(settings.cores) as threads:  # compiled code runs without Python's lock
                draws, fields = zip(*threads.map(one, keys), strict=True)
            values = (np.concatenate([chain[name] for chain in draws]) for name in ("m", "tau", "eta"))
            lost, steps = (sum(int(chain[name].sum()) for chain in fields) for name in ("diverging", "num_steps"))
            root = np.concatenate([chain["root"] for chain in draws]) if correlated else None
            return Sampled(*values, lost, steps, correlation=None if root is None else root @ root.swapaxes(-1, -2))

        return run

    return prepare


def _numpyro_correlated(counts: Counts) -> Callable[[], None]:
    import numpyro
    from numpyro import distributions as dist

    def model() -> None:
        m = numpyro.sample("m", dist.Normal(counts.prior_mean, PRIOR_SD).to_event(1))
        tau = numpyro.sample("tau", dist.HalfNormal(TAU_SCALE).to_event(1))
        root = numpyro.sample("root", dist.LKJCholesky(4, 2.0))
        x = numpyro.sample("x", dist.Normal().expand((len(counts.names), 4)).to_event(2))
        eta = numpyro.deterministic("eta", m + tau * (x @ root.T))
        numpyro.factor("answers", jax_log_likelihood(counts, eta))

    return model


def _numpyro_model(counts: Counts, centred: np.ndarray) -> Callable[[], None]:
    import numpyro
    from numpyro import distributions as dist

    def model() -> None:
        m = numpyro.sample("m", dist.Normal(counts.prior_mean, PRIOR_SD).to_event(1))
        tau = numpyro.sample("tau", dist.HalfNormal(TAU_SCALE).to_event(1))
        x = numpyro.sample("x", dist.Normal(centred * m, tau**centred).expand((len(counts.names), 4)).to_event(2))
        eta = numpyro.deterministic("eta", m + tau ** (1.0 - centred) * (x - centred * m))
        numpyro.factor("answers", jax_log_likelihood(counts, eta))

    return model


def nutpie_pymc(counts: Counts, settings: Settings) -> Run:
    """PyMC's model, non-centred, compiled by Numba and sampled by nutpie, which jitters its starts around the origin."""
    import nutpie

    compiled = nutpie.compile_pymc_model(_pymc_model(counts))
    return _nutpie_run(compiled, settings, len(counts.names))


def _pymc_model(counts: Counts) -> Any:
    import pymc as pm
    from pytensor import tensor as pt

    with pm.Model() as model:
        m = pm.Normal("m", counts.prior_mean, PRIOR_SD, shape=4)
        tau = pm.HalfNormal("tau", TAU_SCALE, shape=4)
        xi = pm.Normal("xi", shape=(len(counts.names), 4))
        eta = pm.Deterministic("eta", m + tau * xi)
        mu1, probit_gamma, log_w, probit_q0 = (eta[:, k, None] for k in range(4))
        gamma = _phi(probit_gamma)
        ratio = 0.5 * (1.0 + pt.sqrt(1.0 + 4.0 * gamma))
        z = (counts.s2 - counts.s1 + gamma / ratio**2 * (counts.s1 - mu1)) * pt.exp(-log_w)
        fall = np.log(2.0) * z**2
        log_equal = pt.log(_phi(probit_q0)) - fall
        log_different = pt.log(_phi(-probit_q0) - _phi(probit_q0) * pt.expm1(-fall))
        pm.Potential("answers", (counts.equal * log_equal + counts.different * log_different).sum())
    return model


def _phi(x: Any) -> Any:
    from pytensor import tensor as pt

    return 0.5 * pt.erfc(-x / np.sqrt(2.0))


def nutpie_numpy(counts: Counts, settings: Settings) -> Run:
    """A plain Python function with a gradient in NumPy, non-centred, sampled by nutpie; no PyMC, nothing compiled."""
    from nutpie.compiled_pyfunc import from_pyfunc

    subjects = len(counts.names)
    size = 8 + 4 * subjects

    def expand(x: np.ndarray) -> dict[str, np.ndarray]:
        m, tau, xi = x[:4], np.exp(x[4:8]), x[8:].reshape(-1, 4)
        return {"m": m, "tau": tau, "eta": m + tau * xi}

    def density(x: np.ndarray) -> tuple[float, np.ndarray]:
        m, tau, xi = x[:4], np.exp(x[4:8]), x[8:].reshape(-1, 4)
        value, slope = log_likelihood(counts, m + tau * xi)
        away, width = (m - counts.prior_mean) / PRIOR_SD, tau / TAU_SCALE
        value += x[4:8].sum() - 0.5 * (np.sum(away**2) + np.sum(width**2) + np.sum(xi**2))
        d_m = slope.sum(axis=0) - away / PRIOR_SD
        d_log_tau = tau * np.sum(slope * xi, axis=0) - width**2 + 1.0
        return value, np.concatenate([d_m, d_log_tau, (tau * slope - xi).ravel()])

    def start(seed: int) -> np.ndarray:
        middle = np.concatenate([counts.prior_mean, np.log(TAU_SCALE), np.zeros(4 * subjects)])
        return middle + np.random.default_rng(seed).uniform(-1.0, 1.0, size)

    shapes = {"m": (4,), "tau": (4,), "eta": (subjects, 4)}
    compiled = from_pyfunc(
        size,
        lambda: density,
        lambda *_: expand,
        [np.dtype(np.float64)] * 3,
        list(shapes.values()),
        list(shapes),
        make_initial_point_fn=start,
    )
    return _nutpie_run(compiled, settings, subjects)


def _nutpie_run(compiled: Any, settings: Settings, subjects: int) -> Run:
    import nutpie

    def run(seed: int) -> Sampled:
        trace = nutpie.sample(
            compiled,
            chains=settings.chains,
            cores=settings.cores,
            tune=settings.warm_up,
            draws=settings.draws,
            target_accept=settings.target,
            seed=seed,
            progress_bar=False,
        )
        values = (trace.posterior[name].to_numpy() for name in ("m", "tau", "eta"))
        stats, before = trace.sample_stats, trace.warmup_sample_stats
        return Sampled(*values, int(stats.diverging.sum()), int(stats.n_steps.sum()), int(before.n_steps.sum()))

    return run


def bayes_toe_method(counts: Counts, settings: Settings, *, correlated: bool = False) -> Run:
    """The package's own, subjects' own posteriors included. It stops by itself: here at 1,900 effective draws of everything."""
    numbers = {"mu1": (2.0, 2.0), "gamma": (1.0, 1.0), "width": (1.0, 0.7), "q0": (1.0, 1.0)}
    sections = {
        name: {"mean": mean, "mean_sd": mean_sd, "sd_scale": sd_scale}
        for (name, (mean_sd, sd_scale)), mean in zip(numbers.items(), counts.prior_mean.tolist(), strict=True)
    }
    hyperprior = bt.Hyperprior().for_study(counts.study).changed(sections)

    def run(seed: int) -> Sampled:
        made = bt.population(counts.study, seed=seed, hyperprior=hyperprior, workers=settings.cores, draws=_ENOUGH, correlations=correlated)
        found = made.chains
        correlation = found.correlation if correlated else None
        return Sampled(found.mean, found.scatter, found.eta, found.divergent, found.gradients, correlation=correlation)

    return run


METHODS: dict[str, Method] = {
    "bayes_toe": bayes_toe_method,
    "bayes_toe-correlated": partial(bayes_toe_method, correlated=True),
    "numpyro": numpyro_method(),
    "numpyro-vectorised": numpyro_method(vectorised=True),
    "numpyro-centred": numpyro_method((1, 1, 1, 1)),
    "numpyro-mixed": numpyro_method((0, 0, 1, 0)),
    "numpyro-correlated": numpyro_method(correlated=True),
    "nutpie": nutpie_pymc,
    "nutpie-numpy": nutpie_numpy,
}
