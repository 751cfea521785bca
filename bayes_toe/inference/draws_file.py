"""The one format of draws: a tree of xarray that ArviZ opens, and its NetCDF file.

`subjects_tree` makes the tree of the draws of subjects. `study_tree` makes the parts that a group
has as well, and `stored_study` reads them. `save_tree` writes a tree and `read_tree` reads one.

A tree has the draws in the group posterior, what is known of each subject in sample_stats, and the
counts in long form over `obs`, one entry per subject and pair. Everything else follows from these;
see :class:`bayes_toe.inference.draws.Draws`. The attributes of the root say which run it was: seed,
time, versions, and a hash of the counts. Numbers have checksums of HDF5 (Fletcher-32).
"""

from __future__ import annotations

import io
import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core.indexing import (
    IndexingSupport,
    LazilyIndexedArray,
    explicit_indexing_adapter,
)

from bayes_toe.arrays import FloatArray, Record, StrPath, Texts, run_starts
from bayes_toe.cluster import without_cluster
from bayes_toe.data.conditions import Conditions, StimulusScales
from bayes_toe.data.messages import format_path, quoted
from bayes_toe.data.stimulus_unit import StimulusUnit
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import task_of
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError
from bayes_toe.inference.subject import Settings, SubjectDraws
from bayes_toe.libraries import library_versions
from bayes_toe.model.models import describe_prior, model_posterior
from bayes_toe.model.parameters import QUANTITY_BY_NAME
from bayes_toe.result_store import load_result

#: The format of the files. A file of another format is refused.
FORMAT = 2
#: The group of a tree that has the covariates; only the tree of a group of subjects has it.
COVARIATES = "covariates"
_GROUPS = ("posterior", "sample_stats", "observed_data", "constant_data", COVARIATES)
BY_SUBJECT = ("chain", "draw", "subject")
_RUN_AGAIN = "run `bayes-toe sample` again, or `bayes-toe population` for a group"


# --- Trees ----------------------------------------------------------------------------------------


def subjects_tree(
    study: Study,
    subject_draws: Sequence[SubjectDraws | Path],
    settings: Settings,
    failed: Mapping[str, str],
    not_interpreted: Mapping[str, str],
) -> xr.DataTree:
    """The tree of the draws of all subjects of the study, which stay in their records.

    `failed` and `not_interpreted` have the reason for each subject that they name.
    """
    quantities = load_result(subject_draws[0]).quantities
    n_chains, n_draws = quantities["lp"].shape
    shape = (n_chains, n_draws, len(study))
    variables = {}
    for quantity in quantities:
        values = LazilyIndexedArray(_DrawsOfSubjects(subject_draws, quantity, shape))
        variables[quantity] = (BY_SUBJECT, values)
    n_walkers = settings.sampler.walkers
    # Draws are walker-major: the draws of the first walker come first.
    walker = np.repeat(np.arange(n_walkers), n_draws // n_walkers)
    coordinates = {
        "chain": np.arange(n_chains),
        "draw": np.arange(n_draws),
        "subject": np.array(study.names, object),
        "walker": ("draw", walker),
    }
    draws = xr.Dataset(variables, coordinates)
    posterior = draws.drop_vars("lp")
    for name, variable in posterior.items():
        variable.attrs["units"] = QUANTITY_BY_NAME[str(name)].unit

    statistics = []
    acceptance = []
    for record in map(load_result, subject_draws):
        statistics.append(record.statistics)
        acceptance.append(record.acceptance)
    # NetCDF has no Boolean values, and a text of any length is an object.
    types: Record = {"converged": np.int8, "shortfall": object, "imprecise": object}
    sample_stats = xr.Dataset(coords=posterior.drop_vars("walker").coords)
    for name in statistics[0]:
        column = [row[name] for row in statistics]
        sample_stats[name] = ("subject", np.array(column, types.get(name)))
    sample_stats["acceptance_rate"] = (("chain", "subject"), np.stack(acceptance, axis=-1))
    target = model_posterior(settings.model, study.subjects[0], settings.prior)
    coordinate_names = ", ".join(target.coordinates)
    density = f"log density of the unconstrained coordinates ({coordinate_names}), unnormalised"
    sample_stats["lp"] = draws["lp"].drop_vars("walker").assign_attrs(description=density)

    tree = study_tree(
        study,
        settings.seed,
        asdict(settings),
        {"posterior": posterior, "sample_stats": sample_stats},
    )
    tree.attrs |= {
        "model": settings.model,
        "prior": describe_prior(settings.model, settings.prior, study.task),
        "failed": json.dumps(dict(failed)),
        "not_interpreted": json.dumps(dict(not_interpreted)),
    }
    return tree


@dataclass
class _DrawsOfSubjects(BackendArray):
    """The draws of a quantity in records of subjects, which xarray reads when it has to.

    The shape is (chains, draws, subjects).
    """

    records: Sequence[SubjectDraws | Path]
    quantity: str
    shape: tuple[int, int, int]
    dtype = np.dtype(np.float64)

    def __getitem__(self, key: Any) -> FloatArray:
        """The draws at an index, which has any form that xarray allows."""
        return explicit_indexing_adapter(key, self.shape, IndexingSupport.BASIC, self._read)

    def _read(self, key: tuple[Any, ...]) -> FloatArray:
        """The draws at an index with a number or a slice for each axis."""
        chains, draws, subjects = key
        if isinstance(subjects, slice):
            indices = range(len(self.records))[subjects]
            return np.stack([self._read((chains, draws, i)) for i in indices], axis=-1)
        record = load_result(self.records[subjects])
        return record.quantities[self.quantity][chains, draws]


def study_tree(
    study: Study, seed: int, settings: Record, groups: Mapping[str, xr.Dataset]
) -> xr.DataTree:
    """A tree of these groups, with the counts of the study and the attributes of every file.

    Numbers of NumPy in the settings become numbers of Python.
    """
    tree = xr.DataTree.from_dict(groups)
    counts = _counts_by_pair(study)
    observed = counts.drop_vars("n_trials").rename(n_yes=study.task.count)
    tree["observed_data"] = xr.DataTree(observed)
    tree["constant_data"] = xr.DataTree(counts[["n_trials"]])

    record = {  # the study without its counts, in values that JSON can store
        "units": {unit.name: (unit.condition, unit.shared_scales) for unit in study},
        "task": study.task.name,
        "stimulus_unit": asdict(study.unit),
        "source": study.source,
        "synthetic": study.synthetic,
        "notes": study.notes,
        "changes": study.changes,
        "conditions": study.conditions and asdict(study.conditions),
    }
    tree.attrs |= {
        "format": FORMAT,
        "seed": seed,
        "created_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "counts_hash": _counts_hash(study),
        "versions": json.dumps(library_versions("xarray") | {"python": platform.python_version()}),
        "study": json.dumps(record),
        "settings": json.dumps(settings, default=np.generic.item),
    }
    return tree


def _counts_hash(study: Study) -> str:
    """A hash of the names and counts of all subjects."""
    digest = sha256()
    for subject in study:
        digest.update(subject.name.encode("utf-8", "surrogatepass"))
        for name in ("s1", "s2", *subject.task.counts):
            digest.update(getattr(subject, name).tobytes())
    return digest.hexdigest()


def _counts_by_pair(study: Study) -> xr.Dataset:
    """The counts of every subject and pair, an entry of `obs` each; s1 and s2 are coordinates."""
    stimuli = ["s1", "s2"]
    n_pairs = [subject.n_pairs for subject in study]
    names = np.repeat(np.array(study.names, object), n_pairs)  # the subject of each entry
    table = xr.Dataset(coords={"obs": np.arange(len(names)), "subject": ("obs", names)})
    for key in (*stimuli, *study.task.counts):
        table[key] = ("obs", np.concatenate([getattr(subject, key) for subject in study]))
    return table.set_coords(stimuli)


def stored_study(tree: xr.DataTree) -> Study:
    """The study in a tree: the counts of the subjects that have draws, and the study's record."""
    record = json.loads(tree.attrs["study"])
    task = task_of(record["task"])
    stimulus_unit = StimulusUnit(**record["stimulus_unit"])

    table = tree["observed_data"].to_dataset().rename({task.count: "n_yes"})
    table["n_trials"] = tree["constant_data"].to_dataset()["n_trials"]
    columns: Record = {key: table[key].values for key in ("s1", "s2", *task.counts)}
    # The name of each row. The rows of a subject are together; the first subject begins at row 0.
    names = table["subject"].values
    rows_by_subject = np.split(np.arange(len(names)), run_starts(names)[1:])
    subjects = []
    for rows in rows_by_subject:
        name = names[rows[0]]
        counts = {key: column[rows] for key, column in columns.items()}
        level, scales = record["units"][name]
        subjects.append(
            Subject(
                name,
                **counts,
                task=task,
                unit=stimulus_unit,
                condition=level,
                shared_scales=scales and StimulusScales(*scales),  # None without shared scales
            )
        )

    fields = record["conditions"]
    if fields is None:
        conditions = None
    else:  # JSON has made a list of the levels
        conditions = Conditions(**{**fields, "levels": tuple(fields["levels"])})
    return Study(
        tuple(subjects),
        source=record["source"],
        synthetic=record["synthetic"],
        notes=tuple(record["notes"]),
        changes=tuple(record["changes"]),
        conditions=conditions,
    )


# --- Files ----------------------------------------------------------------------------------------


def save_tree(tree: xr.DataTree, path: StrPath, *, overwrite: bool = False) -> Path:
    """Write a NetCDF file, whole or not at all. The draws of one subject at a time are in memory.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced, is a folder, or cannot be written.
    """
    groups = tree.to_dict()
    large = {}  # the draws of subjects by their names in the file, such as /posterior/mu1
    encoding: Record = {}
    for path_of_group, group in tree.to_dict().items():
        encoding[path_of_group] = {}
        for name, variable in group.variables.items():
            if variable.dims == BY_SUBJECT:
                large[f"{path_of_group}/{name}"] = group[name]
                del groups[path_of_group][name]
            # HDF5 has checksums of arrays of numbers, not of texts, empty arrays, single values.
            elif variable.dtype.kind not in "UOT" and variable.size > 0 and variable.ndim > 0:
                encoding[path_of_group][name] = {"fletcher32": True}

    content = io.BytesIO()
    with without_cluster():  # xarray would ask a cluster for a lock
        xr.DataTree.from_dict(groups).to_netcdf(content, engine="h5netcdf", encoding=encoding)
    with whole_file(path, overwrite=overwrite) as target:
        target.write_bytes(content.getvalue())
        with _DrawsFile(target, "r+") as file, h5netcdf.File(file, "r+") as netcdf:
            for name, draws in large.items():
                *shape, n_subjects = draws.shape
                variable = netcdf.create_variable(
                    name, BY_SUBJECT, draws.dtype, chunks=(*shape, 1), fletcher32=True
                )
                variable.attrs.update(draws.attrs)
                for i in range(n_subjects):
                    variable[..., i] = draws[..., i].values
    return Path(path)


class _DrawsFile(io.FileIO):
    """A file to which HDF5 writes draws. If the disk cannot take all, closing it is an error.

    HDF5 would end the process at an error such as a full disk. So HDF5 does not learn of the error.
    """

    error: OSError | None = None

    def write(self, content: memoryview) -> int:  # type: ignore[override]
        """Write all bytes. If the disk takes only a part of them, the second call fails."""
        try:
            super().write(content[super().write(content) :])
        except OSError as error:
            self.error = error
        return len(content)

    def truncate(self, size: int | None = None) -> int:
        """Set the size of the file, if all could be written."""
        if self.error is None:
            super().truncate(size)
        return self.tell()

    def close(self) -> None:
        """Close the file, and raise the error of writing."""
        super().close()
        if self.error is not None:
            raise self.error


def read_tree(path: StrPath) -> xr.DataTree:
    """Read a file of draws.

    Raises
    ------
    InputError
        If the file is missing or damaged, or has another format.
    """
    path = Path(path)
    # os.path, because the methods of a Path raise an error for a name that is too long.
    if not os.path.isfile(path):
        problem = "not a file" if os.path.exists(path) else "no such file"
        raise InputError(
            f"{format_path(path)}: {problem}; allowed: a posterior.nc or population.nc written by "
            "bayes-toe"
        )

    with reading(path):
        names = _group_names(path)
        tree = xr.DataTree.from_dict({f"/{name}": _read_group(path, name) for name in names})
        tree.attrs |= _read_group(path, name=None).attrs  # the attributes of the root
        if tree.attrs.get("format") != FORMAT:
            raise InputError("not a file of draws of this version")
    return tree


@contextmanager
def reading(path: StrPath) -> Iterator[None]:
    """Turn any error of the block, which reads a file of draws, into an error of a single line."""
    name = format_path(Path(path))
    try:
        yield
    except InputError as error:
        raise InputError(f"{name}: {error}; {_RUN_AGAIN}") from error
    except Exception as error:  # The libraries raise nearly anything for a damaged file.
        if "filter" in str(error) or "checksum" in str(error):  # the words of HDF5
            problem = "damaged: its numbers do not fit their checksums"
        else:
            problem = "not a file of draws that can be read"
        raise InputError(f"{name}: {problem}; {_RUN_AGAIN}") from error


def _group_names(path: Path) -> list[str]:
    """The groups of a file that a tree may have, by name.

    A link is refused, because it may lead to another file.
    """
    with h5py.File(path) as file:
        # The visit ends at the first name that the function returns, here that of a link.
        link_name = file.visititems_links(
            lambda name, link: None if isinstance(link, h5py.HardLink) else name
        )
        if link_name is not None:
            raise InputError(f"{quoted(link_name)} is a link")
        return [name for name in _GROUPS if name in file]


def _read_group(path: Path, name: str | None) -> xr.Dataset:
    """A group of a file, or its root for None, in memory.

    A damaged file may declare so many numbers that memory cannot hold them. Such a file is refused.
    """
    # By default, xarray makes dates of numbers with a unit such as 'days since 2000-01-01', and
    # warns of dimensions without a name. A file of another program may have both.
    options: Record = {"decode_times": False, "phony_dims": "access"}
    with xr.open_dataset(path, group=name, engine="h5netcdf", **options) as group:
        # `save_tree` does not compress, so that a file is larger than the arrays in it.
        if group.nbytes > path.stat().st_size:
            raise InputError("it declares more numbers than it has")
        group.load()
    # Some versions of the libraries read texts into arrays of strings. These become arrays of
    # objects, as a tree has them before it is saved.
    texts = {}
    for key, variable in group.variables.items():
        if variable.dtype.kind in "TU":
            texts[key] = variable.astype(object)
    return group.assign(texts)


def require_numbers(group: xr.Dataset, dims: Mapping[str, Texts]) -> None:
    """Refuse a group that lacks a variable over its dimensions, or has a number that is no draw.

    `dims` has the dimensions of each variable.
    """
    for name, expected in dims.items():
        if name not in group or group[name].dims != expected:
            raise InputError(f"no {name} over ({', '.join(expected)})")
        # Squares and products of numbers above the limit are infinite. NaN is refused too, because
        # it is not below the limit.
        if not (np.abs(group[name].values) < 1e100).all():
            raise InputError(f"draws of {name} are no numbers")


def as_arviz(tree: xr.DataTree) -> Any:
    """A tree as the ArviZ that is installed has it: InferenceData in 0.x, a DataTree in 1.x."""
    import arviz  # as slow to load as everything else together

    if hasattr(arviz, "from_datatree"):
        return arviz.from_datatree(tree)
    return tree
