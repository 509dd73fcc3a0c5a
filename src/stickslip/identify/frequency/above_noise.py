r"""F-test of each vibration mode of a fit against the same model without that mode.

The sum of squares that a mode explains, :math:`\Delta`, relative to noise of variance :math:`s^2`, is F
distributed at one natural frequency. The search takes the best frequency, so the chance is multiplied by the
number of frequencies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...estimate.lack import independent_samples
from ...estimate.result import Fit

# Probability that white noise shows a mode in one fit.
FALSE_ALARM = 0.01

Array = NDArray[np.float64]


class Left(NamedTuple):
    """Residual of a fit: weighted sum of squares, variance of a weighted residual, share of independent
    samples, and degrees of freedom."""

    square: float
    variance: float
    share: float
    degrees_of_freedom: int

    @classmethod
    def of(cls, fit: Fit) -> Left:
        """Return the residual of all recordings of a fit."""
        parts = [np.asarray(r / n, dtype=float) for r, n in zip(fit.residuals, _noises(fit), strict=True)]
        square = float(sum(part @ part for part in parts))
        share = float(np.mean([independent_samples(part) / part.size for part in parts]))
        return cls(square, square / fit.degrees_of_freedom, share, fit.degrees_of_freedom)

    def chance(self, without: float, freedom: int, trials: float) -> float:
        """Return the probability that noise explains as much as `freedom` parameters do.

        Args:
            without: weighted sum of squares of the model without these parameters.
            freedom: number of these parameters.
            trials: number of natural frequencies of which the best is taken.
        """
        more = self.share * max(without - self.square, 0.0) / freedom
        ratio = more / self.variance if self.variance > 0.0 else np.inf
        return min(
            1.0, trials * float(scipy.stats.f.sf(ratio, freedom, self.share * self.degrees_of_freedom))
        )


def chances(
    fit: Fit, matrices: Sequence[Array], columns: Sequence[Sequence[int]], trials: int
) -> list[float]:
    """Return for each mode the probability that noise explains as much.

    Args:
        fit: of complex responses (real parts, then imaginary parts), or of recordings in time.
        matrices: design matrix of each recording at the values of the fit.
        columns: for each mode, the columns of the matrices that belong to it.
        trials: number of natural frequencies of which the best is taken.
    """
    left, parts = Left.of(fit), []
    for measured, noise, matrix in zip(fit.measured, _noises(fit), matrices, strict=True):
        weight = np.broadcast_to(1.0 / np.asarray(noise, dtype=float), measured.shape)
        parts.append((matrix * weight[:, None], np.asarray(measured) * weight))
    found = []
    for mode in columns:
        without = 0.0
        for design, y in parts:
            kept = np.delete(design, list(mode), axis=1)
            beside = y - kept @ np.linalg.lstsq(kept, y, rcond=None)[0] if kept.shape[1] else y
            without += float(beside @ beside)
        found.append(left.chance(without, len(mode) * len(parts) + 2, trials))
    return found


def left_by_delay(fit: Fit, frequency: Array, longest: float, gain: bool) -> float:
    """Return the weighted sum of squares of responses after the best delayed constant gain is subtracted;
    without `gain`, of the responses themselves.

    Args:
        fit: of these responses, real parts, then imaginary parts.
        frequency: Hz, of all samples of the response.
        longest: longest delay, s.
        gain: subtract a real gain, one for each response.
    """
    rows = []
    for measured, noise in zip(fit.measured, _noises(fit), strict=True):
        weight = np.broadcast_to(1.0 / np.asarray(noise, dtype=float), measured.shape)
        y = np.asarray(measured) * weight
        n = frequency.size
        rows.append((weight[:n], y[:n] + 1j * y[n:]))
    whole = float(sum(np.sum(np.abs(y) ** 2) for _, y in rows))
    if not gain:
        return whole

    def explained(delay: float) -> float:
        phase = np.exp(2j * np.pi * frequency * delay)
        return float(sum(np.sum(np.real(w * y * phase)) ** 2 / np.sum(w**2) for w, y in rows))

    step = 0.125 / float(frequency[-1])
    tried = np.arange(-longest, longest + step, step)
    best = float(tried[np.argmax([explained(one) for one in tried])])
    bounds, within = (best - step, best + step), {"xatol": 1e-6 * step}
    end: Any = scipy.optimize.minimize_scalar(
        lambda d: -explained(d), bounds=bounds, method="bounded", options=within
    )
    return whole + float(end.fun)


def _noises(fit: Fit) -> Sequence[Any]:
    return fit.noise or (1.0,) * len(fit.residuals)


def said_of_noise(numbers: Sequence[int], found: Sequence[float]) -> str:
    """Return a sentence on the modes that may be noise, from their numbers (from 1) and the probabilities
    that noise explains as much."""
    several = len(numbers) > 1
    names = ", ".join(str(n) for n in numbers)
    chance = max(found)
    return (
        f"mode{'s' * several} {names} {'do' if several else 'does'} not stand above the noise: "
        f"the chance of noise to show as much is {chance:.2g}; leave {'them' if several else 'it'} out"
    )
