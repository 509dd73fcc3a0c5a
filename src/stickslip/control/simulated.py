"""Simulation of an actuator under a controller, tick by tick."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..physics.actuator import Actuator
from ..quantities.progress import Progress, unheard
from ..quantities.records import DURATION, SAMPLE_RATE, refuse_too_many
from ..quantities.units import QuantityError, labelled_for, to_si, unit_for
from ..recording import make_recording
from ..rig.closed_loop import targets
from ..rig.protocols import Controller, check_rate
from ..simulation.ticks import Motion
from ..waveform.signal import Waveform
from .blocks import whole_number

if TYPE_CHECKING:
    import xarray as xr

_TOLD = 2000  # number of ticks between two calls of `progress`


def simulate_control(
    model: Actuator,
    controller: Controller,
    target: Waveform | float | str,
    duration: float | str,
    *,
    rate: float | str = 20e3,
    delay: int = 0,
    noise: float | str = 0.0,
    seed: int = 0,
    tolerance: float | str = 1e-9,
    progress: Progress = unheard,
) -> xr.Dataset:
    """Return the trajectory of an actuator under a controller, from rest at 0 V.

    At each tick the controller gets the end-effector's position and returns the voltage, which is constant
    until the next. Positions are relative to the rest position under slope and load (in `simulate`, to rest
    without them). Converters, amplifier and the limits of a rig are not simulated (see `rig.regulate`). If
    the controller, or its `controller`, `mover` or `regulator`, has an attribute `rate` [Hz], it must equal
    `rate`.

    Args:
        model: the actuator.
        controller: object with `step(measured, target, tick)`, which gets positions and the number of the
            tick, and returns the voltage [V]; the run ends when its attribute `done`, if any, is True.
        target: wanted position, m (rad): a number, or a waveform in that unit.
        duration: longest duration, s.
        rate: update rate, Hz.
        delay: delay of the voltage, in ticks; until then it is 0 V.
        noise: standard deviation of a measured position, m.
        seed: seed of the noise.
        tolerance: tolerance of the simulation in each tick, m.
        progress: function that is called with "closed loop" and the finished fraction.

    Returns:
        Dataset over "time": end_effector_position, measured_position, target_position (m), drive_voltage (V).

    Raises:
        QuantityError: a number is out of range; the target is not a position; the controller has the wrong
            type or another rate; it returns a voltage that is not finite or outside the actuator's range; or
            a static stage would jump.
        SimulationError: the motion could not be simulated.
        Exception: an error of the controller itself, such as MoveError, is passed on.
    """
    unit = unit_for(model, "m")
    hertz, seconds = SAMPLE_RATE.check(rate, "rate"), DURATION.check(duration, "duration")
    sigma, ticks = to_si(noise, unit, "noise"), seconds * hertz
    refuse_too_many(ticks, f"duration = {seconds:g} s at rate = {hertz:g} Hz")
    if not ticks > 1.0:
        raise QuantityError(f"duration = {seconds:g} s at rate = {hertz:g} Hz holds fewer than two ticks")
    if not 0.0 <= sigma < math.inf:
        raise QuantityError(f"noise = {sigma:g} {unit} is out of range: it must be >= 0 {unit} and finite")
    delay, seed = whole_number(delay, "delay"), whole_number(seed, "seed")
    count = math.ceil(ticks)
    wanted = targets(target, count, hertz, unit)
    motion = Motion(model, tolerance=tolerance)
    if not callable(getattr(controller, "step", None)):
        raise QuantityError(f"controller = {controller!r:.60} must have step(measured, target, tick)")
    check_rate(controller, hertz)
    read = sigma * np.random.default_rng(seed).standard_normal(count)
    found = np.empty((3, count))
    late = [0.0] * delay
    step, tick_time, start = controller.step, 1.0 / hertz, motion.position
    for tick in range(count):
        if tick % _TOLD == 0:
            progress("closed loop", tick / count)
        position = motion.position - start
        measured = position + read[tick]
        volts = _volts(step(measured, wanted[tick], tick), tick)
        if not model.min_voltage <= volts <= model.max_voltage:  # also true for NaN
            raise QuantityError(
                f"the controller asks for {volts:g} V at tick {tick}; {model.name or 'the actuator'} takes "
                f"{model.min_voltage:g} V to {model.max_voltage:g} V"
            )
        late.append(volts)
        given = late.pop(0)
        found[:, tick] = position, measured, given
        if getattr(controller, "done", False):
            count = tick + 1
            break
        motion.hold(given, tick_time)
    position, measured, given = found[:, :count]
    variables = {
        "end_effector_position": position,
        "measured_position": (measured, "m"),
        "target_position": (wanted[:count], "m"),
        "drive_voltage": given,
    }
    made = make_recording(np.arange(count) / hertz, variables, title=f"control of {model.name}".rstrip())
    labelled_for(model, made)
    made.attrs["model"] = repr(model)
    return made


def _volts(said: Any, tick: int) -> float:
    """Return the controller's output `said` at a tick as a number, V; raise QuantityError if it is not
    one."""
    if isinstance(said, float):
        return said
    field = f"what the controller returned at tick {tick}"
    if isinstance(said, str):  # even a text with a unit, "5 V", is an error of the controller
        raise QuantityError(f"{field} = {said!r:.60} is not a number (expected V)")
    return to_si(said, "V", field)
