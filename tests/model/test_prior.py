"""The prior: quantiles and draws, its files, and what is refused."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import made_subject, problems, refused, text_table
from numpy.random import default_rng

import bayes_toe as bt
from bayes_toe.model.parameters import ObserverPrior
from bayes_toe.model.prior import DEFAULT, ParameterHyperprior, Prior, sections
from bayes_toe.model.prior_file import read_prior

ONE_PAIR = made_subject("0 0.3 4 10")
BACKGROUND = Path(__file__).parents[2] / "docs" / "background.md"
#: The prior file with every number, which the document shows.
COMPLETE_FILE = BACKGROUND.read_text(encoding="utf-8").split("```toml")[1].split("```")[0]
WIDTH_PRIOR = Prior(0.4, 2.5, width_median=0.3, width_sd=0.7, gamma_a=2.0, gamma_b=3.0, q0_a=4.0)


@pytest.mark.parametrize(
    "prior", [Prior(0.4, 2.5, 0.3), WIDTH_PRIOR], ids=["of sigma_p", "of the width"]
)
def test_quantiles_are_those_of_draws(prior):
    n = 200_000
    probabilities = np.array([0.05, 0.5, 0.95])
    target = bt.model.paper_posterior(ONE_PAIR, prior)
    values = target.quantities(target.sample_prior(default_rng(8), n))
    for name in ("mu1", "sigma_p", "gamma", "q0", "sigma_l", "sigma1", "width", "gain"):
        quantiles = np.array([target.prior_quantile(name, p) for p in probabilities])
        shares_below = (values[name][:, None] < quantiles).mean(axis=0)  # of the draws
        # 4.5 standard errors of a share: 48 comparisons, a false alarm in about 3,000 such tests.
        z = (shares_below - probabilities) / np.sqrt(probabilities * (1 - probabilities) / n)
        assert np.abs(z).max() < 4.5, name


def test_a_small_pull_keeps_its_digits():
    target = bt.model.paper_posterior(ONE_PAIR, Prior(gamma_a=0.05))
    # The 5 % quantile of Beta(0.05, 1). So small a gamma is the pull itself.
    gamma = 0.05**20
    assert target.prior_quantile("pull", 0.05) == pytest.approx(gamma, rel=1e-6)


# --- files ----------------------------------------------------------------------------------------


@pytest.fixture
def read(tmp_path):
    """A function that reads a prior file with this text, ' / ' for a new line, or these bytes."""
    path = tmp_path / "prior.toml"

    def read_text(text):
        is_bytes = isinstance(text, bytes)
        path.write_bytes(text if is_bytes else text.replace(" / ", "\n").encode())
        return read_prior(path)

    return read_text


@pytest.mark.parametrize(
    # A file with the section [paper] stands for the paper's prior. Other files change the default
    # prior. The last two files have the line ends and the byte order mark of Windows.
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
def test_a_file_changes_the_numbers_that_it_names(read, text, expected):
    assert read(text) == expected


def test_the_complete_file_has_every_key():
    # The alternative to sigma_p_scale is a comment in the file.
    table = tomllib.loads(COMPLETE_FILE.replace("# width_median", "width_median"))
    assert list(table) == [name for name in sections() if "group" not in name]
    for name, values in table.items():
        assert list(values) == list(sections()[name])


#: Files, with " / " for a new line, and a part of the refusal.
REFUSED = """
    mu1_sd = 2 | mu1_sd: found no such section, allowed: [paper]
    [prior] / mu1_sd = 2 | prior: found no such section, allowed: [noise]
    noise = 2 | noise: found no such section, allowed: [noise]
    [[group]] | group: found no such section, allowed: [noise]
    [group.gain] / mean = 1 | group.gain: found no such section, allowed: [noise]
    [group.noise] / sd = 1 | [group.noise] 'sd': unknown key, allowed: mean, mean_scale, sd
    [group.noise] / sd_scale = 0 | [group.noise] sd_scale: found 0, allowed: a number
    [noise] / scale = 1 | [noise] 'scale': unknown key, allowed: median, sd
    [contraction] / sd = 0 | [contraction] sd: found 0, allowed: a number from 0.001 to
    [paper] / mu1_sd = '2' | mu1_sd: found '2', allowed: a number from 1e-100 to 1e+100
    [paper] / q0_b = 0.01 | q0_b: found 0.01, allowed: a number from 0.05 to 1000
    [paper] / mu1_sd = true | mu1_sd: found true
    [paper] / mu1_sd = [1, 2] | mu1_sd: found a list
    [paper] / mu1_mean = nan | found nan, allowed: a number from -1e+100 to 1e+100
    [q0] / a = 'stimuli' | [q0] a: found 'stimuli', allowed: a number from 0.001 to 1000
    [noise] / sd = 1979-05-27 | sd: found 1979-05-27
"""
#: Files that are no ordinary text, and a part of the refusal.
UNREADABLE = [
    ("[noise] / sd = 1" + "0" * 400, "sd: found an integer too large for a number"),
    ("[noise] / sd = 0x1" + "0" * 5000, "sd: found an integer too large for a number"),
    ("mu1_mean = 1" + "0" * 5000, "found text that is not TOML"),
    ("mu1_mean = " + "[" * 20_000, "found text that is not TOML"),
    (b"\xff\xfe\x00", "found text that is not TOML"),
]


@pytest.mark.parametrize("text, message", [*text_table(REFUSED), *UNREADABLE])
def test_wrong_prior_files_are_refused_with_what_is_allowed(read, text, message):
    (line,) = problems(read, text)
    path, _, problem = line.partition("prior.toml: ")
    assert message in problem
    assert "\n" not in line
    assert len(line) - len(path) < 320  # long values are not repeated


def test_all_problems_of_a_file_are_reported_at_once(read):
    lines = problems(read, "x = 2\n[paper]\nmu1_sd = 'stimulus'\ngamma_a = 'stimuli'")
    # The rules for x, mu1_sd and gamma_a.
    section_rule, sd_rule, gamma_rule = [line.partition("allowed: ")[2] for line in lines]
    assert section_rule.startswith("[noise], [q0]")
    assert sd_rule.startswith("a number from 1e-100 to 1e+100 or 'stimuli'")
    assert gamma_rule == "a number from 0.05 to 1000"


def test_a_file_that_does_not_exist_and_a_folder_are_refused(tmp_path):
    message = r"cannot be read .*; allowed: a TOML file with \[SECTION\] and NAME = NUMBER, as in"
    with refused(message):
        read_prior(tmp_path / "none.toml")
    with refused("cannot be read"):
        read_prior(tmp_path)
