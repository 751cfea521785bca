"""When users of a sampler would call its draws converged: the rules of its own documentation."""

from __future__ import annotations

from bayes_toe.arrays import FloatArray
from bayes_toe.inference.diagnostics import convergence
from speed.outcome import Verdict


def nuts_verdict(draws: FloatArray, divergences: int) -> Verdict:
    """R-hat below 1.01, 100 effective draws a chain, no divergence."""

    def verdict() -> tuple[bool, str]:
        found = [convergence(draws[..., i]) for i in range(4)]
        r_hat, ess = max(f.r_hat for f in found), min(min(f.ess_bulk, f.ess_tail) for f in found)
        content = r_hat < 1.01 and ess >= 100 * len(draws) and divergences == 0
        return bool(content), f"R-hat {r_hat:.3f}, smallest ESS {ess:.0f}, {divergences} divergences"

    return verdict
