"""Faults of instruments that residuals show: jumps, bursts, spikes, freezes, hum, clock jitter and drift."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.units import with_prefix
from .hum import HumLine, lines
from .jitter import scatter
from .jumps import events
from .lack import KnownNoise
from .outliers import TO_DEVIATION, spikes

# FEWEST_FROZEN: fewest equal samples in succession that count as a frozen channel. MOVED: smallest range of
# the model during these samples, as a multiple of the converter step or of the noise's standard deviation,
# whichever is larger.
FEWEST_FROZEN, MOVED = 5, 4.0
# PARTS: number of equal parts of a recording whose mean residuals are tested for drift. LEAST_PART: fewest
# samples in a part. The standard deviation of the means is a drift if it exceeds both WANDERS times the
# residuals' standard deviation, and ABOVE_WHITE times the value for white noise.
PARTS, LEAST_PART, WANDERS, ABOVE_WHITE = 16, 8, 0.3, 3.0
# Change of a fitted value by a fault, in standard errors, above which the interval of the value counts as
# unreliable.
MOVES = 1.0
ADVICE = {
    "jump": "end the recording before it, or record again",
    "burst": "leave these samples out, or record again",
    "spikes": "leave these samples out, or record again",
    "freeze": "end the recording before it, or record again",
    "hum": "find its source, or record with a drive whose frequency does not divide it",
}
# Smallest jump, burst or drift that is reported, as a share of the channel's range; smaller ones may be
# errors of the simulation.
NEGLIGIBLE = 1e-4

Array = NDArray[np.float64]


class Disturbance(NamedTuple):
    """Fault of an instrument, as the residuals of a recording show it.

    Attributes:
        kind: "jump", "burst", "spikes", "freeze", "hum", "jitter" or "drift".
        name: name of the recording.
        when: start [s], in the time of the recording; the instant of the largest of several spikes; the first
            sample if the fault lasts throughout.
        lasts: duration [s].
        size: error of the channel, in `unit`: change of level (measured minus model), largest spike, motion
            hidden by a freeze, amplitude of a hum, or rms of a drift; for jitter, the standard deviation of
            the sampling instants [s].
        unit: unit of the size: that of the data, "s" for jitter.
        frequency: frequency of a hum [Hz]; 0 otherwise.
        samples: number of affected samples; all of them for jitter, hum and drift; always 1 for spikes.
        spikes: instants of all spikes [s].
        moved, moves: name of the fitted value that the fault changes most, and this change in standard
            errors; "" and NaN if unknown. For a jump, burst or freeze, these are the standard errors that the
            fit would have without the fault.
    """

    kind: str
    name: str
    when: float
    lasts: float
    size: float
    unit: str
    frequency: float = 0.0
    samples: int = 0
    spikes: tuple[float, ...] = ()
    moved: str = ""
    moves: float = math.nan

    @property
    def statement(self) -> str:
        """Return a sentence with the recording's name, and the kind, time and size of the fault."""
        size, when = with_prefix(abs(self.size), self.unit, 3), f"{self.when:.4g} s"
        lasts = with_prefix(self.lasts, "s", 3)
        match self.kind:
            case "jump":
                return f"{self.name} jumps by {size} at {when}"
            case "burst":
                return f"{self.name} is off by {size} from {when} on, for {lasts} ({self.samples} samples)"
            case "spikes" if len(self.spikes) == 1:
                return f"{self.name} has a spike of {size} at {when}"
            case "spikes":
                return f"{self.name} has {len(self.spikes)} spikes of up to {size}, the largest at {when}"
            case "freeze":
                return f"{self.name} freezes at {when} for {lasts}, while the model moves by {size}"
            case "hum":
                hertz = f"{self.frequency:.4g} Hz"
                return f"{self.name} has a hum of {hertz} with an amplitude of {size}"
            case "jitter":
                share = 100.0 * self.size * self.samples / self.lasts
                return (
                    f"the clock of {self.name} jitters: its samples are early or late by {size} rms, "
                    f"{share:.2g} % of a sampling interval"
                )
        return f"the noise of {self.name} wanders by {size} rms (drift or 1/f noise)"

    @property
    def sentence(self) -> str:
        """Return the statement together with the effect on a fitted value, if known, and advice if the
        intervals are unreliable. For jitter and drift, the sentence says that the intervals allow for the
        fault."""
        if self.kind == "jitter":
            return f"{self.statement}; the intervals allow for it"
        if self.kind == "drift":
            return f"{self.statement}; the intervals allow for it, unless it led to another minimum"
        if not self.moved:
            return self.statement
        by = f"{self.statement}, which moves {self.moved} by {self.moves:.2g} standard errors"
        if not self.moves > MOVES:
            return by
        return f"{by}; the intervals are not to be trusted: {ADVICE[self.kind]}"

    def shapes(self, times: Array) -> Array:
        """Return the time courses that describe the fault at the times [n], s, as columns, shape (n, k).

        A jump has a step; a hum has cosine and sine; spikes, bursts and freezes have a column for each
        affected sample; jitter and drift have no column.
        """
        if self.kind == "jump":
            return (times >= self.when).astype(float)[:, None]
        if self.kind == "hum":
            return HumLine(self.frequency, 0.0).shape_at(times)
        if self.kind == "spikes":
            return np.eye(times.size)[:, np.isin(times, self.spikes)]
        if self.kind in ("burst", "freeze"):
            within = np.flatnonzero((times >= self.when) & (times < self.when + self.lasts))
            return np.eye(times.size)[:, within]
        return np.zeros((times.size, 0))


def disturbances(
    residuals: Array,
    times: Array,
    *,
    slope: Array | None = None,
    measured: Array | None = None,
    jacobian: Array | None = None,
    known: KnownNoise | None = None,
    name: str = "the recording",
    unit: str = "m",
) -> tuple[Disturbance, ...]:
    """Return the faults of instruments that the residuals of one recording show, in the order freezes,
    jitter, spikes, hum, jumps and bursts, drift. Their fields `moved` and `moves` are not yet known.

    Args:
        residuals: model minus measured, at equal intervals, in the unit of the data, [n].
        times: times of the samples, s, [n].
        slope: speed of the model, in the unit of the data per s, [n]; without it, jitter is not searched for.
        measured: measured values, in the unit of the data, [n]; without them, freezes are not searched for.
        jacobian: derivatives of the residuals by the fitted coordinates, [n, k]; jumps, bursts and drifts
            that other values of the parameters could describe are not reported.
        known: `KnownNoise` of the recording, with its converter step, rest and periods.
        name: name of the recording.
        unit: unit of the data.
    """
    known = known or KnownNoise()
    r = np.array(residuals, dtype=float)
    columns = np.zeros((r.size, 0)) if jacobian is None else np.asarray(jacobian, dtype=float)
    columns = columns[:, np.all(np.isfinite(columns), axis=0)]
    interval = float(times[-1] - times[0]) / (r.size - 1)
    period, found = known.period[1], list[Disturbance]()

    def seen(kind: str, first: int, count: int, size: float, of: str = unit, **more: Any) -> None:
        found.append(
            Disturbance(kind, name, float(times[first]), count * interval, size, of, samples=count, **more)
        )

    wrong = np.zeros(r.size, dtype=bool)
    if measured is not None:
        for first, last, moved in frozen(np.asarray(measured, dtype=float), r, known.step):
            seen("freeze", first, last - first, moved)
            wrong[first:last] = True
    r = _bridged(r, wrong)
    speed = scatter(r, np.zeros(r.size) if slope is None else slope * interval, period)
    if speed.independent:
        seen("jitter", 0, r.size, speed.delay * interval, "s")
        r = speed.narrowed(r)
    single = spikes(r, known.step)
    if single.size:
        wrong[single] = True
        off = r - _bridged(r, wrong)
        largest = int(single[np.argmax(np.abs(off[single]))])
        seen("spikes", largest, 1, -float(off[largest]), spikes=tuple(map(float, times[single])))
        r = _bridged(r, wrong)
    for line in lines(r, period, known.at_rest):
        seen("hum", 0, r.size, line.amplitude, frequency=line.frequency / interval)
        columns = np.column_stack([columns, line.shape(r.size)])
    least = NEGLIGIBLE * float(np.ptp(measured)) if measured is not None else 0.0
    for event in events(r, columns, known.step / math.sqrt(12.0), least):
        kind = "jump" if event.last == r.size else "burst"
        seen(kind, event.first, event.last - event.first, -event.size)
        columns = np.column_stack([columns, event.shape(r.size)])
    wander = _wander(r, columns)
    if wander > max(least, known.step):
        seen("drift", 0, r.size, wander)
    return tuple(found)


def frozen(measured: Array, residuals: Array, step: float) -> list[tuple[int, int, float]]:
    """Return a tuple for each frozen part of a recording: index of the first sample, index after the last
    sample, and range of the model's values between them, in the unit of the data.

    Args:
        measured, residuals: measured values, and model minus measured values, [n].
        step: converter step, in the unit of the data; 0: unknown.
    """
    model, same = residuals + measured, np.diff(measured) == 0.0
    noise = TO_DEVIATION * float(np.median(np.abs(np.diff(measured, 2)))) / math.sqrt(6.0)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    found = []
    for first, last in zip(ends[::2], ends[1::2] + 1, strict=True):
        moved = float(np.ptp(model[first:last]))
        if last - first >= FEWEST_FROZEN and moved > MOVED * max(step, noise):
            found.append((int(first), int(last), moved))
    return found


def _bridged(r: Array, wrong: NDArray[np.bool_]) -> Array:
    """Return the residuals r [n] with straight lines between their neighbours in place of the samples that
    `wrong` [n] marks."""
    right = np.flatnonzero(~wrong)
    return np.asarray(np.interp(np.arange(r.size), right, r[right])) if right.size else r


def _wander(r: Array, columns: Array) -> float:
    """Return the drift of residuals r [n]: the standard deviation of the means of `PARTS` equal parts, in the
    unit of r; 0 below the limits `WANDERS` and `ABOVE_WHITE`, or if the parts are too short.

    The part of r that a constant and `columns` [n, k] describe is subtracted first.
    """
    ones = np.column_stack([columns, np.ones(r.size)])
    norms = np.linalg.norm(ones, axis=0)
    ones = ones[:, norms > 0.0] / norms[norms > 0.0]
    left = r - ones @ np.linalg.lstsq(ones, r, rcond=1e-9)[0]
    size = left.size // PARTS
    if size < LEAST_PART:
        return 0.0
    means = left[: PARTS * size].reshape(PARTS, size).mean(axis=1)
    wander = float(np.std(means))
    return wander if wander > max(WANDERS, ABOVE_WHITE / math.sqrt(size)) * float(np.std(left)) else 0.0
