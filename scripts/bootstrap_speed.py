"""How much faster one batch of Newton ascents refits bootstrap replicates than a loop over scipy.optimize.minimize.

Both fit the same replicates. The loop is what a user would write: the closed form in natural parameters, bounds, scipy's own numerical
gradient, started from the subject's fit; and once more with the starts that the batch has, since one start does not always find the
highest maximum. Times are those of one processor, so that a busy machine does not matter. A replicate agrees where the two objectives
differ by less than 1e-8; where the loop is lower it stopped at a worse point.

Example: python scripts/bootstrap_speed.py --subjects S01,S02 --replicates 1000 --loop 100
"""

import argparse
import platform
import sys
import time

import numpy as np
import scipy
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

import bayes_toe as bt
from bayes_toe.classical.bootstrap import bootstrap_subject, resample
from bayes_toe.classical.counts import Counts, Design
from bayes_toe.classical.maximum_likelihood import fit_subject
from bayes_toe.classical.starts import replicate_starts
from bayes_toe.model.closed_form import MAX_PULL
from bayes_toe.seeds import generator

SEED = 1
BOUNDS = [(-200.0, 200.0), (1e-4, 100.0), (0.0, 1.0), (1e-6, 1.0)]
OPTIONS = {"ftol": 1e-15, "gtol": 1e-8, "maxiter": 2000, "maxfun": 20000}


def objective(subject: bt.Subject, n_equal: np.ndarray):
    """Minus the penalised log likelihood of (mu1, sigma_p, gamma, q0)."""
    different = subject.n_trials - n_equal

    def value(theta: np.ndarray) -> float:
        mu1, sigma_p, gamma, q0 = theta
        ratio = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * gamma))
        z = (subject.s2 - subject.s1 / ratio - (1.0 - 1.0 / ratio) * mu1) / (sigma_p * ratio**1.5)
        log_q = np.log(q0) - np.log(2.0) * z * z
        with np.errstate(divide="ignore"):
            log_rest = np.log(-np.expm1(log_q))
        total = n_equal @ log_q + np.where(different > 0, different * np.where(different > 0, log_rest, 0.0), 0.0).sum()
        return float(-(total - mu1**2 / 200.0)) if np.isfinite(total) else 1e12

    return value


def natural_starts(subject: bt.Subject, fitted, counts: np.ndarray) -> np.ndarray:
    """The batch's starts of every replicate in the loop's parameters, (rows, starts, 4); gamma = 0 is a bound there."""
    design = Design.of(subject, bt.Prior())
    offset, log_share, log_width, log_q0 = replicate_starts(design, fitted, Counts.of(counts, subject.n_trials))
    p = MAX_PULL * np.exp(log_share)
    mu1 = design.sbar + np.divide(offset, p, out=np.full_like(p, -design.sbar), where=p > 0)
    found = np.stack([mu1, np.exp(log_width) * (1.0 - p) ** 1.5, p / (1.0 - p) ** 2, np.exp(log_q0)], axis=-1)
    return np.clip(found, [low for low, _ in BOUNDS], [high for _, high in BOUNDS])


def loop(subject: bt.Subject, counts: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, float]:
    """Best value of every replicate over the starts, and the seconds it took."""
    began = time.process_time()
    found = [
        max(-minimize(objective(subject, row), start, method="L-BFGS-B", bounds=BOUNDS, options=OPTIONS).fun for start in points)
        for row, points in zip(counts, starts, strict=True)
    ]
    return np.array(found), time.process_time() - began


def batch(subject: bt.Subject, fitted, replicates: int, repeats: int):
    """The replicates' fits and the least time of several runs."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        made = bootstrap_subject(subject, seed=SEED, replicates=replicates, fitted=fitted)
        times.append(time.process_time() - began)
    return made.fits.objective, min(times)


def main() -> int:
    """Print one line a subject and loop; exit code 1 if the batch is ever the worse one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--subjects", default="S01,S02,S07,S16", help="subjects of the bundled study")
    parser.add_argument("--replicates", type=int, default=1000)
    parser.add_argument("--loop", type=int, default=50, help="replicates given to the loop; its time is scaled up")
    parser.add_argument("--repeats", type=int, default=5, help="runs of the batch; the fastest counts")
    options = parser.parse_args()
    print(f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}, {platform.machine()}, seed {SEED}")
    print(
        f"{'subject':8} {'starts':>6} {'batch s':>8} {'loop s':>8} {'ratio':>6}  same optimum / loop lower / batch lower, of {options.loop}"
    )
    worse = 0
    for name in options.subjects.split(","):
        subject = bt.example_study()[name]
        fitted = fit_subject(subject)
        values, seconds = batch(subject, fitted, options.replicates, options.repeats)
        counts = resample(subject, generator(SEED, name, "bootstrap"), options.replicates)[: options.loop].astype(float)
        starts = natural_starts(subject, fitted, counts)
        for chosen in (starts[:, :1], starts):
            found, spent = loop(subject, counts, chosen)
            spent *= options.replicates / options.loop
            gap = values[: options.loop] - found
            lower = int((gap < -1e-8).sum())
            verdict = f"{int((np.abs(gap) <= 1e-8).sum())} / {int((gap > 1e-8).sum())} / {lower}"
            print(f"{name:8} {chosen.shape[1]:6d} {seconds:8.3f} {spent:8.1f} {spent / seconds:6.0f}  {verdict}", flush=True)
            worse += lower
    return 1 if worse else 0


if __name__ == "__main__":
    with threadpool_limits(1):
        sys.exit(main())
