"""Files of draws that were damaged, or come from elsewhere: one line, whatever HDF5 would have done with them."""

import zlib

import h5py
import numpy as np
import pytest
import xarray as xr
from commands import call
from processes import save_on_a_full_disk

import bayes_toe as bt
from bayes_toe.errors import InputError
from bayes_toe.inference import draws_file


@pytest.fixture(scope="module")
def bytes_of_draws(analysis, tmp_path_factory):
    """A file of one subject's draws."""
    return analysis.draws.select("B").save(tmp_path_factory.mktemp("nc") / "posterior.nc").read_bytes()


@pytest.fixture
def path(bytes_of_draws, tmp_path):
    file = tmp_path / "posterior.nc"
    file.write_bytes(bytes_of_draws)
    return file


def _circle(file):
    file["posterior/again"] = file["/"]


def _twice(file):
    file["posterior/twice"] = file["posterior/mu1"]


def _soft(file):
    file["posterior/soft"] = h5py.SoftLink("/sample_stats/lp")


def _external(file):
    file["posterior/other"] = h5py.ExternalLink("/etc/hosts", "/x")


def _stored_elsewhere(file):
    del file["posterior/mu1"]
    file["posterior"].create_dataset("mu1", (2, 4), "f8", external=[("/etc/hosts", 0, h5py.h5f.UNLIMITED)])


def _virtual(file):
    layout = h5py.VirtualLayout((2,), "f8")
    layout[:] = h5py.VirtualSource("/tmp/other.h5", "x", (2,))
    file["posterior"].create_virtual_dataset("virtual", layout)


def _never_stored(file):
    file["posterior"].create_dataset("huge", (10**6, 10**6), "f8", chunks=(1000, 1000))


def _inflated(file):
    zeros = file["posterior"].create_dataset("zeros", (10**4, 10**6), "i1", chunks=(10**4, 10**3), compression="gzip")
    chunk = zlib.compress(bytes(10**7))
    for first in range(0, 10**6, 10**3):
        zeros.id.write_direct_chunk((0, first), chunk)


def _no_group(file):
    del file["constant_data"]


def _no_variable(file):
    del file["sample_stats/lp"]


def _another_type(file):
    values = file["sample_stats/converged"]
    values.attrs["scale_factor"] = 0.5


def _another_seed(file):
    file.attrs["seed"] = "five"


def _no_settings(file):
    file.attrs["settings"] = "[" * 60_000


def _unknown_model(file):
    file.attrs["model"] = "lapse"


def _another_subject(file):
    file["observed_data/subject"][0] = "Z"


def _impossible_count(file):
    file["observed_data/n_equal"][0] = -1


def _another_pair(file):
    file["constant_data/s1"][0] += 0.5


def _no_number(file):
    file["posterior/mu1"][0, 0, 0] = np.inf


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_circle, "not a variable of its own"),
        (_twice, "not a variable of its own"),
        (_soft, "not a NetCDF file"),
        (_external, "not a NetCDF file"),
        (_stored_elsewhere, "kept in another file"),
        (_virtual, "kept in another file"),
        (_never_stored, "not all there"),
        (_inflated, "bytes of variables in a file of"),
        (_no_group, "no group constant_data"),
        (_no_variable, "no variable sample_stats/lp"),
        (_another_type, "sample_stats/converged is float"),
        (_another_seed, "attribute seed is not a whole number"),
        (_no_settings, "does not hold a prior"),
        (_unknown_model, "draws of model 'lapse'"),
        (_another_subject, "posterior and observed_data are of other subjects"),
        (_impossible_count, "counts outside"),
        (_another_pair, "observed_data and constant_data are of other pairs"),
        (_no_number, "draws of 'mu1' are no numbers"),
    ],
)
def test_what_is_not_ours_is_refused_in_one_line(path, damage, said, monkeypatch):
    monkeypatch.setattr(draws_file, "_rehearse", lambda *_: None)  # a process each
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(InputError, match=said) as refused:
        bt.load(path)
    assert str(path) in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize("place", [0.0, 0.01, 0.3, 0.7, 0.9999])
def test_one_altered_bit_anywhere_is_noticed(path, place):
    data = bytearray(path.read_bytes())
    data[int(place * len(data))] ^= 4
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"damaged: (it does|its numbers do) not fit"):
        bt.load(path)


def test_every_number_has_a_checksum_and_an_altered_one_is_noticed(path):
    with h5py.File(path) as file:
        numbers = [one for group in file.values() for one in group.values() if one.dtype.kind != "O" and one.id.get_storage_size()]
        assert len(numbers) > 20
        assert all(one.fletcher32 for one in numbers)
        at = file["posterior/q0"].id.get_chunk_info(0).byte_offset
    data = bytearray(path.read_bytes())
    data[at + 100] ^= 1
    path.write_bytes(data[:-1])  # without the seal
    with pytest.raises(InputError, match="damaged: its numbers do not fit their checksums"):
        bt.load(path)


def test_files_without_checksums_still_load(analysis, tmp_path):
    draws = analysis.draws
    draws.tree.to_netcdf(tmp_path / "old.nc", engine="h5netcdf")
    assert bt.load(tmp_path / "old.nc").values("A", "mu1").tolist() == draws.values("A", "mu1").tolist()


@pytest.mark.parametrize(("ends", "said"), [("os.abort()", "crashes"), ("time.sleep(99)", "does not end")])
def test_a_file_on_which_hdf5_crashes_or_hangs_is_refused(path, monkeypatch, ends, said):
    path.write_bytes(path.read_bytes()[:-1])
    monkeypatch.setattr(draws_file, "_PATIENCE", -path.stat().st_size / 1e6 + (60.0 if "abort" in ends else 0.2))
    monkeypatch.setattr(draws_file, "_REHEARSAL", f"import os, time; {ends}")
    with pytest.raises(InputError, match=f"damaged: HDF5 {said} on it"):
        bt.load(path)


def test_the_command_says_one_line_and_ends_with_2(path, tmp_path):
    path.write_bytes(path.read_bytes()[:10_000])
    (tmp_path / "pairs.csv").write_text("s1,s2\n0,0.3\n")
    result = call("predict", path, tmp_path / "pairs.csv", "-o", tmp_path / "out.csv")
    assert (result.returncode, len(result.stderr.splitlines())) == (2, 1)
    assert not (tmp_path / "out.csv").exists()


@pytest.fixture
def large(analysis, tmp_path, monkeypatch):
    """A file of three subjects that is taken for a large one."""
    monkeypatch.setattr("bayes_toe.inference.draws_file.AT_ONCE", 0)
    return analysis.draws.save(tmp_path / "posterior.nc")


def test_draws_of_a_large_file_are_read_when_they_are_asked_for(large, analysis, tmp_path):
    draws = bt.load(large)
    one = draws["B"]
    xr.testing.assert_identical(one.group("posterior"), analysis.draws.select("B").group("posterior"))
    assert draws.points("C").tolist() == analysis.draws.points("C").tolist()
    assert not any(one.variable._in_memory for one in draws.tree["posterior"].to_dataset().data_vars.values())
    draws.save(tmp_path / "again.nc")
    assert (tmp_path / "again.nc").read_bytes() == large.read_bytes()
    xr.testing.assert_identical(bt.load(large).tree.load(), analysis.draws.tree)


def test_a_damaged_subject_of_a_large_file_is_noticed_when_it_is_asked_for(large):
    with h5py.File(large, "r") as file:
        chunk = file["posterior/q0"].id.get_chunk_info(1)
    data = bytearray(large.read_bytes())
    data[chunk.byte_offset + 100] ^= 4
    large.write_bytes(data)
    draws = bt.load(large)
    assert draws.values("A", "q0").size > 0
    for read in (draws.select, draws.points):
        with pytest.raises(InputError, match=r"posterior\.nc: damaged: its numbers do not fit their checksums"):
            read("B")


def test_a_full_disk_is_an_error_and_not_the_end_of_the_process(path, tmp_path):
    """HDF5 ended the process with a segmentation fault here."""
    save_on_a_full_disk(path, tmp_path / "new.nc", 300_000)
    assert [file.name for file in tmp_path.iterdir()] == ["posterior.nc"]
