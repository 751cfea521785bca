"""How often the words of the answer are right: simulated observers that no prior drew.

    python scripts/order_effect.py words -o docs --seed 301
    python scripts/order_effect.py accuracy --seed 1

`words` simulates six designs: the constant error is 0.3, 1 or 2.5 D with random sign, the
contraction .1, .2 or .35; lapses and slopes are there half of the time; half of the observers of
'same or different' follow a bell and not the curve of the model. It writes order_effect.csv, an
observer a row, and prints how often each word is right, log scores and coverage. `accuracy`
compares probabilities and evidences of 24 observers of three designs with long runs of fresh draws.
With --observers there are so many, in `words` of each combination of effects.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from reference.order_cases import NEIGHBOURS, WITH_IDENTICAL
from reference.pages import number_parser
from scipy.special import expit, logit, ndtr, ndtri

from bayes_toe.answers.order_effect import QUESTIONS, order_effect
from bayes_toe.answers.words import Word
from bayes_toe.checks.answer_checks import answer_flags
from bayes_toe.checks.identification import identify
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER, Task
from bayes_toe.design.study_design import StudyDesign, reference_design
from bayes_toe.inference.order_evidence import Precision, order_evidence
from bayes_toe.model.observer import JND_OVER_NOISE

_PAPER_PAIRS = reference_design().pairs
CONSTANT_ERRORS = (0.3, 1.0, 2.5)  # D
CONTRACTIONS = (0.1, 0.2, 0.35)
#: Whether there is a constant error, and whether there is a contraction.
COMBINATIONS = {
    "none": (False, False),
    "constant error": (True, False),
    "contraction": (False, True),
    "both": (True, True),
}


def repeated(pairs: Sequence[tuple[float, float]], n_trials: int, task: Task) -> StudyDesign:
    """A design with so many trials of each pair."""
    n_trials_of_each = np.full(len(pairs), n_trials)
    return StudyDesign(*np.transpose(pairs), n_trials_of_each, task=task).in_order()


DESIGNS = {
    "2AFC 650": repeated(NEIGHBOURS, 65, WHICH_STRONGER),
    "2AFC 200": repeated(NEIGHBOURS, 20, WHICH_STRONGER),
    "13 pairs 650": repeated(_PAPER_PAIRS, 50, SAME_DIFFERENT),
    "13 pairs 195": repeated(_PAPER_PAIRS, 15, SAME_DIFFERENT),
    "neighbours 640": repeated(WITH_IDENTICAL, 40, SAME_DIFFERENT),
    "neighbours 192": repeated(WITH_IDENTICAL, 12, SAME_DIFFERENT),
}
#: Observers of each combination of effects.
N_OBSERVERS = {WHICH_STRONGER: 72, SAME_DIFFERENT: 48}


def simulate(
    design: StudyDesign, name: str, constant_error: float, contraction: float, seed: list[int]
) -> tuple[Subject, dict[str, float | str]]:
    """Answers of one observer, and its curve, c in D with a random sign, p, and JND in D if any."""
    rng = np.random.default_rng(seed)
    s1, s2 = design.s1, design.s2
    scales = design.unanswered.scales
    step, spread = scales.step, scales.spread
    width = 0.8 * step * np.exp(rng.normal(0.0, 0.35))
    q0 = rng.beta(14.0, 2.0)
    lapse = rng.beta(2.0, 14.0) * (rng.uniform() < 0.5)
    noise_slope = rng.normal(-0.1, 0.25) / spread * (rng.uniform() < 0.5)
    peak_slope = rng.normal(0.2, 0.4) / spread * (rng.uniform() < 0.5)
    c = constant_error * step * rng.choice([-1.0, 1.0])
    is_bell = rng.uniform() < 0.5

    middle = 0.5 * (s1 + s2) - scales.sbar
    shift = contraction * (s1 - scales.sbar) - c
    distance = (s2 - s1 + shift) / np.exp(noise_slope * middle)
    peak = expit(logit(q0) + peak_slope * middle)
    if design.task == WHICH_STRONGER:
        curve, noise = "probit", width
        attending, guessing = ndtr(distance / noise), 0.5
    elif is_bell:
        curve, noise = "bell", np.nan
        attending, guessing = peak * np.exp2(-np.square(distance / width)), q0
    else:
        curve, noise = "differencing", width / 1.6
        z, k = distance / noise, ndtri(0.5 * (1.0 + peak))
        attending, guessing = ndtr(k - z) - ndtr(-k - z), q0
    n_yes = rng.binomial(design.n_trials, lapse * guessing + (1.0 - lapse) * attending)
    truth = {"curve": curve, "c": c / step, "p": contraction, "jnd": JND_OVER_NOISE * noise / step}
    return design.answered(n_yes, name), truth


def observers(
    design: str, seed: int, size: int | None
) -> Iterator[tuple[Subject, dict[str, float | str]]]:
    """Observers of every combination of effects; sizes take turns."""
    position = list(DESIGNS).index(design)
    size = size or N_OBSERVERS[DESIGNS[design].task]
    for number, (combination, (has_error, has_contraction)) in enumerate(COMBINATIONS.items()):
        for i in range(size):
            # Sizes of p turn more slowly, so that every size of c meets every size of p.
            c, p = has_error * CONSTANT_ERRORS[i % 3], has_contraction * CONTRACTIONS[i // 3 % 3]
            own_seed = [seed, position, number, i]
            yield simulate(DESIGNS[design], f"{combination} {i}", c, p, own_seed)


def judged(design: str, seed: int, own_seed: int, size: int) -> pd.DataFrame:
    """A row for every observer: truth, probabilities, words, intervals."""
    subjects, truths = zip(*observers(design, own_seed, size), strict=True)
    evidences = order_evidence(subjects, seed)
    flags_of_all = answer_flags(Study(subjects))
    rows = []
    for truth, evidence, flags in zip(truths, evidences, flags_of_all, strict=True):
        subject = evidence.subject
        answer = order_effect(evidence, identify(subject), flags)
        row = {"design": design, "observer": subject.name, **truth}
        for question in QUESTIONS:
            row[f"word_{question}"] = answer.words[question].value
            row[f"p_{question}"] = answer.probabilities[question]
        row["direction"] = answer.direction
        row["depends_on_prior"] = any(flag.startswith("depends") for flag in answer.flags)

        shift, jnd = 100.0 * np.expm1(np.array([truth["c"], row.pop("jnd")]) * subject.scales.step)
        true_sizes = {"pse_shift_percent": shift, "contraction_p": truth["p"], "jnd_percent": jnd}
        for symbol, (name, size) in zip(("c", "p", "jnd"), true_sizes.items(), strict=True):
            if np.isfinite(size):
                low, _, high = answer.sizes[name]
                row[f"{symbol}_covered"] = bool(low <= size <= high)
        rows.append(row)
    return pd.DataFrame(rows)


def has_effect(table: pd.DataFrame, question: str) -> pd.Series:
    """Which observers have the effect that a question asks for."""
    effects = table[["c", "p"]] != 0.0
    columns = {"order_effect": ["c", "p"], "constant_error": ["c"], "contraction": ["p"]}
    return effects[columns[question]].any(axis=1)


def count(is_there: pd.Series, groups: pd.Series) -> pd.Series:
    """How many of each group are there, as 3/4."""
    counts = is_there.groupby(groups).agg(["sum", "size"]).astype(str)
    return counts["sum"] + "/" + counts["size"]


def words_table(table: pd.DataFrame) -> pd.DataFrame:
    """How often each word was right, and given; 'undecided' counts as the absence of an effect."""
    cells = {}
    for question in QUESTIONS:
        words = table[f"word_{question}"]
        is_right = has_effect(table, question) == words.isin([Word.YES, Word.PROBABLY])
        cells[question] = count(is_right, words)
    return pd.DataFrame(cells).reindex(map(str, Word))


def design_table(table: pd.DataFrame) -> pd.DataFrame:
    """Log scores in bits, and how often each size got the word 'yes'."""
    columns = {}
    for question in QUESTIONS:
        p = table[f"p_{question}"].astype(float)
        bits = -np.log2(p.where(has_effect(table, question), 1.0 - p))
        means = bits.groupby(table["design"], sort=False).mean()
        columns[f"log score {question}"] = means.map("{:.2f}".format)
    for symbol, question in (("c", "constant_error"), ("p", "contraction")):
        known = table[table[symbol] != 0.0]
        sizes = [known["design"], known[symbol].abs().round(2)]
        cells = count(known[f"word_{question}"] == "yes", sizes)
        columns[f"yes {symbol}"] = cells.groupby("design").agg(" ".join)
    return pd.DataFrame(columns).reindex(table["design"].unique())


def coverage_table(table: pd.DataFrame) -> pd.DataFrame:
    """Coverage of the 95 % intervals, of observers who have the effect."""
    size = table["c"].abs()
    groups = {
        "p": table.loc[table["p"] != 0.0, "p_covered"],
        "c up to 1 D": table.loc[size.between(0.1, 2.0), "c_covered"],
        "c of 2.5 D": table.loc[size > 2.0, "c_covered"],
        "JND": table["jnd_covered"].dropna(),
    }
    return pd.DataFrame(groups).agg(["sum", "count"]).T


def accuracy(seed: int, number: int) -> None:
    """Probabilities and evidences of ordinary runs against long runs of fresh draws."""
    long_run = Precision(standard_error=0.003, effective_draws=20_000.0, most_draws=120_000)
    for design in ("neighbours 640", "13 pairs 650", "2AFC 650"):
        simulated = [subject for subject, _ in observers(design, seed, None)]
        subjects = simulated[:: len(simulated) // number][:number]
        references = order_evidence(subjects, seed + 1000, precision=long_run)
        errors, p_errors = [], []
        for own_seed in (seed, seed + 1):
            ordinary = order_evidence(subjects, own_seed)
            for evidence, reference in zip(ordinary, references, strict=True):
                is_near = reference.log_evidence > reference.log_evidence.max() - 6.0
                errors += (evidence.log_evidence - reference.log_evidence)[is_near].tolist()
                difference = evidence.probabilities - reference.probabilities
                p_errors += [abs(difference[has].sum()) for has in QUESTIONS.values()]
        quantiles = np.quantile(p_errors, [0.9, 0.99, 1.0]).round(3).tolist()
        mean = f"{np.mean(errors):+.3f}"
        print(f"{design}: ln Z mean error {mean}; error of P at 90, 99, 100 % {quantiles}")


def main() -> None:
    """Run one of the commands."""
    parser = number_parser(__doc__, seed=301, observers=0)
    parser.add_argument("command", choices=("words", "accuracy"))
    parser.add_argument("-o", "--output", type=Path, default=Path())
    options = parser.parse_args()
    if options.command == "accuracy":
        accuracy(options.seed, options.observers or 24)
        return
    tables = []
    for number, design in enumerate(DESIGNS):
        tables.append(judged(design, options.seed, options.seed + number, options.observers))
    table = pd.concat(tables, ignore_index=True)
    for counts in (words_table(table), design_table(table), coverage_table(table)):
        print(counts.to_string())
    table.round(4).to_csv(options.output / "order_effect.csv", index=False)


if __name__ == "__main__":
    main()
