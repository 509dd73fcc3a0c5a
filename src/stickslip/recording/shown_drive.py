"""Recognition of the usual waveforms in a drive channel: step, sawtooth, triangle, sine."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..waveform.drive import evaluate
from ..waveform.periodic import ReverseSawtooth, Sawtooth, Sine, Triangle
from ..waveform.shapes import Step
from ..waveform.signal import Waveform
from .noise import noise_level

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
Drive = Step | Sawtooth | ReverseSawtooth | Triangle | Sine

# MOVED: change of the drive since the first sample, as a share of its range, that shows that the drive has
# started. STILL: largest difference from the level at rest, as a share of the range, of a sample at rest; the
# drive starts after the last such sample. Both are at least SURELY standard deviations of the noise.
MOVED, STILL = 0.02, 1e-4
# Deviation, in standard deviations of the noise, that no sample reaches by chance.
SURELY = 6.0
# Largest differences between a recognised waveform and the channel away from jumps, as a share of the range:
# _NEAR for the median, _OFTEN for 95 % of the samples.
_NEAR, _OFTEN = 0.01, 0.05
# Users choose round numbers, so frequency, amplitude and offset are rounded. _ROUND: largest relative change
# by rounding (of the offset 0.5 % of the channel's range). _AS_GOOD: largest relative increase of the
# residual by rounding or, if larger, _CHANCE divided by the number of samples (three standard errors).
_ROUND, _AS_GOOD, _CHANCE = 0.003, 0.005, 4.5
# Residual, in standard deviations of the channel's white noise, above which other frequencies are tried.
_EXPLAINED = 1.3
_STEPS = 8  # largest number of Gauss-Newton steps; two or three usually suffice
# Increase of the residual by rounding, as a share of the channel's range, that is always allowed.
_EXACT = 1e-6
# Largest number of samples to which a waveform is fitted; of a longer recording, every second, third, ... is
# used.
MOST_FITTED = 100_000
MOST_SAMPLES = 2000  # the start is refined with fewer than twice this number of samples


class RecognisedDrive(NamedTuple):
    """A recognised waveform: its start `begin` [s] in the time of the recording; the `waveform` in time since
    this start; and `residual`, the rms difference [V] between channel and waveform away from jumps."""

    begin: float
    waveform: Drive
    residual: float


def drive_begins(recording: xr.Dataset) -> float | None:
    """Return the time [s] of the last sample at rest before the drive voltage starts to change. The result is
    None without the variable drive_voltage, if it never changes, or if it changes from the first samples
    on."""
    if "drive_voltage" not in recording:
        return None
    drive = recording["drive_voltage"].values
    span = float(np.ptp(drive))
    far = max(MOVED * span, SURELY * noise_level(drive))
    moved = np.flatnonzero(np.abs(drive - drive[0]) > far)
    if not moved.size or moved[0] < 2:
        return None
    rest = drive[: moved[0] // 2 + 1]
    early, late = np.array_split(rest, 2)
    # The drive changes from the first sample on, so there is no rest.
    if abs(float(np.mean(late) - np.mean(early))) > far / 8.0:
        return None
    noise = max(SURELY * float(np.std(rest)), STILL * span)
    still = np.flatnonzero(np.abs(drive[: moved[0]] - np.mean(rest)) <= noise)
    return float(recording["time"].values[still[-1]]) if still.size else None


def best_begin(since: Array, u: Array, drive: Waveform) -> tuple[float, float]:
    """Find when a waveform starts in a drive channel: to a sample by least squares, then between samples by
    the smallest mean absolute difference.

    Args:
        since: sample times from 0 on, s, shape (n,).
        u: samples of the channel, V, shape (n,).
        drive: waveform in time since its start.

    Returns:
        Start of the waveform in the time `since` [s], and mean absolute difference between waveform and
        channel [V].
    """
    table, interval = drive.drive(float(since[-1])), float(since[-1]) / (since.size - 1)
    even = np.linspace(0.0, float(since[-1]), since.size)
    shape = evaluate(table, even)[0] - table.before
    common = scipy.signal.correlate(np.interp(even, since, u) - table.before, shape)[since.size - 1 :]
    energy = np.cumsum(shape**2)[::-1]
    lag = int(np.argmax(2.0 * common - energy))
    some = np.arange(0, since.size, max(1, since.size // MOST_SAMPLES))

    def difference(begin: float) -> float:
        return float(np.mean(np.abs(evaluate(table, since[some] - begin)[0] - u[some])))

    trials = np.clip(interval * (lag + np.linspace(-1.5, 1.5, 31)), 0.0, None)
    coarse = float(min(trials, key=difference))
    near = (max(coarse - 0.2 * interval, 0.0), coarse + 0.2 * interval)
    fine: Any = scipy.optimize.minimize_scalar(
        difference, bounds=near, method="bounded", options={"maxiter": 15}
    )
    begin = min(coarse, float(fine.x), key=difference)
    return begin, difference(begin)


def shown_drive(recording: xr.Dataset) -> RecognisedDrive | None:
    """Return the step, sawtooth, triangle or sine that a recording's channel drive_voltage follows, as a
    `RecognisedDrive`. The result is None if the channel follows none of these, is constant or missing, or has
    fewer than three samples."""
    if "drive_voltage" not in recording or recording.sizes["time"] < 3:
        return None
    start = float(recording["time"].values[0])
    begins = drive_begins(recording)
    whole = recording["time"].values - start, recording["drive_voltage"].values
    count = without_last_jump(whole[1])
    whole = whole[0][:count], whole[1][:count]
    since, volts = (one[:: -(-one.size // MOST_FITTED)] for one in whole)
    begins = 0.0 if begins is None else begins - start
    rest = float(np.mean(volts[since <= begins]))
    if np.ptp(volts) == 0.0:
        return None
    fitted = [_Fitted.of(one, since, volts, rest) for one in _candidates(since - begins, volts - rest)]
    best = min(fitted, key=_residual, default=None)
    if best is None:
        return None
    if best.residual > _EXPLAINED * noise_level(volts) and not isinstance(best.shape, Step):
        unsure = (
            1.5 * float(np.median(np.diff(since))) * best.shape.frequency / float(best.shape.periods or 1.0)
        )
        rates = best.shape.frequency * (1.0 + unsure * np.linspace(-1.0, 1.0, 5))
        shapes = [best.shape._replace(frequency=float(rate)) for rate in rates]
        best = min([best, *(_Fitted.of(shape, since, volts, rest) for shape in shapes)], key=_residual)
    if not best.is_shown(since, volts):
        return None
    best = best.rounded(since, volts)
    # The fit used only some of the samples, and a step may start between these.
    if since.size < whole[0].size:
        best = best._replace(begin=best_begin(*whole, best.shape)[0])
    return best.shown(start)


def flow(drive: Drive) -> str:
    """Return a waveform as YAML text for input files: "{shape: NAME, fields: {amplitude: 65 V, ...}}",
    without fields that are 0."""
    units = {"amplitude": " V", "offset": " V", "frequency": " Hz", "periods": ""}
    fields = {name: getattr(drive, name) for name in units if name in drive._fields}
    said = {name: f"{value:g}{units[name]}" for name, value in fields.items() if value}
    return f"{{shape: {type(drive).__name__}, fields: {{{', '.join(f'{k}: {v}' for k, v in said.items())}}}}}"


def without_last_jump(volts: Array) -> int:
    """Return the number of samples [n], or one less if the channel jumps before its last sample: that sample
    alone does not show where the jump is."""
    return volts.size - int(abs(volts[-1] - volts[-2]) > 0.2 * np.ptp(volts))


def off_jumps(shape: Array) -> NDArray[np.bool_]:
    """Return a mask [n] of the samples of a waveform [n] that are not next to a jump: there, the change per
    sample is below 20 % of the waveform's range."""
    return np.abs(np.gradient(shape)) < 0.2 * np.ptp(shape)


def _candidates(time: Array, moved: Array) -> list[Drive]:
    """Return the waveforms to try, with the amplitude, frequency and number of periods that the channel
    shows: a step, or two sawtooths, a triangle and two sines; empty if the channel does not alternate.

    Args:
        time: sample times since the start of the drive, s.
        moved: voltages minus the level at rest, V.
    """
    low, high = float(moved.min()), float(moved.max())
    level = np.where(moved > low + 0.7 * (high - low), 1, np.where(moved < low + 0.3 * (high - low), 0, -1))
    known = np.flatnonzero(level >= 0)
    turns = np.diff(level[known])
    ups, downs = (time[known[1:]][turns == one] for one in (1, -1))
    size = high if abs(high) >= abs(low) else low
    if len(ups) + len(downs) == 1:
        return [Step(size)]
    edges = max(ups, downs, key=len)
    if len(edges) < 2:
        return []
    apart = float(edges[-1] - edges[0])
    rate = (len(edges) - 1) / apart
    left = time[np.abs(moved) > max(0.02 * (high - low), SURELY * noise_level(moved))]
    # No sample differs from the level at rest by more than the noise.
    if not left.size:
        return []
    count = float(max(1, round(float(left[-1]) * rate + 0.02)))
    shapes: list[Drive] = [one(size, rate, periods=count) for one in (Sawtooth, ReverseSawtooth, Triangle)]
    return [*shapes, Sine(size, rate, periods=count), Sine(-size, rate, periods=count)]


class _Fitted(NamedTuple):
    """A waveform (`shape`, in time since its start) that is fitted to a channel; its start `begin` in s since
    the first sample; and the rms `residual` in V away from jumps."""

    shape: Drive
    begin: float
    residual: float

    @classmethod
    def of(cls, shape: Drive, since: Array, volts: Array, rest: float) -> _Fitted:
        shape = shape._replace(offset=rest)
        begin, _ = best_begin(since, volts, shape)
        return cls(shape, begin, np.inf).refined(since, volts)

    def refined(self, since: Array, volts: Array, fixed: tuple[str, ...] = ()) -> _Fitted:
        """Return the waveform whose parameters fit the samples away from jumps by least squares
        (Gauss-Newton).

        Args:
            since: times since the first sample, s.
            volts: samples of the channel, V.
            fixed: names of parameters that keep their values: "amplitude", "offset" and "frequency" are
                possible.
        """
        best = self.judged(since, volts)
        for _ in range(_STEPS):
            near, columns = best.slopes(since)
            columns = {name: column for name, column in columns.items() if name not in fixed}
            matrix = np.column_stack([*columns.values()])[near]
            left = (volts - best.at(since))[near]
            moves = np.linalg.lstsq(matrix, left, rcond=None)[0]
            tried = best.moved(dict(zip(columns, moves.tolist(), strict=True))).judged(since, volts)
            if not tried.residual < best.residual * (1.0 - 1e-6):
                break
            best = tried
        return best

    def slopes(self, since: Array) -> tuple[NDArray[np.bool_], dict[str, Array]]:
        """Return a mask [n] of the samples away from jumps at the times `since` [s], and the derivatives [n]
        of the waveform by its parameters: a dictionary with the keys amplitude, offset, begin (the start)
        and, unless it is a step, frequency."""
        own, after = self.at(since), np.maximum(since - self.begin, 0.0)
        slope = np.where(since >= self.begin, self.shape.slope(after), 0.0)
        columns = {
            "amplitude": (own - self.shape.offset) / self.shape.amplitude,
            "offset": np.ones(since.size),
            "begin": -slope,
        }
        if not isinstance(self.shape, Step):
            columns["frequency"] = slope * after / self.shape.frequency
        return off_jumps(own), columns

    def moved(self, by: dict[str, float]) -> _Fitted:
        begin = max(self.begin + by.pop("begin"), 0.0)
        values = {name: getattr(self.shape, name) + change for name, change in by.items()}
        if values.get("frequency", 1.0) <= 0.0:
            return self
        return self._replace(begin=begin, shape=self.shape._replace(**values))

    def at(self, since: Array) -> Array:
        """Return the voltages [n] of the waveform, V, at times `since` [s] after the first sample of the
        recording; before its start, the offset."""
        value = self.shape.value(np.maximum(since - self.begin, 0.0))
        return np.where(since >= self.begin, value, self.shape.offset)

    def judged(self, since: Array, volts: Array) -> _Fitted:
        off = self.off(since, volts)
        return self._replace(residual=float(np.sqrt(np.mean(off**2))) if off.size else np.inf)

    def off(self, since: Array, volts: Array) -> Array:
        """Return the absolute differences between channel and waveform, V, of only those samples that are
        away from the waveform's jumps."""
        own = self.at(since)
        return np.abs(volts - own)[off_jumps(own)]

    def is_shown(self, since: Array, volts: Array) -> bool:
        """Return True if a channel (times since its first sample [s], voltages [V]) follows this waveform.
        Over 80 % of the samples must be away from its jumps, and agree within twice the channel's white noise
        or about 1 % of the range.

        Up to 5 % of the samples may be farther away. The result is False if fewer than 80 % of the samples
        are away from jumps.
        """
        span, off = float(np.ptp(volts)), self.off(since, volts)
        if off.size <= 0.8 * volts.size:
            return False
        often = float(np.quantile(off, 0.95))
        left = float(np.sqrt(np.mean(off[off <= often] ** 2)))
        near = np.median(off) < _NEAR * span and often < _OFTEN * span
        return bool(near and left < max(_NEAR * span, 2.0 * noise_level(volts)))

    def rounded(self, since: Array, volts: Array) -> _Fitted:
        """Return the waveform with the roundest numbers for frequency, offset and amplitude with which the
        residual hardly increases; the arguments are times since the first sample [s] and voltages [V]."""
        most = (1.0 + max(_AS_GOOD, _CHANCE / since.size)) * self.residual + _EXACT * float(np.ptp(volts))
        best, fixed = self, ()
        for name in ("frequency", "offset", "amplitude"):
            if name in best.shape._fields:
                fixed = (*fixed, name)
                best = best._with_round(name, fixed, since, volts, most)
        return best

    def _with_round(
        self, name: str, fixed: tuple[str, ...], since: Array, volts: Array, most: float
    ) -> _Fitted:
        def of(value: float) -> _Fitted:
            return self._replace(shape=self.shape._replace(**{name: value})).refined(since, volts, fixed)

        value = float(getattr(self.shape, name))
        within = 0.005 * float(np.ptp(volts)) if name == "offset" else _ROUND * abs(value)
        return of(_roundest(value, within, lambda one: of(one).residual <= most))

    def shown(self, start: float) -> RecognisedDrive:
        """Return the waveform as a `RecognisedDrive`, with its start in the time of a recording whose first
        sample is at `start` [s]."""
        return RecognisedDrive(start + self.begin, self.shape, self.residual)


def _residual(one: _Fitted) -> float:
    return one.residual


def _roundest(value: float, within: float, fits: Callable[[float], bool]) -> float:
    """Return the roundest number (0, then the fewest digits) that differs from `value` by at most `within`
    and for which the function `fits` returns True. If no such number exists, return `value` itself."""
    roundings = (0.0, *(float(f"{value:.{digits}g}") for digits in (1, 2, 3, 4, 5)))
    near = (one for one in roundings if abs(one - value) <= within)
    return next((one for one in near if fits(one)), value)
