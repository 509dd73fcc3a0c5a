"""Axis of a simulated controller: each command or query first simulates the motion up to the present time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from ..protocols import Array
from .stage import Path, Piece, Stage

FLANK = 50e-6  # duration of a step's fast edge (slip), s; at high step rates a tenth of the step's period
CHUNK = 0.02  # duration of the steps that are simulated as one piece, s; at least one step
_RAMP = 0.1  # longest duration of one piece of a ramp, s
_POINTS = 8  # number of times on the slow edge of a step at which positions are computed
# Computing time, s, after which a command no longer simulates further pieces that are due. Their motion is
# then delayed, and the answer to the command is not.
_SLOWEST = 0.1


class Clock(Protocol):
    """Clock of the motions, in s. A test may use a clock of its own whose `sleep` does not really wait."""

    def now(self) -> float:
        """Return the time since any fixed moment, s."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait for some seconds of this clock."""
        ...


class WallClock:
    """The computer's monotonic clock."""

    def now(self) -> float:
        """Return the time since any fixed moment, s."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for some seconds of real time."""
        time.sleep(seconds)


class Axis:
    """One axis of a simulated controller: it plays pieces of drive on a stage as time proceeds.

    Args:
        stage: the stage of the axis.
        clock: clock of the motions.
        heard: function that is called with the `Path` of every simulated piece; by default none.

    A motion depends only on its pieces, not on the times of queries. If the computer is too slow, the motion
    is delayed. A stop takes effect at the end of the present piece.
    """

    def __init__(self, stage: Stage, clock: Clock, heard: Callable[[Path], None] | None = None) -> None:
        self.stage, self._clock, self._heard = stage, clock, heard
        self._pieces: Iterator[Piece] | None = None
        self._path: Path | None = None
        self._forever = False
        self._begin = self._end = clock.now()

    def begin(self, pieces: Iterator[Piece], forever: bool = False) -> None:
        """Start a motion at the end of the present piece. The rest of an earlier motion is dropped.

        Args:
            pieces: pieces of drive, which are taken one by one when they are due.
            forever: True if the motion has no end; the property `forever` reports this value.
        """
        self.advance()
        self._pieces, self._forever = pieces, forever

    def stop(self) -> None:
        """Stop the motion at the end of the present piece."""
        self.advance()
        self._pieces = None

    @property
    def moving(self) -> bool:
        """Return True while a motion is in progress, at the present time of the clock."""
        self.advance()
        return self._pieces is not None or self._path is not None

    @property
    def forever(self) -> bool:
        """Return True while a motion without an end is in progress."""
        return self.moving and self._pieces is not None and self._forever

    def advance(self) -> float:
        """Simulate up to the present time: all pieces that have started and, after the last one, the constant
        voltage. If this takes longer than `_SLOWEST`, later pieces are delayed. Return the present time, s of
        the clock."""
        now, began = self._clock.now(), time.monotonic()
        while self._end <= now:
            piece = next(self._pieces, None) if self._pieces is not None else None
            if piece is None:
                self._pieces = self._path = None
                if now > self._end:
                    self.stage.rest(now - self._end)
                self._begin = self._end = now
                break
            self._path = self.stage.play(piece)
            self._begin, self._end = self._end, self._end + float(piece.times[-1])
            if self._heard is not None:
                self._heard(self._path)
            if self._end <= now and time.monotonic() - began > _SLOWEST:
                self._end = now  # the next piece starts now, although it was due earlier
                break
        return now

    def state(self) -> tuple[float, float, float]:
        """Return the present voltage [V] and the positions of stage and end-effector [m], in this order."""
        now = self.advance()
        if self._path is None:
            return self.stage.voltage, self.stage.elongation, self.stage.position
        return self._path.at(now - self._begin)


def ramp(begin: float, end: float, seconds: float) -> Iterator[Piece]:
    """Yield the pieces of drive, of up to 0.1 s, of a linear ramp from the voltage `begin` to `end` [V] that
    takes `seconds` s."""
    count = max(1, math.ceil(seconds / _RAMP))
    samples: Array = np.linspace(0.0, seconds / count, 21)[1:]
    for k in range(1, count + 1):
        yield Piece(samples[-1:], np.array([begin + (end - begin) * k / count]), samples)


def steps(
    stage: Stage, count: int | None, amplitude: float, frequency: float, base: float = 0.0
) -> Iterator[Piece]:
    """Yield sawtooth steps of drive from `base` to `base + amplitude`, V, in pieces of `CHUNK` s.

    Steps upwards rise slowly and fall within `FLANK`; steps downwards rise fast and fall slowly.

    Args:
        stage: stage that plays the steps; a ramp of 10 ms comes first if its voltage is not `base`.
        count: number of steps, negative for steps downwards; None for endless steps.
        amplitude: voltage of the sawtooth, V; it may be negative.
        frequency: step rate, steps/s; for endless steps a negative one means downwards.
        base: voltage between two steps, V.
    """
    up = frequency > 0.0 if count is None else count > 0
    period = 1.0 / abs(frequency)
    flank = min(FLANK, 0.1 * period)
    if stage.voltage != base:
        yield from ramp(stage.voltage, base, 0.01)
    left = None if count is None else abs(count)
    slow = (np.arange(1, _POINTS + 1, dtype=np.float64) / _POINTS) * (period - flank)
    edges = np.array([period - flank, period]) if up else np.array([flank, period])
    samples = np.append(slow, period) if up else np.append(flank, flank + slow)
    levels = base + np.array([amplitude, 0.0])
    while left is None or left > 0:
        n = max(1, round(CHUNK * abs(frequency)))
        n = n if left is None else min(n, left)
        starts: Array = np.arange(n, dtype=np.float64)[:, None] * period
        yield Piece((starts + edges).ravel(), np.tile(levels, n), (starts + samples).ravel())
        left = None if left is None else left - n
