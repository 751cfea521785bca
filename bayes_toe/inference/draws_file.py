"""A study's draws as one tree of xarray, and its NetCDF file.

What is kept: the draws of natural parameters and their log density (chain, draw, subject), what is known of each subject, and the counts,
in long form over `obs` (one entry per subject and pair). Everything else follows
from these; see :class:`bayes_toe.inference.draws.Draws`.
Draws of one subject are one chunk of each variable, with a checksum of HDF5, Fletcher-32.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bayes_toe.cluster import aside
from bayes_toe.data.conditions import Conditions, Stimuli
from bayes_toe.data.messages import quoted, shown
from bayes_toe.data.study import Study
from bayes_toe.data.tasks import SAME_DIFFERENT, task_counted
from bayes_toe.data.whole_files import require_settled
from bayes_toe.errors import InputError
from bayes_toe.inference.subject import Settings, SubjectDraws
from bayes_toe.model.models import describe_prior, stored_model
from bayes_toe.model.paper_model import PaperModel
from bayes_toe.version import library_versions

ALLOWED = "allowed: a posterior.nc written by bayes-toe"
AT_ONCE = (
    2**28
)  # bytes of draws that are put together, or read, in memory; of more each subject's when they are asked for
LARGEST = 2**31  # bytes of draws in one NetCDF file, which is written from memory
BY_SUBJECT = ("chain", "draw", "subject")
_OBSERVED: dict[str, tuple[str, ...]] = {"subject": ("obs",), "s1": ("obs",), "s2": ("obs",)}
#: Groups, and of each the variables that it must have with their dimensions.
_LAYOUT: dict[str, dict[str, tuple[str, ...]]] = {
    "posterior": {"chain": ("chain",), "draw": ("draw",), "subject": ("subject",)},
    "sample_stats": {
        **dict.fromkeys(
            ("subject", "converged", "shortfall", "min_ess", "max_r_hat"), ("subject",)
        ),
        "lp": BY_SUBJECT,
    },
    "observed_data": {**_OBSERVED},  # and the count of the task
    "constant_data": {**_OBSERVED, "n_trials": ("obs",)},
}
_ATTRIBUTES: dict[str, Any] = {
    "model": str,
    "settings": str,
    "seed": int | np.integer,
    "synthetic": int | np.integer,
}


# --- From the draws of subjects to a tree ---------------------------------------------------------


def assembled_tree(
    study: Study,
    found: Iterable[SubjectDraws],
    settings: Settings,
    failed: Mapping[str, str],
) -> xr.DataTree:
    """The tree of all subjects' draws."""
    heads = [_Head(one) for one in found]
    names = dict.fromkeys(name for head in heads for name in head.units)
    size = (*heads[0].size, len(study))
    values = {name: np.full(size, np.nan) for name in (*names, "lp")}
    units = {name: unit for head in reversed(heads) for name, unit in head.units.items()}
    density = f"log density of the unconstrained coordinates ({', '.join(heads[0].coordinates[:6])}), unnormalised"
    tree = xr.DataTree.from_dict(
        {
            "/posterior": _coordinates(study, heads[0].size, settings.sampler.walkers).assign(
                {name: (BY_SUBJECT, values[name], {"units": units[name]}) for name in names}
            ),
            "/sample_stats": _statistics(study, heads).assign(
                lp=(BY_SUBJECT, values["lp"], {"description": density})
            ),
            "/observed_data": _long(study, "n_yes").rename(n_yes=study.task.count),
            "/constant_data": _long(study, "n_trials"),
        }
    )
    tree.attrs.update(
        _attributes(study, settings) | ({"failed": json.dumps(dict(failed))} if failed else {})
    )
    _fill(values, found)
    return tree


def _fill(values: Mapping[str, Any], found: Iterable[SubjectDraws]) -> None:
    """Put draws in their places; a quantity that a subject does not have, such as the frequency of a pair, stays NaN."""
    for i, one in enumerate(found):
        for name, drawn in {**one.quantities, "lp": one.log_posterior}.items():
            values[name][:, :, i] = drawn


class _Head:
    """What is small of the draws of a subject."""

    def __init__(self, one: SubjectDraws) -> None:
        self.units, self.coordinates, self.size = (
            one.units,
            one.coordinates,
            one.log_posterior.shape,
        )
        self.acceptance, self.statistics = one.acceptance, one.statistics


def _coordinates(study: Study, size: tuple[int, ...], walkers: int) -> xr.Dataset:
    chains, draws = size
    coords = {
        "chain": np.arange(chains),
        "draw": np.arange(draws),
        "subject": np.array(study.names, object),
    }
    return xr.Dataset(
        coords=coords | {"walker": ("draw", np.repeat(np.arange(walkers), draws // walkers))}
    )


def _statistics(study: Study, heads: list[_Head]) -> xr.Dataset:
    """Statistics that are known of every subject."""
    kinds: dict[str, type] = {"converged": np.int8, "shortfall": object, "imprecise": object}
    known = [name for name in heads[0].statistics if all(name in head.statistics for head in heads)]
    rates = np.stack([head.acceptance for head in heads], axis=-1)
    columns: dict[str, Any] = {"acceptance_rate": (("chain", "subject"), rates)}
    columns |= {
        name: ("subject", np.array([head.statistics[name] for head in heads], kinds.get(name)))
        for name in known
    }
    return _coordinates(study, heads[0].size, 1).drop_vars("walker").assign(columns)


def _long(study: Study, key: str) -> xr.Dataset:
    """One count per subject and pair, with the pair as coordinates."""
    columns = {
        name: np.concatenate([getattr(s, name) for s in study])
        for name in ("s1", "s2", *(["isi"] if study.intervals else []), key)
    }
    owner = np.repeat(np.array(study.names, object), [s.n_pairs for s in study])
    coords = {"obs": np.arange(len(owner)), "subject": ("obs", owner)}
    return xr.Dataset(
        {name: ("obs", values) for name, values in columns.items()}, coords
    ).set_coords([*columns][:-1])


def _attributes(study: Study, settings: Settings) -> dict[str, Any]:
    record = stored_model(settings.model, study.task)
    about = record.about
    if study.intervals and isinstance(record, PaperModel):
        about += f"; intervals isi in seconds: {record.about_intervals}"
    versions = library_versions("xarray") | {"python": platform.python_version()}
    return {
        "source": study.source,
        "synthetic": int(study.synthetic),
        "notes": "\n".join(study.notes),
        "changes": "\n".join(study.changes),
        **_condition_attributes(study),
        "model": settings.model,
        "about_model": about,
        "seed": settings.seed,
        "prior": describe_prior(record, settings.prior, study.task),
        "settings": json.dumps(settings.as_dict()),
        "versions": json.dumps(versions),
        "inference_library": "emcee",
        "inference_library_version": versions["emcee"],
    }


def _condition_attributes(study: Study) -> dict[str, str]:
    """Conditions and units as JSON; nothing for a study without conditions."""
    if study.conditions is None:
        return {}
    units = {unit.name: [unit.condition, unit.felt] for unit in study}
    return {"conditions": json.dumps({**asdict(study.conditions), "units": units})}


def stored_conditions(tree: xr.DataTree) -> tuple[Conditions | None, dict[str, dict[str, Any]]]:
    """The conditions in a tree, and for each unit what a Subject has besides its counts."""
    if "conditions" not in tree.attrs:
        return None, {}
    record = json.loads(tree.attrs["conditions"])
    units = {}
    for name, (level, felt) in record["units"].items():
        units[name] = {"condition": level, "felt": felt and Stimuli(*felt)}
    levels = tuple(record["levels"])
    return Conditions(record["name"], levels, record["numeric"]), units


# --- Writing --------------------------------------------------------------------------------------


def as_netcdf(tree: xr.DataTree) -> memoryview:
    """The bytes of a NetCDF file with checksums of its numbers, draws in a chunk a subject; to be released by whoever writes them.

    In memory, because HDF5 ends the process where the disk that it writes to is full.
    """
    encoding: dict[str, dict[str, dict[str, Any]]] = {}
    for group, node in tree.children.items():
        encoding[f"/{group}"] = {
            str(name): {"fletcher32": True}
            | ({"chunksizes": (*one.shape[:2], 1)} if one.dims == BY_SUBJECT else {})
            for name, one in node.to_dataset().variables.items()
            if one.dtype.kind not in "UOT" and one.ndim > 0
        }
    with aside():
        return tree.to_netcdf(engine="h5netcdf", encoding=encoding)


def require_fitting(draws: int) -> None:
    """Refuse before the work more draws, in bytes, than one NetCDF file is written from."""
    if draws > LARGEST:
        found, most = (f"{size / 1e9:.3g} GB" for size in (draws, LARGEST))
        raise InputError(
            f"about {found} of draws, allowed in a NetCDF file: {most}; fewer --draws, or files of some subjects each"
        )


def refuse_store(path: Path) -> None:
    """Refuse a folder in Zarr's format, which earlier versions wrote and read."""
    if path.suffix == ".zarr":
        raise InputError(f"{shown(path)}: Zarr stores are retired, allowed: a NetCDF file, NAME.nc")


# --- Reading --------------------------------------------------------------------------------------


def read_tree(path: str | Path) -> xr.DataTree:
    """All groups of a file of draws; draws of a large file are read when they are asked for.

    What is missing or damaged, or has another layout than draws have, is refused.
    """
    path, name = Path(path), shown(Path(path))
    refuse_store(path)
    require_settled(path)
    # A Path refuses names that are too long with an error of its own.
    if not os.path.isfile(path):
        what = "not a file" if os.path.exists(path) else "no such file"
        raise InputError(f"{name}: {what}; {ALLOWED}")
    try:
        # No units are times.
        tree = xr.open_datatree(path, decode_times=False, engine="h5netcdf")
        at_once = path.stat().st_size <= AT_ONCE
        if at_once:
            with closing(tree):  # an open tree keeps the file locked
                tree = tree.load()
        tree = tree.map_over_datasets(_with_small)
        for problem in _misfits(tree, at_once):
            raise InputError(f"{name}: {problem}; {ALLOWED}")
    except InputError:
        raise
    except (
        Exception
    ) as error:  # of a damaged file the libraries say anything, from KeyError to RuntimeError
        raise unreadable(path, error) from error
    return tree


def _with_small(group: xr.Dataset) -> xr.Dataset:
    """A group with all but its draws in memory, and texts of one type."""
    small = {name: one.load() for name, one in group.variables.items() if one.dims != BY_SUBJECT}
    return group.assign(
        {name: one.astype(object) for name, one in small.items() if one.dtype.kind in "TU"}
    )


def unreadable(path: Path, error: Exception) -> InputError:
    """What is raised where the libraries cannot read a file, or a part of it."""
    damaged = any(word in str(error) for word in ("filter", "checksum"))  # as HDF5 says it
    reason = (
        "damaged: its numbers do not fit their checksums"
        if damaged
        else "not a NetCDF file that can be read"
    )
    return InputError(f"{shown(path)}: {reason}; {ALLOWED}")


def _misfits(tree: xr.DataTree, at_once: bool) -> Iterator[str]:
    """What differs from the layout of draws; the first counts, later ones may rest on it."""
    for name, kind in _ATTRIBUTES.items():
        if not isinstance(tree.attrs.get(name), kind):
            yield f"attribute {name} is not a {'text' if kind is str else 'whole number'}"
    yield from (f"no group {group}" for group in _LAYOUT if group not in tree.children)
    groups = {group: tree[group].to_dataset() for group in _LAYOUT}
    for group, variables in _LAYOUT.items():
        found = {name: one.dims for name, one in groups[group].variables.items()}
        yield from (
            f"no variable {group}/{name} over ({', '.join(dims)})"
            for name, dims in variables.items()
            if found.get(name) != dims
        )
    yield from _odd_draws(
        {str(name): one.variable for name, one in groups["posterior"].data_vars.items()}, at_once
    )
    drawn, judged, observed, _ = ([*map(str, group["subject"].values)] for group in groups.values())
    if (
        not drawn
        or not drawn == judged == list(dict.fromkeys(observed))
        or len({*drawn}) < len(drawn)
    ):
        yield "posterior, sample_stats and observed_data are not of the same subjects"
    task = task_counted(groups["observed_data"])
    if task is None:
        yield f"no variable observed_data/{SAME_DIFFERENT.count} over (obs)"
    elif (
        not groups["observed_data"]
        .drop_vars(task.count)
        .equals(groups["constant_data"].drop_vars("n_trials"))
    ):
        yield "observed_data and constant_data are of other pairs"


def _odd_draws(drawn: Mapping[str, xr.Variable], at_once: bool) -> Iterator[str]:
    """Draws of another shape or that are no numbers; a quantity that a subject does not have is NaN in all of them."""
    for name, one in drawn.items():
        if one.dims != BY_SUBJECT or one.dtype.kind != "f":
            yield f"{quoted(name)} is not a number over ({', '.join(BY_SUBJECT)})"
        if (
            at_once
            and not (
                np.isfinite(one.values).all(axis=(0, 1)) | np.isnan(one.values).all(axis=(0, 1))
            ).all()
        ):
            yield f"draws of {quoted(name)} are no numbers"
