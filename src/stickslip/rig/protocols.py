"""Interfaces and errors of rigs, virtual or real, and interface of the controllers of closed loops.

A rig outputs a drive and records inputs on the same clock; output and inputs start together, at `start`.
Calibration, filtering and storage are the task of `measure`, which treats every rig in the same way.
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
    """A rig or device does not answer, or its answer is wrong, or it cannot do what is requested."""


class StopRequested(RigError):
    """A run ended because a stop was requested. For the interlock this is no fault, unless the program that
    started the run is gone."""


class RigWarning(UserWarning):
    """Warning of a state of a rig that people must look at now, such as a stop without an answer."""


class Capabilities(NamedTuple):
    """Abilities of a rig: rates in Hz, voltages at the piezo in V.

    `name` is the name of the rig for people. `step` is the resolution of the output, V. `max_points` is the
    greatest number of updates of a drive and of samples of a recording. `inputs` gives the unit of each input
    by its name. A rig with `streams` false delivers its samples only after the run, so that end stops are not
    checked during the run. `jitter` is the uncertainty of the delay between the starts of output and
    recording, s. `own_slew` is the slew rate of the ramp to 0 V that the rig itself appends to a drive, V/s.
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
    """Description of a back end before it is connected, for `stickslip rigs`.

    All fields but `ports` are texts: the device, its function (`does`), how its samples arrive, how its
    output reaches a safe state, and against which reference the client was verified. `ports` are the maker's
    TCP ports; with None the search for devices at an address leaves the device out.
    """

    device: str
    does: str
    samples: str
    safe_state: str
    verified: str
    ports: tuple[int, ...] | None = None


class DriveOutput(Protocol):
    """Output of voltages at the piezo. The output is at 0 V before the first `start` and after `stop`."""

    def load(self, volts: Array) -> None:
        """Store the voltages [n], V at the piezo, that `start` puts out, one per update; then the last
        stays."""
        ...

    def start(self) -> None:
        """Start the output, and the recording if `arm` has chosen inputs."""
        ...

    def stop(self, slew: float) -> None:
        """Ramp the output from its present voltage to 0 V at `slew` V/s, and end the recording.

        If the amplifier has a monitor output, the rig has a method `monitor()` that returns its voltage, V.
        A stop is then confirmed only when the monitor reads 0 V.
        """
        ...


class Recorder(Protocol):
    """Recorder of the inputs of a rig; the recording starts with the rig's output."""

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Choose the inputs, by name, and the number of samples of each that are recorded from the start
        on."""
        ...

    def fetch(self) -> Array:
        """Return the samples since the last call [inputs, n], in the units of the inputs; n may be 0.

        The first call returns the samples since the start.

        A recorder whose `fetch` waits for samples may have a method `interrupt()`, which another thread calls
        to request a stop.
        """
        ...


class Rig(DriveOutput, Recorder, Protocol):
    """A drive output and a recorder on one clock.

    A rig with a true attribute `simulated` exists in the computer only and needs no arming. If the limits of
    the device can be changed at the device, the rig has a method `refresh()`. This method is called before
    each run and reads the limits into `capabilities`. Optional are also `told(runs)`, which returns
    attributes for a recording of the next runs, and `origin`, see `home`.
    """

    @property
    def capabilities(self) -> Capabilities:
        """Rates, voltage range, inputs and other capabilities of the rig."""
        ...


class StreamingRig(Rig, Protocol):
    """A rig whose output is set update by update, so that a loop can be closed around it.

    Its inputs are sampled once per update. The readings of an update are available before its voltage is set.
    """

    def begin(self, inputs: tuple[str, ...]) -> list[float]:
        """Start at 0 V and return the readings of these inputs, in their units."""
        ...

    def exchange(self, volts: float) -> list[float]:
        """Put out a voltage, V at the piezo, at this update. Return the readings of the next update."""
        ...


# Names of the attributes that may be a nested controller, and greatest nesting depth that is checked.
_INNER, _DEEPEST = ("controller", "mover", "regulator"), 10


def check_rate(controller: Any, rate: float) -> None:
    """Raise QuantityError if a controller is made for another update rate than `rate` [Hz].

    The attribute `rate` of the controller, and of controllers nested in it, is compared; controllers without
    this attribute work at any rate.
    """
    one = controller
    for _ in range(_DEEPEST):  # limited, because a controller may contain itself
        own = getattr(one, "rate", None)
        if isinstance(own, Real) and not math.isclose(float(own), rate, rel_tol=1e-6):
            who = type(one).__name__
            raise QuantityError(f"rate = {rate:.9g} Hz: the controller's {who} is made for {own:.9g} Hz")
        one = next((getattr(one, name) for name in _INNER if hasattr(one, name)), None)


class Controller(Protocol):
    """Controller of a closed loop, in a simulation, on a virtual rig or on a device.

    A controller needs only `step`. Optional attributes are `rate` (the update rate for which it is made, Hz);
    `done` (True ends the run); `target` (its own target position, m or rad from home, which a rig then
    records and checks instead of the `target` of `step`); and `plausibility` (thresholds for the position).
    Optional methods are `command` (for requests during a run) and `told` (returns JSON data for the
    statistics of a run).
    """

    def step(self, measured: float, target: float, tick: int) -> float:
        """Return the voltage [V] to put out at an update.

        Args:
            measured: position at this update, m (rad) from home.
            target: target position, m (rad) from home.
            tick: number of this update in the run, from 0.
        """
        ...


class ControllerSpec(NamedTuple):
    """Class and options of a controller, from which the process of a rig makes the controller.

    `kind` is a class of `registry.controllers`, of the package or a user's own. `options` are the arguments
    of its constructor, by name; they must be JSON data.
    """

    kind: type
    options: dict[str, Any]

    def document(self) -> dict[str, Any]:
        """Return the specification as JSON data: name of the class, origin of a user's own, `options`."""
        return {**registry.controllers.written(self.kind), "options": self.options}

    def made(self) -> Any:
        """Return a new controller, made by the constructor of `kind` with the `options`."""
        return self.kind(**self.options)


def controller_of(document: dict[str, Any]) -> Any:
    """Return a new controller from the data of `ControllerSpec.document`.

    Raises:
        RegistryError: there is no such controller.
        Exception: the constructor refuses the options, with an error of its own.
    """
    return registry.controllers.of_client(document)(**document["options"])
