"""Groups that are hard to sample: does each converge, at what cost, and do two runs with other seeds and starts agree?

A row a case is written as soon as it is done. `apart` is the largest distance between means of two runs, over means, scatters and members
of every parameter, in Monte Carlo errors of both; with 12 and more numbers up to about 4 is chance.

Example: python scripts/population_hard_cases.py -o docs --resume
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

import bayes_toe as bt
from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tables import write_table
from bayes_toe.data.whole_files import require_writable
from bayes_toe.experiments.simulate import reference_design
from bayes_toe.groups.hyperprior import Hyperprior
from bayes_toe.groups.population import Population, population
from bayes_toe.inference.diagnostics import errors
from bayes_toe.model.ladder import PREDICTIVE_UPDATE, model_named
from bayes_toe.model.posterior import Model, Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator

FILE = "population_hard_cases.csv"
#: A population like the paper's, on group scales: mu1, probit gamma, log width, probit q0.
MEAN, SD = np.array([0.3, -0.5, -1.1, 1.3]), np.array([0.6, 0.4, 0.15, 0.3])


def answered(
    size: int, trials: int, sd: FloatArray = SD, model: Model = PREDICTIVE_UPDATE, mean: FloatArray = MEAN, isi: bool = False
) -> list[Subject]:
    """Subjects of a population, in the paper's pairs."""
    rng, design = generator(1, "hard cases", size, trials), reference_design()
    seconds = np.resize([0.4, 1.0, 2.5], len(design.s1)) if isi else None
    n = np.full(len(design.s1), trials)
    one = Posterior(Subject("any", design.s1, design.s2, 0 * n, n, isi=seconds), model, Prior(offset_sd=1.0, reference_interval=1.0))
    x, _ = one.from_group(mean + sd * rng.standard_normal((size, len(mean))))
    q = np.exp(one.log_answers(x)[0])
    known = one.subject  # which has its pairs in an order of its own
    return [Subject(f"S{i + 1:03d}", known.s1, known.s2, rng.binomial(n, row), n, isi=known.isi) for i, row in enumerate(q)]


def _edge(kind: str) -> Study:
    """Seven subjects and an eighth of some kind."""
    others, last = answered(7, 50), answered(8, 50)[-1]
    some = last.s1 == last.s2
    counts = {
        "1 trial": ([1], [1], slice(1)),
        "all 'equal'": (last.n_trials, last.n_trials, slice(None)),
        "none": (0 * last.n_trials, last.n_trials, slice(None)),
    }
    if kind == "equal pairs only":
        return Study([*others, Subject("odd", last.s1[some], last.s2[some], last.n_equal[some], last.n_trials[some])])
    n_equal, n_trials, which = counts[kind]
    return Study([*others, Subject("odd", last.s1[which], last.s2[which], n_equal, n_trials)])


def _outlier() -> Study:
    """Eleven alike, and one whose prior mean lies far above."""
    far = answered(1, 50, sd=0.0 * SD, mean=MEAN + np.array([4.0, 0.5, 0.0, 0.0]))[0]
    return Study([*answered(11, 50, sd=0.3 * SD), Subject("far", far.s1, far.s2, far.n_equal, far.n_trials)])


def _mixed() -> Study:
    """Four times other pairs: of the second subject only half of them, of the third three."""
    return Study(
        [
            Subject(one.name, *(np.asarray(getattr(one, key))[: (13, 7, 3, 13)[i % 4]] for key in ("s1", "s2", "n_equal", "n_trials")))
            for i, one in enumerate(answered(8, 50))
        ]
    )


def _of(name: str, mean: list[float], sd: list[float], isi: bool = False) -> Callable[[], Study]:
    return lambda: Study(answered(8, 50, np.array(sd), model_named(name), np.array(mean), isi))


def _same(trials: int) -> Study:
    first = answered(1, trials, sd=0.0 * SD)[0]
    return Study([Subject(f"S{i}", first.s1, first.s2, first.n_equal, first.n_trials) for i in range(6)])


Factor = float
#: Study, or None for that of a file, model, scatter, factor of the hyperprior's scales.
CASES: dict[str, tuple[Callable[[], Study] | None, str, str, Factor]] = {
    "8 subjects": (lambda: Study(answered(8, 50)), "update", "normal", 1.0),
    "2 subjects": (lambda: Study(answered(2, 50)), "update", "normal", 1.0),
    "3 subjects": (lambda: Study(answered(3, 50)), "update", "normal", 1.0),
    "7 subjects and one with 1 trial": (lambda: _edge("1 trial"), "update", "normal", 1.0),
    "7 subjects and one who says only 'equal'": (lambda: _edge("all 'equal'"), "update", "normal", 1.0),
    "7 subjects and one who never says 'equal'": (lambda: _edge("none"), "update", "normal", 1.0),
    "7 subjects and one with equal pairs only": (lambda: _edge("equal pairs only"), "update", "normal", 1.0),
    "6 times the same counts, 50 trials a pair": (lambda: _same(50), "update", "normal", 1.0),
    "6 times the same counts, 1,000,000 trials a pair": (lambda: _same(1_000_000), "update", "normal", 1.0),
    "8 subjects, sds three times as large": (lambda: Study(answered(8, 50, sd=3.0 * SD)), "update", "normal", 1.0),
    "11 alike and one far away, normal": (_outlier, "update", "normal", 1.0),
    "11 alike and one far away, t": (_outlier, "update", "t", 1.0),
    "different pairs": (_mixed, "update", "normal", 1.0),
    "three intervals": (_of("update", MEAN.tolist(), SD.tolist(), isi=True), "update", "normal", 1.0),
    "mean-reverting": (_of("mean-reverting", [0.3, -0.7, -1.1, 0.0, 1.3], [0.6, 0.4, 0.15, 0.3, 0.3]), "mean-reverting", "normal", 1.0),
    "free weighting": (_of("free weighting", [0.0, -0.3, -1.1, 1.3], [0.1, 0.2, 0.15, 0.3]), "free weighting", "normal", 1.0),
    "update + both ways": (
        _of("update + both ways", [0.3, -0.5, -1.1, 1.3, -1.0], [0.6, 0.4, 0.15, 0.3, 0.3]),
        "update + both ways",
        "normal",
        1.0,
    ),
    "200 subjects of 20 trials": (
        lambda: Study([Subject(s.name, s.s1, s.s2, s.n_equal, s.n_trials) for s in answered(200, 2)]),
        "update",
        "normal",
        1.0,
    ),
    **{
        f"bundled, hyperprior x {word}": (bt.example_study, "update", "normal", factor)
        for word, factor in (("1", 1.0), ("1/3", 1 / 3), ("3", 3.0))
    },
    **{
        f"vibrotactile, hyperprior x {word}": (None, "update", "normal", factor)
        for word, factor in (("1", 1.0), ("1/3", 1 / 3), ("3", 3.0))
    },
}


def main() -> int:
    """Run the cases that are asked for and not in the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--vibrotactile", type=Path, help="trials.csv of that study; its cases are left out without it")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES), metavar="CASE")
    parser.add_argument("--draws", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--overwrite", action="store_true")
    parser.add_argument("--resume", action="store_true", help="cases that are in the table are kept")
    options = parser.parse_args()
    try:
        path = options.output / FILE
        require_writable(path, overwrite=options.overwrite or options.resume)
        rows = pd.read_csv(path, keep_default_na=False).to_dict("records") if options.resume and path.exists() else []
        for case in options.cases:
            make = CASES[case][0]
            if case not in {row["case"] for row in rows} and (make is not None or options.vibrotactile is not None):
                study = bt.read_study(options.vibrotactile) if make is None else make()
                rows.append(found := row(case, study, options.draws, options.seed))
                write_table(pd.DataFrame(rows), path, overwrite=True)
                print(found, flush=True)
    except bt.BayesToeError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def row(case: str, study: Study, draws: int, seed: int) -> dict[str, object]:
    """What one case came to, in two runs."""
    _, model, scatter, factor = CASES[case]
    hyperprior = Hyperprior().for_study(study).scaled(factor, mean_sd=factor)
    started = time.process_time()
    one, two = (_quietly(study, model, scatter, hyperprior, draws, seed + i) for i in range(2))
    seconds = 0.5 * (time.process_time() - started)
    (lowest, ess), (highest, r_hat) = one.chains.worst(one.names, one.study.names)
    shown = {}
    for j, name in enumerate(one.names):
        for word, values in (("mean", one.chains.mean), ("sd", one.chains.scatter)):
            low, mid, high = np.quantile(values[..., j], [0.05, 0.5, 0.95])
            shown[f"{word} of {name}"] = f"{mid:.3g} ({low:.3g}, {high:.3g})"
    return {
        "case": case,
        "subjects": len(study.names),
        "draws asked for": draws,
        "converged": f"{one.converged}, {two.converged}",
        "least ess": f"{ess:.0f} of {lowest}",
        "largest R-hat": f"{r_hat:.3f} of {highest}",
        "divergent": f"{one.chains.divergent} and {two.chains.divergent} of {one.chains.mean[..., 0].size}",
        "gradients": one.chains.gradients,
        "seconds": round(seconds, 1),
        "apart": round(_apart(one, two), 1),
        **shown,
    }


def _quietly(study: Study, model: str, scatter: str, hyperprior: Hyperprior, draws: int, seed: int) -> Population:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bt.errors.ConvergenceWarning)
        return population(study, model=model, scatter=scatter, hyperprior=hyperprior, draws=draws, seed=seed, workers=1)


def _apart(one: Population, two: Population) -> float:
    """Largest z score of differences between two runs, of means and of squares about them."""
    scores = []
    for a, b in zip(_columns(one), _columns(two), strict=True):
        centre, size = 0.5 * (a.mean() + b.mean()), max(a.std(), b.std())
        for x, y in ((a, b), (np.tanh((a - centre) / size) ** 2, np.tanh((b - centre) / size) ** 2)):
            scores.append(abs(x.mean() - y.mean()) / np.hypot(errors(x).mean, errors(y).mean))
    return float(np.max(scores))


def _columns(found: Population) -> list[FloatArray]:
    own = found.chains
    shared = [np.log(own.scatter[..., j]) for j in range(len(found.names))] + [own.mean[..., j] for j in range(len(found.names))]
    return shared + [own.eta[:, :, i, j] for i in range(own.eta.shape[2]) for j in range(len(found.names))]


if __name__ == "__main__":
    sys.exit(main())
