"""A drive signal given by its samples: an arbitrary waveform, or the drive channel of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..records import Quantity
from ..units import QuantityError
from .drive import Drive
from .pieces import cut
from .signal import Unit, breaks_within, check_unit, slope_at, value_at


@dataclass(frozen=True, eq=False)
class Sampled:
    """Samples, joined by lines ("linear") or each held until the next ("hold", as a DAC does).

    Fields: `times` [n], s, ascending, the first >= 0; `values` [n], V or m. The first value holds before the
    first time, the last one after the last, where `duration` ends.

    Raises:
        QuantityError: no samples, different lengths, NaN, times negative or not ascending, wrong unit.
    """

    times: NDArray[np.float64]
    values: NDArray[np.float64]
    interpolation: Literal["linear", "hold"] = "linear"
    unit: Unit = "V"

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
            i = int(back[0]) + 1
            raise QuantityError(
                f"Sampled.times[{i}] = {times[i]!r} s does not ascend: {times[i - 1]!r} s came before"
            )
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    @classmethod
    def at_rate(
        cls,
        sample_rate: float,
        values: ArrayLike,
        interpolation: Literal["linear", "hold"] = "linear",
        unit: Unit = "V",
    ) -> Sampled:
        """Samples at `sample_rate` [Hz] from t = 0 on."""
        rate = Quantity("Hz", "f_s", "sample rate", above=0).check(sample_rate, "Sampled.sample_rate")
        samples = np.asarray(values)
        return cls(np.arange(samples.size) / rate, samples, interpolation, unit)

    @classmethod
    def from_recording(
        cls, recording: Mapping[str, Any], name: str, interpolation: Literal["linear", "hold"] = "linear"
    ) -> Sampled:
        """One variable of a recording (an ``xarray.Dataset`` over "time"), timed from the first sample.

        The unit is the variable's attribute `units`, which must be "V" or "m".
        """
        if name not in recording:
            raise QuantityError(f"the recording has no {name!r}; it has {', '.join(map(str, recording))}")
        times = np.asarray(recording["time"], dtype=float)
        unit = recording[name].attrs.get("units", "no unit")
        return cls(times - times[:1], np.asarray(recording[name]), interpolation, unit)

    @property
    def period(self) -> None:
        """None: it happens once."""

    @property
    def duration(self) -> float:
        """s, the last time"""
        return float(self.times[-1])

    def range(self) -> tuple[float, float]:
        """Exact."""
        return float(self.values.min()), float(self.values.max())

    def drive(self, duration: float) -> Drive:
        """The segment table for 0 <= t < duration [s]."""
        slope = np.zeros(len(self.times))
        if self.interpolation == "linear":
            slope[:-1] = np.diff(self.values) / np.diff(self.times)
        start, level = self.times, self.values
        if start[0] > 0:
            start, level, slope = np.append(0.0, start), np.append(level[0], level), np.append(0.0, slope)
        # a sample that changes nothing on a flat stretch is no break: the solver need not stop there
        flat = (np.diff(level) == 0) & (slope[1:] == 0)
        kept = np.append(True, ~flat)
        polynomial = np.zeros((np.count_nonzero(kept), 4))
        polynomial[:, 0], polynomial[:, 1] = level[kept], slope[kept]
        first = np.zeros(len(polynomial) + 1, dtype=np.int64)
        return cut(Drive(float(level[0]), start[kept], polynomial, first, np.zeros((0, 4))), duration)


def _samples(values: ArrayLike, field: str, unit: str) -> NDArray[np.float64]:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise QuantityError(f"{field} holds something that is no number (expected {unit})") from None
    if array.ndim != 1 or not len(array):
        raise QuantityError(f"{field} has the shape {array.shape}: one row of numbers in {unit} is expected")
    bad = np.flatnonzero(~np.isfinite(array))
    if len(bad):
        raise QuantityError(f"{field}[{bad[0]}] = {array[bad[0]]} is not finite (expected {unit})")
    array.setflags(write=False)
    return array
