"""The model that other samplers are given: against its definition, its own gradient, and a study whose subjects met different pairs."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr
from speed.population_target import counts_of, log_likelihood

import bayes_toe as bt

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "speed" / "population.py"


@pytest.fixture(scope="module")
def study():
    one = bt.Subject("A", [0.0, 0.1, 0.3], [0.2, 0.1, 0.0], [5, 9, 0], [9, 9, 4])
    return bt.Study([one, bt.Subject("B", [0.0, 0.4], [0.4, 0.1], [3, 7], [8, 7])])


@pytest.fixture(scope="module")
def eta():
    return np.array([[0.7, -0.4, -1.2, 1.3], [-0.5, 1.1, -0.6, 0.4]])


def test_likelihood_is_that_of_the_definition(study, eta):
    expected = 0.0
    for one, (mu1, probit_gamma, log_w, probit_q0) in zip(study, eta, strict=True):
        gamma = ndtr(probit_gamma)
        sigma_p = np.exp(log_w) * (0.5 * (1.0 + np.sqrt(1.0 + 4.0 * gamma))) ** -1.5
        q = bt.model.equal_probability(one.s1, one.s2, mu1, sigma_p, sigma_p * np.sqrt(gamma), ndtr(probit_q0))
        expected += np.sum(one.n_equal * np.log(q) + (one.n_trials - one.n_equal) * np.log1p(-q))
    assert log_likelihood(counts_of(study), eta)[0] == pytest.approx(expected, rel=1e-12)


def test_gradient_is_that_of_the_likelihood(study, eta):
    counts, step = counts_of(study), 1e-5
    for place in np.ndindex(eta.shape):
        moved = np.zeros_like(eta)
        moved[place] = step
        slope = (log_likelihood(counts, eta + moved)[0] - log_likelihood(counts, eta - moved)[0]) / (2.0 * step)
        assert log_likelihood(counts, eta)[1][place] == pytest.approx(slope, rel=1e-6)


def test_scales_of_the_hyperprior_are_over_trials(study):
    apart = (9 * 0.2**2 + 4 * 0.3**2 + 8 * 0.4**2 + 7 * 0.3**2) / 28
    mean = (9 * 0.1 + 4 * 0.3 + 7 * 0.4) / 37
    np.testing.assert_allclose(counts_of(study).prior_mean, [mean, 0.0, 0.5 * np.log(apart), 1.0])


def test_absent_library_is_one_line(tmp_path):
    study = tmp_path / "study.csv"
    study.write_text("subject,s1,s2,n_equal,n_trials\nA,0,0.2,3,9\n")
    hidden = f"import runpy, sys; sys.modules['nutpie'] = None; sys.path.insert(0, ''); sys.argv[0] = {str(SCRIPT)!r}; "
    words = [sys.executable, "-c", f"{hidden}runpy.run_path({str(SCRIPT)!r}, run_name='__main__')", str(study), "--method", "nutpie"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.splitlines()[0] == "nutpie: left out, nutpie is not installed"
