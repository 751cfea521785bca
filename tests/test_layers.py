"""Imports point one way, from the command line down to the model; every module has its place."""

import ast
from pathlib import Path

import pytest

import bayes_toe

PACKAGE = Path(bayes_toe.__file__).parent
# Top to bottom: a module imports from modules below its own line only.
LAYERS = [
    ["__main__"],
    ["cli"],
    ["terminal", "command_options"],
    ["results", "calibration_results"],
    ["report", "paper_figures", "calibration_plot"],
    ["corner_plot", "map_plot", "interval_plot"],
    ["subject_plot", "asymmetry_plot", "filter_plot", "geometry_plot", "sensitivity_plot", "comparison_plot", "calibration_table"],
    ["plots", "calibration"],
    ["api", "comparison", "example", "recipes", "uncertainty", "prediction"],
    ["draws"],
    ["analysis", "files", "checks", "hard_cases", "prior_sensitivity", "rung"],
    ["pointwise", "fit_table", "model_evidence"],
    [
        "laplace",
        "sampling",
        "simulate",
        "number_table",
        "parallel",
        "quadrature",
        "read_options",
        "covariates",
        "leave_one_out",
        "prior_file",
    ],
    ["response_asymmetry", "lattice_quantiles"],
    ["proposal", "lattice_sums"],
    [
        "bootstrap",
        "ladder",
        "frequency_model",
        "maximum",
        "mixture",
        "diagnostics",
        "outputs",
        "cells",
        "goodness_of_fit",
        "sloppiness",
        "lattice",
    ],
    ["interval_posterior"],
    ["posterior", "maximum_likelihood", "panels", "contraction"],
    ["levelling", "target", "parameters"],
    ["prior", "geometry", "likelihood", "fits", "intervals"],
    ["design_rank"],
    ["coordinates", "newton", "frequencies", "filtering", "link", "scales"],
    ["model", "study", "ellipse", "seeds", "exact_test", "perception", "population", "differences", "reliability", "ecdf_bands"],
    ["errors"],
]
DEPTH = {name: depth for depth, names in enumerate(LAYERS) for name in names}


def _modules():
    return sorted(path.stem for path in PACKAGE.glob("*.py") if path.stem != "__init__")


def _imports(name):
    tree = ast.parse((PACKAGE / f"{name}.py").read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("bayes_toe."):
            yield node.module.removeprefix("bayes_toe.").split(".")[0]


def test_every_module_is_placed():
    assert sorted(DEPTH) == _modules()


@pytest.mark.parametrize("name", _modules())
def test_imports_point_down(name):
    upward = [other for other in _imports(name) if DEPTH[other] <= DEPTH[name]]
    assert not upward


@pytest.mark.parametrize(
    ("library", "owners"),
    [
        ("emcee", {"sampling"}),
        (
            "matplotlib",
            {
                *("plots", "corner_plot", "map_plot", "subject_plot", "asymmetry_plot", "filter_plot", "geometry_plot"),
                *("interval_plot", "sensitivity_plot", "comparison_plot", "calibration_plot", "paper_figures"),
            },
        ),
        ("corner", {"corner_plot"}),
        ("arviz", {"diagnostics"}),
        ("arviz_stats", {"diagnostics"}),
        ("xarray", {"draws"}),
        ("loky", {"parallel"}),
        ("typer", {"cli", "command_options"}),
        ("rich", {"terminal"}),
        ("jinja2", {"report"}),
    ],
)
def test_a_library_has_one_owner(library, owners):
    importers = set()
    for name in _modules():
        for node in ast.walk(ast.parse((PACKAGE / f"{name}.py").read_text())):
            found = (
                [alias.name for alias in node.names]
                if isinstance(node, ast.Import)
                else [node.module or ""]
                if isinstance(node, ast.ImportFrom)
                else []
            )
            if any(module.split(".")[0] == library for module in found):
                importers.add(name)
    assert importers == owners
