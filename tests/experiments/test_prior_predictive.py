"""What observers drawn from the prior do on a study's pairs, against observers simulated without posterior; and its figure."""

import dataclasses

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.experiments.prior_predictive import RARELY
from bayes_toe.plots.style import ORDERS


def _subject(name, s1, s2, n_yes=1, n=4, isi=None):
    return bt.Subject(name, s1, s2, np.full(len(s1), n_yes), np.full(len(s1), n), isi)


@pytest.mark.parametrize(
    "prior", [bt.Prior(), bt.Prior(mu1_mean=0.3, mu1_sd=0.5, sigma_p_scale=0.3)]
)
def test_observers_are_those_of_the_closed_form(small_study, prior):
    found = bt.prior_predictive(small_study, prior, seed=3, draws=20_000)
    rng = np.random.default_rng(8)
    theta = [values[:, None] for values in prior.sample(rng, 20_000)]
    equal = bt.model.equal_probability(found.pairs.s1, found.pairs.s2, *theta)[
        :, np.argsort(found.group)
    ]
    error = np.sqrt((equal.var(axis=0) + found.equal.var(axis=0)) / 20_000)
    assert np.abs(found.equal.mean(axis=0) - equal.mean(axis=0)) == pytest.approx(
        0.0, abs=4 * error.max()
    )  # 4 s.e.: false alarm 1e-3 in 13
    rare = np.mean(equal.max(axis=1) < RARELY), np.mean(found.largest < RARELY)
    assert rare[0] == pytest.approx(rare[1], abs=4 * np.sqrt(2 * rare[0] * (1 - rare[0]) / 20_000))


def test_the_papers_prior_in_the_papers_design_calls_everything_different_in_39_percent(
    small_study,
):
    # 0.3872, s.e. 0.0005, is of a million observers by the README's formulas alone; 4 s.e. of 40,000
    assert np.mean(
        bt.prior_predictive(small_study, "paper", draws=40_000).largest < RARELY
    ) == pytest.approx(0.3872, abs=0.01)


def test_pairs_stand_by_distance_with_the_counts_of_who_met_them():
    first, second = (
        _subject("a", [0.0, 0.3, 0.0], [0.3, 0.0, 0.0], 2),
        _subject("b", [0.0, 0.0], [0.3, 0.9], 0, 5),
    )
    found = bt.prior_predictive(bt.Study([first, second]), draws=10)
    assert found.distance == pytest.approx([-0.3, 0.0, 0.3, 0.9])
    assert found.n_trials.tolist() == [[4, 4, 4, 0], [0, 0, 5, 5]]
    assert found.n_yes.tolist() == [[2, 2, 2, 0], [0, 0, 0, 0]]
    assert found.largest_observed.tolist() == [0.5, 0.0]
    assert not found.grouped


def test_many_pairs_are_taken_together_by_order_and_distance():
    s1, s2 = map(np.ravel, np.meshgrid(np.linspace(0.0, 1.5, 16), np.linspace(0.0, 1.5, 16)))
    found = bt.prior_predictive(bt.Study([_subject("a", s1, s2)]), "default", "symmetric", draws=50)
    assert found.grouped
    middle = found.equal.shape[1] // 2
    assert 2 * 8 < found.equal.shape[1] <= 2 * 12 + 1
    assert np.all(np.diff(found.distance) > 0)
    assert found.n_trials[0, middle] == 4 * 16  # equal pairs stand alone
    assert found.n_trials.sum() == 4 * 256
    assert found.equal == pytest.approx(found.equal[:, ::-1])  # no order effect: both orders alike
    assert np.all(np.diff(found.equal[:, middle:], axis=1) <= 0)


def test_a_pair_at_two_intervals_is_two_pairs_and_any_composition_has_a_prior():
    s1, s2, isi = [0.0, 0.0, 0.4, 0.4], [0.4, 0.4, 0.0, 0.0], [0.5, 2.0, 0.5, 2.0]
    study = bt.Study([_subject("a", s1, s2, isi=isi)])
    found = bt.prior_predictive(study, "default", "update + sloped + both ways", draws=200)
    assert found.distance == pytest.approx([-0.4, -0.4, 0.4, 0.4])
    assert np.abs(found.equal[:, 0] - found.equal[:, 1]).max() > 0.01
    assert bt.prior_predictive(study, model="free frequencies", draws=2000).equal.mean(
        axis=0
    ) == pytest.approx(0.5, abs=0.03)
    with pytest.raises(bt.InputError, match="allowed"):
        bt.prior_predictive(study, "flat")


def test_bands_are_the_prior_s_and_points_the_subjects(small_study):
    ax = bt.plots.prior_predictive_figure(small_study, "default", "symmetric", seed=4).axes[0]
    found = bt.prior_predictive(small_study, "default", "symmetric", seed=4)
    outer, inner = ax.containers
    for bars, low, high in ((outer, 0.05, 0.95), (inner, 0.25, 0.75)):
        drawn = np.array([(bar.get_y(), bar.get_y() + bar.get_height()) for bar in bars]).T
        assert drawn == pytest.approx(np.quantile(found.equal, [low, high], axis=0))
    points = {line.get_color(): np.asarray(line.get_ydata()) for line in ax.lines}
    for sign, mark in ORDERS.items():
        expected = [
            (k / n)[np.sign(one.s1 - one.s2) == sign]
            for one in small_study
            for k, n in [(one.n_yes, one.n_trials)]
        ]
        assert np.sort(points[mark.colour]) == pytest.approx(np.sort(np.concatenate(expected)))


def test_the_figure_says_who_calls_everything_different(small_study):
    silent = bt.Subject("silent", [0.0, 0.3], [0.3, 0.0], [0, 1], [50, 50])
    study = dataclasses.replace(
        small_study, subjects=(*small_study.subjects, silent), synthetic=True
    )
    figure = bt.plots.prior_predictive_figure(study)
    words = figure.axes[1].get_legend().get_title().get_text()
    share = np.mean(bt.prior_predictive(study).largest < 0.05)
    assert words.splitlines()[1:] == [
        f"{100 * share:.2g} % of the prior's observers,",
        "1 of 4 subjects",
    ]
    assert "synthetic" in figure.get_suptitle()


def test_names_of_pairs_have_their_interval_and_hundreds_of_pairs_have_none():
    pair = bt.Study([bt.Subject("a", [0.0, 0.0], [0.4, 0.4], [3, 2], [5, 5], isi=[0.5, 2.0])])
    ax = bt.plots.prior_predictive_figure(pair).axes[0]
    assert [label.get_text() for label in ax.get_xticklabels()] == [
        "0, 0.4 (0.5 s)",
        "0, 0.4 (2 s)",
    ]
    s = np.linspace(-1.0, 1.0, 20)
    s1, s2 = map(np.ravel, np.meshgrid(s, s))
    many = bt.Study([bt.Subject("a", s1, s2, np.ones(400, int), np.full(400, 2))])
    labels = [
        label.get_text()
        for label in bt.plots.prior_predictive_figure(many).axes[0].get_xticklabels()
    ]
    assert labels[len(labels) // 2] == "0"
    assert len(labels) <= 25
