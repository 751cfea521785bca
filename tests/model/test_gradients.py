"""Every rung and compositions with every part: value and gradient against hundreds of digits; Hessians by differences of gradients."""

import mpmath
import numpy as np
import pytest
from definitions import assert_agrees, terms
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st

from bayes_toe.data.study import Subject
from bayes_toe.model.ladder import MODELS, posterior_of
from bayes_toe.model.posterior import Model
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import hessian, one_sided

RUNGS = [model.name for model in MODELS if isinstance(model, Model)]
COMPOSED = [
    "none + sloped + both ways",
    "constant error + sloped + both ways + exponent",
    "constant error + both ways + differencing",
    "update + sloped + both ways",
    "update + no lapses + exponent + beta-binomial",
    "free weighting + both ways + beta-binomial",
    "mean-reverting + sloped + exponent + beta-binomial",
]
PRIOR = Prior(mu1_mean=0.4, mu1_sd=2.0, sigma_p_scale=0.7, offset_sd=1.0, reference_interval=1.0)
FLAT = Prior(0.4, 1e30, 0.7, offset_sd=1.0, reference_interval=1.0)
INTERVALS = pytest.mark.parametrize("isi", [None, [0.25, 1.0, 2.0, 0.5, 8.0]], ids=["one interval", "intervals"])


def subject(name, isi, scale=1.0):
    """Beta-binomial answers go one by one: there a fifth of them, for time's sake."""
    s1, s2 = [0.0, 0.0, 0.5, 0.25, 0.125], [0.0, 0.5, 0.0, 0.375, 0.75]
    scale = 0.2 if "beta-binomial" in name else scale
    return Subject("S", s1, s2, *((scale * np.array(part)).astype(int) for part in ([45, 20, 15, 30, 2], [50, 50, 50, 40, 50])), isi)


@INTERVALS
@pytest.mark.parametrize("name", RUNGS + COMPOSED)
@settings(max_examples=15, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(data=st.data())
def test_every_rung(name, isi, data):
    target = posterior_of(subject(name, isi), PRIOR, model=name)
    ranges = {"offset": (-0.6, 0.6), "offset_score": (-0.6, 0.6), "log_width": (-2.0, 1.5), "log_exponent": (-1.6, 3.0)}
    ranges |= {"logit_pull": (-6, 6), "logit_split": (-6, 6), "logit_q0": (-6, 12), "logit_lapse_rate": (-12, 6), "logit_icc": (-20, 6)}
    # Subnormal ones left out: a displacement that underflows lies beyond the kink that an exponent of 1 has at z = 0.
    x = [data.draw(st.floats(*ranges.get(key, (-4.0, 4.0)), allow_subnormal=False), label=key) for key in target.coordinates]
    z = target.distance(np.array([x]))[0]
    # Rounding a displacement costs what its cancellation costs: only pairs off the axis are held to 1e-12.
    assume((np.abs(z) > 1e-2).all() if "exponent" in name else ((z == 0.0) | (np.abs(z) > 1e-2)).all())
    assert_agrees(target, x)


FAR = {"logit_pull": [-80.0, -20.0, 25.0], "logit_split": [-30.0, 30.0], "logit_q0": [-25.0, 60.0, 100.0], "logit_gain": [-30.0, 30.0]}
FAR |= {"noise_slope": [-40.0, 40.0], "logit_lapse_rate": [-60.0, 30.0], "log_exponent": [-1.6, 3.0], "logit_icc": [-60.0, 30.0]}
MIDDLE = {"offset": 0.31, "offset_score": 0.31, "log_width": -0.4, "logit_q0": 2.0, "logit_pull": 0.3, "logit_split": -0.2}
MIDDLE |= {"logit_gain": 0.4, "noise_slope": -0.3, "logit_lapse_rate": -1.7, "log_exponent": 0.4, "logit_icc": -3.0}


@INTERVALS
@pytest.mark.parametrize("name", RUNGS + COMPOSED)
def test_far_out(name, isi):
    target = posterior_of(subject(name, isi, scale=1000.0), FLAT, model=name)
    for key, values in {**FAR, "log_width": [-5.0, 3.0]}.items():
        for value in values if key in target.coordinates else ():
            x = [value if other == key else MIDDLE[other] for other in target.coordinates]
            if key == "logit_pull" and value < -30:
                x[0] = 1e-20  # mu1 within reach
            assert_agrees(target, x, digits=300)


@pytest.mark.parametrize("name", ["predictive update", "constant error + sloped + both ways + exponent", "update + sloped + both ways"])
def test_a_hessian_by_differences(name):
    target = posterior_of(subject(name, None), PRIOR, model=name)
    x = np.array([[MIDDLE[key] for key in target.coordinates]])
    with mpmath.workdps(80):
        h, unit, k = mpmath.mpf(10) ** -20, np.eye(x.shape[1], dtype=int), range(x.shape[1])

        def value(steps):
            return mpmath.fsum(terms(target, [mpmath.mpf(float(v)) + int(s) * h for v, s in zip(x[0], steps, strict=True)]))

        def bend(e, f):
            return (value(e + f) - value(e - f) - value(f - e) + value(-e - f)) / (4 * h**2)

        exact = np.array([[float(bend(unit[i], unit[j])) for j in k] for i in k])

    def gradient(x):
        return target.gradient(x)[1]

    assert np.abs(hessian(gradient, x)[0] - exact).max() < 1e-7 * np.abs(exact).max()
    slopes, bends = one_sided(gradient, x, np.abs(np.diag(exact))[None])
    assert (slopes == gradient(x)).all()
    assert np.abs(bends[0] - exact).max() < 1e-5 * np.abs(exact).max()
