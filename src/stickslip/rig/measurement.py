"""One recording from any rig: plan the run, output a drive within the limits, check the samples, record."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ..quantities.progress import Progress, unheard, within
from ..quantities.records import did_you_mean
from ..quantities.units import QuantityError, with_prefix
from ..recording import STANDARD_NAMES, RecordingError
from ..recording.calibration import CalibrationError
from ..recording.calibration.applying import calibration_chain
from ..recording.drive import drive_text
from ..recording.schema import fits_name
from ..waveform.signal import Waveform, value_at
from .capture import Capture, CaptureError, find_trigger, stride
from .gate import Gate, PositionInput, stop_failed
from .home import Home
from .hosted import HostedRig
from .interlock import enabled
from .limits import LimitError, Limits, check_drive
from .protocols import Array, Capabilities, Rig
from .recorded import Channel, Making
from .samples import Samples
from .site import sited

if TYPE_CHECKING:
    import xarray as xr

DRIVE, POSITION = "drive", "end_effector_position"
SETTLING = 0.01  # time sampled before the recording starts, in which the channels' filters settle, s


class RunPlan(NamedTuple):
    """Plan of one run of a rig.

    `volts` are the voltages at the piezo, one per update [n], with 0 V before the drive. `samples` is the
    number of samples that the rig takes. `begin` is the index of the sample at which the drive starts, and
    `wait` the longest wait for the trigger after that, in samples of the rig.
    """

    volts: Array
    samples: int
    begin: int
    wait: int


def measure(
    rig: Rig,
    drive: Waveform,
    channels: Mapping[str, Channel],
    capture: Capture,
    limits: Limits,
    *,
    title: str = "",
    notes: str = "",
    attributes: Mapping[str, Any] | None = None,
    progress: Progress = unheard,
    home: Home | None = None,
    save: Path | None = None,
) -> xr.Dataset:
    """Record one run, or the average of several. The output always ramps to 0 V, however the run ends.

    If a run ends early, the error has an attribute `recording` with the samples of this run so far, or None.
    The recording's attribute `outcome` says why the run ended; it is "complete" for a whole recording.

    Args:
        rig: virtual or real.
        drive: waveform of the voltage at the piezo, V.
        channels: input and processing of each recorded variable, by the name of the variable.
        capture: length, interval, trigger, averaging.
        limits: limits of the output and the position; stricter limits of the site apply too (see `site`).
        title, notes, attributes: texts, and attributes by name, that are stored with the recording.
        progress: called at each block of samples, with "recording" and the finished fraction of the runs.
        home: origin of positions; by default the end-effector's position when this rig was first used. A
            `HostedRig` has its own home.
        save: file for the recording, NAME.nc. Disk space is reserved before the output starts, and the
            samples are stored beside the file during the run. If the program is killed, `samples.recover`
            makes a recording of them. A run that ended early goes to unfinished/NAME.nc, whose path is then
            the error's attribute `kept`.

    Returns:
        The recording: a variable for each channel at the times of the recording, s.

    Raises:
        QuantityError: a channel, the drive or the capture does not fit the rig. Nothing was put out.
        InterlockError: the run may not start, for example because the output is not armed.
        LimitError: the drive was refused, or the run was stopped at a limit.
        CaptureError: the trigger did not come.
        RigError: the rig does not answer as it should.
        OSError, RecordingError: there is no room for the recording, and nothing was put out; or the recording
            cannot be saved, and the file of samples stays.
    """
    home = _home_of(rig) if home is None else home
    rig, narrower, site = sited(rig, limits)
    can = rig.capabilities
    units = channel_units(can, channels, narrower)
    plan = plan_run(can, drive, channels, capture, limits)
    site.check(plan.volts, limits, can)
    limits = narrower
    told = getattr(rig, "told", None)  # a rig may have this method, which returns attributes of recordings
    told = {} if told is None else told(int(capture.average))
    texts = {"title": title, "notes": notes, **(attributes or {}), **told}
    making = Making(can, channels, units, capture, limits, plan.begin, plan.wait, drive_text(drive), texts)
    total: dict[str, Array] = {}
    samples = None if save is None else Samples(save, making, plan.samples)
    try:
        for run in range(int(capture.average)):
            if samples is not None and run:
                samples.restart()
            part = partial(within, progress, run / capture.average, 1.0 / capture.average)
            with enabled(rig, bool(np.any(plan.volts))) as ended:
                raw, failure = _run(rig, plan, making, home, samples, part)
                ended(failure)
            if failure is None:
                try:
                    for name, values in making.values(raw).items():
                        total[name] = total.get(name, 0.0) + values / capture.average
                except CaptureError as missed:
                    failure = missed
            if failure is not None:
                _keep(failure, making.unfinished(raw, _why(failure)) if raw.size else None, samples, save)
                raise failure
        recording = making.recording(total, making.times(capture.samples))
        if samples is not None and save is not None:
            samples.become(recording, save)
        return recording
    finally:
        if samples is not None:
            samples.close()


_HOMES: WeakKeyDictionary[Rig, Home] = WeakKeyDictionary()


def _keep(
    failure: BaseException, recording: xr.Dataset | None, samples: Samples | None, save: Path | None
) -> None:
    """Attach an incomplete recording to the error that ended it, as its attribute `recording`.

    With `samples` and `save` the recording is also saved in unfinished/ beside `save`, and the path becomes
    the error's attribute `kept`. If that fails, the error gets a note and the file of samples stays.
    """
    failure.recording = recording  # type: ignore[attr-defined]
    if recording is None or samples is None or save is None:
        return
    try:
        failure.kept = samples.become(recording, save, unfinished=True)  # type: ignore[attr-defined]
    except (OSError, RecordingError) as error:
        failure.add_note(f"What there is of {save.name} could not be saved, its samples are left: {error}")


def _home_of(rig: Rig) -> Home:
    try:
        return _HOMES.setdefault(rig, Home())
    except TypeError:  # a user's own rig cannot be a dictionary key: its home cannot be kept
        return Home()


def _why(failure: BaseException) -> str:
    return str(failure) or {"KeyboardInterrupt": "interrupted"}.get(
        type(failure).__name__, type(failure).__name__
    )


def plan_run(
    can: Capabilities, drive: Waveform, channels: Mapping[str, Channel], capture: Capture, limits: Limits
) -> RunPlan:
    """Return the plan of a run: the drive in updates of the rig's output, checked against the limits.

    Nothing is output. The arguments are those of `measure`; `can` are the capabilities of the rig.

    Raises:
        QuantityError: the drive is no waveform in V or repeats too fast, the run is too long for the rig, the
            capture does not fit the rig, or the trigger's signal is no channel.
        LimitError: the limits forbid the drive.
        CaptureError: the trigger cannot come.
    """
    if not hasattr(drive, "drive"):
        raise QuantityError(f"drive = {drive!r} is no waveform, such as Step('60 V')")
    if drive.unit != "V":
        raise QuantityError(f"the drive of a rig is in V, this one is in {drive.unit}")
    step = stride(capture, can.sample_rate)
    begin = capture.before * step + math.ceil(SETTLING * can.sample_rate)
    after = (capture.samples - capture.before) * step
    span = drive.duration if math.isfinite(drive.duration) else capture.length
    _check_length(can, begin / can.sample_rate + max(span, after / can.sample_rate))
    _check_speed(can, drive)
    rest = np.zeros(math.ceil(begin * can.update_rate / can.sample_rate - 1e-9))
    reach = max(span, after / can.sample_rate) if capture.trigger else after / can.sample_rate
    played = value_at(drive, np.arange(math.ceil(reach * can.update_rate) + 1) / can.update_rate)
    wait = _wait(can, played, channels, capture, span)
    samples = begin + wait + after + 1
    _check_length(can, samples / can.sample_rate)
    count = math.ceil(samples * can.update_rate / can.sample_rate)
    if rest.size + played.size < count:
        more = np.arange(played.size, count - rest.size) / can.update_rate
        played = np.append(played, value_at(drive, more))
    volts = np.append(rest, played)[:count]
    check_drive(volts, limits, can)
    return RunPlan(volts, samples, begin, wait)


def _wait(
    can: Capabilities, played: Array, channels: Mapping[str, Channel], capture: Capture, span: float
) -> int:
    """Return the longest wait for the trigger after the start of the drive, in samples of the rig.

    Args:
        can: capabilities of the rig.
        played: voltage at each update from the start of the drive [n], V.
        channels: channels of the recording by name.
        capture: settings of the recording.
        span: duration of the drive, s; for an endless drive the length of the recording.

    Returns:
        0 without a trigger. If the trigger is the uncalibrated drive, its known time after the start plus 5
        ms; for any other signal `span`.

    Raises:
        QuantityError: the trigger's signal is no channel.
        CaptureError: the trigger is the drive, which never crosses the level.
    """
    trigger = capture.trigger
    if trigger is None:
        return 0
    if trigger.signal not in channels:
        known = ", ".join(channels)
        hint = did_you_mean(trigger.signal, channels)
        raise QuantityError(f"the trigger {trigger.signal!r} is no channel{hint}; there are {known}")
    if channels[trigger.signal].input != DRIVE or channels[trigger.signal].calibration:
        return math.ceil(span * can.sample_rate)
    found = find_trigger(np.append(0.0, played), trigger, 1)
    if found is None:
        raise CaptureError(
            f"the drive never passes {trigger.level:g} V ({trigger.edge} edge): it goes from "
            f"{min(played.min(), 0.0):g} to {played.max():g} V, beginning at 0 V"
        )
    # The steps of the converter and a filter may delay the trigger by some milliseconds, so 5 ms are added.
    return math.ceil((found / can.update_rate + 0.005) * can.sample_rate)


def channel_units(can: Capabilities, channels: Mapping[str, Channel], limits: Limits) -> dict[str, str]:
    """Return the unit of each channel after calibration, by name of the channel.

    Raises:
        QuantityError: there is no channel, the rig cannot record one, its unit does not fit its name, or its
            filter does not fit the sampling rate.
        LimitError: the limits have end stops, but no channel records the end-effector's position.
    """
    if not channels:
        raise QuantityError("a recording needs at least one channel")
    units = {}
    for name, channel in channels.items():
        if channel.input not in can.inputs:
            known = ", ".join(can.inputs)
            hint = did_you_mean(channel.input, can.inputs)
            raise QuantityError(f"{name}: {can.name} has no input {channel.input!r}{hint}; it has {known}")
        unit = can.inputs[channel.input]
        if channel.calibration:
            try:
                unit = calibration_chain(channel.calibration, unit)[-1].y_unit
            except CalibrationError as error:
                raise QuantityError(f"{name}: {error}") from None
        if not fits_name(name, unit):
            raise QuantityError(
                f"{name} is a quantity in {STANDARD_NAMES[name].unit}, but the input {channel.input!r} gives "
                f"{unit}: it needs a calibration, or another name"
            )
        if channel.filter is not None and channel.filter.corner >= 0.5 * can.sample_rate:
            raise QuantityError(
                f"{name}: the filter's corner of {with_prefix(channel.filter.corner, 'Hz')} must be below "
                f"half the sample rate, {with_prefix(can.sample_rate, 'Hz')}"
            )
        units[name] = unit
    if limits.end_stops and POSITION not in channels:
        raise LimitError(f"end stops are watched on the channel {POSITION}, which is not recorded")
    return units


def _check_length(can: Capabilities, seconds: float) -> None:
    longest = can.max_points / max(can.update_rate, can.sample_rate)
    if seconds > longest:
        raise QuantityError(
            f"the run takes {with_prefix(seconds, 's')}; {can.name} takes up to {with_prefix(longest, 's')}"
        )


def _check_speed(can: Capabilities, drive: Waveform) -> None:
    """Raise QuantityError if a part of a drive repeats faster than half the output's update rate (aliasing).

    The check covers periodic waveforms and frequency sweeps.
    """
    for part, _ in getattr(drive, "parts", ((drive, 0.0),)):
        period: float | None = getattr(part, "period", None)
        ends = getattr(part, "start_frequency", 0.0), getattr(part, "end_frequency", 0.0)
        frequency = max(1.0 / period if period else 0.0, *ends)
        if frequency > 0.5 * can.update_rate:
            raise QuantityError(
                f"{type(part).__name__} repeats at {with_prefix(frequency, 'Hz')}, above half the output's "
                f"update rate of {with_prefix(can.update_rate, 'Hz')}"
            )


def _run(
    rig: Rig,
    plan: RunPlan,
    making: Making,
    home: Home,
    samples: Samples | None,
    progress: Progress,
) -> tuple[Array, BaseException | None]:
    """Make one run and ramp to 0 V; return its raw samples [inputs, n], and the error that ended it early or
    None."""
    channel = making.channels.get(POSITION)
    position = None if channel is None else PositionInput(channel.input, channel.calibration)
    guard = getattr(rig, "guard", None)  # method of a rig that another process supervises
    if guard is not None:
        guard(making.limits, position, plan.begin, None if samples is None else samples.path)
    gate = Gate(rig, making.limits, making.can, home)
    gate.load(plan.volts)
    gate.arm(making.inputs, plan.samples, None if guard is not None else position, plan.begin)
    blocks, done, failure = [np.zeros((len(making.inputs), 0))], 0, None
    try:
        if isinstance(rig, HostedRig):
            rig.waiting = partial(progress, "recording", 0.0)
        gate.start()
        while done < plan.samples:
            block = rig.fetch()
            blocks.append(block)
            if samples is not None:
                samples.add(block)
            gate.take(block)
            done += block.shape[1]
            progress("recording", done / plan.samples)
    except BaseException as error:
        failure = error
    try:
        gate.stop()
    except BaseException as error:
        failure = stop_failed(error, failure)
    return np.concatenate(blocks, axis=1), failure
