"""The paper's model (H1) of one subject: its posterior and its quantities.

    natural      (mu1, sigma_p, sigma_l, q0)          what the paper reports
    identified   (offset c, pull p, width w, q0)      what the answers depend on

with c = p (mu1 - sbar), sbar the mean first stimulus of the subject; p, gamma and G are those of
:mod:`bayes_toe.model.paper_equations`. Which is stronger has the lapse rate in the place of q0. The
coordinates are those of :mod:`bayes_toe.model.paper_rows`; :class:`FunnelArray` has the posterior
in coordinates without a funnel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtr, ndtri

from bayes_toe.arrays import ArrayPair, FloatArray, NamedArrays
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
from bayes_toe.model.posterior_array import PosteriorArray
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
    def rows(self) -> PaperRows:
        """The counts, as one row."""
        return PaperRows.from_subject(self.subject, self.prior)

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
        mu1, width, p = rows.mu1(x), np.exp(rows.log_width(x)), rows.pull(x)

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

        mean, sd = self.prior.mu1_normal

        with np.errstate(divide="ignore"):
            columns = (
                (mu1 - mean) / sd,
                rows.spread_score(log_width, 1.0 - 1.0 / ratio),
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


# --- Without a funnel -----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Funnel:
    """The normal distribution of the score of mu1 given pull and width, and coordinates without it.

    The answers determine the offset c = p (mu1 - sbar), so that mu1 is the more open the smaller
    the pull p is. Given pull and width, the score of mu1 is about normal with

        s^-2 = 1 + kappa sd^2 p^2 / (w^2 + w_0^2),   mean = (1 - s^2) (sbar + c/p - m) / sd,

    where m and sd are those of the prior of mu1, and the answers give c, kappa and w_0 at the
    highest maximum. A curve that is much steeper than the steps of the stimuli tells c no better.
    The coordinates y have (u_0 - mean)/s in the place of u_0, and the others as they are.

    Attributes
    ----------
    row : PaperRows
        The answers of one subject.
    centre : float
        The score at which mu1 is sbar.
    offset : float
        c over the prior standard deviation of mu1.
    log_precision : float
        Of kappa sd^2.
    log_least_width : float
        Of w_0.
    follows_width : float
        1, or 0 where the precision does not depend on the width: several maxima leave c open.
    """

    row: PaperRows
    centre: float
    offset: float
    log_precision: float
    log_least_width: float
    follows_width: float

    def conditional(self, u: FloatArray) -> ArrayPair:
        """Mean and log standard deviation, (posteriors, points) each."""
        log_pull = self.row.log_pull(u)
        log_square = np.logaddexp(2.0 * self.row.log_width(u), 2.0 * self.log_least_width)
        # The precision that the answers give, and its share of the whole precision, 1 - s^2.
        log_information = self.log_precision + 2.0 * log_pull - self.follows_width * log_square
        log_sd = -0.5 * np.logaddexp(0.0, log_information)
        log_share = log_information + 2.0 * log_sd

        # c/p in logs, because p may be below the smallest float.
        mean = np.exp(log_share) * self.centre + np.exp(log_share - log_pull) * self.offset
        return mean, log_sd

    def forward(self, u: FloatArray) -> ArrayPair:
        """Coordinates y of u, (posteriors, points, 4), and log |dy/du|, (posteriors, points)."""
        mean, log_sd = self.conditional(u)
        y = u.copy()
        y[..., 0] = (u[..., 0] - mean) * np.exp(-log_sd)
        if self.row.prior.spread != "width":
            y[..., 1] = self.row.log_width(u)
        return y, self._log_volume(u, log_sd)

    def inverse(self, y: FloatArray) -> ArrayPair:
        """Coordinates u of y, and log |dy/du| there."""
        u = y.copy()
        if self.row.prior.spread != "width":
            u[..., 1] = self.row.spread_score(y[..., 1], self.row.pull(y))
        mean, log_sd = self.conditional(u)
        u[..., 0] = mean + y[..., 0] * np.exp(log_sd)
        return u, self._log_volume(u, log_sd)

    def _log_volume(self, u: FloatArray, log_sd: FloatArray) -> FloatArray:
        if self.row.prior.spread == "width":
            return -log_sd
        return np.log(self.row.spread_slope(u)) - log_sd


@dataclass(frozen=True, eq=False)
class FunnelArray(PosteriorArray):
    """The posterior of one subject under H1 in the coordinates y of its funnel.

    Densities are with respect to y.
    """

    funnel: Funnel

    def prior_points(self, probability: FloatArray) -> FloatArray:
        """Points of the prior by the quantiles of its coordinates, (posteriors, points, 4)."""
        return self.funnel.forward(super().prior_points(probability))[0]

    def densities(self, y: FloatArray) -> ArrayPair:
        """Log prior and log posterior density, (posteriors, points)."""
        u, log_volume = self.funnel.inverse(y)
        log_prior, log_posterior = super().densities(u)
        return log_prior - log_volume, log_posterior - log_volume

    def original(self, y: FloatArray) -> ArrayPair:
        """Points u of the posteriors, and log |dy/du| there."""
        return self.funnel.inverse(y)
