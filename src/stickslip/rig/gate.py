"""Safety checks of an open-loop run: of the drive before the output, and of the readings during the run.
Closed loops also use the position input and the error of a failed stop."""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from ..quantities.units import with_prefix
from ..recording.calibration import Calibration
from .home import Home
from .limits import LimitError, Limits, beyond, check_drive
from .protocols import Array, Capabilities, Rig, RigError

# Smallest range of a drive, V, during which constant position readings are a fault.
FROZEN_DRIVE = 10.0
SWITCH_OFF = "switch the amplifier off"  # request to people if the output cannot be brought to 0 V
# Longest delay from the drive to the position reading, s. The check for constant readings ignores the drive
# of this last time, to which the sensor cannot have responded yet.
_ANSWER = 0.01


class PositionInput(NamedTuple):
    """Name of the input that measures the end-effector's position, and the calibrations that convert its
    readings to m or rad, in the order in which they are applied; none for an input in m or rad."""

    name: str
    calibration: tuple[Calibration, ...]

    def unit(self, can: Capabilities) -> str:
        """Return the unit of the position after calibration: "m", or "rad" for a rotary stage.

        `can` are the capabilities of the rig, which state the unit of an input without calibration.
        """
        return self.calibration[-1].y_unit if self.calibration else can.inputs[self.name]


class Gate:
    """Access to a rig for one run; every drive and every block of samples is checked against the limits.

    The requested voltages are checked. The converter's output may deviate from them by one of its steps.

    Args:
        rig: rig that outputs the drive and records.
        limits: limits of the output and the position.
        capabilities: capabilities of the rig.
        home: origin of positions. A position input without a home, as all by default, gets as home its mean
            reading before the drive, in the first block of samples. `take` stores the last position here.

    Attributes:
        began: mean position before the drive, in the first block, m (rad) from home; None until it was read.
    """

    def __init__(
        self, rig: Rig, limits: Limits, capabilities: Capabilities, home: Home | None = None
    ) -> None:
        self._rig, self._limits, self._can = rig, limits, capabilities
        self._home = home or Home()
        self._heard = 0.0
        self._volts = np.zeros(1)
        self._inputs: tuple[str, ...] = ()
        self._position: PositionInput | None = None
        self._rest = self._done = self._same = 0
        self._until = 0.0  # duration of the run, s, if the rig delivers its samples only at the end; else 0
        self._origin, self._last = 0.0, math.nan
        self.began: float | None = None

    def load(self, volts: Array) -> None:
        """Check the drive [n], V, and load it into the output. Raises LimitError if a limit forbids it."""
        check_drive(volts, self._limits, self._can)
        self._volts = volts
        self._rig.load(volts)

    def arm(
        self, inputs: tuple[str, ...], samples: int, position: PositionInput | None = None, rest: int = 0
    ) -> None:
        """Prepare the recording of some inputs.

        Args:
            inputs: names of the inputs.
            samples: number of samples of the run.
            position: one of the inputs, checked against end stops and for constant readings; None for no
                check.
            rest: number of samples before the drive.
        """
        self._inputs, self._position, self._rest = inputs, position, rest
        self._done = self._same = 0
        self._last, self.began = math.nan, None
        self._until = 0.0 if self._can.streams else samples / self._can.sample_rate
        self._rig.arm(inputs, samples)
        self._origin = getattr(self._rig, "origin", 0.0)  # read after `arm`: some devices know it only then

    def start(self) -> None:
        """Start the output of the loaded drive, the recording, and the watchdog for missing samples."""
        self._rig.start()
        self._heard = time.monotonic()

    def take(self, block: Array) -> None:
        """Check the samples [inputs, n] that the rig delivered.

        Raises:
            RigError: the samples do not have this shape.
            LimitError: the rig delivered nothing for `Limits.watchdog` (longer if it delivers only at the
                end); a reading, or the position computed from it, is not finite; or the position was constant
                for `Limits.frozen` while the drive changed by `FROZEN_DRIVE`, or is beyond an end stop.
        """
        shape = getattr(block, "shape", None)
        if shape is None or len(shape) != 2 or shape[0] != len(self._inputs):
            given = f"{block!r:.40}" if shape is None else f"an array of the shape {shape}"
            raise RigError(f"{self._can.name}: fetch gave {given}, not an array [{len(self._inputs)}, n]")
        self._hear(block.shape[1])
        if not block.shape[1]:
            return
        self._check_finite(block)
        if self._position is not None:
            raw = block[self._inputs.index(self._position.name)]
            self._check_moving(self._position.name, raw)
            self._check_position(raw, self._position)
        self._done += block.shape[1]

    def stop(self) -> None:
        """Ramp the output from its present voltage to 0 V at `limits.stop_slew`."""
        self._rig.stop(self._limits.stop_slew)

    def _hear(self, samples: int) -> None:
        now = time.monotonic()
        if samples:
            self._heard = now
        elif now - self._heard > self._limits.watchdog + self._until:
            raise LimitError(
                f"watchdog: nothing came from {self._can.name} for {with_prefix(now - self._heard, 's')}"
            )

    def _check_finite(self, block: Array) -> None:
        finite = np.isfinite(block)
        if not finite.all():
            row, column = np.argwhere(~finite)[0]
            raise LimitError(
                f"the input {self._inputs[row]!r} reads {block[row, column]} at sample "
                f"{self._done + column}: stopped"
            )

    def _check_moving(self, source: str, raw: Array) -> None:
        changes = np.flatnonzero(np.diff(raw, prepend=self._last) != 0.0)
        self._same = raw.size - int(changes[-1]) if changes.size else self._same + raw.size
        self._last = float(raw[-1])
        rate, end = self._can.sample_rate, self._done + raw.size
        if self._same < max(self._limits.frozen * rate, 2.0):
            return
        span = np.array([end - self._same, end - _ANSWER * rate]) * (self._can.update_rate / rate)
        low, high = np.clip(span.astype(int), 0, self._volts.size - 1)
        moved = float(np.ptp(self._volts[low : high + 1])) if high > low else 0.0
        if moved >= FROZEN_DRIVE:
            raise LimitError(
                f"the input {source!r} is frozen: it has read {self._last:.6g} for "
                f"{with_prefix(self._same / rate, 's')} while the drive moved by "
                f"{with_prefix(moved, 'V')}: stopped"
            )

    def _check_position(self, raw: Array, position: PositionInput) -> None:
        home = self._home
        if position.name not in home.readings:
            rest = raw[: max(self._rest, 1)]
            home.set(position.name, float(rest.mean()), self._origin)
        at = home.positions(position.name, raw, position.calibration, self._origin)
        if self.began is None:
            self.began = float(at[: max(self._rest, 1)].mean())
        home.position = float(at[-1])
        for value, limit, sign in (
            (float(at.min()), self._limits.min_position, -1),
            (float(at.max()), self._limits.max_position, 1),
        ):
            if sign * (value - limit) > 0.0:
                raise beyond(value, limit, position.unit(self._can))


def stop_failed(error: BaseException, failure: BaseException | None) -> BaseException:
    """Return the error of a run whose ramp to 0 V failed, with the request to switch the amplifier off.

    Args:
        error: the error of the ramp.
        failure: the earlier error that ended the run, or None.

    Returns:
        `failure` with a note on the failed ramp; without `failure` the `error`, with a note if its text does
        not contain the request yet.
    """
    told = f"The stop failed: {SWITCH_OFF}"
    if SWITCH_OFF not in str(error):
        error.add_note(told)
    if failure is None:
        return error
    words = str(error).removesuffix(f". {told}") or type(error).__name__
    failure.add_note(f"The stop failed too ({words}): {SWITCH_OFF}")
    return failure
