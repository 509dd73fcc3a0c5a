"""Samples of the current or last run, kept in memory as float32. During the run, minimum and maximum of
groups of successive samples are sent to every page; a page that zooms in can get all samples of a part."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .decimation import Float32, extremes, window
from .stream import Client, Hub, Message, packed

# Smallest number of buckets (groups of successive samples) into which a long run is divided; the number is
# below twice this. Each gives two points, minimum and maximum: few enough for a browser to connect by lines.
SHOWN = 1250


class Live:
    """Samples of one run at a time; a new run replaces the previous one.

    Pages receive the minimum and maximum of successive buckets of samples, or a part in more detail, see
    `window`.

    Args:
        hub: sends the samples to the pages.
        largest: largest number of samples of all channels together, which are kept as float32.
    """

    def __init__(self, hub: Hub, largest: int = 60_000_000) -> None:
        self._hub, self._largest = hub, largest
        self._lock = threading.Lock()
        self._number = 0
        self._header: dict[str, Any] | None = None
        self._values: Float32 = np.zeros((0, 0), np.float32)
        self._filled = self._sent = 0
        self._bucket = 1
        self._rate = 1.0
        self._pre_trigger = 0.0
        self._recorded: list[float] | None = None  # last value of each channel in the run's recording
        hub.greetings.append(self._so_far)

    def begin(
        self,
        title: str,
        columns: list[dict[str, str]],
        rate: float,
        samples: int,
        before: int,
        pre_trigger: float = 0.0,
    ) -> None:
        """Start a run: discard the previous samples, and send the title and the channels to the pages.

        Samples of the previous run that were not sent yet are sent first.

        Args:
            title: title of the run.
            columns: a dictionary for each channel: "name", "unit" and "label".
            rate: sampling rate, Hz.
            samples: largest number of samples of each channel; further ones are ignored.
            before: number of samples before the drive starts, at time 0.
            pre_trigger: time of the recording before its trigger, s. The trigger is assumed at time 0 until
                `triggered` is called.

        Raises:
            MemoryError: there are more samples than are kept.
        """
        if samples * len(columns) > self._largest:
            raise MemoryError(f"{samples} samples of {len(columns)} channels are too many to show")
        with self._lock:
            if self._header is not None:
                self._send()
            self._number += 1
            self._bucket = max(1, samples // SHOWN)
            self._rate = rate
            self._values = np.zeros((len(columns), samples), np.float32)
            self._filled = self._sent = 0
            self._pre_trigger, self._recorded = pre_trigger, None
            self._header = {
                "kind": "trace",
                "trace": self._number,
                "title": title,
                "columns": columns,
                "begin": -before / rate,
                "zero": -pre_trigger,
                "interval": 1 / rate,
                "samples": samples,
                "bucket": self._bucket,
            }
            self._hub.send(json.dumps(self._header))

    def triggered(self, sample: int) -> None:
        """Set the trigger of the run's recording; pages then count time from the recording's first sample.

        `sample` is the index in the run of the sample at the trigger.
        """
        with self._lock:
            if self._header is None:
                return
            zero = self._header["begin"] + sample / self._rate - self._pre_trigger
            self._header = {**self._header, "zero": zero}
            self._hub.tell("clock", trace=self._number, zero=zero)

    @property
    def begun(self) -> bool:
        """Return True if at least one sample of the run has arrived."""
        return self._filled > 0

    def add(self, block: Mapping[str, NDArray[np.float64]]) -> None:
        """Append the next samples of each channel, arrays [n] by name in the order of the run's columns."""
        rows = list(block.values())
        with self._lock:
            end = min(self._filled + rows[0].size, self._values.shape[1])
            for i, row in enumerate(rows):
                self._values[i, self._filled : end] = row[: end - self._filled]
            self._filled = end
            # If older messages are not sent yet, these samples are sent with the next ones.
            if not self._hub.behind:
                self._send()

    def recorded(self, last: Mapping[str, float]) -> None:
        """Take the last value of each channel in the run's recording, by name, and send it to the pages.

        Pages then show the end of the recording. The run itself has more samples, because its trigger might
        have come later.
        """
        with self._lock:
            if self._header is not None and self._filled:
                self._recorded = [float(last[one["name"]]) for one in self._header["columns"]]
                self._tell_latest()

    def end(self) -> None:
        """Send the samples of the run that were not sent yet; called at its end."""
        with self._lock:
            if self._header is None:
                return
            self._send()
            # The last bucket is incomplete, and its samples were not sent.
            if self._filled > self._sent * self._bucket:
                self._tell_latest()

    def _latest(self) -> list[float]:
        return self._recorded or self._values[:, self._filled - 1].tolist()

    def _tell_latest(self) -> None:
        self._hub.tell("latest", trace=self._number, values=self._latest())

    def _send(self) -> None:
        message = self._block(self._sent)
        if message is not None:
            self._sent = self._filled // self._bucket
            self._hub.send(message)

    def window(self, trace: int, begin: float, end: float, points: int) -> bytes:
        """Return a part of the curves as a packed binary message, for a page that zooms in.

        The message has the times, counted from `begin`, and the values of each channel.

        Args:
            trace: number of the run, counted since the panel started.
            begin, end: limits of the part, s from the start of the drive.
            points: wished number of points of each curve.

        Raises:
            ValueError: the curves are not those of the current or last run.
        """
        with self._lock:
            if self._header is None or trace != self._number:
                raise ValueError("that run is no longer in memory: open its recording")
            first = self._header["begin"]
            low = max(int((begin - first) * self._rate) - 1, 0)
            high = min(int((end - first) * self._rate) + 3, self._filled)
            values = self._values[:, low : max(high, low)]
            time = first + (low + np.arange(values.shape[1])) / self._rate
            times, shown = window(time, values, points)
            return packed({"kind": "window", "trace": trace, "from": begin}, times - begin, *shown)

    def _block(self, first: int) -> bytes | None:
        """Return minimum and maximum of all complete buckets from number `first` on, as a packed message.

        None: no further bucket is complete. A bucket is a group of successive samples.
        """
        last = self._filled // self._bucket
        if last <= first:
            return None
        values = extremes(self._values[:, first * self._bucket : last * self._bucket], self._bucket)
        header = {"kind": "block", "trace": self._number, "bucket": first, "latest": self._latest()}
        return packed(header, *values)

    def _so_far(self, client: Client, said: dict[str, Any]) -> Iterable[Message]:
        with self._lock:
            if self._header is not None:
                yield json.dumps(self._header)
                message = self._block(0)
                if message is not None:
                    yield message
