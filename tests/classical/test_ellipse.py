"""The ellipse that holds a share of a cloud, against clouds whose answer is known."""

import numpy as np
import pytest

from bayes_toe.classical.ellipse import mass_ellipse
from bayes_toe.errors import InputError


def inside(ellipse, x, y):
    turn = np.array([[np.cos(ellipse.angle), np.sin(ellipse.angle)], [-np.sin(ellipse.angle), np.cos(ellipse.angle)]])
    u = turn @ (np.stack([x, y]) - ellipse.centre[:, None])
    return np.square(u / ellipse.half_axes[:, None]).sum(axis=0) <= 1.0 + 1e-9


@pytest.mark.parametrize("mass", [0.05, 0.2, 0.5, 0.9])
def test_a_normal_cloud_gives_the_level_curve_around_its_peak(mass):
    rng = np.random.default_rng(3)
    x, y = rng.multivariate_normal([2.0, -1.0], [[4.0, 1.5], [1.5, 1.0]], size=40_000).T
    found = mass_ellipse(x, y, mass)
    variances, axes = np.linalg.eigh([[4.0, 1.5], [1.5, 1.0]])
    assert inside(found, x, y).mean() == pytest.approx(mass, abs=1e-4)
    assert found.half_axes == pytest.approx(np.sqrt(-2.0 * np.log1p(-mass) * variances[::-1]), rel=0.12)
    assert abs(np.sin(found.angle - np.arctan2(axes[1, 1], axes[0, 1]))) < 0.1
    assert found.centre == pytest.approx([2.0, -1.0], abs=0.25)


def test_a_funnel_is_taken_at_its_peak_where_the_covariance_of_all_points_fails():
    rng = np.random.default_rng(4)
    x, y = -0.3 - rng.pareto(0.8, 20_000), rng.normal(0.25, 0.05, 20_000)  # a tail without a mean
    found = mass_ellipse(x, y)
    assert inside(found, x, y).mean() == pytest.approx(0.2, abs=1e-4)
    assert -0.8 < found.centre[0] < -0.3
    assert found.half_axes.max() < 0.5
    assert np.std(x) > 10


def test_infinite_and_missing_points_count_as_outside():
    rng = np.random.default_rng(6)
    x, y = rng.normal(size=(2, 1000))
    x[:300], y[300:400] = np.inf, np.nan
    with np.errstate(invalid="ignore"):
        assert inside(mass_ellipse(x, y), x, y).sum() == 200
    assert mass_ellipse(x, y, 0.7) is None


@pytest.mark.parametrize(
    ("x", "y"),
    [([0.0], [1.0]), (np.zeros(100), np.arange(100.0)), (np.arange(100.0), 2.0 * np.arange(100.0))],
    ids=["one point", "constant", "on a line"],
)
def test_what_fixes_no_ellipse_gives_none(x, y):
    assert mass_ellipse(x, y) is None
    with pytest.raises(InputError, match=r"mass=1\.0"):
        mass_ellipse(x, y, 1.0)
