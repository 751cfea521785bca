"""Files of draws of subjects and of groups: what is saved is read, and all else is refused."""

import contextlib
import os
import random
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path

import arviz as az
import h5py
import numpy as np
import pytest
import xarray as xr
from commands import refusal_of
from populations import made_result, simulated_group, two_conditions, with_ages
from processes import errors_on_a_full_disk

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.inference.draws_file import study_tree

RUN_AGAIN = "; run `bayes-toe sample` again, or `bayes-toe population` for a group"


@pytest.fixture(scope="module")
def saved(analysis, tmp_path_factory):
    """A folder with draws of subjects, posterior.nc, and of a group, population.nc."""
    folder = tmp_path_factory.mktemp("saved")
    analysis.draws.save(folder / "posterior.nc")
    made_result(*with_ages(), n_divergent=1).save(folder / "population.nc")
    return folder


def require_refusal(path, message):
    """Loading a file is refused in one line that begins with this message; returns the line."""
    with pytest.raises(InputError) as refusal:
        bt.load(path)
    line = str(refusal.value)
    assert line.startswith(f"{path}: {message}")
    assert line.isprintable()
    return line


# --- What is saved is read ------------------------------------------------------------------------


def test_a_file_stores_natural_parameters_alone_and_comes_back_identical(saved, analysis):
    loaded = bt.load(saved / "posterior.nc")
    groups = {"posterior", "sample_stats", "observed_data", "constant_data"}
    assert set(loaded.tree.children) == groups
    assert set(loaded.group("posterior").data_vars) == {"mu1", "sigma_p", "sigma_l", "q0"}
    xr.testing.assert_identical(loaded.tree, analysis.draws.tree)
    assert loaded["B"].study.frame().equals(loaded.study.select("B").frame())


def test_a_file_of_draws_has_no_room_for_all_quantities(saved):
    # The file has 1.8 MB: for each of three subjects, 10,240 draws of four parameters and their
    # density. With all ten quantities it would have 3.8 MB.
    assert (saved / "posterior.nc").stat().st_size < 3e6


def test_a_file_has_the_draws_of_each_subject_in_a_piece_of_their_own(saved):
    # Draws are written subject by subject, 2,560 in each of four chains.
    with h5py.File(saved / "posterior.nc") as file:
        assert file["posterior/mu1"].chunks == file["sample_stats/lp"].chunks == (4, 2560, 1)


def test_a_file_is_not_locked_by_having_been_read(saved):
    path = saved / "posterior.nc"
    bt.load(path).save(path, overwrite=True)


GROUPS = {
    "which is stronger": lambda: made_result(simulated_group(1, n_subjects=4)),
    "same or different": lambda: made_result(
        bt.example_study("same/different").select(["S01", "S02", "S03"])
    ),
    "covariates": lambda: made_result(*with_ages(), n_divergent=1),
    "conditions": lambda: made_result(two_conditions(2, n_subjects=3)),
}


@pytest.mark.parametrize("kind", GROUPS)
def test_a_group_is_read_as_it_was_saved(kind, tmp_path):
    # Arrays are equal to the bit; then records and tables are compared.
    result = GROUPS[kind]()
    loaded = bt.load(result.save(tmp_path / "population.nc"))
    for name in ("mean", "sd", "effects", "subjects"):
        assert np.array_equal(getattr(loaded.draws, name), getattr(result.draws, name))
    for name in ("settings", "scales", "subjects", "problems"):
        assert getattr(loaded, name) == getattr(result, name)
    assert loaded.regressors.columns == result.regressors.columns
    assert loaded.summary().equals(result.summary())
    assert loaded.study.conditions == result.study.conditions
    assert loaded.study.frame().equals(result.study.frame())


def test_arviz_opens_draws_of_subjects(saved):
    data = az.from_netcdf(saved / "posterior.nc")
    assert data["sample_stats"]["lp"].dims == ("chain", "draw", "subject")
    data.close()


def test_arviz_opens_a_group_with_conditions(tmp_path):
    GROUPS["conditions"]().save(tmp_path / "population.nc")
    group = az.from_netcdf(tmp_path / "population.nc")
    assert group["posterior"]["mean"].dims == ("chain", "draw", "coefficient")

    # Three parameters have a mean and a difference.
    coefficients = group["posterior"]["coefficient"].values.tolist()
    means = coefficients[:3]
    differences = coefficients[3:]
    assert differences == [f"difference 1 of {name}" for name in means]
    # The last two parameters do not differ between conditions.
    assert group["posterior"]["parameter"].values.tolist()[-2:] == ["lapse_rate", "noise_slope"]

    group.close()
    table = az.summary(bt.load(tmp_path / "population.nc").to_arviz(), var_names=["mean"])
    assert len(table) == len(coefficients)


def test_a_file_has_the_time_and_the_seed_of_its_run(analysis):
    attributes = analysis.draws.tree.attrs
    age = datetime.now(UTC) - datetime.fromisoformat(attributes["created_at"])
    assert timedelta(0) <= age < timedelta(days=1)  # a session of tests may take hours
    assert attributes["seed"] == analysis.settings.seed


def test_a_file_has_a_hash_of_its_counts_alone(analysis):
    def hash_of_counts(study):
        """The hash in a file without draws, and with another seed than that of the analysis."""
        return study_tree(study, seed=1, settings={}, groups={}).attrs["counts_hash"]

    file_hash = analysis.draws.tree.attrs["counts_hash"]
    assert hash_of_counts(analysis.study) == file_hash
    assert hash_of_counts(analysis.study.swap("A")) != file_hash


# --- What is refused ------------------------------------------------------------------------------


# Each of the following is a function that damages an open HDF5 file, or returns such a function.


def _delete(name):
    """A function that deletes an item of an open HDF5 file."""
    return lambda file: file.pop(name)


def _attribute(**values):
    """A function that changes attributes of an open HDF5 file."""
    return lambda file: file.attrs.update(values)


def _set(name, index, value):
    """A function that changes numbers of an array in an open HDF5 file."""
    return lambda file: file[name].__setitem__(index, value)


def _link_to_another_file(file):
    file["other"] = h5py.ExternalLink("p.nc", "/x")


def _put_inside_itself(file):
    file["posterior/loop"] = file["/"]
    del file["sample_stats"]


def _delete_format(file):
    del file.attrs["format"]


def _declare_more_than_it_has(file):
    # Chunks that were never written take no space: 96 GB are declared in a small file.
    del file["sample_stats/lp"]
    file.create_dataset("sample_stats/lp", (4, 10**9, 3), "f8", chunks=(4, 10**3, 3))


DRAWS_FILE, GROUP = "posterior.nc", "population.nc"
UNREADABLE = "not a file of draws that can be read"


#: A file, the function that damages it, and the message that refuses it.
DAMAGES = [
    (DRAWS_FILE, _delete_format, "not a file of draws of this version"),
    (DRAWS_FILE, _delete("constant_data"), UNREADABLE),
    (DRAWS_FILE, _delete("sample_stats/lp"), "no lp over (chain, draw, subject)"),
    (DRAWS_FILE, _set("posterior/mu1", ..., 1e308), "draws of mu1 are no numbers"),
    (GROUP, _delete("covariates/x"), "no x over (subject, covariate)"),
    (GROUP, _set("covariates/subject", 0, "Z"), UNREADABLE),
    (DRAWS_FILE, _set("posterior/mu1", (0, 0, 0), np.inf), "draws of mu1 are no numbers"),
    (GROUP, _set("covariates/x", ..., np.nan), "draws of x are no numbers"),
    (DRAWS_FILE, _set("posterior/subject", 0, "Z"), "its draws and its counts are of"),
    (DRAWS_FILE, _set("observed_data/n_equal", 0, -1), "subject 'A'"),
    (DRAWS_FILE, _attribute(seed="five"), UNREADABLE),
    (DRAWS_FILE, _attribute(seed=-1), "seed: found -1, allowed: a whole number"),
    (DRAWS_FILE, _attribute(settings="[" * 60_000), UNREADABLE),
    (DRAWS_FILE, _attribute(model="psychic"), "model 'psychic': no such model; allowed: none,"),
    (DRAWS_FILE, _declare_more_than_it_has, "it declares more numbers than it has"),
    (GROUP, _link_to_another_file, "'other' is a link"),
    (DRAWS_FILE, _put_inside_itself, UNREADABLE),
]


@pytest.mark.parametrize("name, damage, message", DAMAGES)
def test_a_damaged_file_is_refused_in_one_line(saved, tmp_path, name, damage, message):
    path = Path(shutil.copy(saved / name, tmp_path))
    with h5py.File(path, "r+") as file:
        damage(file)
    assert RUN_AGAIN in require_refusal(path, message)


def test_changed_bytes_are_refused_in_one_line_or_harmless(saved, tmp_path):
    path = tmp_path / DRAWS_FILE
    content = (saved / DRAWS_FILE).read_bytes()
    rng = random.Random(1)
    for i in range(20):
        changed = bytearray(content)
        end = len(content) if i % 2 else 20_000  # anywhere, or among the headers of HDF5
        for _ in range(3):
            changed[rng.randrange(end)] = rng.randrange(256)
        path.write_bytes(changed)
        # Any other error than a refusal fails the test.
        with contextlib.suppress(InputError):
            bt.load(path).summary()


def test_what_is_no_file_of_draws_is_refused_in_one_line(saved, tmp_path):
    # An empty file, a text, the beginning of a file of draws; then a folder and no file at all.
    path = tmp_path / DRAWS_FILE
    content = (saved / DRAWS_FILE).read_bytes()
    for other in (b"", b"subject", content[:10_000]):
        path.write_bytes(other)
        require_refusal(path, f"{UNREADABLE}{RUN_AGAIN}")
    rule = "allowed: a posterior.nc or population.nc written by bayes-toe"
    require_refusal(tmp_path, f"not a file; {rule}")
    require_refusal(tmp_path / "none.nc", f"no such file; {rule}")


def test_a_command_names_a_file_of_another_kind(saved):
    message = refusal_of("corner population.nc -o corner", cwd=saved)
    assert "population.nc: draws of a group, allowed: those of subjects, a posterior.nc" in message


def test_a_full_disk_is_an_error_and_leaves_nothing(saved, tmp_path):
    """HDF5 itself ends the process with a segmentation fault here."""
    target = tmp_path / DRAWS_FILE
    # The disk is full in the middle of the draws, and among the headers.
    errors = errors_on_a_full_disk(saved / DRAWS_FILE, target, sizes=[500_000, 2000])
    error = f"{target}: cannot be written (File too large), choose another place"
    assert errors == [error, error]
    assert os.listdir(tmp_path) == []


def test_more_draws_than_a_file_holds_are_refused_with_the_way_out(
    study_csv, tmp_path, monkeypatch
):
    monkeypatch.setattr("bayes_toe.inference.draws.LARGEST", 10**6)  # bytes
    monkeypatch.setattr("bayes_toe.analysis.run_stored", None)  # the work must not begin
    message = "allowed in a file: 0.001 GB; fewer --draws, or files of some subjects each"
    assert message in refusal_of(
        "sample", study_csv, "-o", "posterior.nc", cwd=tmp_path, silent=False
    )
