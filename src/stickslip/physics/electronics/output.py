"""Output stage of a drive: converter and amplifier, from a program's values to the voltage at the piezo.

Step tables, loops and searches for drives know the hardware only through the record `OutputStage`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, to_si, with_prefix
from ...waveform.sampled import Sampled
from ...waveform.signal import Waveform
from .amplifier import Amplifier, limits
from .driven import driven_period

# Smallest number of updates of the converter in a period of a drive.
FEWEST = 4
_INF = math.inf
_RATE = Quantity("Hz", "f_DA", "updates per second", above=0)
# End of the output range, V, of an amplifier that represents a slope limit alone; no drive reaches it.
_FAR = 1e9


@record
class OutputStage(NamedTuple):
    """A converter with a fixed update rate, and an amplifier that charges the piezo.

    The values of a drive are multiples of `step` [V] at the piezo (0: any value), each held until the next
    update or interpolated linearly; `points` is their largest number in a period. With an infinite
    `update_rate` there is no converter. Drives are limited to `slew_rate` [V/s] and `current` [A]. A finite
    current or an `amplifier` requires the `capacitance` [F] (`Stack.load`). With an `amplifier`, the drive
    at the piezo is the amplifier's output.
    """

    update_rate: Annotated[float, Quantity("Hz", "f_DA", "updates per second", above=0, maximum=_INF)] = _INF
    points: Annotated[float, Quantity("", "N", "most points of a period", minimum=FEWEST, maximum=_INF)] = (
        _INF
    )
    step: Annotated[float, Quantity("V", "q", "voltage step", minimum=0)] = 0.0
    interpolation: Literal["hold", "linear"] = "hold"
    slew_rate: Annotated[
        float, Quantity("V/s", "R", "greatest slope of the voltage", above=0, maximum=_INF)
    ] = _INF
    current: Annotated[float, Quantity("A", "I", "greatest current", above=0, maximum=_INF)] = _INF
    capacitance: Annotated[float | None, Quantity("F", "C", "capacitance of the piezo", above=0)] = None
    amplifier: Amplifier | None = None

    def _check(self) -> None:
        if math.isfinite(self.points) and self.points % 1:
            raise QuantityError(f"OutputStage.points = {self.points:g} must be a whole number")
        if math.isinf(self.update_rate) and (math.isfinite(self.points) or self.step):
            name = "points" if math.isfinite(self.points) else "step"
            raise QuantityError(
                f"OutputStage.update_rate [Hz] is missing: the converter with that {name} updates at it"
            )
        if self.interpolation not in ("hold", "linear"):
            raise QuantityError(
                f"OutputStage.interpolation = {self.interpolation!r}: it is 'hold' or 'linear'"
            )
        if (math.isfinite(self.current) or self.amplifier) and self.capacitance is None:
            raise QuantityError(
                "OutputStage.capacitance [F] is missing: a current limits the slope of the voltage by it"
            )

    @classmethod
    def of_amplifier(cls, amplifier: Amplifier, capacitance: float | str) -> OutputStage:
        """Return an output stage without a converter, with an amplifier into a capacitance [F] and with the
        amplifier's limits; the current limit is the steady (rms) one."""
        current = min(amplifier.max_current, amplifier.rms_current)
        farad = to_si(capacitance, "F", "capacitance")
        return cls(slew_rate=amplifier.slew_rate, current=current, capacitance=farad, amplifier=amplifier)

    def with_converter(self, other: OutputStage) -> OutputStage:
        """Return an output stage with this amplifier and its limits, and the converter of another output
        stage."""
        return self._replace(
            update_rate=other.update_rate,
            points=other.points,
            step=other.step,
            interpolation=other.interpolation,
        )

    @property
    def updates(self) -> bool:
        """Return True if the output stage has a converter, whose update rate is finite."""
        return math.isfinite(self.update_rate)

    @property
    def slope(self) -> float:
        """Return the largest slope of a drive that slew rate and current allow, V/s; infinite without
        limits."""
        return min(self.slew_rate, self.current / self.capacitance if self.capacitance else _INF)

    @property
    def lag(self) -> float:
        """Return the time constant of the amplifier into the piezo, s; 0 without an amplifier."""
        if self.amplifier is None or self.capacitance is None:
            return 0.0
        return float(limits(self.amplifier, self.capacitance).tau)

    def played_period(self, period: Any) -> Any:
        """Return periods [s] as the converter outputs them: rounded to a whole number of updates, at least
        one. Without a converter they are unchanged."""
        if not self.updates:
            return period
        return np.maximum(np.rint(np.asarray(period) * self.update_rate), 1.0) / self.update_rate

    def played(self, waveform: Waveform, low: float, high: float) -> Sampled:
        """Return one period of a periodic waveform as the converter, which must exist, outputs it, repeated
        without end.

        The period is rounded to a whole number of updates, and the voltages to steps within `low` to `high`
        [V].
        """
        period = float(waveform.period)  # type: ignore[attr-defined]
        count = round(self.played_period(period) * self.update_rate)
        at = np.arange(count) * (period / count)
        volts = np.clip(waveform.value(at), low, high)  # type: ignore[attr-defined]
        if self.step:
            codes = np.rint(volts / self.step)
            volts = self.step * np.clip(codes, *codes_within(self.step, low, high))
        return Sampled(
            np.arange(count) / self.update_rate, volts, self.interpolation, period=count / self.update_rate
        )

    def at_piezo(self, waveform: Waveform) -> Waveform:
        """Return the voltage at the piezo for an endless periodic waveform, in the periodic state: the
        response of the amplifier or, without one, of the slope limit; without both, the waveform. Raises
        QuantityError as `driven_period`."""
        if self.amplifier is not None and self.capacitance is not None:
            return driven_period(self.amplifier, waveform, self.capacitance)
        if not math.isfinite(self.slope):
            return waveform
        farad = self.capacitance or 1.0
        return driven_period(Amplifier(1.0, 0.0, _INF, self.slope, _INF, -_FAR, _FAR), waveform, farad)

    def behind(self, waveform: Waveform) -> Waveform:
        """Return the voltage at the piezo, after converter and amplifier, when a program outputs an endless
        periodic waveform.

        Raises:
            QuantityError: a period has too few or too many updates; or as `driven_period`.
        """
        if not self.updates:
            return self.at_piezo(waveform)
        low, high = waveform.range()
        # The step nearest to a voltage of the drive may be up to half a step beyond the drive's range.
        half = 0.5 * self.step
        played = self.played(waveform, low - half, high + half)
        count, period = played.times.size, float(waveform.period)  # type: ignore[attr-defined]
        if not FEWEST <= count <= self.points:
            raise QuantityError(
                f"a period of {with_prefix(period, 's')} has {count} updates at {self.update_rate:g} Hz, and "
                f"the output plays {FEWEST} to {self.points:g}: take another frequency"
            )
        return self.at_piezo(played)


def output_of(given: OutputStage | float | str) -> OutputStage:
    """Return a given output stage unchanged; for a number, an output stage with this update rate [Hz] and no
    further limits. Raises QuantityError for other values."""
    return given if isinstance(given, OutputStage) else OutputStage(_RATE.check(given, "output.update_rate"))


def codes_within(step: float, low: float, high: float) -> tuple[float, float]:
    """Return the smallest and the largest integer whose product with `step` [V] is within `low` to `high`
    [V], except for rounding."""
    return math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
