"""Draws of every model of the ladder: the same container, whatever the model."""

import numpy as np
import pytest
from commands import good, refused
from conftest import grouped_csv

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.inference.diagnostics import convergence
from bayes_toe.inference.predictive_checks import binomial_deviance
from bayes_toe.model.free_frequencies import FrequencyPosterior
from bayes_toe.model.ladder import MODELS, NAMES
from bayes_toe.model.prior import DEFAULT


@pytest.fixture(scope="module")
def two(small_study):
    """Two subjects, one of them without two of the pairs."""
    b = small_study["B"]
    fewer = bt.Subject("fewer", b.s1[2:], b.s2[2:], b.n_yes[2:], b.n_trials[2:])
    return bt.Study([small_study["A"], fewer], source="two")


@pytest.fixture(scope="module", params=NAMES)
def draws(two, request):
    return bt.sample(two, model=request.param, draws=500, seed=3, workers=1)


def test_the_file_says_which_model_and_which_prior_and_comes_back(draws, tmp_path):
    again = bt.load(draws.save(tmp_path / "posterior.nc"))
    record = next(model for model in MODELS if model.name == draws.model)
    assert (again.model, again.seed, again.prior) == (draws.model, 3, DEFAULT)
    assert again.attrs["prior"] == record.describe(DEFAULT) == again.described_prior()
    for name in again.parameters:
        assert np.array_equal(again.values("A", name), draws.values("A", name), equal_nan=True)
    assert repr(again.fit("A")) == repr(draws.fit("A"))  # under free frequencies a p-value is NaN


def test_points_and_quantities_are_inverse_and_have_the_stored_density(draws):
    for name in draws.names:
        target, x = draws.posterior(name), draws.points(name)
        assert x.shape[-1] == len(target.coordinates)
        stored = draws.group("sample_stats")["lp"].sel(subject=name).values
        assert target.log_density(x.reshape(-1, x.shape[-1])) == pytest.approx(stored.ravel(), rel=1e-7, abs=1e-5)
        found = target.quantities(x)
        for key in target.names.all:
            assert draws.values(name, key) == pytest.approx(found[key], rel=1e-9)


def test_summary_fit_and_predictions_are_those_of_the_draws(draws):
    frame, subject, target, fit = draws.summary(), draws.subject("A"), draws.posterior("A"), draws.fit("A")
    for name in draws.names:
        rows = frame[frame["subject"] == name]
        assert tuple(rows["parameter"]) == draws.posterior(name).names.reported
        assert np.isfinite(rows["mean"]).all()
        assert (rows["contraction"] < 1.0).all()
        # Enough for the ranks of every judged quantity; a quantity that follows from others has about as many.
        assert (rows["ess_bulk"] > 300).all()
    x = draws.points("A").reshape(-1, len(target.coordinates))
    best = binomial_deviance(target.subject.n_yes, target.subject.n_trials, *target.log_answers(x)).sum(axis=1).min()
    assert fit.deviance == pytest.approx(best, rel=1e-3, abs=1e-3)
    assert (fit.degrees_of_freedom, 0.0 <= fit.worst_p <= 1.0) == (13 - len(target.coordinates), True)
    if draws.model == "free frequencies":
        with pytest.raises(InputError, match="says nothing of pairs and intervals that were not tested"):
            bt.predict(draws, "A", subject.s1, subject.s2)
        return
    found, q = bt.predict(draws, "A", subject.s1, subject.s2), np.exp(target.log_answers(x)[0])
    assert found["mean"].to_numpy() == pytest.approx(q.mean(axis=0), rel=1e-9)
    assert found["q95"].to_numpy() == pytest.approx(np.quantile(q, 0.95, axis=0), rel=1e-9)


def test_draws_of_free_frequencies_are_their_beta_posteriors(two):
    draws = bt.sample(two, model="free frequencies", draws=4000, seed=3, workers=1)
    a, fewer = two["A"], two["fewer"]
    assert isinstance(draws.posterior("A"), FrequencyPosterior)
    for i in range(13):
        values, k, n = draws.values("A", f"q_{i + 1}"), a.n_yes[i] + 1, a.n_trials[i] + 2
        sd = np.sqrt(k * (n - k) / n**2 / (n + 1))
        # 13 means at 4.5 standard errors: a false alarm in ten thousand such tests.
        assert values.mean() == pytest.approx(k / n, abs=4.5 * sd / np.sqrt(values.size))
        assert convergence(values).r_hat < 1.01
    assert np.isnan(draws.values("fewer", "q_12")).all()  # that subject met eleven pairs
    assert draws.posterior("fewer").names.natural == tuple(f"q_{i + 1}" for i in range(fewer.n_pairs))


def test_the_command_samples_any_model_and_others_read_its_file(tmp_path, small_study):
    grouped_csv(tmp_path / "study.csv", small_study.select(["A"]))
    asked = ("--model", "constant bias", "--draws", "300", "--seed", "1", "--workers", "1")
    assert "constant bias: medians" in good("sample", "study.csv", "-o", "bias.nc", *asked, cwd=tmp_path)
    assert bt.load(tmp_path / "bias.nc").model == "constant bias"
    (tmp_path / "pairs.csv").write_text("s1,s2\n0,0.2\n", encoding="utf-8")
    good("predict", "bias.nc", "pairs.csv", "-o", "predicted.csv", cwd=tmp_path)
    said = refused("sample", "study.csv", "-o", "none.nc", "--model", "biased", cwd=tmp_path)
    assert "error: model 'biased': 'biased'; allowed, joined by +: order: update, none, constant error" in said
    assert "or: free frequencies, symmetric" in said


def test_what_a_model_does_not_have_and_a_model_that_is_not_known_are_refused(two, tmp_path):
    draws = bt.sample(two.select(["A"]), model="symmetric", draws=300, seed=1, workers=1)
    with pytest.raises(InputError, match="model 'symmetric' has no mu1, sigma_p, sigma_l; it has: q0, width"):
        draws.natural("A")
    draws.tree.attrs["model"] = "psychic"
    with pytest.raises(InputError, match=r"other.nc: draws of model 'psychic': 'psychic'; allowed, joined by \+: .*; or: free"):
        bt.load(draws.save(tmp_path / "other.nc"))
