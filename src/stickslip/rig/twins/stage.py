r"""A simulated stick-slip stage that plays its drive in pieces: the physics behind the protocol of a twin.

The state (stage, end-effector, bristle, hysteresis and creep of the piezo) continues from piece to piece.
Steps therefore vary with the contact and with `irregularity`, a load makes them depend on the direction, and
a constant voltage causes creep. During a long constant voltage, the stage creeps so slowly that the
end-effector sticks to it. With the stage's displacement per voltage :math:`C`, the end-effector x and the
stage y then move by :math:`\Delta x = \Delta y = C\,\Delta u_{piezo}`, with the voltage :math:`u_{piezo}`
after hysteresis and creep.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...physics.actuator import Actuator
from ...physics.temperature import at_temperature
from ...quantities.units import QuantityError, to_si
from ...simulation.drives import table_precision
from ...simulation.models import SLIDER, STAGE
from ...simulation.state import State
from ...simulation.trajectory import COMPLETE, follow_model
from ...waveform.sampled import Sampled
from ...waveform.signal import value_at
from ..irregularity import REGULAR, Irregularity, beyond_end
from ..protocols import Array, RigError
from ..remanence import annealed, from_state, remembers, simplified
from ..variation import Repeats, Variation

# Variation of the contact from stroke to stroke as measured on a tribometer (docs/decisions/rig.md).
MEASURED = Variation(friction=0.004, drift=0.012, drift_runs=15, stiffness=0.02)
_SETTLED = 0.05  # time after a motion in which vibrations decay, so that only creep is left, s
_PIECES = 10_000  # number of pieces after which the random variation of the contact starts again
_TOLERANCE = 1e-9  # greatest error of the simulated positions, m
_MOST_STEPS = 2_000_000  # largest number of the solver's integration steps for one piece


class Piece(NamedTuple):
    """A piece of drive: straight lines from the present voltage through `volts` [n], V, at `times` [n].

    `samples` are the times at which positions are computed. All times are in s from the start of the piece;
    the last one is its end.
    """

    times: Array
    volts: Array
    samples: Array


class Path(NamedTuple):
    """Result of a simulated piece: times [n], s from its start, voltages [n], V, and the positions [n] of
    stage and end-effector, m."""

    times: Array
    volts: Array
    stage: Array
    end_effector: Array

    def at(self, time: float) -> tuple[float, float, float]:
        """Return the voltage [V] and the positions of stage and end-effector [m] at a time within the piece,
        s.

        They are interpolated linearly.
        """
        return tuple(float(np.interp(time, self.times, y)) for y in self[1:])  # type: ignore[return-value]


class Stage:
    """A simulated stick-slip stage: an actuator whose end-effector moves between two end stops.

    Args:
        actuator: the actuator; its voltage range is not checked here, which is the controller's task.
        travel: distance from end stop to end stop, m; positions are measured from the middle.
        variation: random variation of the contact from piece to piece.
        irregularity: irregularity of steps and end stops, and the temperature; none by default.
        seed: seed of variation, irregularity and initial position.

    The end-effector starts at rest in the middle half of the travel. An end stop stops the end-effector,
    apart from the elastic yield of the stop, while the stage moves on below. `voltage` [V], `elongation`
    (position of the stage, m) and `position` (of the end-effector, m) are the state after the last piece.

    Raises:
        QuantityError: the travel is not positive, the actuator is clamped, or its piezo keeps no state.
    """

    def __init__(
        self,
        actuator: Actuator,
        *,
        travel: float | str = 4e-3,
        variation: Variation = MEASURED,
        irregularity: Irregularity = REGULAR,
        seed: int = 0,
    ) -> None:
        travel = to_si(travel, "m", "travel")
        if not 0.0 < travel < math.inf:
            raise QuantityError(f"travel = {travel:g} m must be > 0 m")
        if actuator.clamped:
            raise QuantityError("a twin's actuator cannot be clamped: nothing would move")
        piezo = simplified(actuator.piezo)
        if piezo is not None and not remembers(piezo):
            raise QuantityError(
                "a twin's piezo has PrandtlIshlinskii and Creep, or none: others keep no state"
            )
        actuator = at_temperature(actuator, irregularity.temperature)
        self.actuator = actuator.replace(min_voltage=-math.inf, max_voltage=math.inf, piezo=None)
        self._piezo = piezo
        self._remanence = None if piezo is None else annealed(piezo, 0.0)
        self._repeats, self._pieces = Repeats(variation, seed, 0, irregularity), 0
        self._slips, self._give = self._repeats.slips(actuator), irregularity.end_give
        self.end = 0.5 * travel
        start = float(np.random.default_rng(seed).uniform(-0.5, 0.5)) * self.end
        self._state, self._away = State(end_effector_position=start), start
        self.voltage, self.elongation, self.position = 0.0, 0.0, start
        self.stop_met = 0  # end stop that the end-effector touches: -1 the lower, 1 the upper, 0 none

    def play(self, piece: Piece) -> Path:
        """Simulate a piece of drive from the present state and return its path. The stage then has the state
        at the piece's end.

        Raises:
            RigError: the simulation failed.
        """
        end = float(piece.times[-1])
        given = Sampled(np.append(0.0, piece.times), np.append(self.voltage, piece.volts))
        drive = given
        if self._piezo is not None and self._remanence is not None:
            precision = table_precision(self.actuator, _TOLERANCE)
            drive, self._remanence = from_state(
                self._piezo, self._remanence, given.drive(end), end, precision
            )
        samples = np.unique(np.concatenate([piece.samples, [end]]))
        actuator = self._repeats.actuator(self.actuator, self._pieces % _PIECES)
        self._pieces += 1
        moved = follow_model(
            actuator, drive, samples, tolerance=_TOLERANCE, max_steps=_MOST_STEPS, begin=self._state
        )
        if moved.outcome != COMPLETE:
            raise RigError(f"the simulation of the twin's actuator {moved.outcome}")
        y, w, x, s = moved.samples[-1, :4].tolist()
        before, path = (self.elongation, self.position), moved.samples[:, SLIDER]
        if self._slips is not None:
            offset, seconds = self._slips.offset, np.diff(samples, prepend=0.0)
            slid = path - moved.samples[:, STAGE] - self._away
            path = path + (self._slips.follow(slid, seconds) - offset)
        path = beyond_end(self.position, path, self.end, self._give)
        # Displacement of the end-effector by end stops and irregular slips, which the equations of motion do
        # not contain, m.
        self._away += float(path[-1]) - x
        self.stop_met = int(np.sign(path[-1])) if abs(path[-1]) >= self.end else 0
        x, s = float(path[-1]), 0.0 if self.stop_met else s
        self._state = State(0.0, y, w, x, s, tuple(moved.samples[-1, 5:].tolist()))
        self.voltage, self.elongation, self.position = float(piece.volts[-1]), y, x
        return Path(
            np.append(0.0, samples),
            value_at(given, np.append(0.0, samples)),
            np.append(before[0], moved.samples[:, STAGE]),
            np.append(before[1], path),
        )

    def rest(self, seconds: float) -> None:
        """Simulate the present voltage for some seconds: decaying vibrations for `_SETTLED` s, then creep,
        which the end-effector follows, and relaxation of irregular slips."""
        settling = min(seconds, _SETTLED)
        if settling > 0.0:
            self.play(Piece(np.array([settling]), np.array([self.voltage]), np.array([settling])))
        left = seconds - settling
        if left > 0.0 and self._slips is not None:
            before = self._slips.offset
            slid = self.position - self.elongation - self._away
            self._shift(self._slips.step(slid, left) - before)
        if left > 0.0 and self._piezo is not None and self._remanence is not None:
            held = Sampled(np.array([0.0, left]), np.full(2, self.voltage)).drive(left)
            crept, self._remanence = from_state(self._piezo, self._remanence, held, left, math.inf)
            levels = value_at(crept, np.array([0.0, left]))
            moved = self.actuator.gain * float(levels[1] - levels[0])
            self.elongation += moved
            self._state = self._state._replace(stage_position=self.elongation)
            self._shift(moved)
            self._away -= moved  # no slip: the end-effector has moved with the stage

    def _shift(self, way: float) -> None:
        """Displace the end-effector by `way` [m], limited by the end stops, without simulating its motion."""
        x = float(beyond_end(self.position, np.array([self.position + way]), self.end, self._give)[0])
        self._away += x - self.position
        self._state = self._state._replace(end_effector_position=x)
        self.position = x
