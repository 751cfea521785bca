"""The hierarchical fit of a study: `population`, its result, and reading of saved results.

`population` samples the joint posterior of all subjects and of the group that they come from. Every
subject is the observer with constant error and contraction ('both'). `PopulationResult` has means,
standard deviations between subjects, effects of covariates, differences between conditions and
Bayes factors. `load` reads saved results.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.special import expit

from bayes_toe.arrays import FloatArray, StrPath
from bayes_toe.checks.identification import identify
from bayes_toe.data.conditions import StimulusScales
from bayes_toe.data.covariates import Covariates, read_covariates
from bayes_toe.data.messages import as_html, join_names
from bayes_toe.data.stimulus_unit import UNKNOWN_UNIT, StimulusUnit
from bayes_toe.data.study import Study, Subject, common_scales, require_study, units_by_subject
from bayes_toe.errors import ConvergenceWarning, InputError, require_kind, require_number
from bayes_toe.groups.group_posterior import (
    PLAIN_UNITS,
    GroupPosterior,
    SubjectRows,
    separate_fits,
)
from bayes_toe.groups.group_sampler import GroupDraws, sample_group
from bayes_toe.groups.hyperprior import HyperpriorNumbers
from bayes_toe.groups.population_table import (
    COMPUTED,
    EFFECTS,
    QUANTILES,
    SUBJECT_COLUMNS,
    PopulationTable,
    summary,
    summary_row,
)
from bayes_toe.groups.regressors import Regressor, Regressors, regressors
from bayes_toe.groups.zero_mean import ZeroBayesFactor, zero_difference, zero_effect, zero_mean
from bayes_toe.inference.draws import Draws, draws_from
from bayes_toe.inference.draws_file import (
    COVARIATES,
    as_arviz,
    read_tree,
    reading,
    require_numbers,
    save_tree,
    stored_study,
    study_tree,
)
from bayes_toe.model.observer import JND_OVER_NOISE
from bayes_toe.model.parameters import (
    CONSTANT_ERROR,
    CONTRACTION,
    LAPSE_RATE,
    NOISE,
    PEAK,
    group_parameters,
    lapse_logs,
    task_parameters,
)
from bayes_toe.model.prior import Hyperprior
from bayes_toe.model.prior_file import hyperprior_from
from bayes_toe.seeds import generator, require_seed, root_seed

#: Draws of all chains together; enough for 95 % intervals, and about 5 s of CPU for 10 subjects.
DRAWS = 3200
#: The arrays of :class:`GroupDraws` and the covariates in a file, with the names of their axes.
_DRAWS = {
    "mean": ("chain", "draw", "coefficient"),
    "sd": ("chain", "draw", "coefficient"),
    "effects": ("chain", "draw", "covariate", "coefficient"),
    "subjects": ("chain", "draw", "subject", "parameter"),
}
_COVARIATES = {"x": ("subject", "covariate")}
#: The parameters that may differ between conditions.
DIFFERING = (*EFFECTS, NOISE.name)


@dataclass(frozen=True)
class GroupSettings:
    """The settings that decide the numbers; stored with the results.

    Attributes
    ----------
    seed : int
    hyperprior : Hyperprior
    draws : int
        Number of draws of all chains together. If these draws are not reliable, there are twice as
        many.
    """

    seed: int
    hyperprior: Hyperprior
    draws: int

    def __post_init__(self) -> None:
        require_seed(self.seed)
        require_number("draws", self.draws, smallest=100, largest=100_000)


def study_scales(study: Study) -> StimulusScales:
    """The scales of all subjects together; the spread of first stimuli is that within subjects.

    A subject has one spread over all conditions.
    """
    scales = common_scales(*study)
    if scales is None:
        raise InputError("no pair has two different stimuli, so no order effect can be seen")
    # First stimuli from their mean in the subject, and trials, for each unit.
    deviations = []
    n_trials = []
    for units in units_by_subject(study).values():
        mean = _mean_first(units)
        deviations += [unit.s1 - mean for unit in units]
        n_trials += [unit.n_trials for unit in units]
    squares = np.square(np.concatenate(deviations))
    variance = np.average(squares, weights=np.concatenate(n_trials))
    return scales._replace(first_spread=float(np.sqrt(variance)))


def _mean_first(units: Sequence[Subject]) -> float:
    """Mean first stimulus of all trials of a subject."""
    s1 = np.concatenate([unit.s1 for unit in units])
    n_trials = np.concatenate([unit.n_trials for unit in units])
    return float(np.average(s1, weights=n_trials))


@dataclass(frozen=True, eq=False, repr=False)
class PopulationResult:
    """The posterior of a group, with everything that is needed to read it.

    The first coefficients are the parameters of `names`. With conditions, coefficients of the
    differences follow: for each parameter of :data:`DIFFERING`, one for each column of the design
    of the conditions.

    Attributes
    ----------
    study : Study
        The subjects, or units of subject and condition, that were analysed.
    settings : GroupSettings
    regressors : Regressors
    draws : GroupDraws
    """

    study: Study
    settings: GroupSettings
    regressors: Regressors
    draws: GroupDraws

    # --- What was analysed -----------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that have a distribution over subjects."""
        return tuple(parameter.name for parameter in group_parameters(self.study.task))

    @cached_property
    def subjects(self) -> tuple[str, ...]:
        """Names of the subjects."""
        return tuple(units_by_subject(self.study))

    @cached_property
    def scales(self) -> StimulusScales:
        """The scales of all subjects together."""
        return study_scales(self.study)

    @cached_property
    def numbers(self) -> HyperpriorNumbers:
        """The hyperprior of the coefficients."""
        return _numbers(self.settings.hyperprior, self.study)

    # --- Whether to believe it -------------------------------------------------------------------

    @property
    def is_reliable(self) -> bool:
        """Whether no trajectory diverged, chains agree and draws are enough."""
        return not self.draws.shortfall

    @property
    def problems(self) -> tuple[str, ...]:
        """Problems to know before any number is used, a line each."""
        if self.is_reliable:
            return self.regressors.notes
        problem = f"the group's result is not reliable: {self.draws.shortfall}"
        return (*self.regressors.notes, problem)

    # --- What was found --------------------------------------------------------------------------

    @cached_property
    def identified(self) -> frozenset[str]:
        """The parameters that the pairs of some subject can show.

        The means of other parameters rest on the prior.
        """
        # `identify` gives a reason for each effect that the pairs of a unit cannot show. An effect
        # is unknown if there is a reason in every unit.
        unknown = set(EFFECTS).intersection(*(identify(unit).reasons for unit in self.study))
        return frozenset(self.names) - unknown

    def index(self, name: str) -> int:
        """The position of a parameter among the coefficients."""
        return self.names.index(name)

    def in_units(
        self, name: str, coefficients: FloatArray, unit: StimulusUnit = UNKNOWN_UNIT
    ) -> FloatArray:
        """Coefficients of a parameter in the units of screens.

        The constant error becomes a shift of the PSE, and the noise a JND. Both are in `unit`, by
        default in per cent. Logit q0 becomes q0, and the contraction p stays as it is.
        """
        if name == CONSTANT_ERROR.name:
            return unit.to_differences(coefficients * self.scales.step)
        if name == NOISE.name:
            with np.errstate(over="ignore"):  # an infinite JND is printed as such
                jnd = JND_OVER_NOISE * self.scales.step * np.exp(coefficients)
            return unit.to_differences(jnd)
        if name == PEAK.name:
            return expit(coefficients)
        return coefficients

    def shown_unit(self, name: str) -> StimulusUnit:
        """The unit in which a figure shows a parameter of all subjects and of a new one.

        Per cents become natural logs if an interval of the figure has an end too large for them.
        """
        j = self.index(name)
        # By default, a constant error and a JND are in per cent. Other parameters are shares, far
        # below the limit of per cents.
        new_subject = self.in_units(name, self.new_subject[..., j])
        subjects = self.in_units(name, self.draws.subjects[..., j])
        new_interval = np.quantile(new_subject, QUANTILES)
        intervals = np.quantile(subjects, QUANTILES, axis=(0, 1))  # over chains and draws
        return self.study.unit.with_logs_if_large(np.append(new_interval, intervals))

    def difference_columns(self, name: str) -> list[int]:
        """The positions of the coefficients by which a parameter differs between conditions.

        The coefficients of the conditions follow those of the parameters. Each differing parameter
        has one for each column of the design.
        """
        if self.study.conditions is None:
            return []
        n_columns = self.study.conditions.design().shape[1]
        first = len(self.names) + DIFFERING.index(name) * n_columns
        return list(range(first, first + n_columns))

    def difference(
        self, name: str, levels: tuple[str, str]
    ) -> tuple[FloatArray, FloatArray, ZeroBayesFactor]:
        """The difference of two conditions in a parameter.

        It is the first level minus the second level. Returns draws of its mean and of its standard
        deviation between subjects, (chains, draws), and the Bayes factor for a mean of 0. The
        coefficients of a subject are independent given the group, so that their variances add up.
        """
        conditions = self.study.conditions
        assert conditions is not None  # there are levels
        # A row of the design has the weights of a parameter's coefficients at one level.
        rows = list(map(conditions.levels.index, levels))
        first, second = conditions.design()[rows]
        weights = first - second
        columns = self.difference_columns(name)
        mean = self.draws.mean[..., columns] @ weights
        sd = np.sqrt(np.square(self.draws.sd[..., columns]) @ np.square(weights))
        return mean, sd, zero_difference(self.draws, self.numbers, columns, weights)

    @cached_property
    def new_subject(self) -> FloatArray:
        """A draw of a further subject for every draw, (chains, draws, coefficients).

        Its covariates are at their reference.
        """
        rng = generator(self.settings.seed, "population", "new subject")
        return self.draws.mean + self.draws.sd * rng.standard_normal(self.draws.mean.shape)

    def quantities(self, coefficients: FloatArray) -> dict[str, FloatArray]:
        """Coefficients by their names, and quantities that follow, (..., coefficients) -> (...).

        These are the shift of the point of subjective equality and the JND in per cent, and the
        largest probability of 'equal' if that is a response.
        """
        values = {name: coefficients[..., j] for j, name in enumerate(self.names)}
        for name, quantity in COMPUTED.items():
            if name in values:
                values[quantity] = self.in_units(name, values[name])  # per cent, or a share
        return values

    @property
    def unshared_names(self) -> tuple[str, ...]:
        """The parameters of a subject that the group does not share, such as the lapse rate."""
        names = [parameter.name for parameter in task_parameters(self.study.task)]
        return tuple(name for name in names if name not in self.names)

    @property
    def comparisons(self) -> tuple[tuple[str, str], ...]:
        """Pairs of conditions that are compared."""
        if self.study.conditions is None:
            return ()
        return self.study.conditions.comparisons

    def __repr__(self) -> str:
        badge = "" if self.is_reliable else "; NOT RELIABLE"
        return f"<Population of {self.study.source!r}: {len(self.subjects):,} subjects{badge}>"

    def _repr_html_(self) -> str:
        return as_html(repr(self)[1:-1], self.table.frame())

    # --- Tables and file -------------------------------------------------------------------------

    @cached_property
    def table(self) -> PopulationTable:
        """The rows of population.csv."""
        rows = []
        for name, values in self.quantities(self.draws.mean).items():
            if name in EFFECTS:
                j = self.index(name)
                zero_factor = zero_mean(self.draws, self.numbers, self.regressors.x, j)
            else:  # nobody asks whether the mean of another parameter is 0
                zero_factor = None
            rows.append(summary_row(name, "mean", values, zero_factor=zero_factor))
        for j, name in enumerate(self.names):
            rows.append(summary_row(name, "sd", self.draws.sd[..., j]))
        for name, values in self.quantities(self.new_subject).items():
            rows.append(summary_row(name, "new_subject", values))

        for i, label in enumerate(self.regressors.labels):
            for j, name in enumerate(self.names):
                zero_factor = zero_effect(self.draws, self.numbers, self.regressors.x, i, j)
                values = self.draws.effects[..., i, j]
                rows.append(summary_row(name, "effect", values, label, zero_factor))
        for levels in self.comparisons:
            level = " - ".join(levels)
            for name in DIFFERING:
                mean, sd, zero_factor = self.difference(name, levels)
                rows.append(summary_row(name, "difference", mean, level, zero_factor))
                rows.append(summary_row(name, "difference_sd", sd, level))
        return PopulationTable(tuple(rows), self.settings.seed)

    @cached_property
    def subject_table(self) -> pd.DataFrame:
        """Estimates of every subject, as population_subjects.csv has them.

        They follow from the subject's own responses and from the group.
        """
        n_coefficients = self.draws.mean.shape[-1]
        rows = []
        for i, subject in enumerate(self.subjects):
            draws = self.draws.subjects[:, :, i]  # (chains, draws, parameters)
            values = self.quantities(draws)
            # The parameters that the group does not share follow, as coordinates of their priors.
            for j, name in enumerate(self.unshared_names, start=n_coefficients):
                u = draws[..., j]
                if name == LAPSE_RATE.name:  # u is its normal score
                    log_rate, _ = lapse_logs(u, PLAIN_UNITS.lapse_rate_b)
                    values[name] = np.exp(log_rate)
                else:  # u is a slope in units of its scale, which is over R
                    scale = getattr(PLAIN_UNITS, f"{name}_scale")
                    values[name] = scale / self.scales.spread * u
            rows += [(subject, name, *summary(column)) for name, column in values.items()]
        return pd.DataFrame(rows, columns=list(SUBJECT_COLUMNS))

    def summary(self) -> pd.DataFrame:
        """The table of the group as a frame, with the columns of population.csv."""
        return self.table.frame(full=True)

    def save(self, path: StrPath, *, overwrite: bool = False) -> Path:
        """Write population.nc, which ArviZ opens and :func:`bayes_toe.load` reads."""
        return save_tree(self.tree(), path, overwrite=overwrite)

    def to_arviz(self) -> Any:
        """The draws for ArviZ: an InferenceData for ArviZ 0.x, an xarray.DataTree for 1.x."""
        return as_arviz(self.tree())

    def tree(self) -> xr.DataTree:
        """The draws with the covariates, counts and settings, as the file has them."""
        coefficients = list(self.names)
        for name in DIFFERING:
            n_columns = len(self.difference_columns(name))
            coefficients += [f"difference {i + 1} of {name}" for i in range(n_columns)]
        regressors = self.regressors
        # The names along each axis; both datasets have the first two axes.
        common_axes = {"subject": list(self.subjects), "covariate": regressors.labels}
        parameters = [*coefficients, *self.unshared_names]
        axes = {**common_axes, "coefficient": coefficients, "parameter": parameters}
        draws = {name: (dims, getattr(self.draws, name)) for name, dims in _DRAWS.items()}
        groups = {
            "posterior": xr.Dataset(draws, axes),
            COVARIATES: xr.Dataset({"x": (_COVARIATES["x"], regressors.x)}, common_axes),
        }
        settings = {
            "n_draws": self.settings.draws,
            "hyperprior": asdict(self.settings.hyperprior),
            "n_divergent": self.draws.n_divergent,
            "columns": regressors.columns,
            "notes": regressors.notes,
        }
        return study_tree(self.study, self.settings.seed, settings, groups)


def population(
    study: Study,
    *,
    covariates: Covariates | StrPath | None = None,
    categorical: tuple[str, ...] = (),
    draws: int = DRAWS,
    seed: int | None = None,
    hyperprior: Hyperprior | StrPath | None = None,
) -> PopulationResult:
    """Sample the joint posterior of all subjects and of the group.

    Every subject is the observer with constant error and contraction ('both').

    Parameters
    ----------
    study : Study
        At least two subjects.
    covariates : mapping or path, optional
        What may move the means, by covariate and subject, or a CSV file of covariates. Subjects
        that lack a covariate are left out.
    categorical : tuple of str
        Covariates whose numbers are names of levels.
    draws : int
        Number of draws of all chains together.
    seed : int, optional
    hyperprior : Hyperprior or path, optional
        The prior of the group, or a prior file with the section [group].

    Raises
    ------
    InputError
        If there are fewer than two subjects, or covariates or numbers cannot be used.

    Warns
    -----
    ConvergenceWarning
        If the result is not reliable, and for subjects that are left out.

    Examples
    --------
    >>> from bayes_toe.data.read_study import example_study
    >>> study = example_study().select(["S01", "S02", "S03", "S04", "S05", "S06"])
    >>> result = population(study, seed=1)
    >>> result.names
    ('constant_error', 'contraction', 'noise')
    >>> result.table.row("mean", "contraction").q50 > 0.0
    True
    """
    require_study(study)
    settings = GroupSettings(root_seed(seed), hyperprior_from(hyperprior), draws)
    if study.conditions is not None and covariates is not None:
        raise InputError(
            "population: a condition and covariates are not analysed together; "
            "allowed: --ignore condition, or no covariates"
        )
    if covariates is None:
        covariates = {}
    elif not isinstance(covariates, Mapping):  # the path of a file
        covariates = read_covariates(covariates)
    design_columns = regressors(covariates, tuple(units_by_subject(study)), categorical=categorical)
    if covariates:  # `design_columns` lacks the subjects that lack a covariate
        study = study.select(design_columns.subjects)
    if len(design_columns.subjects) < 2:
        raise InputError(
            f"population: {join_names(design_columns.subjects)} is one subject; allowed: 2 and more"
        )

    posterior = group_posterior(study, settings.hyperprior, design_columns.x)
    group_draws = sample_group(posterior, draws, generator(settings.seed, "population"))
    result = PopulationResult(study, settings, design_columns, group_draws)
    for problem in result.problems:
        warnings.warn(problem, ConvergenceWarning, stacklevel=2)
    return result


def group_posterior(study: Study, hyperprior: Hyperprior, x: FloatArray) -> GroupPosterior:
    """The joint posterior of a study's subjects with covariates x, (subjects, covariates)."""
    rows = subject_rows(study)
    numbers = _numbers(hyperprior, study)
    return GroupPosterior(rows, numbers, x, separate_fits(rows, numbers))


def subject_rows(study: Study) -> SubjectRows:
    """The likelihood of a study's subjects, a row for each unit of subject and condition."""
    # By default, a spread of first stimuli narrows the prior of p. Here the hyperprior is narrowed
    # (see _numbers), so that the spread is 0.
    scales = study_scales(study)._replace(first_spread=0.0)
    units: list[Subject] = []
    unit_scales = []
    first_row = []  # the first unit of each subject
    for subject_units in units_by_subject(study).values():
        first_row.append(len(units))
        units += subject_units
        # Each subject has its own sbar, and all have the D and R of the study.
        unit_scales += [scales._replace(sbar=_mean_first(subject_units))] * len(subject_units)

    if study.conditions is None:
        differences = {}
    else:  # the design of the conditions has a row for each level
        levels = [study.conditions.levels.index(unit.condition) for unit in units]
        differences = dict.fromkeys(DIFFERING, study.conditions.design()[levels])
    return SubjectRows.from_subjects(units, unit_scales, np.array(first_row), differences)


def _numbers(hyperprior: Hyperprior, study: Study) -> HyperpriorNumbers:
    """The hyperprior of all coefficients; roved first stimuli narrow that of the contraction."""
    parameters = group_parameters(study.task)
    priors = {parameter.name: getattr(hyperprior, parameter.name) for parameter in parameters}
    priors[CONTRACTION.name] = hyperprior.contraction.narrowed(study_scales(study).roving_share)
    coefficients = list(priors.values())
    if study.conditions is not None:
        n_columns = study.conditions.design().shape[1]
        for name in DIFFERING:
            coefficients += [priors[name].difference] * n_columns
    return HyperpriorNumbers.from_rows(coefficients)


# --- Reading -------------------------------------------------------------------------------------


def load(path: StrPath) -> Draws | PopulationResult:
    """Read saved draws of subjects (posterior.nc) or of a group (population.nc).

    Raises
    ------
    InputError
        If the file is missing or damaged, or has neither kind of draws.
    """
    require_kind("file", path, (str, os.PathLike), "the path of a posterior.nc or population.nc")
    tree = read_tree(path)
    if COVARIATES not in tree.children:
        return draws_from(tree, path)  # which has its own `with reading(path)`
    with reading(path):
        return _stored_population(tree)


def _stored_population(tree: xr.DataTree) -> PopulationResult:
    """The result from a tree that :meth:`PopulationResult.tree` made."""
    posterior = tree["posterior"].to_dataset()
    covariates = tree[COVARIATES].to_dataset()
    require_numbers(posterior, _DRAWS)
    require_numbers(covariates, _COVARIATES)
    xr.align(posterior, covariates, join="exact")  # refuses other subjects or covariates
    record = json.loads(tree.attrs["settings"])
    draws_by_name = {name: posterior[name].values for name in _DRAWS}
    draws = GroupDraws(**draws_by_name, n_divergent=record["n_divergent"])
    stored_regressors = Regressors(
        tuple(map(str, posterior["subject"].values)),
        covariates["x"].values,
        tuple(Regressor(*column) for column in record["columns"]),
        tuple(record["notes"]),
    )
    hyperprior = Hyperprior.from_record(record["hyperprior"])
    settings = GroupSettings(int(tree.attrs["seed"]), hyperprior, record["n_draws"])
    return PopulationResult(stored_study(tree), settings, stored_regressors, draws)
