"""Speed against error: this package's sampler and evidence beside others, on bundled subjects whose posteriors are known.

Every method runs on the same subjects in one process on one core, from the counts to the draws; what compiles does so apart. Errors are
against deterministic integration (tests/reference), in posterior standard deviations. emcee samples the paper's coordinates and the
identified ones; nutpie and NumPyro (NUTS, one jit) the identified ones, in which they do best; dynesty gives an evidence. Other libraries
take part where they are installed: pip install -e ".[peers]". docs/speed_vs_error.md is a larger race, frozen at its commit.

Example: python scripts/speed_vs_error.py -o speed.csv --seed 1 --runs 4
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"  # before the libraries are imported: they read it once
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import argparse  # noqa: E402
import json  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Mapping  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from importlib.util import find_spec  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import emcee  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from scipy.special import log_expit, logit, ndtri  # noqa: E402

import bayes_toe as bt  # noqa: E402
from bayes_toe.arrays import FloatArray  # noqa: E402
from bayes_toe.data.tables import write_table  # noqa: E402
from bayes_toe.data.whole_files import require_writable  # noqa: E402
from bayes_toe.errors import BayesToeError, InputError  # noqa: E402
from bayes_toe.inference.maxima import find_maxima  # noqa: E402
from bayes_toe.inference.sampling import SamplerSettings  # noqa: E402
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Wanted, infer  # noqa: E402
from bayes_toe.model.closed_form import MAX_PULL  # noqa: E402

REFERENCE = Path(__file__).resolve().parents[1] / "tests" / "reference" / "reference.json"
LEVELS = (0.05, 0.5, 0.95)
COORDINATES = ("offset", "logit_pull", "log_width", "logit_q0")
ENSEMBLES = CHAINS = 4
WALKERS = 64


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one run gives: draws (chains, draws, 4) of mu1, sigma_p, sigma_l, q0, or none; the log evidence in nats, or none."""

    draws: FloatArray | None = None
    log_evidence: float | None = None


#: A subject made ready: from effort and seed to an outcome. What is done before is not timed.
Run = Callable[[int, int], Outcome]


# --- Methods ----------------------------------------------------------------------------------------------------------------------------


def own(posterior: bt.Posterior) -> Run:
    """The package's route; effort is the number of effective draws, 0 for the evidence alone."""

    def run(effort: int, seed: int) -> Outcome:
        result = infer(posterior, seed, Wanted(SamplerSettings(draws=effort) if effort else None, 0 if effort else EVIDENCE_DRAWS))
        if not effort:
            return Outcome(log_evidence=result.evidence.value)
        return Outcome(_natural(posterior, result.chains.x))

    return run


def emcee_identified(moves: list[tuple[Any, float]] | None) -> Callable[[bt.Posterior], Run]:
    """emcee in identified coordinates, vectorised; effort is the number of steps, of which the first quarter is dropped."""

    def prepare(posterior: bt.Posterior) -> Run:
        return lambda effort, seed: Outcome(
            _natural(posterior, _ensembles(posterior.log_density, _cloud(posterior, seed), moves, effort, seed))
        )

    return prepare


def emcee_natural(posterior: bt.Posterior) -> Run:
    """emcee's default in the paper's coordinates (mu1, sigma_p, sigma_l, q0), from the same starts."""

    def log_density(theta: FloatArray) -> FloatArray:
        inside = (theta[:, 1] > 0) & (theta[:, 2] > 0) & (theta[:, 2] < theta[:, 1]) & (theta[:, 3] > 0) & (theta[:, 3] < 1)
        value = np.full(len(theta), -np.inf)
        names = ("mu1", "sigma_p", "sigma_l", "q0")
        x = posterior.points(dict(zip(names, theta[inside].T, strict=True)))
        prior, (_, sigma_p, sigma_l, _) = posterior.prior, theta[inside].T
        of_mu1 = -0.5 * ((theta[inside, 0] - prior.mu1_mean) / prior.mu1_sd) ** 2
        # gamma = sigma_l^2 / sigma_p^2 is uniform, so sigma_l has the density 2 sigma_l / sigma_p^2
        of_sigmas = -0.5 * (sigma_p / prior.sigma_p_scale) ** 2 + np.log(sigma_l) - 2.0 * np.log(sigma_p)
        value[inside] = posterior.log_likelihood(x) + of_mu1 + of_sigmas
        return value

    def run(effort: int, seed: int) -> Outcome:
        starts = [_natural(posterior, cloud) for cloud in _cloud(posterior, seed)]
        return Outcome(_ensembles(log_density, starts, None, effort, seed))

    return run


def _cloud(posterior: bt.Posterior, seed: int) -> list[FloatArray]:
    """Starts about the highest maximum, none of them far out, (WALKERS, 4) for each ensemble."""
    maxima, rng = find_maxima(posterior), np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(maxima.curvature[0])
    scale = 1.0 / np.sqrt(np.maximum(values, 1.0) if values[0] <= 0.01 else values)
    clouds = []
    for _ in range(ENSEMBLES):
        points, shrink = np.empty((0, 4)), 1.0
        while len(points) < WALKERS:
            cloud = maxima.x[0] + shrink * (rng.standard_normal((WALKERS, 4)) * scale) @ vectors.T
            points, shrink = np.concatenate([points, cloud[posterior.log_density(cloud) > maxima.value[0] - 20.0]]), 0.9 * shrink
        clouds.append(points[:WALKERS])
    return clouds


def _ensembles(log_density: Callable[[FloatArray], FloatArray], starts: list[FloatArray], moves: Any, steps: int, seed: int) -> FloatArray:
    """Kept points of independent ensembles, walker-major, (ensembles, draws, 4)."""
    kept = []
    for index, start in enumerate(starts):
        sampler = emcee.EnsembleSampler(WALKERS, 4, log_density, vectorize=True, moves=moves)
        sampler.random_state = np.random.RandomState([seed, index]).get_state()  # the only way to seed it
        sampler.run_mcmc(start, steps)
        kept.append(sampler.get_chain(discard=steps // 4).transpose(1, 0, 2).reshape(-1, 4))
    return np.stack(kept)


def nutpie(posterior: bt.Posterior) -> Run:
    """NUTS by nutpie on the identified coordinates in PyMC; effort is the number of draws of each of four chains."""
    import nutpie
    import pymc as pm
    from pytensor import tensor as pt

    with pm.Model() as model:
        x = [pm.Flat(name) for name in COORDINATES]
        pm.Potential("log_posterior", _log_density(posterior, x, pt, pt.softplus))
    _require_same(posterior, model.compile_logp())
    compiled = nutpie.compile_pymc_model(model)

    def run(effort: int, seed: int) -> Outcome:
        draws = nutpie.sample(compiled, draws=effort, chains=CHAINS, cores=1, seed=seed, progress_bar=False)["posterior"]
        return Outcome(_natural(posterior, np.stack([np.asarray(draws[name]) for name in COORDINATES], axis=-1)))

    return run


def numpyro(posterior: bt.Posterior) -> Run:
    """NUTS by NumPyro on the same, the whole run in one jit; compiled by a first run."""
    import jax
    import numpyro
    from jax import numpy as jnp
    from numpyro import distributions as dist
    from numpyro.infer import MCMC, NUTS
    from numpyro.infer.util import log_density

    numpyro.enable_x64()

    def model() -> None:
        flat = dist.ImproperUniform(dist.constraints.real, (), ())
        x = [numpyro.sample(name, flat) for name in COORDINATES]
        numpyro.factor("log_posterior", _log_density(posterior, x, jnp, jax.nn.softplus))

    _require_same(posterior, lambda values: log_density(model, (), {}, values)[0])
    compiled: dict[int, Any] = {}

    def run(effort: int, seed: int) -> Outcome:
        def whole(key: Any) -> Any:
            sampler = MCMC(
                NUTS(model), num_warmup=1000, num_samples=effort, num_chains=CHAINS, chain_method="sequential", progress_bar=False
            )
            sampler.run(key)
            return sampler.get_samples(group_by_chain=True)

        draws = compiled.setdefault(effort, jax.jit(whole))(jax.random.PRNGKey(seed))
        return Outcome(_natural(posterior, np.stack([np.asarray(draws[name]) for name in COORDINATES], axis=-1)))

    return run


def _log_density(posterior: bt.Posterior, x: Any, library: Any, softplus: Any) -> Any:
    """The log posterior at (offset, logit pull, log width, logit q0), written in another library's operations."""
    subject, prior = posterior.subject, posterior.prior
    equal, different = subject.n_yes.astype(float), (subject.n_trials - subject.n_yes).astype(float)
    c, a, b, top = x
    p = MAX_PULL / (1.0 + library.exp(-a))
    mu1, sigma_p = posterior.sbar + c / p, library.exp(b) * (1.0 - p) ** 1.5
    fall = np.log(2.0) * ((subject.s2 - subject.s1 - c + p * (subject.s1 - posterior.sbar)) * library.exp(-b)) ** 2
    log_different = library.log(library.exp(-softplus(top)) - library.exp(-softplus(-top)) * library.expm1(-fall))
    of_mu1 = -0.5 * ((mu1 - prior.mu1_mean) / prior.mu1_sd) ** 2 - np.log(prior.mu1_sd * np.sqrt(2.0 * np.pi))
    of_sigma_p = -0.5 * (sigma_p / prior.sigma_p_scale) ** 2 + 0.5 * np.log(2.0 / np.pi) - np.log(prior.sigma_p_scale)
    jacobian = library.log1p(p) - 1.5 * library.log1p(-p) - softplus(a) + b - softplus(top) - softplus(-top)
    return of_mu1 + of_sigma_p + jacobian + (equal * (-softplus(-top) - fall) + different * log_different).sum()


def _require_same(posterior: bt.Posterior, log_density: Callable[[dict[str, Any]], Any]) -> None:
    """Another library's model is the package's: at points about the maximum, before anything is timed."""
    points = _cloud(posterior, 1)[0][:20]
    found = [float(log_density(dict(zip(COORDINATES, point, strict=True)))) for point in points]
    gap = np.abs(np.array(found) - posterior.log_density(points)).max()
    if not gap < 1e-6:
        raise InputError(f"subject {posterior.subject.name!r}: a library's log density differs from the package's by {gap:.1e} nat")


def dynesty(posterior: bt.Posterior) -> Run:
    """Static nested sampling over the unit cube, mapped by a wide normal and a logistic density; effort is the number of live points."""
    import dynesty

    centre, scale = np.array([0.0, 0.0, -1.0]), np.array([1.5, 5.0, 1.5])

    def place(u: FloatArray) -> FloatArray:
        return np.append(centre + scale * ndtri(u[:3]), logit(u[3]))

    def log_ratio(x: FloatArray) -> float:
        base = (
            -0.5 * np.square((x[:3] - centre) / scale).sum() - np.log(scale * np.sqrt(2.0 * np.pi)).sum() + log_expit([x[3], -x[3]]).sum()
        )
        return float(posterior.log_density(x)[0] - base)

    def run(effort: int, seed: int) -> Outcome:
        sampler = dynesty.NestedSampler(log_ratio, place, 4, nlive=effort, rstate=np.random.default_rng(seed))
        sampler.run_nested(print_progress=False, maxcall=200_000)
        return Outcome(log_evidence=float(sampler.results.logz[-1]))

    return run


_DIFFERENTIAL = [(emcee.moves.DEMove(), 0.8), (emcee.moves.StretchMove(), 0.2)]
#: By name: how a subject is made ready, the effort and its unit, the library that must be there.
METHODS: Mapping[str, tuple[Callable[[bt.Posterior], Run], int, str, str]] = {
    "bayes_toe, 4,000 draws": (own, 4000, "effective draws", "emcee"),
    "bayes_toe, 10,000 draws": (own, 10_000, "effective draws", "emcee"),
    "bayes_toe, 40,000 draws": (own, 40_000, "effective draws", "emcee"),
    "emcee stretch, the paper's coordinates": (emcee_natural, 1000, "steps", "emcee"),
    "emcee stretch, identified": (emcee_identified(None), 800, "steps", "emcee"),
    "emcee DE and stretch, identified": (emcee_identified(_DIFFERENTIAL), 800, "steps", "emcee"),
    "nutpie, identified": (nutpie, 4000, "draws a chain", "nutpie"),
    "NumPyro in one jit, identified": (numpyro, 4000, "draws a chain", "numpyro"),
    "bayes_toe, evidence": (own, 0, "", "emcee"),
    "dynesty, evidence": (dynesty, 500, "live points", "dynesty"),
}


def _natural(posterior: bt.Posterior, x: FloatArray) -> FloatArray:
    return np.stack([np.asarray(part) for part in posterior.natural(x)], axis=-1)


# --- The race ---------------------------------------------------------------------------------------------------------------------------


def main() -> int:
    """Parse, refuse early, race, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True, help="table to write, a row a subject and method")
    parser.add_argument("--subjects", nargs="+", default=["S01", "S05", "S09", "S15"], help="bundled subjects")
    parser.add_argument("--runs", type=int, default=4, help="runs of every method on every subject")
    parser.add_argument("--shrink", type=int, default=1, help="divide every effort by this: for a quick look")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    try:
        require_writable(options.output, overwrite=options.overwrite)
        table = pd.DataFrame([row for name in options.subjects for row in raced(name, options.runs, options.shrink, options.seed)])
        write_table(table, options.output, overwrite=options.overwrite)
    except BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    print(medians(table).to_string(float_format=lambda value: f"{value:.3g}"))
    return 0


def raced(name: str, runs: int, shrink: int, seed: int) -> list[dict[str, object]]:
    """The rows of one subject; a library that is not installed has none."""
    stored = json.loads(REFERENCE.read_text(encoding="utf-8"))
    if name not in stored["cases"]:
        raise InputError(f"--subjects: no reference of {name!r}; there are: {', '.join(stored['cases'])}")
    posterior, rows = bt.model.posterior_of(bt.example_study()[name], bt.Prior()), []
    own(posterior)(100, seed)  # what is imported on the way is not timed
    for method, (prepare, effort, unit, library) in METHODS.items():
        if find_spec(library) is None:
            print(f"{name}: {method}: {library} is not installed", file=sys.stderr)
            continue
        run, outcomes, seconds = prepare(posterior), [], []
        effort = -(-effort // shrink)
        if library == "numpyro":
            run(effort, seed)  # compiles
        for index in range(runs):
            began = time.perf_counter()
            outcomes.append(run(effort, seed + index))
            seconds.append(time.perf_counter() - began)
        measured = score(outcomes, stored["cases"][name])
        wall = float(np.median(seconds))
        rate = {"effective_draws_per_s": measured["effective_draws"] / wall} if "effective_draws" in measured else {}
        rows.append({"subject": name, "method": method, "effort": effort, "unit": unit, "runs": runs, "wall_s": wall, **measured, **rate})
    return rows


def score(outcomes: list[Outcome], case: Mapping[str, Any]) -> dict[str, float]:
    """Median error over runs: of moments and quantiles, the worst of four parameters in posterior sd, or of the log evidence in nats.

    Effective draws of a run are chains times sd^2 / variance of the chains' means, over all runs, the least of the four parameters: with m
    means their relative error is about sqrt(2 / m).
    """
    found = [one.log_evidence for one in outcomes if one.log_evidence is not None]
    if found:
        return {"log_evidence_error": float(np.median(np.abs(np.array(found) - case["log_evidence"])))}
    means, sds, quantiles = (np.asarray(case[key], np.float64)[:4] for key in ("means", "sds", "quantiles"))
    worst, chains = [], []
    for outcome in outcomes:
        assert outcome.draws is not None
        flat = outcome.draws.reshape(-1, 4)
        gaps = [flat.mean(axis=0) - means, flat.std(axis=0) - sds, *(np.quantile(flat, LEVELS, axis=0) - quantiles.T)]
        worst.append(np.max(np.abs(gaps) / sds))
        chains.append(outcome.draws.mean(axis=1))
    every = np.concatenate(chains)
    per_run = len(every) / len(outcomes)
    effective = per_run * np.min(sds**2 / every.var(axis=0, ddof=1)) if len(every) > 2 else np.nan
    return {"error_worst": float(np.median(worst)), "effective_draws": float(effective)}


def medians(table: pd.DataFrame) -> pd.DataFrame:
    """Medians over subjects, and how many times as many effective draws a second the package gives at 10,000."""
    numbers = [
        name for name in ("wall_s", "error_worst", "effective_draws", "effective_draws_per_s", "log_evidence_error") if name in table
    ]
    found = table.groupby("method", sort=False)[numbers].median()
    rates = table.pivot(index="subject", columns="method", values="effective_draws_per_s")
    found["bayes_toe_over_it"] = rates.rdiv(rates["bayes_toe, 10,000 draws"], axis=0).median()
    return found


if __name__ == "__main__":
    sys.exit(main())
