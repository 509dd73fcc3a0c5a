"""The problems as models of this package."""

from __future__ import annotations

from typing import Any

import stickslip as ss

from ..problems import AMPLITUDE, FREQUENCY, GAIN, PERIOD, PERIODS, PROBLEMS, WN, ZETA

DRIVE = ss.Sawtooth(amplitude=AMPLITUDE, frequency=FREQUENCY)
DURATION = PERIODS * PERIOD

# Each period is by 1e-9 of the amplitude larger than the one before, which moves the end-effector by some
# 1e-14 m: the same solution, but no two periods of the drive are equal, so none is a copy of another.
UNLIKE = ss.waveform.Sequence(
    *((ss.Sawtooth(AMPLITUDE * (1.0 + 1e-9 * k), FREQUENCY), PERIOD) for k in range(PERIODS))
)


def actuator(problem: str, **changed: Any) -> ss.Actuator:
    """P1 or P2, with parameters of the contact changed by their names in `Contact`."""
    p = PROBLEMS[problem]._replace(**changed)
    return ss.load_actuator("kang2007").replace(
        gain=GAIN,
        natural_frequency=WN,
        damping_ratio=ZETA,
        stage_reaction=False,
        end_effector_mass=p.mass,
        min_voltage=0.0,
        max_voltage=100.0,
        friction=ss.LuGre(
            sigma_0=p.sigma_0,
            sigma_1=p.sigma_1,
            sigma_2=0.0,
            coulomb_force=p.coulomb_force,
            stiction_force=p.stiction_force,
            stribeck_velocity=p.stribeck_velocity,
        ),
    )
