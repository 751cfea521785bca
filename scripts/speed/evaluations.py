"""Effective draws of `sample --draws 10000` for each likelihood evaluation, fitting included: one number on standard output.

A program of its own, so that :mod:`before_after` can run it with the package of any commit. It counts points handed to `log_likelihood`,
and to `derivatives`, in which a gradient or a Hessian counts as one; values by pair of draws that are kept already are not counted.
"""

import sys
from typing import Any

import numpy as np

import bayes_toe as bt

COUNTED = ("log_likelihood", "derivatives")


def main(study_file: str) -> None:
    """Wrap the posterior's methods, sample, print the ratio."""
    study: Any = bt.read_study(study_file)
    cls: Any = type(bt.posterior_of(study[study.names[0]]))
    counts = [_counted(cls, name) for name in COUNTED]
    statistics = bt.sample(study, draws=10_000, seed=1, workers=1).group("sample_stats")
    print(float(statistics["min_ess"].sum()) / sum(map(sum, counts)))


def _counted(cls: Any, name: str) -> list[int]:
    """Points that each call of a method will be handed."""
    plain, sizes = getattr(cls, name), []

    def method(self: Any, x: Any, *rest: Any) -> Any:
        sizes.append(len(np.atleast_2d(x)))
        return plain(self, x, *rest)

    setattr(cls, name, method)
    return sizes


if __name__ == "__main__":
    main(sys.argv[1])
