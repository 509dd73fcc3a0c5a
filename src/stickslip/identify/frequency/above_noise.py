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

# Probability of a false alarm: white noise without any mode shows one in a fit. A mode that noise explains
# with a higher probability is reported as possible noise.
FALSE_ALARM = 0.01

Array = NDArray[np.float64]


class Left(NamedTuple):
    """Residual of a fit, divided by the noise's standard deviations.

    Fields: `square`, the sum of squares of the residuals; `variance`, this sum per degree of freedom;
    `share`, the number of independent samples divided by the number of samples (1 for white residuals); and
    `degrees_of_freedom`.
    """

    square: float
    variance: float
    share: float
    degrees_of_freedom: int

    @classmethod
    def of(cls, fit: Fit) -> Left:
        """Return the residual of all recordings of a fit; without noise levels in the fit, unweighted."""
        parts = [np.asarray(r / n, dtype=float) for r, n in zip(fit.residuals, _noises(fit), strict=True)]
        square = float(sum(part @ part for part in parts))
        share = float(np.mean([independent_samples(part) / part.size for part in parts]))
        return cls(square, square / fit.degrees_of_freedom, share, fit.degrees_of_freedom)

    def chance(self, without: float, freedom: int, trials: float) -> float:
        """Return the probability that noise alone lowers the sum of squares as much as further parameters do.

        Args:
            without: weighted sum of squares of the model without these parameters.
            freedom: number of these parameters.
            trials: number of natural frequencies from which the search took the best: the probability at one
                frequency is multiplied by it (and limited to 1).
        """
        more = self.share * max(without - self.square, 0.0) / freedom
        ratio = more / self.variance if self.variance > 0.0 else np.inf
        return min(
            1.0, trials * float(scipy.stats.f.sf(ratio, freedom, self.share * self.degrees_of_freedom))
        )


def chances(
    fit: Fit, matrices: Sequence[Array], columns: Sequence[Sequence[int]], trials: int
) -> list[float]:
    """Return for each mode the probability that noise alone lowers the sum of squares as much as the mode.

    For the model without a mode, the coefficients of the other modes are fitted again; poles stay.

    Args:
        fit: fit of complex responses (real parts, then imaginary parts), or of recordings in time.
        matrices: design matrix of each recording at the values of the fit.
        columns: for each mode, the columns of the matrices that belong to the mode.
        trials: number of natural frequencies from which the search took the best.
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
    """Return the sum of squares of measured responses, divided by the noise, without any mode.

    With `gain`, the best model of a constant gain and a delay is subtracted first.

    Args:
        fit: fit of these responses (real parts, then imaginary parts), for the measured values and their
            noise.
        frequency: frequency of each sample of a response, Hz, shape (n,).
        longest: largest delay that is tried, positive or negative, s.
        gain: True: subtract a real constant gain, one for each response, with a delay common to all.
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
    """Return one sentence which names the modes that may be noise.

    Args:
        numbers: numbers of these modes, from 1.
        found: for each of them, the probability that noise explains as much; the largest is named.
    """
    several = len(numbers) > 1
    names = ", ".join(str(n) for n in numbers)
    chance = max(found)
    return (
        f"mode{'s' * several} {names} {'do' if several else 'does'} not stand above the noise: "
        f"the chance of noise to show as much is {chance:.2g}; leave {'them' if several else 'it'} out"
    )
