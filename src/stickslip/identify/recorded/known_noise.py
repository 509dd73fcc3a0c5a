"""Noise of a recording that is known without a model: at rest, between periods, from a converter, or
white."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...estimate.lack import KnownNoise, Lack
from ...quantities.units import with_prefix
from ...recording.noise import noise_level
from ...waveform.signal import Waveform, value_at
from .drives import periodic_part
from .levels import converter_step

if TYPE_CHECKING:
    import xarray as xr

# Share of the samples after the drive's end in which the stage may still vibrate. These first samples do not
# count as rest.
RINGS = 0.25
# Smallest change of a drive from its first value that counts as the start of the motion, relative to its
# range.
BEGUN = 0.02
# Tolerance, m (rad), of simulations in fits and verifications; smaller residuals are not a lack of fit.
SIMULATED = 1e-10
LEAST_STEP = math.sqrt(12.0) * SIMULATED  # converter step with a rounding error as large as this tolerance
# Largest rms residual that is only noise, relative to the white noise of the samples (NOISY); and largest rms
# residual that is negligible, relative to the range of the samples (NOTHING).
NOISY, NOTHING = 1.3, 1e-4

Array = NDArray[np.float64]


def resolution(positions: Array) -> float:
    """Return the resolution of positions [n], in their unit: the step of a converter, or `LEAST_STEP` if that
    is larger."""
    return max(converter_step(positions), LEAST_STEP)


def white_noise(values: Array) -> float:
    """Return the standard deviation of the white noise of values [n], in their unit, at least that of the
    rounding to converter steps."""
    return max(noise_level(values), converter_step(values) / math.sqrt(12.0))


def more_than_white(left: float, white: float, values: Array, words: tuple[str, str, str, str]) -> str:
    """Return a sentence if the residual of values [n] exceeds their white noise; otherwise an empty text.

    Args:
        left, white: root mean squares of the residual and of the white noise, in the unit of the values.
        values: measured values.
        words: parts of the sentence: name of the recording, unit and name (plural) of the values, and a
            clause on what the model lacks.
    """
    if left <= max(NOISY * white, NOTHING * float(np.ptp(values))):
        return ""
    name, unit, what, lacks = words
    return (
        f"what is left of {name} is {with_prefix(left, unit, 3)} rms, and the white noise of its {what} "
        f"{with_prefix(white, unit, 3)}: {lacks}, and the intervals are not to be trusted, or the noise is "
        "not white"
    )


def said_unjudged(
    lacks: Sequence[Lack], residuals: Sequence[Array], measured: Sequence[Array], unit: str
) -> tuple[str, ...]:
    """Return a sentence on each recording whose noise is not known independently (neither at rest nor between
    periods) and whose residual exceeds the white noise of its positions.

    Args:
        lacks: lack-of-fit test of each recording.
        residuals: residuals of each recording, in `unit`, [n].
        measured: measured positions of each recording, in `unit`, [n].
        unit: unit of the positions.
    """
    words = (unit, "positions", "the model does not explain it")
    said = [
        more_than_white(float(np.sqrt(np.mean(r**2))), white_noise(x), x, (one.name, *words))
        for one, r, x in zip(lacks, residuals, measured, strict=True)
        if not one.against
    ]
    return tuple(one for one in said if one)


def known_noise(recording: xr.Dataset, values: Array, drive: Waveform | None) -> KnownNoise:
    """Return where a channel shows its noise independently of a model, and its resolution.

    The parts are the rest before the drive moves, the rest after the drive has ended, and the repeated
    periods of a known waveform.

    Args:
        recording: over "time" [s].
        values: values of the channel, [n].
        drive: waveform of the drive in the time of the recording; None: the channel drive_voltage, if there
            is one, shows the rests.
    """
    time, step = recording["time"].values, resolution(values)
    interval = float(time[-1] - time[0]) / (time.size - 1)
    if drive is None:
        if "drive_voltage" not in recording:
            return KnownNoise(step=step)
        shown = recording["drive_voltage"].values
        again = _settled(first_change(shown[::-1], BEGUN))
        return KnownNoise(at_rest=first_change(shown, BEGUN), step=step, rest_again=again)
    again = _settled(int(np.count_nonzero(time >= drive.duration)))
    begin, periodic = periodic_part(drive)
    if periodic is None:
        rest = first_change(value_at(drive, time), BEGUN)
        return KnownNoise(at_rest=rest, step=step, rest_again=again)
    first = (begin - float(time[0])) / interval
    lasts = float(periodic.duration) / interval + min(first, 0.0)
    period = float(periodic.period) / interval
    return KnownNoise(
        at_rest=int(np.count_nonzero(time < begin)),
        period=(max(first, 0.0), period, lasts) if lasts > 0.0 else (0.0, 0.0, 0.0),
        step=step,
        rest_again=again,
    )


def _settled(samples: int) -> int:
    """Return how many of the samples after the drive's end, the last ones, count as rest: all except the
    first quarter, in which the stage may still vibrate."""
    return samples - int(RINGS * samples)


def first_change(drive: Array, share: float) -> int:
    """Return the number of samples before a drive [n] differs from its first value by more than the share
    `share` of its range; 0 if the drive is constant."""
    moved = np.abs(drive - drive[0]) > share * np.ptp(drive)
    return int(np.argmax(moved)) if np.any(moved) else 0
