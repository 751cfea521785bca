"""Posterior draws of a study under any model: an xarray.DataTree with ArviZ's groups, its summary, saving and loading.

Groups: posterior (chain, draw, subject), sample_stats, and in long form over `obs` (one entry per subject and pair) observed_data,
constant_data, log_likelihood and posterior_predictive. A chain is an independent ensemble; draws are walker-major within it.
"""

from __future__ import annotations

import importlib.metadata
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.cluster import aside
from bayes_toe.data.places import shown
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.whole_files import whole_file
from bayes_toe.errors import InputError
from bayes_toe.inference.diagnostics import Errors, convergence, errors
from bayes_toe.inference.draws_file import ALLOWED, encoding, read_tree, seal
from bayes_toe.inference.pointwise import POINTWISE_LIMIT, values_needed
from bayes_toe.inference.predictive_checks import FitSummary
from bayes_toe.inference.sampling import Chains, SamplerSettings
from bayes_toe.inference.subject import Settings, SubjectResult
from bayes_toe.model.contraction import contraction
from bayes_toe.model.coordinates import NATURAL, Natural
from bayes_toe.model.free_frequencies import FrequencyPosterior
from bayes_toe.model.ladder import model_named, posterior_of
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.model.propagators import reference_interval
from bayes_toe.model.target import Answering

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


QUANTILES = {"q05": 0.05, "q25": 0.25, "q50": 0.5, "q75": 0.75, "q95": 0.95}
_MCSE = tuple(f"mcse_{name}" for name in Errors._fields)
SUMMARY_COLUMNS = ("subject", "parameter", "mean", "sd", *QUANTILES, "ess_bulk", "ess_tail", "r_hat", "contraction", *_MCSE)
NO_FAILURES: Mapping[str, str] = MappingProxyType({})
#: Names without a unit, with all that begin with q.
_WITHOUT_UNIT = ("gamma", "gain", "pull", "rho")


@dataclass(frozen=True, eq=False)
class Draws:
    """Posterior draws of every subject of a study, under one model.

    Attributes
    ----------
    tree : xarray.DataTree
        All groups; ArviZ reads the saved file as it is.
    """

    tree: xr.DataTree

    def group(self, name: str) -> xr.Dataset:
        """One group of the tree as a Dataset, as ArviZ functions and xarray take it."""
        return self.tree[name].to_dataset()

    @property
    def names(self) -> tuple[str, ...]:
        """Subject identifiers, in the order of the study."""
        return tuple(str(name) for name in self.group("posterior")["subject"].values)

    @property
    def attrs(self) -> dict[str, Any]:
        """Model, seed, prior, settings, versions and what was left out, as stored in the file."""
        return {str(key): value for key, value in self.tree.attrs.items()}

    @property
    def model(self) -> str:
        """The name of the model that these are draws of."""
        return str(self.tree.attrs["model"])

    @property
    def parameters(self) -> tuple[str, ...]:
        """The quantities that are stored, in order; :meth:`values` knows further ones that follow from them."""
        return tuple(str(name) for name in self.group("posterior").data_vars)

    @property
    def seed(self) -> int:
        """The root seed; with it, the same study and the same settings the same draws come again."""
        return int(self.tree.attrs["seed"])

    @property
    def prior(self) -> Prior:
        """The prior that these draws were made under; :meth:`described_prior` is the line for a Methods section."""
        values = json.loads(self.tree.attrs["settings"])["prior"]
        unknown = sorted(set(values) - {one.name for one in fields(Prior)})
        if unknown:
            raise InputError(
                f"draws made under a prior of your own, with {', '.join(unknown)}: only {Prior.__name__} itself can be told back"
            )
        return Prior(**{"offset_sd": 1.0, "reference_interval": 1.0 if self.intervals else None, **values})  # as before these could be said

    def described_prior(self) -> str:
        """The prior of every parameter of the model, in words."""
        return model_named(self.model).describe(self.prior)

    @property
    def intervals(self) -> tuple[float, ...]:
        """Distinct inter-stimulus intervals of the study, seconds, shortest first; empty where it has no column isi."""
        observed = self.group("observed_data")
        return tuple(np.unique(observed["isi"].values).tolist()) if "isi" in observed.coords else ()

    @property
    def synthetic(self) -> bool:
        """True where the data were simulated."""
        return bool(self.tree.attrs["synthetic"])

    @property
    def not_converged(self) -> dict[str, str]:
        """Subjects whose draws missed the convergence criteria, with what was missed."""
        stats = self.group("sample_stats")
        return {
            name: str(reason)
            for name, good, reason in zip(self.names, stats["converged"].values, stats["shortfall"].values, strict=True)
            if not good
        }

    @property
    def failed(self) -> dict[str, str]:
        """Subjects of the study that there are no draws of because their work was lost, with the reason."""
        return {str(name): str(reason) for name, reason in json.loads(self.tree.attrs.get("failed", "{}")).items()}

    def select(self, name: str) -> Draws:
        """Draws of one subject alone, without the pointwise groups."""
        import xarray as xr

        self._require(name)
        groups = {f"/{key}": self.group(key).sel(subject=[name]) for key in ("posterior", "sample_stats")}
        for key in ("observed_data", "constant_data"):
            group = self.group(key)
            groups[f"/{key}"] = group.isel(obs=group["subject"].values == name)
        tree = xr.DataTree.from_dict(groups)
        tree.attrs.update(self.tree.attrs)
        return Draws(tree)

    def subject(self, name: str) -> Subject:
        """The counts behind one subject's draws."""
        self._require(name)
        observed, constant = self.group("observed_data"), self.group("constant_data")
        at = observed["subject"].values == name
        columns = (observed["s1"], observed["s2"], observed["n_equal"], constant["n_trials"])
        s1, s2, n_equal, n_trials = (column.values[at] for column in columns)
        return Subject(name, s1, s2, n_equal, n_trials, observed["isi"].values[at] if "isi" in observed.coords else None)

    def posterior(self, name: str) -> Posterior | FrequencyPosterior:
        """The posterior that one subject's draws are of."""
        return posterior_of(self.subject(name), self.prior, model=self.model)

    def points(self, name: str) -> FloatArray:
        """Draws of one subject in unconstrained coordinates, shape (chains, draws, k), from the stored quantities."""
        stored = self.group("posterior").sel(subject=name)
        return self.posterior(name).points({key: np.asarray(stored[key].values, np.float64) for key in self.parameters})

    def natural(self, name: str) -> Natural:
        """Draws of the paper's parameters of one subject, each of shape (chains, draws).

        Raises
        ------
        InputError
            For an unknown subject, or where the model does not have all four.
        """
        missing = [key for key in NATURAL if key not in self.parameters]
        if missing:
            raise InputError(f"model {self.model!r} has no {', '.join(missing)}; it has: {', '.join(self.parameters)}")
        return Natural(*(self.values(name, key) for key in NATURAL))

    def values(self, name: str, parameter: str) -> FloatArray:
        """Draws of one quantity of one subject, shape (chains, draws).

        Parameters
        ----------
        name : str
            Subject.
        parameter : str
            One of :attr:`parameters`, or of the model's other quantities, such as `offset` or `pull`.

        Raises
        ------
        InputError
            For an unknown subject or parameter.
        """
        self._require(name)
        if parameter in self.parameters:
            return np.asarray(self.group("posterior")[parameter].sel(subject=name).values, np.float64)
        target = self.posterior(name)
        if parameter not in target.names.all:
            raise InputError(f"unknown parameter {parameter!r}; there are: {', '.join(target.names.all)}")
        return target.quantities(self.points(name))[parameter]

    def fit(self, name: str) -> FitSummary:
        """Goodness of fit of one subject: deviance and posterior predictive p-values."""
        self._require(name)
        stats = self.group("sample_stats").sel(subject=name)
        return FitSummary(**{key: stats[column].item() for key, column in _FIT_COLUMNS.items() if column in stats})

    def summary(self) -> pd.DataFrame:
        """One row per subject and parameter: mean, sd, quantiles, bulk and tail ESS, R-hat, contraction, Monte Carlo errors.

        The last are standard errors of the mean and of the 5, 50 and 95 % quantiles: how far these would be off in other draws.
        Contraction is 1 - (posterior width / prior width)^2 of the ranges from 5 to 95 %: 1 where all comes from the data, 0 where the
        posterior is as wide as the prior. Means and standard deviations of mu1 can be ruled by the prior's tail where gamma may vanish;
        read its quantiles.
        """
        import pandas as pd

        rows = []
        for name in self.names:
            target = self.posterior(name)
            rows += [(name, key, *_summary_row(self.values(name, key), target, key)) for key in target.names.reported]
        return pd.DataFrame(rows, columns=list(SUMMARY_COLUMNS))

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a NetCDF file, whole or not at all.

        Raises
        ------
        OutputError
            If the file exists and may not be replaced, or cannot be written.
        """
        with whole_file(path, overwrite=overwrite) as target:
            # By way of memory: where HDF5 itself fails to write, on a full disk, it ends the process with a segmentation fault.
            with aside():
                target.write_bytes(self.tree.to_netcdf(engine="h5netcdf", encoding=encoding(self.tree)))
            seal(target)
        return Path(path)

    def _require(self, name: str) -> None:
        if name not in self.names:
            raise InputError(f"no subject {name!r} among the draws; there are: {', '.join(map(repr, self.names))}")


def load(path: str | Path) -> Draws:
    """Read draws that :meth:`Draws.save` wrote.

    Raises
    ------
    InputError
        If the file is missing, is damaged, or is not such a file: see :mod:`bayes_toe.inference.draws_file`.
    """
    made, name = Draws(read_tree(path)), shown(Path(path))
    try:
        needed = made.posterior(made.names[0]).names.reported
    except InputError as error:
        raise InputError(f"{name}: draws of {error}") from error
    except (TypeError, ArithmeticError) as error:
        raise InputError(f"{name}: its prior or its pairs are none that draws have; {ALLOWED}") from error
    absent = sorted(set(needed) - set(made.parameters))
    if absent:
        raise InputError(f"{name}: no {', '.join(absent)} among the draws of model {made.model!r}; {ALLOWED}")
    return made


def build_draws(study: Study, results: Sequence[SubjectResult], settings: Settings, failed: Mapping[str, str] = NO_FAILURES) -> Draws:
    """Assemble the container from the results of :func:`bayes_toe.inference.subject.infer` with chains, and say who failed."""
    import xarray as xr

    groups = {
        "posterior": _posterior_group(results, settings),
        "sample_stats": _stats_group(results),
        "observed_data": _long_group(study, "n_equal"),
        "constant_data": _long_group(study, "n_trials"),
    }
    left_out = ""
    if all(result.pointwise is not None for result in results):
        groups.update(_pointwise_groups(results, groups["observed_data"]))
    else:
        left_out = (
            f"log_likelihood and posterior_predictive left out: {values_needed(study, settings.sampler):,} values each, more than "
            f"{POINTWISE_LIMIT:,}; sample fewer draws or fewer subjects at a time to have them"
        )
    tree = xr.DataTree.from_dict({f"/{name}": group for name, group in groups.items()})
    tree.attrs.update(_attributes(study, settings, left_out) | ({"failed": json.dumps(dict(failed))} if failed else {}))
    return Draws(tree)


def stored_bytes(study: Study, prior: Prior, sampler: SamplerSettings, model: str) -> int:
    """About how many bytes the file of draws will have, before they are made."""
    record, stored = model_named(model), sampler.ensembles * sampler.walkers * sampler.kept_steps
    names = {name for subject in study for name in record.posterior(subject, prior).names.reported}
    pairs = values_needed(study, sampler)
    return 8 * stored * len(study) * (len(names) + 1) + (6 * pairs if pairs <= POINTWISE_LIMIT else 0) + 50_000


def chains_of(result: SubjectResult) -> Chains:
    """The chains of a result that must have them."""
    if result.chains is None:
        raise InputError(f"subject {result.subject.name!r} was analysed without sampling")
    return result.chains


def _names(results: Sequence[SubjectResult]) -> list[str]:
    return [result.subject.name for result in results]


def _posterior_group(results: Sequence[SubjectResult], settings: Settings) -> xr.Dataset:
    import xarray as xr

    found = [result.target.quantities(chains_of(result).x) for result in results]
    names = dict.fromkeys(name for result in results for name in result.target.names.reported)
    size = chains_of(results[0]).log_posterior.shape
    nothing = np.full(size, np.nan)  # a model may have a quantity per pair, and subjects different pairs
    dims = ("chain", "draw", "subject")
    columns = {name: np.stack([values.get(name, nothing) for values in found], -1) for name in names}
    data = {name: (dims, values, {"units": _unit(name, results[0])}) for name, values in columns.items()}
    walkers = settings.sampler.walkers
    coords: dict[str, Any] = {
        "chain": np.arange(size[0]),
        "draw": np.arange(size[1]),
        "subject": _names(results),
        "walker": ("draw", np.repeat(np.arange(walkers), size[1] // walkers)),
    }
    return xr.Dataset(data, coords)


def _unit(name: str, result: SubjectResult) -> str:
    """The unit of a quantity; at the reference interval where an interval acts on it."""
    plain = "1" if name in _WITHOUT_UNIT or name.startswith("q") else "ln intensity"
    reference = reference_interval(result.subject, result.target.prior.reference_interval)
    return plain if result.subject.isi is None else result.target.model.units_at_intervals(reference).get(name, plain)


def _stats_group(results: Sequence[SubjectResult]) -> xr.Dataset:
    import xarray as xr

    chains = [chains_of(result) for result in results]
    about = f"log density of the unconstrained coordinates ({', '.join(results[0].target.coordinates[:6])}), unnormalised"
    fits = [result.fit for result in results if result.fit is not None]
    data: dict[str, Any] = {
        "lp": (("chain", "draw", "subject"), np.stack([c.log_posterior for c in chains], -1), {"description": about}),
        "acceptance_rate": (("chain", "subject"), np.stack([c.acceptance for c in chains], -1)),
        "converged": ("subject", np.array([c.converged for c in chains], np.int8)),
        "shortfall": ("subject", np.array([c.reason for c in chains], object)),
        "min_ess": ("subject", [c.least_ess for c in chains]),
        "max_r_hat": ("subject", [c.largest_r_hat for c in chains]),
        "thin": ("subject", [c.thin for c in chains]),
        "steps": ("subject", [c.steps for c in chains]),
        "proposal_efficiency": ("subject", [result.efficiency for result in results]),
        "pareto_k": ("subject", [result.pareto_k for result in results]),
        **{column: ("subject", [getattr(fit, key) for fit in fits]) for key, column in _FIT_COLUMNS.items() if _known(fits, key)},
    }
    size = chains[0].log_posterior.shape
    return xr.Dataset(data, {"chain": np.arange(size[0]), "draw": np.arange(size[1]), "subject": _names(results)})


#: Where the goodness of fit is kept among the statistics.
_FIT_COLUMNS = {
    "deviance": "deviance",
    "degrees_of_freedom": "degrees_of_freedom",
    "p_overall": "predictive_p",
    "p_overall_se": "predictive_p_se",
    "worst_p": "worst_pair_p",
    "worst_s1": "worst_pair_s1",
    "worst_s2": "worst_pair_s2",
    "worst_isi": "worst_pair_isi",
    "p_deviance": "deviance_p",
}


def _known(fits: Sequence[FitSummary], key: str) -> bool:
    return bool(fits) and all(getattr(fit, key) is not None for fit in fits)


def _long_group(study: Study, key: str) -> xr.Dataset:
    """One count per subject and pair, with the pair as coordinates."""
    import xarray as xr

    pairs = ("s1", "s2", "isi") if study.intervals else ("s1", "s2")
    columns = {name: np.concatenate([getattr(s, name) for s in study]) for name in (*pairs, key)}
    owner = np.repeat(np.array(study.names, object), [s.n_pairs for s in study])
    coords = {"subject": ("obs", owner), **{name: ("obs", columns[name]) for name in pairs}}
    return xr.Dataset({key: ("obs", columns[key])}, {"obs": np.arange(len(owner)), **coords})


def _pointwise_groups(results: Sequence[SubjectResult], observed: xr.Dataset) -> dict[str, xr.Dataset]:
    import xarray as xr

    dims = ("chain", "draw", "obs")
    found = [result.pointwise for result in results if result.pointwise is not None]
    log_likelihood = np.concatenate([values.log_likelihood for values in found], axis=2)
    predicted = np.concatenate([values.predicted for values in found], axis=2)
    return {
        "log_likelihood": xr.Dataset({"n_equal": (dims, log_likelihood)}, observed.coords),
        "posterior_predictive": xr.Dataset({"n_equal": (dims, predicted)}, observed.coords),
    }


def _attributes(study: Study, settings: Settings, left_out: str) -> dict[str, Any]:
    record = model_named(settings.model)
    packages = ("bayes_toe", "numpy", "scipy", "emcee", "arviz", "xarray")
    versions = {name: importlib.metadata.version(name) for name in packages} | {"python": platform.python_version()}
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


def _summary_row(values: FloatArray, target: Answering, parameter: str) -> tuple[float, ...]:
    quantiles = np.quantile(values, list(QUANTILES.values())).tolist()
    narrowed = contraction(target, parameter, quantiles[0], quantiles[-1])
    return (float(values.mean()), float(values.std(ddof=1)), *quantiles, *convergence(values), narrowed, *errors(values))
