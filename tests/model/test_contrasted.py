"""The joint posterior of a subject's conditions: gradients, and what nothing that differs means."""

import numpy as np
import pytest

import bayes_toe as bt
from bayes_toe.data.conditions import Conditions, felt_together
from bayes_toe.data.study import pooled
from bayes_toe.data.tasks import SAME_DIFFERENT, WHICH_STRONGER
from bayes_toe.model.contrasted import contrasted
from bayes_toe.model.parts import composition

S1, S2 = np.array([0.0, 0.3, 0.3, 0.9, 1.2]), np.array([0.3, 0.0, 0.7, 0.5, 1.2])


def units(
    task=WHICH_STRONGER,
    counts=((5, 2, 9, 1, 4), (9, 4, 10, 2, 7), (8, 3, 9, 4, 6)),
    scale=1.0,
    shift=0.0,
):
    answers = zip("abc", counts, strict=False)
    s1, s2 = scale * S1 + shift, scale * S2 + shift
    return felt_together(
        bt.Subject(f"S@{at}", s1, s2, k, [12] * 5, task=task, condition=at) for at, k in answers
    )


def joint(model, differing, task=WHICH_STRONGER, **how):
    of = units(task, **how)
    design = Conditions("c", tuple(one.condition for one in of)).design()
    return contrasted(composition(model, task).posterior(pooled(of)), of, design, differing)


@pytest.mark.parametrize(
    ("model", "task"),
    [
        ("contraction + sloped", WHICH_STRONGER),
        ("update", WHICH_STRONGER),
        ("free weighting + biased guesses", WHICH_STRONGER),
        ("none", WHICH_STRONGER),
        ("contraction + sloped + both ways", SAME_DIFFERENT),
        ("update + differencing", SAME_DIFFERENT),
        ("constant error", SAME_DIFFERENT),
    ],
)
def test_gradient_and_what_happens_where_nothing_differs(model, task):
    target = joint(model, ("constant error", "lapses", "pull", "width"), task)
    rng, k = np.random.default_rng(1), len(target.model.coordinates)
    x = target.starts()[:4] + 0.1 * rng.standard_normal((4, len(target.coordinates)))
    value, gradient = target.gradient(x)
    np.testing.assert_allclose(value, target.log_density(x), rtol=1e-12)
    steps = 1e-6 * np.eye(x.shape[1])
    numeric = np.stack(
        [(target.log_density(x + step) - target.log_density(x - step)) / 2e-6 for step in steps],
        axis=1,
    )
    np.testing.assert_allclose(gradient, numeric, rtol=1e-5, atol=1e-5)
    same = target.without_differences(x[:, :k])
    np.testing.assert_allclose(
        target.log_likelihood(same), target.pooled.log_likelihood(x[:, :k]), rtol=1e-12
    )
    np.testing.assert_allclose(
        target.in_conditions(same), np.repeat(x[:, None, :k], 3, axis=1), rtol=1e-9, atol=1e-9
    )
    levelling = target.levelling(x)
    np.testing.assert_allclose(levelling.unlevel(levelling.level(x)[0])[0], x, rtol=1e-9, atol=1e-9)


def test_any_two_levels_differ_by_half_a_unit():
    target = joint("contraction", ("constant error", "pull", "width"))
    drawn = target.sample_prior(np.random.default_rng(1), 20_000)
    x, step = target.in_conditions(drawn), target.prior.distribution("offset").spread
    for i, j in ((0, 1), (0, 2), (1, 2)):
        apart = x[:, i] - x[:, j]
        assert apart[:, 0].std() == pytest.approx(0.5 * step, rel=0.03)
        assert apart[:, 2].std() == pytest.approx(0.5, rel=0.03)
