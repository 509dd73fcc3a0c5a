r"""Prior of an actuator before its data sheet is used: a value and a factor for each parameter.

68 % of actuators are expected between the value divided by the factor and the value multiplied by the factor.
For printed numbers the factor follows from the sheet's tolerance. Other values follow from printed numbers,
if these are available, by

.. math:: C \approx 1.5\,\Delta x / \Delta u, \qquad F_C \approx 2 F_0, \qquad m_e \approx F_C / a_0, \qquad
          \frac{F_C}{\sigma_0} \approx \frac{\Delta u\,C}{15}, \qquad
          \sigma_1 \approx 2\zeta_b\sqrt{\sigma_0 m_e}

with the gain C, net step Δx, voltage range Δu, Coulomb force F_C, stall force F_0, moved mass m_e, bristle
stiffness σ_0 and damping σ_1, a_0 = 5 m/s² and ζ_b = 0.1. These are assumptions, with wide factors, not
knowledge. Each parameter of the actuator of [kang2007] deviates from its value by at most the factor to the
power of 1.2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.units import QuantityError
from .data_sheet import DataSheet

Array = NDArray[np.float64]

# Number of standard deviations in half a 95 % interval of a normal distribution.
HALF = 1.959964
# Priors of quantities that the sheet does not print: central value, and the factor (OF_...) within which 68 %
# of actuators are expected on either side.

# Prior (central value, factor) of the piezo's stroke over the whole voltage range, divided by the net step.
GAIN_OVER_STEP, OF_GAIN = 1.5, 1.5
# Prior of the stage's resonance: its ratio to the step rate, the lowest assumed resonance [Hz], and the
# factor.
RESONANCE_OVER_RATE, LEAST_RESONANCE, OF_RESONANCE = 5.0, 500.0, 3.0
# Prior (central value, factor) of the damping ratio of the stage.
DAMPING, OF_DAMPING = 0.15, 3.0
# Prior (central value, factor) of the Coulomb force F_C divided by the stall force.
FRICTION_OVER_STALL, OF_FRICTION = 2.0, 2.0
# Prior (central value, factor) of the acceleration F_C / m_e of the end-effector by friction, m/s^2.
ACCELERATION, OF_ACCELERATION = 5.0, 3.0
# Central value of the moved mass m_e, kg, from which F_C follows if the sheet prints neither mass nor force;
# and its factor.
MASS, OF_MASS = 0.05, 3.0
# Prior (central value, factor) of the contact's elastic deflection F_C / sigma_0 divided by the piezo's
# stroke.
PRESLIDING_SHARE, OF_PRESLIDING = 1.0 / 15.0, 3.0
# Prior (central value, factor) of the damping ratio of the bristle with the moved mass.
BRISTLE_DAMPING, OF_BRISTLE = 0.1, 3.0
# Prior (central value, factor) of the effective mass of the stage divided by the moved mass.
STAGE_OVER_MOVED, OF_STAGE = 1.0, 3.0
# Range of the drive voltage, V, that is assumed for a sheet without a greatest voltage. The sheet then does
# not determine the gain, which is in inverse proportion to the range.
VOLTAGE = 100.0
SHEET = "printed"


class Expected(NamedTuple):
    """Prior of one parameter: its central `value`, SI; the `factor` within which 68 % of actuators are
    expected on either side of this value; and the `reason` for the value in words, `SHEET` for a printed
    number."""

    value: float
    factor: float
    reason: str


# Names of the parameters of the posterior, in the order of their coordinates [n, k].
NAMES = (
    "gain", "natural_frequency", "damping_ratio", "end_effector_mass", "stage_mass", "coulomb_force",
    "sigma_0", "sigma_1",
)  # fmt: skip
UNITS = {
    "gain": "m/V", "natural_frequency": "rad/s", "damping_ratio": "", "end_effector_mass": "kg",
    "stage_mass": "kg", "coulomb_force": "N", "sigma_0": "N/m", "sigma_1": "N s/m",
}  # fmt: skip


class Expectations(NamedTuple):
    """Prior of each coordinate, and the voltage range of the sheet's drive (`low` to `high`, V).

    `known` has an `Expected` for each name in `NAMES`. Some are priors of another quantity than the name
    says: "sigma_0" of F_C/σ_0 [m], and "sigma_1" of the damping ratio of the bristle. Without a printed mass,
    "end_effector_mass" is the prior of F_C/m_e [m/s²]. "stage_mass" is the prior of the stage's mass over
    m_e, or over stiffness / ω_n² if the sheet prints the stiffness.
    """

    known: Mapping[str, Expected]
    low: float
    high: float
    # True if the sheet does not print the moved mass, so that the mass follows from the Coulomb force.
    mass_of_force: bool
    # Printed stiffness of the stage, N/m, from which the stage's mass follows (stiffness / ω_n²); None: not
    # printed.
    stiffness: float | None

    def values(self, points: Array) -> dict[str, Array]:
        """Return the parameters by name (`NAMES`), SI, arrays [n], at coordinates `points` [n, k], which have
        a standard normal distribution in the prior."""
        found = {
            name: self.known[name].value * self.known[name].factor ** points[:, i]
            for i, name in enumerate(NAMES)
        }
        force = found["coulomb_force"]
        if self.mass_of_force:
            found["end_effector_mass"] = force / found["end_effector_mass"]
        moved = found["end_effector_mass"]
        if self.stiffness is not None:
            found["stage_mass"] = found["stage_mass"] * self.stiffness / found["natural_frequency"] ** 2
        else:
            found["stage_mass"] = found["stage_mass"] * moved
        found["sigma_0"] = force / found["sigma_0"]
        found["sigma_1"] = 2.0 * found["sigma_1"] * np.sqrt(found["sigma_0"] * moved)
        return found


def expectations(sheet: DataSheet) -> Expectations:
    """Return the prior of an actuator's parameters that follows from a data sheet.

    Raises:
        QuantityError: the sheet has neither a step, nor a stroke, nor a speed with its step rate.
    """
    printed = math.exp(math.log1p(sheet.tolerance) / HALF)
    low, high, over = sheet.min_voltage, sheet.max_voltage, ""
    if high is None:
        high, over = low + VOLTAGE, f" over an assumed {VOLTAGE:g} V"
    step = sheet.step
    if step is None and sheet.speed is not None and sheet.frequency is not None:
        step = sheet.speed / sheet.frequency
    if step is None and sheet.stroke is not None:
        step = sheet.stroke / GAIN_OVER_STEP
    if step is None:
        raise QuantityError(
            "the data sheet says nothing of the step: give step, or stroke, or speed with the frequency "
            "at which it is reached"
        )
    known: dict[str, Expected] = {}
    if sheet.stroke is not None:
        reason = f"printed stroke{over}" if over else SHEET
        known["gain"] = Expected(sheet.stroke / (high - low), printed, reason)
    else:
        known["gain"] = Expected(
            GAIN_OVER_STEP * step / (high - low), OF_GAIN, f"stroke of {GAIN_OVER_STEP:g} steps{over}"
        )
    if sheet.resonance is not None:
        known["natural_frequency"] = Expected(2.0 * math.pi * sheet.resonance, printed, SHEET)
    else:
        rate = sheet.frequency or (sheet.speed / step if sheet.speed else 0.0)
        hertz = max(RESONANCE_OVER_RATE * rate, LEAST_RESONANCE)
        known["natural_frequency"] = Expected(
            2.0 * math.pi * hertz, OF_RESONANCE, f"{RESONANCE_OVER_RATE:g} times the step rate"
        )
    known["damping_ratio"] = Expected(DAMPING, OF_DAMPING, "of stages with a piezo")
    if sheet.holding_force is not None:
        known["coulomb_force"] = Expected(sheet.holding_force, printed, SHEET)
    elif sheet.mass is not None:
        known["coulomb_force"] = Expected(
            ACCELERATION * sheet.mass, OF_ACCELERATION, f"{ACCELERATION:g} m/s² times the moved mass"
        )
    elif sheet.stall_force is not None:
        known["coulomb_force"] = Expected(
            FRICTION_OVER_STALL * sheet.stall_force,
            OF_FRICTION,
            f"{FRICTION_OVER_STALL:g} times the stall force",
        )
    else:
        known["coulomb_force"] = Expected(
            ACCELERATION * MASS,
            math.exp(math.hypot(math.log(OF_ACCELERATION), math.log(OF_MASS))),
            f"{ACCELERATION:g} m/s² times {1e3 * MASS:g} g",
        )
    if sheet.mass is not None:
        known["end_effector_mass"] = Expected(sheet.mass, printed, SHEET)
    else:
        known["end_effector_mass"] = Expected(
            ACCELERATION, OF_ACCELERATION, f"friction accelerates it by {ACCELERATION:g} m/s²"
        )
    if sheet.stiffness is not None:
        known["stage_mass"] = Expected(1.0, printed, "stiffness over ω_n²")
    else:
        known["stage_mass"] = Expected(STAGE_OVER_MOVED, OF_STAGE, "as much as the moved mass")
    # The presliding distance is a share of the stroke and not of the step, because a contact with a long
    # presliding distance makes short steps.
    stroke = known["gain"].value * (high - low)
    known["sigma_0"] = Expected(PRESLIDING_SHARE * stroke, OF_PRESLIDING, "F_C/σ_0 of a 15th of the stroke")
    known["sigma_1"] = Expected(
        BRISTLE_DAMPING, OF_BRISTLE, f"damping ratio of the bristle of {BRISTLE_DAMPING:g}"
    )
    return Expectations(known, low, high, sheet.mass is None, sheet.stiffness)
