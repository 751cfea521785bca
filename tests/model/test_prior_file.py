"""Prior files: what is read, and one line for everything that cannot be used."""

from dataclasses import asdict

import pytest

import bayes_toe as bt
from bayes_toe.model.prior import example_file


def written(tmp_path, text, name="prior.toml"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", bt.Prior()),
        ("# nothing\n", bt.Prior()),
        ("mu1_sd = 2", bt.Prior(mu1_sd=2.0)),
        ("offset_sd = 2\ngamma_a = 3", bt.Prior(offset_sd=2.0, gamma_a=3.0)),
        ("mu1_mean = -0.5\r\nmu1_sd = 1e1\r\nsigma_p_scale = 0.3\r\n", bt.Prior(-0.5, 10.0, 0.3)),
        (b"\xef\xbb\xbfmu1_sd = 3.0", bt.Prior(mu1_sd=3.0)),
    ],
)
def test_what_is_read(tmp_path, text, expected):
    found = bt.model.read_prior(written(tmp_path, text))
    assert found == expected
    assert {type(value) for value in asdict(found).values() if value} == {float, str}


def test_the_example_is_the_default(tmp_path):
    assert bt.model.read_prior(written(tmp_path, example_file())) == bt.Prior()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mu_sd = 2", "key 'mu_sd': unknown, allowed: mu1_mean, mu1_sd, sigma_p_scale"),
        ("[prior]\nmu1_sd = 2", "key 'prior': unknown"),
        ("mu1_sd = '2'", "key mu1_sd: found '2', allowed: a number from 1e-100 to 1e+100"),
        ("offset_sd = 0", "key offset_sd: found 0, allowed"),
        ("icc_b = 0.01", "key icc_b: found 0.01, allowed: a number from 0.05 to 1000"),
        ("mu1_sd = true", "key mu1_sd: found true"),
        ("mu1_sd = [1, 2]", "key mu1_sd: found a list"),
        ("mu1_sd = 0", "key mu1_sd: found 0, allowed"),
        ("mu1_sd = -1.5", "key mu1_sd: found -1.5, allowed"),
        ("sigma_p_scale = inf", "key sigma_p_scale: found inf"),
        ("mu1_mean = nan", "key mu1_mean: found nan, allowed: a number from -1e+100 to 1e+100"),
        ("mu1_mean = 1" + "0" * 400, "key mu1_mean: found an integer too large for a number"),
        ("mu1_mean = 0x1" + "0" * 5000, "key mu1_mean: found an integer too large for a number"),
        ("mu1_mean = 1" + "0" * 5000, "found text that is not TOML"),
        ("mu1_mean = " + "[" * 20_000, "found text that is not TOML"),
        ("#" * 70_000, "cannot be read (70000 bytes, more than 65536)"),
        ("mu1_mean = 1979-05-27", "key mu1_mean: found 1979-05-27"),
        ("mu1_sd 2", "found text that is not TOML"),
        ("mu1_sd = 2\nmu1_sd = 3", "found text that is not TOML"),
        (b"\xff\xfe\x00", "found bytes that are not UTF-8"),
    ],
)
def test_what_is_refused(tmp_path, text, said):
    path = written(tmp_path, text)
    with pytest.raises(bt.InputError) as caught:
        bt.model.read_prior(path)
    (line,) = caught.value.problems
    assert line.startswith((f"{path}: ", "prior.toml: "))
    assert said in line
    assert "\n" not in line
    assert len(line) - len(str(path)) < 320


def test_all_problems_at_once(tmp_path):
    with pytest.raises(bt.InputError) as caught:
        bt.model.read_prior(written(tmp_path, "mu1_sd = -1\nx = 2\nsigma_p_scale = 'a'"))
    assert len(caught.value.problems) == 3


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(bt.InputError, match="no such file; allowed: a TOML file with NAME = NUMBER, as in mu1_mean = 0"):
        bt.model.read_prior(tmp_path / "none.toml")
    with pytest.raises(bt.InputError, match="cannot be read"):
        bt.model.read_prior(tmp_path)
