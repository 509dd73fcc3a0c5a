"""Simulation of a virtual rig's bench, update by update: converter, amplifier, actuator, sensors.

`VirtualRig` computes a drive that is known beforehand in one piece. This module computes the same instruments
for a drive that a controller decides update by update. The sensors' noise has the same statistics but other
values.
"""

from __future__ import annotations

import math
import zlib

import numpy as np

from ..physics.actuator import Actuator
from ..physics.electronics.amplifier import limits
from ..physics.electronics.charging import charged, rest
from ..simulation.ticks import Motion
from .bench import Bench
from .irregularity import Slips
from .protocols import RigError
from .remanence import Remanence
from .sensing import OVERSAMPLED, Sensing

_TOLERANCE = 5e-3  # greatest error of the amplifier's output, approximated by straight lines, V


class Stream:
    """A run of the virtual rig, computed update by update.

    Args:
        actuator: the actuator in this run.
        bench: the instruments; its inputs are sampled once per update of the output.
        inputs: names of the inputs to read, which may include "drive".
        seed: whole numbers that seed all noise.
        offset: voltage at the piezo, V, for the number 0 sent to the D/A converter.
        per_unit: voltage at the piezo, V, per unit of the number sent to the D/A converter.
        tolerance: greatest error of simulated positions, m (rad for a rotary actuator).
        remanence: initial state of the piezo; None for a piezo that has rested at 0 V for long.
        slips: irregularity of the steps; None if every step follows the equations.

    Raises:
        RigError: the bench's sampling rate differs from its update rate, or a sensor is a user's own.
    """

    def __init__(
        self,
        actuator: Actuator,
        bench: Bench,
        inputs: tuple[str, ...],
        seed: tuple[int, ...],
        offset: float,
        per_unit: float,
        tolerance: float,
        remanence: Remanence | None = None,
        slips: Slips | None = None,
    ) -> None:
        if abs(bench.sample_rate - bench.dac.update_rate) > 1e-9 * bench.sample_rate:
            raise RigError(
                f"a closed loop needs as many samples as updates; {bench.name} has {bench.sample_rate:g} Hz "
                f"and {bench.dac.update_rate:g} Hz"
            )
        self._bench, self._offset, self._per_unit = bench, offset, per_unit
        self._tick = 1.0 / bench.dac.update_rate
        self._of = limits(bench.amplifier, bench.piezo_capacitance)
        first = self._amplified(self.number(0.0))
        self._amplifier, self._volts = rest(first), first
        self._bounds, self._target, self._slope = np.array([0.0, self._tick]), np.zeros(1), np.zeros(1)
        self._motion = Motion(actuator, voltage=first, tolerance=tolerance, remanence=remanence)
        self._monitor, self._slips = first, slips
        self._sensors: list[tuple[bool, Sensing] | None] = []
        for name in inputs:
            mounted = None if name == "drive" else bench.sensors[name]
            if mounted is None:
                self._sensors.append(None)
                continue
            random = np.random.default_rng([*seed, zlib.crc32(name.encode())])
            on_stage = mounted.on == "stage"
            at = self._motion.stage_position if on_stage else self._motion.position
            rate = len(OVERSAMPLED) * bench.sample_rate
            self._sensors.append((on_stage, Sensing(mounted, bench.anti_alias, rate, random, at)))
        self._before = self._now()

    def number(self, volts: float) -> float:
        """Return the number to send to the D/A converter for a voltage [V] at the piezo, not yet rounded."""
        return (volts - self._offset) / self._per_unit

    @property
    def slid(self) -> float:
        """Return the displacement of the end-effector relative to the stage, m (rad for a rotary one)."""
        return self.position - self._motion.stage_position

    @property
    def position(self) -> float:
        """Return the end-effector's position with the irregularity of its steps, m (rad for a rotary one)."""
        return self._motion.position + (0.0 if self._slips is None else self._slips.offset)

    @property
    def remanence(self) -> Remanence | None:
        """Return the present state of the piezo; None if its models keep no state between runs."""
        found = self._motion.remanence
        return None if found is None else Remanence(*found)

    def exchange(self, volts: float) -> list[float]:
        """Output a voltage [V at the piezo] for one update; return the readings of the next update.

        The readings have the order and units of the inputs. SimulationError if the simulation fails.
        """
        target = self._amplified(self.number(volts))
        if target == self._volts and target == self._monitor:
            self._motion.hold(target, self._tick)
        else:
            self._target[0] = target
            times, given = charged(
                *(self._of, self._bounds, self._target, self._slope, self._amplifier, _TOLERANCE)
            )
            self._volts = float(given[-1])
            self._motion.follow(times, given)
        self._monitor = target
        if self._slips is not None:
            self._slips.step(self._motion.position - self._motion.stage_position, self._tick)
        return self.readings()

    def readings(self) -> list[float]:
        """Return the present readings of all inputs, in their order and units.

        Call this only for the first readings: `exchange` calls it at each update, and each call advances the
        filters and the noise of the sensors.
        """
        (x0, v0, y0, w0), now = self._before, self._now()
        self._before = now
        found = []
        for one in self._sensors:
            if one is None:
                found.append(self._monitor)
                continue
            on_stage, sensing = one
            a, da, b, db = (y0, w0, now[2], now[3]) if on_stage else (x0, v0, now[0], now[1])
            value = 0.0
            for share in sensing.shares:
                value = sensing.sees(_between(a, da, b, db, share, self._tick))
            found.append(sensing.reading(value))
        return found

    def _now(self) -> tuple[float, float, float, float]:
        motion = self._motion
        return self.position, motion.velocity, motion.stage_position, motion.stage_velocity

    def _amplified(self, number: float) -> float:
        """Return the final voltage [V] of the amplifier for a number sent to the D/A converter.

        The number is rounded to a step of the converter; the voltage is limited to the amplifier's range.
        """
        dac, amplifier = self._bench.dac, self._bench.amplifier
        steps = (number * dac.gain - dac.low) / dac.step
        code = math.floor(steps + 1e-6) if dac.truncates else round(steps)
        code = min(max(code, 0), 2**dac.bits - 1)
        volts = amplifier.gain * (dac.low + code * dac.step) + amplifier.offset
        return min(max(volts, amplifier.low), amplifier.high)


def _between(a: float, da: float, b: float, db: float, share: float, span: float) -> float:
    """Interpolate a position within one update by a cubic polynomial; return the position, m (or rad).

    Args:
        a, da: position [m or rad] and velocity [m/s or rad/s] at the start of the update.
        b, db: position and velocity at its end, in the same units.
        share: fraction of the update that has passed, 0 to 1.
        span: duration of the update, s.
    """
    if share == 1.0:
        return b
    left = 1.0 - share
    bend = (left - share) * (a - b) + (left * da - share * db) * span
    return left * a + share * b + share * left * bend
