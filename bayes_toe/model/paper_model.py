"""The paper's model (H1) of one subject: its posterior and its quantities.

    natural      (mu1, sigma_p, sigma_l, q0)          what the paper reports
    identified   (offset c, pull p, width w, q0)      what the answers depend on

with c = p (mu1 - sbar), sbar the mean first stimulus of the subject; p, gamma and G are those of
:mod:`bayes_toe.model.paper_equations`. Which is stronger has the lapse rate in the place of q0. The
coordinates are those of :mod:`bayes_toe.model.paper_rows`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np
from scipy.special import ndtr, ndtri

from bayes_toe.arrays import FloatArray, NamedArrays
from bayes_toe.data.study import Subject
from bayes_toe.data.tasks import SAME_DIFFERENT, Task
from bayes_toe.model.densities import probit_of_logit
from bayes_toe.model.observer import JND_OVER_NOISE
from bayes_toe.model.paper_equations import (
    natural_names,
    noise_ratio,
    variance_ratio,
)
from bayes_toe.model.paper_rows import PaperRows
from bayes_toe.model.posterior import Names, SubjectPosterior
from bayes_toe.model.posterior_array import PosteriorArray, independent_array
from bayes_toe.model.prior import DEFAULT, Prior

#: Its name in files and in the keys of its random streams.
PAPER_MODEL = "predictive update"
PRIOR_DRAWS = 100_000
#: The just noticeable difference over the width: where P(equal) is half its peak, or P(second) 75
#: %.
_JND_OVER_WIDTH = {"q0": 1.0, "lapse_rate": JND_OVER_NOISE}


@dataclass(frozen=True)
class PaperModel:
    """The paper's model (H1) of a task."""

    task: Task = SAME_DIFFERENT

    name = PAPER_MODEL
    about = "H1: memory is updated by a prior and diffuses"

    def posterior(self, subject: Subject, prior: Prior = DEFAULT) -> PaperPosterior:
        """The posterior of a subject."""
        return PaperPosterior(subject, prior)


def paper_posterior(subject: Subject, prior: Prior = DEFAULT) -> PaperPosterior:
    """The posterior of one subject under the paper's model (H1).

    Examples
    --------
    >>> subject = Subject("S01", [0.0, 0.0, 0.3], [0.0, 0.3, 0.0], [49, 20, 15], [50, 50, 50])
    >>> paper_posterior(subject).coordinates
    ('mu1', 'width', 'gamma', 'q0')
    """
    return PaperPosterior(subject, prior)


@dataclass(frozen=True, eq=False)
class PaperPosterior(SubjectPosterior):
    """Log posterior of one subject under the paper's model.

    Parameters
    ----------
    subject : Subject
        The counts.
    prior : Prior
        "stimuli" in it become numbers of this subject's stimuli.
    centre : float, optional
        Intensity from which the offset counts, natural-log units; by default the mean first
        stimulus.
    """

    subject: Subject
    prior: Prior = DEFAULT
    centre: float | None = None
    model: PaperModel = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "model", PaperModel(self.subject.task))
        object.__setattr__(self, "prior", self.prior.for_subjects(self.subject))

    @cached_property
    def array(self) -> PosteriorArray:
        """The same posterior as an array of one."""
        rows = PaperRows.from_subjects([self.subject], self.prior)
        return independent_array(rows, [rows.coordinates])

    @property
    def rows(self) -> PaperRows:
        """The counts, as one row."""
        return cast(PaperRows, self.array.likelihood.rows)

    @property
    def share(self) -> str:
        """The name of the fourth parameter: q0 or lapse_rate."""
        return self.subject.task.lapses

    @cached_property
    def sbar(self) -> float:
        """Intensity from which the offset counts, natural-log units."""
        if self.centre is not None:
            return self.centre
        if self.subject.shared_scales is not None:
            return self.subject.shared_scales.sbar
        return float(np.average(self.subject.s1, weights=self.subject.n_trials))

    def for_subject(self, subject: Subject) -> PaperPosterior:
        """The same prior and centre for other answers or other pairs."""
        return replace(self, subject=subject, centre=self.sbar)

    @property
    def names(self) -> Names:
        """The names of the quantities."""
        return Names(
            natural=natural_names(self.subject.task),
            identified=("offset", "pull", "width", self.share),
            derived=("pse_shift", "jnd", "gamma", "sigma1", "gain", "width"),
            monotone=("pse_shift", "jnd", "gain", "pull"),
        )

    @property
    def monotone_in(self) -> Mapping[str, tuple[str, int]]:
        """The quantities that one coordinate determines: its name, and 1 if they rise with it."""
        by_coordinate = {name: (name, 1) for name in self.coordinates}
        by_coordinate |= {"pull": ("gamma", 1), "gain": ("gamma", -1)}
        if self.prior.spread == "width":
            by_coordinate["jnd"] = ("width", 1)
        return by_coordinate

    def quantities(self, x: FloatArray) -> dict[str, FloatArray]:
        """Every named quantity, each with the shape of x without its last axis.

        The shift of the point of subjective equality, at the mean first stimulus, is the offset.
        The just noticeable difference is the distance at which 'equal' is half as frequent as at
        its peak, or P(second) 75 % without lapses.
        """
        rows = self.rows
        u = x.reshape(1, -1, 4)
        shape = x.shape[:-1]
        mu1 = rows.mu1(u).reshape(shape)
        width = np.exp(rows.log_width(u)).reshape(shape)
        p = rows.pull(u).reshape(shape)

        gain = 1.0 - p
        sigma_p = width * gain**rows.power
        offset = p * (mu1 - self.sbar)

        return {
            "mu1": mu1,
            "sigma_p": sigma_p,
            "sigma_l": sigma_p * np.sqrt(p) / gain,
            "gamma": ndtr(x[..., 2]),
            "sigma1": sigma_p / np.sqrt(gain),
            "gain": gain,
            "width": width,
            "offset": offset,
            "pull": p,
            self.share: ndtr(x[..., 3]),
            "jnd": width * _JND_OVER_WIDTH[self.share],
            "pse_shift": offset,
        }

    def points(self, quantities: NamedArrays) -> FloatArray:
        """Points, shape (..., 4), from the natural quantities of shape (...).

        Notes
        -----
        Where sigma_l and sigma_p differ by rounding only, gamma = 1 and its logit is infinite: such
        a point is on the edge, outside the open support. Draws come there: from a logit of 36 on no
        pair of floats distinguishes it.
        """
        mu1, sigma_p, sigma_l, share = (
            np.asarray(quantities[name], np.float64) for name in self.names.natural
        )

        rows = self.rows
        ratio = variance_ratio(noise_ratio(sigma_p, sigma_l))
        log_width = np.log(sigma_p) + rows.power * np.log(ratio)

        # The row of the subject comes first, whatever the shape of the quantities.
        of_row = (1, -1)
        score = rows.spread_score(log_width.reshape(of_row), (1.0 - 1.0 / ratio).reshape(of_row))
        spread = score.reshape(log_width.shape)

        with np.errstate(divide="ignore"):
            columns = (
                (mu1 - rows.mu1_mean[0, 0]) / rows.mu1_sd[0, 0],
                spread,
                probit_of_logit(_logit_gamma(sigma_p, sigma_l)),
                ndtri(share),
            )
        return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _logit_gamma(sigma_p: FloatArray, sigma_l: FloatArray, rounding: float = 1e-15) -> FloatArray:
    """The logit of gamma, with 1 - gamma from the difference of the sigmas.

    By `rounding`, relatively, sigma_l may come out above sigma_p though gamma is below 1.
    """
    difference = (sigma_p - sigma_l) / sigma_p
    is_rounding = (difference < 0.0) & (difference >= -rounding)
    complement = difference * (1.0 + sigma_l / sigma_p)
    log_complement = np.log(np.where(is_rounding, 0.0, complement))
    return 2.0 * (np.log(sigma_l) - np.log(sigma_p)) - log_complement
