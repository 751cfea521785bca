"""Value and gradient of every rung and of compositions with every part against hundreds of digits, and over the whole range of floats."""

import mpmath
import numpy as np
import pytest
from definitions import assert_agrees, terms
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from reference.hard_cases import hard_cases
from scipy.special import logit

from bayes_toe.data.study import Subject
from bayes_toe.errors import NumericalError
from bayes_toe.model.closed_form import MAX_PULL, pull, variance_ratio
from bayes_toe.model.ladder import MODELS, posterior_of
from bayes_toe.model.prior import Prior
from bayes_toe.model.record import Model
from bayes_toe.model.target import hessian, one_sided

CASES = hard_cases()


def test_points_in_blocks_are_points_one_by_one():
    posterior = posterior_of(CASES["400 pairs with 3 trials"])
    x = np.random.default_rng(0).normal(size=(500, 4))
    one_by_one = np.array([posterior.log_density(point)[0] for point in x])
    assert posterior.log_density(x) == pytest.approx(one_by_one, rel=1e-13)
    assert posterior.pair_log_likelihood(x).sum(axis=1) == pytest.approx(
        posterior.log_likelihood(x), rel=1e-13
    )


def test_nan_raises_and_impossible_is_minus_infinity():
    posterior = posterior_of(CASES["all equal"])
    with pytest.raises(NumericalError, match="NaN"):
        posterior.log_density([[np.nan, 0, 0, 0]])
    with pytest.raises(NumericalError, match="shape"):
        posterior.log_density([[0.0, 0.0]])
    # Width e^-400 and an unequal pair called equal: z^2 is beyond the largest float, the probability is 0 to all digits.
    assert posterior.log_density([[0.0, 0.0, -400.0, 0.0]])[0] == -np.inf
    # All 'different' there: P(different) is 1, so the log likelihood is exactly 0, not 0 times infinity.
    assert posterior_of(CASES["all different"]).log_likelihood([[0.1, 0.0, -400.0, 0.0]])[0] == 0.0


RUNGS = [model.name for model in MODELS if isinstance(model, Model)]
COMPOSED = [
    "constant error + sloped + both ways + exponent",
    "update + sloped + both ways + differencing + sloped peak",
    "update + sloped + both ways",
    "update + no lapses + exponent + beta-binomial",
    "free weighting + both ways + beta-binomial",
    "mean-reverting + sloped + exponent + beta-binomial",
]
OTHERS = {"offset_sd": 1.0, "noise_slope_sd": 1.0, "peak_slope_sd": 0.7, "reference_interval": 1.0}
PRIOR = Prior(mu1_mean=0.4, mu1_sd=2.0, sigma_p_scale=0.7, **OTHERS)
OF_WIDTH = Prior(mu1_mean=0.4, mu1_sd=2.0, width_median=0.3, width_sd=0.8, q0_a=4.0, **OTHERS)
FLAT = Prior(0.4, 1e30, 0.7, **OTHERS)
AT_INTERVALS = [
    "predictive update",
    "mean-reverting memory",
    "update + sloped + both ways",
    COMPOSED[-1],
]
#: Every model at one interval, and at several some of those to whom these say something: the others pool the answers.
OF_ALL = pytest.mark.parametrize(
    ("name", "isi"),
    [
        *((name, None) for name in RUNGS + COMPOSED),
        *((name, [0.25, 1.0, 2.0, 0.5, 8.0]) for name in AT_INTERVALS),
    ],
)


def subject(name, isi, scale=1.0, shift=0.0):
    """Beta-binomial answers go one by one: there a fifth of them, for time's sake."""
    s1, s2 = np.array([0.0, 0.0, 0.5, 0.25, 0.125]), np.array([0.0, 0.5, 0.0, 0.375, 0.75])
    scale = 0.2 if "beta-binomial" in name else scale
    return Subject(
        "S",
        s1 + shift,
        s2 + shift,
        *(
            (scale * np.array(part)).astype(int)
            for part in ([45, 20, 15, 30, 2], [50, 50, 50, 40, 50])
        ),
        isi,
    )


@OF_ALL
@settings(max_examples=6, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(data=st.data())
def test_every_rung(name, isi, data):
    target = posterior_of(
        subject(name, isi), data.draw(st.sampled_from([PRIOR, OF_WIDTH])), model=name
    )
    ranges = {"offset": (-0.6, 0.6), "log_width": (-2.0, 1.5), "log_exponent": (-1.6, 3.0)}
    ranges |= {
        "logit_pull": (-6, 6),
        "logit_split": (-6, 6),
        "logit_q0": (-6, 12),
        "logit_lapse_rate": (-12, 6),
        "logit_icc": (-20, 6),
    }
    # Subnormal ones left out: a displacement that underflows lies beyond the kink that an exponent of 1 has at z = 0.
    x = [
        data.draw(st.floats(*ranges.get(key, (-4.0, 4.0)), allow_subnormal=False), label=key)
        for key in target.coordinates
    ]
    z = target.distance(np.array([x]))[0]
    # Rounding a displacement costs what its cancellation costs: only pairs off the axis are held to 1e-12.
    assume(
        (np.abs(z) > 1e-2).all() if "exponent" in name else ((z == 0.0) | (np.abs(z) > 1e-2)).all()
    )
    assert_agrees(target, x)


FAR = {
    "logit_pull": [-80.0, -20.0, 25.0],
    "logit_split": [-30.0, 30.0],
    "logit_q0": [-25.0, 60.0, 100.0],
    "logit_gain": [-30.0, 30.0],
}
FAR |= {
    "noise_slope": [-40.0, 40.0],
    "peak_slope": [-40.0, 40.0],
    "logit_lapse_rate": [-60.0, 30.0],
    "log_exponent": [-1.6, 3.0],
    "logit_icc": [-60.0, 30.0],
}
MIDDLE = {
    "peak_slope": 0.6,
    "offset": 0.31,
    "log_width": -0.4,
    "logit_q0": 2.0,
    "logit_pull": 0.3,
    "logit_split": -0.2,
}
MIDDLE |= {
    "logit_gain": 0.4,
    "noise_slope": -0.3,
    "logit_lapse_rate": -1.7,
    "log_exponent": 0.4,
    "logit_icc": -3.0,
}


@OF_ALL
def test_far_out(name, isi):
    target = posterior_of(subject(name, isi, scale=1000.0, shift=1e6), FLAT, model=name)
    for key, values in {**FAR, "log_width": [-5.0, 3.0]}.items():
        for value in values if key in target.coordinates else ():
            x = [value if other == key else MIDDLE[other] for other in target.coordinates]
            if key == "logit_pull" and value < -30:
                x[0] = 1e-20  # mu1 within reach
            assert_agrees(target, x, digits=150)


@pytest.mark.parametrize(
    "name",
    [
        "predictive update",
        "constant error + sloped + both ways + exponent",
        "update + sloped + both ways",
    ],
)
def test_a_hessian_by_differences(name):
    target = posterior_of(subject(name, None), PRIOR, model=name)
    x = np.array([[MIDDLE[key] for key in target.coordinates]])
    with mpmath.workdps(80):
        h, unit, k = mpmath.mpf(10) ** -20, np.eye(x.shape[1], dtype=int), range(x.shape[1])

        def value(steps):
            return mpmath.fsum(
                terms(
                    target,
                    [mpmath.mpf(float(v)) + int(s) * h for v, s in zip(x[0], steps, strict=True)],
                )
            )

        def bend(e, f):
            return (value(e + f) - value(e - f) - value(f - e) + value(-e - f)) / (4 * h**2)

        exact = np.array([[float(bend(unit[i], unit[j])) for j in k] for i in k])

    def gradient(x):
        return target.gradient(x)[1]

    assert np.abs(hessian(gradient, x)[0] - exact).max() < 1e-7 * np.abs(exact).max()
    slopes, bends = one_sided(gradient, x, np.abs(np.diag(exact))[None])
    assert (slopes == gradient(x)).all()
    assert np.abs(bends[0] - exact).max() < 1e-5 * np.abs(exact).max()


powers = st.floats(-300, -1e-9).map(lambda e: 10.0**e)
counts = st.integers(0, 10**9)


@settings(max_examples=40, deadline=None, derandomize=True, database=None)
@given(
    gamma=powers,
    sigma_p=st.floats(-150, 150).map(lambda e: 10.0**e),
    lapse=st.one_of(powers, st.floats(0.01, 0.99)),
    z=st.one_of(
        st.just(0.0),
        st.floats(-160, 2).map(lambda e: 10.0**e),
        st.floats(2, 149).map(lambda e: 10.0**e),
    ),
    mu1=st.floats(-20, 20),
    answers=st.tuples(counts, counts),
)
def test_one_pair_over_the_whole_range_of_floats(gamma, sigma_p, lapse, z, mu1, answers):
    equal, different = answers
    if equal + different == 0:
        equal = 1
    assume(
        different < 1e300 * lapse
    )  # beyond, the odds of these answers at z = 0 are no floats, though the derivatives may be
    width, p = sigma_p * float(variance_ratio(gamma)) ** 1.5, float(pull(gamma))
    # sbar is the pair's own first stimulus, so the displacement is s2 - s1 - c: the second stimulus is placed z widths away.
    step = z * width + p * mu1
    assume(
        abs(step) < 1e150
    )  # beyond, the standard deviation of the stimuli, a prior's scale, is no float
    subject = Subject("S", [0.0], [step], [equal], [equal + different])
    posterior = posterior_of(subject, Prior())
    # 1 - q0 may be far below machine precision.
    x = [
        p * mu1,
        float(logit(p / MAX_PULL)),
        float(np.log(width)),
        float(np.log1p(-lapse) - np.log(lapse)),
    ]
    # Rounding the displacement itself costs what its cancellation costs: only well-conditioned displacements are held to 1e-12.
    if z == 0.0 or abs(x[0]) < 4 * abs(step - x[0]):
        x[0] = x[0] if z else step
        assert_agrees(posterior, x, digits=650)


@pytest.mark.parametrize("a", [-1e4, -745.0, 745.0, 1e4])
@pytest.mark.parametrize("top", [-1e4, -745.0, 745.0, 1e4])
def test_far_beyond_any_float_nothing_is_nan(a, top):
    s1, s2 = np.array([0.0, 0.0, 0.3]), np.array([0.0, 0.3, 0.0])
    posterior = posterior_of(Subject("S", s1, s2, [5, 2, 3], [10, 10, 10]), Prior())
    for c in (0.0, 1e-320, 0.5):
        assert not np.isnan(posterior.log_density([[c, a, 0.0, top]])[0])
