"""Sums over the lattice of the reference quadrature: weights, moments, and the errors of both."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.special import expit, logsumexp

from bayes_toe.arrays import FloatArray
from bayes_toe.model.paper_equations import MAX_PULL
from reference.lattice import Lattice

CHARACTERS = tuple(sign for sign in product((0, 1), repeat=3) if any(sign))
_SHELL = 2.0  # nats: thickness of the outermost shell whose weight bounds what lies outside


def reach(x: FloatArray) -> FloatArray:
    """mu1 - sbar = c / p at points (c, logit(p / p_max), log w, logit q0), infinite past floats."""
    c, a = x[..., 0], x[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(c == 0.0, 0.0, c * (1.0 + np.exp(-a)) / MAX_PULL)


class Audit:
    """Normalised weights of the lattice points, shape (nodes,), moments, and the errors of both.

    `worst` is the error along each lattice direction, `outside` a bound in its units for what lies
    outside.
    """

    def __init__(self, lattice: Lattice, depth: float) -> None:
        self.lattice = lattice
        self.log_total = float(logsumexp(lattice.log_mass))
        self.weight = np.exp(lattice.log_mass - self.log_total)
        outer = lattice.outer(lattice.index)
        self.outer = outer
        self.shell = lattice.log_mass < lattice.log_mass.max() - depth + _SHELL
        self.panel_error = float(np.exp(lattice.columns[1] - self.log_total).sum())
        first, second = self._node_moments()
        self.means = self.weight @ first
        central = second - first**2 + (first - self.means) ** 2
        self.sds = np.sqrt(self.weight @ central)
        # The columns whose sums are reported: 1, theta - mean, and (theta - mean)^2 - variance, the
        # latter two in units of sd.
        scaled = [
            np.ones(len(outer))[:, None],
            (first - self.means) / self.sds,
            0.5 * (central / self.sds**2 - 1.0),
        ]
        columns = np.column_stack(scaled)
        #: Of the weighted sums of the columns: along the 7 characters of the lattice, outside, and
        #: inside; (9, columns).
        rows = [np.abs((self.weight * self.sign(e)) @ columns) for e in CHARACTERS]
        outside = self.weight[self.shell] @ np.abs(columns[self.shell])
        self.errors = np.stack([*rows, outside, np.full(columns.shape[1], self.panel_error)])

    def _node_moments(self) -> tuple[FloatArray, FloatArray]:
        """First and second moments of mu1 - sbar, sigma_p, sigma_l, q0, gain, (nodes, 5)."""
        mean, sd = self.lattice.columns[2:4]
        x = np.column_stack([mean, self.outer])
        theta = self.lattice.inner.density.natural(x)
        gain = 1.0 - MAX_PULL * expit(self.outer[:, 0])
        first = np.column_stack([reach(x), theta.sigma_p, theta.sigma_l, theta.q0, gain])
        second = first**2
        spread = np.column_stack([sd, self.outer])
        second[:, 0] += reach(spread) ** 2
        return first, second

    def sign(self, character: tuple[int, ...]) -> FloatArray:
        """(-1)^(character . index), (nodes,)."""
        return np.asarray(1.0 - 2.0 * ((self.lattice.index @ np.array(character)) % 2))

    def _in_units(self) -> FloatArray:
        """The rows of `errors` by their worst column, the evidence counting tenfold."""
        allowance = np.where(np.arange(self.errors.shape[1]) == 0, 1.0, 10.0)
        return np.asarray((self.errors / allowance).max(axis=1))

    @property
    def worst(self) -> FloatArray:
        """Sum of the characters that alternate along each direction, (3,)."""
        return np.array(CHARACTERS).T @ self._in_units()[: len(CHARACTERS)]

    @property
    def outside(self) -> float:
        """What the outermost shell contributes."""
        return float(self._in_units()[-2])

    @property
    def missed(self) -> float:
        """Probability that the outermost shell and the panels' errors stand for."""
        return float(self.errors[-2:, 0].sum())

    @property
    def total(self) -> float:
        """Sum of all errors, to be compared with the tolerance."""
        return float(self._in_units().sum())
