"""Simulated wiring between a function generator and an oscilloscope: amplifier, stage, sensor and cables."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np

from ....quantities.units import to_si
from ...protocols import Array
from ...twins.axis import Axis, Clock, WallClock
from ...twins.stage import Path, Piece, Stage


class Wiring:
    """Connections between a simulated generator and a simulated oscilloscope.

    Args:
        stage: the stage that the amplifier drives.
        gain: gain of the amplifier, V/V.
        per_volt: scale of the end-effector's position sensor on channel 2, m/V. Channel 1 is connected to the
            generator's output.
        noise: standard deviation of the sensor's output, V.
        clock: clock of the motions; by default the computer's.

    `cables` is the set of cables that are plugged in: "output", "sync" (trigger) and "sensor".
    """

    def __init__(
        self,
        stage: Stage,
        gain: float = 15.0,
        per_volt: float = 1e-5,
        noise: float | str = 0.0,
        clock: Clock | None = None,
    ) -> None:
        # The generator's and the oscilloscope's servers use one stage from two threads: they share this lock.
        self.clock, self.lock = clock or WallClock(), threading.RLock()
        self.stage, self.gain, self.per_volt, self.noise = stage, gain, per_volt, to_si(noise, "V", "noise")
        self.axis = Axis(stage, self.clock, self._heard)
        self.cables = {"output", "sync", "sensor"}
        self.triggers: list[Any] = []  # functions to call with the start time of each burst, s of the clock
        self._zero, self._random = stage.position, np.random.default_rng(5)
        self._paths: list[Path] = []

    @property
    def voltage(self) -> float:
        """Voltage at the piezo now, V."""
        with self.lock:
            return self.axis.state()[0]

    def put_out(self, pieces: Iterator[Piece]) -> None:
        """Start to play pieces of drive at the piezo, and forget the simulated signals of earlier ones."""
        # Earlier pieces are simulated now, before the start, so that they do not enter the new recording.
        self.axis.advance()
        self._paths = []
        self.axis.begin(pieces)

    @property
    def played(self) -> float:
        """Duration of the pieces of drive that were simulated since `put_out`, s; infinite once all were."""
        moving = self.axis.moving
        return sum(float(path.times[-1]) for path in self._paths) if moving else math.inf

    def seen(self, channel: int, times: Array) -> Array:
        """Return the voltages [n], V, at an oscilloscope channel at times [n], s from the last `put_out`.

        Channel 1 shows the generator's output, channel 2 the sensor with its noise. Other channels, and
        channels with an unplugged cable, have 0 V.
        """
        self.axis.advance()
        plug = {1: "output", 2: "sensor"}.get(channel, "")
        made: Array = np.zeros(times.size)
        if plug in self.cables and self._paths:
            begins = np.cumsum([0.0, *(float(path.times[-1]) for path in self._paths)])
            at = np.concatenate(
                [path.times + begin for path, begin in zip(self._paths, begins[:-1], strict=True)]
            )
            if channel == 1:
                made = np.interp(times, at, np.concatenate([path.volts for path in self._paths])) / self.gain
            else:
                x = np.concatenate([path.end_effector for path in self._paths])
                made = (np.interp(times, at, x) - self._zero) / self.per_volt
        return made + self.noise * self._random.standard_normal(times.size) * (channel == 2)

    def _heard(self, path: Path) -> None:
        self._paths.append(path)
