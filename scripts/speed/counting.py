"""A posterior that counts the points at which it was evaluated; a gradient or a Hessian counts as one evaluation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.model.posterior import Posterior


class Counting(Posterior):
    """The same posterior; `evaluations` is the count."""

    def __init__(self, posterior: Posterior) -> None:
        super().__init__(posterior.subject, posterior.model, posterior.prior)
        object.__setattr__(self, "_inside", False)
        object.__setattr__(self, "evaluations", 0)

    evaluations: int

    def _counted(self, method: str, x: npt.ArrayLike) -> object:
        """Count once, however the public methods call each other."""
        if self.__dict__["_inside"]:
            return getattr(super(), method)(x)
        object.__setattr__(self, "evaluations", self.evaluations + len(np.atleast_2d(x)))
        object.__setattr__(self, "_inside", True)
        try:
            return getattr(super(), method)(x)
        finally:
            object.__setattr__(self, "_inside", False)

    def log_density(self, x: npt.ArrayLike) -> FloatArray:
        return self._counted("log_density", x)  # type: ignore[return-value]

    def log_likelihood(self, x: npt.ArrayLike) -> FloatArray:
        return self._counted("log_likelihood", x)  # type: ignore[return-value]

    def derivatives(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        return self._counted("derivatives", x)  # type: ignore[return-value]
