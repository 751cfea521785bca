"""population.nc: the posterior of a group as ArviZ opens it, and everything that makes it a :class:`Population` again, to the bit.

Groups: posterior (means, scatters, effects, correlations, subjects' parameters on the group scales; quantities of subjects, of one at the
mean and of a further one); sample_stats (diagnostics of every subject's parameters); posterior_predictive (in very large groups
the quantities of subjects, of fewer draws);
constant_data (regressors, draws of each subject alone, and as JSON the study, the settings and what was not reached). Numbers have HDF5's
checksums.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import xarray as xr

from bayes_toe.arrays import IndexArray
from bayes_toe.data.conditions import Conditions, by_person, felt_together
from bayes_toe.data.messages import shown
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, Task, task_of
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError, require_kind
from bayes_toe.groups.chains import GroupChains, with_convergence
from bayes_toe.groups.differences import Differences
from bayes_toe.groups.hyperprior import GROUP_PARAMETERS, Hyperprior
from bayes_toe.groups.regressors import Regressor, Regressors
from bayes_toe.inference.diagnostics import Convergence
from bayes_toe.inference.draws import Draws, load_draws
from bayes_toe.inference.draws_file import as_netcdf
from bayes_toe.model.prior import stored_prior
from bayes_toe.version import library_versions

if TYPE_CHECKING:
    from bayes_toe.groups.population import Population

_ALLOWED = "allowed: a population.nc written by bayes-toe"
MOST_DRAWS = 1000  # of subjects' quantities where all would be too many
AFFORDABLE = 1 << 24  # values of subjects' quantities of all draws: an eighth of a gigabyte
_MOST_SAID = 1 << 14  # characters of one attribute; HDF5 has room for four times as many


def save_population(found: Population, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write the file; see :meth:`Population.save`."""
    with (
        whole_file(path, overwrite=overwrite) as target,
        as_netcdf(_tree(found)) as content,
        target.open("wb") as file,
    ):
        file.write(content)
    return Path(path)


def load(path: str | Path) -> Draws | Population:
    """Read what was saved: draws of subjects, posterior.nc, or the joint posterior of a population, population.nc.

    Raises
    ------
    InputError
        If it is missing, is damaged, or is neither.
    """
    require_kind(
        "file",
        path,
        (str, os.PathLike),
        "the path of a posterior.nc or population.nc",
    )
    of_population = False
    with suppress(OSError), h5py.File(path) as file:
        of_population = "hyperprior" in file.attrs
    return load_population(path) if of_population else load_draws(path)


def load_population(path: str | Path) -> Population:
    """Read what :meth:`Population.save` wrote; anything else, and what is damaged, is refused."""
    name = shown(Path(path))
    if not Path(path).is_file():
        raise InputError(
            f"{name}: {'not a file' if Path(path).exists() else 'no such file'}; {_ALLOWED}"
        )
    try:
        with closing(xr.open_datatree(path, engine="h5netcdf", decode_times=False)) as tree:
            return _population(tree.load())
    except (
        Exception
    ) as error:  # of a damaged file the libraries say anything, from KeyError to RuntimeError
        reason = f" ({error})" if isinstance(error, InputError) else ""
        raise InputError(
            f"{name}: not a population that can be read{reason}; {_ALLOWED}"
        ) from error


# --- Writing --------------------------------------------------------------------------------------


def _tree(found: Population) -> xr.DataTree:
    """All groups; quantities that follow from subjects' parameters are of all draws, or of some where all are too many."""
    chains, draws, subjects, _ = found.chains.eta.shape
    reported = found.posterior(found.study.names[0]).names.reported
    whole = chains * draws * subjects * len(reported) <= AFFORDABLE
    posterior = _posterior(found)
    some = np.arange(draws) if whole else spaced(chains, draws, MOST_DRAWS)
    of_subjects = [found.quantities(found.chains.eta[:, some, i]) for i in range(subjects)]
    values = {
        name: (("chain", "draw", "subject"), np.stack([one[name] for one in of_subjects], axis=-1))
        for name in reported
    }
    thinned: dict[str, xr.Dataset] = {}
    if whole:
        posterior = posterior.assign(values)
    else:
        coords = {"chain": np.arange(chains), "draw": some, "subject": list(found.study.names)}
        thinned["/posterior_predictive"] = xr.Dataset(values, coords)
    coords = {
        "subject": list(found.study.names),
        "parameter": list(found.names),
        "diagnostic": list(Convergence._fields),
    }
    judged = xr.Dataset(
        {"convergence": (("subject", "parameter", "diagnostic"), found.chains.subject_convergence)},
        coords,
    )
    groups = {"/posterior": posterior, "/sample_stats": judged, "/constant_data": _constant(found)}
    tree = xr.DataTree.from_dict(groups | thinned)
    tree.attrs.update(_attributes(found, whole))
    return tree


def spaced(chains: int, draws: int, most: int) -> IndexArray:
    """Draws of each chain, evenly spaced, at most so many in all chains, and at least four of each.

    Examples
    --------
    >>> spaced(16, 600, 1000)[:3].tolist(), len(spaced(16, 600, 1000))
    ([0, 10, 20], 60)
    """
    return np.arange(0, draws, -(-draws // max(4, most // chains)))


def _posterior(found: Population) -> xr.Dataset:
    """Draws of hyperparameters and of subjects' parameters, and what follows from the former."""
    own, dims = found.chains, ("chain", "draw")
    at_mean, further = (found.quantities(eta) for eta in (own.mean, found.new_subject()))
    data: dict[str, Any] = {
        "mean": ((*dims, "parameter"), own.mean),
        "sd": ((*dims, "parameter"), own.scatter),
        "eta": ((*dims, "subject", "parameter"), own.eta),
        "at_mean": ((*dims, "quantity"), np.stack(list(at_mean.values()), axis=-1)),
        "new_subject": ((*dims, "quantity"), np.stack(list(further.values()), axis=-1)),
    }
    coords: dict[str, Any] = {
        "chain": np.arange(len(own.mean)),
        "draw": np.arange(own.mean.shape[1]),
        "quantity": list(at_mean),
    }
    coords |= {"subject": list(found.study.names), "parameter": list(found.names)}
    if found.regressors.columns:
        data["effect"] = ((*dims, "regressor", "parameter"), own.effects)
        coords["regressor"] = [column.label for column in found.regressors.columns]
    if found.differences is not None:
        differing = found.differences.drawn
        data |= {
            "difference_mean": ((*dims, "entry"), differing.mean),
            "difference_sd": ((*dims, "entry"), differing.scatter),
        }
        data["difference"] = ((*dims, "subject", "entry"), differing.eta)
    if own.correlated:
        data |= {
            "correlation": ((*dims, "parameter", "other"), own.correlation),
            "z": ((*dims, "pair"), own.z),
        }
        coords["other"] = list(found.names)
    return xr.Dataset(data, coords)


def _constant(found: Population) -> xr.Dataset:
    """Regressors, subjects without the group, and the record that the file is read back from."""
    study, who, own, settings = found.study, found.regressors, found.chains, found.settings
    keys = ("s1", "s2", "n_yes", "n_trials", *(["isi"] if study.intervals else []))
    record = {
        "study": {
            "subjects": [
                {"name": one.name} | {key: getattr(one, key).tolist() for key in keys}
                for one in study
            ],
            "task": study.task.name,
            **{key: getattr(study, key) for key in ("source", "synthetic", "notes", "changes")},
        },
        "settings": asdict(settings),
        "names": found.names,
        "centre": found.centre,
        "regressors": {
            "columns": [one._asdict() for one in who.columns],
            "left_out": dict(who.left_out),
            "notes": who.notes,
        },
        "chains": {"divergent": own.divergent, "reason": own.reason},
        "differences": None if found.differences is None else _differing(found.differences, keys),
        "left_out": dict(found.left_out),
        "rough": found.rough,
    }
    data: dict[str, Any] = {
        "alone": (("alone_draw", "subject", "parameter"), found.unpooled),
        "record": ((), json.dumps(record)),
    }
    coords = {"subject": list(study.names), "parameter": list(found.names)}
    if who.columns:
        data["x"] = (("subject", "regressor"), who.x)
        coords["regressor"] = [column.label for column in who.columns]
    return xr.Dataset(data, coords)


def _differing(found: Differences, keys: Sequence[str]) -> dict[str, Any]:
    """Conditions, what differs, and the answers of every subject in each condition."""
    units = [one for own in found.units.values() for one in own]
    counts = [
        {"name": one.name, "condition": one.condition}
        | {key: getattr(one, key).tolist() for key in keys}
        for one in units
    ]
    judged = found.drawn.subject_convergence.tolist()
    return {
        "conditions": asdict(found.conditions),
        "names": found.names,
        "columns": found.columns,
        "units": counts,
        "judged": judged,
    }


def _attributes(found: Population, whole: bool) -> dict[str, Any]:
    settings, study = found.settings, found.study
    versions = library_versions("xarray") | {"python": platform.python_version()}
    return {
        "source": study.source,
        "synthetic": int(study.synthetic),
        "notes": _said(study.notes),
        "changes": _said(study.changes),
        "model": settings.model,
        "seed": settings.seed,
        "scatter": settings.scatter,
        "correlations": int(settings.correlations),
        "prior": found.model.describe(settings.prior),
        "hyperprior": "\n".join(
            settings.hyperprior.describe(found.names, correlations=settings.correlations)
        ),
        "settings": json.dumps(
            {
                "draws": settings.draws,
                "prior": asdict(settings.prior),
                "hyperprior": settings.hyperprior.as_dict(),
            }
        ),
        "scales": json.dumps({name: GROUP_PARAMETERS[name].label for name in found.names}),
        "centre": found.centre,
        "regressors": _said(column.about for column in found.regressors.columns),
        "left_out": _said(f"{name}: {reason}" for name, reason in found.left_out.items()),
        "converged": int(found.converged),
        "problems": _said(found.problems),
        "thinned": ""
        if whole
        else "quantities of subjects are those of the draws of posterior_predictive; eta has all",
        "versions": json.dumps(versions),
        "inference_library": "bayes_toe",
        "inference_library_version": versions["bayes_toe"],
    }


def _said(lines: Iterable[str]) -> str:
    """Lines, as many of them as an attribute has room for."""
    text = "\n".join(lines)
    return text if len(text) <= _MOST_SAID else text[:_MOST_SAID] + " ..."


# --- Reading --------------------------------------------------------------------------------------


def _population(tree: xr.DataTree) -> Population:
    from bayes_toe.groups.population import GroupSettings, Population  # which can save itself

    drawn, constant = tree["posterior"].to_dataset(), tree["constant_data"].to_dataset()
    record = json.loads(str(constant["record"].values))
    study, who, settings, names = (
        record["study"],
        record["regressors"],
        record["settings"],
        tuple(record["names"]),
    )
    task = task_of(study.pop("task", SAME_DIFFERENT))
    counts = (
        {"n_yes" if key == SAME_DIFFERENT.count else key: values for key, values in one.items()}
        for one in study["subjects"]
    )
    subjects = tuple(Subject(**one, task=task) for one in counts)
    eta = drawn["eta"].values
    lead, size = eta.shape[:2], (len(subjects), len(names))
    if eta.shape != (*lead, *size) or constant["alone"].shape[1:] != size:
        raise InputError("its draws are of other subjects")
    effects, z = (
        drawn[key].values if key in drawn else np.empty((*lead, 0, *rest))
        for key, rest in (("effect", size[1:]), ("z", ()))
    )
    judged = tree["sample_stats"].to_dataset()["convergence"].values
    divergent, reason = (record["chains"][key] for key in ("divergent", "reason"))
    chains = GroupChains(
        drawn["mean"].values, drawn["sd"].values, effects, eta, z, {}, judged, divergent, reason
    )
    settings["prior"] = stored_prior(settings["prior"])
    *values, together = map(tuple, settings["hyperprior"]["values"])
    settings["hyperprior"] = Hyperprior(
        (*values, *Hyperprior().values[len(values) : -1], together)
    )  # parameters that there were not yet
    x, columns = (
        constant["x"].values if "x" in constant else np.empty((size[0], 0)),
        tuple(Regressor(**one) for one in who["columns"]),
    )
    return Population(
        Study(
            subjects,
            study["source"],
            study["synthetic"],
            tuple(study["notes"]),
            changes=study.get("changes", ()),
        ),
        GroupSettings(**settings),
        names,
        record["centre"],
        Regressors(
            tuple(one.name for one in subjects), x, columns, who["left_out"], tuple(who["notes"])
        ),
        with_convergence(chains),
        constant["alone"].values,
        record["left_out"],
        tuple(record["rough"]),
        None
        if record.get("differences") is None
        else _differences(record["differences"], drawn, chains, task),
    )


def _differences(
    told: Mapping[str, Any], drawn: xr.Dataset, chains: GroupChains, task: Task
) -> Differences:
    """What differs between conditions, with its draws."""
    conditions = Conditions(
        told["conditions"]["name"],
        tuple(told["conditions"]["levels"]),
        told["conditions"]["numeric"],
    )
    units = by_person(felt_together(Subject(**one, task=task) for one in told["units"]))
    mean, scatter, eta = (drawn[f"difference{ending}"].values for ending in ("_mean", "_sd", ""))
    empty: dict[str, Any] = {
        "effects": np.empty((*mean.shape[:2], 0, mean.shape[2])),
        "z": np.empty((*mean.shape[:2], 0)),
    }
    own = replace(
        chains,
        mean=mean,
        scatter=scatter,
        eta=eta,
        **empty,
        subject_convergence=np.array(told["judged"]),
    )
    return Differences(
        conditions, units, tuple(told["names"]), tuple(told["columns"]), with_convergence(own)
    )
