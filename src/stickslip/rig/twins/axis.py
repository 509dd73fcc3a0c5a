"""A stage in time: motions are simulated piece by piece as the clock proceeds between commands."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from ..protocols import Array
from .stage import Path, Piece, Stage

FLANK = 50e-6  # s, fast edge of a step; at most a tenth of its period
CHUNK = 0.02  # s of steps simulated as one piece
_RAMP = 0.1  # s, longest piece of a ramp
_POINTS = 8  # samples on the slow edge of a step
_SLOWEST = 0.1  # s of computing after which the motion is delayed instead of the answer


class Clock(Protocol):
    """Clock, in s; a test may use its own."""

    def now(self) -> float:
        """Return the time since any fixed moment."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait."""
        ...


class WallClock:
    """The computer's monotonic clock."""

    def now(self) -> float:
        """Return the time since any fixed moment."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)


class Axis:
    """An axis of a controller.

    Args:
        stage: the stage of the axis.
        clock: the clock.
        heard: called with the path of every simulated piece.

    A motion depends on its pieces alone, not on the times of queries. If the computer is too slow, the motion
    is delayed. A stop takes effect at the end of the present piece.
    """

    def __init__(self, stage: Stage, clock: Clock, heard: Callable[[Path], None] | None = None) -> None:
        self.stage, self._clock, self._heard = stage, clock, heard
        self._pieces: Iterator[Piece] | None = None
        self._path: Path | None = None
        self._forever = False
        self._begin = self._end = clock.now()

    def begin(self, pieces: Iterator[Piece], forever: bool = False) -> None:
        """Start a motion after the present piece. It replaces the rest of an earlier motion."""
        self.advance()
        self._pieces, self._forever = pieces, forever

    def stop(self) -> None:
        """End the motion with the present piece."""
        self.advance()
        self._pieces = None

    @property
    def moving(self) -> bool:
        """Return True during a motion."""
        self.advance()
        return self._pieces is not None or self._path is not None

    @property
    def forever(self) -> bool:
        """Return True during a motion without an end."""
        return self.moving and self._pieces is not None and self._forever

    def advance(self) -> float:
        """Simulate all pieces that are due, or the rest, up to now. Return the time."""
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
                self._end = now  # delayed
                break
        return now

    def state(self) -> tuple[float, float, float]:
        """Return voltage, V, and the positions of stage and end-effector, m, now."""
        now = self.advance()
        if self._path is None:
            return self.stage.voltage, self.stage.elongation, self.stage.position
        return self._path.at(now - self._begin)


def ramp(begin: float, end: float, seconds: float) -> Iterator[Piece]:
    """Yield a linear ramp between two voltages [V] over some seconds, in pieces of a tenth of a second."""
    count = max(1, math.ceil(seconds / _RAMP))
    samples: Array = np.linspace(0.0, seconds / count, 21)[1:]
    for k in range(1, count + 1):
        yield Piece(samples[-1:], np.array([begin + (end - begin) * k / count]), samples)


def steps(
    stage: Stage, count: int | None, amplitude: float, frequency: float, base: float = 0.0
) -> Iterator[Piece]:
    """Return steps between `base` and `base + amplitude`, V.

    They go up if `count` is positive. With a count of None they are endless, and go down if the frequency is
    negative.
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
