"""The one format of draws: a tree of xarray that ArviZ opens, with its study, as a NetCDF file.

`assembled_tree` makes the tree of subjects, :mod:`bayes_toe.groups.population_file` that of a
group. `save_tree` writes a tree, `read_tree` reads one, and `stored_study` makes its study.

A tree holds the draws in the group posterior, and the counts in long form over `obs`, one entry per
subject and pair. What is known of each subject is in sample_stats. Everything else follows from
these; see :class:`bayes_toe.inference.draws.Draws`. Numbers have checksums of HDF5 (Fletcher-32).
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from bayes_toe.arrays import FloatArray, Record, StrPath
from bayes_toe.cluster import without_cluster
from bayes_toe.data.conditions import Conditions, StimulusScales
from bayes_toe.data.messages import format_path
from bayes_toe.data.stimulus_unit import StimulusUnit
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import task_of
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError
from bayes_toe.inference.subject import Settings, SubjectDraws
from bayes_toe.libraries import library_versions
from bayes_toe.model.models import describe_prior, stored_model

#: The format of the files; a file of another one is refused.
FORMAT = 2
#: The groups that a file may have; `covariates` is that of a population.
COVARIATES = "covariates"
_GROUPS = ("posterior", "sample_stats", "observed_data", "constant_data", COVARIATES)
#: Bytes of draws in one NetCDF file, which is written from memory.
LARGEST = 2**31
_READABLE = "allowed: a posterior.nc or population.nc written by bayes-toe"
BY_SUBJECT = ("chain", "draw", "subject")


# --- Trees ----------------------------------------------------------------------------------------


def assembled_tree(
    study: Study,
    subject_draws: Iterable[SubjectDraws],
    settings: Settings,
    failed: Mapping[str, str],
    not_interpreted: Mapping[str, str],
) -> xr.DataTree:
    """The tree of the draws of all subjects, each of which is read once.

    `failed` and `not_interpreted` have the reason for each subject that they name.
    """
    values: dict[str, FloatArray] = {}
    without_draws = []
    for i, draws in enumerate(subject_draws):
        arrays = {**draws.quantities, "lp": draws.log_posterior}
        if not values:
            size = draws.log_posterior.shape
            values = {name: np.empty((*size, len(study))) for name in arrays}
        for name, drawn in arrays.items():
            values[name][:, :, i] = drawn
        without_draws.append(replace(draws, quantities={}, log_posterior=np.empty(0)))

    posterior = _coordinates(study, size, settings.sampler.walkers)
    for name, unit in without_draws[0].units.items():
        posterior[name] = (BY_SUBJECT, values[name], {"units": unit})
    coordinates = ", ".join(without_draws[0].coordinates[:6])
    density = f"log density of the unconstrained coordinates ({coordinates}), unnormalised"
    statistics = _statistics(study, size, without_draws)
    statistics["lp"] = (BY_SUBJECT, values["lp"], {"description": density})
    groups = {
        "/posterior": posterior,
        "/sample_stats": statistics,
        **counts_of(study),
    }
    tree = xr.DataTree.from_dict(groups)
    tree.attrs.update(_attributes(study, settings))
    tree.attrs["not_interpreted"] = json.dumps(dict(not_interpreted))
    if failed:
        tree.attrs["failed"] = json.dumps(dict(failed))
    return tree


def _coordinates(study: Study, size: tuple[int, ...], walkers: int) -> xr.Dataset:
    n_chains, n_draws = size
    return xr.Dataset(
        coords={
            "chain": np.arange(n_chains),
            "draw": np.arange(n_draws),
            "subject": np.array(study.names, object),
            "walker": ("draw", np.repeat(np.arange(walkers), n_draws // walkers)),
        }
    )


def _statistics(
    study: Study, size: tuple[int, ...], subject_draws: Sequence[SubjectDraws]
) -> xr.Dataset:
    """Statistics of the draws of every subject."""
    types: dict[str, type] = {"converged": np.int8, "shortfall": object, "imprecise": object}
    table = _coordinates(study, size, 1).drop_vars("walker")
    rates = np.stack([draws.acceptance for draws in subject_draws], axis=-1)
    table["acceptance_rate"] = (("chain", "subject"), rates)
    for name in subject_draws[0].statistics:
        column = [draws.statistics[name] for draws in subject_draws]
        table[name] = ("subject", np.array(column, types.get(name)))
    return table


def counts_of(study: Study) -> dict[str, xr.Dataset]:
    """The groups that hold the counts of a study."""
    counts = _by_pair(study, "n_yes").rename(n_yes=study.task.count)
    return {"/observed_data": counts, "/constant_data": _by_pair(study, "n_trials")}


def _by_pair(study: Study, count: str) -> xr.Dataset:
    """One count per subject and pair, with the pair as coordinates."""
    keys = ["s1", "s2"]
    n_pairs = [subject.n_pairs for subject in study]
    owner = np.repeat(np.array(study.names, object), n_pairs)
    table = xr.Dataset(coords={"obs": np.arange(len(owner)), "subject": ("obs", owner)})
    for key in (*keys, count):
        table[key] = ("obs", np.concatenate([getattr(subject, key) for subject in study]))
    return table.set_coords(keys)


def _attributes(study: Study, settings: Settings) -> Record:
    model = stored_model(settings.model, study.task)
    return {
        **attributes_of(study),
        "model": settings.model,
        "about_model": model.about,
        "seed": settings.seed,
        "prior": describe_prior(model, settings.prior, study.task),
        "settings": json.dumps(settings.as_dict()),
        "inference_library": "emcee",
        "inference_library_version": library_versions()["emcee"],
    }


def attributes_of(study: Study) -> Record:
    """The format, the versions, and a study without its counts."""
    versions = library_versions("xarray") | {"python": platform.python_version()}
    return {
        "format": FORMAT,
        "task": study.task.name,
        "source": study.source,
        "synthetic": int(study.synthetic),
        "notes": "\n".join(study.notes),
        "changes": "\n".join(study.changes),
        "unit": study.unit.name,
        "unit_log_reference": study.unit.log_reference,
        **_condition_attributes(study),
        "versions": json.dumps(versions),
    }


def _condition_attributes(study: Study) -> dict[str, str]:
    """Conditions and units as JSON; nothing for a study without conditions."""
    if study.conditions is None:
        return {}
    units = {unit.name: [unit.condition, unit.shared_scales] for unit in study}
    return {"conditions": json.dumps({**asdict(study.conditions), "units": units})}


def stored_study(tree: xr.DataTree) -> Study:
    """The study in a tree: the counts of all who have draws, with the notes of reading them."""
    attributes = tree.attrs
    task = task_of(attributes["task"])
    unit = StimulusUnit(attributes["unit"], float(attributes["unit_log_reference"]))
    conditions, by_unit = _stored_conditions(attributes)
    observed = tree["observed_data"].to_dataset()
    constant = tree["constant_data"].to_dataset()
    names = observed["subject"].values.astype(str)
    columns = [observed[key].values for key in ("s1", "s2", task.count)]
    columns.append(constant["n_trials"].values)
    starts = np.flatnonzero(names[1:] != names[:-1]) + 1
    subjects = []
    for rows in np.split(np.arange(len(names)), starts):
        name = str(names[rows[0]])
        counts = [column[rows] for column in columns]
        subjects.append(Subject(name, *counts, task=task, unit=unit, **by_unit.get(name, {})))
    return Study(
        tuple(subjects),
        attributes["source"],
        bool(attributes["synthetic"]),
        tuple(filter(None, attributes["notes"].split("\n"))),
        changes=tuple(filter(None, attributes["changes"].split("\n"))),
        conditions=conditions,
    )


def _stored_conditions(
    attributes: Mapping[Any, Any],
) -> tuple[Conditions | None, dict[str, Record]]:
    """The conditions, and for each unit what a Subject has besides its counts."""
    if "conditions" not in attributes:
        return None, {}
    record = json.loads(attributes["conditions"])
    units = {}
    for name, (level, scales) in record["units"].items():
        units[name] = {"condition": level, "shared_scales": scales and StimulusScales(*scales)}
    levels = tuple(record["levels"])
    return Conditions(record["name"], levels, record["numeric"]), units


# --- Files ----------------------------------------------------------------------------------------


def save_tree(tree: xr.DataTree, path: StrPath, *, overwrite: bool = False) -> Path:
    """Write a NetCDF file, whole or not at all.

    In memory first, because HDF5 ends the process where the disk that it writes to is full.
    """
    encoding: dict[str, dict[str, Record]] = {}
    for group, node in tree.children.items():
        settings = encoding[f"/{group}"] = {}
        for name, variable in node.to_dataset().variables.items():
            if variable.dtype.kind not in "UOT" and variable.size > 0 and variable.ndim > 0:
                settings[str(name)] = {"fletcher32": True}
    with whole_file(path, overwrite=overwrite) as target:
        with without_cluster():
            content = tree.to_netcdf(engine="h5netcdf", encoding=encoding)
        with content, target.open("wb") as file:
            file.write(content)
    return Path(path)


def require_fitting(n_bytes: int) -> None:
    """Refuse, before the work, more draws than fit into one NetCDF file."""
    if n_bytes > LARGEST:
        raise InputError(
            f"about {n_bytes / 1e9:.3g} GB of draws, allowed in a NetCDF file: "
            f"{LARGEST / 1e9:.3g} GB; fewer --draws, or files of some subjects each"
        )


def read_tree(path: StrPath) -> xr.DataTree:
    """Read a file of draws.

    Raises
    ------
    InputError
        If the file is missing or damaged, has another format, or has draws that are no numbers.
    """
    path = Path(path)
    # A Path refuses names that are too long with an error of its own.
    if not os.path.isfile(path):
        problem = "not a file" if os.path.exists(path) else "no such file"
        raise InputError(f"{format_path(path)}: {problem}; {_READABLE}")
    with reading(path):
        # Only these groups: a link to a group around it has no end.
        with h5py.File(path) as file:
            names = [name for name in _GROUPS if name in file]
        tree = xr.DataTree.from_dict({f"/{name}": _read_group(path, name) for name in names})
        tree.attrs.update(_read_group(path, None).attrs)
    if tree.attrs.get("format") != FORMAT:
        raise InputError(
            f"{format_path(path)}: its format is not that of this version; run `bayes-toe sample` "
            "again, or `bayes-toe population` for a group"
        )
    with reading(path):
        _require_numbers(tree)
    return tree


@contextmanager
def reading(path: StrPath) -> Iterator[None]:
    """Turn errors of reading a file of draws into one line."""
    problem = "not a file of draws that can be read"
    try:
        yield
    except InputError as error:
        raise InputError(f"{format_path(Path(path))}: {error}; {_READABLE}") from error
    except Exception as error:  # The libraries raise nearly anything for a damaged file.
        if "filter" in str(error) or "checksum" in str(error):  # the words of HDF5
            problem = "damaged: its numbers do not fit their checksums"
        raise InputError(f"{format_path(Path(path))}: {problem}; {_READABLE}") from error


def _read_group(path: Path, name: str | None) -> xr.Dataset:
    """A group, or the root of the file, with texts of one type."""
    # No units are times.
    group = xr.load_dataset(path, group=name, engine="h5netcdf", decode_times=False)
    texts = {}
    for key, variable in group.variables.items():
        if variable.dtype.kind in "TU":
            texts[key] = variable.astype(object)
    return group.assign(texts)


def _require_numbers(tree: xr.DataTree) -> None:
    """Refuse draws that are no numbers; of what a subject does not have, all are NaN."""
    draws = dict(tree["posterior"].data_vars)
    if "sample_stats" in tree.children:
        draws["lp"] = tree["sample_stats"]["lp"]
    for name, variable in draws.items():
        is_number = np.isfinite(variable.values).all(axis=(0, 1))
        is_missing = np.isnan(variable.values).all(axis=(0, 1)) & (name != "lp")
        if not (is_number | is_missing).all():
            raise InputError(f"draws of {name!r} are no numbers")


def as_arviz(tree: xr.DataTree) -> Any:
    """A tree as the ArviZ that is installed has it: InferenceData in 0.x, a DataTree in 1.x."""
    import arviz  # as slow to load as everything else together

    convert = getattr(arviz, "from_datatree", None)
    return tree if convert is None else convert(tree)
