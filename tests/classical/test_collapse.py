"""The collapse: points of a known observer lie on the curve, and bands hold their mass."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.classical.frequencies import collapse, universal_curve
from bayes_toe.inference.modes import find_maxima
from bayes_toe.model.coordinates import Natural, unconstrained


def G(theta):  # noqa: N802 - the paper's symbol
    return float((1 + np.sqrt(1 + 4 * theta.gamma)) / 2)


def test_both_orders_collapse_on_one_curve(small_study):
    truth = Natural(*map(np.asarray, (-0.7, 0.25, 0.17, 0.92)))
    subject = small_study["A"]  # rounded expected counts of this observer
    posterior = bt.posterior_of(subject)
    found = collapse(posterior, unconstrained(truth, posterior.sbar))
    expected = (subject.s2 - (subject.s1 + (1 - 1 / G(truth)) * (-0.7 - subject.s1))) / (0.25 * G(truth) ** 1.5)
    assert found.z == pytest.approx(expected, rel=1e-12)
    assert (found.z_low == found.z).all()
    assert (np.abs(found.ratio - universal_curve(found.z)) < 0.03).all()
    assert (found.error > 0).all()
    assert set(found.order) == {-1, 0, 1}


def test_bands_of_the_collapse_hold_their_mass(small_study):
    posterior = bt.posterior_of(small_study["C"])
    x = find_maxima(posterior).x[0] + 0.15 * np.random.default_rng(2).standard_normal((4000, 4)) * [0.2, 1, 0.5, 1]
    found = collapse(posterior, x, mass=0.6)
    z = posterior.distance(x)
    inside = ((z >= found.z_low) & (z <= found.z_high)).mean(axis=0)
    assert inside == pytest.approx(np.full(13, 0.6), abs=1e-3)
