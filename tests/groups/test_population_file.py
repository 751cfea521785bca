"""population.nc: what is read is what was written, and what is refused."""

import h5py
import numpy as np
import pytest
import xarray as xr
from populations import made_result, simulated_group, two_conditions, with_ages

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.groups.population import load as load_population


def with_covariates():
    return made_result(*with_ages(), n_divergent=1)


BUILT = {
    "which is stronger": lambda: made_result(simulated_group(1, n_subjects=4)),
    "same or different": lambda: made_result(
        bt.example_study("same/different").select(["S01", "S02", "S03"])
    ),
    "covariates": with_covariates,
    "conditions": lambda: made_result(two_conditions(2, n_subjects=3)),
}


@pytest.mark.parametrize("kind", BUILT)
def test_there_and_back(kind, tmp_path):
    result = BUILT[kind]()
    loaded = bt.load(result.save(tmp_path / "population.nc"))
    for name in ("mean", "sd", "effects", "subjects"):
        assert np.array_equal(getattr(loaded.draws, name), getattr(result.draws, name))
    for name in ("settings", "scales", "subjects", "problems"):
        assert getattr(loaded, name) == getattr(result, name)
    assert loaded.regressors.columns == result.regressors.columns
    assert loaded.summary().equals(result.summary())
    assert loaded.study.conditions == result.study.conditions
    assert loaded.study.frame().equals(result.study.frame())


def test_the_draws_are_named_for_arviz(tmp_path):
    BUILT["conditions"]().save(tmp_path / "population.nc")
    with xr.open_datatree(tmp_path / "population.nc", engine="h5netcdf") as tree:
        drawn = tree["posterior"]
        assert drawn["mean"].dims == ("chain", "draw", "coefficient")
        coefficients = drawn["coefficient"].values.tolist()
        assert coefficients[:3] == ["constant_error", "contraction", "noise"]
        assert coefficients[3:] == [f"difference 1 of {name}" for name in coefficients[:3]]
        assert drawn["parameter"].values.tolist()[-2:] == ["lapse_rate", "noise_slope"]


def test_what_is_not_a_population_is_refused(tmp_path):
    for name, content in (("text.nc", b"subject"), ("empty.nc", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=f"{name}: not a population that can be read"):
            load_population(tmp_path / name)
    with pytest.raises(InputError, match=r"none\.nc: no such file; allowed: a population\.nc"):
        load_population(tmp_path / "none.nc")
    with h5py.File(tmp_path / "other.nc", "w") as file:
        file.attrs["hyperprior"] = "probit gamma"
    with pytest.raises(InputError, match=r"other\.nc: not a population that can be read"):
        load_population(tmp_path / "other.nc")


def test_damage_is_refused(tmp_path):
    path = BUILT["which is stronger"]().save(tmp_path / "population.nc")
    with h5py.File(path, "a") as file:
        del file["posterior/subjects"]
    with pytest.raises(InputError, match=r"population\.nc: not a population that can be read"):
        load_population(path)


@pytest.mark.parametrize("name, value", [("mean", np.nan), ("sd", -1.0)])
def test_draws_that_no_group_has_are_refused(tmp_path, name, value):
    BUILT["conditions"]().save(tmp_path / "p.nc")
    with h5py.File(tmp_path / "p.nc", "r+") as file:
        file["posterior"][name][0, 0] = value
    with pytest.raises(InputError, match="its draws are no numbers, or a standard deviation"):
        load_population(tmp_path / "p.nc")


def test_covariates_that_are_not_those_of_the_draws_are_refused(tmp_path):
    path = with_covariates().save(tmp_path / "population.nc")
    with h5py.File(path, "r+") as file:
        file["constant_data/x"][...] = np.nan
    with pytest.raises(InputError, match="its covariates are not those of its draws"):
        load_population(path)
