"""Actuator whose piezo has an electrical side: its element in the plant, its state at rest, charge and
current."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..friction import MaxwellSlip
from ..physics.actuator import Actuator, PulledSlider
from ..waveform.drive import Drive, evaluate
from .plant.splitting import through
from .plant.system import Element, Plant

Array = NDArray[np.float64]

# Scale of the stop operators' states: voltages are converted to metres, because the solver's tolerances are
# in metres. The scale is fixed, since with the gain as scale a change of the gain would move the bounds.
PER_VOLT = 1e-7  # m/V


def driven_by_voltage(model: Actuator | PulledSlider) -> bool:
    """Return True if the model has a `MaxwellCapacitor` under voltage control, whose elements slip while the
    stage moves."""
    return isinstance(model, Actuator) and model.two_port is not None and not model.two_port.charge_drive


def element_of(model: Actuator | PulledSlider, modes: int) -> Element | None:
    """Return the stop operators of a `MaxwellCapacitor` as an element of the plant; None for any other model.

    Their input is e = u + T y/C_0. Their sum [V], multiplied by C ω_n², is subtracted from the acceleration
    of the stage, which is the first of `modes` modes. A stop operator is a spring that slips, so they are a
    Maxwell slip law.
    """
    if not driven_by_voltage(model):
        return None
    assert isinstance(model, Actuator)
    assert model.two_port is not None
    width, share = model.two_port.stops()
    # The law is made without its checks, because its fields are arrays in an ensemble.
    law = tuple.__new__(
        MaxwellSlip, (_elements(share), _elements(PER_VOLT * share * width), 0.0, 1.0, 1.0, 1.0)
    )
    none = (None,) * (modes - 1)
    push = -model.gain / PER_VOLT * model.natural_frequency**2
    felt = PER_VOLT * model.drive_force_per_volt / model.two_port.capacitance
    return Element(law, (felt, *none), (push, *none), drive_rate=PER_VOLT)


def _elements(values: Array) -> tuple[Any, ...]:
    """Return values [elements] or [elements, members] as the tuple of a law's field: numbers, or arrays
    [members]."""
    return tuple(values.tolist() if values.ndim == 1 else values)


def settle(plant: Plant, q: Array, first: int, before: float) -> None:
    """Set the state q to rest under the drive `before` [V], reached from 0 V: the states of the stop
    operators, at q[first] and after, and the stage's position q[0].

    On entry, q[0] is the stage's position without the stop operators.
    """
    element, mode = plant.elements[-1], plant.modes[0]
    law, felt, given = element.law, element.velocity[0] or 0.0, -(element.push[0] or 0.0) / mode.stiffness
    share = np.array(law.stiffness)
    limit = np.array(law.strength) / share
    wanted = (element.drive_rate or 0.0) * before + felt * q[0]
    # Output on the initial curve: linear between the limits of the stops.
    corner = np.append(0.0, np.sort(limit))
    total = corner + felt * given * np.sum(share[:, None] * np.minimum(corner, limit[:, None]), axis=0)
    e = np.copysign(np.interp(abs(wanted), total, corner), wanted)  # beyond the last limit all stops slip
    q[first : first + limit.size] = np.clip(e, -limit, limit)
    q[0] -= given * float(share @ q[first : first + limit.size])


def electrical(model: Actuator, samples: Array, further: Array, table: Drive, times: Array) -> dict[str, Any]:
    """Return charge, current and voltage of the piezo at samples of a trajectory, by name with units.

    Args:
        model: the actuator.
        samples: [times, ...], position and velocity of the stage first.
        further: states of the stops [times, stops], in units of `PER_VOLT`.
        table: segment table of the drive, V.
        times: s.
    """
    port = model.two_port
    assert port is not None
    u, du = evaluate(table, times)
    y, dy, per_volt = samples[:, 0], samples[:, 1], model.drive_force_per_volt
    if port.charge_drive:
        free = port.capacitance + model.gain * per_volt
        voltage = (free * u - per_volt * y) / port.capacitance + _across(model, table, times)
        return {"charge": (free * u, "C"), "current": (free * du, "A"), "piezo_voltage": (voltage, "V")}
    width, share = port.stops()
    e, de = u + per_volt * y / port.capacitance, du + per_volt * dy / port.capacitance
    limit = PER_VOLT * width
    slips = (np.abs(further) >= limit * (1.0 - 1e-9)) & (further * de[:, None] > 0.0)
    charge = port.capacitance * (e - further @ share / PER_VOLT)
    current = port.capacitance * de * (1.0 - np.where(slips, 0.0, share).sum(axis=1))
    return {"charge": (charge, "C"), "current": (current, "A")}


def _across(model: Actuator, table: Drive, times: Array) -> Array:
    """Return the voltage [times] across the elements of a piezo under charge control, from rest at
    `table.before` [V]."""
    port = model.two_port
    assert port is not None
    free = port.capacitance + model.gain * model.drive_force_per_volt
    plays = port.operators
    plays = plays._replace(threshold=plays.threshold / free)  # thresholds in terms of the command, V
    z = np.sign(table.before) * np.maximum(abs(table.before) - plays.threshold, 0.0)
    rest = float(plays.weight @ z)
    after = through(plays, table, float(times[-1]), z, rest)
    return free * (plays.weight.sum() * evaluate(table, times)[0] - evaluate(after, times)[0])
