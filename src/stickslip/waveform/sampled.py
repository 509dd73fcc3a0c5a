"""Drive signal given by samples: an arbitrary waveform, or the drive channel of a recording."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..quantities import registry
from ..quantities.records import Quantity
from ..quantities.units import QuantityError, array_si
from .drive import Drive
from .pieces import cut, polynomials, repeat_table, wrapped
from .signal import Unit, breaks_within, check_unit, slope_at, value_at

_PERIOD = Quantity("s", "T", "period", above=0)


@dataclass(frozen=True, eq=False)
class Sampled:
    """Samples, joined by lines ("linear") or each held until the next ("hold", as a converter does).

    Fields: `times` [n], s, ascending, the first >= 0; `values` [n], V, m or rad (`unit`); `period`, s, or
    None for a signal that does not repeat. Without a period, the signal has the first value before the first
    time, and the last value after the last time, which is its `duration`.

    With a period, the samples are repeated without end; all must lie within the period. The last sample is
    joined to the first one of the next period in the same way as the others. With lines, the last time may
    equal the period, and the signal jumps there: ``Sampled([0, 0.2], [0, 65], period=0.2)`` is a sawtooth.

    Raises:
        QuantityError: there are no samples; lengths differ; a number is NaN; times are negative, not
            ascending or not within the period; or a unit or the interpolation is wrong.
    """

    times: NDArray[np.float64]
    values: NDArray[np.float64]
    interpolation: Literal["linear", "hold"] = "linear"
    unit: Unit = "V"
    period: float | None = None

    value, slope, breaks = value_at, slope_at, breaks_within

    def __post_init__(self) -> None:
        check_unit(self.unit, "Sampled")
        if self.interpolation not in ("linear", "hold"):
            raise QuantityError(f"Sampled.interpolation = {self.interpolation!r}: it is 'linear' or 'hold'")
        times = _samples(self.times, "Sampled.times", "s")
        values = _samples(self.values, "Sampled.values", self.unit)
        if len(times) != len(values):
            raise QuantityError(
                f"Sampled has {len(times)} times (in s) for {len(values)} values (in {self.unit})"
            )
        if times[0] < 0:
            raise QuantityError(f"Sampled.times[0] = {times[0]:g} s is out of range: times must be >= 0 s")
        back = np.flatnonzero(np.diff(times) <= 0)
        if len(back):
            before, late = times[back[0] : back[0] + 2].tolist()
            raise QuantityError(
                f"Sampled.times[{back[0] + 1}] = {late!r} s does not ascend: {before!r} s came before"
            )
        if self.period is not None:
            period = _PERIOD.check(self.period, "Sampled.period")
            last = float(times[-1])
            if last > period or (self.interpolation == "hold" and last == period):
                raise QuantityError(
                    f"Sampled.times[{len(times) - 1}] = {last!r} s is out of range: a period of {period!r} s "
                    "ends before"
                )
            object.__setattr__(self, "period", period)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    @classmethod
    def from_recording(
        cls, recording: Mapping[str, Any], name: str, interpolation: Literal["linear", "hold"] = "linear"
    ) -> Sampled:
        """Return a waveform from one variable of a recording; its time starts at the first sample.

        Args:
            recording: an ``xarray.Dataset`` over "time".
            name: name of the variable; its attribute `units` must be "V", "m" or "rad".
            interpolation: "linear" or "hold", see `Sampled`.

        Raises:
            QuantityError: there is no such variable, or it is not suitable.
        """
        if name not in recording:
            raise QuantityError(f"the recording has no {name!r}; it has {', '.join(map(str, recording))}")
        times = array_si(recording["time"], "s", "time")
        unit = recording[name].attrs.get("units", "no unit")
        return cls(times - times[:1], recording[name], interpolation, unit)

    @property
    def duration(self) -> float:
        """Return the time of the last sample, s; infinite with a period."""
        return float(self.times[-1]) if self.period is None else math.inf

    def range(self) -> tuple[float, float]:
        """Return the exact least and greatest value of the drive."""
        return float(self.values.min()), float(self.values.max())

    def drive(self, duration: float) -> Drive:
        """Return the drive for 0 <= t < duration [s] as a table of segments with formulas (`Drive`)."""
        start, polynomial = self.times, np.zeros((len(self.times), 4))
        polynomial[:, 0] = self.values
        if self.interpolation == "linear":
            polynomial[:-1, 1] = np.diff(self.values) / np.diff(self.times)
        if self.period is None:
            if start[0] > 0:
                start, polynomial = np.append(0.0, start), np.vstack([[self.values[0], 0, 0, 0], polynomial])
            return cut(polynomials(start, polynomial), duration)
        # Time from the last sample to the first sample of the next period; if 0, the signal jumps there.
        around = start[0] + (self.period - start[-1])
        if self.interpolation == "linear" and around > 0:
            polynomial[-1, 1] = (self.values[0] - self.values[-1]) / around
        return repeat_table(wrapped(start, polynomial, self.period), self.period, None, duration)


def _samples(values: ArrayLike, field: str, unit: str) -> NDArray[np.float64]:
    array = array_si(values, unit, field)
    if array.ndim != 1 or not len(array):
        raise QuantityError(f"{field} has the shape {array.shape}: one row of numbers in {unit} is expected")
    bad = np.flatnonzero(~np.isfinite(array))
    if len(bad):
        raise QuantityError(f"{field}[{bad[0]}] = {array[bad[0]]} is not finite (expected {unit})")
    array.setflags(write=False)
    return array


registry.waveforms.add(Sampled)
