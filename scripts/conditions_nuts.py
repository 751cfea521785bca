"""The group of docs/conditions.md by another library: NumPyro's NUTS on a likelihood written out anew. Needs `pip install numpyro`.

    python scripts/conditions_nuts.py data/auditory_pwm/trials.csv

Of every subject s and delay t, with x = (t - 4)/4: offset c, probit of the pull p and log width w are u_s + x d_s, noise slope b and
guesses g are the subject's; z = (s2 - s1 + p (s1 - sbar) - c) / (w exp(b m)), P(second) = g/2 + (1 - g) Phi(z). Only the numbers of the
hyperprior are the package's.
"""

from __future__ import annotations

import argparse

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pandas as pd
from jax.scipy.special import ndtr
from numpyro.infer import MCMC, NUTS, init_to_median

import bayes_toe as bt
from bayes_toe.model.contrasted import DIFFERENCE, unit_of

NAMES = ("offset", "pull", "width", "lapse_rate", "noise_slope")


def model(
    pairs: dict[str, np.ndarray],
    subjects: int,
    mean: np.ndarray,
    mean_sd: np.ndarray,
    sd_scale: np.ndarray,
    apart: np.ndarray,
) -> None:
    """Means, scatters and subjects of five parameters, then of three differences, none centred."""
    m = numpyro.sample("m", dist.Normal(mean, mean_sd).to_event(1))
    tau = numpyro.sample("tau", dist.HalfNormal(sd_scale).to_event(1))
    beta = numpyro.sample("beta", dist.Normal(0.0, apart).to_event(1))
    tau_b = numpyro.sample("tau_b", dist.HalfNormal(apart).to_event(1))
    u = m + tau * numpyro.sample("u", dist.Normal(0.0, 1.0).expand([subjects, 5]).to_event(2))
    d = beta + tau_b * numpyro.sample("d", dist.Normal(0.0, 1.0).expand([subjects, 3]).to_event(2))
    own = u[pairs["who"]]
    offset, probit, log_width = (own[:, :3] + pairs["x"][:, None] * d[pairs["who"]]).T
    middle = 0.5 * (pairs["s1"] + pairs["s2"]) - pairs["sbar"]
    z = (
        pairs["s2"] - pairs["s1"] + ndtr(probit) * (pairs["s1"] - pairs["sbar"]) - offset
    ) * jnp.exp(-log_width - own[:, 4] * middle)
    guesses = ndtr(own[:, 3])
    numpyro.sample(
        "n", dist.Binomial(pairs["n"], guesses / 2 + (1 - guesses) * ndtr(z)), obs=pairs["k"]
    )


def main() -> None:
    """Sample, and print differences over the range of delays beside those of `bt.population`."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("trials")
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--subjects", type=int, default=1000)
    parser.add_argument("--package", action="store_true", help="sample with the package too")
    asked = parser.parse_args()
    numpyro.set_host_device_count(2)
    jax.config.update("jax_enable_x64", True)
    trials = pd.read_csv(asked.trials).dropna(subset=["response"])
    trials = trials[trials.subject.isin(trials.subject.unique()[: asked.subjects])]
    pairs = (
        trials.assign(k=trials.response == "second", n=1)
        .groupby(["subject", "s1", "s2", "isi"], as_index=False)[["k", "n"]]
        .sum()
    )
    sbar = pairs.assign(total=pairs.s1 * pairs.n).groupby("subject")[["total", "n"]].sum()
    who, names = pd.factorize(pairs.subject)
    columns = {key: pairs[key].to_numpy(float) for key in ("s1", "s2", "k", "n")}
    columns |= {
        "who": who,
        "x": (pairs.isi.to_numpy() - 4.0) / 4.0,
        "sbar": (sbar.total / sbar.n)[pairs.subject].to_numpy(),
    }
    study = bt.read_study(trials, bt.ReadOptions(condition="isi"))
    whole = study.without_conditions()
    given = bt.Hyperprior().for_study(whole).numbers(NAMES)
    apart = DIFFERENCE * np.array(
        [unit_of(name, bt.model.prior_for(study).at(*whole)) for name in NAMES[:3]]
    )
    sizes = {
        "num_warmup": 800,
        "num_samples": asked.draws,
        "num_chains": 2,
        "chain_method": "sequential",
        "progress_bar": False,
    }
    run = MCMC(NUTS(model, target_accept_prob=0.9, init_strategy=init_to_median), **sizes)
    run.run(
        jax.random.PRNGKey(1), columns, len(names), given.mean, given.mean_sd, given.sd_scale, apart
    )
    found = run.get_samples(group_by_chain=True)
    for i, name in enumerate(NAMES[:3]):
        beta, tau = np.asarray(found["beta"])[..., i], np.asarray(found["tau_b"])[..., i]
        ess = float(numpyro.diagnostics.effective_sample_size(beta))
        said = f"{beta.mean():+.4f} +- {beta.std():.4f} | between subjects {tau.mean():.4f} +- {tau.std():.4f}"
        print(f"NUTS | {name} | {said} | {ess:.0f} effective draws", flush=True)
    if asked.package:
        for row in bt.population(study, model="contraction + sloped", draws=1000, seed=1).table:
            if row.quantity.startswith("condition"):
                print(
                    f"bayes_toe | {row.parameter} | {row.quantity} | {row.mean:+.4f} +- {row.sd:.4f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
