"""A study's draws as one tree of xarray, and its NetCDF file.

`assembled_tree` makes the tree, `as_netcdf` writes it, and `read_tree` reads and checks a file.

A file holds the draws of natural parameters and their log density (chain, draw, subject), what is
known of each subject, and the counts in long form over `obs`, one entry per subject and pair.
Everything else follows from these; see :class:`bayes_toe.inference.draws.Draws`. The draws of one
subject are one chunk of each variable, with a checksum of HDF5 (Fletcher-32).
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from bayes_toe.arrays import FloatArray, Record, StrPath
from bayes_toe.cluster import without_cluster
from bayes_toe.data.conditions import Conditions, StimulusScales
from bayes_toe.data.messages import format_path, quoted
from bayes_toe.data.stimulus_unit import StimulusUnit
from bayes_toe.data.study import Study
from bayes_toe.data.tasks import SAME_DIFFERENT, task_counted
from bayes_toe.errors import InputError
from bayes_toe.inference.subject import Settings, SubjectDraws
from bayes_toe.libraries import library_versions
from bayes_toe.model.models import describe_prior, stored_model

READABLE = "allowed: a posterior.nc written by bayes-toe"
#: Bytes of a file whose draws are read at once. Of a larger one, draws are read subject by subject.
AT_ONCE = 2**28
#: Bytes of draws in one NetCDF file, which is written from memory.
LARGEST = 2**31
BY_SUBJECT = ("chain", "draw", "subject")
_BY_PAIR = {"subject": ("obs",), "s1": ("obs",), "s2": ("obs",)}
_STATISTICS = ("subject", "converged", "shortfall", "min_ess", "max_r_hat")
#: The variables that each group must have, with their dimensions; observed_data also has a count.
_LAYOUT: dict[str, dict[str, tuple[str, ...]]] = {
    "posterior": {"chain": ("chain",), "draw": ("draw",), "subject": ("subject",)},
    "sample_stats": {**dict.fromkeys(_STATISTICS, ("subject",)), "lp": BY_SUBJECT},
    "observed_data": {**_BY_PAIR},
    "constant_data": {**_BY_PAIR, "n_trials": ("obs",)},
}
_TEXT_ATTRIBUTES = ("model", "settings")
_COUNT_ATTRIBUTES = ("seed", "synthetic")
_JSON_ATTRIBUTES = ("failed", "versions", "not_interpreted")
#: Where draws may lie: shares, standard deviations, and all other quantities.
_SHARE, _POSITIVE, _ANYWHERE = (0.0, 1.0), (0.0, 1e100), (-1e100, 1e100)
_RANGES = {
    **dict.fromkeys(("q0", "lapse_rate", "gamma"), _SHARE),
    **dict.fromkeys(("sigma_p", "sigma_l", "noise"), _POSITIVE),
}


# --- From the draws of subjects to a tree ---------------------------------------------------------


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
        "/observed_data": _by_pair(study, "n_yes").rename(n_yes=study.task.count),
        "/constant_data": _by_pair(study, "n_trials"),
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
    versions = library_versions("xarray") | {"python": platform.python_version()}
    return {
        "source": study.source,
        "synthetic": int(study.synthetic),
        "notes": "\n".join(study.notes),
        "changes": "\n".join(study.changes),
        "unit": study.unit.name,
        "unit_log_reference": study.unit.log_reference,
        **_condition_attributes(study),
        "model": settings.model,
        "about_model": model.about,
        "seed": settings.seed,
        "prior": describe_prior(model, settings.prior, study.task),
        "settings": json.dumps(settings.as_dict()),
        "versions": json.dumps(versions),
        "inference_library": "emcee",
        "inference_library_version": versions["emcee"],
    }


def _condition_attributes(study: Study) -> dict[str, str]:
    """Conditions and units as JSON; nothing for a study without conditions."""
    if study.conditions is None:
        return {}
    units = {unit.name: [unit.condition, unit.shared_scales] for unit in study}
    return {"conditions": json.dumps({**asdict(study.conditions), "units": units})}


def stored_unit(attributes: Mapping[Any, Any]) -> StimulusUnit:
    """The unit of the stimuli; an InputError if it is not allowed."""
    log_reference = float(attributes.get("unit_log_reference", 0.0))
    return StimulusUnit(str(attributes.get("unit", "")), log_reference)


def stored_conditions(tree: xr.DataTree) -> tuple[Conditions | None, dict[str, Record]]:
    """The conditions in a tree, and for each unit what a Subject has besides its counts."""
    if "conditions" not in tree.attrs:
        return None, {}
    record = json.loads(tree.attrs["conditions"])
    units = {}
    for name, (level, scales) in record["units"].items():
        units[name] = {"condition": level, "shared_scales": scales and StimulusScales(*scales)}
    levels = tuple(record["levels"])
    return Conditions(record["name"], levels, record["numeric"]), units


# --- Writing --------------------------------------------------------------------------------------


def as_netcdf(tree: xr.DataTree) -> memoryview:
    """The bytes of a NetCDF file, which the caller releases.

    In memory, because HDF5 ends the process where the disk that it writes to is full.
    """
    encoding: dict[str, dict[str, Record]] = {}
    for group, node in tree.children.items():
        settings = encoding[f"/{group}"] = {}
        for name, variable in node.to_dataset().variables.items():
            if variable.dtype.kind in "UOT" or variable.ndim == 0:
                continue
            settings[str(name)] = {"fletcher32": True}
            if variable.dims == BY_SUBJECT:
                settings[str(name)]["chunksizes"] = (*variable.shape[:2], 1)
    with without_cluster():
        return tree.to_netcdf(engine="h5netcdf", encoding=encoding)


def require_fitting(n_bytes: int) -> None:
    """Refuse, before the work, more draws than fit into one NetCDF file."""
    if n_bytes > LARGEST:
        raise InputError(
            f"about {n_bytes / 1e9:.3g} GB of draws, allowed in a NetCDF file: "
            f"{LARGEST / 1e9:.3g} GB; fewer --draws, or files of some subjects each"
        )


# --- Reading --------------------------------------------------------------------------------------


def read_tree(path: StrPath) -> xr.DataTree:
    """All groups of a file of draws; draws of a large file are read when they are used.

    Raises
    ------
    InputError
        If the file is missing or damaged, or is no file of draws.
    """
    path = Path(path)
    # A Path refuses names that are too long with an error of its own.
    if not os.path.isfile(path):
        problem = "not a file" if os.path.exists(path) else "no such file"
        raise InputError(f"{format_path(path)}: {problem}; {READABLE}")
    try:
        require_no_links(path)
        # No units are times.
        tree = xr.open_datatree(path, decode_times=False, engine="h5netcdf")
        is_read_at_once = path.stat().st_size <= AT_ONCE
        if is_read_at_once:
            with closing(tree):  # An open tree keeps the file locked.
                tree = tree.load()
        tree = tree.map_over_datasets(_with_small_in_memory)
        problem = next(_problems(tree, is_read_at_once), "")
    except InputError as error:
        raise InputError(f"{format_path(path)}: {error}; {READABLE}") from error
    except Exception as error:  # The libraries raise nearly anything for a damaged file.
        raise unreadable(path, error) from error
    if problem:
        raise InputError(f"{format_path(path)}: {problem}; {READABLE}")
    return tree


def require_no_links(path: Path) -> None:
    """Refuse a file that has anything besides groups of variables.

    A link may lead to another file or around in a circle, which reading would follow.
    """
    with h5py.File(path) as file:
        for name in file:
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                raise InputError(f"{quoted(name)} is a link")
            group = file[name]
            if not isinstance(group, h5py.Group):
                continue
            for inner in group:
                if not isinstance(group.get(inner, getlink=True), h5py.HardLink):
                    raise InputError(f"{quoted(inner)} in {quoted(name)} is a link")
                if isinstance(group[inner], h5py.Group):
                    raise InputError(f"{quoted(inner)} in {quoted(name)} is a group")


def _with_small_in_memory(group: xr.Dataset) -> xr.Dataset:
    """A group with all but its draws in memory, and texts of one type."""
    texts = {}
    for name, variable in group.variables.items():
        if variable.dims != BY_SUBJECT:
            variable.load()
            if variable.dtype.kind in "TU":
                texts[name] = variable.astype(object)
    return group.assign(texts)


def unreadable(path: Path, error: Exception) -> InputError:
    """The error for a file, or a part of it, that the libraries cannot read."""
    reason = "not a NetCDF file that can be read"
    if "filter" in str(error) or "checksum" in str(error):  # the words of HDF5
        reason = "damaged: its numbers do not fit their checksums"
    return InputError(f"{format_path(path)}: {reason}; {READABLE}")


def _problems(tree: xr.DataTree, is_read_at_once: bool) -> Iterator[str]:
    """Differences from the layout of draws; later checks may rest on earlier ones."""
    yield from _problems_of_attributes(tree.attrs)
    for group, expected in _LAYOUT.items():
        if group not in tree.children:
            yield f"no group {group}"
        variables = tree[group].to_dataset().variables
        for name, dims in expected.items():
            if name not in variables or variables[name].dims != dims:
                yield f"no variable {group}/{name} over ({', '.join(dims)})"
    statistics = tree["sample_stats"].to_dataset()
    if not np.isin(statistics["converged"], (0, 1)).all():
        yield "sample_stats/converged is neither 0 nor 1"
    if (statistics["min_ess"] < 0.0).any():
        yield "sample_stats/min_ess is below 0"
    quantities = dict(tree["posterior"].to_dataset().data_vars)
    quantities["lp"] = statistics["lp"]
    for quantity, draws in quantities.items():
        yield from _problems_of_draws(str(quantity), draws, is_read_at_once)
    yield from _problems_of_counts(tree)


def _problems_of_attributes(attributes: Mapping[Any, Any]) -> Iterator[str]:
    """Attributes that are missing, or of another kind."""
    for name in _TEXT_ATTRIBUTES:
        if not isinstance(attributes.get(name), str):
            yield f"attribute {name} is not a text"
    for name in _COUNT_ATTRIBUTES:
        value = attributes.get(name)
        if not isinstance(value, int | np.integer) or value < 0:
            yield f"attribute {name} is not a whole number"
    stored_unit(attributes)
    for name in _JSON_ATTRIBUTES:
        if not _is_json_object(attributes.get(name, "{}")):
            yield f"attribute {name} is not an object of JSON"


def _problems_of_draws(name: str, draws: xr.DataArray, is_read_at_once: bool) -> Iterator[str]:
    """Another shape, or no numbers; of a quantity that a subject does not have all are NaN."""
    if draws.dims != BY_SUBJECT or draws.dtype.kind != "f":
        yield f"{quoted(name)} is not a number over ({', '.join(BY_SUBJECT)})"
    if is_read_at_once:
        is_number = np.isfinite(draws.values).all(axis=(0, 1))
        is_missing = np.isnan(draws.values).all(axis=(0, 1)) & (name != "lp")
        if not (is_number | is_missing).all():
            yield f"draws of {quoted(name)} are no numbers"
        low, high = _RANGES.get(name, _ANYWHERE)
        values = draws.values[:, :, is_number]
        if ((values < low) | (values > high)).any():
            yield f"draws of {quoted(name)} are beyond {low:g} to {high:g}"


def _is_json_object(text: object) -> bool:
    try:
        return isinstance(text, str) and isinstance(json.loads(text), dict)
    except (ValueError, RecursionError):
        return False


def _problems_of_counts(tree: xr.DataTree) -> Iterator[str]:
    """Other subjects, another task or other pairs in one group than in another."""
    observed = tree["observed_data"].to_dataset()
    constant = tree["constant_data"].to_dataset()
    drawn_subjects = list(map(str, tree["posterior"].to_dataset()["subject"].values))
    described_subjects = list(map(str, tree["sample_stats"].to_dataset()["subject"].values))
    observed_subjects = list(dict.fromkeys(map(str, observed["subject"].values)))
    # The last list has each subject once.
    if not (drawn_subjects == described_subjects == observed_subjects != []):
        yield "posterior, sample_stats and observed_data are not of the same subjects"
    task = task_counted(observed)
    if task is None:
        yield f"no variable observed_data/{SAME_DIFFERENT.count} over (obs)"
        return
    if not observed.drop_vars(task.count).equals(constant.drop_vars("n_trials")):
        yield "observed_data and constant_data are of other pairs"
