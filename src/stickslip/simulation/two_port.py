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

# Scale [m/V] of the stop operators' states. The states are voltages, and are converted to metres because the
# solver's tolerances are in metres. The actuator's gain is not used as the scale: in a derivative by the
# gain, a changed gain would change the bounds of the states.
PER_VOLT = 1e-7


def driven_by_voltage(model: Actuator | PulledSlider) -> bool:
    """Return True if the model has a `MaxwellCapacitor` under voltage control, whose elements slip while the
    stage moves."""
    return isinstance(model, Actuator) and model.two_port is not None and not model.two_port.charge_drive


def element_of(model: Actuator | PulledSlider, modes: int) -> Element | None:
    """Return the stop operators of a `MaxwellCapacitor` as an element of the plant; None for any other model.

    Their input is e = u + T y/C_0, with the voltage u, the force per volt T, the stage's position y and the
    capacitance C_0. Their sum [V], multiplied by C ω_n² (C: gain), is subtracted from the acceleration of the
    stage. A stop operator is a spring that slips, so that they are one Maxwell slip law.

    Args:
        model: the actuator; in an ensemble, its fields may be arrays [members].
        modes: number of modes of the plant, the first of which is the stage.
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
    """Return an array [elements] as a tuple of numbers, or [elements, members] as a tuple of arrays
    [members]: the value of a law's field."""
    return tuple(values.tolist() if values.ndim == 1 else values)


def settle(plant: Plant, q: Array, first: int, before: float) -> None:
    """Change a state in place to rest with the stop operators, under a voltage that was reached from 0 V.

    Args:
        plant: the plant, whose last element is that of the stop operators.
        q: state [states] at rest without the stop operators. The stage's position q[0] is corrected, and the
            operators' states are filled.
        first: index of the first stop operator's state.
        before: voltage, V.
    """
    element, mode = plant.elements[-1], plant.modes[0]
    law, felt, given = element.law, element.velocity[0] or 0.0, -(element.push[0] or 0.0) / mode.stiffness
    share = np.array(law.stiffness)
    limit = np.array(law.strength) / share
    wanted = (element.drive_rate or 0.0) * before + felt * q[0]
    # Solve for the input e of the operators. On the initial curve from 0 V, `total` = `wanted` is piecewise
    # linear in e, with corners at the limits of the stops; beyond the last limit all stops slip.
    corner = np.append(0.0, np.sort(limit))
    total = corner + felt * given * np.sum(share[:, None] * np.minimum(corner, limit[:, None]), axis=0)
    e = np.copysign(np.interp(abs(wanted), total, corner), wanted)
    q[first : first + limit.size] = np.clip(e, -limit, limit)
    q[0] -= given * float(share @ q[first : first + limit.size])


def electrical(model: Actuator, samples: Array, further: Array, table: Drive, times: Array) -> dict[str, Any]:
    """Return electrical channels of the piezo at samples of a trajectory, as pairs of array [times] and unit.

    The names are "charge" (C) and "current" (A), and under charge control also "piezo_voltage" (V).

    Args:
        model: an actuator with a `MaxwellCapacitor`.
        samples: [times, ...], whose first columns are position and velocity of the stage.
        further: states of the stop operators [times, stops]: V times `PER_VOLT`. Not used under charge
            control.
        table: segment table of the drive, V.
        times: sample times, s.
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
    """Return the voltage [V] at `times` [s] across the hysteresis elements of a piezo under charge control,
    from rest at the command `table.before` [V]."""
    port = model.two_port
    assert port is not None
    free = port.capacitance + model.gain * model.drive_force_per_volt
    plays = port.operators
    plays = plays._replace(threshold=plays.threshold / free)  # from C to V of the command
    z = np.sign(table.before) * np.maximum(abs(table.before) - plays.threshold, 0.0)
    rest = float(plays.weight @ z)
    after = through(plays, table, float(times[-1]), z, rest)
    return free * (plays.weight.sum() * evaluate(table, times)[0] - evaluate(after, times)[0])
