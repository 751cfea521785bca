"""A mixture of multivariate Student-t densities: evaluate, draw, and fit to weighted points by EM.

Two choices make it cheap, and fitting a proposal is mostly this. The distances of all points to all components are one matrix product,
of the components' quadratic forms with the points' monomials up to second order, counted from the mixture's mean. And half the sum of
degrees of freedom and dimension is a whole number, so that each density is a power by multiplication, without a logarithm.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln

FloatArray = npt.NDArray[np.float64]
_BLOCK = 1024  # points done together: with some tens of components the temporary arrays stay in the processor's cache


@dataclass(frozen=True, eq=False)
class StudentMixture:
    """Mixture of J Student-t components in D dimensions.

    Parameters
    ----------
    weights : array, shape (J,)
        Positive, summing to 1.
    means : array, shape (J, D)
    scales : array, shape (J, D, D)
        Scale matrices (not covariances), positive definite.
    df : int
        Degrees of freedom, common to all components; df + D is even.

    Raises
    ------
    ValueError
        If df + D is odd.

    Examples
    --------
    >>> one = StudentMixture(np.ones(1), np.zeros((1, 1)), np.ones((1, 1, 1)), df=1)
    >>> bool(np.isclose(np.exp(one.log_density(np.zeros((1, 1))))[0], 1 / np.pi))
    True
    """

    weights: FloatArray
    means: FloatArray
    scales: FloatArray
    df: int
    _factors: FloatArray = field(init=False, repr=False)
    _centre: FloatArray = field(init=False, repr=False)
    _forms: FloatArray = field(init=False, repr=False)  # times monomials: 1 + distance / df
    _tops: FloatArray = field(init=False, repr=False)  # of the components' densities, over the highest
    _log_highest: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        dim = self.means.shape[1]
        if (self.df + dim) % 2:
            raise ValueError(f"df={self.df} and dimension {dim}: their sum must be even")
        factors = np.linalg.cholesky(self.scales)
        log_volume = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
        log_norm = gammaln((self.df + dim) / 2) - gammaln(self.df / 2) - dim / 2 * np.log(self.df * np.pi)
        log_tops = np.log(self.weights) + log_norm - log_volume
        centre = self.weights @ self.means
        for key, value in {
            "_factors": factors,
            "_centre": centre,
            "_forms": _quadratic_forms(self.means - centre, np.linalg.inv(factors), self.df),
            "_tops": np.exp(log_tops - log_tops.max()),
            "_log_highest": float(log_tops.max()),
        }.items():
            object.__setattr__(self, key, value)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log density at x, shape (N, D) -> (N,)."""
        found = np.empty(len(x))
        for block in _blocks(len(x)):
            found[block] = self._tops @ self._kernel(self._forms @ self._monomials(x[block]))
        return np.asarray(np.log(found) + self._log_highest)

    def sample(self, rng: np.random.Generator | np.random.RandomState, size: int) -> FloatArray:
        """Draws, shape (size, D); works with numpy's old and new generators."""
        which = np.searchsorted(np.cumsum(self.weights)[:-1], rng.uniform(size=size), side="right")
        normal = rng.standard_normal((size, self.means.shape[1]))
        stretch = np.sqrt(self.df / rng.chisquare(self.df, size=size))
        return np.asarray(self.means[which] + np.einsum("nij,nj->ni", self._factors[which], normal) * stretch[:, None])

    def updated(self, x: FloatArray, weights: FloatArray) -> StudentMixture:
        """One EM step toward the density that points x, shape (N, D), with normalised weights (N,) stand for.

        Components that no longer hold any weight are dropped.
        """
        dim = x.shape[1]
        held, squares, moments = np.zeros(len(self.means)), np.zeros(len(self.means)), np.zeros_like(self._forms)
        for block in _blocks(len(x)):
            monomials = self._monomials(x[block])
            u = self._forms @ monomials
            shares = self._tops[:, None] * self._kernel(u)
            shares *= weights[block] / shares.sum(axis=0)
            held += shares.sum(axis=1)
            squares += np.einsum("jn,jn->j", shares, shares)
            moments += (shares / u) @ monomials.T
        # A component needs some points of its own for a covariance: the effective number behind its share.
        kept = (held > 1e-4) & (held**2 > 3 * dim * squares)
        if not kept.any():
            return self
        held, moments = held[kept], moments[kept] * ((self.df + dim) / self.df)
        apart = moments[:, 1 : dim + 1] / moments[:, :1]
        scales = (_symmetric(moments[:, dim + 1 :], dim) - moments[:, 0, None, None] * _outer(apart)) / held[:, None, None]
        return StudentMixture(held / held.sum(), self._centre + apart, _safeguarded(scales, x, weights), self.df)

    def joined(self, other: StudentMixture, share: float) -> StudentMixture:
        """This mixture with another one of the same degrees of freedom taking a share of it."""
        return StudentMixture(
            np.concatenate([self.weights * (1.0 - share), other.weights * share]),
            np.concatenate([self.means, other.means]),
            np.concatenate([self.scales, other.scales]),
            self.df,
        )

    @property
    def covariance(self) -> FloatArray:
        """Covariance, shape (D, D); df is above 2."""
        apart = self.means - self._centre
        return np.asarray(np.einsum("j,jab->ab", self.weights, self.scales * (self.df / (self.df - 2)) + _outer(apart)))

    def _monomials(self, x: FloatArray) -> FloatArray:
        """1, coordinates and their products, counted from the centre, shape (monomials, N)."""
        dim = x.shape[1]
        result = np.empty((self._forms.shape[1], len(x)))
        result[0] = 1.0
        apart = np.subtract(x.T, self._centre[:, None], out=result[1 : dim + 1])
        first = dim + 1
        for row in range(dim):
            np.multiply(apart[row], apart[row:], out=result[first : first + dim - row])
            first += dim - row
        return result

    def _kernel(self, u: FloatArray) -> FloatArray:
        return 1.0 / _power(u, (self.df + self.means.shape[1]) // 2)


@cache
def _upper(dim: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    return np.triu_indices(dim)


def _blocks(size: int) -> list[slice]:
    return [slice(i, i + _BLOCK) for i in range(0, size, _BLOCK)]


def _power(u: FloatArray, exponent: int) -> FloatArray:
    """Whole power, at least 1, by repeated squaring: a few multiplications, where numpy's own power takes a logarithm."""
    if exponent == 1:
        return u
    half = _power(u, exponent // 2)
    return half * half * u if exponent % 2 else half * half


def _quadratic_forms(means: FloatArray, whiteners: FloatArray, df: float) -> FloatArray:
    """Coefficients of 1 + (squared distance) / df in the monomials of x, shape (J, monomials).

    What is lost by multiplying the square out is a rounding error times the squared distance of a component from the centre in its own
    scales: 1e-10 where it is a thousand of them away.
    """
    precisions = whiteners.transpose(0, 2, 1) @ whiteners
    of_means = np.einsum("jab,jb->ja", precisions, means)
    constant = np.einsum("ja,ja->j", of_means, means)
    rows, columns = _upper(means.shape[1])
    products = precisions[:, rows, columns] * np.where(rows == columns, 1.0, 2.0)
    return np.concatenate([df + constant[:, None], -2.0 * of_means, products], axis=1) / df


def _symmetric(products: FloatArray, dim: int) -> FloatArray:
    """Symmetric matrices from their upper triangles, (J, D (D + 1) / 2) -> (J, D, D)."""
    rows, columns = _upper(dim)
    full = np.empty((len(products), dim, dim))
    full[:, rows, columns] = full[:, columns, rows] = products
    return full


def _outer(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])


def _safeguarded(scales: FloatArray, x: FloatArray, weights: FloatArray) -> FloatArray:
    """Scale matrices with a thousandth of the overall spread added, so that none collapses onto a few points."""
    mean = weights @ x
    spread = weights @ np.square(x - mean)
    return np.asarray(scales + 1e-3 * np.diag(spread))
