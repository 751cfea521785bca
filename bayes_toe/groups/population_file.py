"""The draws of a group with its counts and settings as a tree, the format of population.nc."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from bayes_toe.arrays import Record
from bayes_toe.data.study import Study
from bayes_toe.groups.group_sampler import GroupDraws
from bayes_toe.groups.regressors import Regressor, Regressors
from bayes_toe.inference.draws_file import COVARIATES, attributes_of, counts_of, stored_study
from bayes_toe.libraries import library_versions

#: The draws, with what their axes have names for.
_DIMS = {
    "mean": ("coefficient",),
    "sd": ("coefficient",),
    "effect": ("covariate", "coefficient"),
    "subjects": ("subject", "parameter"),
}


def group_tree(
    study: Study,
    regressors: Regressors,
    draws: GroupDraws,
    settings: Mapping[str, Any],
    *,
    coefficients: Sequence[str],
    unshared: Sequence[str],
) -> xr.DataTree:
    """The tree of a group.

    Parameters
    ----------
    study, regressors, draws
        What was analysed, and its draws.
    settings : mapping
        As JSON has them.
    coefficients, unshared : sequence of str
        Names of the parameters that have a mean and an sd, and of those that only subjects have.
    """
    subjects = list(regressors.subjects)
    covariates = [column.label for column in regressors.columns]
    names = {
        "coefficient": list(coefficients),
        "parameter": [*coefficients, *unshared],
        "covariate": covariates,
        "subject": subjects,
    }
    values = (draws.mean, draws.sd, draws.effects, draws.subjects)
    variables = {}
    for (name, dims), array in zip(_DIMS.items(), values, strict=True):
        variables[name] = (("chain", "draw", *dims), array)
    x = {"x": (("subject", "covariate"), regressors.x)}
    groups = {
        "/posterior": xr.Dataset(variables, names),
        f"/{COVARIATES}": xr.Dataset(x, {"subject": subjects, "covariate": covariates}),
        **counts_of(study),
    }
    tree = xr.DataTree.from_dict(groups)
    record = {
        **settings,
        "n_divergent": draws.n_divergent,
        "columns": [column._asdict() for column in regressors.columns],
        "left_out": dict(regressors.left_out),
        "notes": list(regressors.notes),
    }
    tree.attrs.update(attributes_of(study))
    tree.attrs["settings"] = json.dumps(record)
    tree.attrs["inference_library"] = "bayes_toe"
    tree.attrs["inference_library_version"] = library_versions()["bayes_toe"]
    return tree


def stored_group(tree: xr.DataTree) -> tuple[Study, Regressors, GroupDraws, Record]:
    """The study, covariates, draws and settings in a tree."""
    record = json.loads(tree.attrs["settings"])
    posterior, covariates = tree["posterior"].to_dataset(), tree[COVARIATES].to_dataset()
    mean, sd, effects, subjects = (posterior[name].values for name in _DIMS)
    draws = GroupDraws(mean, sd, effects, subjects, record["n_divergent"])
    regressors = Regressors(
        tuple(map(str, posterior["subject"].values)),
        covariates["x"].values,
        tuple(Regressor(**column) for column in record["columns"]),
        record["left_out"],
        tuple(record["notes"]),
    )
    return stored_study(tree), regressors, draws, record
