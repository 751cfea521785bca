"""Is the Bayes factor of a group's mean calibrated? Simulated studies, half of the means being 0.

    python scripts/population_checks.py --studies 80

A simulated study has ten subjects who answer which of two stimuli is stronger: ten ordered pairs of
neighbours of six levels 0.25 apart, 40 or 200 trials a subject. sigma_d is 0.8 D exp(Normal(0,
0.35)); with probability 1/2 each, the lapse rate is Beta(2, 14) and the noise slope Normal(-0.1,
0.25)/R, otherwise 0. A study takes about 4 s of CPU; --first continues where another run has ended.
"""

from __future__ import annotations

import argparse
import warnings
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

import bayes_toe as bt
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.groups.population import PopulationResult

STEP = 0.25
_LEVELS = STEP * np.arange(6)
S1 = np.concatenate([_LEVELS[:-1], _LEVELS[1:]])
S2 = np.concatenate([_LEVELS[1:], _LEVELS[:-1]])
SPREAD = float(np.sqrt(np.mean(np.square(np.concatenate([S1, S2]) - S1.mean()))))
N_SUBJECTS = 10


class Truth(NamedTuple):
    """Means and standard deviations between subjects; c in D."""

    mean_c: float
    sd_c: float
    mean_p: float
    sd_p: float


def simulated_study(truth: Truth, n_trials: int, rng: np.random.Generator) -> bt.Study:
    """Ten subjects of a group."""
    subjects = []
    for i in range(N_SUBJECTS):
        c = STEP * rng.normal(truth.mean_c, truth.sd_c)
        p = rng.normal(truth.mean_p, truth.sd_p)
        noise = 0.8 * STEP * np.exp(rng.normal(0.0, 0.35))
        lapse_rate = rng.beta(2, 14) if rng.uniform() < 0.5 else 0.0
        slope = rng.normal(-0.1, 0.25) / SPREAD if rng.uniform() < 0.5 else 0.0
        middle = 0.5 * (S1 + S2) - S1.mean()
        z = (S2 - S1 - c + p * (S1 - S1.mean())) / (noise * np.exp(slope * middle))
        p_second = 0.5 * lapse_rate + (1.0 - lapse_rate) * ndtr(z)
        n_each = np.full(len(S1), n_trials // len(S1))
        n_second = rng.binomial(n_each, p_second)
        subjects.append(bt.Subject(f"S{i}", S1, S2, n_second, n_each, task=WHICH_STRONGER))
    return bt.Study(subjects, synthetic=True)


def analysed(study: bt.Study, seed: int) -> PopulationResult:
    """The group; a result that is not reliable is printed and counts."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bt.ConvergenceWarning)
        result = bt.population(study, seed=seed)
    for problem in result.problems:
        print(f"  {problem}", flush=True)
    return result


def calibration(studies: range) -> None:
    """How often a mean is 0 where the Bayes factor says so, half of the means being 0."""
    limits = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
    said: dict[int, list[tuple[float, bool]]] = {place: [] for place in range(len(limits) - 1)}
    for i in studies:
        rng = np.random.default_rng([3, i])
        is_small = i % 2 == 0
        sd_c, sd_p = (0.1, 0.05) if is_small else (0.5, 0.15)
        is_zero = rng.uniform(size=2) < 0.5
        mean_c = 0.0 if is_zero[0] else 0.5 * rng.standard_t(3)
        mean_p = 0.0 if is_zero[1] else rng.normal(0.0, 0.2)
        truth = Truth(mean_c, sd_c, mean_p, sd_p)
        result = analysed(simulated_study(truth, 40 if is_small else 200, rng), i)
        for name, zero in zip(("constant_error", "contraction"), is_zero.tolist(), strict=True):
            probability = float(1.0 / (1.0 + np.exp(-result.effect(name).zero_mean.log_bf)))
            place = int(np.searchsorted(limits[1:-1], probability))
            said[place].append((probability, zero))
    for place, pairs in said.items():
        if pairs:
            mean = np.mean([probability for probability, _ in pairs])
            zeros = sum(zero for _, zero in pairs)
            bounds = f"{limits[place]:.2f} to {limits[place + 1]:.2f}"
            print(f"P(zero mean) {bounds}: said {mean:.2f}, was zero {zeros} of {len(pairs)}")


def main() -> None:
    """Simulate studies and compare."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--studies", type=int, default=80)
    parser.add_argument("--first", type=int, default=0, help="number of the first study")
    asked = parser.parse_args()
    calibration(range(asked.first, asked.first + asked.studies))


if __name__ == "__main__":
    main()
