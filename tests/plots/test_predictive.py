"""Posterior predictive checks, by what is drawn."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import enlarged_table, refused
from legible import require_legible
from scipy.stats import binom

import bayes_toe as bt
from bayes_toe.plots.predictive import predictive_interval


def enlarged_analysis(analysis, size):
    """An analysis with `size` subjects: the subjects of an analysis by turns, with new names."""
    evidence = enlarged_table(analysis.evidence, size, "participant number {}")
    subjects = []
    curves = []
    for i, row in enumerate(evidence):
        position = i % len(analysis.study)
        subjects.append(replace(analysis.study.subjects[position], name=row.subject))
        curves.append(analysis.curves[position])
    study = bt.Study(subjects, synthetic=True)
    return replace(analysis, study=study, evidence=evidence, curves=tuple(curves))


def test_the_predictive_interval_of_one_draw_is_that_of_the_binomial_distribution(stronger):
    curve = stronger.curve("pulled")
    subject = curve.target.subject
    # The same draw many times, so that the ends are precise.
    one_draw = replace(curve, x=np.repeat(curve.x[:1], 2000, axis=0))
    # P('second') of each pair; its responses are binomial.
    share = one_draw.yes(subject.s1, subject.s2)[0]
    ends = predictive_interval(one_draw, seed=1)
    expected = binom.ppf([[0.025], [0.975]], subject.n_trials, share)
    assert subject.n_trials * ends == pytest.approx(expected, abs=1.0)  # one response


@pytest.mark.parametrize("size", [1, 8, 40])
def test_figures_are_legible_and_as_wide_as_a_column_or_a_page(analysis, stronger, size):
    for source in (analysis, stronger):
        figure = bt.plots.posterior_predictive(enlarged_analysis(source, size))
        require_legible(figure)
        # In millimetres, as journals print columns and pages.
        width = 25.4 * figure.get_figwidth()
        assert width == pytest.approx(85.0) or width == pytest.approx(175.0)
        assert 25.4 * figure.get_figheight() < 240.0
        assert figure.get_suptitle() == "synthetic data"


def test_too_many_subjects_and_unknown_ones_are_refused(analysis):
    # More subjects than a figure has panels, and a subject that the analysis does not have.
    with refused("found 41, allowed: 1 to 40"):
        bt.plots.posterior_predictive(enlarged_analysis(analysis, 41))
    with refused("Z"):
        bt.plots.posterior_predictive(analysis, ["Z"])
