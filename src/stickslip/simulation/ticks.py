"""Motion of an actuator from one tick of a controller to the next: its voltages are not known in advance.

Between two ticks the trajectory is that of `simulate`, by the same solver. The end of one tick is the start
of the next, so the result equals that for the complete drive within the tolerance.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engine.binding import ComposedPlant, DriveTable, integrate
from ..engine.outcome import DONE
from ..physics.actuator import Actuator
from ..physics.piezo import Creep, Piezo, PrandtlIshlinskii
from ..physics.piezo.creep import Lags, relaxed
from ..physics.piezo.operators import response
from ..quantities.records import of_kind
from ..quantities.units import QuantityError, to_si
from ..waveform.drive import Drive
from .errors import SimulationError
from .jumps import INSTEAD, STATIC_JUMPS, cannot_jump
from .models import contact_load
from .trajectory import checked_tolerance

Array = NDArray[np.float64]

# Largest number of solver steps in one tick.
MAX_STEPS = 100_000
_NO_TIMES, _NO_HARMONICS = np.zeros(0), np.zeros((0, 4))


class Motion:
    """An actuator that moves tick by tick, from rest under a voltage.

    Args:
        model: the actuator.
        voltage: voltage at which the actuator has rested for long, V, reached monotonically from 0 V.
        load: normal force relative to the reference at which the friction parameters hold.
        tolerance: tolerance of the end-effector's position in each tick, m (rad for a rotary actuator).
        remanence: pair of arrays, the states of the piezo's plays and of its creep terms, V, from the
            property of this name; by default those after a long rest at `voltage`.

    Attributes:
        time: time since the start, s.

    Raises:
        QuantityError: the piezo has another hysteresis than `PrandtlIshlinskii`, or another creep than
            `Creep`, whose state is not supported here; or an argument is wrong.
    """

    def __init__(
        self,
        model: Actuator,
        *,
        voltage: float | str = 0.0,
        load: float = 1.0,
        tolerance: float | str = 1e-9,
        remanence: tuple[Array, Array] | None = None,
    ) -> None:
        rest, self._tolerance = to_si(voltage, "V", "voltage"), checked_tolerance(None, tolerance)
        of_kind(model, Actuator, "model")
        self._cannot_jump = cannot_jump(model)
        contact = contact_load(load, 1.0)
        self._of, self._load = contact.system(model), DriveTable(contact.drive)
        self._plant = ComposedPlant(self._of.plant)
        self._piezo = None if model.piezo is None else _PiezoState(model.piezo, rest, remanence)
        self._volts = rest if self._piezo is None else self._piezo.level
        self._q = contact.rest(self._of, self._volts)
        self._room(8)
        self._samples = np.zeros((0, self._plant.columns))
        self.time = 0.0

    def hold(self, volts: float, duration: float) -> None:
        """Continue the motion for `duration` [s] at a constant voltage `volts` [V]; the drive jumps to it
        first.

        Raises:
            QuantityError: the stage is static, its law has bristles, and the voltage jumps.
            SimulationError: the motion could not be simulated.
        """
        if self._piezo is not None:
            self.follow(np.array([0.0, duration]), np.array([volts, volts]))
            return
        self._polynomial[0, 0], self._polynomial[0, 1] = volts, 0.0
        self._on(volts, volts, 1, duration)

    def follow(self, times: Array, volts: Array) -> None:
        """Continue the motion under voltages that are linear between samples.

        Args:
            times: sample times [n], s from now; the first is 0.
            volts: voltages [n], V.

        Raises:
            QuantityError, SimulationError: as for `hold`.
        """
        if self._piezo is not None:
            volts = self._piezo.through(times, volts)
        n = times.size - 1
        if n > self._start.size:
            self._room(2 * n)
        self._start[:n], self._polynomial[:n, 0] = times[:-1], volts[:-1]
        self._polynomial[:n, 1] = (volts[1:] - volts[:-1]) / (times[1:] - times[:-1])
        self._on(float(volts[0]), float(volts[-1]), n, float(times[-1]))

    def _on(self, begin: float, volts: float, segments: int, end: float) -> None:
        """Integrate through the first `segments` rows of the drive table, up to `end` [s] after the start of
        this tick. `begin` and `volts` are the first and the last voltage [V], after hysteresis and creep."""
        rows = self._start[:segments], self._polynomial[:segments], self._first[: segments + 1]
        if self._cannot_jump and not math.isclose(begin, self._volts, rel_tol=1e-9, abs_tol=1e-9):
            raise QuantityError(
                f"{STATIC_JUMPS}, and a held voltage jumps at every tick: {INSTEAD}, which `follow` takes"
            )
        drive = DriveTable(Drive(begin, *rows, _NO_HARMONICS))
        outcome = integrate(
            *(self._plant, drive, self._load, self._q, (0.0, end), self._tolerance, False, MAX_STEPS),
            *(_NO_TIMES, self._samples),
        )[0]
        self.time += end
        self._volts = volts
        if outcome != DONE:
            raise SimulationError(f"the motion could not be followed beyond t = {self.time:g} s")

    @property
    def remanence(self) -> tuple[Array, Array] | None:
        """Return the states [V] of the piezo's plays and of its creep terms, as the argument `remanence`
        takes them; None without a piezo model."""
        return None if self._piezo is None else self._piezo.remanence

    @property
    def position(self) -> float:
        """Return the position of the end-effector, m, or rad for a rotary actuator."""
        of, q = self._of, self._q
        return self.stage_position if of.clamped else float(q[of.slider])

    @property
    def velocity(self) -> float:
        """Return the velocity of the end-effector, m/s, or rad/s for a rotary actuator."""
        of, q = self._of, self._q
        return self.stage_velocity if of.clamped else float(q[of.slider + 1])

    @property
    def stage_position(self) -> float:
        """Return the position of the stage, m, or rad for a rotary actuator."""
        of = self._of
        return float(sum(self._q[c] for c in of.stages)) if of.stages else of.gain * self._volts

    @property
    def stage_velocity(self) -> float:
        """Return the velocity of the stage, m/s (rad/s); always 0 for a static stage, even if the drive
        moves the stage."""
        return float(sum(self._q[c + 1] for c in self._of.stages))

    def _room(self, segments: int) -> None:
        self._start, self._polynomial = np.zeros(segments), np.zeros((segments, 4))
        self._first = np.zeros(segments + 1, dtype=np.int64)


class _PiezoState:
    """Memory of a piezo between ticks: states of plays and creep terms, exact at the samples of the drive.

    Args:
        piezo: the piezo model.
        rest: voltage of a long rest before the first tick, V.
        remanence: states of plays and creep terms to continue from, V; None: those of the rest.
    """

    def __init__(self, piezo: Piezo, rest: float, remanence: tuple[Array, Array] | None) -> None:
        hysteresis, after = piezo.hysteresis, piezo.creep
        if not isinstance(hysteresis, PrandtlIshlinskii | None) or not isinstance(after, Creep | None):
            name = type(hysteresis if after is None else after).__name__
            raise QuantityError(f"a piezo with a {name} cannot be followed from tick to tick")
        self._operators: Any = None if hysteresis is None else hysteresis.operators
        self._plays = np.zeros(0) if hysteresis is None else hysteresis.rested(rest)
        level = rest if hysteresis is None else hysteresis.at_rest(rest)
        self._shares = np.array(() if after is None else after.shares)
        self._lags = Lags(np.array(() if after is None else after.time_constants))
        self._terms = np.full(self._shares.size, level)
        if remanence is not None:
            self._plays, self._terms = remanence[0].copy(), remanence[1].copy()
        self.level = float(self.through(np.zeros(1), np.full(1, rest))[0])

    @property
    def remanence(self) -> tuple[Array, Array]:
        """Return copies of the states of all plays, and of all creep terms, V."""
        return self._plays.copy(), self._terms.copy()

    def through(self, times: Array, volts: Array) -> Array:
        """Return the voltages [n] after hysteresis and creep for voltages [n] that are linear between these
        times [s from now], and move the memory to the last time."""
        level = volts
        if self._operators is not None:
            level = np.empty(volts.size)
            response(self._operators, volts, self._plays, level)
        if not self._shares.size:
            return level
        crept = np.empty((times.size, self._shares.size))
        relaxed(self._lags, times, level, self._terms, crept)
        return level + crept @ self._shares
