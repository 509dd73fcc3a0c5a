"""A closed loop on a rig: read, step the controller, put out, update by update.

The loop runs in a thread of its own, so that a controller that never answers can be left behind: whoever
waits for it ramps the output to 0 V. What the loop recorded until then is kept.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..progress import Progress, unheard
from ..recording import save_recording
from ..units import QuantityError, optional_si, to_si, with_prefix
from ..waveform.signal import Waveform, value_at
from .capture import Capture, stride
from .gate import FROZEN_DRIVE, PositionInput
from .home import Home, calibrated
from .limits import LimitError, Limits
from .measurement import POSITION, _home_of, _keep, _why, channel_units
from .protocols import Array, Capabilities, Controller, RigError, StreamingRig
from .recorded import COMPLETE, Channel, Making
from .samples import Samples

TARGET, ASKED = "target_position", "asked_voltage"
_BLOCK = 0.02  # s of samples that are written together
_LOOK = 0.02  # s between two looks at whether the loop goes on


def regulate(
    rig: StreamingRig,
    controller: Controller,
    target: Waveform | float | str,
    channels: Mapping[str, Channel],
    limits: Limits,
    duration: float | str,
    *,
    interval: float | str | None = None,
    title: str = "",
    attributes: Mapping[str, Any] | None = None,
    progress: Progress = unheard,
    home: Home | None = None,
    save: Path | None = None,
) -> xr.Dataset:
    """Close a loop for a while, and record it. However it ends, the output ramps to 0 V.

    What the controller asks for is kept within voltages and slew of the limits (`limited_updates` says how
    often that was needed); a voltage that is no finite number, an exception, and no answer within
    `limits.watchdog` end the run. A controller with an attribute `done` ends it when that is true.

    Args:
        rig: one that takes its output update by update, such as `VirtualRig`.
        controller: what has `step(measured, target, tick)`.
        target: m from home: a number, or a waveform in m.
        channels: as for `measure`; the position that is controlled is `end_effector_position`.
        limits: what the output may not pass; end stops and frozen readings end the run.
        duration: s, at most.
        interval: s between samples that are kept, a multiple of the rig's; each of them if left out.
        title, attributes, progress, home, save: as for `measure`. A run that ended early, or was killed, is
            in unfinished/ beside `save`.

    Returns:
        The recording, with `target_position` [m] and `asked_voltage` [V]. Its attributes `limited_updates`,
        `slowest_step` [s], `mean_step` [s] and `late_updates` (steps longer than an update) say how it went.

    Raises:
        QuantityError: a channel, the target or a time does not fit the rig. Nothing was put out.
        LimitError: a limit was passed, or the controller failed; its `recording` is what there is.
        RigError: the rig does not answer as it should.
    """
    if isinstance(target, str):
        target = to_si(target, "m", "target")
    seconds, between = to_si(duration, "s", "duration"), optional_si(interval, "s", "interval")
    can = rig.capabilities
    if not hasattr(rig, "begin") or not hasattr(rig, "exchange"):
        raise RigError(f"{can.name} takes whole drives only: no loop can be closed on it")
    units = channel_units(can, channels, limits)
    if POSITION not in channels:
        raise QuantityError(f"a closed loop needs the channel {POSITION}, which is not recorded")
    if any(channel.filter is not None or channel.zero for channel in channels.values()):
        raise QuantityError(
            "channels of a closed loop have no filter and no zero: they come sample by sample"
        )
    if can.sample_rate != can.update_rate:
        raise QuantityError(
            f"{can.name} has {can.sample_rate:g} samples for {can.update_rate:g} updates a second"
        )
    if limits.max_duty < 1.0:
        raise QuantityError("Limits.max_duty is of drives that are known beforehand, not of a closed loop")
    capture = Capture(seconds, between or 1.0 / can.sample_rate)
    stride(capture, can.sample_rate)
    count = math.ceil(seconds * can.sample_rate)
    if count > can.max_points:
        raise QuantityError(
            f"duration = {seconds:g} s is longer than {can.name} takes, {can.max_points} updates"
        )
    wanted = targets(target, count, can.update_rate)
    told = getattr(rig, "told", None)
    texts = {"title": title, **(attributes or {}), **({} if told is None else told(1))}
    making = Making(can, channels, units, capture, limits, 0, 0, "", texts)
    samples = None if save is None else Samples(save, making, count)
    home = _home_of(rig) if home is None else home
    try:
        loop = _Loop(rig, controller, wanted, making, home, samples)
        failure = loop.run(progress)
        raw = loop.recorded()
        outcome = COMPLETE if failure is None else f"stopped: {_why(failure)}"[:1000]
        recording = None if raw.shape[1] < 2 else loop.recording(raw, outcome)
        if failure is not None:
            _keep(failure, recording, save)
            raise failure
        assert recording is not None
        if samples is not None and save is not None:
            samples.make_room()
            save_recording(recording, save)
        return recording
    finally:
        if samples is not None:
            samples.close()


def targets(target: Waveform | float | str, count: int, rate: float) -> list[float]:
    """The wanted position at each of so many ticks at a rate [Hz], m; raises QuantityError."""
    if isinstance(target, float | int | str):
        return [to_si(target, "m", "target")] * count
    if getattr(target, "unit", None) != "m":
        raise QuantityError(f"target = {target!r:.60} must be a position [m] or a waveform in m")
    return value_at(target, np.arange(count) / rate).tolist()


class _Loop:
    """One run; `run` is for who waits, `_go` for the thread."""

    def __init__(
        self,
        rig: StreamingRig,
        controller: Controller,
        wanted: list[float],
        making: Making,
        home: Home,
        samples: Samples | None,
    ) -> None:
        self._rig, self._controller, self._making, self._samples = rig, controller, making, samples
        self._wanted, self._can, self._limits = wanted, making.can, making.limits
        channel = making.channels[POSITION]
        self._position = PositionInput(channel.input, channel.calibration)
        self._row, self._home = making.inputs.index(channel.input), home
        self._guard = _Guard(making.limits, making.can)
        self._raw: list[list[float]] = []
        self._measured: list[float] = []
        self._asked: list[float] = []
        self._written = 0
        self._heard = time.monotonic()
        self._begun = False  # whether the rig has; a virtual one compiles its solver before, if it must
        self._answering = False  # whether the controller is being asked just now
        self._left = False  # whether nobody waits any more
        self._ended = threading.Event()
        self._failure: BaseException | None = None
        self._slowest = self._total = 0.0
        self._late = 0

    def run(self, progress: Progress) -> BaseException | None:
        """To its end, and the ramp; what ended it early, if anything did."""
        origin = getattr(self._rig, "origin", 0.0)
        failure: BaseException | None = None
        thread = threading.Thread(target=self._go, args=(origin,), name="closed loop", daemon=True)
        try:
            thread.start()
            while not self._ended.wait(_LOOK):
                progress("closed loop", len(self._raw) / len(self._wanted))
                silent = time.monotonic() - self._heard
                if self._begun and silent > self._limits.watchdog:
                    who = "the controller" if self._answering else self._can.name
                    raise LimitError(f"watchdog: nothing came from {who} for {with_prefix(silent, 's')}")
            failure = self._failure
        except BaseException as error:
            failure = error
        self._left = True
        try:
            self._rig.stop(self._limits.stop_slew)
        except RigError as error:
            if failure is None:
                failure = error
            else:
                failure.add_note(f"The stop failed too: {error}")
        return failure

    def _go(self, origin: float) -> None:
        try:
            self._turns(origin)
        except BaseException as error:
            self._failure = error
        finally:
            self._ended.set()

    def _turns(self, origin: float) -> None:
        step, exchange = self._controller.step, self._rig.exchange
        raw, asked, guard = self._raw, self._asked, self._guard
        readings = self._rig.begin(self._making.inputs)
        self._heard, self._begun = time.monotonic(), True
        first = np.array([readings[self._row]])
        here = partial(
            self._home.positions, self._position.name, chain=self._position.calibration, origin=origin
        )
        start = float(here(first)[0])
        self._home.position = start
        plain, zero = not self._position.calibration, readings[self._row]
        period, block = 1.0 / self._can.update_rate, max(1, round(_BLOCK * self._can.sample_rate))
        given = 0.0
        for tick, target in enumerate(self._wanted):
            reading = readings[self._row]
            measured = start + (reading - zero) if plain else float(here(np.array([reading]))[0])
            self._check(readings, tick)
            self._home.position = measured
            guard.sees(reading, measured, given)
            begun = time.perf_counter()
            self._answering = True
            try:
                wish = step(measured, target, tick)
            except Exception as error:
                raise LimitError(
                    f"the controller failed at update {tick}: {type(error).__name__} {error}"
                ) from error
            self._answering = False
            took = time.perf_counter() - begun
            self._total += took
            self._slowest = max(self._slowest, took)
            self._late += took > period
            self._heard = time.monotonic()
            if self._left:
                return
            given = guard.allowed(wish, given, tick)
            raw.append(readings)
            self._measured.append(measured)
            asked.append(wish)
            if getattr(self._controller, "done", False):
                break
            readings = exchange(given)
            self._heard = time.monotonic()
            if tick % block == block - 1:
                self._write()
        self._write()

    def _check(self, readings: list[float], tick: int) -> None:
        for name, value in zip(self._making.inputs, readings, strict=True):
            if not math.isfinite(value):
                raise LimitError(f"the input {name!r} reads {value} at sample {tick}: stopped")

    def _write(self) -> None:
        if self._samples is not None and len(self._raw) > self._written:
            self._samples.add(np.array(self._raw[self._written :]).T)
            self._written = len(self._raw)

    def recorded(self) -> Array:
        """The raw samples [inputs, n]."""
        return np.array(self._raw).reshape(-1, len(self._making.inputs)).T

    def recording(self, raw: Array, outcome: str) -> xr.Dataset:
        """Of raw samples, with what was wanted and asked for."""
        count = raw.shape[1]
        chosen = np.arange(0, count, stride(self._making.capture, self._can.sample_rate))
        making = self._making
        values = {
            name: calibrated(raw[making.inputs.index(channel.input)], channel.calibration)[chosen]
            for name, channel in making.channels.items()
        }
        values[POSITION] = np.array(self._measured[:count])[chosen]
        made = making.recording(values, making.times(chosen.size), outcome)
        for name, column, unit in ((TARGET, self._wanted, "m"), (ASKED, self._asked, "V")):
            told = {"units": unit, "long_name": name.replace("_", " ")}
            made[name] = ("time", np.array(column[:count], dtype=float)[chosen], told)
        made.attrs.update(
            limited_updates=self._guard.limited,
            slowest_step=self._slowest,
            mean_step=self._total / max(count, 1),
            late_updates=int(self._late),
        )
        return made


class _Guard:
    """The limits, update by update."""

    def __init__(self, limits: Limits, can: Capabilities) -> None:
        self._low = max(limits.min_voltage, can.min_voltage)
        self._high = min(limits.max_voltage, can.max_voltage)
        self._most = limits.max_slew / can.update_rate
        self._limits = limits
        self._patience = max(limits.frozen * can.sample_rate, 2.0)
        self._last, self._same = math.nan, 0
        self._least = self._greatest = 0.0  # of the drive since the reading changed
        self.limited = 0

    def sees(self, reading: float, measured: float, given: float) -> None:
        """A reading and the position of it, after a voltage was put out; raises LimitError."""
        limits = self._limits
        for limit, sign in ((limits.min_position, -1), (limits.max_position, 1)):
            if sign * (measured - limit) > 0.0:
                raise LimitError(
                    f"the end-effector is at {with_prefix(measured, 'm')} from home, beyond the end stop at "
                    f"{with_prefix(limit, 'm')}: stopped"
                )
        if reading != self._last:
            self._last, self._same, self._least, self._greatest = reading, 0, given, given
            return
        self._same += 1
        self._least, self._greatest = min(self._least, given), max(self._greatest, given)
        if self._same >= self._patience and self._greatest - self._least >= FROZEN_DRIVE:
            raise LimitError(
                f"the position is frozen: it has read {reading:.6g} for {self._same} updates while the drive "
                f"moved by {with_prefix(self._greatest - self._least, 'V')}: stopped"
            )

    def allowed(self, wish: float, given: float, tick: int) -> float:
        """What of a wish [V] may be put out after `given`; raises LimitError for what is no number."""
        if not isinstance(wish, float | int) or not math.isfinite(wish):
            raise LimitError(f"the controller asked for {wish!r} V at update {tick}: stopped")
        found = min(max(wish, self._low, given - self._most), self._high, given + self._most)
        self.limited += found != wish
        return found
