"""How well histories are told and their parameters known, of simulated observers; how many trials that takes. Writes docs/history_*.csv.

    python scripts/history.py -o docs --seed 1

Observers say which of two stimuli was stronger, of ten neighbouring pairs of six levels in both orders, with a pull of 0.3 toward the
middle and a tenth of a step as the width's unit; what is carried over differs between them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import kstest

from bayes_toe.comparison.history import subject_history
from bayes_toe.data.answers import Answers
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.inference.space import space_evidence
from bayes_toe.model.history import require_order
from bayes_toe.model.ladder import models_of
from bayes_toe.model.parts import composition
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import DEFAULT
from bayes_toe.seeds import generator
from bayes_toe.workers import run_in_order

#: Truths: what they are called, and model and own parameter of those who answer.
TRUTHS = {
    "static": ("contraction", {}),
    "carry-over 0.6": ("contraction + carry-over", {"carry_over": 0.6}),
    "half-life 0.8": ("contraction + running average", {"half_life": 0.8}),
    "half-life 5": ("contraction + running average", {"half_life": 5.0}),
    "half-life 20": ("contraction + running average", {"half_life": 20.0}),
}
STEP, PULL, WIDTH, LAPSES = 0.3, 0.3, 0.3, 0.04
TRIALS = (100, 200, 400, 800)


def presented(trials: int, rng: np.random.Generator) -> Answers:
    """Random neighbouring pairs of six levels, in two sessions, without answers yet."""
    low, up = rng.integers(0, 5, trials), rng.random(trials) < 0.5
    keys = STEP * np.column_stack([low + ~up, low + up]).astype(float)
    place = np.arange(trials) + (np.arange(trials) >= trials // 2)
    return Answers(
        keys, np.zeros(trials, np.int64), np.ones(trials, np.int64), None, (), True, place
    )


def answered(target: Posterior, x: np.ndarray, rng: np.random.Generator) -> Subject:
    """The subject of a posterior with simulated answers to its trials, in their order, at a point, shape (1, k)."""
    answers = require_order(target.subject)
    p = np.empty(len(answers.n_yes))
    # The model has the trials in the order of their pairs.
    p[np.lexsort(answers.keys.T[::-1])] = np.exp(target.trial_answers(x)[0])
    n_yes = (rng.random(len(p)) < p).astype(np.int64)
    return Subject.from_answers(
        target.subject.name, replace(answers, n_yes=n_yes), target.subject.task
    )


def observer(name: str, truth: str, trials: int, seed: int) -> Subject:
    """One of these observers."""
    rng = generator(seed, name, "observer")
    model, own = TRUTHS[truth]
    asked = Subject.from_answers(name, presented(trials, rng), WHICH_STRONGER)
    target = composition(model, WHICH_STRONGER).posterior(asked, DEFAULT)
    offset, width = rng.normal(0.0, 0.05), WIDTH * np.exp(rng.normal(0.0, 0.2))
    known = {"offset": offset, "pull": PULL, "width": width, "lapse_rate": LAPSES, **own}
    return answered(
        target, target.points({key: np.array([value]) for key, value in known.items()}), rng
    )


def judged(truth: str, trials: int, i: int, seed: int) -> dict[str, object]:
    """What is concluded of one of them."""
    subject = observer(f"{truth} {trials} {i}", truth, trials, seed)
    row = subject_history(
        space_evidence(subject, DEFAULT, models_of(subject.task).space, seed), seed
    )
    levels = {
        "static": row.p_static,
        "carry-over": row.p_carry_over,
        "running average": row.p_running_average,
    }
    own = TRUTHS[truth][1]
    held = row.q05 <= own[row.parameter] <= row.q95 if row.parameter in own else None
    return {
        **{
            "truth": truth,
            "trials": trials,
            "likeliest": max(levels, key=lambda level: levels[level] or 0.0),
            "interval_holds": held,
        },
        **{
            key: getattr(row, key)
            for key in ("depends", "log_bayes_factor_history", "history_p_static", "history_p")
        },
        "interval": np.nan if held is None else row.q95 - row.q05,
    }


def ranked(model: str, i: int, seed: int) -> dict[str, object]:
    """Where the true values of an observer from the prior stand among its posterior draws, in 0..1."""
    name = f"{model} {i}"
    rng = generator(seed, name, "ranks")
    asked = Subject.from_answers(name, presented(400, rng), WHICH_STRONGER)
    target = composition(model, WHICH_STRONGER).posterior(asked, DEFAULT)
    x = target.sample_prior(rng, 1)[0]
    subject = answered(target, x[None], rng)
    found = space_evidence(subject, DEFAULT, [target.model], seed).sampled
    if not found:
        return {"model": model, "failed": 1}
    draws = found[0].fitted.draws
    true, values = (target.quantities(one) for one in (x, draws.x))
    ranks = {key: float(draws.shares @ (values[key] < true[key])) for key in target.names.natural}
    return {"model": model, "failed": 0, **ranks}


def told(found: pd.DataFrame) -> Iterator[dict[str, object]]:
    """One row a truth and number of trials."""
    for (truth, trials), some in found.groupby(["truth", "trials"], sort=False):
        held = some.interval_holds.dropna()
        yield {
            "truth": truth,
            "trials": trials,
            "observers": len(some),
            **{
                word: int((some.depends == word).sum())
                for word in ("yes", "probably", "undecided", "probably not", "no", "no pull")
            },
            **{
                f"likeliest {level}": int((some.likeliest == level).sum())
                for level in ("static", "carry-over", "running average")
            },
            "sum_log_bayes_factor": some.log_bayes_factor_history.sum(),
            "intervals": len(held),
            "intervals_hold": int(held.sum()),
            "mean_width": some.interval.mean(),
            "misfit_static": int((some.history_p_static < 0.01).sum()),
            "misfit_with": int((some.history_p < 0.01).sum()),
        }


def main() -> None:
    """Simulate, judge, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("docs"))
    parser.add_argument("--observers", type=int, default=40)
    parser.add_argument("--ranks", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    kinds = [(truth, 400) for truth in TRUTHS] + [
        ("carry-over 0.6", trials) for trials in TRIALS if trials != 400
    ]
    jobs = [
        partial(judged, truth, trials, i, asked.seed)
        for truth, trials in kinds
        for i in range(asked.observers)
    ]
    table = pd.DataFrame(
        told(pd.DataFrame(run_in_order(jobs, asked.workers, None, [()] * len(jobs))))
    )
    table.to_csv(asked.output / "history_recovery.csv", index=False)
    print(table.to_string())
    models = ("contraction + carry-over", "contraction + running average")
    jobs = [partial(ranked, model, i, asked.seed) for model in models for i in range(asked.ranks)]
    found = pd.DataFrame(run_in_order(jobs, asked.workers, None, [()] * len(jobs)))
    uniform = [
        {
            "model": model,
            "quantity": key,
            "observers": int(values.count()),
            "p_uniform": kstest(values.dropna(), "uniform").pvalue,
        }
        for model, some in found.groupby("model", sort=False)
        for key, values in some.drop(columns=["model", "failed"]).items()
        if values.notna().any()
    ]
    checked = pd.DataFrame(uniform)
    checked.to_csv(asked.output / "history_ranks.csv", index=False)
    print(checked.to_string(), int(found.failed.sum()), "without evidence")


if __name__ == "__main__":
    main()
