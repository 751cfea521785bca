"""Are the probabilities and intervals of the four models calibrated? Observers from the prior.

A model is drawn with its prior probability, the parameters from their prior, responses by the
formulas of `reference.tempering`. Where everything is right, of the observers with posterior
probability near P of an effect a share P has it, and the true constant error, contraction and JND
have uniform ranks among the draws that the answer's sizes are made of. Writes
calibration_order.csv and calibration_order.md; exit code 3 where something is not calibrated.

Example: python scripts/order_calibration.py -o docs --observers 500 --seed 1 --overwrite
"""

import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np
import pandas as pd
from order_effect import DESIGNS, has_effect
from reference.calibration_statistics import judge_probabilities, judged_ranks, place
from reference.pages import judgement_page, page_parser, print_judgements, write_page
from reference.tempering import Observer, Parameters, answer_probabilities, shifted_difference
from scipy.special import ndtr

import bayes_toe as bt
from bayes_toe.answers.contrast import one_observer
from bayes_toe.answers.order_effect import QUESTIONS
from bayes_toe.data.study import pooled
from bayes_toe.data.tasks import THREE_ANSWERS
from bayes_toe.design.study_design import StudyDesign
from bayes_toe.inference.order_evidence import (
    EVERY_MODEL,
    HAS_CONTRACTION,
    HAS_ERROR,
    OrderEvidence,
    order_evidence,
)
from bayes_toe.model.observer import DEFAULT_PRIOR, JND_OVER_NOISE
from bayes_toe.workers import run_in_order

#: Prior probabilities of the models, as the page of the model states them.
PROBABILITIES = {"none": 1 / 2, "constant error": 1 / 6, "contraction": 1 / 6, "both": 1 / 6}
#: By name, the designs of the test of words, two with three answers, and two of an observer who
#: does two tasks; each has a part for each task.
ALL_DESIGNS = {name: (design,) for name, design in DESIGNS.items()}
for size in (640, 192):
    design = replace(DESIGNS[f"neighbours {size}"], task=THREE_ANSWERS)
    ALL_DESIGNS[f"three answers {size}"] = (design,)
_PAPER, _NEIGHBOURS = DESIGNS["13 pairs 650"], DESIGNS["2AFC 650"]
ALL_DESIGNS["two tasks 645"] = (_PAPER.with_total(13 * 25), _NEIGHBOURS.with_total(10 * 32))
ALL_DESIGNS["two tasks 204"] = (_PAPER.with_total(13 * 8), _NEIGHBOURS.with_total(10 * 10))
#: By ranked quantity, the models that its draws come from.
RANKED = {"constant_error": HAS_ERROR, "contraction": HAS_CONTRACTION, "jnd": EVERY_MODEL}
_DRAWS = 100  # among which a true value is ranked
_CHUNK = 40  # observers of a job
#: Titles of the page, for each part.
TITLES = {
    "probability": {"what": "question", "data_sets": "observers"},
    "rank": {"what": "quantity", "data_sets": "observers", "calibrated": "uniform"},
}


def simulate(
    parts: Sequence[StudyDesign], name: str, seed: list[int]
) -> tuple[list[bt.Subject], dict[str, float]]:
    """The responses of an observer from the prior to each task, and its true quantities."""
    rng = np.random.default_rng(seed)
    asked = [replace(part.unanswered, name=name) for part in parts]
    # The first task has all parameters; the scales are those of all trials.
    everything = pooled([replace(part, task=asked[0].task) for part in asked])
    model = str(rng.choice(list(PROBABILITIES), p=list(PROBABILITIES.values())))
    observer = Observer(everything, model)
    values = observer.natural(rng.standard_normal((1, len(observer.parameters))))
    units = [respond(part, observer.sbar, values, rng) for part in asked]
    quantities = {"jnd": "sigma_d", "constant_error": "c", "contraction": "p"}
    truth = {name: values[key].item() for name, key in quantities.items() if key in values}
    truth["jnd"] *= JND_OVER_NOISE
    return units, truth


def respond(
    asked: bt.Subject, sbar: float, values: Parameters, rng: np.random.Generator
) -> bt.Subject:
    """The responses of an observer to the trials of a task."""
    yes, _ = answer_probabilities(asked, sbar, values)
    n_yes = rng.binomial(asked.n_trials, yes[0])
    if asked.task != THREE_ANSWERS:
        return replace(asked, n_yes=n_yes)
    n_second = rng.binomial(asked.n_trials - n_yes, share_of_second(asked, sbar, values)[0])
    return replace(asked, n_yes=n_yes, n_second=n_second)


def share_of_second(asked: bt.Subject, sbar: float, values: Parameters) -> np.ndarray:
    """P('second') where the answer is not 'equal', of three answers, shape (1, pairs)."""
    numerator, middle = shifted_difference(asked, sbar, values)
    z = numerator / (values["sigma_d"] * np.exp(values["b"] * middle))
    k = values["k"] * np.exp(values["g"] * middle)
    lapse = values["lambda"]
    second = lapse * ndtr(-k) + (1.0 - lapse) * ndtr(z - k)
    first = lapse * ndtr(-k) + (1.0 - lapse) * ndtr(-z - k)
    return second / (second + first)


def answered(design: str, numbers: range, seed: int) -> list[dict[str, object]]:
    """A row for each of some observers: effects, log odds of the questions, ranks."""
    position = list(ALL_DESIGNS).index(design)
    seeds = [[seed, position, i] for i in numbers]
    observers = [simulate(ALL_DESIGNS[design], f"{design} {key[-1]}", key) for key in seeds]
    if len(ALL_DESIGNS[design]) == 1:
        evidences = order_evidence([units[0] for units, _ in observers], seed)
    else:
        evidences = [one_observer(units, DEFAULT_PRIOR, seed) for units, _ in observers]
    rows = []
    for key, (_, truth), evidence in zip(seeds, observers, evidences, strict=True):
        rows.append({"design": design, **row(truth, evidence, np.random.default_rng([*key, 1]))})
    return rows


def row(
    truth: dict[str, float], evidence: OrderEvidence, rng: np.random.Generator
) -> dict[str, object]:
    """The true effects, log odds of the three questions, and the rank of every true value."""
    entries = {"c": truth.get("constant_error", 0.0), "p": truth.get("contraction", 0.0)}
    for question, has in QUESTIONS.items():
        entries[f"log_odds_{question}"] = evidence.log_odds(has)
    for quantity, has in RANKED.items():
        entries[quantity] = np.nan
        if quantity in truth:
            draws = evidence.averaged(has)
            values = draws.posterior.quantities(draws.resampled(rng, _DRAWS))[quantity]
            entries[quantity] = place(truth[quantity], values, rng)
    return entries


def judged_probabilities(table: pd.DataFrame, seed: int) -> list[dict[str, object]]:
    """Whether the probabilities of a question are calibrated, by design."""
    rows = []
    for design, group in table.groupby("design", sort=False):
        for question in QUESTIONS:
            is_there = has_effect(group, question)
            row = {"part": "probability", "design": design, "what": question}
            row |= {"data_sets": len(group), "with_effect": is_there.sum()}
            rng = np.random.default_rng(seed)
            rows.append(row | judge_probabilities(group[f"log_odds_{question}"], is_there, rng))
    return rows


def judged(options: Namespace) -> tuple[pd.DataFrame, str]:
    """The table of all judgements, and the page."""
    jobs = []
    for design in ALL_DESIGNS:
        for start in range(0, options.observers, _CHUNK):
            numbers = range(start, min(start + _CHUNK, options.observers))
            jobs.append(partial(answered, design, numbers, options.seed))
    parts = run_in_order(jobs, options.workers, None, [()] * len(jobs))
    observers = pd.DataFrame(chain.from_iterable(parts))
    observers = pd.concat([observers, observers.assign(design="all")])
    probabilities = judged_probabilities(observers, options.seed)
    table = pd.DataFrame([*probabilities, *judged_ranks(observers, tuple(RANKED))])
    values = {"n_designs": len(ALL_DESIGNS), "draws": _DRAWS, "options": options}
    return table, judgement_page(__file__, table, table, TITLES, **values)


def main() -> int:
    """Simulate, answer, judge, write."""
    options = page_parser(__doc__, observers=500, seed=1).parse_args()
    return print_judgements(write_page(options, "calibration_order", partial(judged, options)))


if __name__ == "__main__":
    sys.exit(main())
