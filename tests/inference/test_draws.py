"""Draws of every model that is sampled: their file, their summary, and what ArviZ finds in them."""

import arviz as az
import numpy as np
import pandas as pd
import pytest
from commands import refusal_of, run_ok
from conftest import refused
from populations import some_pairs

import bayes_toe as bt
from bayes_toe.inference.fitted import find_maxima
from bayes_toe.inference.goodness_of_fit import binomial_deviance
from bayes_toe.inference.subject import SUMMARY_COLUMNS
from bayes_toe.model.prior import DEFAULT

NATURAL = ("mu1", "sigma_p", "sigma_l", "q0")
#: All quantities in a summary of the paper's model.
PARAMETERS = (*NATURAL, "gamma", "sigma1", "gain", "width", "pse_shift", "jnd")


# --- Draws of any model ---------------------------------------------------------------------------


@pytest.fixture(scope="module", params=["none", "both", "paper"])
def draws(small_study, request):
    """Draws of two subjects; the second subject lacks two of the pairs."""
    subject_b = some_pairs(small_study["B"], slice(2, None))
    return bt.sample(
        bt.Study([small_study["A"], subject_b]),
        model=request.param,
        draws=np.int64(500),
        seed=np.int64(2**62),
    )


def test_a_file_says_which_model_and_which_prior_and_comes_back(draws, tmp_path):
    loaded = bt.load(draws.save(tmp_path / "posterior.nc"))
    # The seed needs 63 bits.
    assert (loaded.model, loaded.seed, loaded.prior) == (draws.model, 2**62, DEFAULT)
    assert loaded.tree.attrs["prior"] == loaded.described_prior() == draws.described_prior()
    for name in loaded.parameters:
        assert np.array_equal(loaded.values("A", name), draws.values("A", name), equal_nan=True)
    assert loaded.fit("A") == draws.fit("A")


def test_points_and_quantities_are_inverse_and_have_the_stored_density(draws):
    for name in draws.names:
        # The points, (chains, draws, coordinates), are computed from the stored quantities.
        target = draws.posterior(name)
        x = draws.points(name)
        expected = draws.group("sample_stats")["lp"].sel(subject=name).values
        log_density = target.log_density(x.reshape(-1, len(target.coordinates)))
        # The tolerances are for the rounding of the points.
        np.testing.assert_allclose(log_density, expected.ravel(), rtol=1e-7, atol=1e-5)
        quantities = target.quantities(x)
        for key in target.names.all:
            np.testing.assert_allclose(draws.values(name, key), quantities[key], rtol=1e-9)


def test_the_summary_has_the_reported_quantities_of_the_model(draws):
    assert tuple(draws["A"].summary()["parameter"]) == draws.posterior("A").names.reported


def test_the_deviance_of_the_fit_is_that_of_the_maximum(draws):
    subject = draws.subject("A")
    target = draws.posterior("A")
    maximum = find_maxima(target).x[:1, target.is_free]  # the highest maximum, (1, coordinates)
    counts = subject.n_yes, subject.n_trials
    deviance = binomial_deviance(*counts, *target.log_answers(maximum)).sum()
    fit = draws.fit("A")
    assert fit.deviance == pytest.approx(deviance, rel=1e-6)
    assert fit.degrees_of_freedom == 13 - len(target.coordinates)  # 13 pairs


def test_predictions_are_those_of_the_draws(draws):
    subject = draws.subject("A")
    target = draws.posterior("A")
    x = draws.points("A").reshape(-1, len(target.coordinates))  # (draws, coordinates)
    q = np.exp(target.log_answers(x)[0])  # P(equal), (draws, pairs)
    predicted = bt.predict(draws, "A", subject.s1, subject.s2)
    assert predicted["mean"].to_numpy() == pytest.approx(q.mean(axis=0), rel=1e-9)
    assert predicted["q95"].to_numpy() == pytest.approx(np.quantile(q, 0.95, axis=0), rel=1e-9)


def test_the_command_samples_the_model_that_is_typed(study_csv):
    folder = study_csv.parent
    words = "sample study.csv -o draws.nc --model constant-error --draws 100 --seed 1"
    assert "Draws in draws.nc. Seed 1." in run_ok(words, cwd=folder)
    # The model 'constant error' does not have the paper's parameters.
    message = "model 'constant error' has no mu1, sigma_p, sigma_l; it has: noise, q0, lapse_rate"
    with refused(message):
        bt.load(folder / "draws.nc").natural("A")


def test_an_unknown_model_is_refused_with_those_there_are(study_csv):
    message = refusal_of("sample study.csv -o none.nc --model biased", cwd=study_csv.parent)
    assert "model 'biased': no such model; allowed: none, constant-error, contraction" in message


# --- Draws of the paper's model: contents, summary, ArviZ -----------------------------------------


def test_the_summary_of_an_analysis_is_that_of_its_draws(analysis):
    """Effective draws come from ranks, which differ where rounding changes the order of draws."""
    pd.testing.assert_frame_equal(analysis.summary(), analysis.draws.summary(), rtol=1e-5)


def test_summary_has_the_columns_and_the_numbers(analysis):
    frame = analysis.draws.summary()
    assert tuple(frame.columns) == SUMMARY_COLUMNS
    assert len(frame) == 3 * len(PARAMETERS)  # of three subjects

    row = frame.set_index(["subject", "parameter"]).loc["B", "sigma_p"]
    values = analysis.draws.values("B", "sigma_p")
    quantiles = np.quantile(values, [0.05, 0.25, 0.5, 0.75, 0.95])
    assert row[["q05", "q25", "q50", "q75", "q95"]].tolist() == pytest.approx(quantiles)

    # Posterior contraction is 1 - (posterior width / prior width)^2.
    target = analysis.draws.posterior("B")
    prior_range = target.prior_quantile("sigma_p", 0.95) - target.prior_quantile("sigma_p", 0.05)
    expected = 1.0 - ((row["q95"] - row["q05"]) / prior_range) ** 2
    assert row["posterior_contraction"] == pytest.approx(expected)


@pytest.fixture(scope="module")
def data(analysis):
    """The draws for the ArviZ that is installed: an InferenceData or a DataTree."""
    return analysis.draws.to_arviz()


def test_the_summary_by_arviz_has_the_same_numbers(analysis):
    subject = analysis.draws["A"]
    table = az.summary(subject.to_arviz(), var_names=list(PARAMETERS), round_to="none")
    expected = subject.summary().set_index("parameter").loc[list(PARAMETERS)]
    for column in ("mean", "mcse_mean", "ess_bulk", "r_hat"):
        assert table[column].to_numpy(float) == pytest.approx(expected[column].to_numpy(), rel=1e-6)


def test_arviz_leaves_out_each_pair_of_one_subject_and_of_three(data, analysis):
    # Each subject has 13 pairs.
    for draws, n_pairs in ((analysis.draws["A"].to_arviz(), 13), (data, 39)):
        loo = az.loo(draws, var_name="n_equal", pointwise=True)
        # Older versions of ArviZ say `loo_i`.
        assert np.asarray(loo.elpd_i if hasattr(loo, "elpd_i") else loo.loo_i).size == n_pairs


def test_predicted_answers_follow_from_the_draws(analysis, data):
    """Means and variances of replicated counts; tolerances are for their Monte Carlo errors."""
    is_c = data["observed_data"]["subject"].values == "C"
    subject = analysis.study["C"]
    theta = (analysis.draws.values("C", key)[..., None] for key in NATURAL)
    q = bt.model.equal_probability(subject.s1, subject.s2, *theta)  # (chains, draws, pairs)
    predicted = data["posterior_predictive"]["n_equal"].values[..., is_c]
    mean = subject.n_trials * q
    assert predicted.mean(axis=(0, 1)) == pytest.approx(mean.mean(axis=(0, 1)), abs=0.5)

    # The mean binomial variance, and the variance of the binomial mean.
    variance = (mean * (1 - q)).mean(axis=(0, 1)) + mean.var(axis=(0, 1))
    assert predicted.var(axis=(0, 1)) == pytest.approx(variance, rel=0.1)


@pytest.mark.parametrize(
    "subject, parameter, message",
    [("Z", "mu1", "no subject 'Z'"), ("A", "mu_1", "unknown parameter 'mu_1'; there are: mu1")],
)
def test_unknown_names_are_refused(analysis, subject, parameter, message):
    with refused(message):
        analysis.draws.values(subject, parameter)
