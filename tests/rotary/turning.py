"""What turns: the thesis's actuator on a radius, in rad, N m and kg m^2."""

from __future__ import annotations

import stickslip as ss

RADIUS = 0.012
SLIDES = ss.load_actuator("kang2007")
DRIVE = ss.Sawtooth(65.0, 20.0, periods=3)


def on_radius(model: ss.Actuator) -> ss.Actuator:
    """What slides, seen as what turns about an axis at that radius."""
    law = model.friction
    return model.replace(
        gain=model.gain / RADIUS,
        stage_mass=model.stage_mass * RADIUS**2,
        end_effector_mass=model.end_effector_mass * RADIUS**2,
        external_force=model.external_force * RADIUS,
        friction=law._replace(
            sigma_0=law.sigma_0 * RADIUS**2,
            sigma_1=law.sigma_1 * RADIUS**2,
            coulomb_force=law.coulomb_force * RADIUS,
            stiction_force=law.stiction_force * RADIUS,
            stribeck_velocity=law.stribeck_velocity / RADIUS,
        ),
        rotary=True,
        name="",
    )


TURNS = on_radius(SLIDES)

BENCH = """
kind = "bench"
title = "An encoder of 50 nrad in place of the sensors"
base = "kang2007-bench"
[sensor.encoder]
type = "Encoder"
on = "end_effector"
[sensor.encoder.resolution]
value = 50
unit = "nrad"
source = "its datasheet"
"""


def units(made) -> dict[str, str]:
    return {name: v.attrs["units"] for name, v in made.variables.items() if "units" in v.attrs}
