"""Is there an order effect, and of which kind: how often is the answer right, and are its probabilities honest?

Observers of three kinds (none, constant error, update), each with all four combinations of noise (Weber, sloped) and lapses (misses, both
ways) in turn, are drawn from the prior that the analysis uses and answer the trials of two designs: the paper's 13 pairs, 50 times or 5
times. Evidences of H0 and of the 12 compositions of the default space are computed for each, and from them the probability of each kind.

Evidence: the mean likelihood of draws from the prior, which serve all observers of a design, until its standard error is below 0.05 nat;
where MOST draws do not suffice, the program's own (fitted proposal, importance sampling). `fitted` in the table counts the second kind.

Examples:
    python scripts/order_effect.py -o docs --observers 200 --seed 1
    python scripts/order_effect.py -o docs --observers 200 --seed 1 --resume    # what is in the table is kept; more observers: added
    python scripts/order_effect.py -o docs --figures --overwrite                # from the table; scores to the terminal
"""

import argparse
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import logsumexp, softmax, xlogy
from threadpoolctl import threadpool_limits

import bayes_toe as bt
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_writable
from bayes_toe.errors import InputError
from bayes_toe.experiments.simulate import Design, reference_design
from bayes_toe.inference.proposal import FittedProposal
from bayes_toe.inference.subject import EVIDENCE_DRAWS, Wanted, infer
from bayes_toe.model.free_frequencies import FREE_FREQUENCIES
from bayes_toe.model.ladder import COMPOSED
from bayes_toe.model.parts import compose
from bayes_toe.model.posterior import Model
from bayes_toe.seeds import generator

TABLE = "order_effect.csv"
KINDS = ("none", "constant error", "update")
#: Noise and lapses of every fourth observer of a kind, so that each model of the space is as frequent as its prior probability.
CELLS = (("Weber", "misses"), ("sloped", "both ways"), ("sloped", "misses"), ("Weber", "both ways"))
DESIGNS = {"paper": reference_design(), "sparse": reference_design(batches=5)}
COMPOSITIONS = [model for model in COMPOSED if isinstance(model, Model)]
PLAIN = [compose(order=kind) for kind in KINDS]
PARAMETERS = ("offset", "mu1", "gain", "width", "q0", "noise_slope", "lapse_rate")
#: Prior draws at once and at most, and the effective number that is enough: a standard error of 0.05 nat.
BLOCK, MOST, ENOUGH = 20_000, 6_000_000, 400.0
#: So few observers are left to the fitted proposal at once: it then costs less than further draws from the prior.
FEW = 15
#: Of the numbers in the table.
DIGITS = 5


class Observers(NamedTuple):
    """All observers of a design: their answers, who they are."""

    design: str
    prior: bt.Prior
    subjects: list[bt.Subject]
    rows: list[dict[str, object]]


def main() -> int:
    """Simulate and analyse, or draw what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder; the committed run is in docs")
    parser.add_argument("--observers", type=int, default=200, help="of each kind in each design")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--figures", action="store_true", help="only draw what is in the table")
    parser.add_argument("--overwrite", action="store_true")
    parser.add_argument("--resume", action="store_true")
    options = parser.parse_args()
    try:
        if options.figures:
            from order_effect_figures import draw

            draw(options.output, overwrite=options.overwrite)
        else:
            require_writable(options.output / TABLE, overwrite=options.overwrite or options.resume)
            simulate(options)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


# --- Simulated observers ------------------------------------------------------------------------------


def simulate(options: argparse.Namespace) -> None:
    """Evidence of every model for all observers of every design; the table is written, whole, after each."""
    path, began = options.output / TABLE, time.monotonic()
    everyone = [observers(design, options.observers, options.seed) for design in DESIGNS]
    frame = pd.DataFrame([row for some in everyone for row in some.rows])
    if options.resume and path.exists():
        frame = stored(path, frame)
    for some in everyone:
        design = (frame["design"] == some.design).to_numpy()
        for model in COMPOSITIONS:
            names = [f"log_evidence: {model.name}", f"se: {model.name}", "fitted"]
            left = design & frame[names[1]].isna().to_numpy() if names[1] in frame else design
            if not left.any():
                continue
            asked = some._replace(subjects=[one for one, here in zip(some.subjects, left[design], strict=True) if here])
            value, se, again = evidences(model, asked, options.seed)
            frame.loc[left, names] = np.column_stack([value, se, frame.loc[left, "fitted"] + again])
            write_table(with_probabilities(frame).round(DIGITS), path, overwrite=True)
            words = f"{some.design} design, {model.name}: {len(value)} evidences, {again.sum()} by a fitted proposal"
            print(f"{(time.monotonic() - began) / 60:.1f} min, {words}", flush=True)


def stored(path: Path, asked: pd.DataFrame) -> pd.DataFrame:
    """The observers asked for, with what an earlier run has found out about them."""
    frame, keys = pd.read_csv(path), ["design", "kind", "observer"]
    both = asked.merge(frame, on=keys, how="left", suffixes=("", " before"), validate="one_to_one")
    before = both["fraction_equal before"]
    if before.notna().sum() != len(frame) or not np.allclose(
        before.dropna(), both["fraction_equal"][before.notna()], rtol=0.0, atol=10.0**-DIGITS
    ):
        raise InputError(f"{path}: found other observers, allowed with --resume: those of the same --seed, as many --observers or more")
    both["fitted"] = both["fitted before"].fillna(0)
    return both.drop(columns=[name for name in both if name.endswith(" before")])


def observers(name: str, size: int, seed: int) -> Observers:
    """Observers of every kind with their answers, and what the table says of them."""
    design = DESIGNS[name]
    trials = np.full(len(design.s1), design.batches)
    prior = bt.prior_for(bt.Study([bt.Subject(name, design.s1, design.s2, trials, trials)]), "stimuli")
    subjects, rows = [], []
    for kind in KINDS:
        for i in range(size):
            noise, lapses = CELLS[i % len(CELLS)]
            true = compose(order=kind, noise=noise, lapses=lapses)
            subject, truth = observer(f"{name} {kind} {i}", true, design, prior, seed)
            free = FREE_FREQUENCIES.posterior(subject, prior).log_evidence
            rows.append(
                {
                    **{"design": name, "kind": kind, "observer": i, "noise": noise, "lapses": lapses, "model": true.name, **truth},
                    **{"fraction_equal": subject.fraction_equal, "fitted": 0, "log_evidence: free frequencies": free},
                }
            )
            subjects.append(subject)
    return Observers(name, prior, subjects, rows)


def observer(name: str, true: Model, design: Design, prior: bt.Prior, seed: int) -> tuple[bt.Subject, dict[str, float]]:
    """Answers of an observer drawn from the prior of its model, and its parameters."""
    rng, trials = generator(seed, name, "observer"), np.full(len(design.s1), design.batches)
    posterior = true.posterior(bt.Subject(name, design.s1, design.s2, trials, trials), prior)
    x = posterior.sample_prior(rng, 1)
    shown, q = posterior.subject, np.exp(posterior.log_answers(x)[0][0])
    found = {key: float(value[0]) for key, value in posterior.quantities(x).items()}
    return bt.Subject(name, shown.s1, shown.s2, rng.binomial(trials, q), trials), {key: found.get(key, np.nan) for key in PARAMETERS}


# --- Evidence -----------------------------------------------------------------------------------------


def evidences(model: Model, some: Observers, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log evidence and its standard error for every observer, and whether the fitted proposal had to be asked."""
    value, effective = by_prior_draws(model, some, generator(seed, some.design, model.name, "prior draws"))
    again, se = effective < ENOUGH, 1.0 / np.sqrt(effective)
    for i in np.flatnonzero(again):
        value[i], se[i] = by_proposal(model, some.subjects[i], some.prior, seed)
    return value, se, again


def by_prior_draws(model: Model, some: Observers, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Log mean likelihood over prior draws, and the effective number of these, for every observer at once: one product of matrices."""
    n_equal, n_trials = (np.array([getattr(subject, key) for subject in some.subjects], float) for key in ("n_equal", "n_trials"))
    posterior = model.posterior(some.subjects[0], some.prior)
    rest = n_trials - n_equal
    best = (xlogy(n_equal, n_equal / n_trials) + xlogy(rest, rest / n_trials)).sum(axis=1)  # log likelihood of the saturated model
    counts = np.concatenate([n_equal, rest], axis=1).astype(np.float32)
    top, total, squares, draws = np.full(len(best), -np.inf), np.zeros(len(best)), np.zeros(len(best)), np.zeros(len(best))
    left = np.arange(len(best))
    while draws.min() == 0 or (len(left) > FEW and draws.max() < MOST):
        logs = np.concatenate(posterior.log_answers(posterior.sample_prior(rng, BLOCK)), axis=1)
        logs = np.where(np.isneginf(logs), -1e30, logs).astype(np.float32)  # so that an answer never given costs nothing, 0 times -1e30
        log_likelihood = logs @ counts[left].T - best[left].astype(np.float32)
        highest = np.maximum(top[left], log_likelihood.max(axis=0))
        weights, shrink = np.exp(log_likelihood - highest.astype(np.float32)), np.exp(top[left] - highest)
        total[left] = total[left] * shrink + weights.sum(axis=0, dtype=np.float64)
        squares[left] = squares[left] * shrink**2 + np.einsum("ij,ij->j", weights, weights)
        top[left], draws[left] = highest, draws[left] + BLOCK
        left = left[total[left] ** 2 < ENOUGH * squares[left]]
    return best + top + np.log(total / draws), total**2 / squares


def by_proposal(model: Model, subject: bt.Subject, prior: bt.Prior, seed: int) -> tuple[float, float]:
    """The program's evidence; NaN where it is withheld for two seeds."""
    for attempt in (seed, seed + 1):
        found = infer(model.posterior(subject, prior), attempt, Wanted(evidence_draws=EVIDENCE_DRAWS)).evidence
        if found is not None and found.value is not None and found.se is not None:
            return found.value, found.se
    return np.nan, np.nan


def resampled(fitted: FittedProposal, rng: np.random.Generator, size: int) -> np.ndarray:
    """Posterior draws from those of a fitted proposal, by their weights, shape (size, k)."""
    return fitted.draws.x[rng.choice(len(fitted.draws.x), size, p=softmax(fitted.draws.log_weights))]


def with_probabilities(frame: pd.DataFrame) -> pd.DataFrame:
    """The table with the probability of each kind, over the 12 models and the three plain ones, and the best model, once all are there."""
    names = [f"log_evidence: {model.name}" for model in COMPOSITIONS]
    if not set(names) <= set(frame):
        return frame
    found = frame.copy()
    for ending, models in (("", COMPOSITIONS), ("_plain", PLAIN)):
        every = logsumexp(frame[[f"log_evidence: {model.name}" for model in models]], axis=1)
        for kind in KINDS:
            of_kind = [f"log_evidence: {model.name}" for model in models if dict(model.levels)["order"] == kind]
            found[f"p_{kind.replace(' ', '_')}{ending}"] = np.exp(logsumexp(frame[of_kind], axis=1) - every)
    known = frame[names].notna().all(axis=1)
    found["best"] = frame.loc[known, names].idxmax(axis=1).str.removeprefix("log_evidence: ")
    return found


if __name__ == "__main__":
    with threadpool_limits(1):
        sys.exit(main())
