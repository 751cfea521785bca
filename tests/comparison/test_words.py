"""The scale of words against the probabilities that it is stated with."""

import math

from bayes_toe.comparison import words


def test_the_scale_is_stated_with_its_own_probabilities():
    # 2 log B of 2, 6 and 10, as Kass and Raftery have them.
    assert [2 * least for least, _ in words.SCALE] == [10.0, 6.0, 2.0, 0.0]
    for least, shown in ((1.0, "0.73"), (3.0, "0.95"), (5.0, "0.993")):
        assert f"{1 / (1 + math.exp(-least)):.3f}".startswith(shown)
        assert shown in words.STATED
