r"""The equations of motion, once, for every engine.

A stage and a slider (the end-effector) that meet in one friction contact, for exports:

.. math::

   \ddot y   &= b\,u(t) + a_s - c\,\dot y - k\,y - r F \\
   \ddot x_e &= b_e\,u(t) + a_e - c_e\,\dot x_e - k_e\,x_e + \mu F, \qquad v = \dot y - \dot x_e

With k = ωₙ², c = 2ζωₙ, b = Cωₙ², r = 1/m and μ = 1/m_e this is the thesis's model [kang2007, eq. 3.20-3.25];
r = 0 drops the reaction of the friction on the stage as the thesis does in eq. 3.24. A slider on fixed ground
pulled through a spring has b_e, c_e, k_e and a stage at rest. A `kinematic` stage follows the drive, y = C u
(Pohl's model, a tribometer).
"""

from __future__ import annotations

from typing import NamedTuple

# Rows of the state vector; the internal states of the friction law follow.
STAGE, STAGE_VELOCITY, SLIDER, SLIDER_VELOCITY, FIRST_BRISTLE = 0, 1, 2, 3, 4


class Mechanism(NamedTuple):
    """Coefficients of the equations above, per unit mass. `rate` [rad/s] is the scale that makes a velocity
    comparable with a position in the error control; `clamped` holds v = 0 for ever."""

    kinematic: bool
    clamped: bool
    gain: float
    stage_stiffness: float
    stage_damping: float
    stage_drive: float
    stage_acceleration: float
    reaction: float
    slider_stiffness: float
    slider_damping: float
    slider_drive: float
    slider_acceleration: float
    mobility: float
    rate: float


def stage_acceleration(mech, u, y, w, force):
    """Acceleration of the stage for the drive u and the friction force."""
    return (
        mech.stage_drive * u
        + mech.stage_acceleration
        - mech.stage_damping * w
        - mech.stage_stiffness * y
        - mech.reaction * force
    )


def slider_acceleration(mech, u, x, s, force):
    """Acceleration of the slider for the drive u and the friction force."""
    return (
        mech.slider_drive * u
        + mech.slider_acceleration
        - mech.slider_damping * s
        - mech.slider_stiffness * x
        + mech.mobility * force
    )


def holding_force(mech, u, ddu, q):
    """The force that a contact at rest carries: the one for which stage and slider accelerate alike."""
    slider = slider_acceleration(mech, u, q[SLIDER], q[SLIDER_VELOCITY], 0.0)
    if mech.kinematic:
        return (mech.gain * ddu - slider) / mech.mobility
    stage = stage_acceleration(mech, u, q[STAGE], q[STAGE_VELOCITY], 0.0)
    return (stage - slider) / (mech.reaction + mech.mobility)


def joined(mech, offset):
    """Stage and slider moving as one body, x_e = y + offset: its own equation in the stage's place.

    The body's acceleration is the mean of the two free accelerations, weighted by the masses.
    """
    total = mech.reaction + mech.mobility
    stage = mech.mobility / total if total > 0.0 else 1.0
    slider = mech.reaction / total if total > 0.0 else 0.0
    return Mechanism(
        mech.kinematic,
        mech.clamped,
        mech.gain,
        stage * mech.stage_stiffness + slider * mech.slider_stiffness,
        stage * mech.stage_damping + slider * mech.slider_damping,
        stage * mech.stage_drive + slider * mech.slider_drive,
        stage * mech.stage_acceleration
        + slider * (mech.slider_acceleration - mech.slider_stiffness * offset),
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        mech.rate,
    )
