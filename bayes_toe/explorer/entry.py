"""What the page keeps of one subject under one model: draws, contours, curves, counts, and what to know before believing them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_toe.arrays import FloatArray, IndexArray
from bayes_toe.classical.frequencies import laplace_error, laplace_estimate, presentation_order
from bayes_toe.explorer.contours import contours, frame
from bayes_toe.explorer.curves import POINTS, axis, slice_count, slices
from bayes_toe.explorer.packing import floats
from bayes_toe.inference.draws import Draws
from bayes_toe.inference.prediction import Predictor
from bayes_toe.model.free_frequencies import FrequencyPosterior
from bayes_toe.model.posterior import PRIOR_DRAWS, Model, Posterior, prior_draws
from bayes_toe.model.prior import Prior
from bayes_toe.model.target import DOMINATED, contraction
from bayes_toe.plots.corner import Span, known_from, spans_of
from bayes_toe.plots.style import MARKED

if TYPE_CHECKING:
    from bayes_toe.groups.population import Population

#: Quantities of one entry; only free frequencies of a large design are more.
MOST_QUANTITIES = 16
_QUANTILES = np.linspace(0.0, 1.0, 201)


@dataclass(frozen=True, eq=False)
class Entry:
    """One choice of the page.

    Attributes
    ----------
    label : str
        The model, or what else tells this posterior from others of the subject.
    target : Posterior or FrequencyPosterior
    x : array, shape (chains, draws, k)
        Draws in unconstrained coordinates.
    badges : tuple of (str, str)
        Kind - unconverged, misfit, untold, fine - and words.
    truth : mapping of str to float
        Known values, as given; those that the model does not have are those of another model.
    prior : bool
        Whether the target's prior is that of these draws; not so in a group.
    synthetic : bool
    """

    label: str
    target: Posterior | FrequencyPosterior
    x: FloatArray
    badges: tuple[tuple[str, str], ...] = ()
    truth: Mapping[str, float] | None = None
    prior: bool = True
    synthetic: bool = False
    about: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities that are shown."""
        return self.target.names.all[:MOST_QUANTITIES]

    def values_a_draw(self, most_slices: int) -> int:
        """Numbers that :meth:`packed` keeps of every draw."""
        curves = (
            0 if isinstance(self.target, FrequencyPosterior) else sum(len(one.orders) for one in slices(self.target.subject, most_slices))
        )
        return len(self.names) + 2 + POINTS * curves

    def packed(self, rows: int, most_slices: int) -> dict[str, Any]:
        """What the page holds of it: about so many draws, and curves of so many weaker stimuli at most."""
        x = self.x.reshape(-1, self.x.shape[-1])
        kept = thinned(len(x), rows)  # by the rule that explorer.js goes back by
        quantities = self.target.quantities(x)
        samples = np.column_stack([quantities[name] for name in self.names])
        marked = np.quantile(samples, MARKED, axis=0)
        some = {name: values[kept] for name, values in quantities.items()}
        return {
            "subject": self.target.subject.name,
            "label": self.label,
            "model": self.target.model.name,
            "synthetic": self.synthetic,
            "about": self.about,
            "badges": [*self.badges, *self._dominated(marked)],
            "rows": len(kept),
            "of": len(x),
            "perChain": self.x.shape[1],
            "names": self.names,
            "more": len(self.target.names.all) - len(self.names),
            "natural": [name for name in self.names if name in self.target.names.natural],
            "identified": [name for name in self.names if name in self.target.names.identified],
            "values": floats(samples[kept].T),
            "marked": marked.T.tolist(),
            "truth": self._truth(),
            **outlined(samples, spans_of(samples, self.names, self.target)),
            **self._answers(x[kept], some, most_slices),
        }

    def _dominated(self, marked: FloatArray) -> list[tuple[str, str]]:
        """Quantities whose 5 to 95 % range is not much narrower than the prior's."""
        ends = zip(self.names, marked[0].tolist(), marked[2].tolist(), strict=True)
        return [("dominated", name) for name, low, high in ends if self.prior and contraction(self.target, name, low, high) < DOMINATED]

    def _truth(self) -> dict[str, float]:
        given = {} if self.truth is None else {name: value for name, value in self.truth.items() if name in self.target.names.all}
        known = known_from(given, self.target) if given else {}
        return {name: float(value) for name, value in known.items() if name in self.names}

    def _answers(self, x: FloatArray, quantities: Mapping[str, FloatArray], most_slices: int) -> dict[str, Any]:
        """Counts, and curves over them where the model has any."""
        counts = self.target.subject
        low, high = (float(edge([counts.s1, counts.s2])) for edge in (np.min, np.max))
        pad = 0.08 * (high - low) if high > low else 0.5
        ends = [low - pad, high + pad]
        fitted = None if isinstance(self.target, FrequencyPosterior) else Predictor(self.target, x)
        shown = slices(counts, most_slices)
        higher = np.maximum(counts.s1, counts.s2)
        return {
            "pairs": {
                "s1": counts.s1.tolist(),
                "s2": counts.s2.tolist(),
                **({} if counts.isi is None else {"isi": counts.isi.tolist()}),
                "k": counts.n_equal.tolist(),
                "n": counts.n_trials.tolist(),
                "order": presentation_order(counts).tolist(),
                "estimate": laplace_estimate(counts.n_equal, counts.n_trials).tolist(),
                "error": laplace_error(counts.n_equal, counts.n_trials).tolist(),
                "higher": higher.tolist(),
            },
            "slices": [
                {
                    "title": one.title(len(shown) > 1),
                    "isi": one.isi,
                    "pairs": one.pairs.tolist(),
                    "x": one.x.tolist(),
                    "orders": one.orders,
                    "equal": None if fitted is None else floats(one.equal(fitted)),
                }
                for one in shown
            ],
            "undrawn": slice_count(counts) - len(shown),
            "reference": None if fitted is None or counts.isi is None else fitted.target.reference,
            "ends": ends,
            "axis": floats(axis(quantities, self.target.sbar, ends)) if isinstance(self.target, Posterior) else None,
        }


def thinned(size: int, rows: int) -> IndexArray:
    """Evenly spaced places of at most so many draws.

    Examples
    --------
    >>> thinned(10, 4).tolist()
    [0, 2, 5, 7]
    """
    most = min(size, rows)
    return np.asarray(np.arange(most) * size // most)


def outlined(samples: FloatArray, spans: list[Span]) -> dict[str, Any]:
    """Spans, and contours in their frames."""
    return {"spans": spans, "frames": [frame(one) for one in spans], "contours": contours(samples, spans)}


def prior_of(entry: Entry) -> dict[str, Any] | None:
    """Quantiles of the prior of every quantity, evenly spaced in probability, and their names."""
    if not entry.prior:
        return None
    target = entry.target
    if isinstance(target, Posterior):
        return _prior_of_design(target.model, target.prior, target.sbar, entry.names)
    drawn = target.quantities(target.sample_prior(np.random.default_rng(0), PRIOR_DRAWS))
    return quantiles({name: drawn[name] for name in entry.names})


@lru_cache(maxsize=1)
def _prior_of_design(model: Model, prior: Prior, sbar: float, names: tuple[str, ...]) -> dict[str, Any]:
    """The same for all subjects of a design, one after the other."""
    drawn = prior_draws(model, prior, sbar)
    return quantiles({name: drawn[name] for name in names})


def quantiles(drawn: Mapping[str, FloatArray]) -> dict[str, Any]:
    """Evenly spaced quantiles by name."""
    return {"names": list(drawn), "quantiles": floats([np.quantile(values, _QUANTILES) for values in drawn.values()])}


def entries_of(draws: Draws, label: str, subjects: tuple[str, ...], truths: Mapping[str, Mapping[str, float]]) -> list[Entry]:
    """Subjects of a posterior file."""
    missed = draws.not_converged
    about = f"{label}: {draws.attrs.get('source', '')}, seed {draws.seed}, prior {draws.described_prior()}."
    return [
        Entry(
            label,
            draws.posterior(name),
            draws.points(name),
            badges(draws, name, missed),
            truths.get(name),
            synthetic=draws.synthetic,
            about=about,
        )
        for name in subjects
    ]


def badges(draws: Draws, name: str, missed: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """Whether draws converged and the model describes the answers, as far as that was checked; `missed` is what did not converge."""
    fit = draws.fit(name)
    sampled = ("unconverged", missed[name]) if name in missed else ("fine", "converged")
    if np.isnan(fit.p_overall):
        return (sampled,)
    if fit.describes is None:
        return sampled, ("untold", f"whether the model describes the answers cannot be told, predictive p {_said(fit.p_overall)}")
    described = (
        ("misfit", f"predictive p {_said(fit.p_overall)}, p of the deviance {_said(fit.p_deviance)}")
        if fit.misfit
        else ("fine", f"no misfit seen, predictive p {_said(fit.p_overall)}")
    )
    return sampled, described


def _said(p: float) -> str:
    return f"{p:.2g}" if p >= 0.001 else "below 0.001"


def in_group(found: Population, subjects: tuple[str, ...], truths: Mapping[str, Mapping[str, float]]) -> list[Entry]:
    """The same subjects in the light of the others."""
    label, names, made = f"{found.model.name}, in the group", list(found.study.names), []
    told = (("fine", "converged"),) if found.converged else (("unconverged", found.chains.reason),)
    about = f"{label}: {len(names)} subjects, seed {found.settings.seed}."
    for name in (one for one in subjects if one in names):
        eta, target = found.chains.eta[:, :, names.index(name)], found.posterior(name)
        x, _ = target.from_group(eta.reshape(-1, eta.shape[-1]))
        made.append(Entry(label, target, x.reshape(eta.shape), told, truths.get(name), False, found.study.synthetic, about))
    return made
