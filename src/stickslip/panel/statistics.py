"""Live statistics of a run: rms and range of each channel, steps and their drift; and alarms on them."""

from __future__ import annotations

import json
import math
import threading
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from fastapi import APIRouter, Request
from numpy.typing import NDArray
from pydantic import Field

from ..gate.text import MOST_BYTES, read_json
from ..history.storable import storable
from ..quantities.input_file import Strict
from ..quantities.units import QuantityError, to_si, with_prefix
from ..recording.replacing import replaced_whole
from ..rig.measurement import DRIVE, POSITION
from .control import Control
from .journal import Journal
from .stream import Client, Hub

PAUSE = 0.2  # shortest time between two messages with statistics, s
STEPS = 50  # number of last steps over which mean step and drift are computed
# Growth of the drive's peak-to-peak voltage, as a factor, at which the search for steps starts again. The
# middle has then moved, and earlier rises through it had another phase.
_GROWN = 1.05
_LEAST_SWING = 1.0  # smallest peak-to-peak voltage with which steps are counted, V
ALARMS = ".stickslip/alarms.json"  # file in the panel's folder that keeps the alarms


class Alarm(Strict):
    """Request for an alarm on a statistic, given by its name, such as "mean step".

    `low` and `high` are the limits, in SI or as texts with units; None: no limit. An alarm is raised once in
    a run; with `stop` it then also stops the run.
    """

    statistic: str = Field(max_length=80)
    low: str | float | None = None
    high: str | float | None = None
    stop: bool = False


class Alarms(Strict):
    """Request with the list of all alarms, which replaces the previous list."""

    alarms: list[Alarm] = Field(max_length=40)


class Statistics:
    """Statistics of the current or last run, and alarms on them.

    A step is the displacement between two successive times at which the drive rises through the middle of its
    range. The drive has the same phase at both, so elastic deflection does not count. The drift is the slope
    of a straight line through the last `STEPS` steps over their number. `values` has for each statistic by
    name its label, value and unit; a statistic with an alarm also has "alarm", True if a limit is exceeded.
    Positions and steps are in m, or rad.
    """

    def __init__(self, hub: Hub, journal: Journal, folder: Path) -> None:
        self._hub, self._journal, self._file = hub, journal, folder / ALARMS
        self._lock = threading.Lock()
        self.alarms = self._kept()
        self._columns: list[dict[str, str]] = []
        self._drive = ""
        self.values: dict[str, dict[str, Any]] = {}
        self._raised: set[str] = set()
        hub.greetings.append(self._greet)

    def begin(self, columns: list[dict[str, str]], drive: str) -> None:
        """Reset the statistics for a new run.

        Args:
            columns: a dictionary for each channel: "name", "unit" and "label".
            drive: name of the channel that shows the drive, "" for none: then no steps are counted.
        """
        with self._lock:
            self._columns, self._drive = columns, drive
            self._unit = next((one["unit"] for one in columns if one["name"] == POSITION), "m")
            self._sums = {one["name"]: np.zeros(3) for one in columns}
            self._ends = {one["name"]: [math.inf, -math.inf] for one in columns}
            self._low, self._high = math.inf, -math.inf
            self._swing = 0.0  # peak-to-peak voltage when the search for steps started, V
            self._above = True  # True at first: a rise counts after the drive was below the middle
            self._at: float | None = None
            self._steps: deque[float] = deque(maxlen=STEPS)
            self._count = 0
            self._raised, self._next = set(), 0.0

    def add(self, block: Mapping[str, NDArray[np.float64]], position: float) -> str:
        """Add samples of a run to the statistics; at most every `PAUSE` seconds check alarms and send all to
        the pages.

        Args:
            block: next samples of each channel [n], by name.
            position: position from home, m or rad.

        Returns:
            The reason why an alarm stops the run, "" to continue.
        """
        with self._lock:
            for name, values in block.items():
                if values.size and name in self._sums:
                    self._sums[name] += (values.size, values.sum(), np.square(values).sum())
                    ends = self._ends[name]
                    ends[:] = min(ends[0], float(values.min())), max(ends[1], float(values.max()))
            if self._drive in block and POSITION in block and block[POSITION].size:
                self._walk(block[self._drive], block[POSITION])
            now = time.monotonic()
            if now < self._next:
                return ""
            self._next = now + PAUSE
            return self._tell(position)

    def end(self, position: float) -> None:
        """Send the final statistics of a run to the pages; `position` is the last position from home [m, or
        rad]."""
        with self._lock:
            if self._columns:
                self._tell(position)

    def _walk(self, volts: NDArray[np.float64], at: NDArray[np.float64]) -> None:
        """Find steps in the next samples of the drive [V] and of the position [m, or rad], `at`.

        The range of the drive at a sample depends on the samples up to it only. The steps therefore do not
        depend on the blocks into which a run is cut.
        """
        low = np.fmin.accumulate(np.append(self._low, volts))[1:]
        high = np.fmax.accumulate(np.append(self._high, volts))[1:]
        self._low, self._high = float(low[-1]), float(high[-1])
        swing = high - low
        middle, margin = 0.5 * (low + high), 0.2 * swing
        state = np.where(volts > middle, 1, np.where(volts < middle - margin, -1, 0))
        begin = int(np.searchsorted(swing, _LEAST_SWING))
        while begin < swing.size:
            if swing[begin] > _GROWN * self._swing:
                self._swing, self._above, self._at = float(swing[begin]), True, None
            end = int(np.searchsorted(swing, _GROWN * self._swing, side="right"))
            self._rises(state[begin:end], at[begin:end])
            begin = end

    def _rises(self, state: NDArray[np.int_], at: NDArray[np.float64]) -> None:
        """Append the steps between rises of the drive through the middle of its range.

        `state` is 1 at samples above the middle, -1 at samples clearly below it, else 0. `at` is the position
        at the samples.
        """
        known = np.flatnonzero(state)
        turns = np.flatnonzero(np.diff(state[known], prepend=1 if self._above else -1))
        for i in known[turns]:
            self._above = bool(state[i] > 0)
            if not self._above:
                continue
            if self._at is not None:
                self._steps.append(float(at[i]) - self._at)
                self._count += 1
            self._at = float(at[i])

    def _tell(self, position: float) -> str:
        made: dict[str, dict[str, Any]] = {"position": _value("position from home", position, self._unit)}
        if self._steps:
            steps = np.array(self._steps)
            made["steps"] = _value("steps so far", self._count, "")
            made["step"] = _value("last step", float(steps[-1]), self._unit)
            made["mean step"] = _value("mean step", float(steps.mean()), self._unit)
            if steps.size > 2:
                slope = float(np.polyfit(np.arange(steps.size), steps, 1)[0])
                made["drift of the step"] = _value("change of the step, per step", slope, self._unit)
        for one in self._columns:
            name, (count, total, squares) = one["name"], self._sums[one["name"]]
            if not count:
                continue
            mean = total / count
            spread = math.sqrt(max(squares / count - mean**2, 0.0))
            label, unit = one["label"], one["unit"]
            made[f"rms of {name}"] = _value(f"{label}, rms", math.sqrt(squares / count), unit)
            made[f"deviation of {name}"] = _value(f"{label}, rms about its mean", spread, unit)
            low, high = self._ends[name]
            made[f"range of {name}"] = _value(f"{label}, peak to peak", high - low, unit)
        self.values = made
        why = self._watch()
        self._hub.send(self._message())
        return why

    def _watch(self) -> str:
        """Mark each statistic beyond a limit of its alarm; log it at its first time in the run.

        Returns the message of an alarm that stops the run, "" to continue.
        """
        stop = ""
        for alarm in self.alarms:
            value = self.values.get(alarm.statistic)
            if value is None:
                continue
            try:
                low, high = (
                    None if limit is None else to_si(limit, value["unit"], alarm.statistic)
                    for limit in (alarm.low, alarm.high)
                )
            except QuantityError as error:  # a limit that cannot be compared counts as exceeded
                value["alarm"] = True
                if alarm.statistic not in self._raised:
                    self._raised.add(alarm.statistic)
                    self._journal(f"alarm: {error}", "error")
                    stop = f"alarm: {error}" if alarm.stop else stop
                continue
            beyond = (low is not None and value["value"] < low) or (
                high is not None and value["value"] > high
            )
            value["alarm"] = beyond
            if beyond and alarm.statistic not in self._raised:
                self._raised.add(alarm.statistic)
                shown = with_prefix(value["value"], value["unit"])
                below = low is not None and value["value"] < low
                limit = f"below {alarm.low}" if below else f"above {alarm.high}"
                said = f"alarm: {value['label']} is {shown}, {limit}"
                self._journal(said, "error")
                stop = said if alarm.stop else stop
        return stop

    def set_alarms(self, alarms: list[Alarm]) -> None:
        """Replace all alarms, save them for the next start of the panel, and send them to all pages.

        Raises QuantityError for an alarm without limits, or a limit in another unit than its statistic, which
        is not checked if the statistic has no value yet.
        """
        for one in alarms:
            unit = self.values.get(one.statistic, {}).get("unit")
            for limit in (one.low, one.high):
                if limit is not None and unit is not None:
                    to_si(limit, unit, one.statistic)
            if one.low is None and one.high is None:
                raise QuantityError(f"{one.statistic}: an alarm has a low or a high limit")
        with self._lock:
            self.alarms, self._raised = alarms, set()
            self._file.parent.mkdir(exist_ok=True)
            with replaced_whole(self._file) as temporary:
                temporary.write_text(Alarms(alarms=alarms).model_dump_json(), encoding="utf-8")
        self._hub.send(self._message())

    def _kept(self) -> list[Alarm]:
        try:
            return Alarms.model_validate(storable(read_json(self._file, MOST_BYTES))).alarms
        except (OSError, ValueError):
            return []

    def _message(self) -> str:
        alarms = [one.model_dump() for one in self.alarms]
        return json.dumps({"kind": "statistics", "values": self.values, "alarms": alarms})

    def _greet(self, client: Client, said: dict[str, Any]) -> list[str]:
        return [self._message()]


def _value(label: str, value: float, unit: str) -> dict[str, Any]:
    return {"label": label, "value": value, "unit": unit}


def drive_channel(channels: Mapping[str, Any]) -> str:
    """Return the name of the channel that shows the drive, "" for none; `channels` are those of a cell."""
    return next((name for name, one in channels.items() if one.input == DRIVE), "")


def statistics_routes(control: Control, statistics: Statistics) -> APIRouter:
    """Return the router with the route that sets the alarms, "/statistics/alarms", for the page in
    control."""
    routes = APIRouter(prefix="/statistics")

    @routes.post("/alarms")
    def alarms(asked: Alarms, request: Request) -> dict[str, int]:
        control.need(request.headers.get("x-client", ""))
        statistics.set_alarms(asked.alarms)
        return {"alarms": len(asked.alarms)}

    return routes
