"""The drive as it is at the piezo: when it begins in a recording, how fast its jumps are, what repeats."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import correlate

from ...recording import RecordingError
from ...units import QuantityError
from ...waveform.drive import Drive, evaluate
from ...waveform.sequence import Sequence
from ...waveform.signal import Waveform, breaks_within, slope_at, value_at
from .channels import channel

# Of the range of the drive; the channel differs from the waveform by no more, on average, if it is of it.
ALIKE = 0.1
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
            taken = abs(_at(table, i, 0.0) - last) / self.rate
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
    return float(t[0]) + begin


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
