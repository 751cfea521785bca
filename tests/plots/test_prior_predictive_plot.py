"""The figure of what the prior expects, by what is drawn in it."""

import dataclasses

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.plots.style import ORDERS


def test_bands_are_the_prior_s_and_points_the_subjects(small_study):
    ax = bt.plots.prior_predictive_figure(small_study, "default", "symmetric", seed=4).axes[0]
    found = bt.prior_predictive(small_study, "default", "symmetric", seed=4)
    outer, inner = ax.containers
    for bars, low, high in ((outer, 0.05, 0.95), (inner, 0.25, 0.75)):
        drawn = np.array([(bar.get_y(), bar.get_y() + bar.get_height()) for bar in bars]).T
        assert drawn == pytest.approx(np.quantile(found.equal, [low, high], axis=0))
    points = {line.get_color(): np.asarray(line.get_ydata()) for line in ax.lines}
    for sign, mark in ORDERS.items():
        expected = [(k / n)[np.sign(one.s1 - one.s2) == sign] for one in small_study for k, n in [(one.n_yes, one.n_trials)]]
        assert np.sort(points[mark.colour]) == pytest.approx(np.sort(np.concatenate(expected)))


def test_the_figure_says_who_calls_everything_different(small_study):
    silent = bt.Subject("silent", [0.0, 0.3], [0.3, 0.0], [0, 1], [50, 50])
    study = dataclasses.replace(small_study, subjects=(*small_study.subjects, silent), synthetic=True)
    figure = bt.plots.prior_predictive_figure(study)
    words = figure.axes[1].get_legend().get_title().get_text()
    share = np.mean(bt.prior_predictive(study).largest < 0.05)
    assert words.splitlines()[1:] == [f"{100 * share:.2g} % of the prior's observers,", "1 of 4 subjects"]
    assert "synthetic" in figure.get_suptitle()


def test_names_of_pairs_have_their_interval_and_hundreds_of_pairs_have_none():
    pair = bt.Study([bt.Subject("a", [0.0, 0.0], [0.4, 0.4], [3, 2], [5, 5], isi=[0.5, 2.0])])
    ax = bt.plots.prior_predictive_figure(pair).axes[0]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["0, 0.4 (0.5 s)", "0, 0.4 (2 s)"]
    s = np.linspace(-1.0, 1.0, 20)
    s1, s2 = map(np.ravel, np.meshgrid(s, s))
    many = bt.Study([bt.Subject("a", s1, s2, np.ones(400, int), np.full(400, 2))])
    labels = [label.get_text() for label in bt.plots.prior_predictive_figure(many).axes[0].get_xticklabels()]
    assert labels[len(labels) // 2] == "0"
    assert len(labels) <= 25
