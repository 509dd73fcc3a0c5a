"""Instants of slip, from the jumps of drive_voltage or from the position alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...recording import RecordingError
from ..recorded.drives import refuse_coarse

# Smallest change of the drive from one sample to the next that is a jump, relative to its range.
JUMP = 0.3
# Time without a slip, in periods, after which the next slip belongs to another walk.
APART = 4.5
# Smallest median height of the edges in a position that are slips, in standard deviations of the edges that
# noise makes. An edge is the mean of some samples minus the mean of as many samples before.
ABOVE_NOISE = 5.0
# Largest deviation of the time between two edges from a whole number of periods, in periods, at which the
# time counts as regular.
IRREGULAR = 0.25

Array = NDArray[np.float64]


class SlipEvents(NamedTuple):
    """Slips of a recording.

    Fields: `time`, instants of the slips, s, ascending, [n]; `sign` of each jump of the position, +1 or -1,
    [n]; `walk`, the number of the walk (from 0) of each slip, [n]; `period` of the slips [s]; `delay` of the
    position after the drive [s], NaN without a drive; and `inverted`, True if the position jumps against the
    drive (False without a drive).
    """

    time: Array
    sign: NDArray[np.int64]
    walk: NDArray[np.int64]
    period: float
    delay: float
    inverted: bool


def slips_of(t: Array, x: Array, u: Array | None, where: str) -> SlipEvents:
    """Return the slips of a recording, from the jumps of the drive and their delay, or from the position
    alone.

    Args:
        t: times, s, [n].
        x: positions, m (rad), [n].
        u: drive voltage, V, [n]; None: not recorded.
        where: name of the recording in errors.

    Raises:
        RecordingError: the drive has fewer than two jumps, no slips exceed the noise of the position, or a
            period has too few samples.
    """
    if u is None:
        time, sign, period = _in_position(t, x, where)
        return SlipEvents(time, sign, _walks(time, sign, period), period, np.nan, False)
    change = np.diff(u)
    at = np.flatnonzero(np.abs(change) > JUMP * np.ptp(u))
    at = at[np.diff(at, prepend=-2) > 1] + 1
    if at.size < 2:
        raise RecordingError(
            f"drive_voltage [V] of {where} jumps {at.size} times: it is no sawtooth, or too short; at "
            "least 2 jumps are needed"
        )
    jump = np.sign(change[at - 1]).astype(int)
    walk = _walks(t[at], jump, float(np.median(np.diff(t[at]))))
    period = float(np.median(np.concatenate([np.diff(t[at][walk == w]) for w in np.unique(walk)])))
    refuse_coarse(t, period, where)
    delay, side = _delay(t, x, t[at], jump, period)
    kept = t[at] + delay < t[-1]
    return SlipEvents(t[at][kept] + delay, side * jump[kept], walk[kept], period, delay, side < 0)


def _walks(time: Array, sign: NDArray[np.int64], period: float) -> NDArray[np.int64]:
    """Return the number of the walk (from 0) to which each slip belongs, [n]. A new walk starts after a pause
    of more than `APART` times `period` [s], or if the sign of the jumps changes."""
    new = (np.diff(time) > APART * period) | (np.diff(sign) != 0)
    return np.concatenate([[0], np.cumsum(new)])


def _edges(x: Array, half: int) -> Array:
    """Return the mean of `half` samples of the position x [n] after each sample minus the mean of `half`
    samples before, [n]; 0 near both ends."""
    mean = scipy.ndimage.uniform_filter1d(x, half, mode="nearest", origin=0)
    after, before = np.roll(mean, -(half // 2)), np.roll(mean, half - half // 2)
    found = after - before
    found[: 2 * half] = found[-2 * half :] = 0.0
    return found


def _delay(t: Array, x: Array, jumps: Array, sign: NDArray[np.int64], period: float) -> tuple[float, int]:
    """Return the delay [s] of the slips after the jumps of the drive, and the side: +1 if the position jumps
    with the drive, -1 if against it.

    The delay, from -2 samples to a fifth of a period, maximises the magnitude of the sum of the position's
    edges over all jumps; a parabola interpolates between samples.

    Args:
        t, x: times [s] and positions, [n].
        jumps, sign: instants [s] and signs of the drive's jumps, [jumps].
        period: period of the drive, s.
    """
    interval = float(np.median(np.diff(t)))
    half = max(3, min(int(0.05 * period / interval), 40))
    edges = _edges(x, half)
    lags = np.arange(-2, max(4, int(0.2 * period / interval)))
    at = np.searchsorted(t, jumps)[:, None] + lags
    total = (sign[:, None] * edges[np.clip(at, 0, t.size - 1)]).sum(axis=0)
    best = int(np.argmax(np.abs(total)))
    side = 1 if total[best] > 0.0 else -1
    best = int(np.clip(best, 1, lags.size - 2))
    a, b, c = (side * total[best + k] for k in (-1, 0, 1))
    bend = a - 2.0 * b + c
    shift = 0.5 * (a - c) / bend if bend < 0.0 else 0.0
    return float((lags[best] + np.clip(shift, -0.5, 0.5)) * interval), side


def _in_position(t: Array, x: Array, where: str) -> tuple[Array, NDArray[np.int64], float]:
    """Find slips in the position alone; return their instants [s], signs (+1 or -1) and period [s].

    Slips are regular edges, computed with the number of samples at which they exceed the noise most clearly.

    Args:
        t, x: times [s] and positions, [n].
        where: name of the recording in errors.

    Raises:
        RecordingError: no slips exceed the noise, or a period has too few samples.
    """
    best = 0.0, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    half = 2
    while half < x.size // 20:
        clearness, peaks, sign = _stand_out(x, half)
        if clearness > best[0]:
            best = clearness, peaks, sign
        half = int(1.5 * half) + 1
    clearness, peaks, sign = best
    if clearness < ABOVE_NOISE * peaks.size or not peaks.size:
        raise RecordingError(f"no slips exceed the noise in the position of {where}")
    period = float(np.median(np.diff(t[peaks])))
    refuse_coarse(t, period, where)
    return t[peaks], sign, period


def _stand_out(x: Array, half: int) -> tuple[float, NDArray[np.int64], NDArray[np.int64]]:
    """Return clearness, sample indices and signs (+1 or -1) of the edges in the position x [n].

    The clearness is the number of edges times their median height over the rms noise between them. It is 0
    unless at least four edges recur regularly. `half` is the number of samples in each of the two means.
    """
    edges = _edges(x, half)
    slow = edges - scipy.ndimage.median_filter(edges, 8 * half + 1, mode="nearest")
    size = np.abs(slow)
    peaks = scipy.signal.find_peaks(size, height=0.5 * float(size.max()), distance=2 * half)[0]
    none = (0.0, peaks, np.zeros(0, dtype=np.int64))
    if peaks.size < 4:
        return none
    apart = np.diff(peaks)
    period = float(np.median(apart))
    regular = np.mean(np.abs(apart / period - np.maximum(1, np.round(apart / period))) < IRREGULAR)
    away = np.ones(x.size, dtype=bool)
    for p in peaks:
        away[max(p - 2 * half, 0) : p + 2 * half] = False
    if regular < 0.7 or half > 0.3 * period or np.count_nonzero(away) < 10:
        return none
    noise = float(np.sqrt(np.mean(slow[away] ** 2)))
    return (
        peaks.size * float(np.median(size[peaks])) / (noise or 1e-300),
        peaks,
        np.sign(slow[peaks]).astype(int),
    )
