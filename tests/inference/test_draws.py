"""The container: contract of posterior.nc, summary, saving, loading, ArviZ; whose draws they are."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.analysis import smooth_curve_evidence
from bayes_toe.errors import InputError
from bayes_toe.inference.belonging import require_belonging
from bayes_toe.inference.subject import SUMMARY_COLUMNS

PARAMETERS = ("mu1", "sigma_p", "sigma_l", "q0", "gamma", "sigma1", "gain", "width", "pse_shift", "jnd")


@pytest.fixture(scope="module")
def saved(analysis, tmp_path_factory):
    return analysis.draws.save(tmp_path_factory.mktemp("nc") / "posterior.nc")


def test_seed_and_prior_come_back_as_they_went_in(saved, small_study, tmp_path):
    loaded = bt.load(saved)
    assert (loaded.seed, loaded.prior) == (5, bt.Prior())
    assert "mu1 ~ Normal(0, 10)" in loaded.attrs["prior"]
    assert json.loads(loaded.attrs["settings"])["sampler"]["draws"] == 2000
    assert {"python", "emcee", "arviz", "bayes_toe"} <= set(json.loads(loaded.attrs["versions"]))
    prior = bt.Prior(mu1_mean=-0.25, mu1_sd=1.5, sigma_p_scale=0.1 + 0.2)
    draws = bt.sample(small_study.select(["A"]), draws=200, seed=np.int64(2**62), prior=prior, workers=1)
    again = bt.load(draws.save(tmp_path / "posterior.nc"))
    assert (again.seed, again.prior) == (2**62, prior)
    assert again.attrs["prior"] == again.prior.describe()


def test_saved_and_loaded_are_one(saved, analysis):
    loaded = bt.load(saved)
    assert (loaded.names, loaded.parameters) == (analysis.draws.names, PARAMETERS)
    for name in PARAMETERS:
        assert np.array_equal(loaded.values("B", name), analysis.draws.values("B", name))
    assert np.array_equal(loaded.subject("B").n_yes, analysis.study["B"].n_yes)
    loaded.save(saved, overwrite=True)  # the file is not locked by having been read


@pytest.fixture(scope="module")
def data(saved):
    """For the ArviZ that is installed: an InferenceData or a DataTree."""
    return bt.load(saved).to_arviz()


def test_arviz_has_all_groups_and_their_dimensions(data):
    for name in PARAMETERS:
        assert data["posterior"][name].dims == ("chain", "draw", "subject")
    assert data["posterior"]["sigma1"].attrs["units"] == "ln intensity"
    for group in ("log_likelihood", "posterior_predictive"):
        assert data[group]["n_equal"].dims == ("chain", "draw", "obs")
    for group in ("observed_data", "constant_data", "log_likelihood"):
        assert {"subject", "s1", "s2"} <= set(data[group].coords)
    assert data["sample_stats"]["lp"].dims == ("chain", "draw", "subject")
    assert data["sample_stats"]["acceptance_rate"].dims == ("chain", "subject")
    assert data.attrs["model"] == "predictive update"


@pytest.mark.filterwarnings("ignore")  # of ArviZ's own imports and of its pictures
def test_arviz_functions_take_it(data, analysis):
    import arviz as az
    import matplotlib.pyplot as plt

    one = analysis.draws["A"].to_arviz()
    table = az.summary(one, var_names=list(PARAMETERS), round_to="none")
    assert len(table) == len(PARAMETERS)
    assert table["mean"].to_numpy(float) == pytest.approx([analysis.draws.values("A", name).mean() for name in PARAMETERS])
    ours = analysis.draws.summary()
    expected = ours[(ours.subject == "A")].set_index("parameter").loc[list(PARAMETERS)]
    assert table["r_hat"].to_numpy(float) == pytest.approx(expected["r_hat"].to_numpy(), abs=1e-6)
    for draws, pairs in ((one, 13), (data, 39)):
        loo = az.loo(draws, var_name="n_equal", pointwise=True)
        assert np.asarray(loo.elpd_i if hasattr(loo, "elpd_i") else loo.loo_i).size == pairs
    az.plot_pair(one, var_names=["mu1", "gain"])
    az.plot_forest(data, var_names=["gain"], combined=True)
    marks = [len(ax.lines) + len(ax.collections) for number in plt.get_fignums() for ax in plt.figure(number).axes]
    assert sum(marks) > 3  # ArviZ 1.x can draw an empty forest without a word
    plt.close("all")


def test_log_likelihoods_and_predicted_answers_follow_from_the_draws(analysis, data):
    name = "C"
    at = data["observed_data"]["subject"].values == name
    theta = [analysis.draws.values(name, key)[..., None] for key in ("mu1", "sigma_p", "sigma_l", "q0")]
    s = analysis.study[name]
    q = bt.model.equal_probability(s.s1, s.s2, *theta)
    expected = s.n_yes * np.log(q) + (s.n_trials - s.n_yes) * np.log1p(-q)
    assert data["log_likelihood"]["n_equal"].values[..., at] == pytest.approx(expected, rel=1e-9, abs=1e-9)
    predicted = data["posterior_predictive"]["n_equal"].values[..., at]
    assert predicted.mean(axis=(0, 1)) == pytest.approx((s.n_trials * q).mean(axis=(0, 1)), abs=0.5)
    spread = s.n_trials * (q * (1 - q)).mean(axis=(0, 1)) + (s.n_trials * q).var(axis=(0, 1))
    assert predicted.var(axis=(0, 1)) == pytest.approx(spread, rel=0.1)
    again = analysis.draws[name].to_arviz()["posterior_predictive"]["n_equal"].values
    assert np.array_equal(again, predicted)


@pytest.mark.filterwarnings("ignore")  # of ArviZ's own imports
def test_arviz_opens_the_file_as_it_is(saved):
    import arviz as az

    data = az.from_netcdf(saved)
    posterior = data["posterior"].to_dataset() if hasattr(data["posterior"], "to_dataset") else data["posterior"]
    one = posterior.sel(subject="A")
    assert float(az.rhat(one)["mu1"]) < 1.01
    assert len(az.summary(one)) == 4
    assert data["sample_stats"]["lp"].dims == ("chain", "draw", "subject")
    data.close()


def test_summary_has_the_columns_and_the_numbers(analysis):
    frame = analysis.draws.summary()
    assert tuple(frame.columns) == SUMMARY_COLUMNS
    before = "subject,parameter,mean,sd,q05,q25,q50,q75,q95,ess_bulk,ess_tail,r_hat,contraction"
    assert ",".join(SUMMARY_COLUMNS) == before + ",mcse_mean,mcse_q05,mcse_q50,mcse_q95"
    assert len(frame) == 3 * len(PARAMETERS)
    row = frame[(frame.subject == "B") & (frame.parameter == "sigma_p")].iloc[0]
    values = analysis.draws.values("B", "sigma_p")
    assert row["mean"] == pytest.approx(values.mean())
    assert row["q95"] == pytest.approx(np.quantile(values, 0.95))
    assert row["mcse_mean"] == pytest.approx(values.std(ddof=1) / np.sqrt(row["ess_bulk"]), rel=0.2)
    natural = frame[frame.parameter.isin(("mu1", "sigma_p", "sigma_l", "q0"))]
    assert (natural[["mcse_q05", "mcse_q95"]].max(axis=1) < 0.05 * (natural.q95 - natural.q05)).all()


def test_unknown_names_and_files_are_refused(analysis, tmp_path):
    with pytest.raises(InputError, match="no subject 'Z'"):
        analysis.draws.values("Z", "mu1")
    with pytest.raises(InputError, match="unknown parameter"):
        analysis.draws.values("A", "mu_1")
    with pytest.raises(InputError, match="no such file"):
        bt.load(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("not netcdf")
    with pytest.raises(InputError, match="not a NetCDF file"):
        bt.load(tmp_path / "text.nc")


def test_the_bundled_study_is_recovered_and_small(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        study, truth = bt.example_study(), bt.example_truth()
        draws = bt.sample(study, seed=4)  # of some seeds a quantile of S05 is said to need more draws
    levels = []
    for name in study.names:
        for key, value in truth[name].items():
            levels.append((draws.values(name, key) < value).mean())
    levels = np.array(levels)
    # 64 quantile levels of true values: for a calibrated posterior the count outside 90 % is Binomial(64, 0.1).
    assert ((levels < 0.05) | (levels > 0.95)).sum() <= 14
    assert 0.3 < levels.mean() < 0.7
    path = draws.save(tmp_path / "posterior.nc")
    assert path.stat().st_size < 60e6


def test_draws_tell_their_study(analysis, small_study):
    require_belonging(analysis.draws, "draws", study=small_study, prior=bt.Prior(), seed=5, model="predictive update")
    again = analysis.draws.study
    assert (again.names, again.source, again.synthetic) == (small_study.names, small_study.source, small_study.synthetic)
    require_belonging(analysis.draws, "draws", study=again.select(["C", "A", "B"]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda one: replace(one, n_yes=np.minimum(one.n_yes + 1, one.n_trials)), "found draws of subject 'B' from other answers"),
        (lambda one: replace(one, name="X"), "found no draws of subject 'X'"),
        (lambda one: None, "found draws of subject 'B', whom three kinds does not have"),
        (lambda one: replace(one, isi=np.ones(one.n_pairs)), "found draws of subject 'B' from other answers"),
    ],
    ids=["counts", "name", "absent", "intervals"],
)
def test_another_study_is_refused(analysis, small_study, change, said):
    others = [small_study["A"], change(small_study["B"]), small_study["C"]]
    if others[1] is not None and others[1].isi is not None:
        others = [replace(one, isi=np.ones(one.n_pairs)) for one in others]
        said = said.replace("'B'", "'A', 'B', 'C'")
    study = bt.Study([one for one in others if one is not None], source="three kinds")
    with pytest.raises(bt.InputError, match=r"^file: ") as refused:
        require_belonging(analysis.draws, "file", study=study)
    assert said in str(refused.value)


def test_another_model_is_refused_for_figures(small_study):
    draws = bt.sample(small_study.select(["A"]), model="constant bias", draws=100, seed=1, workers=1)
    with pytest.raises(bt.InputError, match=r"^the paper's figures: found draws of the model 'constant bias'"):
        bt.plots.figures(draws)


def test_evidence_of_saved_draws_is_that_of_the_run(analysis):
    found = smooth_curve_evidence(analysis.draws, workers=1)
    assert [row.log_evidence_h1 for row in found] == [row.log_evidence_h1 for row in analysis.evidence]
