"""Speed against error: this package and other programs on the same posteriors, by processor time.

    python scripts/speed_vs_error.py --quick               # two subjects; no other program needed
    python scripts/speed_vs_error.py --full                # writes docs/speed_vs_error.md, csv, svg
    python scripts/speed_vs_error.py --full --sections ordinary hard evidence group curves scaling

`pip install bayes_toe[peers]` installs the other programs; those that are missing are skipped.
Every method has one thread. The references are in tests/reference; that of the group is a long run.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
import warnings
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path
from typing import NamedTuple

import emcee
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from reference.hard_cases import hard_cases
from reference.order_cases import order_cases
from reference.pages import markdown
from reference.paper_density import Counts, PaperDensity
from reference.tempering import Observer, refined, tempered
from scipy.special import logit, ndtri
from threadpoolctl import threadpool_limits

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.design.study_design import BatchDesign
from bayes_toe.groups.population import study_scales, subject_rows
from bayes_toe.inference.diagnostics import convergence_of, worst
from bayes_toe.inference.fitted import find_maxima, fit_posterior, importance_evidence
from bayes_toe.inference.maxima import laplace
from bayes_toe.inference.order_evidence import MODEL_NAMES, order_evidence
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import AnalysisRequest, fitted_result
from bayes_toe.model.paper_equations import MAX_PULL
from bayes_toe.model.paper_model import PaperPosterior

ROOT = Path(__file__).resolve().parents[1]
PEERS = ("emcee", "nutpie", "pymc", "numpyro", "dynesty", "nautilus-sampler", "psignifit")
SECTIONS = ("ordinary", "hard", "evidence", "group", "curves", "scaling")
ORDINARY, PRIOR = ("S01", "S05", "S09", "S15"), bt.Prior()
WARM_UP, N_CHAINS, WALKERS = 1000, 4, 32
#: Of nested sampling.
MOST_CALLS = 50_000
#: R-hat from which on draws fail; nats below the best model from which on a model is left out;
#: the ratio below which the page begins with a method.
LARGEST_R_HAT, FAR, CLOSE = 1.01, 6.0, 3.0


class Draws(NamedTuple):
    """Draws of quantities, (quantities, chains, draws); weighted ones have one chain."""

    values: np.ndarray
    weights: np.ndarray | None = None
    log_evidence: float = np.nan


class Case(NamedTuple):
    """The posterior of H1 of a subject.

    The package has it in scores of the prior. Other samplers have the density of the references in
    their coordinates, and start at draws, (points, 4), whose cost does not count.
    """

    posterior: PaperPosterior
    density: PaperDensity
    starts: np.ndarray

    @classmethod
    def of_subject(cls, subject, coordinates):
        """The case of a subject."""
        posterior, rng = bt.model.paper_posterior(subject, PRIOR), np.random.default_rng(0)
        fitted = fit_posterior(posterior, rng)
        u, _ = fitted.original(fitted.draws.resampled(rng, N_CHAINS * WALKERS))
        values = posterior.quantities(u)
        columns = values["mu1"], np.log(values["sigma_p"]), logit(values["gamma"])
        if coordinates == "identified":
            pull = logit(values["pull"] / MAX_PULL)
            columns = values["offset"], pull, np.log(values["width"])
        starts = np.stack([*columns, logit(values["q0"])], axis=-1)
        return cls(posterior, PaperDensity(subject, PRIOR, coordinates), starts)

    def natural(self, u):
        """Natural parameters at scores of the prior, (..., 4) -> (4, ...)."""
        values = self.posterior.quantities(u)
        return np.stack([values[name] for name in self.posterior.names.natural])


# --- Methods that draw from H1 -------------------------------------------------------------------


def draw_sample(case, size, seed):
    """The chains of `sample`."""
    request = AnalysisRequest(SamplerSettings(draws=size))
    chains = fitted_result(case.posterior, seed, request)[0].chains
    return Draws(case.natural(chains.x))


def draw_importance(case, size, seed):
    """Fresh draws of the fitted mixture, with the evidence."""
    rng = np.random.default_rng(seed)
    fitted = fit_posterior(case.posterior, rng)
    draws = fitted.fresh(rng, size)
    evidence = importance_evidence(draws)
    if evidence.value is None:
        raise RuntimeError(f"Pareto k {evidence.pareto_k:.2f}, no evidence")
    values = case.natural(fitted.original(draws.x)[0])
    return Draws(values[:, None], draws.shares, evidence.value)


def draw_emcee(moves, case, size, seed):
    """Independent ensembles of emcee."""
    chains = []
    for i, start in enumerate(np.split(case.starts, N_CHAINS)):
        density = case.density.log_density
        sampler = emcee.EnsembleSampler(WALKERS, 4, density, moves=moves, vectorize=True)
        sampler.random_state = np.random.RandomState(1000 * seed + i).get_state()
        sampler.run_mcmc(start, size, skip_initial_state_check=True)
        chains.append(sampler.get_chain().swapaxes(0, 1).reshape(-1, 4))
    return Draws(np.stack(case.density.natural(np.stack(chains))))


def draw_nutpie(case, size, seed):
    """NUTS of nutpie."""
    import nutpie

    counts = case.density.counts
    model = compile_nutpie(case.density.coordinates, len(counts.first))
    data = {name: np.asarray(values, float) for name, values in counts._asdict().items()}
    options = {"init_mean": case.starts[0], "cores": 1, "progress_bar": False}
    sizes = {"draws": size, "tune": WARM_UP, "chains": N_CHAINS, "seed": seed}
    trace = nutpie.sample(model.with_data(**data), **sizes, **options)
    return Draws(np.stack(case.density.natural(trace.posterior["x"].values)))


@cache
def compile_nutpie(coordinates, n_pairs):
    """The density of all subjects with so many pairs."""
    import nutpie
    import pymc
    import pytensor.tensor as pt

    density = PaperDensity(hard_cases()["funnel"], PRIOR, coordinates)
    with pymc.Model() as model:
        columns = [pymc.Data(name, np.ones(n_pairs)) for name in Counts._fields[:-1]]
        counts = Counts(*columns, pymc.Data("sbar", 0.0))
        x = pymc.Flat("x", shape=4)
        pymc.Potential("density", density.log_density_of(x[None], counts, pt)[0])
    return nutpie.compile_pymc_model(model)


def draw_numpyro(case, size, seed):
    """NUTS of NumPyro."""
    import jax

    draws = compile_numpyro(case.density.coordinates, size)
    starts = {"x": jax.numpy.asarray(case.starts[::WALKERS])}
    counts = map(jax.numpy.asarray, case.density.counts)
    x = np.asarray(draws(jax.random.key(seed), starts, *counts)["x"])
    return Draws(np.stack(case.density.natural(x)))


@cache
def compile_numpyro(coordinates, size):
    """The sampler of all subjects, which compiles once for each number of pairs."""
    import jax.numpy as jnp
    import numpyro
    from numpyro.distributions import ImproperUniform, constraints

    numpyro.enable_x64()
    density = PaperDensity(hard_cases()["funnel"], PRIOR, coordinates)
    flat = ImproperUniform(constraints.real_vector, (), (4,))

    def model(*counts):
        x = numpyro.sample("x", flat)
        numpyro.factor("density", density.log_density_of(x[None], Counts(*counts), jnp)[0])

    return numpyro_draws(model, size, target_accept_prob=0.8)


def numpyro_draws(model, size, **options):
    """All chains of a model as one compiled function of key, starts and data."""
    import jax
    from numpyro.infer import MCMC, NUTS

    sizes = {"num_warmup": WARM_UP, "num_samples": size, "num_chains": N_CHAINS}

    @jax.jit
    def draws(key, starts, *data):
        kernel = NUTS(model, **options)
        sampler = MCMC(kernel, chain_method="vectorized", progress_bar=False, **sizes)
        sampler.run(key, *data, init_params=starts)
        return sampler.get_samples(group_by_chain=True)

    return draws


def draw_nested(program, case, size, seed):
    """Nested sampling from the prior."""
    points, log_weights, log_evidence = program(case.posterior.log_likelihood, 4, size, seed)
    weights = np.exp(log_weights - log_weights.max())
    return Draws(case.natural(points)[:, None], weights / weights.sum(), float(log_evidence))


def run_dynesty(log_likelihood, k, size, seed):
    """Points, log weights and log evidence by dynesty, from k standard normal scores."""
    import dynesty

    def at_point(u):
        return log_likelihood(u[None])[0]

    rng = np.random.default_rng(seed)
    sampler = dynesty.NestedSampler(at_point, ndtri, k, nlive=size, rstate=rng)
    sampler.run_nested(print_progress=False, maxcall=MOST_CALLS)
    results = sampler.results
    if results.ncall.sum() >= MOST_CALLS:
        raise RuntimeError(f"not done after {MOST_CALLS:,} evaluations")
    return results.samples, results.logwt, results.logz[-1]


def run_nautilus(log_likelihood, k, size, seed):
    """The same by nautilus."""
    import nautilus

    sampler = nautilus.Sampler(
        ndtri, log_likelihood, n_dim=k, n_live=size, vectorized=True, seed=seed
    )
    if not sampler.run(n_eff=2 * size, n_like_max=MOST_CALLS):
        raise RuntimeError(f"not done after {MOST_CALLS:,} evaluations")
    points, log_weights, _ = sampler.posterior()
    return points, log_weights, sampler.log_z


STRETCH = emcee.moves.StretchMove()
SNOOKER = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
NESTED = {"dynesty": run_dynesty, "nautilus-sampler": run_nautilus}
#: Of each way to draw from H1 what must be installed, the method, its coordinates and sizes.
BOTH, SCORES = ("natural", "identified"), ("scores",)
METHODS = {
    "sample": ("emcee", draw_sample, SCORES, (1000, 4000, 16_000)),
    "importance draws": ("emcee", draw_importance, SCORES, (4000, 16_000, 64_000)),
    "emcee stretch": ("emcee", partial(draw_emcee, STRETCH), BOTH, (200, 800)),
    "emcee DE and snooker": ("emcee", partial(draw_emcee, SNOOKER), BOTH, (200, 800)),
    "nutpie": ("nutpie", draw_nutpie, BOTH, (1000, 4000)),
    "NumPyro": ("numpyro", draw_numpyro, BOTH, (1000, 4000)),
    "dynesty": ("dynesty", partial(draw_nested, run_dynesty), SCORES, (50,)),
    "nautilus": ("nautilus-sampler", partial(draw_nested, run_nautilus), SCORES, (500,)),
}


# --- What is measured ----------------------------------------------------------------------------


def is_installed(name):
    """Whether a program is installed."""
    try:
        return bool(version(name))
    except PackageNotFoundError:
        return False


def measured(row, work, judge):
    """A row with the processor seconds of the work and its errors, or the reason of a failure."""
    row["problem"] = ""
    start = time.process_time()
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            result = work()
            row["seconds"] = time.process_time() - start
            row |= judge(result)
    except Exception as error:  # the failure of a method is a result
        row["problem"] = f"{error or type(error).__name__}".splitlines()[0][:100]
    print(*row.values(), sep=", ", flush=True)
    return row


def measured_ways(row, ways, judge):
    """A row for each method."""
    return [measured({**row, "method": name}, work, judge) for name, work in ways.items()]


def judge_draws(reference, draws):
    """Errors of draws in posterior standard deviations and in nats, and what they claim."""
    flat = draws.values.reshape(len(draws.values), -1)
    offsets = np.average(flat, axis=1, weights=draws.weights) - reference["means"]
    entries = {"error": np.sqrt(np.mean(np.square(offsets / reference["sds"])))}
    if draws.weights is not None:
        entries["effective"] = 1.0 / np.square(draws.weights).sum()
        entries["nats"] = abs(draws.log_evidence - reference["log_evidence"])
        return entries
    (_, entries["effective"]), (_, r_hat) = worst(convergence_of(dict(enumerate(draws.values))))
    if not r_hat < LARGEST_R_HAT:
        entries["problem"] = f"R-hat {r_hat:.2f}"
    return entries


def stored(file):
    """The stored references by case."""
    return json.loads((ROOT / "tests" / "reference" / file).read_text(encoding="utf-8"))["cases"]


def measure_h1(subjects, kind, chosen_sizes, seeds):
    """Rows of every method on every subject, by some of its sizes."""
    rows, compiled, references = [], set(), stored("reference.json")
    for name, (program, draw, systems, sizes) in METHODS.items():
        for coordinates, subject in product(systems, subjects):
            if not is_installed(program):
                continue
            case = Case.of_subject(subject, coordinates)
            for size, seed in product(sizes[chosen_sizes], seeds):
                shape = name, coordinates, size, subject.n_pairs
                row = {"target": "H1", "kind": kind, "subject": subject.name, "method": name}
                row |= {"coordinates": coordinates, "size": size, "seed": seed}
                work = partial(draw, case, size, seed)
                if program in ("nutpie", "numpyro") and shape not in compiled:
                    measured({"compiles": name}, work, lambda draws: {})
                compiled.add(shape)
                reference = dict(references[subject.name])
                reference["means"] = np.array(reference["means"][:4])
                reference["sds"] = np.array(reference["sds"][:4])
                rows.append(measured(row, work, partial(judge_draws, reference)))
    return rows


def temper(log_likelihood, k, seed):
    """Log evidence by tempering, from k standard normal scores."""
    rng = np.random.default_rng(seed)
    points, _ = tempered(log_likelihood, k, rng, 1000)
    return refined(log_likelihood, points, rng, 4000)[0]


def nested_evidence(program, size, log_likelihood, k, seed):
    """Log evidence by nested sampling."""
    return program(log_likelihood, k, size, seed)[2]


def h1_laplace(posterior):
    """Laplace's log evidence of H1."""
    return laplace(posterior.array, [find_maxima(posterior)])[1]


def four_models(estimate, subject, seed):
    """The log evidences of the four models, by an estimate from a likelihood of scores."""
    observers = [Observer(subject, name) for name in MODEL_NAMES]
    return [estimate(observer, len(observer.parameters), seed) for observer in observers]


def judge_evidence(reference, values):
    """The largest error, nats, of models that are not far below the best one."""
    errors = np.abs(np.subtract(values, reference))[reference > reference.max() - FAR]
    if not np.isfinite(errors).all():
        return {"problem": "does not exist"}
    return {"nats": errors.max()}


def measure_evidence(kinds, is_quick):
    """Rows of log evidences: of H1 by methods that give no draws, and of the four models."""
    rows, known = [], stored("reference.json")
    for kind, subjects in kinds.items():
        for subject in subjects:
            posterior = bt.model.paper_posterior(subject, PRIOR)
            reference = np.array([known[subject.name]["log_evidence"]])
            ways = {
                "Laplace": partial(h1_laplace, posterior),
                "tempering": partial(temper, posterior.log_likelihood, 4, 1),
            }
            row = {"target": "H1", "kind": kind, "subject": subject.name}
            rows += measured_ways(row, ways, partial(judge_evidence, reference))

    known = stored("order_models.json")
    for name, subject in list(order_cases().items())[: 1 if is_quick else None]:
        values = [known[f"{name}: {model}"]["log_evidence"] for model in MODEL_NAMES]
        ways = {
            "engine": lambda subject=subject: order_evidence([subject], 1)[0].log_evidence,
            "Laplace": lambda subject=subject: order_evidence([subject], 1)[0].laplace,
            "tempering": partial(four_models, temper, subject, 1),
        }
        kind = "ordinary" if "S0" in name else "hard"
        for program, size in (("dynesty", 50), ("nautilus-sampler", 500)):
            if is_installed(program) and kind == "ordinary" and not is_quick:
                estimate = partial(nested_evidence, NESTED[program], size)
                ways[program] = partial(four_models, estimate, subject, 1)
        row = {"target": "four models", "kind": kind, "subject": name}
        rows += measured_ways(row, ways, partial(judge_evidence, np.array(values)))
    return rows


def draw_group(study, n_draws, seed):
    """Means and standard deviations of a group by `population`."""
    draws = bt.population(study, draws=n_draws, seed=seed).draws
    return Draws(np.moveaxis(np.concatenate([draws.mean, draws.sd], axis=-1), -1, 0))


def draw_numpyro_group(draws, seed):
    """The same by NumPyro."""
    import jax

    samples = draws(jax.random.key(seed), None)
    sds = [abs(samples["sd_c"]), samples["sd_p"], samples["sd_noise"]]
    return Draws(np.stack([samples["mean_c"], samples["mean_p"], samples["mean_noise"], *sds]))


def numpyro_group(rows, n_draws):
    """The group of 2AFC subjects as a model of NumPyro, which shares no code with the package."""
    import jax
    import jax.numpy as jnp
    import numpyro
    from jax.scipy.special import ndtr
    from numpyro import distributions as dist

    numpyro.enable_x64()
    names = ("first", "difference", "middle", "n_yes", "n_no")
    first, difference, middle, n_yes, n_no = (getattr(rows, name)[:, 0] for name in names)

    def group():
        mean_c = numpyro.sample("mean_c", dist.StudentT(3.0, 0.0, 0.5))
        mean_p = numpyro.sample("mean_p", dist.Normal(0.0, 0.2))
        mean_noise = numpyro.sample("mean_noise", dist.Normal(0.0, 0.6))
        sd_c = jnp.abs(numpyro.sample("sd_c", dist.StudentT(3.0, 0.0, 0.3)))
        sd_p = numpyro.sample("sd_p", dist.HalfNormal(0.15))
        sd_noise = numpyro.sample("sd_noise", dist.HalfNormal(0.4))
        with numpyro.plate("subjects", len(first)):
            score = numpyro.sample("score", dist.Normal().expand([3]).to_event(1))
            lapse_rate = numpyro.sample("lapse_rate", dist.Beta(1.0, 9.0))[:, None]
            slope = numpyro.sample("slope", dist.StudentT(3.0, 0.0, 0.15))[:, None]
        c = mean_c + sd_c * score[:, :1]
        p = mean_p + sd_p * score[:, 1:2]
        log_noise = mean_noise + sd_noise * score[:, 2:]
        z = (difference - c + p * first) * jnp.exp(-log_noise - slope * rows.slope_unit * middle)
        p_yes = 0.5 * lapse_rate + (1.0 - lapse_rate) * ndtr(z)
        answers = dist.Binomial((n_yes + n_no).astype(int), p_yes).to_event(2)
        numpyro.sample("answers", answers, obs=n_yes.astype(int))

    draws = numpyro_draws(group, n_draws, target_accept_prob=0.95)
    draws(jax.random.key(0), None)  # compiles
    return draws


def measure_group(is_quick):
    """Rows of the group of the 2AFC example, against a long run."""
    study = bt.example_study()
    study = study.select(study.names[: 3 if is_quick else 12])
    n_draws = 400 if is_quick else 3200
    long_run = draw_group(study, 10 * n_draws, 99).values.reshape(6, -1)
    reference = {"means": long_run.mean(axis=1), "sds": long_run.std(axis=1)}
    ways = {"population": partial(draw_group, study, n_draws)}
    if is_installed("numpyro") and not is_quick:
        rows = subject_rows(study, study_scales(study)).rows
        ways["NumPyro"] = partial(draw_numpyro_group, numpyro_group(rows, n_draws // N_CHAINS))
    row, rows = {"target": "group", "subject": f"{len(study)} subjects"}, []
    for seed in (1,) if is_quick else (1, 2):
        of_seed = {name: partial(draw, seed) for name, draw in ways.items()}
        rows += measured_ways(row, of_seed, partial(judge_draws, reference))
    return rows


def shift_by_sample(subject):
    """5, 50 and 95 % quantiles of the constant error in its model."""
    draws = bt.sample(bt.Study([subject]), model="constant-error", draws=1000, seed=1, workers=1)
    summary = draws.summary().set_index("parameter")
    return summary.loc["constant_error", ["q05", "q50", "q95"]]


def shift_by_psignifit(subject):
    """Half of the distance between the PSEs of both orders, with its 90 % interval."""
    import psignifit

    pses, widths = [], []
    first_order = subject.s1, subject.s2, subject.n_yes
    second_order = subject.s2, subject.s1, subject.n_trials - subject.n_yes
    for standard, comparison, n_stronger in (first_order, second_order):
        columns = np.column_stack([comparison, n_stronger, subject.n_trials])[standard == 0.0]
        curve = psignifit.psignifit(columns, sigmoid="norm", experiment_type="equal asymptote")
        low, high = curve.confidence_intervals["threshold"]["0.9"]
        pses.append(curve.parameter_estimate["threshold"])
        widths.append(high - low)
    middle, half = 0.5 * (pses[0] - pses[1]), 0.25 * np.hypot(*widths)
    return middle - half, middle, middle + half


def judge_shift(shift, interval):
    """Error and width of an interval, and whether it covers the truth."""
    low, middle, high = interval
    return {
        "error": abs(middle - shift),
        "width": high - low,
        "covered": float(low <= shift <= high),
    }


def measure_curves(n_observers):
    """Rows of the PSE shift of simulated observers, by this package and by curves of psignifit."""
    comparisons = np.linspace(-0.4, 0.4, 8)
    pairs = np.append(np.zeros(8), comparisons), np.append(comparisons, np.zeros(8))
    shifts = np.linspace(-0.15, 0.15, n_observers)
    observers = {f"O{i}": {"noise": 0.2, "constant_error": shift} for i, shift in enumerate(shifts)}
    study = bt.simulate(observers, design=BatchDesign(*pairs, 40), task="2afc", seed=67).study
    rows = []
    for subject, shift in zip(study, shifts, strict=True):
        ways = {"sample": partial(shift_by_sample, subject)}
        if is_installed("psignifit"):
            ways["psignifit"] = partial(shift_by_psignifit, subject)
        row = {"target": "PSE shift", "subject": subject.name}
        rows += measured_ways(row, ways, partial(judge_shift, shift))
    return rows


PROGRAM = """
import json, resource, time
from dataclasses import replace
import bayes_toe as bt
factor, subjects = {trials} // 100, []
for one in bt.simulate({subjects}, batches=100, task="2afc", seed=1).study:
    subjects.append(replace(one, n_yes=factor * one.n_yes, n_trials=factor * one.n_trials))
study = bt.Study(subjects, synthetic=True)
workers = {workers!r}
if workers == "Dask":
    from distributed import Client
    workers = Client(n_workers=2, threads_per_worker=1, dashboard_address=None)
start = time.perf_counter()
bt.{call}
elapsed = time.perf_counter() - start
if not isinstance(workers, int):
    workers.shutdown()
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps(dict(elapsed=elapsed, megabytes=memory)))
"""
CALLS = {
    "run": "run(study, draws=1000, seed=1, workers=workers)",
    "population": "population(study, seed=1)",
}


def run_program(call, n_subjects, n_trials, workers):
    """Elapsed seconds, megabytes, and processor seconds of a process of its own."""
    before = sum(os.times()[2:4])
    parts = {"call": CALLS[call], "subjects": n_subjects, "trials": n_trials, "workers": workers}
    command = [sys.executable, "-W", "ignore", "-c", PROGRAM.format(**parts)]
    printed = subprocess.check_output(command, text=True, stderr=subprocess.DEVNULL)
    return {**json.loads(printed), "seconds": sum(os.times()[2:4]) - before}


def measure_scaling(largest):
    """Rows of `run` and `population` by subjects, by trials of a pair, and by workers."""
    jobs = [("population", 6, 100, 1)]
    if largest >= 10:
        sizes = [(10**k, 100) for k in range(1, 5) if 10**k <= largest]
        sizes += [(10, 10**k) for k in range(3, 7)]
        jobs = [(call, *size, 1) for call, size in product(CALLS, sizes)]
        jobs += [("run", 20, 100, workers) for workers in (1, 2, "Dask")]
    rows = []
    for call, n_subjects, n_trials, workers in jobs:
        row = {"target": call, "subject": n_subjects, "size": n_trials, "method": workers}
        work = partial(run_program, call, n_subjects, n_trials, workers)
        rows.append(measured({**row, "kind": "scaling"}, work, dict))
    return rows


# --- Page ----------------------------------------------------------------------------------------

OURS = ["sample", "importance draws"]


def h1_rows(table):
    """Rows of draws from H1; the label of a method has its coordinates."""
    rows = table[(table["target"] == "H1") & table["size"].notna()].copy()
    is_peer = rows["coordinates"] != "scores"
    rows["label"] = rows["method"].where(~is_peer, rows["method"] + ", " + rows["coordinates"])
    return rows


def ratios_to_sample(rows):
    """By kind and subject, and by measure and label: seconds over those of `sample`."""
    largest = rows[rows["size"] == rows.groupby(["kind", "method"])["size"].transform("max")]
    costs = {
        "draw": largest["seconds"] / largest["effective"],
        "error": largest["seconds"] * np.square(largest["error"]),
    }
    keys, ratios = [largest["kind"], largest["subject"], largest["label"]], {}
    for name, cost in costs.items():
        by_method = cost.groupby(keys).mean().unstack()
        ratios[name] = by_method.div(by_method["sample"], axis=0)
    return pd.concat(ratios, axis=1)


def ratio_table(rows, ratios):
    """Median and smallest ratios of every label, and how often it failed."""
    entries = {}
    for name, kind in product(("draw", "error"), ratios.index.levels[0]):
        of_kind = ratios.loc[kind, name]
        numbers = of_kind.agg(["median", "min"]).map("{:,.3g}".format)
        subject = of_kind.fillna(np.inf).idxmin()
        median, smallest = numbers.to_numpy()
        entries[f"{kind}, {name}"] = median + "; " + smallest + " " + subject
    entries["failures"] = rows["problem"].notna().groupby(rows["label"]).sum()
    table = pd.DataFrame(entries).drop("sample").rename_axis("method").reset_index()
    return table.replace("nan; nan .*", "no result", regex=True)


def better_coordinates(rows, ratios):
    """The rows of each method in its better coordinates."""
    medians = ratios["error"].median().fillna(np.inf)
    methods = rows.drop_duplicates("label").set_index("label")["method"]
    return rows[rows["label"].isin(medians.groupby(methods).idxmin())]


def hard_table(rows):
    """A row for each hard case, a column for each method."""
    hard = rows[rows["kind"] == "hard"]
    numbers = hard["error"].map("{:.3f}".format) + ", " + hard["seconds"].map("{:.2g} s".format)
    cells = hard["problem"].where(hard["problem"].notna(), numbers)
    by_case = cells.groupby([hard["subject"], hard["label"]], sort=False).last().unstack()
    return by_case.fillna("not measured").reset_index()


def summary(rows, keys, **columns):
    """Numbers of rows by keys, and how many rows failed."""
    groups = rows.groupby(keys, sort=False)
    numbers = groups.agg(seconds=("seconds", "median"), **columns).map("{:.3g}".format)
    return numbers.assign(failures=groups["problem"].count()).reset_index()


def scaling_table(rows):
    """Seconds and memory, with the slope from the row before."""
    size = rows["subject"].astype(float) * rows["size"]
    slope = np.log(rows["seconds"]).diff() / np.log(size).diff()
    is_next = (rows["target"] == rows["target"].shift()) & (size > size.shift())
    whole = rows[["subject", "size"]].astype(float).astype(int)
    shown = pd.concat([rows[["target", "method"]], whole], axis=1)
    shown.columns = ["call", "workers", "subjects", "trials a pair"]
    shown["slope"] = slope.map("{:.2f}".format).where(is_next, "")
    for name in ("seconds", "elapsed", "megabytes"):
        shown[name] = rows[name].map("{:,.3g}".format)
    return shown


def draw_figure(rows, path):
    """Median error against median seconds, a line for each method."""
    plt.rcParams["svg.hashsalt"] = "speed_vs_error"
    figure, panels = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
    for ax, kind in zip(panels, ("ordinary", "hard"), strict=True):
        medians = (
            rows[rows["kind"] == kind].groupby(["label", "size"])[["seconds", "error"]].median()
        )
        for i, label in enumerate(rows["label"].unique()):
            style = {"marker": "o", "color": f"C{i}", "label": label}
            if label == "sample":
                style |= {"marker": "*", "markersize": 15, "color": "black"}
            points = medians[medians.index.get_level_values("label") == label]
            ax.plot(points["seconds"], points["error"], **style)
        ax.set(xscale="log", yscale="log", title=f"{kind} subjects", xlabel="processor seconds")
        ax.tick_params(axis="x", which="minor", labelbottom=False)
    panels[0].set_ylabel("error of means (posterior SD)")
    panels[0].legend(fontsize=7)
    figure.savefig(path, metadata={"Date": None})


def write_page(table, stem):
    """Write the figure and the page."""
    rows = h1_rows(table)
    ratios = ratios_to_sample(rows)
    better = better_coordinates(rows, ratios)
    draw_figure(better, stem.with_suffix(".svg"))

    of_peers = ratios["draw"].drop(columns=OURS).groupby("kind").median()
    close, best = [], {}
    for kind, medians in of_peers.iterrows():
        best[f"best_{kind}"] = f"{medians.min():.3g} ({medians.idxmin()})"
        for label, ratio in medians[medians < CLOSE].items():
            close.append(f"{label} ({kind} subjects, {ratio:.2g} times the seconds)")
    sentence = f"No other sampler of H1 comes within a factor of {CLOSE:g} of `sample`."
    if close:
        sentence = (
            f"Within a factor of {CLOSE:g} of `sample` for an effective draw: {'; '.join(close)}."
        )
    group = table[table["target"] == "group"]
    costs = (group["seconds"] / group["effective"]).groupby(group["method"]).median()
    for name, ratio in (costs / costs["population"]).drop("population").items():
        sentence += f" For the group, {name} needs {ratio:.2g} times the seconds of `population`."

    importance = ratios["draw"]["importance draws"]
    with_nats = table[table["nats"].notna() | table["section"].eq("evidence")]
    is_largest = with_nats["size"] == with_nats.groupby("method")["size"].transform("max")
    evidence = with_nats[is_largest | with_nats["size"].isna()]
    keys, is_laplace = ["target", "kind", "method"], evidence["method"] == "Laplace"
    nats = {"nats": ("nats", "median"), "worst": ("nats", "max")}
    error = {"error": ("error", "median")}
    width = {"width": ("width", "median"), "covered": ("covered", "mean")}
    by_target = dict(iter(table.groupby("target")))
    tables = {
        "ratios": ratio_table(rows, ratios),
        "evidence": summary(evidence.sort_values(keys), keys, **nats),
        "group": summary(group, "method", **error, effective=("effective", "median")),
        "curves": summary(by_target["PSE shift"], "method", **error, **width),
        "hard": hard_table(better),
        "scaling": scaling_table(table[table["kind"] == "scaling"]),
    }
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    models = [line.partition(": ")[2] for line in lines if line.startswith("model name")]
    installed = [name for name in PEERS if is_installed(name)]
    template = Path(__file__).with_suffix(".md").read_text(encoding="utf-8")
    page = template.format(
        **{name: markdown(rows) for name, rows in tables.items()},
        **best,
        close=sentence,
        importance=importance.median(),
        most_importance=importance.max(),
        laplace=evidence[is_laplace & (evidence["target"] == "H1")]["nats"].max(),
        r_hat=LARGEST_R_HAT,
        commit=" and ".join(table["commit"].unique()),
        minutes=table["seconds"].sum() / 60.0,
        cores=os.cpu_count(),
        machine=[*models, platform.machine()][0],
        load=os.getloadavg()[2],
        versions=", ".join(f"{name} {version(name)}" for name in ("numpy", *installed)),
        missing=" ".join(f"{name} was not installed." for name in PEERS if name not in installed),
    )
    stem.with_suffix(".md").write_text(page, encoding="utf-8")


def main():
    """Measure, and write the page when every section is measured."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    size = parser.add_mutually_exclusive_group(required=True)
    size.add_argument("--quick", action="store_true", help="two subjects, smallest settings")
    size.add_argument("--full", action="store_true", help="all subjects and settings")
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=SECTIONS)
    parser.add_argument("--seeds", type=int, default=2, help="of ordinary subjects")
    parser.add_argument("--largest", type=int, default=1000, help="most subjects of the scaling")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs", help="folder")
    options = parser.parse_args()
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    print("not installed:", *[name for name in PEERS if not is_installed(name)])

    example, cases = bt.example_study("same/different"), hard_cases()
    kinds = {"ordinary": [example["S01"]], "hard": [cases["funnel"]]}
    chosen_sizes, hard_sizes, n_seeds = slice(1), slice(1), 1
    if options.full:
        kinds = {"ordinary": [example[name] for name in ORDINARY], "hard": list(cases.values())}
        chosen_sizes, hard_sizes, n_seeds = slice(None), slice(-1, None), options.seeds
    of_ordinary = kinds["ordinary"], "ordinary", chosen_sizes, range(1, 1 + n_seeds)
    jobs = (
        partial(measure_h1, *of_ordinary),
        partial(measure_h1, kinds["hard"], "hard", hard_sizes, [1]),
        partial(measure_evidence, kinds, options.quick),
        partial(measure_group, options.quick),
        partial(measure_curves, 2 if options.quick else 20),
        partial(measure_scaling, 0 if options.quick else options.largest),
    )
    file = options.output / "speed_vs_error.csv"
    table = pd.read_csv(file) if file.exists() else pd.DataFrame({"section": []})
    git = ["git", "rev-parse", "--short=8", "HEAD"]
    commit = subprocess.check_output(git, cwd=ROOT, text=True).strip()
    for section, job in zip(SECTIONS, jobs, strict=True):
        if section in options.sections:
            with threadpool_limits(1):
                rows = pd.DataFrame(job()).assign(section=section, commit=commit)
            kept = table[table["section"] != section].to_dict("records")
            table = pd.DataFrame([*kept, *rows.to_dict("records")])
            write_table(table, file, overwrite=True)
    if set(SECTIONS) <= set(table["section"]):
        write_page(pd.read_csv(file), options.output / "speed_vs_error")


if __name__ == "__main__":
    main()
