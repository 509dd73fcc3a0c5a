"""The drive as it is at the piezo: when it begins in a recording, how fast its jumps are, what repeats."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import correlate

from ...recording import RecordingError, RecordingWarning
from ...units import QuantityError
from ...waveform.drive import Drive, evaluate
from ...waveform.sequence import Sequence
from ...waveform.signal import Waveform, breaks_within, slope_at, value_at
from .channels import channel

# Of the range of the drive; the channel differs from the waveform by no more, on average, if it is of it.
ALIKE = 0.1
# The same over the worst of its periods: late, slewed and noisy as the channel may be.
STRETCH = 0.25
# Samples that it is compared at, one in so many of them all.
MOST_SAMPLES = 2000
# Of a period. A walk is told by the slope of its slow part and the levels before and behind its slip: lines
# through a third and means over a tenth of a period (see `sawtooth`), three samples and one by then.
FEWEST_PER_PERIOD = 10


@dataclass(frozen=True)
class Slewed:
    """A drive whose jumps take the time that the amplifier's `rate` [V/s] needs, as of a current limit.

    What lies between the jumps is slower, and stays.
    """

    source: Waveform
    rate: float

    value, slope, breaks = value_at, slope_at, breaks_within

    def __post_init__(self) -> None:
        if not self.rate > 0:
            raise QuantityError(f"the slew rate {self.rate:g} V/s is out of range: it must be > 0 V/s")

    @property
    def unit(self) -> str:
        """That of the source."""
        return self.source.unit

    @property
    def duration(self) -> float:
        """s, that of the source and of a last jump."""
        low, high = self.source.range()
        return self.source.duration + (high - low) / self.rate

    def range(self) -> tuple[float, float]:
        """That of the source."""
        return self.source.range()

    def drive(self, duration: float) -> Drive:
        """The segment table for 0 <= t < duration [s].

        Raises:
            QuantityError: a jump takes longer than what follows it before the next.
        """
        table = self.source.drive(duration)
        ends = np.append(table.start[1:], np.inf)
        starts, polynomials, rows, harmonics, last = [], [], [0], [], table.before
        for i, (start, end) in enumerate(zip(table.start, ends, strict=True)):
            harmonic = table.harmonic[table.first[i] : table.first[i + 1]]
            taken = _meeting(table, i, last, self.rate, end - start)
            if taken >= end - start:
                raise QuantityError(
                    f"at {self.rate:g} V/s the jump at {start:g} s takes {taken:g} s, more than there is"
                )
            if taken > 1e-9:
                rise = (_at(table, i, taken) - last) / taken
                starts.append(start)
                polynomials.append([last, rise, 0.0, 0.0])
                rows.append(rows[-1])
            else:
                taken = 0.0
            starts.append(start + taken)
            polynomials.append(_shifted(table.polynomial[i], taken))
            rows.append(rows[-1] + len(harmonic))
            for amplitude, omega, phase, chirp in harmonic:
                phase += taken * (omega + chirp * taken)
                harmonics.append([amplitude, omega + 2.0 * chirp * taken, phase, chirp])
            last = _at(table, i, end - start) if np.isfinite(end) else last
        return Drive(
            table.before,
            np.array(starts),
            np.array(polynomials),
            np.array(rows, dtype=np.int64),
            np.array(harmonics).reshape(-1, 4),
        )


def _meeting(table: Drive, i: int, last: float, rate: float, longest: float) -> float:
    """Return when an output that moves from `last` at `rate` [V/s] meets segment i, in s from its start."""
    taken = abs(_at(table, i, 0.0) - last) / rate
    for _ in range(100):  # a contraction by the segment's slope over the rate
        before, taken = taken, abs(_at(table, i, taken) - last) / rate
        if taken >= longest or abs(taken - before) <= 1e-14:
            break
    return taken


def _at(table: Drive, i: int, tau: float) -> float:
    """The value of segment i, also at its very end."""
    c0, c1, c2, c3 = table.polynomial[i].tolist()
    waves = table.harmonic[table.first[i] : table.first[i + 1]].tolist()
    swing = sum(a * math.sin(phase + tau * (omega + chirp * tau)) for a, omega, phase, chirp in waves)
    return c0 + tau * (c1 + tau * (c2 + tau * c3)) + swing


def _shifted(polynomial: np.ndarray, by: float) -> list[float]:
    """Coefficients of the same polynomial from a later time on."""
    c0, c1, c2, c3 = polynomial
    return [
        c0 + by * (c1 + by * (c2 + by * c3)),
        c1 + by * (2.0 * c2 + 3.0 * by * c3),
        c2 + 3.0 * by * c3,
        c3,
    ]


def begin_of(recording: xr.Dataset, drive: Waveform, where: str) -> float:
    """The instant [s] of a recording at which a drive begins, by its channel drive_voltage.

    Where they differ least: in the sum of squares by whole samples, then in the mean between them.

    Raises:
        RecordingError: the channel is missing, too short or constant, or it shows another drive.
    """
    u, t = channel(recording, "drive_voltage", where, varies=True), recording["time"].values
    since, interval = t - t[0], float(t[-1] - t[0]) / (t.size - 1)
    table = drive.drive(float(since[-1]))
    even = np.linspace(0.0, float(since[-1]), t.size)
    shape = evaluate(table, even)[0] - table.before
    common = correlate(np.interp(even, since, u) - table.before, shape)[t.size - 1 :]
    energy = np.cumsum(shape**2)[::-1]
    lag = int(np.argmax(2.0 * common - energy))
    some = np.arange(0, t.size, max(1, t.size // MOST_SAMPLES))

    def difference(begin: float) -> float:
        return float(np.mean(np.abs(evaluate(table, since[some] - begin)[0] - u[some])))

    trials = np.clip(interval * (lag + np.linspace(-1.5, 1.5, 31)), 0.0, None)
    coarse = float(min(trials, key=difference))
    near = (max(coarse - 0.2 * interval, 0.0), coarse + 0.2 * interval)
    fine: Any = minimize_scalar(difference, bounds=near, method="bounded", options={"maxiter": 15})
    begin = min(coarse, float(fine.x), key=difference)
    low, high = drive.range()
    silence = float(np.mean(np.abs(u[some] - table.before)))  # as if it began after the recording's end
    if difference(begin) > min(ALIKE * (high - low), 0.5 * silence):
        raise RecordingError(
            f"drive_voltage [V] of {where} is not the drive that the file names: they differ by "
            f"{difference(begin):.3g} V on average, wherever it begins"
        )
    asked = since <= begin + drive.duration  # what comes later may be anything
    _refuse_stretch(
        since[asked], u[asked], evaluate(table, since[asked] - begin)[0], drive, float(t[0]), where
    )
    return float(t[0]) + begin


def _refuse_stretch(
    since: NDArray[np.float64],
    u: NDArray[np.float64],
    wanted: NDArray[np.float64],
    drive: Waveform,
    start: float,
    where: str,
) -> None:
    """Raise RecordingError where the channel is another drive for as long as a period, as where the waveform
    has a period less than was driven."""
    volts, when = greatest_difference(since, u, wanted, drive)
    low, high = drive.range()
    if volts > STRETCH * (high - low):
        raise RecordingError(
            f"drive_voltage [V] of {where} is not the drive that the file names: even where it fits best, "
            f"they differ by {volts:.3g} V on average about t = {start + when:.4g} s (has the waveform as "
            "many periods as were driven?)"
        )


def warn_of_other_drive(recording: xr.Dataset, drive: Waveform | None, where: str) -> None:
    """Warn where a recording has a channel drive_voltage, and that is not the drive that was given."""
    if drive is None or "drive_voltage" not in recording:
        return
    time, u = recording["time"].values, recording["drive_voltage"].values
    volts, when = greatest_difference(time, u, value_at(drive, time), drive)
    if volts > STRETCH * float(np.ptp(u)) > 0.0:
        warnings.warn(
            f"drive_voltage [V] of {where} is not the drive that is given, and that is what counts: they "
            f"differ by {volts:.3g} V on average about t = {when:.4g} s (a waveform begins at t = 0 of the "
            "recording)",
            RecordingWarning,
            stacklevel=4,
        )


def greatest_difference(
    time: NDArray[np.float64], u: NDArray[np.float64], wanted: NDArray[np.float64], drive: Waveform
) -> tuple[float, float]:
    """By how many volts a channel differs from a drive, on average over the period (of what has none, a tenth
    of it all) in which it does most; and the middle of that [s]."""
    _, periodic = periodic_part(drive)
    whole = float(time[-1] - time[0]) or 1.0  # a single sample
    lasting = 0.1 * whole if periodic is None else float(periodic.period)
    count = int(np.clip(round(lasting / whole * (time.size - 1)), min(10, time.size), time.size))
    so_far = np.append(0.0, np.cumsum(np.abs(u - wanted)))
    mean = (so_far[count:] - so_far[:-count]) / count
    at = int(np.argmax(mean))
    return float(mean[at]), float(time[at + count // 2])


def periodic_part(drive: Any, begin: float = 0.0) -> tuple[float, Any]:
    """When [s] the first part with a period begins, and that part; None where there is none."""
    if isinstance(drive, Slewed):
        return periodic_part(drive.source, begin)
    if not isinstance(drive, Sequence):
        return begin, drive if getattr(drive, "period", None) is not None else None
    for part, length in drive.parts:
        found = periodic_part(part, begin)
        if found[1] is not None:
            return found
        begin += length
    return begin, None


def refuse_sampling(time: NDArray[np.float64], drive: Waveform | None, where: str) -> None:
    """Raise `RecordingError` if a recording is too short or too coarsely sampled for a drive that repeats.

    Args:
        time: of the recording, s.
        drive: in that time; None, or one without a period: nothing is known of what is needed.
        where: what to call the recording.
    """
    begin, periodic = (0.0, None) if drive is None else periodic_part(drive)
    if periodic is None:
        return
    period, interval = float(periodic.period), refuse_coarse(time, float(periodic.period), where)
    lasts = float(time[-1]) - begin
    if lasts < period * (1.0 - 1e-6) - interval:
        raise RecordingError(
            f"end_effector_position [m] of {where} is too short: it ends {lasts:.3g} s after the drive "
            f"begins; at least one period of the drive, {period:.3g} s, is needed"
        )


def refuse_coarse(time: NDArray[np.float64], period: float, where: str) -> float:
    """The sampling interval [s]; raises `RecordingError` if a period [s] of the drive has too few samples."""
    interval = float(np.median(np.diff(time)))
    if period < FEWEST_PER_PERIOD * interval * (1.0 - 1e-6):
        raise RecordingError(
            f"end_effector_position [m] of {where} is too coarsely sampled: {period / interval:.3g} samples "
            f"per period of the drive; at least {FEWEST_PER_PERIOD} are needed, one every "
            f"{period / FEWEST_PER_PERIOD:.3g} s"
        )
    return interval
