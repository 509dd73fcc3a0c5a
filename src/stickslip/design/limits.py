"""Limits of amplifier and generator on a drive signal, and the signal as the generator plays it."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..actuator import Actuator
from ..electronics import Amplifier
from ..records import Quantity, record
from ..rig.bench import Bench
from ..units import QuantityError, to_si, with_prefix
from ..waveform.sampled import Sampled
from ..waveform.signal import Waveform

Array = NDArray[np.float64]
# Updates of a period: fewer make no waveform.
FEWEST = 4
# Frequencies that are searched unless bounds are given, over those of stage and contact.
SLOWEST, FASTEST = 0.1, 3.0


@record
class DriveLimits(NamedTuple):
    """Of the amplifier: slope of the voltage, and peak current into a capacitance [F] (`Stack.load`). With
    the `amplifier` itself, a drive is judged by what that makes of it."""

    slew_rate: Annotated[
        float, Quantity("V/s", "R", "greatest slope of the voltage", above=0, maximum=math.inf)
    ] = math.inf
    current: Annotated[float, Quantity("A", "I", "greatest current", above=0, maximum=math.inf)] = math.inf
    capacitance: Annotated[float | None, Quantity("F", "C", "capacitance of the piezo", above=0)] = None
    amplifier: Amplifier | None = None

    def _check(self) -> None:
        if (math.isfinite(self.current) or self.amplifier) and self.capacitance is None:
            raise QuantityError(
                "DriveLimits.capacitance [F] is missing: a current limits the slope of the voltage by it"
            )

    @classmethod
    def of_amplifier(cls, amplifier: Amplifier, capacitance: float | str) -> DriveLimits:
        """Those of an amplifier into a capacitance [F]; of its currents the one that it gives for ever."""
        current = min(amplifier.max_current, amplifier.rms_current)
        return cls(amplifier.slew_rate, current, to_si(capacitance, "F", "capacitance"), amplifier)

    @property
    def slope(self) -> float:
        """V/s, the greatest."""
        return min(self.slew_rate, self.current / self.capacitance if self.capacitance else math.inf)


@record
class Generator(NamedTuple):
    """What plays the waveform: so many updates per second, so many points at most, voltages that are
    multiples of a step (V at the piezo; 0: any), each held until the next or joined by lines."""

    update_rate: Annotated[float, Quantity("Hz", "f_DA", "updates per second", above=0)]
    points: Annotated[
        float, Quantity("", "N", "most points of a period", minimum=FEWEST, maximum=math.inf)
    ] = math.inf
    step: Annotated[float, Quantity("V", "q", "voltage step", minimum=0)] = 0.0
    interpolation: Literal["hold", "linear"] = "hold"

    def _check(self) -> None:
        if math.isfinite(self.points) and self.points % 1:
            raise QuantityError(f"Generator.points = {self.points:g} must be a whole number")
        if self.interpolation not in ("hold", "linear"):
            raise QuantityError(f"Generator.interpolation = {self.interpolation!r}: it is 'hold' or 'linear'")

    @classmethod
    def of_bench(cls, bench: Bench, points: int) -> Generator:
        """The converter of a bench, behind its amplifier."""
        return cls(bench.dac.update_rate, points, bench.dac.step * bench.amplifier.gain)

    def played(self, waveform: Waveform, low: float, high: float) -> Sampled:
        """One period as it is played, for ever: the values at the updates, at the nearest steps within the
        voltages; the nearest whole number of updates long."""
        period = float(waveform.period)  # type: ignore[attr-defined]
        count = max(1, round(period * self.update_rate))
        at = np.arange(count) * (period / count)
        volts = np.clip(waveform.value(at), low, high)  # type: ignore[attr-defined]
        if self.step:
            codes = np.rint(volts / self.step)
            volts = self.step * np.clip(codes, *_codes(self.step, low, high))
        return Sampled(
            np.arange(count) / self.update_rate, volts, self.interpolation, period=count / self.update_rate
        )


def _codes(step: float, low: float, high: float) -> tuple[float, float]:
    return math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)


class Allowed(NamedTuple):
    """What all of it leaves: voltages, V; slope, V/s; frequencies, Hz; the generator, if there is one."""

    low: float
    high: float
    slope: float
    slowest: float
    fastest: float
    generator: Generator | None
    limits: DriveLimits

    @property
    def swing(self) -> float:
        return self.high - self.low


def allowed(
    model: Actuator,
    min_voltage: float | None,
    max_voltage: float | None,
    limits: DriveLimits | None,
    frequency: tuple[float, float] | None,
    generator: Generator | None,
) -> Allowed:
    """What model, limits and generator allow together.

    Raises:
        QuantityError: nothing, or a voltage that the model does not take; says which limit it is.
    """
    low, high = _voltages(model, min_voltage, max_voltage)
    slowest, fastest = frequency or _usual(model, high - low)
    limits = limits or DriveLimits()
    if not isinstance(limits, DriveLimits):
        raise QuantityError(f"limits = {limits!r:.60} must be design.DriveLimits(slew_rate=..., current=...)")
    if generator is not None and not isinstance(generator, Generator):
        raise QuantityError(f"generator = {generator!r:.60} must be a design.Generator")
    slope = limits.slope
    if generator is not None:
        least, most = _codes(generator.step, low, high) if generator.step else (0, 1)
        if most <= least:
            raise QuantityError(
                f"Generator.step = {with_prefix(generator.step, 'V')} leaves less than two voltages from "
                f"{low:g} V to {high:g} V"
            )
        # A sample may be off by half a step, and so may the one before.
        steps = generator.step * generator.update_rate
        if slope <= steps:
            raise QuantityError(
                f"a slope of at most {with_prefix(slope, 'V/s')} excludes every drive: one step of the "
                f"generator, {with_prefix(generator.step, 'V')}, takes {with_prefix(steps, 'V/s')}"
            )
        slope -= steps
        ends = generator.update_rate / generator.points, generator.update_rate / FEWEST
        wanted = slowest, fastest
        slowest, fastest = max(slowest, ends[0]), min(fastest, ends[1])
        if slowest >= fastest:
            raise QuantityError(
                f"frequency = {wanted[0]:g} Hz to {wanted[1]:g} Hz is excluded by the generator, which plays "
                f"{FEWEST} to {generator.points:g} points at {generator.update_rate:g} Hz: "
                f"{ends[0]:g} Hz to {ends[1]:g} Hz"
            )
    return Allowed(low, high, slope, slowest, fastest, generator, limits)


def _voltages(model: Actuator, low: float | None, high: float | None) -> tuple[float, float]:
    if low is None:
        low = model.min_voltage if math.isfinite(model.min_voltage) else 0.0
    if high is None:
        high = model.max_voltage
    if not (math.isfinite(low) and math.isfinite(high)):
        raise QuantityError("max_voltage [V] is missing, and the model has no greatest voltage of its own")
    if not low < high:
        raise QuantityError(
            f"min_voltage = {low:g} V and max_voltage = {high:g} V exclude every drive: the first "
            "must be less"
        )
    if low < model.min_voltage or high > model.max_voltage:
        raise QuantityError(
            f"{low:g} V to {high:g} V is out of range: {model.name or 'the actuator'} takes "
            f"{model.min_voltage:g} V to {model.max_voltage:g} V"
        )
    return low, high


def frequencies(given: tuple[float | str, float | str] | None) -> tuple[float, float] | None:
    """(low, high), Hz; raises QuantityError for what is none."""
    if given is None:
        return None
    try:
        first, last = given
    except (TypeError, ValueError):
        raise QuantityError(f"frequency = {given!r} must be (low, high), in Hz") from None
    low, high = to_si(first, "Hz", "frequency"), to_si(last, "Hz", "frequency")
    if not 0.0 < low < high < math.inf:
        raise QuantityError(
            f"frequency = ({low:g}, {high:g}) Hz excludes every drive: low must be > 0 Hz and below high"
        )
    return low, high


def _usual(model: Actuator, swing: float) -> tuple[float, float]:
    """Frequencies [Hz] about those at which the friction can just move the end-effector over the stroke, and
    of the stage."""
    stroke = abs(model.gain) * swing
    force = abs(getattr(model.friction, "coulomb_force", 0.0))
    found = [] if model.static else [model.natural_frequency / (2.0 * math.pi)]
    if stroke > 0.0 and force > 0.0:
        found.append(0.5 * math.sqrt(force / (model.end_effector_mass * stroke)))
    if not found:
        raise QuantityError("frequency = (low, high) [Hz] is needed: the model does not tell")
    return SLOWEST * min(found), FASTEST * max(found)
