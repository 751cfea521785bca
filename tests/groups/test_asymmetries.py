"""Asymmetries of a population: of a known subject where nobody differs, by plain Monte Carlo where they do, and by level."""

import numpy as np
import pytest
from populations import CENTRE, SIZE, made_up
from scipy import stats

import bayes_toe as bt
from bayes_toe.data.covariates import Covariates
from bayes_toe.data.tasks import WHICH_STRONGER
from bayes_toe.groups.regressors import regressors

OVERALL = "P(equal) stronger first less weaker first"
DESIGN = (
    [0.0, 0.3, 0.0, 0.5, 0.2, 0.2],
    [0.3, 0.0, 0.5, 0.0, 0.2, 0.4],
)  # two pairs in both orders, (0.2, 0.4) in one only


def study(names="abcde", far=0.0, **more):
    """Of the design, somewhere."""
    s1, s2 = (np.add(stimuli, far) for stimuli in DESIGN)
    return bt.Study(
        [bt.Subject(name, s1, s2, [20, 30, 10, 25, 45, 9], [50] * 6, **more) for name in names]
    )


def test_where_nobody_differs_it_is_that_of_the_subject_at_the_mean():
    same = np.broadcast_to(CENTRE, (*SIZE, 4))
    found = made_up(study(), scatter=1e-9, mean=same)
    at = {name: values[0, 0] for name, values in found.quantities(same).items()}
    q = bt.model.equal_probability(
        *map(np.array, DESIGN), at["mu1"], at["sigma_p"], at["sigma_l"], at["q0"]
    )
    expected = [q[1] - q[0], q[3] - q[2]]  # the stronger one first, less the weaker one first
    assert expected[0] > 0.05  # as for a prior mean below the stimuli
    assert found.asymmetries.levels == ("",)
    assert found.asymmetries.comparisons[1:] == (
        "P(equal) 0.3 then 0 less 0 then 0.3",
        "P(equal) 0.5 then 0 less 0 then 0.5",
    )
    for values in (found.asymmetries.draws[:, :, 0], found.asymmetries.new_subject[..., None]):
        assert np.allclose(values[..., 0], np.mean(expected), rtol=0, atol=1e-6)
    assert np.allclose(found.asymmetries.draws[0, 0, 0, 1:], expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", ["normal", "t", "correlated"])
def test_the_average_is_that_of_many_subjects(kind):
    """Against 40,000 subjects for one draw: four standard errors of these, and the fixed scores' own error."""
    rng, z = (
        np.random.default_rng(4),
        np.broadcast_to(np.arctanh([0.9, 0.9, 0.9, 0, 0, 0]), (*SIZE, 6)),
    )
    of = {"kind": "t"} if kind == "t" else {"z": z} if kind == "correlated" else {}
    found = made_up(study(), mean=np.broadcast_to(CENTRE, (*SIZE, 4)), scatter=0.5, **of)
    u = rng.standard_t(4, (40_000, 4)) if kind == "t" else rng.standard_normal((40_000, 4))
    at = found.quantities(CENTRE + 0.5 * u @ np.linalg.cholesky(found.chains.correlation[0, 0]).T)
    one, other = (
        bt.model.equal_probability(s1, s2, at["mu1"], at["sigma_p"], at["sigma_l"], at["q0"])
        for s1, s2 in ((0.3, 0.0), (0.0, 0.3))
    )
    many = np.ravel(one - other)
    assert found.asymmetries.draws[0, 0, 0, 1] == pytest.approx(
        many.mean(), abs=4 * many.std() / 200 + 0.03 * many.std()
    )


def test_levels_differ_by_their_effects():
    ages, groups = (
        dict(zip("abcde", values, strict=True))
        for values in ((20.0, 30.0, 50.0, 40.0, 33.0), "xyzxx")
    )
    effects = np.zeros((*SIZE, 3, 4))
    effects[..., 2, 0] = 2.0  # of level z on mu1: far above the stimuli
    found = made_up(
        study(), regressors(Covariates({"age": ages, "group": groups}), "abcde"), effects=effects
    )
    every = found.asymmetries
    assert every.levels == (
        "",
        "age +1 sd - mean",
        "group x",
        "group y",
        "group z",
        "group y - x",
        "group z - x",
    )
    at = dict(zip(every.levels, np.moveaxis(every.draws[..., 0], -1, 0), strict=True))
    assert np.allclose(at["group z - x"], at["group z"] - at["group x"], rtol=0, atol=1e-12)
    assert not at["age +1 sd - mean"].any()
    assert not at["group y - x"].any()
    assert (at["group x"] > 0.1).all()
    assert (at["group z"] < -0.1).all()
    share = (at[""] - at["group x"]) / at["group z - x"]  # one of five subjects
    assert np.allclose(share, 0.2, rtol=0, atol=0.06)
    rows = {row.level: row for row in found.table.some("asymmetry", OVERALL)}
    assert tuple(rows) == every.levels
    assert (rows["group z - x"].p_direction, rows["group x"].p_direction) == (1.0, 1.0)
    assert rows["group z"].mean == pytest.approx(at["group z"].mean())


def test_of_which_is_stronger_it_is_the_difference_of_errors():
    """Who calls the second stimulus the stronger one too often errs where the stronger one is first."""
    asked, centre = (
        study(task=WHICH_STRONGER),
        np.array([-0.1, 0.0, -1.2, -2.0]),
    )  # constant error, gain 1, width, lapses
    same = np.broadcast_to(centre, (*SIZE, 4))
    found = made_up(asked, scatter=1e-9, mean=same, model="free weighting").asymmetries
    width, lapses = np.exp(-1.2), stats.norm.cdf(-2.0)
    second = [
        lapses / 2 + (1 - lapses) * stats.norm.cdf((s2 - s1 + 0.1) / width)
        for s1, s2 in ((0.3, 0.0), (0.0, 0.3))
    ]
    assert found.comparisons[:2] == (
        "P(wrong) stronger first less weaker first",
        "P(wrong) 0.3 then 0 less 0 then 0.3",
    )
    assert np.allclose(found.draws[0, 0, 0, 1], second[0] - (1.0 - second[1]), rtol=0, atol=1e-6)
    assert found.draws.min() > 0.0


def test_pairs_at_several_intervals_are_told_apart():
    found = made_up(study(isi=[1.0, 1.0, 1.0, 2.0, 1.0, 1.0]))
    assert found.asymmetries.comparisons[1:] == ("P(equal) 0.3 then 0 less 0 then 0.3, 1 s",)


def test_stimuli_of_each_subject_are_judged_from_its_own_mean():
    """Offsets count from everybody's own mean: wherever somebody's stimuli lie, a pair is as far from it."""
    centre = np.array(
        [0.05, -0.5, -1.2, 1.5]
    )  # constant error, probit(gain/2), log width, probit q0
    same = {"model": "free weighting", "scatter": 1e-9, "mean": np.broadcast_to(centre, (*SIZE, 4))}
    apart = made_up(bt.Study([*study("a"), *study("b", far=5.0)]), **same).asymmetries
    alone = made_up(study("ab"), **same).asymmetries
    first, second = apart.draws[..., 1:3], apart.draws[..., 3:]
    assert np.allclose(first, second, rtol=0, atol=1e-12)
    assert np.allclose(first, alone.draws[..., 1:], rtol=0, atol=1e-12)
    assert np.ptp(first) > 0.01
