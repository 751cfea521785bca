"""The verdict of a subject: words by their limits, robustness and size by other routes, real subjects as measured."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.comparison import words
from bayes_toe.comparison.verdict import Doubt, Verdict, verdict
from bayes_toe.data.study import Subject
from bayes_toe.inference.prediction import effect_size
from bayes_toe.inference.predictive_checks import FitSummary
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.prior import DEFAULT

FITS = FitSummary(8.0, 9, 0.5, 0.01, 0.2, 0.0, 0.3, p_deviance=0.5)


def made(none, constant=0.0, *, larger=1.0, varied=(), fit=FITS, **other):
    return Verdict(
        "S", (none, constant, 1.0 - none - constant), varied, 0.0, 0.3, larger, "none", fit, **other
    )


def test_words_by_their_limits():
    """Of P(none), and of P of an effect that is not small."""
    limits = {
        (0.05, 1.0): "has",
        (0.06, 1.0): "probably has",
        (0.25, 0.0): "probably has",
        (0.26, 1.0): "undecided",
        (0.26, 0.05): "negligible",
        (0.74, 0.06): "undecided",
        (0.75, 0.0): "probably none",
        (0.95, 1.0): "none",
    }
    assert {of: made(of[0], larger=of[1]).effect for of in limits} == limits


def test_a_kind_is_named_by_its_share_of_the_effect():
    """Of P(none) and P(constant error)."""
    kinds = {
        (0.0, 0.9): "constant error",
        (0.0, 0.89): "probably constant error",
        (0.2, 0.16): "probably pull",
        (0.2, 0.05): "pull",
        (0.0, 0.5): "open",
        (0.3, 0.7): "",
    }
    assert {orders: made(*orders).kind for orders in kinds} == kinds


def test_robust_is_who_keeps_side_and_kind():
    """A kind that is open is no other kind."""
    others = {
        (0.04, 0.1, 0.86): "yes",
        (0.3, 0.1, 0.6): "no",
        (0.02, 0.9, 0.08): "no",
        (0.02, 0.4, 0.58): "yes",
    }
    assert {
        other: made(0.03, 0.02, varied=((0.02, 0.03, 0.95), other)).robust for other in others
    } == others
    assert (
        "P of none 0.02 to 0.30"
        in made(0.03, 0.02, varied=((0.02, 0.03, 0.95), (0.3, 0.1, 0.6))).describe()
    )


def test_every_doubt_stands_in_the_words():
    misfit = replace(FITS, p_overall=0.001)
    said = made(
        0.9, fit=misfit, p_none_scattered=0.4, data=(Doubt("swapped blocks", "--turn S:2,4"),)
    ).describe()
    assert said.startswith(
        "probably has no order effect (P of none = 0.90); but no model describes the answers"
    )
    assert "with more scatter P of none = 0.40" in said
    assert "swapped blocks (--turn S:2,4)" in said
    assert made(0.9, fit=None).fit == "cannot be told"
    assert (
        made(0.02, 0.01, larger=0.03).describe()
        == "has a small order effect: a pull (P of an effect = 0.98, that it is a pull = 0.99)"
    )
    assert Verdict("S", None, (), None, None, None, "", None).effect == ""


def test_size_is_the_shift_over_the_distance_at_which_the_curve_has_halved():
    subject = Subject("S", [0.0, 0.2, 0.6], [0.3, 0.2, 0.1], [3, 4, 5], [10, 20, 30])
    for name in (
        "update",
        "constant error + sloped",
        "update + both ways + differencing",
        "none + differencing",
    ):
        posterior = posterior_of(subject, model=name)
        x = posterior.sample_prior(np.random.default_rng(3), 5)
        found = posterior.quantities(x)
        shift = found.get("offset", 0.0) - np.outer(
            subject.s1 - posterior.sbar, found.get("pull", np.zeros(5))
        )
        half = []
        for point in x:  # bisection on the curve of answers that depend on the stimuli
            low, high = 0.0, 60.0
            whole = replace(
                posterior, model=replace(posterior.model, link=posterior.model.link_without_lapses)
            )
            for _ in range(60):
                z = 0.5 * (low + high)
                top, here = whole.yes_at_distance(point[None], np.array([0.0, z]))[0]
                low, high = (z, high) if here > 0.5 * top else (low, z)
            half.append(low)
        size = np.sqrt(np.average(np.square(shift), axis=0, weights=subject.n_trials)) / (
            found["width"] * np.array(half)
        )
        np.testing.assert_allclose(effect_size(posterior, x), size, rtol=1e-9, atol=1e-12)


def test_halved_and_doubled_scales_are_those_of_fresh_runs(three_models):
    subject = bt.example_study()["S08"]
    said, _ = verdict(subject, DEFAULT, 1)
    numbers = DEFAULT.at(subject)
    for factor, p in zip((0.5, 2.0), said.varied, strict=True):
        other = replace(
            numbers, mu1_sd=factor * numbers.mu1_sd, offset_sd=factor * numbers.offset_sd
        )
        fresh, _ = verdict(subject, other, 2)
        np.testing.assert_allclose(p, fresh.p_orders, atol=0.015)
    assert all(
        low[0] < high[0] for low, high in pairwise([said.varied[0], said.p_orders, said.varied[1]])
    )


#: P(none), P(constant error), P(update) and the word, measured by another engine.
MEASURED = {
    "1008": (0.0, 0.0, 1.0, "has"),
    "1009": (0.53, 0.38, 0.09, "negligible"),
    "888": (0.16, 0.62, 0.22, "probably has"),
    "1012": (0.86, 0.11, 0.03, "probably none"),
}


@pytest.mark.parametrize("name", MEASURED)
def test_real_subjects_are_as_measured(name, real_data):
    study = bt.read_study(
        real_data / "vibrotactile_rate" / "trials.csv", bt.ReadOptions(equal_code="1")
    )
    said, _ = verdict(study[name], DEFAULT, 1)
    *orders, word = MEASURED[name]
    np.testing.assert_allclose(said.p_orders, orders, atol=0.02)
    assert said.effect == word
    assert said.fit == "described"


def test_the_scale_is_stated_with_its_own_probabilities():
    # 2 log B of 2, 6 and 10, as Kass and Raftery have them.
    assert [2 * least for least, _ in words.SCALE] == [10.0, 6.0, 2.0, 0.0]
    for least, shown in ((1.0, "0.73"), (3.0, "0.95"), (5.0, "0.993")):
        assert f"{1 / (1 + math.exp(-least)):.3f}".startswith(shown)
        assert shown in words.STATED
