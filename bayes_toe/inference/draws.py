"""Posterior draws of a study under any model.

`Draws` has the draws of all subjects, their summary and the export to ArviZ. `load_draws` reads a
file of draws.

A file stores the draws of natural parameters, their density and the counts
(:mod:`bayes_toe.inference.draws_file`). Derived quantities, log likelihoods and predicted answers
follow from these. A chain is an independent ensemble; draws are walker-major within it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from bayes_toe.arrays import FloatArray, IntArray, NamedArrays, StrPath, Texts
from bayes_toe.data.messages import format_path, join_few
from bayes_toe.data.study import Study, Subject
from bayes_toe.data.tasks import Task
from bayes_toe.errors import InputError, require_kind
from bayes_toe.inference.draws_file import (
    BY_SUBJECT,
    COVARIATES,
    as_arviz,
    read_tree,
    reading,
    require_numbers,
    save_tree,
    stored_study,
)
from bayes_toe.inference.goodness_of_fit import GoodnessOfFit
from bayes_toe.inference.sampling import SamplerSettings, diagnose
from bayes_toe.inference.subject import (
    FIT_COLUMNS,
    SUMMARY_COLUMNS,
    Settings,
    SummaryRow,
    summary_rows,
)
from bayes_toe.model.models import (
    ObserverPosterior,
    model_posterior,
    model_title,
)
from bayes_toe.model.paper_equations import NATURAL, Natural
from bayes_toe.model.paper_model import PaperPosterior
from bayes_toe.model.parameters import QUANTITY_BY_NAME
from bayes_toe.model.prior import Prior, stored_prior
from bayes_toe.seeds import generator

#: Bytes of draws in one file. Who reads the file has them in memory together.
LARGEST = 2**33


@dataclass(frozen=True, eq=False, repr=False)
class Draws:
    """Posterior draws of every subject of a study, under one model.

    Attributes
    ----------
    tree : xarray.DataTree
        What is stored, in ArviZ's groups; :meth:`to_arviz` has all of them.
    """

    tree: xr.DataTree
    # All quantities of the subject that was asked for last, by the name of the subject.
    _derived: dict[str, NamedArrays] = field(default_factory=dict, init=False)

    def group(self, name: str) -> xr.Dataset:
        """One group of the tree as a Dataset, as ArviZ functions and xarray take it."""
        return self.tree[name].to_dataset()

    @cached_property
    def names(self) -> Texts:
        """Subject identifiers, in the order of the study."""
        return tuple(map(str, self.group("posterior")["subject"].values))

    @property
    def model(self) -> str:
        """The name of the model that these are draws of."""
        return str(self.tree.attrs["model"])

    @property
    def parameters(self) -> Texts:
        """The quantities that tables report, in order; :meth:`values` has further quantities."""
        return self.posterior(self.names[0]).names.reported

    @property
    def seed(self) -> int:
        """The root seed. The same study, settings and seed give the same draws."""
        return self.settings.seed

    @cached_property
    def settings(self) -> Settings:
        """The settings of the analysis that made these draws."""
        record = json.loads(self.tree.attrs["settings"])
        return Settings(
            seed=int(self.tree.attrs["seed"]),
            prior=stored_prior(record["prior"]),
            sampler=SamplerSettings(**record["sampler"]),
            model=self.model,
        )

    @property
    def prior(self) -> Prior:
        """The prior of these draws; :meth:`described_prior` is the line for a Methods section."""
        return self.settings.prior

    def described_prior(self) -> str:
        """The prior of every parameter of the model, in words."""
        return str(self.tree.attrs["prior"])

    @property
    def synthetic(self) -> bool:
        """True where the data were simulated."""
        return self.study.synthetic

    @property
    def not_converged(self) -> dict[str, str]:
        """Subjects whose draws missed the convergence criteria, with what was missed."""
        return self._remarks("shortfall")

    @property
    def imprecise(self) -> dict[str, str]:
        """Subjects with a quantile that is not precise enough, with how many draws would do."""
        return self._remarks("imprecise")

    def _remarks(self, column: str) -> dict[str, str]:
        """The subjects that have a text in this column of the statistics, with the text."""
        texts = map(str, self.group("sample_stats")[column].values)
        return {name: text for name, text in zip(self.names, texts, strict=True) if text}

    @property
    def failed(self) -> dict[str, str]:
        """Subjects of the study without draws, because their work was lost, with the reason."""
        return dict(json.loads(self.tree.attrs["failed"]))

    @property
    def not_interpreted(self) -> dict[str, str]:
        """Subjects whose responses have a fault that allows no conclusion, with the fault."""
        return dict(json.loads(self.tree.attrs["not_interpreted"]))

    def __getitem__(self, name: str | int) -> Draws:
        """Draws of one subject alone, by its name or its position in the study."""
        subject_name = self.subject(name).name
        index = self.names.index(subject_name)
        groups = self.tree.to_dict()
        for key in ("/posterior", "/sample_stats"):  # a slice keeps the axis of subjects
            groups[key] = groups[key].isel(subject=slice(index, index + 1)).load()
        for key in ("/observed_data", "/constant_data"):  # counts, an entry for each pair
            groups[key] = groups[key].isel(obs=groups[key]["subject"].values == subject_name)
        return Draws(xr.DataTree.from_dict(groups))

    @cached_property
    def study(self) -> Study:
        """The counts of the subjects that have draws, with the notes of reading them."""
        return stored_study(self.tree)

    @property
    def task(self) -> Task:
        """The task of the subjects."""
        return self.study.task

    def subject(self, name: str | int) -> Subject:
        """The counts of one subject."""
        return self.study[name]

    def posterior(self, name: str | int) -> ObserverPosterior | PaperPosterior:
        """The posterior of one subject under the model of the draws."""
        return model_posterior(self.model, self.subject(name), self.prior)

    def points(self, name: str | int) -> FloatArray:
        """Draws of one subject in unconstrained coordinates, shape (chains, draws, k)."""
        target = self.posterior(name)
        natural = {key: self._stored(target.subject.name, key) for key in target.names.natural}
        return target.points(natural)

    def natural(self, name: str | int) -> Natural:
        """Draws of the paper's parameters of one subject, each of shape (chains, draws).

        Raises
        ------
        InputError
            For an unknown subject, or if the model does not have all four parameters.
        """
        missing_names = [parameter for parameter in NATURAL if parameter not in self.parameters]
        if missing_names:
            raise InputError(
                f"model {self.model!r} has no {', '.join(missing_names)}; it has: "
                f"{', '.join(self.parameters)}"
            )
        return Natural(*(self.values(name, parameter) for parameter in NATURAL))

    def values(self, name: str | int, parameter: str) -> FloatArray:
        """Draws of one quantity of one subject, shape (chains, draws).

        Parameters
        ----------
        name : str
            Subject.
        parameter : str
            One of :attr:`parameters`, or of the model's other quantities, such as `offset` or
            `pull`.

        Raises
        ------
        InputError
            For an unknown subject or parameter.
        """
        name = self.subject(name).name
        if parameter in self.group("posterior"):
            return self._stored(name, parameter)

        target = self.posterior(name)
        if parameter not in target.names.all:
            raise InputError(
                f"unknown parameter {parameter!r}; there are: {', '.join(target.names.all)}"
            )

        # All quantities follow at once, and stay here for further calls for the same subject.
        if name not in self._derived:
            self._derived.clear()  # so that memory holds the quantities of one subject
            self._derived[name] = target.quantities(self.points(name))
        return self._derived[name][parameter]

    def fit(self, name: str | int) -> GoodnessOfFit:
        """Goodness of fit of one subject: deviance and its p-value."""
        stats = self.group("sample_stats").sel(subject=self.subject(name).name)
        return GoodnessOfFit(*(stats[column].item() for column in FIT_COLUMNS))

    def summary(self) -> pd.DataFrame:
        """Posterior of every subject and parameter, and how well it is sampled.

        The columns are mean, sd, quantiles, bulk and tail ESS, R-hat, posterior contraction, and
        Monte Carlo standard errors of the mean and of the 5, 50 and 95 % quantiles: how far these
        would be off in other draws. Posterior contraction is 1 - (posterior width / prior width)^2
        of the ranges from 5 to 95 %: 1 where all comes from the data, 0 where the posterior is as
        wide as the prior. Means and standard deviations of mu1 can be ruled by the prior's tail
        where gamma may vanish; read the quantiles of mu1.
        """
        rows: list[SummaryRow] = []
        for name in self.names:
            target = self.posterior(name)
            quantities = {key: self.values(name, key) for key in target.names.all}
            diagnostics = diagnose(quantities, target.names.same_ranks)
            rows += summary_rows(target, quantities, diagnostics)
        return pd.DataFrame(rows, columns=list(SUMMARY_COLUMNS))

    def to_arviz(self) -> Any:
        """Everything that ArviZ asks for.

        An InferenceData for ArviZ 0.x, an xarray.DataTree for 1.x.

        Groups: posterior with every reported quantity, sample_stats, and over `obs`, an entry for
        each subject and pair, observed_data, constant_data, log_likelihood and posterior_predictive
        (answers to a repeated experiment) of every draw. For one subject,
        `draws["S01"].to_arviz()`.

        Examples
        --------
        >>> from bayes_toe.analysis import sample
        >>> one = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
        >>> data = sample(Study([one]), draws=100, seed=1, workers=1).to_arviz()
        >>> sorted(data["posterior"].data_vars)
        ['gain', 'gamma', 'jnd', 'mu1', 'pse_shift', 'q0', 'sigma1', 'sigma_l', 'sigma_p', 'width']
        """
        groups = self.tree.to_dict()
        for key in self.parameters:
            values = np.stack([self.values(name, key) for name in self.names], axis=-1)
            groups["/posterior"][key] = (BY_SUBJECT, values, {"units": QUANTITY_BY_NAME[key].unit})

        coords = {**groups["/sample_stats"].coords, **groups["/observed_data"].coords}
        arrays_by_group = zip(*map(self._answers, self.names), strict=True)
        for group, arrays in zip(
            ("log_likelihood", "posterior_predictive"), arrays_by_group, strict=True
        ):
            # (chains, draws, obs), which are the pairs of one subject after the other.
            variable = (("chain", "draw", "obs"), np.concatenate(arrays, axis=-1))
            groups[f"/{group}"] = xr.Dataset({self.task.count: variable}, coords)

        return as_arviz(xr.DataTree.from_dict(groups))

    def _answers(self, name: str) -> tuple[FloatArray, IntArray]:
        """Log likelihood and predicted answers of a subject, (chains, draws, pairs) each.

        The same draws give the same answers.
        """
        target = self.posterior(name)
        x = self.points(name)  # (chains, draws, k)
        subject = target.subject
        rng = generator(self.seed, name, self.model, "posterior_predictive")
        log_likelihood, predicted = np.empty((2, *x.shape[:2], subject.n_pairs))

        # One chain at a time: temporaries of a large design stay small.
        for i, points in enumerate(x):
            log_answers = target.log_answers(points)
            (log_likelihood[i],) = target.rows.terms(log_answers)  # of the one row
            predicted[i] = rng.binomial(subject.n_trials, np.exp(log_answers[0]))
        return log_likelihood, predicted.astype(np.int64)

    def save(self, path: StrPath, *, overwrite: bool = False) -> Path:
        """Write a NetCDF file, whole or not at all.

        Raises
        ------
        OutputError
            If the file exists and may not be replaced, is a folder, or cannot be written.
        """
        return save_tree(self.tree, path, overwrite=overwrite)

    def _stored(self, name: str, parameter: str) -> FloatArray:
        """The draws of a quantity that the tree has, (chains, draws)."""
        drawn = self.group("posterior")[parameter].sel(subject=name)
        # A sum adds in the same order whatever the layout of the file.
        return np.ascontiguousarray(drawn.values, np.float64)

    def __repr__(self) -> str:
        sizes = self.group("posterior").sizes
        subjects = f"{len(self.names):,} subjects ({join_few(self.names)})"
        chains = f"{sizes['chain']} chains of {sizes['draw']:,}, seed {self.seed}"
        text = f"Draws of {model_title(self.model)}: {subjects}, {chains}"
        if self.not_converged:
            text += f"; NOT CONVERGED: {join_few([*self.not_converged])}"
        return f"<{text}>"


def require_draws(value: object) -> None:
    """Refuse a value that is no Draws, and name the functions that make them."""
    require_kind(
        "draws",
        value,
        Draws,
        "Draws, such as bt.sample(study), bt.run(study).draws or bt.load('posterior.nc')",
    )


def load_draws(path: StrPath) -> Draws:
    """Read draws that :meth:`Draws.save` wrote."""
    return draws_from(read_tree(path), path)


def draws_from(tree: xr.DataTree, path: StrPath) -> Draws:
    """The draws in the tree of a file; an InputError where a part is missing or not finite."""
    if COVARIATES in tree.children:
        raise InputError(
            f"{format_path(Path(path))}: draws of a group, allowed: those of subjects, a "
            "posterior.nc"
        )

    draws = Draws(tree)
    with reading(path):
        statistics = draws.group("sample_stats")
        require_numbers(statistics, {"lp": BY_SUBJECT, "min_ess": ("subject",)})
        # Values in `_` are read for the error that they raise if they are missing.
        _ = statistics[["converged", "shortfall", "imprecise", "max_r_hat"]]
        if draws.study.names != draws.names:
            raise InputError("its draws and its counts are of different subjects")
        natural = draws.posterior(draws.names[0]).names.natural
        require_numbers(draws.group("posterior"), dict.fromkeys(natural, BY_SUBJECT))
        _ = draws.settings, draws.failed, draws.not_interpreted
    return draws


def require_fitting(study: Study, settings: Settings) -> None:
    """Refuse, before the work, more draws than the memory of many computers holds."""
    sampler = settings.sampler
    n_draws = sampler.ensembles * sampler.walkers * sampler.kept_steps  # of a subject
    natural = model_posterior(settings.model, study.subjects[0], settings.prior).names.natural
    n_stored = len(natural) + 1  # and the log density
    n_bytes = 8 * n_stored * n_draws * len(study)  # a number has 8 bytes
    if n_bytes > LARGEST:
        raise InputError(
            f"about {n_bytes / 1e9:.3g} GB of draws, allowed in a file: {LARGEST / 1e9:.3g} GB; "
            "fewer --draws, or files of some subjects each"
        )
