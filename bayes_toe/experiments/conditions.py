"""Observers under several conditions, between which constant error, pull and width differ by sizes that are stated.

    eta_sc = eta_s + x_c d_s,    d_s ~ Normal(size, sd^2),

on the scales on which subjects scatter: the constant error (natural-log intensity), the probit of the pull, the log of the width. Steps x_c
go evenly from -1/2 at the first level to 1/2 at the last; of numbers they are (x - mean)/range. So the size is that of the last level less
the first, or of the largest number less the smallest, and what is said of a subject is of the middle of the conditions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bayes_toe.arrays import FloatArray
from bayes_toe.data.conditions import Conditions
from bayes_toe.data.covariates import level_words
from bayes_toe.data.messages import quoted
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import Task
from bayes_toe.data.validation import AT, number
from bayes_toe.errors import InputError
from bayes_toe.model.contrasted import QUANTITIES
from bayes_toe.model.coordinates import Natural, natural_names
from bayes_toe.model.ladder import ORDERS, models_of
from bayes_toe.model.parts import CURVE_SCALES, compose
from bayes_toe.model.posterior import Posterior
from bayes_toe.model.prior import Prior
from bayes_toe.seeds import generator

UPDATE = ORDERS[-1]
#: What may differ between conditions.
DIFFERING = ("constant error", "pull", "width")
#: Differences by quantity: their mean, and the sd between subjects.
Sizes = Mapping[str, tuple[float, float]]
_ALLOWED = "QUANTITY=SIZE, or QUANTITY=SIZE:SD with the sd between subjects, of constant error, pull, width, separated by commas"


@dataclass(frozen=True)
class Differing:
    """Conditions, and what differs between the first and the last of them: by quantity the mean and the sd between subjects.

    Examples
    --------
    >>> found = Differing.of(["2", "6", "4"], {"pull": 0.5})
    >>> found.steps.tolist(), found.sizes
    ([-0.5, 0.5, 0.0], {'pull': (0.5, 0.0)})
    """

    conditions: Conditions
    sizes: Sizes

    @classmethod
    def of(
        cls, levels: Sequence[str], differ: Mapping[str, float | tuple[float, float]] | None = None
    ) -> Differing:
        """Of these levels, by these sizes, each with the sd between subjects or without."""
        values = [number(level, decimal_comma=False) for level in levels]
        numeric = bool(np.isfinite(values).all())
        names = tuple(level_words(values) if numeric else levels)
        if (
            len(names) < 2
            or len({*names}) < len(names)
            or any(not one or AT in one for one in names)
        ):
            raise InputError(
                f"--conditions: found {quoted(','.join(levels))}, allowed: two levels and more, each once, without {AT}"
            )
        sizes = {
            key: (float(size), 0.0) if isinstance(size, int | float) else size
            for key, size in (differ or {}).items()
        }
        for key, (size, sd) in sizes.items():
            if key not in DIFFERING or not (np.isfinite([size, sd]).all() and sd >= 0.0):
                raise InputError(
                    f"--differ: found {quoted(f'{key}={size:g}:{sd:g}')}, allowed: {_ALLOWED}"
                )
        return cls(Conditions("condition", names, numeric), sizes)

    @property
    def steps(self) -> FloatArray:
        """Where each level is between the first and the last one, shape (levels,)."""
        levels = self.conditions.levels
        return (
            self.conditions.design()[:, 0]
            if self.conditions.numeric
            else np.linspace(-0.5, 0.5, len(levels))
        )

    def drawn(self, name: str, seed: int) -> dict[str, float]:
        """How much each quantity differs in a subject; the random stream is keyed by its name."""
        rng = generator(seed, name, "differences between conditions")
        return {
            key: size + sd * float(rng.standard_normal()) for key, (size, sd) in self.sizes.items()
        }

    def moved(
        self, target: Posterior, x: FloatArray, name: str, seed: int
    ) -> tuple[Posterior, FloatArray]:
        """The model by which an observer answers in every condition, and its points there, (levels, k), from one of a model, (1, k).

        Who updates is one of any pull, as in the models of conditions.
        """
        levels = dict(target.model.levels)
        model = compose(
            target.model.task,
            **{**levels, "order": "contraction" if levels["order"] == UPDATE else levels["order"]},
        )
        moved, known = (
            Posterior(target.subject, model, target.prior, target.sbar, target.reference),
            target.quantities(x),
        )
        by = np.zeros(len(model.group))
        for key, size in self.drawn(name, seed).items():
            places = [i for i, quantity in enumerate(model.group) if quantity in QUANTITIES[key]]
            if not places:
                raise InputError(
                    f"--differ: model {model.name!r} has no {key}, allowed: what the observers have"
                )
            by[places] = [-size if model.group[i] == "gain" else size for i in places]
        eta = moved.to_group(moved.points({name: known[name] for name in moved.names.natural}))
        return moved, moved.from_group(eta + self.steps[:, None] * by)[0]

    def observers(self, pairs: Subject, name: str, one: Natural, seed: int) -> Natural:
        """The observer of a name, parameters of shape (), in every condition, (levels,); the pairs are those shown.

        Quantities are those at one second, and the constant error is that at the mean first stimulus.
        """
        target = Posterior(
            pairs, models_of(pairs.task).update, Prior(reference_interval=1.0), interval=1.0
        )
        x = target.points(
            {
                key: np.atleast_1d(value)
                for key, value in zip(natural_names(pairs.task), one, strict=True)
            }
        )
        moved, points = self.moved(target, x, name, seed)
        found = moved.quantities(points)
        return Natural(
            *of_update(found["offset"], found["pull"], found["width"], target.sbar, pairs.task),
            found[pairs.task.lapses],
        )


def of_update(
    offset: npt.ArrayLike, pull: npt.ArrayLike, width: npt.ArrayLike, at: float, task: Task
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """mu1 = at + c/p, sigma_p = w K^power of the task, sigma_l = sigma_p p^(1/2) / K, with K = 1 - p; offsets count from `at`."""
    p, gain = np.asarray(pull), 1.0 - np.asarray(pull)
    sigma_p = np.asarray(np.asarray(width) * gain ** CURVE_SCALES[task].power)
    return np.asarray(at + np.asarray(offset) / p), sigma_p, np.asarray(sigma_p * np.sqrt(p) / gain)


def differing_from(conditions: str | None, differ: str | None) -> Differing | None:
    """What `--conditions` and `--differ` say; None without conditions.

    Examples
    --------
    >>> differing_from("left,right", "pull=0.5:0.1,width=0.3").sizes
    {'pull': (0.5, 0.1), 'width': (0.3, 0.0)}
    """
    if conditions is None:
        if differ is not None:
            raise InputError("--differ: allowed with --conditions, between which observers differ")
        return None
    sizes = {}
    for part in differ.split(",") if differ else ():
        key, _, said = part.partition("=")
        size, _, sd = said.partition(":")
        try:
            sizes[key.strip()] = float(size), float(sd or 0.0)
        except ValueError:
            raise InputError(f"--differ: found {quoted(part)}, allowed: {_ALLOWED}") from None
    return Differing.of([one.strip() for one in conditions.split(",")], sizes)
