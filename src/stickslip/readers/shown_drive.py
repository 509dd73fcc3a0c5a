"""The waveform that a drive channel shows, where it shows one."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..waveform.periodic import ReverseSawtooth, Sawtooth, Sine, Triangle
from ..waveform.shapes import Step
from .inspection import drive_begins

Array = NDArray[np.float64]
Drive = Step | Sawtooth | ReverseSawtooth | Triangle | Sine

# Of the drive's range: in half of the samples it is nearer than `_NEAR`, in 95 % nearer than `_OFTEN`; the
# others are beside jumps.
_NEAR, _OFTEN = 0.01, 0.05
# People set round numbers: the roundest within this, which a lag of the amplifier is worth.
_ROUND = 0.003


def shown_drive(recording: xr.Dataset) -> tuple[float, Drive] | None:
    """When [s] the drive of a recording begins, and the waveform that it is from then on: with the first
    sample where it never rests. None where none of the usual ones is it."""
    if "drive_voltage" not in recording:
        return None
    begins = drive_begins(recording)
    if begins is None:
        begins = float(recording["time"].values[0])
    time = recording["time"].values - begins
    volts = recording["drive_voltage"].values
    rest = float(np.mean(volts[time <= 0.0]))
    moved = volts - rest
    if np.ptp(moved) == 0.0:
        return None
    fitted = [_fitted(one, time, moved, rest) for one in _candidates(time, moved)]
    fitting = [one for one in fitted if one is not None]
    return (begins, min(fitting, key=lambda one: one[1])[0]) if fitting else None


def flow(drive: Drive) -> str:
    """The waveform as files name it."""
    units = {"amplitude": " V", "offset": " V", "frequency": " Hz", "periods": ""}
    fields = {name: getattr(drive, name) for name in units if name in drive._fields}
    said = {name: f"{value:g}{units[name]}" for name, value in fields.items() if value}
    return f"{{shape: {type(drive).__name__}, fields: {{{', '.join(f'{k}: {v}' for k, v in said.items())}}}}}"


def _candidates(time: Array, moved: Array) -> list[Drive]:
    """Of the right length and frequency, of amplitude 1."""
    low, high = float(moved.min()), float(moved.max())
    level = np.where(moved > low + 0.7 * (high - low), 1, np.where(moved < low + 0.3 * (high - low), 0, -1))
    known = np.flatnonzero(level >= 0)
    turns = np.diff(level[known])
    ups, downs = (time[known[1:]][turns == one] for one in (1, -1))
    sign = 1.0 if abs(high) >= abs(low) else -1.0
    if len(ups) + len(downs) == 1:
        return [Step(sign)]
    edges = max(ups, downs, key=len)
    if len(edges) < 2:
        return []
    apart = float(edges[-1] - edges[0])
    rate = _rounded((len(edges) - 1) / apart, 1.5 * float(np.median(np.diff(time))) / apart)
    left = time[np.abs(moved) > 0.02 * (high - low)]
    count = float(max(1, round(float(left[-1]) * rate + 0.02)))
    shapes: list[Drive] = [one(sign, rate, periods=count) for one in (Sawtooth, ReverseSawtooth, Triangle)]
    return [*shapes, Sine(1.0, rate, periods=count)]


def _fitted(shape: Drive, time: Array, moved: Array, rest: float) -> tuple[Drive, float] | None:
    """The waveform with its amplitude and how far it is off, over the range; None where it is too far."""
    step, best = float(np.median(np.diff(time))), None
    span = float(np.ptp(moved))
    for shift in np.linspace(-1.0, 1.0, 9) * step:
        unit = np.where(time >= shift, shape.value(np.maximum(time - shift, 0.0)), 0.0)
        near = np.abs(np.gradient(unit)) < 0.2  # off the jumps, whose side is a matter of a sample
        size = float(unit[near] @ moved[near]) / max(float(unit[near] @ unit[near]), 1e-300)
        off = np.abs(moved - size * unit)[near] / span
        if best is None or np.mean(off) < best[1]:
            good = np.median(off) < _NEAR and np.quantile(off, 0.95) < _OFTEN and near.mean() > 0.8
            best = (size * shape.amplitude if good else None, float(np.mean(off)))
    if best is None or best[0] is None:
        return None
    offset = 0.0 if abs(rest) < 0.005 * span else _rounded(rest)
    return shape._replace(amplitude=_rounded(best[0]), offset=offset), best[1]


def _rounded(value: float, unsure: float = 0.0) -> float:
    roundings = (float(f"{value:.{digits}g}") for digits in (1, 2, 3))
    return next(
        (one for one in roundings if abs(one - value) <= max(_ROUND, unsure) * abs(value)),
        float(f"{value:.4g}"),
    )
