"""Samples of the current or last run: sent to every page as they come, and kept at full resolution."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .decimation import Float32, extremes, window
from .stream import Client, Hub, Message, packed

# Fewest buckets of samples into which a long run is divided; it has less than twice as many. Each gives two
# points (minimum and maximum): few enough for a browser to draw all connecting lines.
SHOWN = 1250


class Live:
    """Samples of one run at a time; a new run replaces the previous one.

    Args:
        hub: sends to the pages.
        largest: samples of all channels together that are kept at full resolution, float32.
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
        self._recorded: list[float] | None = None  # last values of the run's recording
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
        """Start a run.

        Args:
            title: title of the run.
            columns: name, unit and label of each channel.
            rate: sampling rate, Hz.
            samples: number of samples of each channel.
            before: number of samples before the drive starts; time 0 is after them.
            pre_trigger: s of the recording before its trigger. The trigger is assumed at time 0 until
                `triggered` is called.
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
        """Set the trigger of the recording; pages then start the time axis at the recording's first sample.

        `sample` is the index of the trigger's sample in the run.
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
        """Append samples [n] of each channel, in the order of the run's columns."""
        rows = list(block.values())
        with self._lock:
            end = min(self._filled + rows[0].size, self._values.shape[1])
            for i, row in enumerate(rows):
                self._values[i, self._filled : end] = row[: end - self._filled]
            self._filled = end
            if not self._hub.behind:  # otherwise they are sent with the next samples
                self._send()

    def recorded(self, last: Mapping[str, float]) -> None:
        """Take the last values of the run's recording: pages show what the file contains.

        More samples are measured than recorded, because the trigger might have come later.
        """
        with self._lock:
            if self._header is not None and self._filled:
                self._recorded = [float(last[one["name"]]) for one in self._header["columns"]]
                self._tell_latest()

    def end(self) -> None:
        """Finish the run: send the remaining samples."""
        with self._lock:
            if self._header is None:
                return
            self._send()
            if self._filled > self._sent * self._bucket:  # an incomplete bucket, in no block
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
        """Return the values between two times as a binary message, for a page that zooms in.

        Args:
            trace: number of the run's curves; ValueError if it is not the current or last run.
            begin, end: s from the start of the drive. The times of the message count from `begin`.
            points: number of points to draw.
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
        """Return the complete buckets from `first` on as a message; None if no new bucket is complete."""
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
