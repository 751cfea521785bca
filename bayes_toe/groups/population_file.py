"""population.nc: the draws of a group with its counts and settings, as a NetCDF file by xarray."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from bayes_toe.arrays import Record, StrPath
from bayes_toe.data.conditions import Conditions
from bayes_toe.data.messages import format_path
from bayes_toe.data.stimulus_unit import StimulusUnit
from bayes_toe.data.study import Study, Subject, with_shared_scales
from bayes_toe.data.tasks import task_of
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError
from bayes_toe.groups.group_sampler import GroupDraws
from bayes_toe.groups.regressors import Regressor, Regressors
from bayes_toe.inference.draws_file import as_netcdf, require_no_links
from bayes_toe.libraries import library_versions

_READABLE = "allowed: a population.nc written by bayes-toe"
_MARK = "group_record"
_DRAWS = ("mean", "sd", "effect", "subjects")


def save_group(
    path: StrPath,
    study: Study,
    regressors: Regressors,
    draws: GroupDraws,
    record: Mapping[str, Any],
    *,
    coefficients: Sequence[str],
    unshared: Sequence[str],
    overwrite: bool = False,
) -> Path:
    """Write the file, whole or not at all.

    Parameters
    ----------
    path : str or Path
    study, regressors, draws
        What was analysed, and its draws.
    record : mapping
        Settings, as JSON has them.
    coefficients, unshared : sequence of str
        Names of the parameters that have a mean and an sd, and of those that only subjects have.
    overwrite : bool
        Whether a file that exists is replaced.
    """
    counts = xr.Dataset()
    for key in ("s1", "s2", "n_yes", "n_trials"):
        counts[key] = ("count", np.concatenate([getattr(unit, key) for unit in study]))
    counts["unit"] = (("count",), np.repeat(np.arange(len(study)), [u.n_pairs for u in study]))
    x = {"x": (("subject", "covariate"), regressors.x)}
    groups = {
        "/posterior": _posterior(regressors, draws, coefficients, unshared),
        "/constant_data": xr.Dataset(x, {"subject": list(regressors.subjects)}),
        "/observed_data": counts,
    }
    tree = xr.DataTree.from_dict(groups)
    whole_record = {
        **record,
        "study": _study_record(study),
        "regressors": _regressors_record(regressors),
        "n_divergent": draws.n_divergent,
    }
    tree.attrs[_MARK] = json.dumps(whole_record)
    tree.attrs["inference_library"] = "bayes_toe"
    tree.attrs["inference_library_version"] = library_versions("xarray")["bayes_toe"]
    target = whole_file(path, overwrite=overwrite)
    with target as temporary, as_netcdf(tree) as content, temporary.open("wb") as file:
        file.write(content)
    return Path(path)


def _posterior(
    regressors: Regressors,
    draws: GroupDraws,
    coefficients: Sequence[str],
    unshared: Sequence[str],
) -> xr.Dataset:
    """The draws, with names on every axis."""
    dims = ("chain", "draw")
    variables = {
        "mean": ((*dims, "coefficient"), draws.mean),
        "sd": ((*dims, "coefficient"), draws.sd),
        "effect": ((*dims, "covariate", "coefficient"), draws.effects),
        "subjects": ((*dims, "subject", "parameter"), draws.subjects),
    }
    names = {
        "coefficient": list(coefficients),
        "parameter": [*coefficients, *unshared],
        "covariate": [column.label for column in regressors.columns],
        "subject": list(regressors.subjects),
    }
    return xr.Dataset(variables, names)


def _regressors_record(regressors: Regressors) -> Record:
    """The covariates without their values, for JSON."""
    return {
        "columns": [column._asdict() for column in regressors.columns],
        "left_out": dict(regressors.left_out),
        "notes": list(regressors.notes),
    }


def _study_record(study: Study) -> Record:
    """A study without its counts, as JSON has it."""
    conditions = None if study.conditions is None else asdict(study.conditions)
    return {
        "units": [(unit.name, unit.condition) for unit in study],
        "task": study.task.name,
        "stimulus_unit": asdict(study.unit),
        "source": study.source,
        "synthetic": study.synthetic,
        "notes": list(study.notes),
        "changes": list(study.changes),
        "conditions": conditions,
    }


def is_group_file(path: StrPath) -> bool:
    """Whether the file is a population.nc."""
    # A damaged file makes the library raise other errors too.
    with suppress(OSError, RuntimeError, LookupError, ValueError), h5py.File(path) as file:
        return _MARK in file.attrs
    return False


def load_group(path: StrPath) -> tuple[Study, Regressors, GroupDraws, Record]:
    """Read a file of :func:`save_group`; refuse other and damaged files."""
    name = format_path(Path(path))
    if not Path(path).is_file():
        problem = "not a file" if Path(path).exists() else "no such file"
        raise InputError(f"{name}: {problem}; {_READABLE}")
    try:
        require_no_links(Path(path))
        with closing(xr.open_datatree(path, engine="h5netcdf", decode_times=False)) as tree:
            return _read(tree.load())
    except Exception as error:  # a damaged file makes the libraries raise nearly anything
        reason = f" ({error})" if isinstance(error, InputError) else ""
        problem = f"not a population that can be read{reason}"
        raise InputError(f"{name}: {problem}; {_READABLE}") from error


def _read(tree: xr.DataTree) -> tuple[Study, Regressors, GroupDraws, Record]:
    record = json.loads(tree.attrs[_MARK])
    drawn = tree["posterior"].to_dataset()
    mean, sd, effects, subjects = (drawn[name].values for name in _DRAWS)
    draws = GroupDraws(mean, sd, effects, subjects, record["n_divergent"])
    study = _study(record["study"], tree["observed_data"].to_dataset())
    of_subjects = tree["constant_data"].to_dataset()
    columns = tuple(Regressor(**column) for column in record["regressors"]["columns"])
    regressors = Regressors(
        tuple(map(str, of_subjects["subject"].values)),
        of_subjects["x"].values,
        columns,
        record["regressors"]["left_out"],
        tuple(record["regressors"]["notes"]),
    )
    is_number = all(np.isfinite(drawn[name]).all() for name in _DRAWS)
    if not is_number or (sd < 0.0).any():
        raise InputError("its draws are no numbers, or a standard deviation is below 0")
    # Sizes with the same name are the same in all arrays of the draws.
    expected = (drawn.sizes["subject"], len(columns))
    is_column = regressors.x.shape == expected and drawn.sizes["covariate"] == len(columns)
    if not (is_column and np.isfinite(regressors.x).all()):
        raise InputError("its covariates are not those of its draws")
    return study, regressors, draws, record


def _study(record: Mapping[str, Any], counts: xr.Dataset) -> Study:
    """The study from its record and its counts."""
    task = task_of(record["task"])
    stimulus_unit = StimulusUnit(**record.get("stimulus_unit", {}))
    units = []
    for i, (name, condition) in enumerate(record["units"]):
        unit_counts = counts.isel(count=np.flatnonzero(counts["unit"].values == i))
        columns = [unit_counts[key].values for key in ("s1", "s2", "n_yes", "n_trials")]
        subject = Subject(name, *columns, task=task, unit=stimulus_unit, condition=condition)
        units.append(subject)
    conditions = None
    if record["conditions"] is not None:
        parts = record["conditions"]
        conditions = Conditions(parts["name"], tuple(parts["levels"]), parts["numeric"])
        units = list(with_shared_scales(units))
    return Study(
        tuple(units),
        record["source"],
        record["synthetic"],
        tuple(record["notes"]),
        changes=tuple(record["changes"]),
        conditions=conditions,
    )
