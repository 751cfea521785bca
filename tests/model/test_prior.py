"""The prior: quantiles and draws, densities against mpmath, contraction."""

import tomllib
from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest
from conftest import made_subject, problems
from definitions import ncdf, normal
from numpy.random import default_rng
from scipy import stats

import bayes_toe as bt
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.model.densities import (
    ProbitOfBeta,
    half_normal_score,
    log_half_normal,
    log_half_normal_slope,
)
from bayes_toe.model.parameters import ObserverPrior
from bayes_toe.model.posterior import posterior_contraction
from bayes_toe.model.prior import DEFAULT, ParameterHyperprior, Prior, sections
from bayes_toe.model.prior_file import read_prior

ONE_PAIR = made_subject("0 0.3 4 10")
BACKGROUND = Path(__file__).parents[2] / "docs" / "background.md"
COMPLETE_FILE = BACKGROUND.read_text(encoding="utf-8").split("```toml")[1].split("```")[0]
OF_WIDTH = Prior(0.4, 2.5, width_median=0.3, width_sd=0.7, gamma_a=2.0, gamma_b=3.0, q0_a=4.0)


@pytest.mark.parametrize(
    "prior", [Prior(0.4, 2.5, 0.3), OF_WIDTH], ids=["of sigma_p", "of the width"]
)
@pytest.mark.parametrize(
    "parameter", ["mu1", "sigma_p", "gamma", "q0", "sigma_l", "sigma1", "width", "gain"]
)
def test_quantiles_and_contraction_are_those_of_draws(parameter, prior):
    n, p = 200_000, np.array([0.05, 0.5, 0.95])
    target = bt.model.paper_posterior(ONE_PAIR, prior)
    values = target.quantities(target.sample_prior(default_rng(8), n))[parameter]
    limits = np.array([target.prior_quantile(parameter, share) for share in p])
    low, _, high = limits
    shares = (values[:, None] < limits).mean(axis=0)
    # 4.5 standard errors of a share: 48 comparisons, a false alarm in about 3,000 such tests
    assert np.all(np.abs(shares - p) < 4.5 * np.sqrt(p * (1 - p) / n))
    middle, quarter = 0.5 * (low + high), 0.25 * (high - low)
    half = posterior_contraction(target, parameter, middle - quarter, middle + quarter)
    assert half == pytest.approx(0.75, rel=1e-9)
    assert posterior_contraction(target, parameter, middle, middle) == 1.0
    assert posterior_contraction(target, parameter, low - 0.1, high + 0.1) < 0.0


def test_a_small_pull_keeps_its_digits():
    target = bt.model.paper_posterior(ONE_PAIR, Prior(gamma_a=0.05))
    gamma = 0.05**20  # the 5 % quantile of Beta(0.05, 1)
    assert target.prior_quantile("pull", 0.05) == pytest.approx(gamma, rel=1e-6)


@pytest.mark.parametrize(
    "numbers, message",
    [
        ({"sigma_p_scale": 0.0}, "prior: sigma_p_scale: found 0.0, allowed: a number from 1e-100"),
        ({"sigma_p_scale": np.inf}, "found inf, allowed: a number from 1e-100"),
        ({"mu1_mean": np.nan}, "mu1_mean: found nan, allowed: a number from .* or 'stimuli'"),
        ({"mu1_mean": None}, "mu1_mean: found None, allowed"),
        ({"gamma_a": "stimuli"}, "gamma_a: found 'stimuli', allowed: a number from 0.05 to 1000$"),
        ({"gamma_a": 1e-5}, "gamma_a: found 1e-05, allowed: a number from 0.05 to 1000$"),
    ],
)
def test_numbers_that_are_refused(numbers, message):
    with pytest.raises(bt.InputError, match=message):
        Prior(**numbers)


def test_a_contraction_without_a_distribution_is_refused():
    with pytest.raises(bt.InputError, match="contraction_sd: found 0"):
        ObserverPrior(contraction_sd=0.0)


# --- files ----------------------------------------------------------------------------------------


@pytest.fixture
def read(tmp_path):
    """Reads a prior file of this text or these bytes."""
    path = tmp_path / "prior.toml"

    def read_text(text):
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_prior(path)

    return read_text


@pytest.mark.parametrize(
    "text, expected",
    [
        ("", DEFAULT),
        ("[paper]", bt.Prior()),
        (COMPLETE_FILE, bt.Prior()),
        (
            '[paper]\nmu1_mean = "stimuli"\nsigma_p_scale = 0.5',
            bt.Prior(mu1_mean="stimuli", sigma_p_scale=0.5),
        ),
        (
            "[contraction]\nsd = 1\n[q0]\nb = 2",
            replace(DEFAULT, observer=ObserverPrior(contraction_sd=1.0, q0_b=2.0)),
        ),
        (
            "[group.q0]\nmean = 2",
            replace(DEFAULT, group=bt.Hyperprior(q0=ParameterHyperprior(2.0, 1.0, 1.0))),
        ),
        ("[paper]\r\nmu1_mean = -0.5\r\nmu1_sd = 1e1\r\n", bt.Prior(-0.5, 10.0)),
        (b"\xef\xbb\xbf[paper]\nmu1_sd = 3", bt.Prior(mu1_sd=3.0)),
    ],
)
def test_what_is_read(read, text, expected):
    assert read(text) == expected


def test_the_complete_file_has_every_key():
    table = tomllib.loads(COMPLETE_FILE.replace("# width_median", "width_median"))
    assert list(table) == [name for name in sections() if "group" not in name]
    for name, values in table.items():
        assert list(values) == list(sections()[name])


@pytest.mark.parametrize(
    "text, message",
    [
        ("mu1_sd = 2", "mu1_sd: found no such section, allowed: [paper]"),
        ("[prior]\nmu1_sd = 2", "prior: found no such section, allowed: [noise]"),
        ("noise = 2", "noise: found no such section, allowed: [noise]"),
        ("[[group]]", "group: found no such section, allowed: [noise]"),
        ("[group.gain]\nmean = 1", "group.gain: found no such section, allowed: [noise]"),
        ("[group.noise]\nsd = 1", "[group.noise] 'sd': unknown key, allowed: mean, mean_scale, sd"),
        (
            "[group.noise]\nsd_scale = 0",
            "[group.noise] sd_scale: found 0, allowed: a number",
        ),
        ("[noise]\nscale = 1", "[noise] 'scale': unknown key, allowed: median, sd"),
        ("[contraction]\nsd = 0", "[contraction] sd: found 0, allowed: a number from 0.001 to"),
        ("[paper]\nmu1_sd = '2'", "mu1_sd: found '2', allowed: a number from 1e-100 to 1e+100"),
        ("[paper]\nq0_b = 0.01", "q0_b: found 0.01, allowed: a number from 0.05 to 1000"),
        ("[paper]\nmu1_sd = true", "mu1_sd: found true"),
        ("[paper]\nmu1_sd = [1, 2]", "mu1_sd: found a list"),
        ("[paper]\nmu1_mean = nan", "found nan, allowed: a number from -1e+100 to 1e+100"),
        ("[noise]\nsd = 1" + "0" * 400, "sd: found an integer too large for a number"),
        ("[noise]\nsd = 0x1" + "0" * 5000, "sd: found an integer too large for a number"),
        ("mu1_mean = 1" + "0" * 5000, "found text that is not TOML"),
        ("mu1_mean = " + "[" * 20_000, "found text that is not TOML"),
        ("#" * 70_000, "cannot be read (70000 bytes, more than 65536)"),
        ("[q0]\na = 'stimuli'", "[q0] a: found 'stimuli', allowed: a number from 0.001 to 1000"),
        ("[noise]\nsd = 1979-05-27", "sd: found 1979-05-27"),
        (b"\xff\xfe\x00", "found text that is not TOML"),
    ],
)
def test_files_that_are_refused(read, text, message):
    (line,) = problems(read, text)
    path, _, problem = line.partition("prior.toml: ")
    assert message in problem
    assert "\n" not in line
    assert len(line) - len(path) < 320


def test_all_problems_at_once(read):
    lines = problems(read, "x = 2\n[paper]\nmu1_sd = 'stimulus'\ngamma_a = 'stimuli'")
    unknown, of_sd, of_gamma = [line.partition("allowed: ")[2] for line in lines]
    assert unknown.startswith("[noise], [q0]")
    assert of_sd.startswith("a number from 1e-100 to 1e+100 or 'stimuli'")
    assert of_gamma == "a number from 0.05 to 1000"


def test_paths_that_are_refused(tmp_path):
    message = r"cannot be read .*; allowed: a TOML file with \[SECTION\] and NAME = NUMBER, as in"
    with pytest.raises(bt.InputError, match=message):
        read_prior(tmp_path / "none.toml")
    with pytest.raises(bt.InputError, match="cannot be read"):
        read_prior(tmp_path)


# --- shares at their ends -------------------------------------------------------------------------


@pytest.mark.parametrize("a, b", [(1.0, 2.0), (2.0, 3.0), (0.6, 1.0), (0.3, 0.4), (30.0, 7.0)])
def test_the_probit_of_a_beta_is_exact_wherever_the_share_is(a, b):
    probits = np.array([-1e4, -40.0, -9.0, -0.6, 0.0, 0.4, 3.0, 8.0, 40.0, 1e4])
    density = ProbitOfBeta(a, b)
    with mpmath.workdps(60):
        for probit, value in zip(probits, density.log_density(probits), strict=True):
            # The smaller share has 60 digits, the larger one is its complement.
            below, above = ncdf(mpmath.mpf(probit)), ncdf(mpmath.mpf(-probit))
            log_below = mpmath.log(below) if probit < 0 else mpmath.log1p(-above)
            log_above = mpmath.log(above) if probit > 0 else mpmath.log1p(-below)
            expected = (a - 1) * log_below + (b - 1) * log_above - mpmath.log(mpmath.beta(a, b))
            expected += normal(mpmath.mpf(probit), 0, 1)
            assert value == pytest.approx(float(expected), rel=1e-12, abs=1e-12)
            of_phi = mpmath.npdf(probit)
            slope = of_phi * ((a - 1) / below - (b - 1) / above) - probit
            observed = density.slope(np.array(probit))
            assert observed == pytest.approx(float(slope), rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("score", [-600.0, -37.0, -20.5, -19.5, -3.0, 0.0, 2.0, 12.0, 37.0])
def test_the_log_of_a_half_normal_quantile_is_exact_in_both_tails(score):
    """P(U <= u) = Phi(score); its slope is phi(score) / (2 phi(u) u)."""
    with mpmath.workdps(330):
        log_u = mpmath.mpf(float(log_half_normal(np.array(score))))
        u = mpmath.exp(log_u)
        height = 2 * mpmath.npdf(u) * u
        slope = mpmath.npdf(score) / height
        mass, expected = mpmath.erf(u / mpmath.sqrt(2)), mpmath.ncdf(score)
        if score > 0:
            mass, expected = 2 * mpmath.ncdf(-u), mpmath.ncdf(-score)
        error_of_log = (mass - expected) / height
        assert abs(error_of_log) < 1e-14 * max(1, abs(log_u))
        assert log_half_normal_slope(np.array(score)) == pytest.approx(float(slope), rel=1e-11)
        if score > -37.5:
            assert half_normal_score(np.array(float(u))) == pytest.approx(score, abs=1e-12)


@pytest.mark.parametrize("name", ["gamma", "lapse_rate"])
@pytest.mark.parametrize("a, b", [(1.0, 0.05), (0.05, 1.0), (0.05, 0.05), (1.0, 0.25)])
def test_draws_of_a_share_with_poles_have_finite_coordinates_of_its_distribution(name, a, b):
    """Half of the draws from Beta(1, 0.05) lie nearer to 1 than floats do."""
    prior = Prior(**{f"{name}_a": a, f"{name}_b": b})
    subject = made_subject("0 0 45 50, 0 0.3 20 50, 0.3 0 15 50", task=WHICH_STRONGER)
    posterior = bt.model.paper_posterior(subject, prior)
    x = posterior.sample_prior(default_rng(3), 4000)
    assert np.isfinite(x).all()
    assert not np.isnan(posterior.log_density(x)).any()
    values = np.sort(posterior.quantities(x)[name])
    is_inside = np.abs(values - 0.5) < 0.5 - 1e-12  # nearer to an edge a float rounds them
    expected = (np.arange(len(values)) + 0.5) / len(values)
    distance = np.abs(stats.beta.cdf(values, a, b) - expected)[is_inside].max()
    assert distance < 0.035  # Kolmogorov: passes by chance in all but 1e-4
