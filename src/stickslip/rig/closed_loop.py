"""Closed-loop runs on a rig: at each update, read the inputs, call the controller, set the output.

The loop runs in a thread of its own. If the controller never returns, the calling thread abandons that
thread and ramps the output to 0 V; the samples recorded so far are kept. For a `HostedRig` the loop runs in
the process that owns the rig, and the thread here only fetches its samples.
"""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..quantities.progress import Progress, unheard
from ..quantities.units import QuantityError, optional_si, to_si, with_prefix
from ..recording.calibration.applying import calibration_attribute
from ..recording.calibration.storage import to_text
from ..waveform.signal import Waveform, value_at
from .capture import Capture, stride
from .gate import PositionInput, stop_failed
from .home import Home
from .hosted import HostedRig
from .interlock import enabled
from .limits import LimitError, Limits
from .measurement import POSITION, _home_of, _keep, _why, channel_units
from .plausibility import Plausibility, plausibility_of
from .protocols import Array, Controller, ControllerSpec, RigError, StreamingRig
from .recorded import COMPLETE, Channel, Making
from .samples import Samples
from .site import sited
from .turns import ASKED, AT, STATISTICS, WANTED, LoopRig, looped

if TYPE_CHECKING:
    import xarray as xr

_TARGET, _ASKED = "target_position", "asked_voltage"
_GRACE = 0.2  # longest wait of the calling thread, after the ramp, for the end of the loop's thread, s
_LOOK = 0.02  # time between two checks of the loop's thread for its end and for silence, s


def regulate(
    rig: StreamingRig | HostedRig,
    controller: Controller | ControllerSpec,
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
    sees: Callable[[dict[str, Array]], None] | None = None,
    plausibility: Plausibility | None = None,
    second: str = "",
) -> xr.Dataset:
    """Run a closed loop and record it. Once started, the output always ramps to 0 V, however the run ends.

    The voltage that the controller requests is clipped to the voltage range and slew rate of the limits;
    `limited_updates` counts the clipped updates. A request that is not finite, an exception, or no answer
    within `limits.watchdog` ends the run. A controller with an attribute `done` ends the run when it becomes
    true. If the controller has an attribute `target`, this target is recorded and checked instead of the
    given one.

    Args:
        rig: a rig whose output is set update by update, such as `VirtualRig`; or a `HostedRig` of one.
        controller: has `step(measured, target, tick)`, see `protocols.Controller`. A `HostedRig` needs a
            `ControllerSpec`, from which its process makes the controller.
        target: target position, m (rad) from home: a number, a text with unit, or a waveform in that unit.
        channels: settings by the name of the recorded variable, without filter and `zero`. The channel
            `end_effector_position` is the controlled position.
        limits: limits of the output, to which the site's are added (`site`); end stops and constant readings
            end the run. `max_duty` must be 1.
        duration: longest duration, s.
        interval: time between recorded samples, s, a multiple of the rig's; by default all samples are
            recorded.
        title, attributes, progress, home, save: as for `measure`. A run that ended early is saved in
            unfinished/ beside `save`.
        sees: called about every 5 ms (`HostedRig`: up to 0.1 s) with the next values of each channel [n] by
            name, in the thread of the loop: a slow function delays the updates (not those of a `HostedRig`).
            An error that it raises ends the run.
        plausibility: thresholds for the position, see `control.plausibility`; by default the controller's
            own, as for a `Mover`.
        second: name of a channel that measures the same position by another sensor, for comparison; "" for
            none.

    Returns:
        The recording, with `target_position` [m or rad] and `asked_voltage` [V], the controller's request
        before it is clipped. Its attributes `limited_updates`, `slowest_step` and `mean_step` (computing time
        of the controller's `step`, s) and `late_updates` (number of steps that took longer than an update)
        are statistics of the run.

    Raises:
        QuantityError: a channel, a limit, the target, a time or the update rate of the controller does not
            fit the rig. Nothing was put out.
        InterlockError: the run may not start, for example because the output is not armed.
        LimitError: a limit was passed, the position is not plausible, or the controller failed. Its
            `recording` contains the samples so far; None if there are fewer than two.
        RigError: the rig allows no closed loop, or does not answer as it should.
    """
    home = _home_of(rig) if home is None else home
    rig, limits, _ = sited(rig, limits)  # type: ignore[assignment]
    seconds, between = to_si(duration, "s", "duration"), optional_si(interval, "s", "interval")
    can = rig.capabilities
    if not isinstance(rig, HostedRig) and not (hasattr(rig, "begin") and hasattr(rig, "exchange")):
        raise RigError(f"{can.name} takes whole drives only: no loop can be closed on it")
    if limits.max_duty < 1.0:
        raise QuantityError("Limits.max_duty is of drives that are known beforehand, not of a closed loop")
    unit = channel_units(can, channels, limits).get(POSITION, "m")
    if isinstance(target, str):
        target = to_si(target, unit, "target")
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
    if second and second not in channels:
        raise QuantityError(f"second = {second!r:.60} is no channel; there are {', '.join(channels)}")
    capture = Capture(seconds, between or 1.0 / can.sample_rate)
    stride(capture, can.sample_rate)
    count = math.ceil(seconds * can.sample_rate)
    if count > can.max_points:
        raise QuantityError(
            f"duration = {seconds:g} s is longer than {can.name} takes, {can.max_points} updates"
        )
    whole = isinstance(target, float | int)  # a constant target: one value is enough for all updates
    wanted = targets(target, 1 if whole else count, can.update_rate, unit)
    told = getattr(rig, "told", None)
    chains = {name: [to_text(one) for one in channel.calibration] for name, channel in channels.items()}
    texts = {"calibration": calibration_attribute(chains), "title": title, **(attributes or {})}
    shown = {**channels, POSITION: Channel(AT), _TARGET: Channel(WANTED), _ASKED: Channel(ASKED)}
    units = channel_units(looped(can, unit), shown, limits)
    texts |= {} if told is None else told(1)
    if plausibility is None and not isinstance(rig, HostedRig):  # a HostedRig's process does this
        plausibility = plausibility_of(
            controller.made() if isinstance(controller, ControllerSpec) else controller
        )
    if plausibility is not None:
        texts["plausibility"] = json.dumps(plausibility._asdict())
    making = Making(looped(can, unit), shown, units, capture, limits, 0, 0, "", texts)
    samples = None if save is None else Samples(save, making, count)
    position = PositionInput(channels[POSITION].input, channels[POSITION].calibration)
    other = PositionInput(channels[second].input, channels[second].calibration) if second else None
    try:
        hears = _looped(rig, controller, position, home, limits, samples, plausibility, other)
        loop = _Loop(hears, making, samples, sees)
        with enabled(rig, True) as ended:
            failure = loop.run(wanted, count, progress)
            ended(failure)
        raw = loop.recorded()
        outcome = COMPLETE if failure is None else f"stopped: {_why(failure)}"[:1000]
        recording = None
        if raw.shape[1] > 1:
            every = np.arange(0, raw.shape[1], stride(capture, can.sample_rate))
            values = {name: one[every] for name, one in making.channel_values(raw).items()}
            recording = making.recording(values, making.times(every.size), outcome)
            for name in (_TARGET, _ASKED):
                recording[name].attrs["long_name"] = name.replace("_", " ")
            recording.attrs.update(loop.statistics())
        if failure is not None:
            _keep(failure, recording, samples, save)
            raise failure
        assert recording is not None
        if samples is not None and save is not None:
            samples.become(recording, save)
        return recording
    finally:
        if samples is not None:
            samples.close()


def _looped(
    rig: StreamingRig | HostedRig,
    controller: Controller | ControllerSpec,
    position: PositionInput,
    home: Home,
    limits: Limits,
    samples: Samples | None,
    plausibility: Plausibility | None,
    second: PositionInput | None,
) -> LoopRig | HostedRig:
    """Return a rig whose runs are the closed loop.

    A `HostedRig` is returned itself, set up so that its process closes the loop. Any other rig is wrapped in
    a `LoopRig`, which explains the arguments. `samples` is the file of samples of the run, or None.
    QuantityError if a `HostedRig` has no `ControllerSpec`.
    """
    if not isinstance(rig, HostedRig):
        made: Controller = controller.made() if isinstance(controller, ControllerSpec) else controller
        return LoopRig(rig, made, position, home, limits, plausibility, second)
    if not isinstance(controller, ControllerSpec):
        raise QuantityError(
            "a loop on a HostedRig runs in the rig's process: give a ControllerSpec, not a controller"
        )
    rig.guard(limits, position, 0, None if samples is None else samples.path)
    rig.controlled(controller, plausibility, second)
    return rig


def targets(target: Waveform | float | str, count: int, rate: float, unit: str) -> list[float]:
    """Return the target positions of a run in `unit`, one per update [count].

    Args:
        target: a constant (number in `unit`, or text with a unit), or a waveform in `unit`.
        count: number of updates.
        rate: updates per second, Hz.
        unit: unit of positions, "m" or "rad".

    Raises:
        QuantityError: the target has another unit, or is not finite at every update.
    """
    if isinstance(target, float | int | str):
        found = [to_si(target, unit, "target")] * count
    elif getattr(target, "unit", None) != unit:
        raise QuantityError(f"target = {target!r:.60} must be a position [{unit}] or a waveform in {unit}")
    else:
        found = value_at(target, np.arange(count) / rate).tolist()
    if not np.all(np.isfinite(found)):
        raise QuantityError(f"target = {target!r:.60} is not finite at every tick")
    return found


class _Loop:
    """One closed-loop run: the caller waits in `run`, while another thread starts it and fetches its samples.

    Args:
        rig: the loop as a rig, or a hosted rig whose process closes the loop.
        making: settings of the recording.
        samples: file that gets the samples during the run, or None.
        sees: called with the next values of each channel [n] by name, or None.
    """

    def __init__(
        self,
        rig: LoopRig | HostedRig,
        making: Making,
        samples: Samples | None,
        sees: Callable[[dict[str, Array]], None] | None,
    ) -> None:
        self._rig, self._making, self._samples, self._sees = rig, making, samples, sees
        self._blocks = [np.zeros((len(making.inputs), 0))]
        self._count = self._most = 0
        self._left = False  # True once `run` has stopped waiting, so that the other thread ends
        self._ended = threading.Event()
        self._failure: BaseException | None = None

    def run(self, wanted: list[float], count: int, progress: Progress) -> BaseException | None:
        """Run the loop and then the ramp to 0 V; return the error that ended the run early, or None.

        A failed ramp is an error too, see `stop_failed`, and so is an error while the last samples are stored
        or shown to `sees`. Only the first error is returned; later ones are notes of it.

        Args:
            wanted: target position at each update, m (rad).
            count: greatest number of updates.
            progress: called repeatedly with "closed loop" and the finished fraction.
        """
        failure: BaseException | None = None
        self._most = count
        thread = threading.Thread(target=self._go, args=(wanted,), name="closed loop", daemon=True)
        try:
            thread.start()
            while not self._ended.wait(_LOOK):
                progress("closed loop", min(self._so_far() / count, 1.0))
                self._listen()
            failure = self._failure
        except BaseException as error:
            failure = error
        self._left = True
        try:
            self._rig.stop(self._making.limits.stop_slew)
        except BaseException as error:
            failure = stop_failed(error, failure)
        try:
            thread.join(_GRACE)
            if isinstance(self._rig, LoopRig):
                self._take(self._rig.rest())
        except BaseException as error:
            if failure is None:
                return error
            failure.add_note(f"The last samples failed too: {type(error).__name__} {error}")
        return failure

    def _so_far(self) -> int:
        return self._rig.count if isinstance(self._rig, LoopRig) else self._count

    def _listen(self) -> None:
        """Raise LimitError if neither controller nor rig has answered for `limits.watchdog` seconds.

        A hosted rig is not checked here, because its own process does that. The time before the start of the
        rig does not count.
        """
        rig = self._rig
        if not isinstance(rig, LoopRig) or not rig.begun:
            return
        silent = time.monotonic() - rig.heard
        if silent > self._making.limits.watchdog:
            who = "the controller" if rig.answering else self._making.can.name
            raise LimitError(f"watchdog: nothing came from {who} for {with_prefix(silent, 's')}")

    def _go(self, wanted: list[float]) -> None:
        try:
            self._rig.load(np.array(wanted))
            self._rig.arm(self._making.inputs, self._most)
            self._rig.start()
            while not self._left:
                self._take(self._rig.fetch())
                if self._rig.ended:
                    break
        except BaseException as error:
            self._failure = error
        finally:
            self._ended.set()

    def _take(self, block: Array) -> None:
        if not block.shape[1]:
            return
        self._blocks.append(block)
        self._count += block.shape[1]
        if self._samples is not None:
            self._samples.add(block)
        if self._sees is not None:
            self._sees(self._making.channel_values(block))

    def recorded(self) -> Array:
        """Return the raw samples [inputs, n] that the run has recorded so far."""
        return np.concatenate(self._blocks, axis=1)

    def statistics(self) -> dict[str, Any]:
        """Return the statistics of the run by their names in `turns.STATISTICS`."""
        said = self._rig.statistics() if isinstance(self._rig, LoopRig) else self._rig.said()
        return {name: said[name] for name in STATISTICS if name in said}
