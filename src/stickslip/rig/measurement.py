"""One recording from any rig: put out a drive through the gate, record, calibrate, filter, trigger, cut."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
import xarray as xr

from ..calibration import Calibration, CalibrationError
from ..calibration.applying import calibration_attribute, calibration_chain
from ..calibration.storage import to_text
from ..electronics import Filter, filtered
from ..recording import STANDARD_NAMES, make_recording
from ..records import did_you_mean
from ..units import QuantityError, with_prefix
from ..waveform.signal import Waveform, value_at
from .capture import Capture, CaptureError, find_trigger, picks, stride
from .limits import Gate, LimitError, Limits, check_drive
from .protocols import Array, Capabilities, Rig

DRIVE, POSITION = "drive", "end_effector_position"
SETTLING = 0.01  # s before the pre-trigger, for filters to settle


class Channel(NamedTuple):
    """A variable of the recording: the rig's input, and what is done to it.

    `calibration` is applied to the raw samples, one after the other; then the `filter`; `zero` takes off the
    mean of what is before the trigger.
    """

    input: str
    calibration: tuple[Calibration, ...] = ()
    filter: Filter | None = None
    zero: bool = False


class Plan(NamedTuple):
    """What goes to a rig for one run: voltages, samples to record, and where the drive begins among them."""

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
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """A recording.

    Args:
        rig: virtual or real.
        drive: V at the piezo.
        channels: by the name of the variable they become.
        capture: length, interval, trigger, averaging.
        limits: what the output may not pass.
        title, notes: kept with the recording.
        progress: called with the part done, from 0 to 1.

    Raises:
        QuantityError: a channel, the drive or the capture does not fit the rig. Nothing was put out.
        LimitError: the drive was refused, or stopped.
        CaptureError: the trigger did not come.
        RigError: the rig does not answer as it should.
    """
    can = rig.capabilities
    units = channel_units(can, channels, limits)
    plan = plan_run(can, drive, channels, capture, limits)
    inputs = tuple(dict.fromkeys(channel.input for channel in channels.values()))
    total: dict[str, Array] = {}
    for run in range(int(capture.average)):
        raw = _run(rig, plan, inputs, channels, limits, partial(_tell, progress, run, capture))
        full = {name: _processed(raw[inputs.index(c.input)], c, can) for name, c in channels.items()}
        chosen = picks(capture, can.sample_rate, _trigger(full, capture, plan, can))
        for name, channel in channels.items():
            kept = full[name][chosen]
            if channel.zero:
                kept = kept - kept[: max(capture.before, 1)].mean()
            total[name] = total.get(name, 0.0) + kept / capture.average
    applied = {name: [to_text(c) for c in channel.calibration] for name, channel in channels.items()}
    made = make_recording(
        np.arange(capture.samples) * capture.interval,
        {name: (values, units[name]) for name, values in total.items()},
        title=title,
        notes=notes,
        source=can.name,
        calibration=calibration_attribute(applied),
        processing="; ".join(_steps(channels, capture, can)),
    )
    made.attrs["capture"] = json.dumps(_plain(capture))
    made.attrs["limits"] = json.dumps({k: v for k, v in limits._asdict().items() if math.isfinite(v)})
    made.attrs["drive"] = repr(drive)[:2000]
    return made


def _tell(progress: Callable[[float], None] | None, run: int, capture: Capture, part: float) -> None:
    if progress is not None:
        progress((run + part) / capture.average)


def plan_run(
    can: Capabilities, drive: Waveform, channels: Mapping[str, Channel], capture: Capture, limits: Limits
) -> Plan:
    """The drive as the rig's output takes it, checked against the limits; nothing is put out.

    Raises:
        QuantityError, LimitError, CaptureError: as `measure`.
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
    return Plan(volts, samples, begin, wait)


def _wait(
    can: Capabilities, played: Array, channels: Mapping[str, Channel], capture: Capture, span: float
) -> int:
    """How many samples after the begin of the drive its trigger comes at the latest."""
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
    # A converter's steps and a filter may bring it a little later than the drive as it is asked for.
    return math.ceil((found / can.update_rate + 0.005) * can.sample_rate)


def _run(
    rig: Rig,
    plan: Plan,
    inputs: tuple[str, ...],
    channels: Mapping[str, Channel],
    limits: Limits,
    progress: Callable[[float], None],
) -> Array:
    """One run: the raw samples [inputs, samples]. However it ends, the output ramps to 0 V."""
    gate = Gate(rig, limits, rig.capabilities)
    position = channels.get(POSITION) if limits.end_stops else None
    home = None
    gate.load(plan.volts)
    rig.arm(inputs, plan.samples)
    blocks, done = [], 0
    try:
        gate.start()
        while done < plan.samples:
            block = rig.fetch()
            gate.heard(block.shape[1])
            if position is not None and block.shape[1]:
                at = _calibrated(block[inputs.index(position.input)], position)
                home = at[: plan.begin].mean() if home is None else home
                gate.watch(at - home)
            blocks.append(block)
            done += block.shape[1]
            progress(done / plan.samples)
    finally:
        gate.stop()
    return np.concatenate(blocks, axis=1)


def _calibrated(raw: Array, channel: Channel) -> Array:
    for calibration in channel.calibration:
        raw = calibration(raw)
    return raw


def _processed(raw: Array, channel: Channel, can: Capabilities) -> Array:
    values = _calibrated(raw, channel)
    return values if channel.filter is None else filtered(channel.filter, values, can.sample_rate)


def _trigger(full: Mapping[str, Array], capture: Capture, plan: Plan, can: Capabilities) -> int:
    """The sample at which the recording is triggered."""
    if capture.trigger is None:
        return plan.begin
    values = full[capture.trigger.signal]
    found = find_trigger(values, capture.trigger, plan.begin - 1)
    if found is None or found > plan.begin + plan.wait:
        name, level, edge = capture.trigger
        raise CaptureError(
            f"no trigger: {name} did not pass {level:g} ({edge} edge) within "
            f"{with_prefix(plan.wait / can.sample_rate, 's')}; it went from {values.min():.4g} to "
            f"{values.max():.4g}"
        )
    return found


def channel_units(can: Capabilities, channels: Mapping[str, Channel], limits: Limits) -> dict[str, str]:
    """The unit of each channel, calibrated; raises QuantityError for channels that the rig cannot record."""
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
        standard = STANDARD_NAMES.get(name)
        if standard is not None and standard.unit != unit:
            raise QuantityError(
                f"{name} is a quantity in {standard.unit}, but the input {channel.input!r} gives {unit}: it "
                "needs a calibration, or another name"
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
    """Raises QuantityError for what repeats faster than the output can follow: it would be another signal."""
    for part, _ in getattr(drive, "parts", ((drive, 0.0),)):
        period: float | None = getattr(part, "period", None)
        ends = getattr(part, "start_frequency", 0.0), getattr(part, "end_frequency", 0.0)
        frequency = max(1.0 / period if period else 0.0, *ends)
        if frequency > 0.5 * can.update_rate:
            raise QuantityError(
                f"{type(part).__name__} repeats at {with_prefix(frequency, 'Hz')}, above half the output's "
                f"update rate of {with_prefix(can.update_rate, 'Hz')}"
            )


def _steps(channels: Mapping[str, Channel], capture: Capture, can: Capabilities) -> list[str]:
    """What was done to the samples, in words."""
    steps = [f"sampled at {with_prefix(can.sample_rate, 'Hz')}"]
    for name, channel in channels.items():
        if channel.filter is not None:
            low = channel.filter
            corner = with_prefix(low.corner, "Hz")
            family = low.family if low.family == "elliptic" else low.family.capitalize()
            steps.append(f"{name} behind a filter ({family}, order {low.order:g}, {corner})")
        if channel.zero:
            steps.append(f"{name} less its mean before the trigger")
    if stride(capture, can.sample_rate) > 1:
        steps.append(f"every {stride(capture, can.sample_rate)}th sample kept")
    if capture.average > 1:
        steps.append(f"mean of {capture.average:g} runs")
    return steps


def _plain(capture: Capture) -> dict[str, object]:
    found = capture._asdict()
    return {**found, "trigger": capture.trigger._asdict() if capture.trigger else None}
