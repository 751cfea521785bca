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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from order_effect import DESIGNS, Design, has_effect
from reference.calibration_statistics import LEAST_P, judge_probabilities, judge_ranks, place
from reference.pages import (
    judgement_lines,
    judgement_tables,
    page_parser,
    versions,
    write_page,
)
from reference.tempering import Observer, answer_probabilities
from scipy.stats import norm

import bayes_toe as bt
from bayes_toe.answers.contrast import one_observer
from bayes_toe.answers.order_effect import QUESTIONS
from bayes_toe.data.study import pooled
from bayes_toe.data.tasks import THREE_ANSWERS
from bayes_toe.errors import NumericalError
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
ALL_DESIGNS = {design.name: (design,) for design in DESIGNS}
ALL_DESIGNS |= {
    "three answers 640": (replace(DESIGNS[4], task=THREE_ANSWERS),),
    "three answers 192": (replace(DESIGNS[5], task=THREE_ANSWERS),),
    "two tasks 645": (replace(DESIGNS[2], trials=25), replace(DESIGNS[0], trials=32)),
    "two tasks 204": (replace(DESIGNS[3], trials=8), replace(DESIGNS[1], trials=10)),
}
RANKED = ("constant_error", "contraction", "jnd")
_DRAWS = 100  # among which a true value is ranked
_CHUNK = 40  # observers of a job
_SHARED = {"design": "design", "what": "question", "observers": "observers"}
#: Columns of the page, with their titles, for each part.
COLUMNS = {
    "probability": _SHARED
    | {"with_effect": "with the effect", "ece": "ECE", "floor": "floor", "p_value": "p"}
    | {"log_score_bits": "log score", "calibrated": "calibrated"},
    "rank": _SHARED
    | {"what": "quantity", "largest_difference": "largest difference", "at": "at", "p_value": "p"}
    | {"calibrated": "uniform"},
}
PAGE = """# Calibration of the four models

For each of {designs} designs, we draw {observers} observers from the prior. For each observer, we first draw one of the four
models and then its parameters. Separate code (`scripts/reference/tempering.py`) simulates the responses. `bayes-toe
run` analyses these responses. In the two designs with two tasks, an observer responds to the 13 pairs of 'same or different' and
to the ten pairs of 'which is stronger'. `bayes-toe contrast` analyses both tasks as one observer.

{conclusion}

## Probabilities

If the probabilities are correct, 80 of 100 observers with P = .80 have the effect. The expected calibration error
(ECE) is the mean difference between P and the share of observers with the effect, over ten bins of P. Even correct probabilities have an ECE
above 0 by chance. The column *floor* has the mean ECE of correct probabilities. The p-value is the probability that
correct probabilities have an ECE at least as large as the observed ECE. A row is calibrated if p is at least
{least_p:g}. The log score is in bits, and a lower score is better.

{probability}

## Ranks

If the intervals are correct, the ranks of the true values among posterior draws have a uniform distribution. We rank a
true constant error or contraction among {draws} draws of the models that have this effect. We rank each true JND among
{draws} draws of all models. The p-value tests the largest difference between the distribution of the ranks and the
uniform distribution. Ranks count as uniform if p is at least {least_p:g}.

{rank}

`python scripts/order_calibration.py -o docs --observers {observers} --seed {seed} --overwrite` writes this page and
[{table}]({table}). The versions were bayes_toe {version}, Python {python} and numpy {numpy}.
"""


@dataclass(frozen=True, eq=False)
class Simulated:
    """An observer: responses to each task, and the true value of each quantity."""

    units: list[bt.Subject]
    truth: dict[str, float]


def simulate(parts: Sequence[Design], name: str, seed: list[int]) -> Simulated:
    """An observer from the prior."""
    rng = np.random.default_rng(seed)
    asked = []
    for part in parts:
        s1, s2 = np.array(part.pairs).T
        n_trials = np.full(len(s1), part.trials)
        asked.append(bt.Subject(name, s1, s2, n_trials, n_trials, task=part.task))
    # The first task has all parameters; the scales are those of all trials.
    everything = pooled([replace(part, task=asked[0].task) for part in asked])
    model = str(rng.choice(list(PROBABILITIES), p=list(PROBABILITIES.values())))
    observer = Observer(everything, model)
    values = observer.natural(rng.standard_normal((1, len(observer.parameters))))
    truth = {"jnd": JND_OVER_NOISE * values["sigma_d"].item()}
    if "c" in values:
        truth["constant_error"] = values["c"].item()
    if "p" in values:
        truth["contraction"] = values["p"].item()
    return Simulated([respond(part, observer, values, rng) for part in asked], truth)


def respond(
    asked: bt.Subject,
    observer: Observer,
    values: Mapping[str, np.ndarray],
    rng: np.random.Generator,
) -> bt.Subject:
    """The responses of an observer to the trials of a task."""
    yes, _ = answer_probabilities(asked, observer.sbar, values)
    n_yes = rng.binomial(asked.n_trials, yes[0])
    if asked.task != THREE_ANSWERS:
        return replace(asked, n_yes=n_yes)
    n_second = rng.binomial(asked.n_trials - n_yes, share_of_second(asked, observer, values))
    return replace(asked, n_yes=n_yes, n_second=n_second)


def share_of_second(
    asked: bt.Subject, observer: Observer, values: Mapping[str, np.ndarray]
) -> np.ndarray:
    """P('second') where the answer is not 'equal', of three answers, shape (pairs,)."""
    value = {name: column.item() for name, column in values.items()}
    first, middle = asked.s1 - observer.sbar, 0.5 * (asked.s1 + asked.s2) - observer.sbar
    shift = value.get("p", 0.0) * first - value.get("c", 0.0)
    z = (asked.s2 - asked.s1 + shift) / (value["sigma_d"] * np.exp(value["b"] * middle))
    k = value["k"] * np.exp(value["g"] * middle)
    guessed = value["lambda"] * norm.sf(k)
    second, opposite = (guessed + (1.0 - value["lambda"]) * norm.sf(k - x) for x in (z, -z))
    return second / (second + opposite)


def answered(design: str, numbers: range, seed: int) -> list[dict[str, object]]:
    """A row for each of some observers: effects, log odds of the questions, ranks."""
    at = list(ALL_DESIGNS).index(design)
    made = [simulate(ALL_DESIGNS[design], f"{design} {i}", [seed, at, i]) for i in numbers]
    if len(ALL_DESIGNS[design]) == 1:
        evidences = order_evidence([observer.units[0] for observer in made], seed)
    else:
        evidences = []
        for observer in made:
            evidence = one_observer(observer.units, DEFAULT_PRIOR, seed)
            if isinstance(evidence, NumericalError):
                raise evidence
            evidences.append(evidence)
    return [
        row(design, observer, evidence, np.random.default_rng([seed, at, i, 1]))
        for i, observer, evidence in zip(numbers, made, evidences, strict=True)
    ]


def row(
    design: str, observer: Simulated, evidence: OrderEvidence, rng: np.random.Generator
) -> dict[str, object]:
    """The true effects, log odds of the three questions, and the rank of every true value."""
    entries: dict[str, object] = {
        "design": design,
        "c": observer.truth.get("constant_error", 0.0),
        "p": observer.truth.get("contraction", 0.0),
    }
    for question, has in QUESTIONS.items():
        entries[f"log_odds_{question}"] = evidence.log_odds(has)
    models = {"constant_error": HAS_ERROR, "contraction": HAS_CONTRACTION, "jnd": EVERY_MODEL}
    for quantity, has in models.items():
        entries[f"rank_{quantity}"] = np.nan
        if quantity in observer.truth:
            draws = evidence.averaged(has)
            points = draws.resampled(rng, _DRAWS)
            values = draws.posterior.quantities(points)[quantity]
            entries[f"rank_{quantity}"] = place(observer.truth[quantity], values, rng)
    return entries


def judged_probabilities(table: pd.DataFrame, seed: int) -> Iterator[dict[str, object]]:
    """Whether the probabilities of a question are calibrated, by design and of all together."""
    groups = [*table.groupby("design", sort=False), ("all", table)]
    for design, group in groups:
        for question in QUESTIONS:
            log_odds = group[f"log_odds_{question}"].to_numpy(np.float64)
            is_there = has_effect(group, question).to_numpy()
            yield {
                "design": design,
                "what": question,
                "observers": len(group),
                "with_effect": int(is_there.sum()),
                **judge_probabilities(log_odds, is_there, np.random.default_rng(seed)),
            }


def judged_ranks(table: pd.DataFrame) -> Iterator[dict[str, object]]:
    """Whether the ranks of a quantity are uniform, by design and of all together."""
    groups = [*table.groupby("design", sort=False), ("all", table)]
    for design, group in groups:
        for quantity in RANKED:
            ranks = group[f"rank_{quantity}"].dropna()
            if ranks.empty:  # few observers, and none has the effect
                continue
            yield {
                "design": design,
                "what": quantity,
                "observers": len(ranks),
                **judge_ranks(ranks),
            }


def page(table: pd.DataFrame, observers: int, seed: int) -> str:
    """The judgements as Markdown."""
    return PAGE.format(
        designs=len(ALL_DESIGNS),
        observers=observers,
        seed=seed,
        table="calibration_order.csv",
        conclusion="\n".join(f"* {line}" for line in judgement_lines(table)),
        draws=_DRAWS,
        least_p=LEAST_P,
        **judgement_tables(table, COLUMNS),
        **versions(),
    )


def judged(options: Namespace) -> tuple[pd.DataFrame, str]:
    """The table of all judgements, and the page."""
    jobs, names = [], []
    for design in ALL_DESIGNS:
        for start in range(0, options.observers, _CHUNK):
            numbers = range(start, min(start + _CHUNK, options.observers))
            jobs.append(partial(answered, design, numbers, options.seed))
            names.append((f"{design} {start}",))
    parts = run_in_order(jobs, options.workers, None, names)
    observers = pd.DataFrame([entries for rows in parts for entries in rows])

    probabilities = pd.DataFrame(judged_probabilities(observers, options.seed))
    ranks = pd.DataFrame(judged_ranks(observers))
    table = pd.concat(
        [probabilities.assign(part="probability"), ranks.assign(part="rank")], ignore_index=True
    )
    return table, page(table, options.observers, options.seed)


def main() -> int:
    """Simulate, answer, judge, write."""
    parser = page_parser(__doc__)
    parser.add_argument("--observers", type=int, default=500, help="of each design")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    table = write_page(options, "calibration_order", partial(judged, options))
    print("\n".join(judgement_lines(table)))
    return 0 if table["calibrated"].astype(bool).all() else 3


if __name__ == "__main__":
    sys.exit(main())
