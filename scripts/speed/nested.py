"""dynesty and nautilus, each in natural coordinates through the prior's own transform, and in identified ones.

A nested sampler works on the unit cube. In identified coordinates the cube is mapped through wide Student-t distributions of
(offset, logit pull, log width) and the logistic of logit q0, and the ratio of posterior to that density takes the place of the
likelihood: same posterior, same evidence.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import stats
from scipy.special import log_expit, logit, ndtri, stdtrit

from bayes_toe.arrays import FloatArray
from bayes_toe.model.coordinates import natural
from bayes_toe.model.posterior import Posterior
from speed.agreement import require_same
from speed.cases import Case
from speed.method import Prepared
from speed.natural_target import NaturalTarget
from speed.outcome import WEIGHTED, Outcome, natural_draws

#: Base density of offset, logit pull and log width: Student-t, degrees of freedom, centres and scales.
_DF, _CENTRES, _SCALES = 4.0, np.array([0.0, 0.0, -1.0]), np.array([1.0, 3.0, 1.0])
_LOG_NORM = float(stats.t.logpdf(0.0, _DF, scale=_SCALES).sum())
LIVE, NETWORKS = 500, 1  # of nautilus: its defaults, 2,000 and 4, take minutes a subject
MAX_CALLS = 200_000  # of dynesty, and
_MAX_SECONDS = 90.0  # of nautilus: a run that reaches its limit says that it is not done


class NaturalCube:
    """The default prior as a map of the cube onto (mu1, sigma_p, gamma, q0), and the likelihood there."""

    def __init__(self, posterior: Posterior) -> None:
        self._prior, self._target = posterior.prior, NaturalTarget(posterior)

    def transform(self, u: FloatArray) -> FloatArray:
        """Cube (..., 4) to parameters (..., 4)."""
        mu1 = self._prior.mu1_mean + self._prior.mu1_sd * ndtri(u[..., 0])
        sigma_p = self._prior.sigma_p_scale * ndtri(0.5 + 0.5 * u[..., 1])
        return np.stack([mu1, sigma_p, u[..., 2], u[..., 3]], axis=-1)

    def log_likelihood(self, theta: FloatArray) -> FloatArray:
        """Parameters (..., 4) to log likelihood (...)."""
        mu1, sigma_p, gamma, q0 = np.moveaxis(np.atleast_2d(theta), -1, 0)
        value = self._target.log_likelihood(mu1, sigma_p, gamma, q0)
        return value if np.ndim(theta) > 1 else value[0]

    def natural(self, theta: FloatArray) -> FloatArray:
        """Parameters (draws, 4) to natural draws (1, draws, 4)."""
        return natural_draws(theta[:, 0], theta[:, 1], theta[:, 1] * np.sqrt(theta[:, 2]), theta[:, 3])


class IdentifiedCube:
    """A wide base density as a map of the cube onto x, and log posterior minus log base density there."""

    def __init__(self, posterior: Posterior) -> None:
        self._posterior = posterior

    def transform(self, u: FloatArray) -> FloatArray:
        """Cube (..., 4) to unconstrained coordinates (..., 4)."""
        return np.concatenate([_CENTRES + _SCALES * stdtrit(_DF, u[..., :3]), logit(u[..., 3:])], axis=-1)

    def log_base(self, x: FloatArray) -> FloatArray:
        """Log density of the base, (..., 4) -> (...)."""
        distance = np.square((x[..., :3] - _CENTRES) / _SCALES)
        wide = _LOG_NORM - 0.5 * (_DF + 1.0) * np.log1p(distance / _DF).sum(axis=-1)
        return np.asarray(wide + log_expit(x[..., 3]) + log_expit(-x[..., 3]))

    def log_likelihood(self, x: FloatArray) -> FloatArray:
        """Coordinates (..., 4) to what takes the place of the log likelihood (...)."""
        value = self._posterior.log_density(x) - self.log_base(np.atleast_2d(x))
        return value if np.ndim(x) > 1 else value[0]

    def natural(self, x: FloatArray) -> FloatArray:
        """Coordinates (draws, 4) to natural draws (1, draws, 4)."""
        return natural_draws(*self._posterior.natural(x))


Cube = NaturalCube | IdentifiedCube


def natural_cube(case: Case) -> Cube:
    """The natural cube, checked: log likelihood plus log prior is the posterior."""
    posterior = case.posterior
    cube = NaturalCube(posterior)

    def log_density(x: FloatArray) -> float:
        theta = natural(x, posterior.sbar)
        point = np.array([theta.mu1, theta.sigma_p, theta.gamma, theta.q0])
        return float(cube.log_likelihood(point) + posterior.prior.log_density(theta))

    require_same(posterior, log_density, natural=True, coefficients=False)
    return cube


def identified_cube(case: Case) -> Cube:
    """The identified cube, checked: its map has the base density, by differences along each axis."""
    cube = IdentifiedCube(case.posterior)
    u, step = np.random.default_rng(1).uniform(0.05, 0.95, (20, 4)), 1e-6
    slopes = [(cube.transform(u + step * e)[:, i] - cube.transform(u - step * e)[:, i]) / (2 * step) for i, e in enumerate(np.eye(4))]
    if not np.allclose(-np.log(slopes).sum(axis=0), cube.log_base(cube.transform(u)), atol=1e-5):
        raise AssertionError("the base density of the identified cube is not that of its map")
    return cube


def dynesty_with(cube_of: Callable[[Case], Cube]) -> Callable[[Case], Prepared]:
    """Static nested sampling with the library's defaults; effort is the number of live points."""

    def prepare(case: Case) -> Prepared:
        import dynesty

        cube = cube_of(case)

        def run(effort: int, seed: int) -> Outcome:
            sampler = dynesty.NestedSampler(cube.log_likelihood, cube.transform, 4, nlive=effort, rstate=np.random.default_rng(seed))
            sampler.run_nested(print_progress=False, maxcall=MAX_CALLS)
            found = sampler.results
            calls, log_z, error = int(np.sum(found.ncall)), float(found.logz[-1]), float(found.logzerr[-1])
            done = calls < MAX_CALLS
            return Outcome(
                WEIGHTED,
                cube.natural(found.samples),
                np.asarray(found.logwt) - log_z,
                calls,
                log_evidence=log_z,
                log_evidence_se=error,
                verdict=lambda: (done, f"{calls} calls"),
            )

        return Prepared(run)

    return prepare


def nautilus_with(cube_of: Callable[[Case], Cube]) -> Callable[[Case], Prepared]:
    """Importance nested sampling, vectorised, with few live points and networks; effort is the number of effective draws."""

    def prepare(case: Case) -> Prepared:
        import nautilus

        cube = cube_of(case)

        def run(effort: int, seed: int) -> Outcome:
            sampler = nautilus.Sampler(
                cube.transform, cube.log_likelihood, n_dim=4, n_live=LIVE, n_networks=NETWORKS, vectorized=True, seed=seed
            )
            done = bool(sampler.run(n_eff=effort, timeout=_MAX_SECONDS))
            x, log_weights, _ = sampler.posterior()
            # It states no standard error; its documentation says what its effective sample size implies: n_eff^(-1/2).
            return Outcome(
                WEIGHTED,
                cube.natural(x),
                log_weights,
                int(sampler.n_like),
                log_evidence=float(sampler.log_z),
                log_evidence_se=float(sampler.n_eff) ** -0.5,
                verdict=lambda: (done, f"n_eff {sampler.n_eff:.0f}"),
            )

        return Prepared(run)

    return prepare
