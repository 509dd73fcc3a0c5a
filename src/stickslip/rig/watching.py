"""Wrapper of a rig that passes samples to a viewer during the run, processed as in the recording."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import scipy

from ..physics.electronics.filters import sections
from .gate import PositionInput
from .hosted import HostedRig
from .limits import Limits
from .measurement import SETTLING
from .protocols import Array, Capabilities, Rig
from .recorded import Channel


class WatchedRig:
    """Wrapper of a rig that shows the samples to a watcher, the function `sees`; see `protocols.Rig`.

    Args:
        rig: the rig that records.
        channels: as for `measure`; calibrated, filtered and zeroed block by block. `zero` subtracts the mean
            of the samples before the drive in the first block.
        armed: called before a run with two numbers: the number of samples that will be shown, and the number
            of them before the drive.
        sees: called with the next values of each channel [n] by name, in its unit. The samples in which
            filters settle are left out; while the start is awaited, n is 0. An error that it raises ends the
            run with a ramp to 0 V.
        stopping: called without arguments after the rig's method `stop` has returned.
    """

    def __init__(
        self,
        rig: Rig,
        channels: Mapping[str, Channel],
        armed: Callable[[int, int], None],
        sees: Callable[[dict[str, Array]], None],
        stopping: Callable[[], None],
    ) -> None:
        self._rig, self._channels = rig, channels
        self._armed, self._sees, self._stopping = armed, sees, stopping
        self._inputs: tuple[str, ...] = ()
        self._before = self._skip = 0
        self._states: dict[str, Array] = {}
        self._zeros: dict[str, float] = {}

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of the wrapped rig."""
        return self._rig.capabilities

    @property
    def origin(self) -> float:
        """Return the wrapped rig's `origin`, m (rad), see `home`; 0 if it has none."""
        return getattr(self._rig, "origin", 0.0)

    @property
    def simulated(self) -> bool:
        """Return True if the wrapped rig is simulated."""
        return getattr(self._rig, "simulated", False)

    @property
    def guard(self) -> Callable[[Limits, PositionInput | None, int, Path | None], None] | None:
        """Return the wrapped rig's method `guard`, which gives the limits to the process that supervises the
        rig (see `HostedRig.guard`); None for a rig in this program."""
        return getattr(self._rig, "guard", None)

    def told(self, runs: int) -> dict[str, str]:
        """Return the wrapped rig's attributes for a recording of its next `runs` runs, by name."""
        return getattr(self._rig, "told", lambda runs: {})(runs)

    def load(self, volts: Array) -> None:
        """Load the drive [n], V at the piezo, one value per update. Its first value other than 0 V counts as
        its start."""
        can = self.capabilities
        moving = np.flatnonzero(volts)
        first = int(moving[0]) if moving.size else volts.size
        self._before = int(first * can.sample_rate / can.update_rate)
        self._rig.load(volts)

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Record these inputs for `samples` samples, and call `armed`; the drive must be loaded before."""
        self._inputs, self._states, self._zeros = inputs, {}, {}
        self._skip = min(math.ceil(SETTLING * self.capabilities.sample_rate), self._before)
        self._rig.arm(inputs, samples)
        self._armed(samples - self._skip, self._before - self._skip)

    def start(self) -> None:
        """Call `sees` without samples, then start the run; an error that `sees` raises prevents the start.

        If the wrapped rig is a `HostedRig`, its start calls `sees` without samples again and again while the
        run is prepared.
        """
        nothing = {name: np.zeros(0) for name in self._channels}
        self._sees(nothing)
        if isinstance(self._rig, HostedRig):
            self._rig.waiting = lambda: self._sees(nothing)
        self._rig.start()

    def fetch(self) -> Array:
        """Return the next raw samples [inputs, n], after `sees` was called with their values."""
        block = self._rig.fetch()
        if block.shape[1]:
            shown = {name: self._shown(name, block)[self._skip :] for name in self._channels}
            self._skip = max(self._skip - block.shape[1], 0)
            self._sees(shown)
        return block

    def stop(self, slew: float) -> None:
        """Ramp to 0 V at `slew` [V/s], then call `stopping`."""
        self._rig.stop(slew)
        self._stopping()

    def _shown(self, name: str, block: Array) -> Array:
        channel = self._channels[name]
        values = block[self._inputs.index(channel.input)]
        for calibration in channel.calibration:
            values = calibration(values)
        if channel.filter is not None:
            made = sections(channel.filter, self.capabilities.sample_rate)
            state = self._states.get(name, scipy.signal.sosfilt_zi(made) * values[0])
            values, self._states[name] = scipy.signal.sosfilt(made, values, zi=state)
        if channel.zero:
            if name not in self._zeros:
                self._zeros[name] = float(values[: max(self._before, 1)].mean())
            values = values - self._zeros[name]
        return values
