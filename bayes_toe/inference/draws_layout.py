"""The layout of a file of draws: what is small and known of all subjects first, and where the draws of each subject go.

Large variables have a part for every subject, which lies in one chunk of the file: see :func:`regions`.
"""

from __future__ import annotations

import json
import math
import platform
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.data.study import Study
from bayes_toe.inference.pointwise import POINTWISE_LIMIT, spacing, values_needed
from bayes_toe.inference.subject import Settings
from bayes_toe.inference.subject_draws import SubjectDraws
from bayes_toe.model.ladder import model_named
from bayes_toe.version import library_versions

if TYPE_CHECKING:
    import xarray as xr

Key: TypeAlias = tuple[str, str]  # group, variable
Region: TypeAlias = tuple[Key, tuple[Any, ...], npt.NDArray[Any]]
BY_SUBJECT, BY_PAIR = ("chain", "draw", "subject"), ("chain", "draw", "obs")
MOST_INFLATED = 200  # bytes in memory for one on the disk; predicted counts, which alone are compressed, shrink to a third
_POINTWISE = {"log_likelihood": "float32", "posterior_predictive": "int32"}
_STATISTICS: dict[str, type] = {"converged": np.int8, "shortfall": object}


@dataclass(frozen=True)
class Large:
    """A variable with values for every draw.

    Attributes
    ----------
    dims : tuple of str
    shape : tuple of int
    dtype : str
    chunk : tuple of int
        The part of one subject.
    attrs : dict
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    chunk: tuple[int, ...]
    attrs: Mapping[str, str] = field(default_factory=dict)

    @property
    def nbytes(self) -> int:
        """Bytes in memory."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize


@dataclass(frozen=True, eq=False)
class Head:
    """What is small of the draws of a subject."""

    units: Mapping[str, str]
    coordinates: tuple[str, ...]
    size: tuple[int, int]
    acceptance: FloatArray
    statistics: Mapping[str, float | int | str]
    pointwise: bool

    @classmethod
    def of(cls, one: SubjectDraws) -> Head:
        """Of one subject."""
        chains, draws = one.log_posterior.shape
        return cls(one.units, one.coordinates, (chains, draws), one.acceptance, one.statistics, one.pointwise is not None)


def skeleton(study: Study, heads: Sequence[Head], settings: Settings, failed: Mapping[str, str]) -> tuple[xr.DataTree, dict[Key, Large]]:
    """All groups with everything that is small, and the large variables that are still to be filled in."""
    import xarray as xr

    observed = _long_group(study, "n_equal")
    groups = {
        "posterior": _coordinates(study, heads, walkers=settings.sampler.walkers),
        "sample_stats": _statistics_group(study, heads),
        "observed_data": observed,
        "constant_data": _long_group(study, "n_trials"),
    }
    large, left_out = _drawn(study, heads), ""
    if all(head.pointwise for head in heads):
        steps = np.arange(0, heads[0].size[1], spacing(*heads[0].size))
        groups |= {name: xr.Dataset(coords={"chain": np.arange(heads[0].size[0]), "draw": steps, **observed.coords}) for name in _POINTWISE}
        large |= _of_pairs(study, heads[0].size)
    else:
        left_out = (
            f"log_likelihood and posterior_predictive left out: {values_needed(study, settings.sampler):,} values each, more than "
            f"{POINTWISE_LIMIT:,}; sample fewer draws or fewer subjects at a time to have them"
        )
    tree = xr.DataTree.from_dict({f"/{name}": group for name, group in groups.items()})
    tree.attrs.update(_attributes(study, settings, left_out) | ({"failed": json.dumps(dict(failed))} if failed else {}))
    return tree, large


def filled(tree: xr.DataTree, large: Mapping[Key, Large], parts: Iterable[Region]) -> xr.DataTree:
    """The tree with its large variables in memory."""
    import xarray as xr

    arrays = {key: np.empty(one.shape, one.dtype) for key, one in large.items()}
    for key, where, values in parts:
        arrays[key][where] = values
    for group, node in tree.children.items():
        own = {name: xr.Variable(one.dims, arrays[of, name], one.attrs) for (of, name), one in large.items() if of == group}
        node.dataset = node.to_dataset().assign(own)
    return tree


def taken_apart(tree: xr.DataTree) -> tuple[xr.DataTree, dict[Key, Large], Iterator[Region]]:
    """The inverse of :func:`filled`: what is small, the large variables, and their parts, which are read as they are asked for."""
    import xarray as xr

    groups = {group: node.to_dataset() for group, node in tree.children.items()}
    sizes = [len(list(pairs)) for _, pairs in groupby(groups["observed_data"]["subject"].values.tolist())]
    last = {"subject": 1, "obs": _commonest(sizes)}
    large = {
        (group, str(name)): Large(tuple(map(str, one.dims)), one.shape, str(one.dtype), (*one.shape[:2], last[str(one.dims[2])]), one.attrs)
        for group, own in groups.items()
        for name, one in own.data_vars.items()
        if one.ndim == len(BY_SUBJECT)
    }
    small = xr.DataTree.from_dict(
        {f"/{group}": own.drop_vars([name for of, name in large if of == group]) for group, own in groups.items()}
    )
    small.attrs.update(tree.attrs)

    def parts() -> Iterator[Region]:
        for where in _places(sizes):
            for (group, name), one in large.items():
                yield (group, name), where[one.dims[-1]], groups[group][name][where[one.dims[-1]]].values

    return small, large, parts()


def load_small(tree: xr.DataTree) -> None:
    """Read what is small of an open file or store; the large variables are read when they are asked for."""
    for variable in (one for node in tree.children.values() for one in node.variables.values() if one.ndim < len(BY_SUBJECT)):
        variable.load()


def regions(study: Study, found: Iterable[SubjectDraws], large: Mapping[Key, Large]) -> Iterator[Region]:
    """Subject by subject, the parts of the large variables: variable, where in it, values."""
    for one, where in zip(found, _places(subject.n_pairs for subject in study), strict=True):
        nothing = np.full(one.log_posterior.shape, np.nan)  # a model may have a quantity per pair, and subjects different pairs
        for group, name in large:
            if group == "posterior":
                yield (group, name), where["subject"], one.quantities.get(name, nothing)[..., None]
            elif group == "sample_stats":
                yield (group, name), where["subject"], one.log_posterior[..., None]
            elif one.pointwise is not None:
                values = one.pointwise.log_likelihood if group == "log_likelihood" else one.pointwise.predicted
                yield (group, name), where["obs"], values


def _places(sizes: Iterable[int]) -> Iterator[Mapping[str, tuple[Any, ...]]]:
    """Where the part of every subject lies, by the last dimension of a large variable; sizes are their numbers of pairs."""
    end = 0
    for i, size in enumerate(sizes):
        end += size
        yield {"subject": (..., slice(i, i + 1)), "obs": (..., slice(end - size, end))}


def _commonest(sizes: Sequence[int]) -> int:
    return max(set(sizes), key=Counter(sizes).__getitem__)


def _drawn(study: Study, heads: Sequence[Head]) -> dict[Key, Large]:
    size, count = heads[0].size, len(study)
    shape, chunk = (*size, count), (*size, 1)
    units = {name: unit for head in reversed(heads) for name, unit in head.units.items()}
    names = dict.fromkeys(name for head in heads for name in head.units)
    about = f"log density of the unconstrained coordinates ({', '.join(heads[0].coordinates[:6])}), unnormalised"
    return {
        **{("posterior", name): Large(BY_SUBJECT, shape, "float64", chunk, {"units": units[name]}) for name in names},
        ("sample_stats", "lp"): Large(BY_SUBJECT, shape, "float64", chunk, {"description": about}),
    }


def _of_pairs(study: Study, size: tuple[int, int]) -> dict[Key, Large]:
    pairs = [subject.n_pairs for subject in study]
    kept = size[0], -(-size[1] // spacing(*size))
    shape, chunk = (*kept, sum(pairs)), (*kept, _commonest(pairs))
    return {(group, "n_equal"): Large(BY_PAIR, shape, dtype, chunk) for group, dtype in _POINTWISE.items()}


def _coordinates(study: Study, heads: Sequence[Head], *, walkers: int) -> xr.Dataset:
    import xarray as xr

    chains, draws = heads[0].size
    coords = {"chain": np.arange(chains), "draw": np.arange(draws), "subject": list(study.names)}
    return xr.Dataset(coords=coords | {"walker": ("draw", np.repeat(np.arange(walkers), draws // walkers))})


def _statistics_group(study: Study, heads: Sequence[Head]) -> xr.Dataset:
    """Statistics that are known of every subject."""
    import xarray as xr

    known = [name for name in heads[0].statistics if all(name in head.statistics for head in heads)]
    columns = {name: np.array([head.statistics[name] for head in heads], _STATISTICS.get(name)) for name in known}
    data: dict[str, Any] = {
        "acceptance_rate": (("chain", "subject"), np.stack([head.acceptance for head in heads], -1)),
        **{name: ("subject", values) for name, values in columns.items()},
    }
    chains, draws = heads[0].size
    return xr.Dataset(data, {"chain": np.arange(chains), "draw": np.arange(draws), "subject": list(study.names)})


def _long_group(study: Study, key: str) -> xr.Dataset:
    """One count per subject and pair, with the pair as coordinates."""
    import xarray as xr

    pairs = ("s1", "s2", "isi") if study.intervals else ("s1", "s2")
    columns = {name: np.concatenate([getattr(s, name) for s in study]) for name in (*pairs, key)}
    owner = np.repeat(np.array(study.names, object), [s.n_pairs for s in study])
    coords = {"subject": ("obs", owner), **{name: ("obs", columns[name]) for name in pairs}}
    return xr.Dataset({key: ("obs", columns[key])}, {"obs": np.arange(len(owner)), **coords})


def _attributes(study: Study, settings: Settings, left_out: str) -> dict[str, Any]:
    record = model_named(settings.model)
    versions = library_versions("xarray") | {"python": platform.python_version()}
    return {
        "source": study.source,
        "synthetic": int(study.synthetic),
        "notes": "\n".join(study.notes),
        "model": settings.model,
        "about_model": record.about + (f"; intervals isi in seconds: {record.of_intervals}" if study.intervals else ""),
        "seed": settings.seed,
        "prior": record.describe(settings.prior),
        "settings": json.dumps(settings.as_dict()),
        "versions": json.dumps(versions),
        "inference_library": "emcee",
        "inference_library_version": versions["emcee"],
        "left_out": left_out,
    }
