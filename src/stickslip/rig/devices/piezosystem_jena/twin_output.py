"""Output of the simulated NV200 in ticks of 50 us: set point, generator, closed loop and recorder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ...protocols import Array
from ...twins.axis import Axis, Clock
from ...twins.stage import Path, Piece, Stage

TICK = 50e-6  # interval of the amplifier's clock, s
RECORD = 6144  # greatest number of samples in a channel of the recorder
# Ends of the range of voltages (av...), V, and of positions (pos...), um, by the names of their queries.
RANGE = {"avmin": -20.0, "avmax": 180.0, "posmin": -80.0, "posmax": 80.0}
_PIECE = 400  # largest number of ticks simulated as one piece
_LOOP = 100  # number of ticks between two updates of the closed loop (5 ms)


class Recorder:
    """Recorder of two channels with the sampling interval `interval` [s].

    `sources` are the numbers of the two recorded quantities in the device's protocol, such as 0 (position)
    and 2 (voltage). The first sample is taken at the start of the next simulated piece of drive.
    """

    def __init__(self) -> None:
        self.sources = [0, 2]
        self.rows: list[Array] = []
        self.count = self.length = 0
        self._elapsed, self.interval = 0.0, TICK
        self.armed = self.running = False

    def start(self, stride: int, length: int) -> None:
        """Start recording.

        Args:
            stride: sampling interval in ticks of 50 us.
            length: number of samples; with 0 the recorder runs until it is stopped, and keeps the last
                `RECORD` samples.
        """
        self.rows, self.count = [], 0
        self._elapsed, self.interval, self.length = 0.0, stride * TICK, length
        self.armed, self.running = False, True

    def take(self, path: Path, columns: Array) -> None:
        """Record the samples that fall into a simulated piece, interpolated between its times.

        Args:
            path: result of the simulation of the piece.
            columns: recorded quantities [channels, n] at the n times of the path, in V or um.
        """
        began = self._elapsed
        self._elapsed += float(path.times[-1])
        last = int(np.floor(self._elapsed / self.interval - 1e-6)) + 1
        last = min(last, self.length) if self.length else last
        if last <= self.count:
            return
        at = np.arange(self.count, last) * self.interval - began
        self.rows.append(np.array([np.interp(at, path.times, row) for row in columns]))
        self.count = last
        if self.length and self.count >= self.length:
            self.running = False
        elif not self.length and sum(row.shape[1] for row in self.rows[1:]) >= RECORD:
            self.rows.pop(0)

    def values(self, row: int) -> Array:
        """Return the last `RECORD` samples [n] of the channel `row` (0 or 1), oldest first, in V or um."""
        if not self.rows:
            return np.zeros(0)
        return np.concatenate([block[row] for block in self.rows])[-RECORD:]


class Output:
    """Output stage of the simulated amplifier, with the stage that it drives.

    Args:
        stage: the driven stage.
        clock: clock of the motions.
        kept: present values of the device's settings by name; the device changes this dictionary.
        noise: standard deviation of a position reading, m.
        on: body whose position is measured, "end_effector" or "stage"; ValueError for another name.
        seed: seed of the noise.
    """

    def __init__(
        self, stage: Stage, clock: Clock, kept: Mapping[str, float], noise: float, on: str, seed: int
    ) -> None:
        if on not in ("end_effector", "stage"):
            raise ValueError(f"on = {on!r} must be end_effector or stage")
        self.axis = Axis(stage, clock, self._heard)
        self.recorder, self.table, self.index = Recorder(), np.zeros(1024), 0
        self.set_point, self._generating, self._last_point = 0.0, False, 0.0
        self._kept, self._noise, self._on_stage = kept, noise, on == "stage"
        self._random = np.random.default_rng([seed, 3])
        self._zero = 0.0 if self._on_stage else stage.position

    @property
    def set_range(self) -> tuple[float, float]:
        """Smallest and largest set point: in V in open loop, in um in closed loop."""
        names = ("posmin", "posmax") if self._kept["cl"] else ("avmin", "avmax")
        return RANGE[names[0]], RANGE[names[1]]

    @property
    def generating(self) -> bool:
        """Return True while the generator puts out its table, at the present time of the clock."""
        self.axis.advance()
        return self._generating

    @property
    def recording(self) -> bool:
        """Return True while the recorder runs, or is armed and waits for its start."""
        self.axis.advance()
        return self.recorder.running or self.recorder.armed

    def percent(self, position: float) -> float:
        """Convert a position [um] to percent of the position range, the unit of the generator's table."""
        return 100.0 * (position - RANGE["posmin"]) / (RANGE["posmax"] - RANGE["posmin"])

    def measured(self) -> float:
        """Return a noisy reading of the position sensor at the present time, um."""
        _, y, x = self.axis.state()
        return float(self._sensed(np.array([y if self._on_stage else x]))[0])

    def go(self, value: float, seconds: float = 0.0) -> None:
        """Move the output to a set point (V, or um in closed loop), along a line of `seconds` s or at once.

        If the generator or another source drives the output, the set point is only stored. A recorder that
        waits for a set point (setting `recast` 1) starts.
        """
        self.axis.advance()
        if self._kept["recast"] == 1 and self.recorder.armed:
            self._record_now()
        begin, self.set_point = self.set_point, value
        if self._kept["modsrc"] == 0:
            ticks = max(1, round(seconds / TICK))
            points = begin + (value - begin) * np.arange(1, ticks + 1) / ticks
            self._play(iter((points,)))

    def follow_source(self) -> None:
        """Adapt the output after the closed loop was switched on or off, or the source of set points changed.

        The generator stops. If set points come from commands, a closed loop starts with the present position
        as its set point, and an open loop keeps the set point within its range.
        """
        self._generating = False
        if self._kept["cl"] and self._kept["modsrc"] == 0:
            low, high = self.set_range
            self.set_point = float(np.clip(self.measured(), low, high))
        elif self._kept["modsrc"] == 0:
            self.set_point = float(np.clip(self.set_point, *self.set_range))
        if self._kept["modsrc"] == 0:
            self._play(iter((np.array([self.set_point]),)))
        else:
            self._play(iter(()))

    def generate(self, run: bool) -> None:
        """Start (`run` True) or stop the generator. A recorder that waits for it (`recast` 2) starts too."""
        self.axis.advance()
        if not run:
            if self.generating:
                self._generating = False
                self._play(iter(()))
            return
        if self._kept["recast"] == 2 and self.recorder.armed:
            self._record_now()
        self._generating = True
        self._play(self._generated(), forever=self._kept["gcarb"] == 0)

    def record(self, run: bool) -> None:
        """Start the recorder (`run` True), arm it if the setting `recast` is not 0, or stop it (False)."""
        self.axis.advance()
        self.recorder.armed = self.recorder.running = False
        if run and self._kept["recast"] != 0:
            self.recorder.rows, self.recorder.count, self.recorder.armed = [], 0, True
        elif run:
            self._record_now()
            if not self.axis.moving:
                self._play(iter(()))

    def recorded(self, channel: int) -> Array:
        """Return the recorded samples [n] of a channel (0 or 1), in V or um."""
        self.axis.advance()
        return self.recorder.values(channel)

    def stop(self) -> None:
        """Stop the generator and move the output to a set point of 0, at the slew rate of the settings."""
        self._generating, self.set_point = False, 0.0
        self._play(iter((np.zeros(1),)))

    def _record_now(self) -> None:
        self.recorder.start(int(self._kept["recstr"]), int(self._kept["reclen"]))

    def _play(self, points: Iterator[Array], forever: bool = False) -> None:
        self.axis.begin(self._pieces(points), forever)

    def _pieces(self, points: Iterator[Array]) -> Iterator[Piece]:
        """Yield the pieces of drive for arrays of set points, one set point (V; closed loop: um) per tick.

        In open loop the drive follows the set points after low pass and slew-rate limit, in closed loop it is
        the controller's output. After the last set point `generating` becomes False, and pieces with this set
        point (or the previous one, if `points` is empty) continue while the recorder runs or the output has
        not settled. A closed loop never settles, so its pieces never end.
        """
        for chunk in points:
            for first in range(0, chunk.size, _PIECE):
                yield from self._driven(chunk[first : first + _PIECE])
        self._generating = False
        while self._unsettled() or self.recorder.running:
            yield from self._driven(np.full(_LOOP if self._kept["cl"] else _PIECE, self._last_point))

    def _unsettled(self) -> bool:
        if self._kept["cl"]:
            return True
        return abs(self._last_point - self.axis.stage.voltage) > 1e-9

    def _driven(self, points: Array) -> Iterator[Piece]:
        """Yield the pieces of drive for an array of set points (V; closed loop: um), one per tick."""
        self._last_point = float(points[-1])
        if not self._kept["cl"]:
            yield _piece(self.axis.stage.voltage, self._slewed(points))
            return
        gain = self.axis.stage.actuator.gain
        share = min(0.01 * float(self._kept["ki"]), 1.0)
        for first in range(0, points.size, _LOOP):
            part = points[first : first + _LOOP]
            stage = self.axis.stage
            at = stage.elongation if self._on_stage else stage.position
            error = 1e-6 * float(part[-1] - self._sensed(np.array([at]))[0])
            wanted = float(np.clip(stage.voltage + share * error / gain, RANGE["avmin"], RANGE["avmax"]))
            yield _piece(stage.voltage, np.linspace(stage.voltage, wanted, part.size + 1)[1:])

    def _slewed(self, points: Array) -> Array:
        """Return the voltages [n], V, for set points [n], V, one per tick, after clipping to the voltage
        range, low pass and slew-rate limit, where the settings switch these on."""
        points = np.clip(points, RANGE["avmin"], RANGE["avmax"])
        rate = float(self._kept["sr"])
        begin = self.axis.stage.voltage
        if self._kept["setlpon"]:
            share = 1.0 - np.exp(-2.0 * np.pi * float(self._kept["setlpf"]) * TICK)
            made, level = np.empty(points.size), begin
            for k, point in enumerate(points):
                level += share * (point - level)
                made[k] = level if abs(point - level) > 1e-6 else point
            points = made
        if rate < 2000.0:
            step = rate / 100.0 * (RANGE["avmax"] - RANGE["avmin"]) * 1e3 * TICK
            made, level = np.empty(points.size), begin
            for k, point in enumerate(points):
                level += float(np.clip(point - level, -step, step))
                made[k] = level
            points = made
        return points

    def _generated(self) -> Iterator[Array]:
        """Yield arrays of the generator's set points (V; closed loop: um), one set point per tick.

        The first cycle starts at the table entry of the setting `goarb`, later ones at `gsarb`. The setting
        `gcarb` is the number of cycles, 0 for endless ones.
        """
        kept = self._kept
        cycle, first = 0, int(kept["goarb"])
        while kept["modsrc"] == 3 and (kept["gcarb"] == 0 or cycle < kept["gcarb"]):
            low, high = self.set_range
            last = int(kept["gearb"])
            self.index = last
            entries = self.table[first : last + 1] if last >= first else self.table[first : first + 1]
            points, ticks = low + 0.01 * entries * (high - low), int(kept["gtarb"])
            together = max(1, _PIECE // ticks)
            for k in range(0, points.size, together):
                yield np.repeat(points[k : k + together], ticks)
            cycle, first = cycle + 1, int(kept["gsarb"])

    def _heard(self, path: Path) -> None:
        if not self.recorder.running:
            return
        positions = self._sensed(path.stage if self._on_stage else path.end_effector)
        rows = [self._source(source, path, positions) for source in self.recorder.sources]
        self.recorder.take(path, np.array(rows))

    def _source(self, source: int, path: Path, positions: Array) -> Array:
        error = self.set_point - positions if self._kept["cl"] else np.zeros_like(positions)
        return {
            0: positions,
            1: np.full_like(positions, self.set_point),
            2: path.volts,
            3: error,
            4: np.abs(error),
            5: positions,
        }.get(source, np.zeros_like(positions))

    def _sensed(self, at: Array) -> Array:
        """Return noisy readings [n] of the position sensor, um, for true positions `at` [n], m."""
        return 1e6 * (at - self._zero + self._noise * self._random.standard_normal(at.size))


def _piece(begin: float, volts: Array) -> Piece:
    """Return a piece of drive that starts at the voltage `begin` and reaches `volts[k]` [V] at the end of
    tick k.

    Points on a straight line between their neighbours are left out of the drive; the positions are computed
    at the end of each tick.
    """
    times: Array = np.arange(1, volts.size + 1, dtype=np.float64) * TICK
    slopes = np.diff(np.append(begin, volts))
    keep = np.append(np.abs(np.diff(slopes)) > 1e-12, True)
    return Piece(times[keep], volts[keep], times)
