"""Effective sample size and R-hat of several chains of one scalar series.

Sources: Geyer 1992, Practical Markov chain Monte Carlo, Statistical Science 7, 473-483; Vehtari, Gelman, Simpson, Carpenter, Buerkner
2021, Bayesian Analysis 16, 667-718, equations (1) to (4) and (10) to (13).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bayes_toe.arrays import FloatArray

#: A series with a smaller range is constant.
_RESOLUTION = float(np.finfo(np.float64).resolution)
#: Lags summed one by one; a chain whose autocorrelation lasts longer gets all at once from a Fourier transform, which costs about as much.
_LAGS = 32


class Series(NamedTuple):
    """Chains of one scalar about their own means.

    Attributes
    ----------
    means : array, shape (chains,)
    deviations : array, shape (chains, draws)
    range : float
        Of all values.
    within : float
        Mean variance of a chain.
    between : float
        Variance of the means; 0 of a single chain.
    """

    means: FloatArray
    deviations: FloatArray
    range: float
    within: float
    between: float


def series(values: FloatArray) -> Series:
    """A series from values of shape (chains, draws), with at least two draws."""
    with np.errstate(invalid="ignore"):  # an infinite value has no moments, which NaN says
        means = values.mean(axis=1)
        deviations = values - means[:, None]
        span = float(values.max() - values.min())
    within = _lagged(deviations, 0) / (values.size - len(values))
    return Series(means, deviations, span, within, float(means.var(ddof=1)) if len(means) > 1 else 0.0)


def effective_size(chains: Series) -> float:
    """Effective number of draws in all chains; their plain number where the series is constant.

    Sums of autocorrelations at lags 2 j and 2 j + 1 are added while they are positive, none counted as larger than the one before; of the
    pair that ends the sequence only the even lag counts. Antithetic chains have at most log10(draws) times their number of draws.

    Source: Vehtari et al. 2021, equations (10) to (13) and section 3.2; Geyer 1992, section 3.3.

    Examples
    --------
    >>> draws = np.random.default_rng(0).standard_normal((4, 1000))
    >>> 3500 < effective_size(series(draws)) < 4500
    True
    """
    size = chains.deviations.size
    if chains.range < _RESOLUTION:
        return float(size)
    sums, even = [], 1.0
    for even, odd in _correlations(chains):
        sums.append(even + odd)
        if not sums[-1] > 0.0:
            break
    last = even if even > 0.0 or sums[-1] >= 0.0 else 0.0
    tau = -1.0 + 2.0 * float(np.minimum.accumulate(sums)[:-1].sum()) + last
    return float("nan") if np.isnan(sums[-1]) else size / max(tau, 1.0 / float(np.log10(size)))


def r_hat(chains: Series) -> float:
    """Potential scale reduction of at least two chains; NaN where none of them varies.

    Source: Vehtari et al. 2021, equations (1) to (4).

    Examples
    --------
    >>> draws = np.random.default_rng(0).standard_normal((4, 1000))
    >>> r_hat(series(draws)) < 1.01 < r_hat(series(draws + np.arange(4.0)[:, None]))
    True
    """
    draws = chains.deviations.shape[1]
    if chains.within == 0.0:
        return float("inf") if chains.between > 0.0 else float("nan")
    return float(np.sqrt((draws * chains.between / chains.within + draws - 1.0) / draws))


def _correlations(chains: Series) -> Iterator[tuple[float, float]]:
    """Autocorrelations over all chains at lags (0, 1), (2, 3) and so on, made as they are asked for."""
    deviations = chains.deviations
    draws = deviations.shape[1]
    # One minus what the variance between draws that far apart makes of that between independent ones.
    total = chains.within * (draws - 1.0) / draws + chains.between
    offset = 1.0 - chains.within / total
    yield 1.0, offset + _lagged(deviations, 1) / (deviations.size * total)
    later = np.empty(0)
    for lag in range(2, draws - 2, 2):
        if lag == _LAGS:
            later = _all_lagged(deviations)
        even, odd = later[lag : lag + 2] if lag >= _LAGS else (_lagged(deviations, lag), _lagged(deviations, lag + 1))
        yield float(offset + even / (deviations.size * total)), float(offset + odd / (deviations.size * total))


def _lagged(deviations: FloatArray, lag: int) -> float:
    """Sum of products of deviations that far apart. Not by BLAS, whose sums depend on the number of its threads."""
    return float(np.einsum("ct,ct->", deviations[:, : deviations.shape[1] - lag], deviations[:, lag:]))


def _all_lagged(deviations: FloatArray) -> FloatArray:
    """The same at every lag, shape (draws,), from the power spectrum of the chains with zeros after their end."""
    draws = deviations.shape[1]
    length = 1 << (2 * draws - 1).bit_length()
    spectrum = np.fft.rfft(deviations, n=length, axis=1)
    power = (spectrum.real**2 + spectrum.imag**2).sum(axis=0)
    return np.asarray(np.fft.irfft(power, n=length)[:draws])
