"""Is the joint posterior of a group calibrated? Groups drawn from the hyperprior answer, and true values are ranked among draws.

A population is drawn from the hyperprior, members from it, with one covariate, answers to the paper's 13 pairs from them; `population`
analyses the answers as usual, and each true value is ranked among draws. Where everything is right ranks are uniform, whatever the data.
One row a study is written as soon as it is done; with --resume a run goes on. Studies that did not converge are ranked with the others.

Example: python scripts/population_calibration.py -o docs --studies 200 --seed 1 --resume
Exit code 3 where ranks of a quantity are outside their band.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import bayes_toe as bt
from bayes_toe.arrays import FloatArray, IntArray
from bayes_toe.data.covariates import Covariates
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_writable
from bayes_toe.experiments.calibration_table import FALSE_ALARM
from bayes_toe.experiments.rank_bands import POINTS, band, ecdf_difference, uniformity
from bayes_toe.experiments.simulate import Design, reference_design
from bayes_toe.groups import chains
from bayes_toe.groups.hamiltonian import Hamiltonian
from bayes_toe.groups.hyperprior import Hyperprior, HyperpriorNumbers
from bayes_toe.groups.population import Population, population
from bayes_toe.groups.regressors import regressors
from bayes_toe.groups.scatter import scatter_named
from bayes_toe.model.ladder import model_named
from bayes_toe.model.posterior import Model, Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.plots.figure_files import save_figure
from bayes_toe.plots.style import EQUAL, LETTERS, PAGE, STRONGER_FIRST, WEAKER_FIRST, dress, new_figure
from bayes_toe.seeds import generator

SIZES = (4, 16)
TRIALS = 20
#: Effective draws asked for, and how many are ranked among: about independent.
DRAWS, USED = 100, 32
#: Observers more or less as in the paper. The default numbers allow some who never say 'equal', of whom answers tell next to nothing: their
#: posteriors are full of narrow corners, and one study takes minutes.
NUMBERS = {
    "mu1": {"mean_sd": 0.5, "sd_scale": 0.5, "effect_sd": 0.3},
    "gamma": {"mean_sd": 0.7, "sd_scale": 0.7, "effect_sd": 0.5},
    "width": {"mean_sd": 0.3, "sd_scale": 0.3, "effect_sd": 0.2},
    "q0": {"mean_sd": 0.5, "sd_scale": 0.5, "effect_sd": 0.3},
}
#: A shorter run than usual. R-hat below 1.01 takes thousands of draws, however few are wanted, where there are 32 halves of chains.
QUICK = {"MAX_R_HAT": 1.1, "_FIRST": 4.0}
QUICK_ROUNDS = ((20, 30),)
FILES = ("population_calibration.csv", "population_calibration.png")
KINDS = ("mean", "sd", "effect", "first", "new")
COLOURS = {4: (STRONGER_FIRST, "-"), 16: (WEAKER_FIRST, (0, (3, 1.2)))}


def main() -> int:
    """Simulate, analyse, rank; write the table after each study, the figure at the end."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to write to; the committed run is in docs")
    parser.add_argument("--studies", type=int, default=200, help="studies of each size")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="subjects of a study")
    parser.add_argument("--model", default="update")
    parser.add_argument("--scatter", default="normal", choices=("normal", "t"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--overwrite", action="store_true")
    parser.add_argument("--resume", action="store_true", help="studies that are in the table are kept")
    options = parser.parse_args()
    try:
        path, picture = (options.output / name for name in FILES)
        for one in (path, picture):
            require_writable(one, overwrite=options.overwrite or options.resume)
        rows = pd.read_csv(path, keep_default_na=False).to_dict("records") if options.resume and path.exists() else []
        there = {(row["subjects"], row["study"]) for row in rows}
        for size in options.sizes:
            for number in range(1, options.studies + 1):
                if (size, number) not in there:
                    rows.append(study_row(size, number, options.seed, model_named(options.model), options.scatter))
                    write_table(pd.DataFrame(rows), path, overwrite=True)
        table = pd.read_csv(path, keep_default_na=False)
        save_figure(figure(table), picture, overwrite=True)
        verdicts = judged(table)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    print(verdicts.to_string(index=False))
    return 0 if (verdicts["verdict"] == "inside").all() else 3


# --- one study --------------------------------------------------------------------------------------------------------------------------


def study_row(size: int, number: int, seed: int, model: Model, scatter: str) -> dict[str, object]:
    """Simulate a group, analyse it, rank what is known of it."""
    rng, design = generator(seed, "population calibration", size, number), _design()
    names = [f"S{i:02d}" for i in range(1, size + 1)]
    people = Covariates({"age": dict(zip(names, rng.standard_normal(size).tolist(), strict=True))})
    hyperprior = Hyperprior().for_study(_study(names, design, np.zeros((size, len(design.s1)), int))).changed(NUMBERS)
    numbers, x = hyperprior.numbers(model.group), regressors(people, names).x
    mean, sd, effect = _shared(numbers, rng)
    eta = mean + x * effect + sd * scatter_named(scatter).sample(rng, (size, len(mean)))
    new = mean + sd * scatter_named(scatter).sample(rng, (len(mean),))
    study = _study(names, design, _answers(model, names, design, eta, rng))
    started = time.process_time()
    quick = patch.multiple(chains, **QUICK), patch.object(Hamiltonian.warm_up, "__defaults__", QUICK_ROUNDS)
    with warnings.catch_warnings(), quick[0], quick[1]:
        warnings.simplefilter("ignore", bt.errors.ConvergenceWarning)
        found = population(
            study, covariates=people, model=model.name, draws=DRAWS, hyperprior=hyperprior, scatter=scatter, seed=number, workers=1
        )
    truth = np.stack([mean, sd, effect, eta[0], new])
    return {
        "subjects": size,
        "study": number,
        "shortfall": found.chains.reason,
        "divergent": found.chains.divergent,
        "trajectories": found.chains.mean[..., 0].size,
        "gradients": found.chains.gradients,
        "seconds": round(time.process_time() - started, 2),
        **{f"{kind} of {name}": rank for (kind, name), rank in _ranks(found, truth, rng).items()},
        "log likelihood": _rank_of_likelihood(found, eta, rng),
        **{f"true sd of {name}": float(f"{value:.4g}") for name, value in zip(model.group, sd, strict=True)},
    }


def _design() -> Design:
    """The paper's pairs, sorted as those of subjects are, so that counts by pair are theirs."""
    design = reference_design(batches=TRIALS)
    order = np.lexsort((design.s2, design.s1))
    return Design(design.s1[order], design.s2[order], TRIALS)


def _shared(numbers: HyperpriorNumbers, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, scatter and effect of the covariate, (k,) each, from the hyperprior."""
    z = rng.standard_normal((3, len(numbers.mean)))
    return numbers.mean + numbers.mean_sd * z[0], np.abs(numbers.sd_scale * z[1]), numbers.effect_sd * z[2]


def _study(names: list[str], design: Design, n_equal: IntArray) -> Study:
    return Study(
        [Subject(name, design.s1, design.s2, k, [TRIALS] * len(k)) for name, k in zip(names, n_equal, strict=True)], synthetic=True
    )


def _answers(model: Model, names: list[str], design: Design, eta: FloatArray, rng: np.random.Generator) -> IntArray:
    """Counts of 'equal', shape (subjects, pairs)."""
    any_one = _study(names[:1], design, np.zeros((1, len(design.s1)), int)).subjects[0]
    assert np.array_equal([any_one.s1, any_one.s2], [design.s1, design.s2])
    posterior = Posterior(any_one, model, Prior(offset_sd=1.0))
    x, _ = posterior.from_group(eta)
    q, _ = posterior.realised_answers(rng, x, posterior.log_answers(x))
    return rng.binomial(TRIALS, np.exp(q))


def _used(draws: FloatArray) -> FloatArray:
    """Draws far apart, (chains, draws, ...) -> (USED, ...): as many of each chain, the last one among them."""
    each = USED // draws.shape[0]
    return draws[:, -1 :: -(draws.shape[1] // each)][:, :each].reshape(USED, *draws.shape[2:])


def _ranks(found: Population, truth: FloatArray, rng: np.random.Generator) -> dict[tuple[str, str], float]:
    """Ranks of mean, sd, effect, first member and a new one, by kind and name, in 0..1."""
    own = found.chains
    columns = (own.mean, own.scatter, own.effects[:, :, 0], own.eta[:, :, 0], found.new_subject())
    return {
        (kind, name): _rank(_used(draws)[:, j], true[j], rng)
        for kind, draws, true in zip(KINDS, columns, truth, strict=True)
        for j, name in enumerate(found.names)
    }


def _rank_of_likelihood(found: Population, eta: FloatArray, rng: np.random.Generator) -> float:
    """Of the log likelihood of all members: it sees every one of them at once."""
    every = np.concatenate([_used(found.chains.eta), eta[None]])
    posteriors = [found.posterior(name) for name in found.study.names]
    values = sum(one.log_likelihood(one.from_group(every[:, i])[0]) for i, one in enumerate(posteriors))
    return _rank(values[:-1], values[-1], rng)


def _rank(draws: FloatArray, true: float, rng: np.random.Generator) -> float:
    """Share of the draws below, made continuous by drawing within the place that the truth takes among them."""
    low, high = (draws < true).sum(), (draws <= true).sum()
    return float(round((rng.integers(low, high + 1) + rng.uniform()) / (len(draws) + 1), 6))


# --- all studies ------------------------------------------------------------------------------------------------------------------------


def _quantities(table: pd.DataFrame) -> list[str]:
    return [name for name in table.columns if name.startswith(tuple(f"{kind} of " for kind in KINDS)) or name == "log likelihood"]


def judged(table: pd.DataFrame) -> pd.DataFrame:
    """A verdict for every quantity and size: outside where the p-value falls below 0.01 shared among them all."""
    quantities, rows = _quantities(table), []
    for size, found in table.groupby("subjects"):
        for name in quantities:
            difference, p = ecdf_difference(found[name]), uniformity(found[name])
            far = int(np.abs(difference).argmax())
            inside = p >= FALSE_ALARM / (len(quantities) * table["subjects"].nunique())
            numbers = (
                size,
                name,
                len(found),
                f"{difference[far]:+.3f}",
                f"{POINTS[far]:.2f}",
                f"{p:.2g}",
                "inside" if inside else "outside",
            )
            rows.append(dict(zip(("subjects", "quantity", "studies", "largest difference", "at", "p", "verdict"), numbers, strict=True)))
    return pd.DataFrame(rows)


def figure(table: pd.DataFrame) -> Figure:
    """Distribution functions of ranks minus the uniform one, a panel a quantity, with the band that all lines stay in with 99 %."""
    quantities, ends = _quantities(table), np.concatenate([[0.0], POINTS, [1.0]])
    columns = (len(quantities) - 1) // len(KINDS)
    made = new_figure(PAGE, 1.25 * (len(KINDS) + 1))
    panels = made.subplots(len(KINDS) + 1, columns, sharex=True, sharey=True).ravel()
    for ax, name in zip(panels, quantities, strict=False):
        for size, found in table.groupby("subjects"):
            lower, upper = band(len(found), 1.0 - FALSE_ALARM / (len(quantities) * table["subjects"].nunique())).differences()
            ax.fill_between(ends, np.pad(lower, 1), np.pad(upper, 1), color=EQUAL, alpha=0.15, lw=0)
            colour, line = COLOURS.get(int(size), ("black", "-"))
            ax.plot(
                ends, np.pad(ecdf_difference(found[name]), 1), color=colour, ls=line, lw=1.1, label=f"{size} subjects, {len(found)} studies"
            )
        ax.axhline(0.0, color="black", lw=0.5)
        ax.set_title(name, fontsize=LETTERS)
        ax.set_xlim(0.0, 1.0)
        dress(ax)
    for ax in panels[len(quantities) :]:
        ax.axis("off")
    made.legend(*panels[0].get_legend_handles_labels(), fontsize=LETTERS, loc="lower right", frameon=False)
    made.supxlabel("rank of the true value", fontsize=LETTERS)
    made.supylabel("ECDF difference", fontsize=LETTERS)
    return made


if __name__ == "__main__":
    sys.exit(main())
