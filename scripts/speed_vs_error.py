"""Speed against error: this package and other programs on the same posteriors, by processor time.

    python scripts/speed_vs_error.py --quick               # two subjects
    python scripts/speed_vs_error.py --full                # writes docs/speed_vs_error.md, csv, svg
    python scripts/speed_vs_error.py --full --sections group    # measures the group again
    python scripts/speed_vs_error.py --full --sections     # writes the page from the table

`pip install bayes_toe[peers]` installs the other programs. Missing programs are skipped.
Every method has one thread. A new row takes the place of the row with the same settings.
"""

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
import warnings
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import emcee
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from jinja2 import Environment, StrictUndefined
from reference.hard_cases import hard_cases
from reference.order_cases import order_cases
from reference.pages import markdown
from reference.paper_density import Counts, PaperDensity, identified
from reference.tempering import Observer, refined, tempered
from scipy.special import logit, ndtri, softmax
from threadpoolctl import threadpool_limits

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.design.study_design import StudyDesign
from bayes_toe.groups.population import study_scales, subject_rows
from bayes_toe.inference.diagnostics import convergence_of, worst
from bayes_toe.inference.fitted import find_maxima, fit_posterior, importance_evidence
from bayes_toe.inference.maxima import laplace
from bayes_toe.inference.order_evidence import MODEL_NAMES, order_evidence
from bayes_toe.inference.sampling import SamplerSettings
from bayes_toe.inference.subject import AnalysisRequest, fitted_result
from bayes_toe.model.paper_model import PaperPosterior

ROOT = Path(__file__).resolve().parents[1]
PRIOR = bt.Prior()
WARM_UP, N_CHAINS, WALKERS = 1000, 4, 32
LARGEST_R_HAT = 1.01
#: What identifies a row.
KEYS = ("target", "kind", "subject", "method", "size", "seed")
NUMBERS = ("seconds", "error", "effective", "nats", "width", "covered", "elapsed", "megabytes")
COLUMNS = ("section", *KEYS, "problem", *NUMBERS, "program", "load", "started", "commit", "machine")
#: Evaluations of the likelihood after which nested sampling has failed.
MOST_CALLS = 50_000
#: Nats below the best model from which on the error of an evidence does not count.
FAR = 6.0


class Case(NamedTuple):
    """A posterior of a subject or study, and the reference for its error."""

    target: str
    kind: str
    name: str
    data: Any
    reference: Any = None


# --- Draws from H1: (parameters, chains, draws) --------------------------------------------------


def natural_values(posterior, scores):
    """Natural parameters of H1 at scores of the prior."""
    values = posterior.quantities(scores)
    return np.stack([values[name] for name in posterior.names.natural])


def draw_sample(posterior, size, seed):
    """Draw by `sample`."""
    request = AnalysisRequest(SamplerSettings(draws=size))
    chains = fitted_result(posterior, seed, request).chains
    return {"draws": natural_values(posterior, chains.x)}


def draw_importance(posterior, size, seed):
    """Draw from the fitted mixture, with weights."""
    rng = np.random.default_rng(seed)
    fitted = fit_posterior(posterior, rng)
    draws = fitted.fresh(rng, size)
    evidence = importance_evidence(draws)
    if evidence.value is None:
        raise RuntimeError(f"Pareto k {evidence.pareto_k:.2f}, no evidence")
    values = natural_values(posterior, fitted.original(draws.x)[0])
    return {"draws": values[:, None], "weights": draws.shares, "log_evidence": evidence.value}


@cache
def starting_points(posterior, coordinates):
    """Draws of the posterior, where other samplers start."""
    values = draw_sample(posterior, 1000, 0)["draws"]
    rng = np.random.default_rng(0)
    draws = rng.choice(values.reshape(4, -1), N_CHAINS * WALKERS, axis=1, replace=False)
    mu1, sigma_p, sigma_l, q0 = draws
    columns = mu1, np.log(sigma_p), logit((sigma_l / sigma_p) ** 2), logit(q0)
    points = np.stack(columns, axis=-1)
    if coordinates == "identified":
        columns, _ = identified(points, Counts.of_subject(posterior.subject).sbar)
        points = np.stack(columns, axis=-1)
    return points


def draw_elsewhere(sampler, coordinates, posterior, size, seed):
    """Draw by a sampler that knows the density."""
    density = PaperDensity(posterior.subject, PRIOR, coordinates)
    points = sampler(density, starting_points(posterior, coordinates), size, seed)
    return {"draws": np.stack(density.natural(points))}


def run_emcee(moves, density, starts, size, seed):
    """Independent ensembles of emcee."""
    chains = []
    for i, start in enumerate(np.split(starts, N_CHAINS)):
        sampler = emcee.EnsembleSampler(
            WALKERS, 4, density.log_density, moves=moves, vectorize=True
        )
        sampler.random_state = np.random.RandomState(1000 * seed + i).get_state()
        sampler.run_mcmc(start, size, skip_initial_state_check=True)
        chains.append(sampler.get_chain().swapaxes(0, 1).reshape(-1, 4))
    return np.stack(chains)


def run_nutpie(density, starts, size, seed):
    """NUTS of nutpie."""
    import nutpie

    counts = density.counts._asdict()
    data = {name: np.asarray(values, float) for name, values in counts.items()}
    model = compile_nutpie(density.coordinates).with_data(**data)
    options = {"init_mean": starts[0], "cores": 1, "progress_bar": False, "seed": seed}
    trace = nutpie.sample(model, draws=size, tune=WARM_UP, chains=N_CHAINS, **options)
    return trace.posterior["x"].values


@cache
def compile_nutpie(coordinates):
    """The density for the counts of any subject."""
    import nutpie
    import pymc
    import pytensor.tensor as pt

    density = PaperDensity(hard_cases()["funnel"], PRIOR, coordinates)
    with pymc.Model() as model:
        columns = [pymc.Data(name, np.ones(2)) for name in Counts._fields[:-1]]
        counts = Counts(*columns, pymc.Data("sbar", 0.0))
        x = pymc.Flat("x", shape=4)
        pymc.Potential("density", density.log_density_of(x[None], counts, pt)[0])
    return nutpie.compile_pymc_model(model)


def run_numpyro(density, starts, size, seed):
    """NUTS of NumPyro."""
    draws = compile_numpyro(numpyro_density(density.coordinates), size, 0.8)
    return np.asarray(draws(seed, {"x": starts[::WALKERS]}, *density.counts)["x"])


@cache
def numpyro_density(coordinates):
    """The density for the counts of any subject as a model of NumPyro."""
    import jax.numpy as jnp
    import numpyro
    from numpyro.distributions import ImproperUniform, constraints

    density = PaperDensity(hard_cases()["funnel"], PRIOR, coordinates)

    def model(*counts):
        x = numpyro.sample("x", ImproperUniform(constraints.real_vector, (), (4,)))
        numpyro.factor("density", density.log_density_of(x[None], Counts(*counts), jnp)[0])

    return model


@cache
def compile_numpyro(model, size, target_accept_prob):
    """All chains of a model as one compiled function of seed, starts and data."""
    import jax
    import numpyro
    from numpyro.infer import MCMC, NUTS

    numpyro.enable_x64()
    sizes = {"num_warmup": WARM_UP, "num_samples": size, "num_chains": N_CHAINS}

    def draws(seed, starts, *data):
        kernel = NUTS(model, target_accept_prob=target_accept_prob)
        sampler = MCMC(kernel, chain_method="vectorized", progress_bar=False, **sizes)
        sampler.run(jax.random.key(seed), *data, init_params=starts)
        return sampler.get_samples(group_by_chain=True)

    return jax.jit(draws)


# --- Log evidences of H1 and of the four models --------------------------------------------------


def likelihoods(data):
    """Log likelihoods of standard normal scores, and how many scores they have."""
    if isinstance(data, PaperPosterior):
        return [(data.log_likelihood, 4)]
    observers = [Observer(data, name) for name in MODEL_NAMES]
    return [(observer, len(observer.parameters)) for observer in observers]


def temper(data, size, seed):
    """Estimate by tempering."""
    values = []
    for log_likelihood, k in likelihoods(data):
        rng = np.random.default_rng(seed)
        points, _ = tempered(log_likelihood, k, rng, 1000)
        values.append(refined(log_likelihood, points, rng, 4000)[0])
    return {"log_evidence": values}


def h1_laplace(posterior, size, seed):
    """Estimate by Laplace's approximation."""
    return {"log_evidence": laplace(posterior.array, [find_maxima(posterior)])[1]}


def order_engine(name, subject, size, seed):
    """Estimates of the package."""
    (evidence,) = order_evidence([subject], seed)
    return {"log_evidence": getattr(evidence, name)}


def nest(program, data, size, seed):
    """Estimate by nested sampling, with weighted draws of H1."""
    runs = [program(*likelihood, size, seed) for likelihood in likelihoods(data)]
    result = {"log_evidence": [log_evidence for _, _, log_evidence in runs]}
    if isinstance(data, PaperPosterior):
        points, log_weights, _ = runs[0]
        result["draws"] = natural_values(data, points)[:, None]
        result["weights"] = softmax(log_weights)
    return result


def run_dynesty(log_likelihood, k, size, seed):
    """Points, log weights and log evidence by dynesty."""
    import dynesty

    def at_point(scores):
        return log_likelihood(scores[None])[0]

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

    options = {"n_live": size, "vectorized": True, "seed": seed}
    sampler = nautilus.Sampler(ndtri, log_likelihood, n_dim=k, **options)
    if not sampler.run(n_eff=2 * size, n_like_max=MOST_CALLS):
        raise RuntimeError(f"not done after {MOST_CALLS:,} evaluations")
    points, log_weights, _ = sampler.posterior()
    return points, log_weights, sampler.log_z


# --- Means and standard deviations of a group ----------------------------------------------------


def group_by_package(study, size, seed):
    """Draw by `population`."""
    draws = bt.population(study, draws=N_CHAINS * size, seed=seed).draws
    return {"draws": np.moveaxis(np.concatenate([draws.mean, draws.sd], axis=-1), -1, 0)}


def group_by_numpyro(study, size, seed):
    """Draw by NumPyro."""
    rows = subject_rows(study, study_scales(study)).rows
    names = ("first", "difference", "middle", "n_yes", "n_no")
    columns = [getattr(rows, name)[:, 0] for name in names]
    draws = compile_numpyro(numpyro_group, size, 0.95)(seed, None, *columns, rows.slope_unit)
    return {"draws": np.moveaxis(np.asarray(draws["group"]), -1, 0)}


def numpyro_group(first, difference, middle, n_yes, n_no, slope_unit):
    """The group of 2AFC subjects as a model of NumPyro, which shares no code with the package."""
    from jax.numpy import exp, stack
    from jax.scipy.special import ndtr
    from numpyro import deterministic, plate, sample
    from numpyro import distributions as dist

    mean_c = sample("mean_c", dist.StudentT(3.0, 0.0, 0.5))
    mean_p = sample("mean_p", dist.Normal(0.0, 0.2))
    mean_noise = sample("mean_noise", dist.Normal(0.0, 0.6))
    sd_c = abs(sample("sd_c", dist.StudentT(3.0, 0.0, 0.3)))
    sd_p = sample("sd_p", dist.HalfNormal(0.15))
    sd_noise = sample("sd_noise", dist.HalfNormal(0.4))
    deterministic("group", stack([mean_c, mean_p, mean_noise, sd_c, sd_p, sd_noise]))
    with plate("subjects", len(first)):
        score = sample("score", dist.Normal().expand([3]).to_event(1))
        lapse_rate = sample("lapse_rate", dist.Beta(1.0, 9.0))[:, None]
        slope = sample("slope", dist.StudentT(3.0, 0.0, 0.15))[:, None]
    c = mean_c + sd_c * score[:, :1]
    p = mean_p + sd_p * score[:, 1:2]
    log_noise = mean_noise + sd_noise * score[:, 2:] + slope * slope_unit * middle
    z = (difference - c + p * first) * exp(-log_noise)
    p_yes = 0.5 * lapse_rate + (1.0 - lapse_rate) * ndtr(z)
    answers = dist.Binomial((n_yes + n_no).astype(int), p_yes).to_event(2)
    sample("answers", answers, obs=n_yes.astype(int))


# --- PSE shift of an observer: 5, 50 and 95 % quantiles ------------------------------------------


def shift_by_sample(subject, size, seed):
    """The constant error in its model."""
    study = bt.Study([subject])
    draws = bt.sample(study, model="constant-error", draws=size, seed=seed, workers=1)
    row = draws.summary().set_index("parameter").loc["constant_error"]
    return {"interval": row[["q05", "q50", "q95"]]}


def shift_by_psignifit(subject, size, seed):
    """The mean of the PSEs of both orders, as the stimulus difference s2 - s1."""
    import psignifit

    columns = np.column_stack([subject.s2 - subject.s1, subject.n_yes, subject.n_trials])
    pses, widths = [], []
    for is_order in (subject.s1 == 0.0, subject.s2 == 0.0):
        shape = {"sigmoid": "norm", "experiment_type": "equal asymptote"}
        curve = psignifit.psignifit(columns[is_order], **shape)
        pses.append(curve.parameter_estimate["threshold"])
        widths.append(np.ptp(curve.confidence_intervals["threshold"]["0.9"]))
    middle, half = np.mean(pses), 0.25 * np.hypot(*widths)
    return {"interval": (middle - half, middle, middle + half)}


# --- Scaling: a call in a process of its own -----------------------------------------------------

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


def run_program(call, workers, numbers, size, seed):
    """Elapsed seconds and megabytes."""
    program = PROGRAM.format(call=CALLS[call], workers=workers, **numbers)
    command = [sys.executable, "-W", "ignore", "-c", program]
    return {"usage": json.loads(subprocess.check_output(command, stderr=subprocess.DEVNULL))}


# --- What is measured ----------------------------------------------------------------------------


class Method(NamedTuple):
    """A function of data, size and seed; a method without draws has the size 1."""

    target: str
    name: str
    program: str
    function: Any
    sizes: tuple[int, ...] = (1,)


STRETCH = emcee.moves.StretchMove()
SNOOKER = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
METHODS = [
    Method("H1", "sample", "bayes_toe", draw_sample, (1000, 4000, 16_000)),
    Method("H1", "importance draws", "bayes_toe", draw_importance, (4000, 16_000, 64_000)),
    Method("H1", "Laplace", "bayes_toe", h1_laplace),
    Method("four models", "engine", "bayes_toe", partial(order_engine, "log_evidence")),
    Method("four models", "Laplace", "bayes_toe", partial(order_engine, "laplace")),
    Method("group", "population", "bayes_toe", group_by_package, (800,)),
    Method("group", "NumPyro", "numpyro", group_by_numpyro, (800,)),
    Method("PSE shift", "sample", "bayes_toe", shift_by_sample, (1000,)),
    Method("PSE shift", "psignifit", "psignifit", shift_by_psignifit),
    Method("run", "1 worker", "bayes_toe", partial(run_program, "run", 1)),
    Method("run", "2 workers", "bayes_toe", partial(run_program, "run", 2)),
    Method("run", "2 workers of Dask", "dask", partial(run_program, "run", "Dask")),
    Method("population", "1 worker", "bayes_toe", partial(run_program, "population", 1)),
]
SAMPLERS = [
    Method("H1", "emcee stretch", "emcee", partial(run_emcee, STRETCH), (200, 800)),
    Method("H1", "emcee DE and snooker", "emcee", partial(run_emcee, SNOOKER), (200, 800)),
    Method("H1", "nutpie", "nutpie", run_nutpie, (1000, 4000)),
    Method("H1", "NumPyro", "numpyro", run_numpyro, (1000, 4000)),
]
for sampler, system in product(SAMPLERS, ("natural", "identified")):
    function = partial(draw_elsewhere, sampler.function, system)
    METHODS.append(sampler._replace(name=f"{sampler.name}, {system}", function=function))
for target in ("H1", "four models"):
    METHODS += [
        Method(target, "tempering", "bayes_toe", temper),
        Method(target, "dynesty", "dynesty", partial(nest, run_dynesty), (50,)),
        Method(target, "nautilus", "nautilus-sampler", partial(nest, run_nautilus), (500,)),
    ]


def is_installed(program):
    """Whether a program is installed."""
    try:
        return bool(version(program))
    except PackageNotFoundError:
        return False


def stored(file):
    """The stored references by case."""
    return json.loads((ROOT / "tests" / "reference" / file).read_text(encoding="utf-8"))["cases"]


def h1_cases(kind, subjects):
    """The posterior of H1 of subjects."""
    cases, references = [], stored("reference.json")
    for subject in subjects:
        posterior = bt.model.paper_posterior(subject, PRIOR)
        cases.append(Case("H1", kind, subject.name, posterior, references[subject.name]))
    return cases


def evidence_cases():
    """The four models."""
    cases, references = [], stored("order_models.json")
    for name, subject in order_cases().items():
        values = [references[f"{name}: {model}"]["log_evidence"] for model in MODEL_NAMES]
        kind = "ordinary" if "S0" in name else "hard"
        cases.append(Case("four models", kind, name, subject, {"log_evidence": values}))
    return cases


def group_cases():
    """The group of the 2AFC example, with a long run."""
    study = bt.example_study()
    study = study.select(study.names[:12])
    draws = group_by_package(study, 8000, 99)["draws"].reshape(6, -1)
    reference = {"means": draws.mean(axis=1), "sds": draws.std(axis=1)}
    return [Case("group", "ordinary", "12 subjects", study, reference)]


def curve_cases():
    """Simulated observers with known constant errors."""
    comparisons = np.linspace(-0.4, 0.4, 8)
    pairs = np.append(np.zeros(8), comparisons), np.append(comparisons, np.zeros(8))
    design = StudyDesign(*pairs, np.full(16, 40), task="2afc")
    shifts = np.linspace(-0.15, 0.15, 20)
    observers = {f"O{i}": {"noise": 0.2, "constant_error": shifts[i]} for i in range(20)}
    study = bt.simulate(observers, design=design, batches=40, task="2afc", seed=67).study
    case = partial(Case, "PSE shift", "ordinary")
    return [case(subject.name, subject, shifts[i]) for i, subject in enumerate(study)]


def scaling_cases(largest):
    """Numbers of subjects, and of trials of a pair."""
    cases = []
    for call in CALLS:
        for n in (10, 100, 1000, 10_000):
            if n <= largest:
                cases.append(Case(call, "subjects", str(n), {"subjects": n, "trials": 100}))
        for n in (100, 1000, 10_000, 100_000, 1_000_000):
            cases.append(Case(call, "trials a pair", str(n), {"subjects": 10, "trials": n}))
    return cases


SECTIONS = ("ordinary", "hard", "evidence", "curves", "group", "scaling")


def errors(result, reference):
    """Errors in posterior standard deviations and in nats, and what the draws claim."""
    row = result.get("usage", {})
    if "draws" in result:
        draws, weights = result["draws"], result.get("weights")
        k = len(draws)
        means = np.average(draws.reshape(k, -1), axis=1, weights=weights)
        offsets = np.subtract(means, reference["means"][:k]) / reference["sds"][:k]
        row["error"] = np.linalg.norm(offsets) / np.sqrt(k)
        if weights is None:
            (_, row["effective"]), (_, r_hat) = worst(convergence_of(dict(enumerate(draws))))
            if not r_hat < LARGEST_R_HAT:
                row["problem"] = f"R-hat {r_hat:.2f}"
        else:
            row["effective"] = 1.0 / np.square(weights).sum()
    if "log_evidence" in result:
        known = np.atleast_1d(reference["log_evidence"])
        is_near = known > known.max() - FAR
        row["nats"] = np.abs(result["log_evidence"] - known)[is_near].max()
        if not np.isfinite(row["nats"]):
            row["problem"] = "does not exist"
    if "interval" in result:
        low, middle, high = result["interval"]
        row["error"], row["width"] = abs(middle - reference), high - low
        row["covered"] = float(low <= reference <= high)
    return row


def cpu_seconds():
    """Processor seconds of this process and of those that it waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def measure(method, case, size, seed):
    """Processor seconds and errors, or the reason of a failure."""
    try:
        with threadpool_limits(1), warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            if method.program in ("nutpie", "numpyro"):
                method.function(case.data, size, 0)  # compiles
            start = cpu_seconds()
            result = method.function(case.data, size, seed)
            seconds = cpu_seconds() - start
            return {"seconds": seconds, **errors(result, case.reference)}
    except Exception as error:  # the failure of a method is a result
        return {"problem": f"{error or type(error).__name__}".splitlines()[0][:100]}


# --- Page ----------------------------------------------------------------------------------------


def show(table):
    """A table in Markdown."""
    table = table.reset_index().rename(columns={"kind": "case"})
    for name in table.select_dtypes("float"):
        table[name] = table[name].map("{:,.3g}".format).replace("nan", "-")
    return markdown(table.fillna("-"))


def ratio_table(draws):
    """Seconds for an effective draw over those of `sample`, by kind of subject and method."""
    keys = ["kind", "subject", "method"]
    cost = (draws["seconds"] / draws["effective"]).groupby([draws[key] for key in keys]).mean()
    ratios = cost / cost.xs("sample", level="method")
    groups = ratios.dropna().groupby(["kind", "method"])
    table = groups.agg(subjects="count", median="median", smallest="min")
    table["at"] = [subject for _, subject, _ in groups.idxmin()]
    table["failures"] = draws.groupby(["kind", "method"])["problem"].count()
    return table.sort_values(["kind", "median"], ascending=[False, True])


def median_table(rows):
    """Medians of what is measured, and the largest error of an evidence."""
    groups = rows.groupby(["target", "kind", "method"])
    table = groups[["seconds", "error", "effective", "nats", "width"]].median()
    columns = {"largest": groups["nats"].max(), "covered": groups["covered"].mean()}
    return table.assign(**columns, failures=groups["problem"].count())


def hard_table(draws):
    """A row for each hard case, a column for each method."""
    numbers = draws["error"].map("{:.3f}, ".format) + draws["seconds"].map("{:.2g} s".format)
    cells = draws.assign(cell=draws["problem"].fillna(numbers))
    return cells[cells["kind"] == "hard"].pivot_table("cell", "subject", "method", "first")


def scaling_table(rows):
    """Seconds and memory, with the slope from the row before."""
    keys = ["target", "method", "kind"]
    table = rows.assign(number=rows["subject"].astype(int)).sort_values([*keys, "number"])
    rises = np.log(table[["number", "seconds"]]).groupby([table[key] for key in keys]).diff()
    table["slope"] = rises["seconds"] / rises["number"]
    return table.set_index(keys)[["number", "seconds", "slope", "elapsed", "megabytes"]]


def draw_figure(draws, path):
    """Median error against median seconds, a line for each method."""
    plt.rcParams["svg.hashsalt"] = "speed_vs_error"
    shape = {"figsize": (9, 4.5), "layout": "constrained"}
    figure, panels = plt.subplots(1, 2, sharex=True, sharey=True, **shape)
    for ax, kind in zip(panels, ("ordinary", "hard"), strict=True):
        of_kind = draws[draws["kind"] == kind]
        for method in draws["method"].unique():
            rows = of_kind[of_kind["method"] == method]
            line = rows.groupby("size")[["seconds", "error"]].median()
            style = {"marker": "o", "label": method}
            if method == "sample":
                style = {"marker": "*", "markersize": 16, "color": "black", "label": method}
            ax.loglog(line["seconds"], line["error"], **style)
        ax.set(title=f"{kind} subjects", xlabel="processor seconds")
    panels[0].set_ylabel("error of means (posterior SD)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.savefig(path, metadata={"Date": None})


def write_page(rows, stem, is_full_run):
    """Write the figure and the page."""
    largest = rows.sort_values("size").drop_duplicates([*KEYS[:4], "seed"], keep="last")
    is_draw = "target == 'H1' and size > 1"
    is_shown = f"{is_draw} and not method.str.endswith('natural')"
    draw_figure(rows.query(is_shown), stem.with_suffix(".svg"))
    template = Path(__file__).with_suffix(".md").read_text(encoding="utf-8")
    environment = Environment(undefined=StrictUndefined, trim_blocks=True)
    environment.filters["table"] = show
    page = environment.from_string(template).render(
        rows=rows,
        is_full_run=is_full_run,
        r_hat=LARGEST_R_HAT,
        missing={method.program for method in METHODS} - set(rows["program"].str.split().str[0]),
        ratios=ratio_table(largest.query(is_draw)),
        hard=hard_table(largest.query(is_shown)),
        medians=median_table(largest.query("section != 'scaling'")),
        scaling=scaling_table(rows.query("section == 'scaling'")),
    )
    stem.with_suffix(".md").write_text(page + "\n", encoding="utf-8")


def main():
    """Measure every method on every case, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    size = parser.add_mutually_exclusive_group(required=True)
    size.add_argument("--quick", action="store_true", help="a case of the first sections")
    size.add_argument("--full", action="store_true", help="all cases")
    parser.add_argument("--sections", nargs="*", choices=SECTIONS)
    parser.add_argument("--seeds", type=int, default=1, help="runs of each method")
    parser.add_argument("--largest", type=int, default=1000, help="most subjects of the scaling")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs", help="folder")
    options = parser.parse_args()
    sections = options.sections
    if sections is None:
        sections = SECTIONS[:4] if options.quick else SECTIONS
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    git = ["git", "rev-parse", "--short=8", "HEAD"]
    call = {
        "started": time.ctime(),
        "commit": subprocess.check_output(git, cwd=ROOT, text=True).strip(),
        "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
    }

    example = bt.example_study("same/different")
    cases_of = {
        "ordinary": partial(h1_cases, "ordinary", example.select(("S01", "S05", "S09", "S15"))),
        "hard": partial(h1_cases, "hard", hard_cases().values()),
        "evidence": evidence_cases,
        "curves": curve_cases,
        "group": group_cases,
        "scaling": partial(scaling_cases, options.largest),
    }
    stem = options.output / "speed_vs_error"
    stem.parent.mkdir(exist_ok=True)
    file = stem.with_suffix(".csv")
    read_rows = partial(pd.read_csv, file, dtype={"subject": str})
    rows = read_rows().to_dict("records") if file.exists() else []
    by_key = {tuple(row[key] for key in KEYS): row for row in rows}
    n_cases = 1 if options.quick else None
    for section in sections:
        for case, method in product(cases_of[section]()[:n_cases], METHODS):
            if method.target != case.target or not is_installed(method.program):
                continue
            sizes = method.sizes[:1] if options.quick else method.sizes
            for size, seed in product(sizes, range(options.seeds)):
                key = case.target, case.kind, case.name, method.name, size, seed
                row = {"section": section, **dict(zip(KEYS, key, strict=True)), "problem": ""}
                row |= measure(method, case, size, 1 + seed)
                print(*row.values(), sep=", ", flush=True)
                program = f"{method.program} {version(method.program)}"
                by_key[key] = {**row, "program": program, "load": os.getloadavg()[0], **call}
                table = pd.DataFrame(list(by_key.values()), columns=COLUMNS)
                write_table(table, file, overwrite=True)

    rows = read_rows()
    is_whole = options.full and set(SECTIONS) == set(sections)
    write_page(rows, stem, is_whole and set(rows["started"]) == {call["started"]})


if __name__ == "__main__":
    main()
