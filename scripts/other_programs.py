"""Other programs on the posteriors that speed_vs_error.py has: H1, a group, and a PSE shift.

A function of data, size and seed returns draws by name, (parameters, chains, draws), or an
interval; nested sampling returns points, their log weights and the log evidence. Programs are
imported where they are used, because some may be missing.
"""

from functools import cache, partial
from itertools import product

import numpy as np
from emcee import EnsembleSampler
from emcee.moves import DEMove, DESnookerMove, StretchMove
from reference.paper_density import Counts, identified, log_density, natural
from reference.tempering import Observer, estimate_by_tempering
from scipy.special import logit, ndtri, softmax

import bayes_toe as bt
from bayes_toe.groups.population import subject_rows
from bayes_toe.inference.order_evidence import MODEL_NAMES
from bayes_toe.model.paper_equations import NATURAL

WARM_UP, N_CHAINS, WALKERS = 1000, 4, 32
#: Evaluations of the likelihood after which nested sampling has failed.
MOST_CALLS = 50_000


# --- Draws from H1, in natural or identified coordinates -----------------------------------------


def draw(sampler, coordinates, posterior, size, seed):
    """Draw by a sampler that knows the density; it starts at draws of the posterior."""
    counts = Counts.of_subject(posterior.subject)
    starts = starting_points(posterior)
    if coordinates == "identified":
        starts, _ = identified(starts, counts.sbar)
    points = sampler(coordinates, counts, starts, size, seed)
    if coordinates == "natural":
        points, _ = identified(points, counts.sbar)
    return {"draws": np.stack(natural(points, counts.sbar))}


@cache
def starting_points(posterior):
    """Draws of the posterior in natural coordinates, (chains, walkers, 4)."""
    study = bt.Study([posterior.subject])
    draws = bt.sample(study, prior="paper", draws=1000, seed=0, workers=1)
    values = np.reshape(draws.natural(posterior.subject.name), (4, -1))
    rng = np.random.default_rng(0)
    mu1, sigma_p, sigma_l, q0 = rng.choice(values, (N_CHAINS, WALKERS), axis=1, replace=False)
    return np.stack([mu1, np.log(sigma_p), logit((sigma_l / sigma_p) ** 2), logit(q0)], axis=-1)


def run_emcee(moves, coordinates, counts, starts, size, seed):
    """Independent ensembles of emcee."""
    density = partial(log_density, counts=counts, coordinates=coordinates)
    chains = []
    for i, start in enumerate(starts):
        sampler = EnsembleSampler(WALKERS, 4, density, moves=moves, vectorize=True)
        sampler.random_state = np.random.RandomState(1000 * seed + i).get_state()
        sampler.run_mcmc(start, size, skip_initial_state_check=True)
        chains.append(sampler.get_chain().swapaxes(0, 1).reshape(-1, 4))
    return np.stack(chains)


def run_nutpie(coordinates, counts, starts, size, seed):
    """NUTS of nutpie."""
    import nutpie

    data = {name: np.asarray(values, float) for name, values in counts._asdict().items()}
    model = nutpie_model(coordinates).with_data(**data)
    options = {"init_mean": starts[0, 0], "cores": 1, "progress_bar": False, "seed": seed}
    trace = nutpie.sample(model, draws=size, tune=WARM_UP, chains=N_CHAINS, **options)
    return trace.posterior["x"].values


@cache
def nutpie_model(coordinates):
    """The compiled density for the counts of any subject."""
    import nutpie
    import pymc
    import pytensor.tensor as pt

    with pymc.Model() as model:
        *names, sbar = Counts._fields
        columns = [pymc.Data(name, np.ones(2)) for name in names]
        counts = Counts(*columns, pymc.Data(sbar, 0.0))
        x = pymc.Flat("x", shape=4)
        pymc.Potential("density", log_density(x[None], counts, coordinates, pt)[0])
    return nutpie.compile_pymc_model(model)


def run_numpyro(coordinates, counts, starts, size, seed):
    """NUTS of NumPyro."""
    draws = numpyro_sampler(numpyro_h1, coordinates, size, 0.8)
    return np.asarray(draws(seed, {"x": starts[:, 0]}, *counts)["x"])


def numpyro_h1(coordinates, *counts):
    """The density as a model of NumPyro."""
    import jax.numpy as jnp
    from numpyro import distributions, factor, sample

    x = sample("x", distributions.Normal().expand([4]).mask(False))
    factor("density", log_density(x[None], Counts(*counts), coordinates, jnp)[0])


@cache
def numpyro_sampler(model, form, size, target_accept_prob):
    """All chains of a form of a model as one compiled function of seed, starts and data."""
    import jax
    import numpyro
    from numpyro.infer import MCMC, NUTS

    numpyro.enable_x64()
    sizes = {"num_warmup": WARM_UP, "num_samples": size, "num_chains": N_CHAINS}

    def draws(seed, starts, *data):
        kernel = NUTS(partial(model, form), target_accept_prob=target_accept_prob)
        sampler = MCMC(kernel, chain_method="vectorized", progress_bar=False, **sizes)
        sampler.run(jax.random.key(seed), *data, init_params=starts)
        return sampler.get_samples(group_by_chain=True)

    return jax.jit(draws)


# --- Programs that need normal scores of the prior: points, log weights and log evidence ----------


def h1_by_scores(program, posterior, size, seed):
    """Weighted draws from H1, and its log evidence."""
    return weighted_draws(posterior, *program(posterior.log_likelihood, 4, size, seed))


def weighted_draws(posterior, points, log_weights, log_evidence):
    """Weighted draws at normal scores of the prior, and the log evidence."""
    values = posterior.quantities(points)
    draws = np.stack([values[name] for name in NATURAL])[:, None]
    return {"draws": draws, "weights": softmax(log_weights), "log_evidence": log_evidence}


def order_by_scores(program, subject, size, seed):
    """The log evidences of the four models."""
    values = []
    for name in MODEL_NAMES:
        observer = Observer(subject, name)
        values.append(program(observer, len(observer.parameters), size, seed)[-1])
    return {"log_evidence": values}


def run_dynesty(log_likelihood, k, size, seed):
    """Nested sampling by dynesty."""
    import dynesty

    def at_point(scores):
        return log_likelihood(scores[None])[0]

    rng = np.random.default_rng(seed)
    sampler = dynesty.NestedSampler(at_point, ndtri, k, nlive=size, rstate=rng)
    sampler.run_nested(print_progress=False, maxcall=MOST_CALLS)
    results = sampler.results
    require_end(results.ncall.sum())
    return results.samples, results.logwt, results.logz[-1]


def run_nautilus(log_likelihood, k, size, seed):
    """The same by nautilus."""
    import nautilus

    options = {"n_live": size, "n_networks": 1, "vectorized": True, "seed": seed}
    sampler = nautilus.Sampler(ndtri, log_likelihood, n_dim=k, **options)
    sampler.run(n_eff=2 * size, n_like_max=MOST_CALLS)
    require_end(sampler.n_like)
    points, log_weights, _ = sampler.posterior()
    return points, log_weights, sampler.log_z


def require_end(n_calls):
    """Refuse a run that stopped because it had too many evaluations."""
    if n_calls >= MOST_CALLS:
        raise RuntimeError(f"not done after {MOST_CALLS:,} evaluations")


# --- Means and standard deviations of a group ----------------------------------------------------


def group_by_numpyro(study, size, seed):
    """Draw by NumPyro."""
    rows = subject_rows(study).rows
    names = ("slope_unit", "first", "difference", "middle", "n_yes", "n_no")
    columns = [np.reshape(getattr(rows, name), (len(study), -1)) for name in names]
    draws = numpyro_sampler(numpyro_group, None, size, 0.95)(seed, None, *columns)
    return {"draws": np.moveaxis(np.asarray(draws["group"]), -1, 0)}


def numpyro_group(_, slope_unit, first, difference, middle, n_yes, n_no):
    """The group of 2AFC subjects as a model of NumPyro, which shares no code with the package."""
    from jax.numpy import concatenate, exp, stack
    from jax.scipy.special import ndtr
    from numpyro import deterministic, plate, sample
    from numpyro.distributions import Beta, Binomial, HalfNormal, Normal, StudentT

    mean_c = sample("mean_c", StudentT(3.0, 0.0, 0.5))
    mean_p = sample("mean_p", Normal(0.0, 0.2))
    mean_noise = sample("mean_noise", Normal(0.0, 0.6))
    sd_c = abs(sample("sd_c", StudentT(3.0, 0.0, 0.3)))
    sd_p = sample("sd_p", HalfNormal(0.15))
    sd_noise = sample("sd_noise", HalfNormal(0.4))
    mean, sd = stack([mean_c, mean_p, mean_noise]), stack([sd_c, sd_p, sd_noise])
    deterministic("group", concatenate([mean, sd]))
    with plate("subjects", len(first)):
        score = sample("score", Normal().expand([3]).to_event(1))
        lapse_rate = sample("lapse_rate", Beta(1.0, 9.0))[:, None]
        slope = sample("slope", StudentT(3.0, 0.0, 0.15))[:, None]
    c, p, log_noise = (mean + sd * score).T[:, :, None]
    z = (difference - c + p * first) * exp(-log_noise - slope * slope_unit * middle)
    p_yes = 0.5 * lapse_rate + (1.0 - lapse_rate) * ndtr(z)
    answers = Binomial((n_yes + n_no).astype(int), p_yes).to_event(2)
    sample("answers", answers, obs=n_yes.astype(int))


# --- PSE shift of an observer: 5, 50 and 95 % quantiles ------------------------------------------


def shift_by_psignifit(subject, size, seed):
    """The mean of the PSEs of both orders, as the stimulus difference s2 - s1."""
    import psignifit

    columns = np.column_stack([subject.s2 - subject.s1, subject.n_yes, subject.n_trials])
    options = {"sigmoid": "norm", "experiment_type": "equal asymptote"}
    pses, widths = [], []
    for standard in (subject.s1, subject.s2):
        curve = psignifit.psignifit(columns[standard == 0.0], **options)
        pses.append(curve.parameter_estimate["threshold"])
        widths.append(np.ptp(curve.confidence_intervals["threshold"]["0.9"]))
    half = 0.25 * np.hypot(*widths)
    return {"interval": np.mean(pses) + half * np.array([-1.0, 0.0, 1.0])}


# --- The table of methods ------------------------------------------------------------------------

SNOOKER = [(DEMove(), 0.8), (DESnookerMove(), 0.2)]
SAMPLERS = {
    "emcee stretch": ("emcee", partial(run_emcee, StretchMove()), 200, 800),
    "emcee DE and snooker": ("emcee", partial(run_emcee, SNOOKER), 200, 800),
    "nutpie": ("nutpie", run_nutpie, 1000, 4000),
    "NumPyro": ("numpyro", run_numpyro, 1000, 4000),
}
#: By target and name of a method: its program, its function, and its sizes, 1 without draws.
METHODS = {
    "H1": {},
    "four models": {},
    "group": {"NumPyro": ("numpyro", group_by_numpyro, 800)},
    "PSE shift": {"psignifit": ("psignifit", shift_by_psignifit, 1)},
}
for (name, (program, sampler, *sizes)), system in product(
    SAMPLERS.items(), ("natural", "identified")
):
    function = partial(draw, sampler, system)
    METHODS["H1"][f"{name}, {system}"] = program, function, *sizes
for target, by_scores in (("H1", h1_by_scores), ("four models", order_by_scores)):
    METHODS[target] |= {
        "tempering": ("bayes_toe", partial(by_scores, estimate_by_tempering), 1),
        "dynesty": ("dynesty", partial(by_scores, run_dynesty), 50),
        "nautilus": ("nautilus-sampler", partial(by_scores, run_nautilus), 300),
    }
