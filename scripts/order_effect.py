"""How often the words of a verdict are right: simulated observers of every kind of order effect, and what is said of them.

    python scripts/order_effect.py -o docs --observers 200 --seed 1 --workers 2

writes order_effect.csv, a row an observer, and order_effect_words.csv, and prints the latter. Two designs of observers meet the paper's 13
pairs 50 times each: *moderate* ones differ little from the paper's; *harsh* ones lapse, depart from Weber's law, difference, and have a
peak that depends on the intensity. Three further designs ask which was stronger, of neighbours among six levels, of a grid of five, and of
a reference with four others, in both orders. None is drawn from the prior of the analysis.

With `--studies 30` it simulates studies instead, so many of each kind, and writes order_effect_studies.csv: what `population` says of each
beside the sentence of its subjects' verdicts.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pandas as pd

import bayes_toe as bt
from bayes_toe.comparison.population_answer import on_average
from bayes_toe.comparison.study_answer import study_sentence
from bayes_toe.comparison.verdict import verdict
from bayes_toe.comparison.words import EFFECTS, SMALL
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.groups.population import population
from bayes_toe.inference.prediction import effect_size
from bayes_toe.model.ladder import ORDERS, posterior_of
from bayes_toe.model.prior import DEFAULT
from bayes_toe.seeds import generator
from bayes_toe.workers import run_in_order

TRIALS, SUBJECTS = 50, 8
_SIX, _FIVE, _FOUR = 0.2 * np.arange(6), 0.25 * np.arange(5), 0.2 * np.array([-2, -1, 1, 2])
#: Of the designs that ask which was stronger: pairs, natural-log intensities, and trials of each.
COMPARED = {
    "neighbours": ([pair for a, b in pairwise(_SIX) for pair in ((a, b), (b, a))], 65),
    "grid": ([(a, b) for a in _FIVE for b in _FIVE], 26),
    "reference": ([pair for a in _FOUR for pair in ((0.0, a), (a, 0.0))], 81),
}
STUDIES = ("none", "constant error", "opposite errors", "pull")
KINDS = {"none": "none", "constant error": "constant error", "update": "pull"}


def observer(design: str, order: str, name: str, seed: int) -> tuple[Subject, float]:
    """Answers of one simulated observer, and the true size of the order effect in just noticeable differences."""
    rng, pairs = generator(seed, design, order, name), bt.example_study().subjects[0]
    harsh = design == "harsh"
    values = {
        "width": float(np.exp(rng.normal(np.log(0.32 if harsh else 0.3), 0.35 if harsh else 0.3))),
        "q0": float(rng.beta(*((14, 2) if harsh else (20, 2)))),
    }
    parts = [order]
    if rng.uniform() < (2 / 3 if harsh else 0.5):
        parts.append("both ways")
        values["lapse_rate"] = float(rng.beta(2, 10 if harsh else 14))
    if rng.uniform() < (0.6 if harsh else 0.5):
        parts.append("sloped")
        values["noise_slope"] = float(rng.normal(-0.4 if harsh else -0.3, 0.5))
    if harsh and rng.uniform() < 0.5:
        parts.append("differencing")
    if harsh and rng.uniform() < 0.5:
        parts.append("sloped peak")
        values["peak_slope"] = float(rng.normal(1.0, 1.5))
    values["offset"] = float(
        rng.choice([-1, 1]) * np.exp(rng.normal(np.log(0.15), 0.8))
        if harsh
        else rng.normal(0.0, 0.2)
    )
    middle = float(np.mean([pairs.s1, pairs.s2]))
    mu1 = float(middle + rng.uniform(-2.5, 2.5) if harsh else rng.normal(0.25, 0.45))
    pull = float(rng.uniform(0.1, 0.35) if harsh else rng.uniform(0.08, 0.38))
    gamma = pull / (1.0 - pull) ** 2
    sigma_p = values["width"] * (1.0 - pull) ** 1.5
    values |= {"mu1": mu1, "sigma_p": sigma_p, "sigma_l": sigma_p * np.sqrt(gamma)}
    asked = Subject(name, pairs.s1, pairs.s2, 0 * pairs.n_yes, np.full(pairs.n_pairs, TRIALS))
    return answered(asked, " + ".join(parts), values, rng)


def comparing_observer(design: str, order: str, name: str, seed: int) -> tuple[Subject, float]:
    """The same of one who says which was stronger; the true size is in just noticeable differences."""
    rng, (pairs, trials) = generator(seed, design, order, name), COMPARED[design]
    s1, s2 = np.array(pairs).T
    step = float(np.sqrt(np.mean(np.square(s2 - s1)[s1 != s2])))
    values = {"width": step * np.exp(rng.normal(0.0, 0.3)), "lapse_rate": rng.beta(1, 19)}
    parts = [order]
    if rng.uniform() < 0.5:
        parts.append("sloped")
        values["noise_slope"] = rng.normal(-0.3, 0.5)
    values["offset"] = rng.choice([-1, 1]) * step * np.exp(rng.normal(np.log(0.3), 0.6))
    pull = rng.uniform(0.08, 0.38)
    sigma_p = values["width"] * (1.0 - pull)
    values |= {
        "mu1": rng.normal(s1.mean(), 1.2 * s1.std()),
        "sigma_p": sigma_p,
        "sigma_l": sigma_p * np.sqrt(pull) / (1.0 - pull),
    }
    asked = Subject(
        name, s1, s2, np.zeros(len(s1), int), np.full(len(s1), trials), task=WHICH_STRONGER
    )
    return answered(asked, " + ".join(parts), values, rng)


def answered(
    asked: Subject, model: str, values: dict[str, float], rng: np.random.Generator
) -> tuple[Subject, float]:
    """What an observer with these quantities under a model answers to the pairs of a subject, and the true size of the order effect."""
    posterior = posterior_of(asked, model=model)
    x = posterior.points({key: np.asarray(value) for key, value in values.items()})[None]
    given = rng.binomial(asked.n_trials, np.exp(posterior.log_answers(x)[0][0]))
    return replace(asked, n_yes=given), float(effect_size(posterior, x)[0])


def row(design: str, order: str, i: int, seed: int) -> dict[str, object]:
    """One observer with its verdict."""
    subject, size = (comparing_observer if design in COMPARED else observer)(
        design, order, f"{order} {i}", seed
    )
    said, _ = verdict(subject, DEFAULT, seed)
    assert said.p_orders is not None
    found = dict(zip(("p_none", "p_constant_error", "p_update"), said.p_orders, strict=True))
    named = {"effect": said.effect, "kind": said.kind, "fit": said.fit, "robust": said.robust}
    return {
        "design": design,
        "observer": i,
        "true": KINDS[order],
        "true_size": size,
        **named,
        **found,
        "p_larger": said.p_larger,
    }


def members(kind: str, i: int, seed: int) -> bt.Study:
    """The subjects of a simulated study: no effect, constant errors of one sign or of both, pulls toward about the middle."""
    rng, pairs = generator(seed, "study", kind, str(i)), bt.example_study().subjects[0]
    made = []
    for j in range(SUBJECTS):
        pull = rng.normal(0.18, 0.06) if kind == "pull" else 0.0
        error = {
            "constant error": rng.normal(0.12, 0.05),
            "opposite errors": (-1) ** j * rng.normal(0.2, 0.05),
        }.get(kind, 0.0)
        values = {
            "offset": error,
            "gain": 1.0 - pull,
            "width": np.exp(rng.normal(-1.2, 0.2)),
            "q0": rng.beta(20, 2),
        }
        asked = Subject(
            f"P{j + 1:02d}", pairs.s1, pairs.s2, 0 * pairs.n_yes, np.full(pairs.n_pairs, TRIALS)
        )
        made.append(answered(asked, "free weighting", values, rng)[0])
    return bt.Study(made)


def study_row(kind: str, i: int, seed: int) -> dict[str, object]:
    """One study: what is said of its population, and of how many of its subjects an effect, none, or neither."""
    study = members(kind, i, seed)
    answer = on_average(population(study, draws=300, seed=seed, workers=1))
    said = [verdict(one, DEFAULT, seed)[0] for one in study]
    assert answer is not None
    factors = {f"bf_{row.parameter.replace(' ', '_')}": row.of_none for row in answer.means}
    counts = {
        f"n_{word.replace(' ', '_')}": sum(one.effect == word for one in said)
        for word in EFFECTS
        if word
    }
    said_of_all = {"kind": kind, "study": i, "population": answer.words, "p_none": answer.p_none}
    return {**said_of_all, **factors, **counts, "subjects": study_sentence(said)}


def agreement(table: pd.DataFrame) -> pd.DataFrame:
    """What was said of studies of each kind, how often, and how many of their eight subjects have, or probably have, an effect."""
    clause = table["population"].str.partition(":")[0].str.replace(", and subjects differ", "")
    some = table["n_has"] + table["n_probably_has"]
    rows = table.assign(population=clause, subjects=some).groupby(
        ["kind", "population"], sort=False
    )["subjects"]
    return rows.agg(studies="size", fewest="min", median="median", most="max").reset_index()


def words(table: pd.DataFrame) -> pd.DataFrame:
    """How often each word was said and right, by design."""
    effect, large = table["true"] != "none", table["true_size"] > SMALL
    truths = {
        "has": effect,
        "probably has": effect,
        "negligible": ~large,
        "probably none": ~effect,
        "none": ~effect,
    }
    found = []
    for design, of in table.groupby("design", sort=False):
        for word in filter(None, EFFECTS):
            some = of.index[of["effect"] == word]
            found.append(
                (design, word, len(some), int(truths[word][some].sum()) if word in truths else None)
            )
        for kind in ("constant error", "pull"):
            for word in (kind, f"probably {kind}"):
                some = of[of["kind"] == word]
                found.append((design, word, len(some), int((some["true"] == kind).sum())))
        p = of[["p_none", "p_constant_error", "p_update"]].to_numpy()
        own = p[np.arange(len(of)), [list(KINDS.values()).index(true) for true in of["true"]]]
        sure = p.max(axis=1) > 0.95
        found.append((design, "P > 0.95", int(sure.sum()), int((own[sure] >= 0.5).sum())))
        found.append((design, f"log score {-np.log(own).mean():.3f}", len(of), None))
    return pd.DataFrame(found, columns=["design", "word", "said", "right"]).astype(
        {"right": "Int64"}
    )


def main() -> None:
    """Simulate, judge, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=Path())
    parser.add_argument("--observers", type=int, default=200, help="of each kind and design")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--studies", type=int, default=0, help="of each kind, in the place of observers"
    )
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    if given.studies:
        name, of, jobs = (
            "order_effect_studies.csv",
            study_row,
            [(kind, i) for kind in STUDIES for i in range(given.studies)],
        )
    else:
        designs = ("moderate", "harsh", *COMPARED)
        name, of, jobs = (
            "order_effect.csv",
            row,
            [*product(designs, ORDERS, range(given.observers))],
        )
    rows = run_in_order(
        [partial(of, *job, given.seed) for job in jobs],
        given.workers,
        None,
        [(str(job),) for job in jobs],
    )
    table = pd.DataFrame(rows)
    table.to_csv(given.output / name, index=False, float_format="%.3g" if given.studies else "%.4g")
    found = agreement(table) if given.studies else words(table)
    if not given.studies:
        found.to_csv(given.output / "order_effect_words.csv", index=False)
    print(found.to_string(index=False))


if __name__ == "__main__":
    main()
