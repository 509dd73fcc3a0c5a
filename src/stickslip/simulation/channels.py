"""The channels of a trajectory: motion, energy and current, by name and unit, from the solver's samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..friction import elements
from ..physics.actuator import Actuator, PulledSlider
from ..physics.electronics.account import electrical
from ..physics.electronics.stack import Stack
from ..waveform.drive import Drive, evaluate
from ..waveform.signal import Waveform
from . import two_port
from .demand import lines_off, refuse_stack
from .models import SLIDER, STAGE


def variables_of(
    model: Actuator | PulledSlider,
    samples: NDArray[np.float64],
    table: Drive,
    times: NDArray[np.float64],
    waveform: Waveform,
) -> dict[str, Any]:
    """Return the channels of a trajectory by name: motion, forces, drive, and the internal variables of piezo
    and contact.

    Args:
        model: actuator or pulled slider.
        samples: [times, columns], see `models.classic`.
        table: segment table of the drive, in V (after the piezo's hysteresis and creep) or m.
        times: sample times, s.
        waveform: the drive before the piezo.

    Returns:
        Arrays [times] in SI, or pairs of array and unit where the name does not determine the unit. For an
        actuator the names are end_effector_position, stage_position, sliding_displacement, friction_force,
        drive_voltage, stage_velocity, end_effector_velocity, bristle_deflection (numbered if several),
        stage_mode_1 and so on for several modes, and those of `two_port.electrical`. A pulled slider has
        spring_position and spring_force instead of those of stage and drive.
    """
    y, w, x, s, force = samples[:, :5].T
    # With hysteresis or creep, `table` is the drive after the piezo; the channel is the voltage before it.
    if isinstance(model, Actuator) and model.piezo is not None:
        table = waveform.drive(float(times[-1]))
    drive = evaluate(table, times)[0]
    variables: dict[str, Any] = {"end_effector_position": x}
    if isinstance(model, Actuator):
        variables |= {"stage_position": y, "sliding_displacement": y - x}
    variables["friction_force"] = force
    if isinstance(model, Actuator):
        variables |= {"drive_voltage": drive, "stage_velocity": w}
    else:
        variables |= {
            "spring_position": (drive, "m"),
            "spring_force": (model.spring_stiffness * (drive - x), "N"),
        }
    variables["end_effector_velocity"] = s
    n = elements(model.friction)
    for e in range(n):
        name = "bristle_deflection" if n == 1 else f"bristle_deflection_{e + 1}"
        variables[name] = (samples[:, 5 + e], "m")
    if isinstance(model, Actuator):
        for m in range(1 + len(model.further_modes.gain) if model.further_modes else 0):
            variables[f"stage_mode_{m + 1}"] = (samples[:, 5 + n + 2 * m], "m")
        if model.two_port is not None:
            variables |= two_port.electrical(model, samples, samples[:, 5 + n :], table, times)
    return variables


def energy_account(
    model: Actuator, samples: NDArray[np.float64], work: NDArray[np.float64], start: NDArray[np.float64]
) -> dict[str, Any]:
    """Return the energy account by name, as pairs of an array [times] and its unit J.

    The names are drive_work, stage_dissipation, friction_work, external_work (from the start of the account),
    kinetic_energy, elastic_energy, and energy_defect. The defect is the work put in by drive and external
    force, minus dissipation, work lost to friction and the change of the stored energy: 0 for an exact
    solution. If the model drops the reaction of the friction on the stage, the contact's work on the stage
    does not appear in the balance.

    Args:
        model: actuator whose stage has one mode, without a `MaxwellCapacitor`.
        samples: [times, columns], see `models.classic`.
        work: [times, 4], integrals of power over time, see `engine.binding.TERMS`.
        start: [columns], sample at which the account starts.
    """
    y, w, x, s = samples[:, :4].T
    m, m_e = (0.0 if model.static else model.stage_mass), model.end_effector_mass
    k = 0.0 if model.static else model.stage_stiffness
    if model.clamped:  # the mass of the stage already includes that of the end-effector
        m_e = 0.0
    on_stage = (
        work[:, 2] + work[:, 3] if model.stage_reaction and not model.static and not model.clamped else 0.0
    )
    on_slider = 0.0 if model.clamped else work[:, 3]
    kinetic = 0.5 * m * w**2 + 0.5 * m_e * s**2
    elastic = 0.5 * k * y**2
    external = 0.0 * x if model.clamped else model.axial_force * (x - start[SLIDER])
    drive, damping = m * work[:, 0], m * work[:, 1]
    at_start = 0.5 * k * start[STAGE] ** 2 + 0.5 * m * start[STAGE + 1] ** 2
    at_start += 0.5 * m_e * start[SLIDER + 1] ** 2
    stored = kinetic + elastic - at_start
    return {
        "drive_work": (drive, "J"),
        "stage_dissipation": (damping, "J"),
        "friction_work": (work[:, 2], "J"),
        "external_work": (external, "J"),
        "kinetic_energy": (kinetic, "J"),
        "elastic_energy": (elastic, "J"),
        "energy_defect": (drive + external + on_slider - on_stage - damping - stored, "J"),
    }


def of_stack(
    model: Actuator | PulledSlider, stack: Stack, waveform: Waveform, times: NDArray[np.float64]
) -> dict[str, tuple[NDArray[np.float64], str]]:
    """Return the electrical channels of a piezo stack under the drive at the times [s], by name.

    The names are "current" (A), "charge" (C), "reactive_power" (W), "loss_power" (W) and "temperature" (K);
    each value is a pair of an array [times] and its unit.

    Raises:
        QuantityError: the model cannot drive a stack (see `demand.refuse_stack`), or the drive jumps.
    """
    refuse_stack(model, stack)
    end = float(times[-1])
    run = electrical(waveform, stack, end, times=times, tolerance=lines_off(waveform))
    u, du = evaluate(waveform.drive(end), times)
    return {
        "current": (stack.load * du, "A"),
        "charge": (stack.load * u, "C"),
        "reactive_power": (stack.load * u * du, "W"),
        "loss_power": (run["loss_power"].values, "W"),
        "temperature": (run["temperature"].values, "K"),
    }
