"""Group scales of every composition: there and back, and Jacobians against the definitions in 260 digits, far into both tails."""

import mpmath
import numpy as np
import pytest

from bayes_toe.data.study import Subject
from bayes_toe.model.ladder import posterior_of
from bayes_toe.model.parts import compose, compositions
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior

SUBJECT = Subject("A", [0.1, 0.3, 0.6], [0.1, 0.5, 0.2], [9, 4, 5], [10, 10, 10])
#: Each order with all other parts: between them they have every block.
ORDERS = ("none", "constant error", "update", "free weighting", "mean-reverting")
ALL = {
    "noise": "sloped",
    "lapses": "both ways",
    "curve": "exponent",
    "peak": "sloped peak",
    "spread": "beta-binomial",
}
FULL = [compose(order=order, **ALL).name for order in ORDERS]


#: Quantities that have a probit, or a logarithm, for a group scale.
PROBITS = ["gamma", "q0", "lapse_rate", "icc", "pull", "split", "gain", "carry_over"]
LOGS = ["width", "exponent", "carry_over_tau", "half_life"]


def posterior(name):
    return posterior_of(SUBJECT, model=name)


def logit(share):
    return mpmath.log(share / (1 - share))


def by_definition(names, eta, sbar):
    """Coordinates from group parameters, written down without stable forms."""
    at, x = dict(zip(names, eta, strict=True)), []
    for name in names:
        share = mpmath.ncdf(at[name])
        if name == "mu1":
            x.append(pull_of(at) * (at[name] - sbar))
        elif name == "gamma":
            x.append(logit(2 * pull_of(at) / (3 - mpmath.sqrt(5))))
        else:
            x.append(logit(share) if name in PROBITS else at[name])
    return x


def pull_of(at):
    if "pull" in at:
        return mpmath.ncdf(at["pull"])
    ratio = (1 + mpmath.sqrt(1 + 4 * mpmath.ncdf(at["gamma"]))) / 2
    return (ratio - 1) / ratio


def jacobian_by_definition(names, eta, sbar):
    h, columns = mpmath.mpf(10) ** -40, []
    for j in range(len(eta)):
        up, down = (
            by_definition(names, [e + sign * h * (i == j) for i, e in enumerate(eta)], sbar)
            for sign in (1, -1)
        )
        columns.append([(a - b) / (2 * h) for a, b in zip(up, down, strict=True)])
    return np.array([[float(value) for value in column] for column in columns]).T


def points(names, far):
    rng = np.random.default_rng(3)
    ordinary = rng.standard_normal((3, len(names)))
    probit = np.array([name in PROBITS for name in names])
    tails = np.where(
        probit,
        rng.choice([-1.0, 1.0], (3, len(names))) * rng.uniform(5.0, 30.0, (3, len(names))),
        ordinary,
    )
    widths = np.where(
        [name in LOGS for name in names],
        rng.uniform(-50.0, 50.0, (3, len(names))),
        tails,
    )
    return widths if far else ordinary


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize("name", FULL)
def test_coordinates_and_jacobian_are_those_of_the_definitions(name, far):
    target = posterior(name)
    with mpmath.workdps(260):
        for eta in points(target.model.group, far):
            x, jacobian = target.from_group(eta[None])
            exact = [mpmath.mpf(float(e)) for e in eta]
            assert x[0] == pytest.approx(
                [
                    float(v)
                    for v in by_definition(target.model.group, exact, mpmath.mpf(target.sbar))
                ],
                rel=2e-13,
                abs=1e-300,
            )
            wanted = jacobian_by_definition(target.model.group, exact, mpmath.mpf(target.sbar))
            assert jacobian[0] == pytest.approx(wanted, rel=2e-12, abs=1e-300)


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize(
    "model", compositions(order=ORDERS, lapses=("misses", "no lapses", "both ways"))
)
def test_there_and_back(model, far):
    target = posterior(model.name)
    assert len(target.model.group) == len(target.coordinates) == len(set(target.model.group))
    eta = points(target.model.group, far)
    back = target.to_group(target.from_group(eta)[0])
    # A pull near its least, p ~ e^-450, leaves of mu1 what (p mu1)/p has.
    assert back == pytest.approx(eta, rel=1e-11, abs=1e-11)


def test_members_of_a_group_have_one_centre():
    here, there = (
        Posterior(SUBJECT, posterior("update").model, Prior(), centre=centre)
        for centre in (0.0, 2.0)
    )
    eta = np.array([[0.7, -0.3, -1.0, 1.2]])
    shift = here.from_group(eta)[0] - there.from_group(eta)[0]
    assert shift[0] == pytest.approx(
        [2.0 * here.model.free[0].group_pull(eta[:, 1]).pull[0], 0.0, 0.0, 0.0]
    )
