"""Interface of a rig, virtual or real: put out a drive, and record inputs on the same clock.

Everything is synchronous: output and inputs begin at the same moment, `start`. A rig knows nothing of
calibrations, filters, triggers or files: `measure` sees to them in the same way for every rig.
"""

from __future__ import annotations

import math
from numbers import Real
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..quantities import registry
from ..quantities.units import QuantityError

Array = NDArray[np.float64]


class RigError(RuntimeError):
    """A rig does not answer, or not as it should."""


class StopRequested(RigError):
    """Somebody asked for a stop."""


class RigWarning(UserWarning):
    """A rig that people must look at now."""


class Capabilities(NamedTuple):
    """What a rig can do: rates in Hz, voltages at the piezo in V.

    `step` is that of the output, V; `max_points` the longest drive or recording, in samples; `inputs` the
    unit of each. A rig that does not `streams` hands its samples out when the run has ended: until then no
    end stop is watched. `jitter` is how unsure the moment is at which output and recording begin, s.
    `own_slew` is that of a ramp to 0 V which the rig itself puts after a drive, V/s.
    """

    name: str
    update_rate: float
    sample_rate: float
    min_voltage: float
    max_voltage: float
    step: float
    max_points: int
    inputs: dict[str, str]
    streams: bool = True
    jitter: float = 0.0
    own_slew: float = 0.0


class About(NamedTuple):
    """What is known of a back end before it is connected, for `stickslip rigs`: the device, what it does,
    how its samples come, how the output is brought to its safe state, and what of all that was verified
    against what."""

    device: str
    does: str
    samples: str
    safe_state: str
    verified: str


class DriveOutput(Protocol):
    """Puts out voltages at the piezo; before the first and after `stop` it is at 0 V."""

    def load(self, volts: Array) -> None:
        """Take the values [n], V, that `start` will put out, one per update; the last one is held."""
        ...

    def start(self) -> None:
        """Begin to put out, and to record if armed."""
        ...

    def stop(self, slew: float) -> None:
        """Wherever the output is, ramp it to 0 V at `slew` V/s, and end recording. Where the amplifier has a
        monitor, a method `monitor()` reads it, V: a stop then ends when that is at 0 V."""
        ...


class Recorder(Protocol):
    """Samples inputs from `start` on."""

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Record these inputs, so many samples of each, when the output starts."""
        ...

    def fetch(self) -> Array:
        """The samples since the last call [inputs, n], in the units of the inputs; n may be 0. One that waits
        for more may have a method `interrupt()`, which another thread calls when a stop was asked for."""
        ...


class Rig(DriveOutput, Recorder, Protocol):
    """A drive output and a recorder on one clock. One of the computer only has an attribute `simulated` that
    is true: nobody is asked to arm it. One whose device has limits that can be changed there has a method
    `refresh()`, which is called before each run and reads them into `capabilities`."""

    @property
    def capabilities(self) -> Capabilities:
        """What it can do."""
        ...


class StreamingRig(Rig, Protocol):
    """A rig that takes its output update by update, so that a loop can be closed around it.

    Its inputs are sampled once per update; what is read at an update is known before its voltage is.
    """

    def begin(self, inputs: tuple[str, ...]) -> list[float]:
        """Begin at 0 V; the readings of these inputs, in their units."""
        ...

    def exchange(self, volts: float) -> list[float]:
        """Put out a voltage, V at the piezo, at this update; the readings at the next one."""
        ...


# Under which names a controller holds another, and how many of them in a row are looked at.
_INNER, _DEEPEST = ("controller", "mover", "regulator"), 10


def check_rate(controller: Any, rate: float) -> None:
    """Raise QuantityError for a controller that is made for another rate [Hz], or holds one that is."""
    one = controller
    for _ in range(_DEEPEST):  # what holds itself has no end
        own = getattr(one, "rate", None)
        if isinstance(own, Real) and not math.isclose(float(own), rate, rel_tol=1e-6):
            who = type(one).__name__
            raise QuantityError(f"rate = {rate:.9g} Hz: the controller's {who} is made for {own:.9g} Hz")
        one = next((getattr(one, name) for name in _INNER if hasattr(one, name)), None)


class Controller(Protocol):
    """What closes a loop: in a simulation, on a virtual rig, on a device."""

    def step(self, measured: float, target: float, tick: int) -> float:
        """The voltage [V] to put out at an update.

        Args:
            measured: position, m from home, at this update.
            target: where it should be, m from home.
            tick: which update of the run this is, from 0 on.
        """
        ...


class ControllerSpec(NamedTuple):
    """A controller by name and what it is made with, as JSON has it: what a rig's process makes it of. Its
    `kind` is one of `registry.controllers`, "path.py:Name" for one's own."""

    kind: type
    options: dict[str, Any]

    def document(self) -> dict[str, Any]:
        """As JSON."""
        return {**registry.controllers.written(self.kind), "options": self.options}

    def made(self) -> Any:
        """The controller."""
        return self.kind(**self.options)


def controller_of(document: dict[str, Any]) -> Any:
    """The controller that a client asks for; raises RegistryError, or what its options are refused with."""
    return registry.controllers.of_client(document)(**document["options"])
