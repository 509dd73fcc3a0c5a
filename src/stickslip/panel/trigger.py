"""Search for the sample that triggers a recording, while its run continues."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..rig.capture import Capture, find_trigger
from .live import Live


class TriggerSeeker:
    """Finds the sample at which the trigger signal of a recording crosses its level, and tells `live` its
    index.

    Calling the object with the next samples of each channel, by name, continues the search that `begin`
    started. Without a trigger nothing is searched.
    """

    def __init__(self, capture: Capture, live: Live) -> None:
        self._trigger, self._live = capture.trigger, live
        self._open = False

    def begin(self, before: int) -> None:
        """Start the search in a new run; only samples after the first `before`, when the drive starts, can
        trigger."""
        self._seen, self._before = np.zeros(0), before
        self._passed = 0
        self._open = self._trigger is not None

    def __call__(self, block: dict[str, NDArray[np.float64]]) -> None:
        if not self._open or self._trigger is None:
            return
        values = np.append(self._seen, block[self._trigger.signal])
        found = find_trigger(values, self._trigger, self._before - self._passed)
        if found is not None:
            self._open = False
            self._live.triggered(self._passed + found)
        self._passed += values.size - 1
        self._seen = values[-1:]
