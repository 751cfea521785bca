"""The prior: quantiles and draws, general families against mpmath and SciPy, shares at their ends, contraction."""

from dataclasses import asdict, fields, replace

import mpmath
import numpy as np
import pytest
from scipy import stats
from scipy.special import betaln, expit

import bayes_toe as bt
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.model.distributions import (
    Beta,
    HalfNormal,
    LogNormal,
    Normal,
    Uniform,
    log_density_of_logit,
    slope_of_logit,
)
from bayes_toe.model.paper_equations import quantities
from bayes_toe.model.paper_model import log_density_of_noise_ratio
from bayes_toe.model.parameters import ObserverPrior
from bayes_toe.model.posterior import contraction
from bayes_toe.model.prior import DEFAULT, Prior
from bayes_toe.model.prior_file import example_file, read_prior, sections

SBAR = 0.2


OF_WIDTH = Prior(0.4, 2.5, width_median=0.3, width_sd=0.7, gamma_a=2.0, gamma_b=3.0, q0_a=4.0)


def of(prior):
    """Log density of H1's prior and its gradient, with respect to unconstrained coordinates."""
    posterior = bt.model.paper_posterior(bt.Subject("S", [SBAR], [SBAR], [3], [5]), prior)
    return posterior.log_prior, posterior.prior_gradient


def test_distributions_by_name():
    found = Prior(lapse_rate_b=4.0)
    assert found.distribution("lapse_rate").describe() == "Beta(1, 4)"
    assert Prior().distribution("q0") == Prior().distribution("gamma") == Uniform()
    assert (Prior(0.4, 2.5).penalty, Prior(0.4, 2.5).describe_penalty()) == (
        Normal(0.4, 2.5),
        "mu1 ~ Normal(0.4, 2.5)",
    )
    names = [one.name for one in Prior.declared()]
    assert [*names, "observer"] == [field.name for field in fields(Prior)]


@pytest.mark.parametrize(
    "prior", [Prior(0.4, 2.5, 0.3), OF_WIDTH], ids=["of sigma_p", "of the width"]
)
@pytest.mark.parametrize(
    "parameter", ["mu1", "sigma_p", "gamma", "q0", "sigma_l", "sigma1", "width", "gain"]
)
def test_quantiles_and_contraction_are_those_of_draws(parameter, prior):
    n, p = 200_000, np.array([0.05, 0.5, 0.95])
    drawn = quantities(prior.sample(np.random.default_rng(8), n), SBAR)[parameter]
    target = bt.model.paper_posterior(bt.Subject("S", [0.0], [0.3], [4], [10]), prior)
    limits = [target.prior_quantile(parameter, one) for one in p]
    # 4.5 standard errors of a share: 48 comparisons, a false alarm in about 3,000 such tests
    assert np.all(
        np.abs([(drawn < limit).mean() for limit in limits] - p) < 4.5 * np.sqrt(p * (1 - p) / n)
    )
    middle = 0.5 * (limits[0] + limits[2])
    assert contraction(
        target, parameter, 0.5 * (limits[0] + middle), 0.5 * (limits[2] + middle)
    ) == pytest.approx(0.75, rel=1e-9)
    assert contraction(target, parameter, middle, middle) == 1.0
    assert contraction(target, parameter, limits[0] - 0.1, limits[2] + 0.1) < 0.0


@pytest.mark.parametrize(
    ("call", "said"),
    [
        *(
            (
                lambda bad=bad: Prior(sigma_p_scale=bad),
                "prior: sigma_p_scale=.*, allowed: a positive finite number",
            )
            for bad in (0.0, -1.0, np.inf)
        ),
        (
            lambda: Prior(mu1_mean=np.nan),
            "prior: mu1_mean=nan, allowed: a finite number or 'stimuli'",
        ),
        (lambda: Prior(gamma_a="stimuli"), "gamma_a=stimuli, allowed: a positive finite number$"),
        (
            lambda: Prior().distribution("sigma_l"),
            "no distribution of 'sigma_l', allowed: mu1, sigma_p, width, gamma, q0, ",
        ),
        (lambda: ObserverPrior(contraction_sd=0.0), "contraction_sd is 0.0; allowed is a number"),
    ],
)
def test_what_it_may_not_be(call, said):
    with pytest.raises(bt.InputError, match=said):
        call()


# --- files ----------------------------------------------------------------------------------------


def written(tmp_path, text):
    path = tmp_path / "prior.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def with_observer(prior=DEFAULT, **numbers):
    return replace(prior, observer=ObserverPrior(**numbers))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", DEFAULT),
        ("[paper]", bt.Prior()),
        (example_file(), bt.Prior()),
        (
            '[paper]\nmu1_mean = "stimuli"\nsigma_p_scale = 0.5',
            bt.Prior(mu1_mean="stimuli", sigma_p_scale=0.5),
        ),
        ("[contraction]\nsd = 1\n[q0]\nb = 2", with_observer(contraction_sd=1.0, q0_b=2.0)),
        ("[paper]\r\nmu1_mean = -0.5\r\nmu1_sd = 1e1\r\n", bt.Prior(-0.5, 10.0)),
        (b"\xef\xbb\xbf[paper]\nmu1_sd = 3", bt.Prior(mu1_sd=3.0)),
    ],
)
def test_what_is_read(tmp_path, text, expected):
    found = read_prior(written(tmp_path, text))
    assert found == expected
    values = [value for name, value in asdict(found).items() if value and name != "observer"]
    assert {type(value) for value in values} <= {float, str}
    assert {type(value) for value in asdict(found.observer).values()} == {float}


def test_every_number_of_the_observer_has_a_key():
    keys = {f"{section}_{key}" for section, values in sections().items() for key in values}
    assert {field.name for field in fields(ObserverPrior)} <= keys


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mu_sd = 2", "key 'mu_sd': unknown, allowed: sections [noise], [q0], [lapse_rate]"),
        ("mu1_sd = 2", "key mu1_sd: found outside of the sections, allowed: in the section [paper"),
        ("[prior]\nmu1_sd = 2", "key 'prior': unknown, allowed: sections [noise]"),
        ("noise = 2", "noise: found no section, allowed: [noise] and below it median, sd"),
        ("[[paper]]", "paper: found no section, allowed: [paper] and below it mu1_mean, mu1_sd"),
        ("[noise]\nscale = 1", "[noise] key 'scale': unknown, allowed: median, sd"),
        ("[contraction]\nsd = 0", "[contraction] key sd: found 0, allowed: a number from 0.001 to"),
        (
            "[q0]\na = 'stimuli'",
            "[q0] key a: found 'stimuli', allowed: a number from 0.001 to 1000",
        ),
        ("[paper]\nmu1_sd = '2'", "key mu1_sd: found '2', allowed: a number from 1e-100 to 1e+100"),
        ("[paper]\nq0_b = 0.01", "key q0_b: found 0.01, allowed: a number from 0.05 to 1000"),
        ("[paper]\nmu1_sd = true", "key mu1_sd: found true"),
        ("[paper]\nmu1_sd = [1, 2]", "key mu1_sd: found a list"),
        ("[paper]\nmu1_sd = -1.5", "key mu1_sd: found -1.5, allowed"),
        ("[paper]\nsigma_p_scale = inf", "key sigma_p_scale: found inf"),
        ("[paper]\nmu1_mean = nan", "found nan, allowed: a number from -1e+100 to 1e+100"),
        ("[noise]\nsd = 1" + "0" * 400, "key sd: found an integer too large for a number"),
        ("[noise]\nsd = 0x1" + "0" * 5000, "key sd: found an integer too large for a number"),
        ("mu1_mean = 1" + "0" * 5000, "found text that is not TOML"),
        ("mu1_mean = " + "[" * 20_000, "found text that is not TOML"),
        ("#" * 70_000, "cannot be read (70000 bytes, more than 65536)"),
        ("[noise]\nsd = 1979-05-27", "key sd: found 1979-05-27"),
        ("mu1_sd 2", "found text that is not TOML"),
        ("[noise]\nsd = 2\nsd = 3", "found text that is not TOML"),
        (b"\xff\xfe\x00", "found bytes that are not UTF-8"),
    ],
)
def test_what_is_refused(tmp_path, text, said):
    path = written(tmp_path, text)
    with pytest.raises(bt.InputError) as caught:
        read_prior(path)
    (line,) = caught.value.problems
    assert line.startswith((f"{path}: ", "prior.toml: "))
    assert said in line
    assert "\n" not in line
    assert len(line) - len(str(path)) < 320


def test_all_problems_at_once(tmp_path):
    text = "x = 2\n[paper]\nmu1_sd = 'stimulus'\ngamma_a = 'stimuli'"
    with pytest.raises(bt.InputError) as caught:
        read_prior(written(tmp_path, text))
    allowed = [
        "sections [noise], [q0]",
        "a number from 1e-100 to 1e+100 or 'stimuli'",
        "a number from 0.05 to 1000",
    ]
    assert [
        line.split("allowed: ")[1][: len(known)]
        for line, known in zip(caught.value.problems, allowed, strict=True)
    ] == allowed
    said = r"no such file; allowed: a TOML file with \[SECTION\] and NAME = NUMBER, as in"
    with pytest.raises(bt.InputError, match=said):
        read_prior(tmp_path / "none.toml")
    with pytest.raises(bt.InputError, match="cannot be read"):
        read_prior(tmp_path)


# --- shares at their ends -------------------------------------------------------------------------


@pytest.mark.parametrize(("a", "b"), [(1.0, 2.0), (2.0, 3.0), (0.6, 1.0), (0.3, 0.4), (30.0, 7.0)])
def test_a_beta_of_gamma_is_exact_wherever_the_pull_is(a, b):
    prior, logits = (
        Prior(gamma_a=a, gamma_b=b),
        [-700.0, -80.0, -9.0, -0.6, -1e-3, 0.0, 0.4, 3.0, 36.0, 80.0, 700.0],
    )
    x = np.array([[0.0, logit, -1.0, 0.5] for logit in logits])
    value = log_density_of_noise_ratio(prior.distribution("gamma"), x[:, 1])
    more = of(prior)[0](x) - of(Prior())[0](x)
    slope = (of(prior)[1](x) - of(Prior())[1](x))[:, 1]

    def by_hand(logit):
        p = (3 - mpmath.sqrt(5)) / 2 / (1 + mpmath.exp(-logit))
        gamma = p / (1 - p) ** 2
        return (
            (a - 1) * mpmath.log(gamma)
            + (b - 1) * mpmath.log(1 - gamma)
            - mpmath.log(mpmath.beta(a, b))
        )

    for row, logit in enumerate(logits):
        with mpmath.workdps(700):
            h = mpmath.mpf(10) ** -300
            truth, rise = (
                float(by_hand(mpmath.mpf(logit))),
                float((by_hand(logit + h) - by_hand(logit - h)) / (2 * h)),
            )
        assert value[row] == pytest.approx(truth, rel=1e-12, abs=1e-300), logit
        assert (more[row], slope[row]) == pytest.approx((truth, rise), rel=1e-9, abs=1e-9), logit


@pytest.mark.parametrize("distribution", [Beta(1.0, 9.0), Beta(0.3, 4.0)])
def test_a_share_keeps_its_digits_at_both_ends(distribution):
    a, b, logits = distribution.a, distribution.b, np.array([-700.0, -2.0, 0.3, 40.0, 700.0])
    expected = -a * np.logaddexp(0, -logits) - b * np.logaddexp(0, logits) - betaln(a, b)
    assert log_density_of_logit(distribution, logits) == pytest.approx(expected, rel=1e-13)
    plain = stats.beta.logpdf(expit(logits[1:3]), a, b) + np.log(
        expit(logits[1:3]) * expit(-logits[1:3])
    )
    assert expected[1:3] == pytest.approx(plain, rel=1e-12)
    slope = slope_of_logit(distribution, logits)
    values = [log_density_of_logit(distribution, logits[1:3] + step) for step in (-1e-5, 1e-5)]
    assert slope[1:3] == pytest.approx((values[1] - values[0]) / 2e-5, rel=1e-7)
    assert slope[[0, -1]] == pytest.approx([a, -b])


# --- families against SciPy -----------------------------------------------------------------------

FAMILIES = [
    (Normal(0.3, 2.5), stats.norm(0.3, 2.5)),
    (HalfNormal(0.7), stats.halfnorm(scale=0.7)),
    (Uniform(), stats.uniform()),
    (Uniform(2.5), stats.uniform(scale=2.5)),
    (Beta(1.0, 9.0), stats.beta(1.0, 9.0)),
    (Beta(1.7, 2.5), stats.beta(1.7, 2.5)),
    (LogNormal(2.0, 0.5), stats.lognorm(0.5, scale=2.0)),
]


@pytest.mark.parametrize(
    ("ours", "theirs"), FAMILIES, ids=lambda one: getattr(one, "describe", str)()
)
def test_families_are_scipys(ours, theirs):
    p = np.array([1e-12, 0.01, 0.2, 0.5, 0.9, 1 - 1e-6])
    x = theirs.ppf(p)
    assert ours.log_density(x) == pytest.approx(theirs.logpdf(x), rel=1e-12, abs=1e-12)
    assert ours.quantile(p) == pytest.approx(x, rel=1e-9)
    step = 1e-5 * theirs.std()
    near = [ours.log_density(x[1:-1] + k * step) for k in (-1, 1)]
    assert ours.slope(x[1:-1]) == pytest.approx(
        (near[1] - near[0]) / (2 * step), rel=1e-6, abs=1e-6
    )


@pytest.mark.parametrize(
    ("ours", "theirs"), FAMILIES, ids=lambda one: getattr(one, "describe", str)()
)
@pytest.mark.parametrize(
    "rng", [np.random.default_rng(11), np.random.RandomState(11)], ids=["Generator", "RandomState"]
)
def test_draws_follow_the_distribution_function(ours, theirs, rng):
    # 10 such tests at 1e-4 each: a false alarm in a thousand
    assert stats.kstest(ours.sample(rng, 20_000), theirs.cdf).pvalue > 1e-4


def test_edges_and_what_lies_beyond():
    assert HalfNormal(1.0).log_density([-1.0, 0.0]).tolist() == [
        -np.inf,
        pytest.approx(0.5 * np.log(2 / np.pi)),
    ]
    assert Uniform(2.0).log_density([-0.1, 0.0, 2.0, 2.1]).tolist() == [
        -np.inf,
        -np.log(2.0),
        -np.log(2.0),
        -np.inf,
    ]
    assert [one.log_density(1e300).item() for one in (Normal(0.0, 1.0), HalfNormal(1.0))] == [
        -np.inf,
        -np.inf,
    ]
    assert all(
        np.isnan(one.log_density(np.nan)) for one in (Normal(0.0, 1.0), HalfNormal(1.0), Uniform())
    )
    for one in (HalfNormal(1.0), Uniform(), Beta(2.0, 0.5), LogNormal(1.0, 2.0)):
        assert one.log_density(-1.0) == -np.inf
    for ours, theirs in (FAMILIES[1], FAMILIES[-1]):
        x = theirs.ppf([1e-12, 0.01, 0.2, 0.5, 0.9, 1 - 1e-6])
        assert ours.cdf([-1.0, *x]) == pytest.approx(theirs.cdf([-1.0, *x]), rel=1e-9)
    assert Beta(2.0, 3.0).log_density(1.0) == -np.inf
    assert Beta(1.0, 2.0).log_density([0.0, 1.5]).tolist() == [np.log(2.0), -np.inf]
    assert LogNormal(1.0, 2.0).log_density([0.0, np.inf]).tolist() == [-np.inf, -np.inf]
    assert Normal(0.0, 1e300).log_density(1e10) == pytest.approx(
        -0.5 * np.log(2 * np.pi) - 300 * np.log(10)
    )


@pytest.mark.parametrize("name", ["gamma", "lapse_rate"])
@pytest.mark.parametrize(("a", "b"), [(1.0, 0.05), (0.05, 1.0), (0.05, 0.05), (1.0, 0.25)])
def test_draws_of_a_share_with_poles_have_finite_coordinates_of_its_distribution(name, a, b):
    """Half of the draws from Beta(1, 0.05) lie nearer to 1 than floats do."""
    prior = replace(Prior(), **{f"{name}_a": a, f"{name}_b": b})
    s1, s2 = [0.0, 0.0, 0.3], [0.0, 0.3, 0.0]
    subject = bt.Subject("S01", s1, s2, [45, 20, 15], [50, 50, 50], task=WHICH_STRONGER)
    posterior = bt.model.paper_posterior(subject, prior)
    x = posterior.sample_prior(np.random.default_rng(3), 4000)
    assert np.isfinite(x).all()
    assert not np.isnan(posterior.log_density(x)).any()
    values = np.sort(posterior.quantities(x)[name])
    inside = np.abs(values - 0.5) < 0.5 - 1e-12  # nearer to an edge a float rounds them
    expected = (np.arange(len(values)) + 0.5) / len(values)
    assert (
        np.abs(stats.beta.cdf(values, a, b) - expected)[inside].max() < 0.035
    )  # Kolmogorov: passes by chance in all but 1e-4


def test_the_summary_says_what_the_prior_rules(small_study):
    # one trial a pair tells nearly nothing of gamma; fifty thousand tell everything
    s1, s2 = small_study["A"].s1, small_study["A"].s2
    few = bt.Subject("few", s1, s2, np.ones(len(s1), int), np.ones(len(s1), int))
    many = bt.Subject(
        "many", s1, s2, 1000 * small_study["A"].n_yes, 1000 * small_study["A"].n_trials
    )
    summary = bt.sample(bt.Study([few, many]), draws=500, seed=1, workers=1).summary()
    assert "posterior_contraction" in summary.columns
    of = summary.set_index(["subject", "parameter"])["posterior_contraction"]
    assert (of["many"] > 0.99).all()
    assert of["few"]["gamma"] < 0.3
    assert (of["few"] < of["many"]).all()
