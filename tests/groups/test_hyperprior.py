"""The hyperprior: its defaults beside the single-subject prior, numbers from the stimuli, files, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import bayes_toe as bt
from bayes_toe.data.conditions import Stimuli
from bayes_toe.groups.hyperprior import GROUP_PARAMETERS, Hyperprior, example_file, read_hyperprior
from bayes_toe.model.prior import DEFAULT
from bayes_toe.records import packed, unpacked


def study(factor=1.0, shift=0.0):
    s1, s2 = np.array([0.0, 1.0, 1.0]), np.array([3.0, 0.0, 1.0])
    return bt.Study(
        [bt.Subject("S", factor * s1 + shift, factor * s2 + shift, [1, 1, 5], [5, 15, 20])]
    )


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "hyperprior.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_what_the_stimuli_say_by_hand():
    found, (mean, sd, step, _) = Hyperprior().for_study(study()), Stimuli.of(*study())
    names = ("offset", "width", "noise_slope", "peak_slope", "answer_bias", "mu1")
    numbers, rest = found.numbers(names), [name for name in GROUP_PARAMETERS if name not in names]
    assert numbers.mean == pytest.approx([0.0, np.log(step), 0.0, 0.0, 0.0, mean])
    assert numbers.mean_sd == pytest.approx(
        [step / 2, 1.0, 0.5 / sd, 0.5 / sd, 0.3 * step, 2.5 * sd]
    )
    assert numbers.sd_scale == pytest.approx(
        [step / 2, 0.7, 0.5 / sd, 0.5 / sd, 0.3 * step, 2.5 * sd]
    )
    assert numbers.effect_sd.tolist() == numbers.sd_scale.tolist()
    assert [*map(np.ndarray.tolist, found.numbers(rest)[:4])] == [
        *map(np.ndarray.tolist, Hyperprior().numbers(rest)[:4])
    ]  # no others
    assert found.for_study(study(9.0)) == found  # once


@pytest.mark.parametrize("name", ["gamma", "q0", "lapse_rate", "exponent", "icc"])
def test_a_mean_is_spread_like_a_single_subject(name):
    """By default, on the group parameter's scale; the prior's own quantiles say where a single subject is."""
    prior = DEFAULT.distribution(name).sample(np.random.default_rng(3), 40_000)
    eta = {"log": np.log, "probit": stats.norm.ppf}[GROUP_PARAMETERS[name].scale](prior)
    mean, sd = (numbers[0] for numbers in Hyperprior().numbers([name])[:2])
    # five standard errors of a mean of 40,000, and what rounding to one digit takes
    assert (eta.mean(), eta.std()) == pytest.approx(
        (mean, sd), abs=0.025 * sd + 0.015 + 0.02 * (name == "q0")
    )


def test_files_dictionaries_and_records(written):
    assert read_hyperprior(written("")) == read_hyperprior(written(example_file())) == Hyperprior()
    found = read_hyperprior(
        written('\ufeff[gamma]\nsd_scale = 2\n[mu1]\nmean_sd = 1.5\nsd_scale = "stimuli"\n')
    )
    assert found == Hyperprior().changed({"gamma": {"sd_scale": 2.0}, "mu1": {"mean_sd": 1.5}})
    assert (found != Hyperprior(), len({found, Hyperprior(), Hyperprior()})) == (True, 2)
    assert found.for_study(study()).numbers(["mu1", "gamma"]).sd_scale.tolist() == [
        2.5 * Stimuli.of(*study()).sd,
        2.0,
    ]
    assert (
        Hyperprior().changed(json.loads(json.dumps(found.as_dict())))
        == unpacked(packed(found))
        == found
    )
    assert {type(value) for values in found.for_study(study()).values for value in values} == {
        float
    }


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[gama]\nmean = 0", "section 'gama': unknown, allowed: mu1, gamma, width, q0"),
        (
            "gamma = 0.5",
            "key gamma: found 0.5, allowed: a section [gamma] with mean, mean_sd, sd_scale, effect_sd",
        ),
        ("[[gamma]]\nmean = 0", "key gamma: found a list, allowed"),
        (
            "[gamma]\nsd = 0",
            "[gamma] key 'sd': unknown, allowed: mean, mean_sd, sd_scale, effect_sd",
        ),
        (
            "[gamma]\nsd_scale = 0",
            "[gamma] key sd_scale: found 0, allowed: a number from 1e-100 to 1e+100",
        ),
        (
            "[gamma]\nmean = 'stimuli'",
            "[gamma] key mean: found 'stimuli', allowed: a number from -1e+100 to 1e+100",
        ),
        (
            "[mu1]\nmean = 'stimulus'",
            "[mu1] key mean: found 'stimulus', allowed: a number from -1e+100 to 1e+100 or 'stimuli'",
        ),
        ("[mu1]\nmean = nan", "[mu1] key mean: found nan"),
        ("[mu1]\nmean = true", "[mu1] key mean: found true"),
        ("[mu1]\nmean.x = 1", "[mu1] key mean: found a table"),
        ("[mu1", "found text that is not TOML"),
        (
            b"\xff\xfe",
            "found bytes that are not UTF-8, allowed: a TOML file with NAME = NUMBER below a line [PARAMETER], as in mean = 0",
        ),
    ],
)
def test_bad_files_are_one_line(written, text, said):
    path = written(text)
    with pytest.raises(bt.InputError) as refused:
        read_hyperprior(path)
    (line,) = refused.value.problems
    assert line.startswith(f"{path}: {said}")
    assert line.isprintable()


def test_what_else_is_refused(tmp_path, written):
    with pytest.raises(bt.InputError, match="no such file; allowed: a TOML file"):
        read_hyperprior(tmp_path / "none.toml")
    with pytest.raises(bt.InputError) as several:
        read_hyperprior(written("[gamma]\nsd_scale = -1\nmean = '0'\n[x]\n"))
    assert len(several.value.problems) == 3
    with pytest.raises(
        bt.InputError, match="hyperprior: no parameter 'sigma_p', allowed: mu1, gamma"
    ):
        Hyperprior().numbers(["gamma", "sigma_p"])
    with pytest.raises(
        bt.InputError, match="hyperprior: mean of mu1 is that of the stimuli; Hyperprior"
    ):
        Hyperprior().numbers(["mu1"])
    with pytest.raises(
        bt.InputError, match=r"hyperprior: \[gamma\] key sd_scale: found -2.0, allowed"
    ):
        Hyperprior().changed({"gamma": {"sd_scale": -2.0}})
    with pytest.raises(bt.InputError, match="needs pairs of different stimuli"):
        Hyperprior().for_study(bt.Study([bt.Subject("S", [0.4], [0.4], [1], [2])]))


def test_the_page_shows_the_defaults():
    page = (Path(bt.__file__).parents[1] / "docs" / "population.md").read_text(encoding="utf-8")
    shown = page.partition("```toml\n")[2].partition("```")[0]
    sections = [f"[{part}" for part in shown.split("[")[1:]]
    assert all(part in example_file() for part in sections)
    assert [part[1 : part.index("]")] for part in sections] == [
        "mu1",
        "gamma",
        "width",
        "q0",
        "gain",
        "offset",
        "correlations",
    ]
