r"""Uncertainty of a least-squares fit under autocorrelated noise.

Noise of a filtered, drifting sensor is the sum of an autoregressive part and a random walk. The least-squares
estimate is unbiased under both; its covariance is the sandwich :math:`(J^TJ)^{-1} J^T \Sigma J (J^TJ)^{-1}`
with the covariance :math:`\Sigma` of a model of the noise, whose few numbers come from the residuals.
Weighting by :math:`\Sigma^{-1}` would gain little and trust the model at frequencies where the filter leaves
no noise. `with_inherited` adds the uncertainty of quantities that the fit took as known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from .covariance import decomposed
from .drift import LEAST_WALK, MOST_WALK, sine_powers, walk_and_white
from .minima import Minimum
from .moves import moves, noise_of_data, tangent
from .result import Fit

MOST_ORDER = 20

Array = NDArray[np.float64]


class Coloured(NamedTuple):
    """Noise model of one channel.

    Fields: `autocovariance` [lags] of the stationary part, in the squared unit of the data, from lag 0 on and
    zero at all longer lags; `walk`: variance that a random walk gains from sample to sample, in the same
    unit.
    """

    autocovariance: Array
    walk: float = 0.0


def autoregression(pieces: Sequence[Array], most: int = MOST_ORDER) -> tuple[Array, float]:
    """Return the filter 1, -a_1, ..., -a_p that whitens residuals, and the variance of the whitened
    residuals.

    The filter solves the Yule-Walker equations for the autocovariance of all pieces (arrays of residuals).
    Schwarz's criterion [schwarz1978] chooses the order p, at most `most` and a quarter of the shortest piece.
    Akaike's criterion would choose an order above 0 for white noise in one case of four, at any length, and
    then describe the dips that the fit itself has made in the spectrum.
    """
    size = sum(r.size for r in pieces)
    most = min(most, min(r.size for r in pieces) // 4)
    covariance = np.zeros(most + 1)
    for r in pieces:
        covariance += [float(r[k:] @ r[: r.size - k]) / size for k in range(most + 1)]
    best, variance = np.ones(1), float(covariance[0])
    if variance <= 0.0:
        return best, 0.0
    lowest, left, a = size * math.log(variance), variance, np.zeros(0)
    # Levinson's recursion gives the filter of each order from the filter of the previous order.
    for order in range(1, most + 1):
        reflection = (covariance[order] - float(a @ covariance[order - 1 : 0 : -1])) / left
        a = np.append(a - reflection * a[::-1], reflection)
        left *= 1.0 - reflection**2
        if left <= 0.0:
            break
        criterion = size * math.log(left) + order * math.log(size)
        if criterion < lowest:
            best, variance, lowest = np.append(1.0, -a), left, criterion
    return best, variance


def noise_of(fit: Fit) -> Coloured:
    """Return the noise model (`Coloured`) of the residuals of a fit, after their clock jitter is removed.

    The random walk is at least the largest known drift of the recordings, because a short recording does not
    show a drift smaller than its noise.
    """
    found = coloured([one.narrowed(r) for one, r in zip(fit.jitter, fit.residuals, strict=True)], walks=True)
    return found._replace(walk=max([found.walk, *(known.drift for known in fit.known)]))


def coloured(pieces: Sequence[Array], walks: bool = False) -> Coloured:
    """Return the noise model (`Coloured`) that describes residuals.

    Args:
        pieces: residuals of each recording, shape (n,), evenly sampled.
        walks: True to allow a random walk in the model; slow changes by model error then count as a random
            walk.
    """
    filter, variance, steps = filter_and_walk(pieces, walks)
    if filter.size == 1:
        return Coloured(np.array([variance]), steps)
    impulse = np.zeros(min(max(r.size for r in pieces), 2000))
    impulse[0] = math.sqrt(variance)
    response = np.asarray(scipy.signal.lfilter([1.0], filter, impulse))
    return Coloured(scipy.signal.fftconvolve(response, response[::-1])[response.size - 1 :], steps)


def white_and_walk(pieces: Sequence[Array]) -> tuple[float, float]:
    """Return the standard deviation of the white noise in residuals, in their unit, and the relative variance
    of a random walk.

    The second number is the variance that the walk gains per sample, divided by the variance of the white
    noise. Noise with a 1/f spectrum is close to the sum of both. If the residuals show no random walk, the
    second number is 0, and noise that is correlated over some samples counts by the sum of its
    autocovariance.

    Args:
        pieces: residuals of each recording, shape (n,), evenly sampled.
    """
    ratio = _walk(pieces)
    if ratio:
        return math.sqrt(walk_and_white(pieces)(math.log(ratio))[1]), ratio
    lags = coloured(pieces).autocovariance
    return math.sqrt(float(lags[0] + 2.0 * lags[1:].sum())), 0.0


def filter_and_walk(pieces: Sequence[Array], walks: bool = True) -> tuple[Array, float, float]:
    """Return three results: the filter 1, -a_1, ..., -a_p that whitens the stationary part of residuals, the
    variance of the whitened residuals, and the variance that an additional random walk gains from sample to
    sample.

    Args:
        pieces: residuals of each recording, shape (n,), evenly sampled.
        walks: True to allow a random walk; otherwise the last result is 0.
    """
    found = autoregression([r - r.mean() for r in pieces])
    walk, steps = _walk(pieces) if walks else 0.0, 0.0
    if walk:
        left = [_without_walk(r, walk) for r in pieces]
        beside = autoregression(left)
        level = walk * float(np.mean(np.concatenate(left) ** 2))
        # Autoregressive noise and a random walk resemble each other, so Schwarz's criterion decides whether
        # the model of the noise includes the random walk.
        if _criterion(pieces, *beside, level) < _criterion(pieces, *found):
            found, steps = beside, level
    return *found, steps


def spectrum_of_differences(angles: Array, filter: Array, variance: float, walk: float) -> Array:
    """Return the power spectrum of the sample-to-sample differences of noise at angular frequencies [rad per
    sample].

    Args:
        angles: angular frequencies, shape (n,).
        filter: filter 1, -a_1, ..., -a_p that whitens the stationary part of the noise.
        variance: variance of the whitened part.
        walk: variance that a random walk gains from sample to sample.
    """
    passed = np.abs(np.polyval(filter[::-1], np.exp(-1j * angles))) ** 2
    return np.asarray(walk + (2.0 - 2.0 * np.cos(angles)) * variance / passed)


def _criterion(pieces: Sequence[Array], filter: Array, variance: float, walk: float = 0.0) -> float:
    """Return Schwarz's criterion (smaller is better) of an autoregression plus a random walk as a model of
    residuals, by Whittle's likelihood of their differences [whittle1953].

    Args:
        pieces: residuals of each recording, [n].
        filter: filter 1, -a_1, ..., -a_p that whitens the stationary part.
        variance: variance of the whitened part.
        walk: variance that the random walk gains from sample to sample.
    """
    size, total = 0, 0.0
    for r in pieces:
        angles, powers = sine_powers(r)
        variances = spectrum_of_differences(angles, filter, variance, walk)
        total += float(np.sum(powers / variances + np.log(variances)))
        size += powers.size
    return total + (filter.size - 1 + (walk > 0.0)) * math.log(size)


def _walk(pieces: Sequence[Array]) -> float:
    """Return the ratio of the variance of a random walk's steps to the variance of white noise in residuals
    (arrays [n]), by maximum likelihood; 0 if they show no random walk, or one array is constant."""
    if not all(np.ptp(r) for r in pieces):
        return 0.0
    found = walk_and_white(pieces)
    range_ = (2.0 * math.log(LEAST_WALK), 2.0 * math.log(MOST_WALK))
    best: Any = scipy.optimize.minimize_scalar(
        lambda x: found(x)[0], bounds=range_, method="bounded", options={"xatol": 0.05}
    )
    # A random walk must raise twice the log-likelihood by more than 2.7, the 90 % quantile of chi-squared. A
    # variance cannot be negative, so white noise reaches this in only 5 % of all cases.
    return math.exp(best.x) if found(range_[0])[0] - best.fun > 2.7 else 0.0


def _without_walk(r: Array, ratio: float) -> Array:
    """Return the residuals r [n] minus their most likely random walk; `ratio` is the variance of the walk's
    steps divided by the variance of the white noise."""
    # The random walk x solves (1/ratio) D'D x + x = r, where D takes differences of neighbouring samples.
    band = np.full((2, r.size), -1.0 / ratio)
    band[0] = 1.0 + 2.0 / ratio
    band[0, [0, -1]] = 1.0 + 1.0 / ratio
    return r - scipy.linalg.cho_solve_banded((scipy.linalg.cholesky_banded(band, lower=True), True), r)


def scores(jacobians: Sequence[Array], noise: Coloured) -> Array:
    r"""Return :math:`J^T \Sigma J`, shape (k, k), for the Jacobians J [n, k] of several recordings
    (`jacobians`). The noise of each recording has the covariance :math:`\Sigma` of this model, and is
    independent of the other recordings."""
    total = np.zeros((jacobians[0].shape[1],) * 2)
    for j in jacobians:
        lags = noise.autocovariance[: len(j)]
        kernel = np.concatenate([lags[:0:-1], lags])
        full = scipy.signal.fftconvolve(j, kernel[:, None], axes=0)[lags.size - 1 : lags.size - 1 + len(j)]
        total += j.T @ full
        later = np.cumsum(j[::-1], axis=0)[::-1][1:]
        total += noise.walk * later.T @ later
    return 0.5 * (total + total.T)


def with_own_noise(fit: Fit) -> Fit:
    """Return a copy of the fit whose covariance allows for the autocorrelated noise that its own residuals
    show; see `with_coloured_noise`."""
    return with_coloured_noise(fit, noise_of(fit))


def with_coloured_noise(fit: Fit, noise: Coloured, known: int = 0) -> Fit:
    """Return a copy of the fit whose covariance and other minima allow for autocorrelated noise, with
    `correlated` set.

    Parameters that are not at a bound get the covariance without bounds: a value at its bound does not narrow
    their intervals.

    Args:
        fit: least-squares fit with its Jacobian.
        noise: noise model that all recordings share, in the unit of the data.
        known: number of entries at the end of `fit.recordings` that are priors, not recordings; their noise
            is taken as white.
    """
    assert fit.jacobian is not None
    in_time = len(fit.recordings) - known
    ends = np.cumsum([g.n_data for g in fit.recordings[:in_time]])
    directions, root, lost = decomposed(tangent(fit))
    (*_, count), ends = ends, ends[:-1]
    of_data, of_priors = np.split(directions, [count])
    wide = np.concatenate([one.widening for one in fit.jitter[:in_time]]) / noise_of_data(fit)[:count]
    power = scores(np.split(of_data * wide[:, None], ends), noise)
    # The residuals are smaller than the noise, because the fit follows the noise in part. For white noise,
    # the ratio of the number of data to the degrees of freedom corrects their variance exactly.
    power *= fit.n_data / fit.degrees_of_freedom
    spread = root @ (power + of_priors.T @ of_priors) @ root.T
    spread[lost, :] = spread[:, lost] = 0.0
    spread[lost, lost] = np.inf
    bounded = fit.uncertainty.bounded != 0
    minima = _of_coloured(fit, spread)
    released = np.where(bounded, np.diag(spread), 0.0)
    spread[bounded, :] = spread[:, bounded] = np.nan
    return replace(
        fit,
        uncertainty=fit.uncertainty._replace(covariance=spread, released=released),
        correlated=True,
        minima=minima,
    )


def _of_coloured(fit: Fit, spread: Array) -> tuple[Minimum, ...]:
    """Return the other minima of a fit, changed from white to autocorrelated noise.

    The variances of each minimum grow by the same factors (at least 1) as those of the lowest minimum, whose
    new covariance is `spread` [k, k]. The excess of chi-squared of each minimum is divided by the median of
    these factors.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.diag(spread) / np.diag(fit.uncertainty.covariance)
    ratio = np.where(np.isfinite(ratio), np.maximum(ratio, 1.0), 1.0)
    root = np.sqrt(np.outer(ratio, ratio))
    return tuple(
        m._replace(
            uncertainty=m.uncertainty._replace(covariance=m.uncertainty.covariance * root),
            excess=m.excess / float(np.median(ratio)),
        )
        for m in fit.minima
    )


def with_inherited(fit: Fit, jacobian: Array, covariance: Array) -> Fit:
    """Return a copy of the fit whose covariance includes the uncertainty of quantities that the fit took as
    known.

    Args:
        fit: least-squares fit with its Jacobian.
        jacobian: derivatives of the fit's residuals by those quantities, in the unit of the data, shape (n,
            m).
        covariance: covariance of those quantities, shape (m, m).
    """
    moved = moves(fit, jacobian)
    added = moved @ covariance @ moved.T
    known = fit.uncertainty
    released = np.where(known.bounded != 0, known.released + np.diag(added), known.released)
    return replace(fit, uncertainty=known._replace(covariance=known.covariance + added, released=released))


def inflation(fit: Fit, place: int) -> float:
    """Return the factor, at least 1, by which autocorrelated noise increases the variance of the parameter
    with the index `place` in `fit.parameters`, compared with white noise.

    The factor is 1 if the fit assumes white noise or has no Jacobian, or if the parameter is at a bound or
    has no effect on the residuals.
    """
    if fit.jacobian is None or not fit.correlated or fit.uncertainty.bounded[place]:
        return 1.0
    j = tangent(fit)
    norms = np.linalg.norm(j, axis=0)
    scale = norms[place]
    if not scale > 0.0:
        return 1.0
    j = j / np.where(norms > 0.0, norms, 1.0)
    white = np.linalg.pinv(j.T @ j)[place, place] / scale**2
    white *= 1.0 if fit.noise_known else fit.reduced_chi_squared
    return max(1.0, float(fit.uncertainty.covariance[place, place]) / float(white))
