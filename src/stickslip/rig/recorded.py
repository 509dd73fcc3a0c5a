"""Processing of a rig's raw samples into a recording: calibration, filter, trigger, choice of samples; and
storage of the settings as text."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..gate.text import load_json
from ..physics.electronics import Filter, filtered
from ..quantities.units import with_prefix
from ..recording import make_recording
from ..recording.calibration import Calibration
from ..recording.calibration.applying import calibration_attribute, scale_attribute
from ..recording.calibration.storage import from_text, to_text
from .capture import Capture, CaptureError, Trigger, find_trigger, picks, stride
from .home import calibrated
from .limits import Limits
from .protocols import Array, Capabilities

if TYPE_CHECKING:
    import xarray as xr

COMPLETE = "complete"


class Channel(NamedTuple):
    """A variable of the recording: the name of the rig's input, and the processing of its samples.

    The calibrations are applied to the raw samples in order, then the `filter`. With `zero` the mean of the
    recorded samples before the trigger (at least of the first one) is subtracted.
    """

    input: str
    calibration: tuple[Calibration, ...] = ()
    filter: Filter | None = None
    zero: bool = False


class Making(NamedTuple):
    """Settings with which raw samples become a recording.

    `can` are the capabilities of the rig. `channels` and `units` give, by name of the recorded variable, its
    processing and its unit after calibration. `begin` is the index of the raw sample at which the drive
    starts, and `wait` the longest wait for the trigger after that, in raw samples. `drive` describes the
    drive as a text. `texts` are title, notes and other attributes by name.
    """

    can: Capabilities
    channels: Mapping[str, Channel]
    units: Mapping[str, str]
    capture: Capture
    limits: Limits
    begin: int
    wait: int
    drive: str
    texts: Mapping[str, Any]

    @property
    def inputs(self) -> tuple[str, ...]:
        """Return the names of the inputs that the channels need, each once; raw samples have this order."""
        return tuple(dict.fromkeys(channel.input for channel in self.channels.values()))

    def values(self, raw: Array) -> dict[str, Array]:
        """Return the values of each channel by name, one per sample of the recording [n], in its unit.

        Args:
            raw: raw samples [inputs, n] of a whole run.

        Raises:
            CaptureError: the trigger did not come in time.
        """
        full = self.channel_values(raw)
        chosen = picks(self.capture, self.can.sample_rate, self._trigger(full))
        return {name: self._zeroed(name, full[name][chosen], self.capture.before) for name in self.channels}

    def times(self, count: int) -> Array:
        """Return the times of the first `count` samples of the recording, s from its start."""
        return np.arange(count, dtype=float) * self.capture.interval

    def recording(self, total: Mapping[str, Array], time: Array, outcome: str = COMPLETE) -> xr.Dataset:
        """Return the recording, with attributes for its processing and settings.

        Args:
            total: values of each channel by name [n], in the channel's unit.
            time: times of the samples [n], s.
            outcome: how the run ended: "complete" or "stopped: WHY".
        """
        texts = {name: [to_text(c) for c in channel.calibration] for name, channel in self.channels.items()}
        made = make_recording(
            time,
            {name: (values, self.units[name]) for name, values in total.items()},
            source=self.can.name,
            calibration=calibration_attribute(texts),
            processing="; ".join(self._steps()),
        )
        for name, channel in self.channels.items():
            made[name].attrs.update(scale_attribute(channel.calibration))
        made.attrs.update(self.texts)
        made.attrs["capture"] = json.dumps(_plain(self.capture))
        made.attrs["limits"] = json.dumps(
            {k: v for k, v in self.limits._asdict().items() if math.isfinite(v)}
        )
        made.attrs["drive"] = self.drive
        made.attrs["outcome"] = outcome
        return made

    def unfinished(self, raw: Array, why: str) -> xr.Dataset | None:
        """Return the recording of an unfinished run, up to the first reading that is not finite.

        Without a trigger in the samples, the recording starts where it would with a trigger at the start of
        the drive. If the run ended before that sample, the recording starts at the first raw sample.

        Args:
            raw: raw samples [inputs, n] until the run ended.
            why: reason for the end, in words, for the attribute `outcome`.

        Returns:
            The recording, or None if it would have fewer than two samples.
        """
        broken = np.flatnonzero(~np.isfinite(raw).all(axis=0))
        raw = raw[:, : broken[0]] if broken.size else raw
        if raw.shape[1] < 2:
            return None
        full = self.channel_values(raw)
        step = stride(self.capture, self.can.sample_rate)
        try:
            trigger = self._trigger(full)
        except CaptureError:
            trigger = self.begin
        first = max(trigger - self.capture.before * step, 0)
        if raw.shape[1] - first < step + 1:  # the run ended before the recording's start
            first = 0
        chosen = np.arange(first, raw.shape[1], step)[: self.capture.samples]
        if chosen.size < 2:
            return None
        before = (trigger - first) // step
        kept = {name: self._zeroed(name, full[name][chosen], before) for name in self.channels}
        return self.recording(kept, self.times(chosen.size), f"stopped: {why}"[:1000])

    def _zeroed(self, name: str, kept: Array, before: int) -> Array:
        return kept - kept[: max(before, 1)].mean() if self.channels[name].zero else kept

    def channel_values(self, raw: Array) -> dict[str, Array]:
        """Return the calibrated and filtered values [n] of each channel by name, at all n raw samples.

        `raw` [inputs, n] has the units of the inputs, the result the units of the channels.
        """
        found = {}
        for name, channel in self.channels.items():
            values = calibrated(raw[self.inputs.index(channel.input)], channel.calibration)
            if channel.filter is not None:
                values = filtered(channel.filter, values, self.can.sample_rate)
            found[name] = values
        return found

    def _trigger(self, full: Mapping[str, Array]) -> int:
        """Return the index of the raw sample at the trigger; without a trigger, at the start of the drive.

        `full` has the values of each channel at all raw samples [n]. Raises CaptureError if the trigger did
        not come in time.
        """
        if self.capture.trigger is None:
            return self.begin
        values = full[self.capture.trigger.signal]
        found = find_trigger(values, self.capture.trigger, self.begin - 1)
        if found is None or found > self.begin + self.wait:
            name, level, edge = self.capture.trigger
            raise CaptureError(
                f"no trigger: {name} did not pass {level:g} ({edge} edge) within "
                f"{with_prefix(self.wait / self.can.sample_rate, 's')}; it went from {values.min():.4g} to "
                f"{values.max():.4g}"
            )
        return found

    def _steps(self) -> list[str]:
        """Return the processing steps of the samples, in words, for the recording's attribute
        "processing"."""
        capture, rate = self.capture, self.can.sample_rate
        steps = [f"sampled at {with_prefix(rate, 'Hz')}"]
        for name, channel in self.channels.items():
            if channel.filter is not None:
                low = channel.filter
                corner = with_prefix(low.corner, "Hz")
                family = low.family if low.family == "elliptic" else low.family.capitalize()
                steps.append(f"{name} behind a filter ({family}, order {low.order:g}, {corner})")
            if channel.zero:
                steps.append(f"{name} less its mean before the trigger")
        if stride(capture, rate) > 1:
            steps.append(f"every {stride(capture, rate)}th sample kept")
        if capture.average > 1:
            steps.append(f"mean of {capture.average:g} runs")
        return steps

    def to_text(self) -> str:
        """Return the settings as a JSON text, which the file of samples of a run contains (see `samples`)."""
        content = self._asdict() | {
            "can": self.can._asdict(),
            "channels": {name: channel_document(one) for name, one in self.channels.items()},
            "units": dict(self.units),
            "capture": _plain(self.capture),
            "limits": self.limits._asdict(),
            "texts": dict(self.texts),
        }
        return json.dumps(content)

    @classmethod
    def from_text(cls, text: str) -> Making:
        """Return the settings from the JSON text of `to_text`. Raises ValueError, LookupError or TypeError
        for any other text."""
        content = load_json(text, "samples that were kept")
        trigger = content["capture"].pop("trigger")
        return cls(
            **content
            | {
                "can": Capabilities(**content["can"]),
                "channels": {name: channel_of(one) for name, one in content["channels"].items()},
                "capture": Capture(**content["capture"], trigger=Trigger(**trigger) if trigger else None),
                "limits": Limits(**content["limits"]),
            }
        )


def channel_document(channel: Channel) -> dict[str, Any]:
    """Return a channel as JSON data: `input`, `calibration` (list of JSON texts), `filter`, `zero`."""
    return {
        "input": channel.input,
        "calibration": [to_text(one) for one in channel.calibration],
        "filter": None if channel.filter is None else channel.filter._asdict(),
        "zero": channel.zero,
    }


def channel_of(content: Mapping[str, Any]) -> Channel:
    """Return the channel from the data that `channel_document` returned."""
    low = content["filter"]
    return Channel(
        str(content["input"]),
        tuple(from_text(one) for one in content["calibration"]),
        None if low is None else Filter(**low),
        bool(content["zero"]),
    )


def _plain(capture: Capture) -> dict[str, object]:
    found = capture._asdict()
    return {**found, "trigger": capture.trigger._asdict() if capture.trigger else None}
