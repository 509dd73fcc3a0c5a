"""First estimate of frequency, damping and delay of a step response, before it is fitted.

Nothing is known of the stage. The time in which the response crosses its middle half gives its approximate
speed, and the spectrum its frequency if it vibrates. Of second-order responses with similar frequencies, the
closest is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...recording import RecordingError
from .linear import second_order_poles, step_response
from .recorded_step import StepTest

# First estimate of the angular frequency multiplied by the time from a quarter to three quarters of the rise.
# The product is 0.6 without damping and 1.7 with critical damping.
CROSSED = 0.9
# Multiples of the first estimate of the frequency, and damping ratios, that are tried. A slow amplifier or
# sensor may hide how fast the stage is, so most multiples are above 1.
FACTORS = np.geomspace(0.3, 8.0, 13)
DAMPINGS = np.geomspace(2e-3, 2.5, 12)
# Number of spectral peaks that are tried (PEAKS), and their range relative to the first estimate (ABOUT).
PEAKS, ABOUT = 3, (0.2, 12.0)
# PERIODS: examined duration after the rise, in periods of the first estimate. Largest number of samples for
# the choice of a response (CHOSEN_BY) and for its refinement by least squares (POLISHED_BY).
PERIODS, CHOSEN_BY, POLISHED_BY = 60.0, 1200, 5000
# Largest damping ratio at which a vibration is visible; stronger damping counts as this one for the period.
LARGEST_RINGING = 0.8
# Fewest periods that a recording must last after the delay: to the first peak and half-way back.
LEAST_AFTER = 0.75
# Smallest detectable rise, in standard deviations of the noise at rest.
SEEN = 4.0

Array = NDArray[np.float64]


class Look(NamedTuple):
    """Parameters of a second-order response: `natural_frequency` [rad/s], `damping_ratio`, and `delay` after
    the step [s]."""

    natural_frequency: float
    damping_ratio: float
    delay: float

    @property
    def decay(self) -> float:
        """Return the rate at which the slowest part of the response decays, 1/s."""
        zeta = self.damping_ratio
        return self.natural_frequency * (zeta if zeta < 1.0 else 1.0 / (zeta + math.sqrt(zeta**2 - 1.0)))

    @property
    def period(self) -> float:
        """Return the period of the vibration, s. A damping ratio above `LARGEST_RINGING` counts as this one,
        because a more strongly damped response has no visible period."""
        zeta = min(self.damping_ratio, LARGEST_RINGING)
        return 2.0 * math.pi / (self.natural_frequency * math.sqrt(1.0 - zeta**2))


# Type of a function that takes a recorded step and the parameters of a second-order response, and returns the
# response to this step with a gain of 1, in V, shape (n,).
Response = Callable[[StepTest, Look], Array]


def plain(test: StepTest, look: Look) -> Array:
    """Return the second-order response `look` to the step of the recording `test` with a gain of 1, V, shape
    (n,), without piezo, amplifier and filter."""
    poles = second_order_poles(look.damping_ratio, look.natural_frequency)
    return test.voltage * step_response(test.time - look.delay, poles)


def first_look(test: StepTest, response: Response = plain) -> Look:
    """Return the second-order response that is closest to a recorded one.

    Args:
        test: recorded step.
        response: function for the response [n] to the step with a gain of 1, from the step and a `Look`; it
            may contain a known piezo, amplifier and filter.

    Raises:
        RecordingError: the recording has no rest before the step, does not rise out of its noise, or ends
            during the rise.
    """
    crossed, half, rise = _crossing(test)
    angular = CROSSED / crossed
    kept = test.time <= half + PERIODS * 2.0 * math.pi / angular
    shown = test._replace(time=test.time[kept], position=test.position[kept] - rise[0])
    coarse = _thinned(shown, CHOSEN_BY)

    tried = [*_rings(test, half, rise[1], angular), *(angular * FACTORS)]
    looks = [_aligned(Look(w, zeta, 0.0), coarse, half, response) for w, zeta in product(tried, DAMPINGS)]
    left = [float(np.sum(_left(look, coarse, response) ** 2)) for look in looks]
    found = _polished(looks[int(np.argmin(left))], _thinned(shown, POLISHED_BY), rise[1], response)
    needed = found.delay + LEAST_AFTER * found.period
    if test.time[-1] < needed:
        raise RecordingError(
            f"end_effector_position [m] of {test.name} is too short: it ends {test.time[-1]:g} s after its "
            f"step, amid its motion; {needed:.3g} s are needed"
        )
    return found


def common_look(tests: Sequence[StepTest], looks: Sequence[Look]) -> int:
    """Return the index of the recording whose second-order response fits all recordings of a stage best, each
    scaled to its own rise.

    Args:
        tests: recorded steps.
        looks: second-order response estimated from each of them.
    """
    if len(looks) == 1:
        return 0
    levels = [_crossing(test)[2] for test in tests]
    shown = [
        _thinned(test._replace(position=(test.position - rest) / rise), CHOSEN_BY)
        for test, (rest, rise) in zip(tests, levels, strict=True)
    ]

    def left(look: Look) -> float:
        return sum(float(np.mean(_left(look, one, plain) ** 2)) for one in shown)

    return int(np.argmin([left(look) for look in looks]))


def _crossing(test: StepTest) -> tuple[float, float, tuple[float, float]]:
    """Return three results on the rise of a recorded step.

    Returns:
        The duration from a quarter to three quarters of the rise [s]; the time after the step at which half
        of the rise is reached [s]; and the pair of position before the step and height of the rise [m].

    Raises:
        RecordingError: there are no samples before or after the step, or the rise is not above the noise.
    """
    t, x = test.time, test.position
    before, after = x[t <= 0.0], x[t > 0.0]
    if before.size < 2 or after.size < 2:
        raise RecordingError(f"{test.name} has no samples before its step, or none after it")
    rest, noise = float(before.mean()), float(before.std())
    rise = float(after[after.size // 2 :].mean()) - rest
    if abs(rise) < SEEN * noise or rise == 0.0:
        raise RecordingError(f"{test.name}: the rise of {rise:g} m drowns in the noise, {noise:g} m")
    since, share = np.append(0.0, t[t > 0.0]), np.append(0.0, (after - rest) / rise)
    half = int(np.flatnonzero(share >= 0.5)[0])
    low = int(np.flatnonzero(share[:half] < 0.25)[-1])
    high = half + int(np.flatnonzero(share[half:] >= 0.75)[0])
    begin, middle, end = (
        float(np.interp(part, share[i - 1 : i + 1], since[i - 1 : i + 1]))
        for part, i in ((0.25, low + 1), (0.5, half), (0.75, high))
    )
    crossed = max(end - begin, 1e-3 * float(np.median(np.diff(t))))
    return crossed, middle, (rest, rise)


def _rings(test: StepTest, half: float, rise: float, angular: float) -> list[float]:
    """Return angular frequencies [rad/s] of at most `PEAKS` spectral peaks of the response after the rise,
    the highest first; empty without peaks.

    Args:
        test: recorded step.
        half: time after the step at which half of the rise is reached, s.
        rise: height of the rise, m.
        angular: approximate angular frequency, rad/s; peaks far from it are ignored.
    """
    x = test.position[test.time > half]
    interval = float(np.median(np.diff(test.time)))
    x = x[: max(int(4.0 * PERIODS * 2.0 * math.pi / (angular * interval)), 16)] - x[x.size // 2 :].mean()
    padded = 4 * x.size
    spectrum = np.abs(np.fft.rfft(x / rise, padded))
    frequency = 2.0 * math.pi * np.fft.rfftfreq(padded, interval)
    peaks = scipy.signal.find_peaks(spectrum)[0]
    peaks = peaks[(frequency[peaks] > ABOUT[0] * angular) & (frequency[peaks] < ABOUT[1] * angular)]
    return list(frequency[peaks[np.argsort(spectrum[peaks])[::-1][:PEAKS]]])


def _thinned(test: StepTest, most: int) -> StepTest:
    """Return the recording without samples before its step, and with every n-th sample only, so that about
    `most` samples remain."""
    every = np.flatnonzero(test.time >= 0.0)
    every = every[:: max(every.size // most, 1)]
    return test._replace(time=test.time[every], position=test.position[every])


def _aligned(look: Look, test: StepTest, half: float, response: Response) -> Look:
    """Return the estimate `look` with another delay, at which its response reaches half of its rise at the
    time `half` [s] after the step.

    Args:
        look: estimate whose delay is 0.
        test: recorded step; its time and position are not used.
        half: time after the step at which the recorded position reaches half of its rise, s.
        response: function for the response of an estimate to the step, see `Response`.
    """
    slow = 2.0 / look.natural_frequency * (1.0 + 2.0 * look.damping_ratio)
    since = np.append(np.linspace(0.0, max(slow, 2.0 * half), 40), 1e3 / look.decay)
    share = np.abs(response(test._replace(time=since), look))
    share = share / share[-1]
    i = max(int(np.flatnonzero(share >= 0.5)[0]), 1)
    return look._replace(delay=half - float(np.interp(0.5, share[i - 1 : i + 1], since[i - 1 : i + 1])))


def _left(look: Look, test: StepTest, response: Response) -> Array:
    """Return the recorded position minus the response for `look` with the best gain, m, shape (n,)."""
    shape = response(test, look)
    power = float(shape @ shape)
    return test.position - (float(shape @ test.position) / power if power > 0.0 else 0.0) * shape


def _polished(look: Look, test: StepTest, rise: float, response: Response) -> Look:
    """Return the parameters of the second-order response closest to the recorded one, by least squares.

    The natural frequency changes at most by a factor 2, the damping ratio by a factor 20, and the delay by 3
    divided by the angular frequency.

    Args:
        look: initial guess.
        test: recorded step, with positions relative to the position before the step.
        rise: height of the recorded rise, m.
        response: function for the response of parameters to the step, see `Response`.
    """
    w, zeta, delay = look

    def of(q: Array) -> Look:
        return Look(w * math.exp(q[0]), zeta * math.exp(q[1]), delay + q[2] / w)

    found = scipy.optimize.least_squares(
        lambda q: _left(of(q), test, response) / rise,
        np.zeros(3),
        bounds=([-0.7, -3.0, -3.0], [0.7, 3.0, 3.0]),
        x_scale=[0.1, 0.3, 0.1],
        diff_step=1e-5,
    )
    return of(found.x)
