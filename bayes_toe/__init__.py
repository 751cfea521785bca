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
    "Study": "study",
    "Subject": "study",
    "read_study": "files",
    "ReadOptions": "read_options",
    "example_study": "example",
    "example_truth": "example",
    "check_study": "checks",
    "Prior": "prior",
    "read_prior": "prior_file",
    "identifiability": "design_rank",
    "sensitivity": "prior_sensitivity",
    "SensitivityTable": "prior_sensitivity",
    "sensitivity_axes": "sensitivity_plot",
    "sensitivity_figure": "sensitivity_plot",
    "Posterior": "posterior",
    "sample": "api",
    "evidence": "api",
    "asymmetry": "response_asymmetry",
    "AsymmetryTable": "response_asymmetry",
    "covariate_tests": "covariates",
    "read_covariates": "covariates",
    "fit": "fit_table",
    "FitTable": "fit_table",
    "compare_intervals": "uncertainty",
    "run": "api",
    "settings_for": "api",
    "load": "draws",
    "Draws": "draws",
    "EvidenceTable": "model_evidence",
    "compare": "comparison",
    "ModelComparison": "comparison",
    "comparison_axes": "comparison_plot",
    "comparison_figure": "comparison_plot",
    "model_frequency_axes": "comparison_plot",
    "sample_model": "rung",
    "model_posterior": "ladder",
    "corner": "corner_plot",
    "curves": "plots",
    "evidence_figure": "plots",
    "save_figure": "plots",
    "figures": "paper_figures",
    "write_figures": "paper_figures",
    "asymmetry_axes": "asymmetry_plot",
    "order_axes": "asymmetry_plot",
    "filter_axes": "filter_plot",
    "noticed_axes": "filter_plot",
    "answers_axes": "subject_plot",
    "prior_axes": "subject_plot",
    "collapse_axes": "subject_plot",
    "map_axes": "map_plot",
    "plane_axes": "geometry_plot",
    "gamma_axes": "geometry_plot",
    "mass_ellipse": "ellipse",
    "posterior_of": "interval_posterior",
    "predict_equal": "prediction",
    "predict_gain": "prediction",
    "interval_curves": "interval_plot",
    "interval_gain_axes": "interval_plot",
    "interval_answers_axes": "interval_plot",
    "file_stems": "outputs",
    "equal_probability": "model",
    "noticed": "filtering",
    "calibrate": "calibration_table",
    "write_calibration": "calibration_results",
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
    from bayes_toe.asymmetry_plot import asymmetry_axes as asymmetry_axes
    from bayes_toe.asymmetry_plot import order_axes as order_axes
    from bayes_toe.calibration_results import write_calibration as write_calibration
    from bayes_toe.calibration_table import calibrate as calibrate
    from bayes_toe.checks import check_study as check_study
    from bayes_toe.comparison import ModelComparison as ModelComparison
    from bayes_toe.comparison import compare as compare
    from bayes_toe.comparison_plot import comparison_axes as comparison_axes
    from bayes_toe.comparison_plot import comparison_figure as comparison_figure
    from bayes_toe.comparison_plot import model_frequency_axes as model_frequency_axes
    from bayes_toe.corner_plot import corner as corner
    from bayes_toe.covariates import covariate_tests as covariate_tests
    from bayes_toe.covariates import read_covariates as read_covariates
    from bayes_toe.design_rank import identifiability as identifiability
    from bayes_toe.draws import Draws as Draws
    from bayes_toe.draws import load as load
    from bayes_toe.ellipse import mass_ellipse as mass_ellipse
    from bayes_toe.errors import BayesToeError as BayesToeError
    from bayes_toe.errors import ConvergenceWarning as ConvergenceWarning
    from bayes_toe.errors import InputError as InputError
    from bayes_toe.errors import OutputError as OutputError
    from bayes_toe.example import example_study as example_study
    from bayes_toe.example import example_truth as example_truth
    from bayes_toe.files import read_study as read_study
    from bayes_toe.filter_plot import filter_axes as filter_axes
    from bayes_toe.filter_plot import noticed_axes as noticed_axes
    from bayes_toe.filtering import noticed as noticed
    from bayes_toe.fit_table import FitTable as FitTable
    from bayes_toe.fit_table import fit as fit
    from bayes_toe.geometry_plot import gamma_axes as gamma_axes
    from bayes_toe.geometry_plot import plane_axes as plane_axes
    from bayes_toe.interval_plot import interval_answers_axes as interval_answers_axes
    from bayes_toe.interval_plot import interval_curves as interval_curves
    from bayes_toe.interval_plot import interval_gain_axes as interval_gain_axes
    from bayes_toe.interval_posterior import posterior_of as posterior_of
    from bayes_toe.ladder import model_posterior as model_posterior
    from bayes_toe.map_plot import map_axes as map_axes
    from bayes_toe.model import equal_probability as equal_probability
    from bayes_toe.model_evidence import EvidenceTable as EvidenceTable
    from bayes_toe.outputs import file_stems as file_stems
    from bayes_toe.paper_figures import figures as figures
    from bayes_toe.paper_figures import write_figures as write_figures
    from bayes_toe.plots import curves as curves
    from bayes_toe.plots import evidence_figure as evidence_figure
    from bayes_toe.plots import save_figure as save_figure
    from bayes_toe.posterior import Posterior as Posterior
    from bayes_toe.prediction import predict_equal as predict_equal
    from bayes_toe.prediction import predict_gain as predict_gain
    from bayes_toe.prior import Prior as Prior
    from bayes_toe.prior_file import read_prior as read_prior
    from bayes_toe.prior_sensitivity import SensitivityTable as SensitivityTable
    from bayes_toe.prior_sensitivity import sensitivity as sensitivity
    from bayes_toe.read_options import ReadOptions as ReadOptions
    from bayes_toe.response_asymmetry import AsymmetryTable as AsymmetryTable
    from bayes_toe.response_asymmetry import asymmetry as asymmetry
    from bayes_toe.rung import sample_model as sample_model
    from bayes_toe.sensitivity_plot import sensitivity_axes as sensitivity_axes
    from bayes_toe.sensitivity_plot import sensitivity_figure as sensitivity_figure
    from bayes_toe.study import Study as Study
    from bayes_toe.study import Subject as Subject
    from bayes_toe.subject_plot import answers_axes as answers_axes
    from bayes_toe.subject_plot import collapse_axes as collapse_axes
    from bayes_toe.subject_plot import prior_axes as prior_axes
    from bayes_toe.uncertainty import compare_intervals as compare_intervals


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'bayes_toe' has no attribute {name!r}")
    return getattr(import_module(f"bayes_toe.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
