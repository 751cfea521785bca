"""The scale of words against the probabilities that it is stated with, and the words for an order effect."""

import math

import pytest

from bayes_toe.comparison import words


def test_the_scale_is_stated_with_its_own_probabilities():
    # 2 log B of 2, 6 and 10, as Kass and Raftery have them.
    assert [2 * least for least, _ in words.SCALE] == [10.0, 6.0, 2.0, 0.0]
    for least, shown in ((1.0, "0.73"), (3.0, "0.95"), (5.0, "0.993")):
        assert f"{1 / (1 + math.exp(-least)):.3f}".startswith(shown)
        assert shown in words.STATED


@pytest.mark.parametrize(
    ("found", "word"),
    [
        ((0.0, -0.9, -5.0), "undecided"),
        ((0.0, -1.0, -5.0), "no order effect"),
        ((-4.0, 0.0, -1.5), "constant error"),
        ((-4.0, -6.0, 0.0), "update"),
        ((-1.5, 0.0, -0.2), "some order effect"),
        ((-1.1, 0.0, -0.2), "undecided"),  # 0.9 nats from the second kind to none
        ((-0.5, 0.0, -3.0), "undecided"),
        (None, "no estimate"),
    ],
)
def test_words_for_an_order_effect(found, word):
    assert words.order_effect(found) == word
    assert word in words.order_effect_and_probability(found)


def test_probabilities_of_evidences_beyond_the_range_of_floats():
    assert words.probabilities((-2000.0, -2000.0 + math.log(3.0), -9000.0)) == pytest.approx((0.25, 0.75, 0.0))
