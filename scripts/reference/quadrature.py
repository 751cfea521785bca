r"""Evidence and posterior moments of one subject by deterministic integration.

A reference that shares no code with the samplers.

The integral over x = (c, a, b, l), with a = logit(p/p_max), b = log w, l = logit q0, is nested:

inside   g(a, b, l) = \int exp(log posterior) dc: adaptive Clenshaw-Curtis panels, so that the
         funnel (the spread of c shrinks with p) and several humps in c cost more panels and nothing
         else;
outside  Z = h_1 h_2 h_3 |L| sum_k g(o + L (h k)): the trapezoidal rule, whose error falls
         exponentially because g is smooth and decays on the whole space, on a sheared lattice (L
         lower triangular, the local shape of g at its highest point). Only points with g > e^-depth
         max g are kept; they are found by walking from neighbour to neighbour, from every maximum.

Quantiles use the same two representations: along a lattice direction the integral of the
band-limited interpolant, whose cumulative weight is S(x) = 1/2 + Si(pi x)/pi, and along c the
integral of the panels' polynomials.

Errors are measured, not assumed, and add up from: the sums with alternating signs along every
lattice direction and diagonal (what halving the number of points would change), the outermost shell
of 2 nats (what moving the limits in would change), and the panels' difference between 17 and 9
points. Each is the error of a coarser rule than the one whose value is returned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_toe.arrays import FloatArray
from bayes_toe.model.paper_equations import NATURAL
from reference.lattice import MAX_NODES, start
from reference.lattice_quantiles import Quantiles, find_quantiles
from reference.lattice_sums import Audit
from reference.panels import Density

QUANTITIES = (*NATURAL, "gain")
TOLERANCE = 1e-4
#: Changes whenever a change of the integration can change a number; stored references carry it.
METHOD = "nested 2"

_DEPTH = 15.0  # nats below the highest lattice value at which the walk turns back
_DEEPER = 3.0  # nats that are added if that is not enough


@dataclass(frozen=True, eq=False)
class Reference:
    """Evidence (log, nats) and posterior moments by quadrature.

    Every error is an estimate from above.

    Moments are of :data:`QUANTITIES`, shape (5,): mu1, sigma_p, sigma_l (natural-log units), q0 and
    the Kalman gain; quantiles at 5, 50 and 95 %, shape (5, 3); evaluations are points at which the
    log density was computed.
    """

    log_evidence: float
    log_evidence_error: float
    means: FloatArray
    means_error: FloatArray
    sds: FloatArray
    sds_error: FloatArray
    quantiles: FloatArray
    quantiles_error: FloatArray
    evaluations: int


def integrate(posterior: Density, *, tolerance: float = TOLERANCE) -> Reference:
    """Integrate a posterior until the errors meet the tolerance, or there are 600,000 points.

    A posterior is anything with `sbar`, `log_density` and `natural`; the tolerance is that of the
    log evidence, nats: means and standard deviations may have 10 times that in units of the
    posterior sd. The errors that were reached are in the result.
    """
    lattice = start(posterior, tolerance)
    depth = _DEPTH
    while True:
        lattice.walk(depth)
        audit = Audit(lattice, depth)
        full = len(lattice.index) > MAX_NODES
        if not full and audit.total > tolerance:
            if audit.outside > audit.worst.max():
                depth += _DEEPER
            else:
                lattice.halve(int(np.argmax(audit.worst)))
            continue
        quantiles = find_quantiles(audit)
        if full or quantiles.worst.max() < 50.0 * tolerance:
            return _reference(audit, quantiles)
        lattice.halve(int(np.argmax(quantiles.worst)))


def _reference(audit: Audit, quantiles: Quantiles) -> Reference:
    """The result, in natural units."""
    lattice = audit.lattice
    volume = np.log(lattice.step).sum() + np.log(np.diagonal(lattice.basis)).sum()
    error = audit.errors.sum(axis=0)
    n = len(QUANTITIES)
    shift = np.zeros(n)
    shift[0] = lattice.inner.density.sbar
    sizes = (error[0], error[1 : n + 1] * audit.sds, error[n + 1 :] * audit.sds)
    values = (
        float(audit.log_total + volume),
        float(sizes[0]),
        audit.means + shift,
        sizes[1],
        audit.sds,
        sizes[2],
    )
    return Reference(
        *values, quantiles.values + shift[:, None], quantiles.errors, lattice.inner.evaluations
    )
