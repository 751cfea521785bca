"""Bayesian inference for time-order effects in same/different judgements (arXiv 2604.19662).

>>> import bayes_toe as bt
>>> study = bt.example_study()          # or bt.read_study("study.csv")
>>> table = bt.evidence(study.select(["S01"]), seed=1)
>>> table["S01"].log_bayes_factor > 0   # H1 (predictive update) against H0 (free frequencies), natural log
True
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

__version__ = version("bayes_toe")

# Public names and where they live. They load on first use, so that importing the package costs next to nothing.
_PLACES = {
    "Study": "data.study",
    "Subject": "data.study",
    "read_study": "data.read_study",
    "ReadOptions": "data.read_options",
    "example_study": "data.example",
    "example_truth": "data.example",
    "check_study": "experiments.checks",
    "Prior": "model.prior",
    "read_prior": "model.prior_file",
    "identifiability": "experiments.identifiability",
    "sensitivity": "comparison.prior_sensitivity",
    "SensitivityTable": "comparison.prior_sensitivity",
    "sensitivity_axes": "plots.sensitivity",
    "sensitivity_figure": "plots.sensitivity",
    "Posterior": "model.posterior",
    "sample": "api",
    "evidence": "api",
    "asymmetry": "classical.asymmetry",
    "AsymmetryTable": "classical.asymmetry",
    "covariate_tests": "classical.covariates",
    "read_covariates": "classical.covariates",
    "fit": "classical.fit_table",
    "FitTable": "classical.fit_table",
    "compare_intervals": "classical.interval_table",
    "run": "api",
    "settings_for": "api",
    "load": "inference.draws",
    "Draws": "inference.draws",
    "EvidenceTable": "comparison.evidence_table",
    "compare": "comparison.ladder_table",
    "ModelComparison": "comparison.ladder_table",
    "comparison_axes": "plots.comparison",
    "comparison_figure": "plots.comparison",
    "model_frequency_axes": "plots.comparison",
    "sample_model": "comparison.model_row",
    "model_posterior": "model.ladder",
    "corner": "plots.corner",
    "curves": "plots.curves",
    "evidence_figure": "plots.evidence",
    "save_figure": "plots.figure_files",
    "figures": "plots.paper_figures",
    "write_figures": "plots.paper_figures",
    "asymmetry_axes": "plots.asymmetry",
    "order_axes": "plots.asymmetry",
    "filter_axes": "plots.beliefs",
    "noticed_axes": "plots.beliefs",
    "answers_axes": "plots.subject",
    "prior_axes": "plots.subject",
    "collapse_axes": "plots.subject",
    "map_axes": "plots.map",
    "plane_axes": "plots.geometry",
    "gamma_axes": "plots.geometry",
    "mass_ellipse": "classical.ellipse",
    "posterior_of": "model.ladder",
    "predict_equal": "inference.prediction",
    "predict_gain": "inference.prediction",
    "interval_curves": "plots.intervals",
    "interval_gain_axes": "plots.intervals",
    "interval_answers_axes": "plots.intervals",
    "file_stems": "data.file_names",
    "equal_probability": "model.closed_form",
    "noticed": "model.beliefs",
    "calibrate": "experiments.calibration_table",
    "write_calibration": "cli.calibration_folder",
    "BayesToeError": "errors",
    "InputError": "errors",
    "OutputError": "errors",
    "ConvergenceWarning": "errors",
}

__all__ = ["__version__", *sorted(_PLACES)]

if TYPE_CHECKING:
    from bayes_toe.api import evidence as evidence
    from bayes_toe.api import run as run
    from bayes_toe.api import sample as sample
    from bayes_toe.api import settings_for as settings_for
    from bayes_toe.classical.asymmetry import AsymmetryTable as AsymmetryTable
    from bayes_toe.classical.asymmetry import asymmetry as asymmetry
    from bayes_toe.classical.covariates import covariate_tests as covariate_tests
    from bayes_toe.classical.covariates import read_covariates as read_covariates
    from bayes_toe.classical.ellipse import mass_ellipse as mass_ellipse
    from bayes_toe.classical.fit_table import FitTable as FitTable
    from bayes_toe.classical.fit_table import fit as fit
    from bayes_toe.classical.interval_table import compare_intervals as compare_intervals
    from bayes_toe.cli.calibration_folder import write_calibration as write_calibration
    from bayes_toe.comparison.evidence_table import EvidenceTable as EvidenceTable
    from bayes_toe.comparison.ladder_table import ModelComparison as ModelComparison
    from bayes_toe.comparison.ladder_table import compare as compare
    from bayes_toe.comparison.model_row import sample_model as sample_model
    from bayes_toe.comparison.prior_sensitivity import SensitivityTable as SensitivityTable
    from bayes_toe.comparison.prior_sensitivity import sensitivity as sensitivity
    from bayes_toe.data.example import example_study as example_study
    from bayes_toe.data.example import example_truth as example_truth
    from bayes_toe.data.file_names import file_stems as file_stems
    from bayes_toe.data.read_options import ReadOptions as ReadOptions
    from bayes_toe.data.read_study import read_study as read_study
    from bayes_toe.data.study import Study as Study
    from bayes_toe.data.study import Subject as Subject
    from bayes_toe.errors import BayesToeError as BayesToeError
    from bayes_toe.errors import ConvergenceWarning as ConvergenceWarning
    from bayes_toe.errors import InputError as InputError
    from bayes_toe.errors import OutputError as OutputError
    from bayes_toe.experiments.calibration_table import calibrate as calibrate
    from bayes_toe.experiments.checks import check_study as check_study
    from bayes_toe.experiments.identifiability import identifiability as identifiability
    from bayes_toe.inference.draws import Draws as Draws
    from bayes_toe.inference.draws import load as load
    from bayes_toe.inference.prediction import predict_equal as predict_equal
    from bayes_toe.inference.prediction import predict_gain as predict_gain
    from bayes_toe.model.beliefs import noticed as noticed
    from bayes_toe.model.closed_form import equal_probability as equal_probability
    from bayes_toe.model.ladder import model_posterior as model_posterior
    from bayes_toe.model.ladder import posterior_of as posterior_of
    from bayes_toe.model.posterior import Posterior as Posterior
    from bayes_toe.model.prior import Prior as Prior
    from bayes_toe.model.prior_file import read_prior as read_prior
    from bayes_toe.plots.asymmetry import asymmetry_axes as asymmetry_axes
    from bayes_toe.plots.asymmetry import order_axes as order_axes
    from bayes_toe.plots.beliefs import filter_axes as filter_axes
    from bayes_toe.plots.beliefs import noticed_axes as noticed_axes
    from bayes_toe.plots.comparison import comparison_axes as comparison_axes
    from bayes_toe.plots.comparison import comparison_figure as comparison_figure
    from bayes_toe.plots.comparison import model_frequency_axes as model_frequency_axes
    from bayes_toe.plots.corner import corner as corner
    from bayes_toe.plots.curves import curves as curves
    from bayes_toe.plots.evidence import evidence_figure as evidence_figure
    from bayes_toe.plots.figure_files import save_figure as save_figure
    from bayes_toe.plots.geometry import gamma_axes as gamma_axes
    from bayes_toe.plots.geometry import plane_axes as plane_axes
    from bayes_toe.plots.intervals import interval_answers_axes as interval_answers_axes
    from bayes_toe.plots.intervals import interval_curves as interval_curves
    from bayes_toe.plots.intervals import interval_gain_axes as interval_gain_axes
    from bayes_toe.plots.map import map_axes as map_axes
    from bayes_toe.plots.paper_figures import figures as figures
    from bayes_toe.plots.paper_figures import write_figures as write_figures
    from bayes_toe.plots.sensitivity import sensitivity_axes as sensitivity_axes
    from bayes_toe.plots.sensitivity import sensitivity_figure as sensitivity_figure
    from bayes_toe.plots.subject import answers_axes as answers_axes
    from bayes_toe.plots.subject import collapse_axes as collapse_axes
    from bayes_toe.plots.subject import prior_axes as prior_axes


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'bayes_toe' has no attribute {name!r}")
    return getattr(import_module(f"bayes_toe.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
