"""How often the words of the answer are right: simulated observers that no prior drew.

    python scripts/order_effect.py words -o docs --seed 301
    python scripts/order_effect.py accuracy --seed 1

`words` simulates six designs: the constant error is 0.3, 1 or 2.5 D with random sign, the
contraction .1, .2 or .35; lapses and slopes are there half of the time; half of the observers of
'same or different' follow a bell and not the curve of the model. It writes order_effect.csv, an
observer a row, and prints how often each word is right, log scores and coverage.
`accuracy` compares probabilities and evidences with long runs of fresh draws.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import expit, log_ndtr, logit, ndtr, ndtri

from bayes_toe.answers.order_effect import QUESTIONS, order_effect
from bayes_toe.answers.words import Word
from bayes_toe.checks.answer_checks import answer_flags
from bayes_toe.checks.identification import Identification
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.inference.order_evidence import Precision, order_evidence
from bayes_toe.model.observer import JND_OVER_NOISE

_LEVELS = 0.25 * np.arange(6)
_NEIGHBOURS = [pair for low, high in pairwise(_LEVELS) for pair in ((low, high), (high, low))]
_IDENTICAL = [(level, level) for level in _LEVELS]
_PAPER_LEVELS = np.log([1.0, 1.15, 1.36, 1.55, 1.66])
_PAPER_PAIRS = [
    *((level, level) for level in _PAPER_LEVELS),
    *((_PAPER_LEVELS[0], level) for level in _PAPER_LEVELS[1:]),
    *((level, _PAPER_LEVELS[0]) for level in _PAPER_LEVELS[1:]),
]
CONSTANT_ERRORS = (0.3, 1.0, 2.5)  # D
CONTRACTIONS = (0.1, 0.2, 0.35)
COVERED = ("c_covered", "p_covered", "jnd_covered")
COMBINATIONS = ("none", "constant error", "contraction", "both")


@dataclass(frozen=True)
class Design:
    """Pairs of a task, each answered so often."""

    name: str
    task: Task
    pairs: list[tuple[float, float]]
    trials: int
    observers: int  # of each combination of effects

    def asked(self, name: str) -> Subject:
        """A subject who was asked all trials; the responses say nothing yet."""
        s1, s2 = np.array(self.pairs).T
        n_trials = np.full(len(s1), self.trials)
        return Subject(name, s1, s2, n_trials, n_trials, task=self.task)


DESIGNS = (
    Design("2AFC 650", WHICH_STRONGER, _NEIGHBOURS, 65, 72),
    Design("2AFC 200", WHICH_STRONGER, _NEIGHBOURS, 20, 72),
    Design("13 pairs 650", SAME_DIFFERENT, _PAPER_PAIRS, 50, 48),
    Design("13 pairs 195", SAME_DIFFERENT, _PAPER_PAIRS, 15, 48),
    Design("neighbours 640", SAME_DIFFERENT, _NEIGHBOURS + _IDENTICAL, 40, 48),
    Design("neighbours 192", SAME_DIFFERENT, _NEIGHBOURS + _IDENTICAL, 12, 48),
)


class Truth(NamedTuple):
    """What a simulated observer is: c in D, p, and the JND in D where it has one."""

    c: float
    p: float
    jnd: float
    curve: str


def simulate(
    design: Design, name: str, constant_error: float, contraction: float, seed: list[int]
) -> tuple[Subject, Truth]:
    """Answers of one observer; the constant error in D gets a random sign."""
    rng = np.random.default_rng(seed)
    asked = design.asked(name)
    scales = asked.scales
    s1, s2 = asked.s1, asked.s2
    step, spread = scales.step, scales.spread
    width = 0.8 * step * np.exp(rng.normal(0.0, 0.35))
    q0 = rng.beta(14.0, 2.0)
    lapse = rng.beta(2.0, 14.0) * (rng.uniform() < 0.5)
    noise_slope = rng.normal(-0.1, 0.25) / spread * (rng.uniform() < 0.5)
    peak_slope = rng.normal(0.2, 0.4) / spread * (rng.uniform() < 0.5)
    c = constant_error * step * rng.choice([-1.0, 1.0])
    middle = 0.5 * (s1 + s2) - scales.sbar
    distance = (s2 - s1 - c + contraction * (s1 - scales.sbar)) / np.exp(noise_slope * middle)
    is_bell = rng.uniform() < 0.5
    if design.task == WHICH_STRONGER:
        noise, curve = width, "probit"
        probability = 0.5 * lapse + (1.0 - lapse) * ndtr(distance / noise)
    else:
        peak = expit(logit(q0) + peak_slope * middle)
        if is_bell:
            curve, noise = "bell", np.nan
            attending = peak * np.exp2(-np.square(distance / width))
        else:
            curve, noise = "differencing", width / 1.6
            z, k = distance / noise, ndtri(0.5 * (1.0 + peak))
            attending = np.exp(log_ndtr(k - z)) - np.exp(log_ndtr(-k - z))
        probability = lapse * q0 + (1.0 - lapse) * attending
    n_yes = rng.binomial(asked.n_trials, probability)
    truth = Truth(c / step, contraction, JND_OVER_NOISE * noise / step, curve)
    return replace(asked, n_yes=n_yes), truth


def observers(design: Design, seed: int) -> Iterator[tuple[Subject, Truth]]:
    """Observers of every combination of effects; sizes take turns."""
    place = [other.name for other in DESIGNS].index(design.name)
    for number, combination in enumerate(COMBINATIONS):
        for i in range(design.observers):
            c = CONSTANT_ERRORS[i % 3] if combination in ("constant error", "both") else 0.0
            # Sizes of p turn more slowly, so that every size of c meets every size of p.
            p = CONTRACTIONS[i // 3 % 3] if combination in ("contraction", "both") else 0.0
            name = f"{combination} {i}"
            yield simulate(design, name, c, p, [seed, place, number, i])


def judged(design: Design, made: list[tuple[Subject, Truth]], seed: int) -> pd.DataFrame:
    """A row for every observer: truth, probabilities, words, intervals."""
    everything = Identification({})
    subjects = [subject for subject, _ in made]
    evidences = order_evidence(subjects, seed)
    rows = []
    for (subject, truth), evidence, flags in zip(
        made, evidences, answer_flags(Study(tuple(subjects))), strict=True
    ):
        answer = order_effect(evidence, everything, flags)
        row = {"design": design.name, "observer": subject.name}
        row |= {"curve": truth.curve, "c": truth.c, "p": truth.p}
        for question in QUESTIONS:
            row[f"word_{question}"] = answer.words[question].value
            row[f"p_{question}"] = answer.probabilities[question]
        row["direction"] = answer.direction
        row["depends_on_prior"] = any(flag.startswith("depends") for flag in answer.flags)
        shift, jnd = 100.0 * np.expm1(np.array([truth.c, truth.jnd]) * subject.scales.step)
        true_sizes = {"pse_shift_percent": shift, "contraction_p": truth.p, "jnd_percent": jnd}
        for column, (name, size) in zip(COVERED, true_sizes.items(), strict=True):
            interval = answer.sizes[name]
            row[column] = bool(interval.q025 <= size <= interval.q975)
            if np.isnan(size):
                row[column] = None
        rows.append(row)
    return pd.DataFrame(rows)


def has_effect(table: pd.DataFrame, question: str) -> pd.Series:
    """Which observers have the effect that a question asks for."""
    has_error, has_contraction = table["c"] != 0.0, table["p"] != 0.0
    if question == "constant_error":
        return has_error
    return has_contraction if question == "contraction" else has_error | has_contraction


def words_table(table: pd.DataFrame) -> pd.DataFrame:
    """How often each word was right, and given; 'undecided' counts as the absence of an effect."""
    cells = {}
    for question in QUESTIONS:
        words = table[f"word_{question}"]
        is_right = has_effect(table, question) == words.isin([Word.YES, Word.PROBABLY])
        counts = is_right.groupby(words).agg(["sum", "size"]).astype(str)
        cells[question] = counts["sum"] + "/" + counts["size"]
    return pd.DataFrame(cells).reindex(map(str, Word))


def design_table(table: pd.DataFrame) -> pd.DataFrame:
    """Log scores in bits, and how often each size got the word 'yes'."""
    rows = []
    for design, group in table.groupby("design", sort=False):
        row = {"design": design}
        for question in QUESTIONS:
            probability = group[f"p_{question}"].astype(float)
            assigned = probability.where(has_effect(group, question), 1.0 - probability)
            row[f"log score {question}"] = f"{-np.log2(assigned).mean():.2f}"
        for column, question in (("c", "constant_error"), ("p", "contraction")):
            is_yes = group[f"word_{question}"] == "yes"
            counts = is_yes.groupby(group[column].abs().round(2)).agg(["sum", "size"])
            row[f"yes {column}"] = " ".join(f"{n}/{size}" for n, size in counts.iloc[1:].to_numpy())
        rows.append(row)
    return pd.DataFrame(rows)


def coverage_lines(table: pd.DataFrame) -> list[str]:
    """Coverage of the 95 % intervals, of observers who have the effect."""
    groups = {
        "p": table.loc[table["p"] != 0.0, "p_covered"],
        "c up to 1 D": table.loc[table["c"].abs().between(0.1, 2.0), "c_covered"],
        "c of 2.5 D": table.loc[table["c"].abs() > 2.0, "c_covered"],
        "JND": table["jnd_covered"].dropna(),
    }
    lines = []
    for name, is_covered in groups.items():
        lines.append(f"95 % intervals of {name}: {is_covered.sum()} of {len(is_covered)}")
    return lines


def accuracy(seed: int, number: int) -> None:
    """Probabilities and evidences of ordinary runs against long runs of fresh draws."""
    long_run = Precision(standard_error=0.003, effective_draws=20_000.0, most_draws=120_000)
    for design in (DESIGNS[4], DESIGNS[2], DESIGNS[0]):
        made = [subject for subject, _ in observers(design, seed)]
        subjects = made[:: len(made) // number][:number]
        exact = order_evidence(subjects, seed + 1000, precision=long_run)
        errors, p_errors, least = [], [], np.inf
        for own_seed in (seed, seed + 1):
            for evidence, reference in zip(order_evidence(subjects, own_seed), exact, strict=True):
                is_near = reference.log_evidence > reference.log_evidence.max() - 6.0
                errors += (evidence.log_evidence - reference.log_evidence)[is_near].tolist()
                least = min(least, float(evidence.effective_draws[is_near].min()))
                own = evidence.probabilities
                known = reference.probabilities
                p_errors += [abs(own[has].sum() - known[has].sum()) for has in QUESTIONS.values()]
        quantiles = np.quantile(p_errors, [0.9, 0.99, 1.0]).round(3).tolist()
        worst = min(errors, key=lambda error: -abs(error))
        print(
            f"{design.name}: ln Z mean error {np.mean(errors):+.3f}, worst {worst:+.3f}; error of "
            f"P at 90, 99, 100 % {quantiles}; least effective draws {least:.0f}"
        )


def main() -> None:
    """Run one of the commands."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("command", choices=("words", "accuracy"))
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--seed", type=int, default=301)
    parser.add_argument("--observers", type=int, help="of each combination, fewer than by default")
    given = parser.parse_args()
    if given.command == "accuracy":
        accuracy(given.seed, 24 if given.observers is None else given.observers)
        return
    tables = []
    for number, design in enumerate(DESIGNS):
        chosen = design
        if given.observers is not None:
            chosen = replace(design, observers=given.observers)
        tables.append(judged(chosen, list(observers(chosen, given.seed + number)), given.seed))
    table = pd.concat(tables, ignore_index=True)
    print(words_table(table).to_string())
    print(design_table(table).to_string(index=False))
    print("\n".join(coverage_lines(table)))
    if given.output is not None:
        table.round(4).to_csv(given.output / "order_effect.csv", index=False)


if __name__ == "__main__":
    main()
