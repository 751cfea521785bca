"""Many subjects in one call: value and gradient of each are those of its own posterior, for every composition."""

import numpy as np
import pytest

from bayes_toe.data.study import Subject
from bayes_toe.groups.members import MembersLikelihood
from bayes_toe.model.crowd import crowd_posterior
from bayes_toe.model.parts import compose
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior

ORDERS = ("none", "constant error", "update", "free weighting", "mean-reverting")
#: Every level of every part with every order.
OTHERS = (
    {},
    {"noise": "sloped", "lapses": "both ways", "spread": "beta-binomial"},
    {"lapses": "no lapses"},
    {"curve": "differencing", "spread": "beta-binomial"},
    {"curve": "exponent", "lapses": "no lapses", "noise": "sloped"},
    {"curve": "exponent", "lapses": "both ways"},
    {"curve": "differencing", "lapses": "both ways"},
)
MODELS = [compose(order=order, **levels) for order in ORDERS for levels in OTHERS]
CENTRE, REFERENCE = 0.2, 0.7
PRIOR = Prior(offset_sd=1.0, reference_interval=REFERENCE)


def subjects(intervals):
    """Six: other pairs, other numbers of them, one pair only, all 'equal', none 'equal', one trial."""
    rng, made = np.random.default_rng(5), []
    for i, pairs in enumerate((9, 4, 1, 6, 5, 1)):
        s1, s2 = rng.normal(0.3, 0.3, (2, pairs))
        s2 = np.where(rng.uniform(size=pairs) < 0.3, s1, s2)
        n = rng.integers(1, 40, pairs) if i != 5 else np.array([1])
        k = n if i == 3 else 0 * n if i == 4 else rng.binomial(n, 0.6)
        isi = rng.choice([0.4, 0.9, 2.0], pairs) if intervals else None
        made.append(Subject(f"S{i}", s1, s2, k, n, isi=isi))
    return made


@pytest.mark.parametrize("intervals", [False, True], ids=["", "intervals"])
@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_of_each_what_its_own_posterior_has(model, intervals):
    people, rng = subjects(intervals), np.random.default_rng(7)
    crowd = crowd_posterior(model, PRIOR, people, CENTRE, REFERENCE)
    assert crowd.model.group == model.group
    for spread in (0.7, 4.0):
        eta = rng.normal(0.0, spread, (len(people), len(model.coordinates)))
        x, jacobian = crowd.from_group(eta)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            value, gradient = crowd.likelihood_gradient(x)
            assert value == pytest.approx(crowd.pair_log_likelihood(x).sum(axis=1), rel=1e-13, abs=1e-13)
        for i, one in enumerate(people):
            own = Posterior(one, model, PRIOR, centre=CENTRE)
            x_own, jacobian_own = own.from_group(eta[i : i + 1])
            assert x[i] == pytest.approx(x_own[0], rel=1e-13)
            assert jacobian[i] == pytest.approx(jacobian_own[0], rel=1e-13, abs=1e-300)
            wanted = own.log_likelihood(x_own)[0]
            assert value[i] == pytest.approx(wanted, rel=1e-13, abs=1e-13)
            if np.isfinite(wanted):
                steep = own.likelihood_gradient(x_own)[1][0]
                assert gradient[i] == pytest.approx(steep, rel=1e-12, abs=1e-12 * (1.0 + np.abs(steep).max()))


@pytest.mark.parametrize("model", MODELS[:: len(OTHERS)] + MODELS[1 :: len(OTHERS)], ids=lambda model: model.name)
def test_blocks_of_members_change_nothing_and_the_gradient_is_the_slope(model, monkeypatch):
    people, copies, rng = subjects(True), 3, np.random.default_rng(8)
    eta = rng.normal(0.0, 0.6, (copies, len(people), len(model.coordinates)))
    whole = MembersLikelihood(model, PRIOR, people, CENTRE, copies)
    value, gradient = whole(eta)
    monkeypatch.setattr("bayes_toe.groups.members._BLOCK", 32)  # three or four rows a block
    for one, other in zip((value, gradient), MembersLikelihood(model, PRIOR, people, CENTRE, copies)(eta), strict=True):
        assert one == pytest.approx(other, rel=1e-13, abs=1e-12)
    for j in range(eta.shape[-1]):
        h = 1e-4 * np.eye(eta.shape[-1])[j]
        (a, _), (b, _), (c, _), (d, _) = (whole(eta + f * h) for f in (-2.0, -1.0, 1.0, 2.0))
        slope = (a - 8.0 * b + 8.0 * c - d) / 12e-4
        assert gradient[..., j] == pytest.approx(slope, rel=2e-7, abs=2e-7 * (1.0 + np.abs(value).max()))


def test_a_pair_never_shown_adds_nothing_where_an_answer_is_impossible():
    """No lapses: two equal stimuli are never called different, and the pairs that fill a row up are such."""
    model = compose(order="none", lapses="no lapses")
    people = [Subject("A", [0.0, 0.1, 0.2], [0.3, 0.4, 0.2], [3, 4, 9], [9, 9, 9]), Subject("B", [0.0], [0.3], [2], [5])]
    value, gradient = MembersLikelihood(model, PRIOR, people, 0.0, 1)(np.array([[[-1.0], [-1.0]]]))
    own = [Posterior(one, model, PRIOR, centre=0.0).log_likelihood([[-1.0]])[0] for one in people]
    assert value[0] == pytest.approx(own, rel=1e-14)
    assert np.isfinite(gradient).all()


def test_an_impossible_answer_is_minus_infinity_for_its_member_only():
    model = compose(order="none", lapses="no lapses")
    people = [Subject("A", [0.0, 0.1], [0.0, 0.4], [8, 4], [9, 9]), Subject("B", [0.0], [0.3], [2], [5])]
    with np.errstate(divide="ignore", invalid="ignore"):
        value, _ = MembersLikelihood(model, PRIOR, people, 0.0, 1)(np.full((1, 2, 1), -1.0))
    assert value[0, 0] == -np.inf
    assert np.isfinite(value[0, 1])
