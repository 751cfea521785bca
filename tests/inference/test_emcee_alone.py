"""emcee without scipy.stats."""

import subprocess
import sys

_LOADED = """
import sys, threading
import numpy as np
from bayes_toe.inference.emcee_alone import emcee_alone
{before}
emcee = emcee_alone()
print("scipy.stats" in sys.modules)
sampler = emcee.EnsembleSampler(16, 2, lambda x: -0.5 * (x**2).sum(), moves=emcee.moves.KDEMove())
sampler.run_mcmc(np.random.default_rng(1).normal(size=(16, 2)), 20)
print(bool((np.diff(sampler.get_chain(), axis=0) != 0).any()), emcee is emcee_alone(), "scipy.stats" in sys.modules)
"""


def _says(before: str) -> list[str]:
    return subprocess.run([sys.executable, "-c", _LOADED.format(before=before)], capture_output=True, text=True, check=True).stdout.split()


def test_scipy_stats_comes_when_the_kde_move_is_used():
    assert _says("") == ["False", "True", "True", "True"]


def test_what_is_loaded_already_stays_as_it_is():
    assert _says("import scipy.stats")[0] == "True"
    thread = "one = threading.Thread(target=emcee_alone); one.start(); one.join(); import scipy.stats"
    assert _says(thread) == ["True", "True", "True", "True"]
