"""population.nc: the posterior of a group as ArviZ opens it, and everything that makes it a :class:`Population` again, to the bit.

Groups: posterior (means, scatters, effects, correlations, members' parameters on the group scales; quantities of members, of a subject at
the mean and of a further one); posterior_predictive (asymmetries, of fewer draws); constant_data (regressors, draws of each subject alone,
and the record that the file is read back from). It is written, and sealed, as posterior.nc is.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.arrays import IndexArray
from bayes_toe.data.places import shown
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError
from bayes_toe.groups.asymmetries import MOST_DRAWS, spaced
from bayes_toe.groups.hyperprior_fields import GROUP_PARAMETERS
from bayes_toe.inference.draws_file import opened
from bayes_toe.inference.draws_layout import Key, Large, Region
from bayes_toe.inference.draws_writer import sealed, write_tree
from bayes_toe.records import packed, unpacked
from bayes_toe.version import library_versions

if TYPE_CHECKING:
    import xarray as xr

    from bayes_toe.groups.population import Population

_ALLOWED = "allowed: a population.nc written by bayes-toe"
_CHAINS = {"mean": "mean", "sd": "scatter", "effect": "effects", "eta": "eta", "z": "z"}  # variables, and what the record calls them
_AFFORDABLE = 1 << 26  # values: half a gigabyte
_MOST_SAID = 1 << 14  # characters of one attribute; HDF5 has room for four times as many


def save_population(found: Population, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write the file; see :meth:`Population.save`."""
    large, where = _large(found)
    with whole_file(path, overwrite=overwrite) as target:
        write_tree(target, _small(found, where), large, _parts(found, where))
    return Path(path)


def load_population(path: str | Path) -> Population:
    """Read what :meth:`Population.save` wrote.

    Raises
    ------
    InputError
        If it is missing, is damaged, or is not such a file.
    """
    name = shown(Path(path))
    if not Path(path).is_file():
        raise InputError(f"{name}: {'not a file' if Path(path).exists() else 'no such file'}; {_ALLOWED}")
    try:
        if not sealed(Path(path)):
            raise InputError("damaged, or written by something else")
        return _made(opened(name, path))
    except Exception as error:  # of a damaged file the libraries say anything, from KeyError to RuntimeError
        reason = f" ({error})" if isinstance(error, InputError) else ""
        raise InputError(f"{name}: not a population that can be read{reason}; {_ALLOWED}") from error


def _made(tree: xr.DataTree) -> Population:
    from bayes_toe.groups.population import Population  # which can save itself

    drawn = tree["posterior"].to_dataset()
    constant = tree["constant_data"].to_dataset()
    found = unpacked(constant["record"].values.tobytes())
    if not isinstance(found, Population):
        raise InputError("it holds something else")
    parts: dict[str, Any] = {ours: np.asarray(drawn[name].values) for name, ours in _CHAINS.items() if name in drawn}
    lead, n, k = parts["mean"].shape[:2], len(found.study), len(found.names)
    if parts["eta"].shape != (*lead, n, k) or constant["alone"].shape[1:] != (n, k):
        raise InputError("its draws are of other subjects")
    parts.setdefault("effects", np.empty((*lead, 0, k)))
    parts.setdefault("z", np.empty((*lead, 0)))
    return replace(found, chains=replace(found.chains, **parts), alone=np.asarray(constant["alone"].values))


# --- Layout ---------------------------------------------------------------------------------------


def _large(found: Population) -> tuple[dict[Key, Large], str]:
    """Variables with a part for every subject, and the group of those that follow from parameters: where all draws of them fit, all."""
    shape, names = found.chains.eta.shape, _reported(found)
    where = "posterior" if shape[0] * shape[1] * shape[2] * len(names) <= _AFFORDABLE else "posterior_predictive"
    draws = len(_draws(found, where))
    eta = Large(("chain", "draw", "subject", "parameter"), shape, "float64", (*shape[:2], 1, shape[3]))
    own = Large(("chain", "draw", "subject"), (shape[0], draws, shape[2]), "float64", (shape[0], draws, 1))
    return {("posterior", "eta"): eta, **{(where, name): own for name in names}}, where


def _parts(found: Population, where: str) -> Iterator[Region]:
    draws = _draws(found, where)
    for i in range(len(found.study)):
        one = found.chains.eta[:, :, i]
        yield ("posterior", "eta"), (..., slice(i, i + 1), slice(None)), one[:, :, None]
        quantities = found.quantities(one[:, draws])
        for name in _reported(found):
            yield (where, name), (..., slice(i, i + 1)), quantities[name][..., None]


def _small(found: Population, where: str) -> xr.DataTree:
    import xarray as xr

    every = found.asymmetries
    shared = ("chain", "draw")
    at_mean, further = (found.quantities(eta) for eta in (found.chains.mean, found.new_subject()))
    drawn: dict[str, Any] = {
        "mean": ((*shared, "parameter"), found.chains.mean),
        "sd": ((*shared, "parameter"), found.chains.scatter),
        "at_mean": ((*shared, "quantity"), np.stack(list(at_mean.values()), axis=-1)),
        "new_subject": ((*shared, "quantity"), np.stack(list(further.values()), axis=-1)),
    }
    names = {"subject": list(found.study.names), "parameter": list(found.names)}
    coords = names | {"quantity": list(at_mean), **_steps(found, "posterior")}
    if columns := [column.label for column in found.regressors.columns]:
        drawn["effect"] = ((*shared, "regressor", "parameter"), found.chains.effects)
        coords["regressor"] = columns
    if found.chains.correlated:
        drawn |= {"correlation": ((*shared, "parameter", "other"), found.chains.correlation), "z": ((*shared, "pair"), found.chains.z)}
        coords["other"] = names["parameter"]
    groups = {"/posterior": xr.Dataset(drawn, coords), "/constant_data": _constant(found, names, columns)}
    if every is not None or where != "posterior":
        data: dict[str, Any] = {}
        some = _steps(found, "posterior_predictive") | ({} if where == "posterior" else {"subject": names["subject"]})
        if every is not None:
            data = {"asymmetry": ((*shared, "level", "comparison"), every.draws), "new_asymmetry": (shared, every.new_subject)}
            some |= {"level": list(every.levels), "comparison": list(every.comparisons)}
        groups["/posterior_predictive"] = xr.Dataset(data, some)
    tree = xr.DataTree.from_dict(groups)
    tree.attrs.update(_attributes(found, where))
    return tree


def _constant(found: Population, names: dict[str, list[str]], columns: list[str]) -> xr.Dataset:
    import xarray as xr

    nothing: dict[str, Any] = dict.fromkeys(_CHAINS.values(), np.empty(0))
    empty = replace(found.chains, **nothing)
    record = np.frombuffer(packed(replace(found, chains=empty, alone=np.empty(0))), np.uint8)
    data: dict[str, Any] = {"alone": (("alone_draw", "subject", "parameter"), found.alone), "record": ("byte", record)}
    if columns:
        data["x"] = (("subject", "regressor"), found.regressors.x)
    return xr.Dataset(data, names | ({"regressor": columns} if columns else {}))


def _steps(found: Population, group: str) -> dict[str, Any]:
    return {"chain": np.arange(len(found.chains.mean)), "draw": _draws(found, group)}


def _draws(found: Population, group: str) -> IndexArray:
    """Which draws a group holds."""
    if group == "posterior":
        return np.arange(found.chains.mean.shape[1])
    chains, draws, _ = found.chains.mean.shape
    return spaced(chains, draws, MOST_DRAWS) if found.asymmetries is None else found.asymmetries.kept


def _reported(found: Population) -> tuple[str, ...]:
    return found.posterior(found.study.names[0]).names.reported


def _attributes(found: Population, where: str) -> dict[str, Any]:
    settings, study = found.settings, found.study
    versions = library_versions("xarray") | {"python": platform.python_version()}
    return {
        "source": study.source,
        "synthetic": int(study.synthetic),
        "notes": _said(study.notes),
        "model": settings.model,
        "seed": settings.seed,
        "scatter": settings.scatter,
        "method": settings.method,
        "correlations": int(settings.correlations),
        "prior": found.model.describe(settings.prior),
        "hyperprior": "\n".join(settings.hyperprior.describe(found.names, correlations=settings.correlations)),
        "settings": json.dumps({"draws": settings.draws, "prior": asdict(settings.prior), "hyperprior": settings.hyperprior.as_dict()}),
        "scales": json.dumps({name: GROUP_PARAMETERS[name].label for name in found.names}),
        "centre": found.centre,
        "regressors": _said([column.about for column in found.regressors.columns]),
        "left_out": _said([f"{name}: {reason}" for name, reason in found.left_out.items()]),
        "converged": int(found.converged),
        "problems": _said(found.problems),
        "thinned": "" if where == "posterior" else "quantities of subjects are those of the draws of posterior_predictive; eta has all",
        "versions": json.dumps(versions),
        "inference_library": "bayes_toe",
        "inference_library_version": versions["bayes_toe"],
    }


def _said(lines: tuple[str, ...] | list[str]) -> str:
    """Lines, as many of them as an attribute has room for."""
    text = "\n".join(lines)
    return text if len(text) <= _MOST_SAID else text[:_MOST_SAID] + " ..."
