"""Reversals of a contact within a step: where its sliding speed passes through a value, or is least or most,
on the continuous extension, as a polynomial of the fraction of the step."""

from __future__ import annotations

from .._jit import fused
from ..plant.generated import drive_rates, follows_drive, relative_speeds

# A root whose last correction was smaller than this part of the step is exact to rounding.
ENOUGH = 1e-8
# Of half a step, to find where the sliding speed is least.
HALVINGS = 12


@fused
def polynomial(plant, e, h, q, new, rows, u):
    """Sliding speed of contact e within a step as a polynomial of the fraction: a_0 to a_4."""
    v, v_new = relative_speeds(plant, q)[e], relative_speeds(plant, new)[e]
    r0, r1, r2 = (
        relative_speeds(plant, rows[0])[e],
        relative_speeds(plant, rows[1])[e],
        relative_speeds(plant, rows[2])[e],
    )
    a0, a1, a2, a3, a4 = v, v_new - v + r0, r1 - r0, r2 - r1, -r2
    if follows_drive(plant):  # the slope of the drive between its values, of the same order
        share = drive_rates(plant)[e]
        d0, d1 = u[0][1], h * u[0][2]
        end, turn, middle = u[5][1] - d0 - d1, h * u[5][2] - d1, u[6][1] - d0 - 0.5 * d1
        d2 = 16.0 * middle - 5.0 * end + turn
        d3 = 4.0 * end - turn - 2.0 * d2
        a0, a1, a2 = a0 + share * d0, a1 + share * d1, a2 + share * d2
        a3, a4 = a3 + share * d3, a4 + share * (end - d2 - d3)
    return a0, a1, a2, a3, a4


@fused
def speed_at(theta, a):
    """The sliding speed at a fraction of the step."""
    return a[0] + theta * (a[1] + theta * (a[2] + theta * (a[3] + theta * a[4])))


@fused
def _rise(theta, a):
    """Its slope."""
    return a[1] + theta * (2.0 * a[2] + theta * (3.0 * a[3] + theta * 4.0 * a[4]))


@fused
def reached(speed, low, high, side, a):
    """Fraction of the step, between `low` and `high`, at which the sliding speed has fallen to `speed`:
    Newton's method, kept between the bounds."""
    a = (a[0] * side - speed, a[1] * side, a[2] * side, a[3] * side, a[4] * side)
    theta = 0.5 * (low + high)
    for _ in range(30):
        f, turn = speed_at(theta, a), _rise(theta, a)
        if f > 0.0:
            low = theta
        else:
            high = theta
        correction = f / turn if turn != 0.0 else 2.0
        theta -= correction
        if not low <= theta <= high:
            theta = 0.5 * (low + high)
        elif abs(correction) < ENOUGH:
            break
    return theta


@fused
def _extreme(low, high, a):
    """Where the slope of the sliding speed, of opposite signs at these fractions of the step, is zero."""
    begun = _rise(low, a)
    for _ in range(HALVINGS):
        theta = 0.5 * (low + high)
        if _rise(theta, a) * begun > 0.0:
            low = theta
        else:
            high = theta
    return 0.5 * (low + high)


@fused
def least(side, a):
    """Fraction of the step at which the sliding speed, after it has fallen, rises again; 1 if it does not."""
    low, high = (0.0, 0.5) if _rise(0.5, a) * side > 0.0 else (0.5, 1.0)
    falls_and_rises = _rise(low, a) * side < 0.0 and _rise(high, a) * side > 0.0
    return _extreme(low, high, a) if falls_and_rises else 1.0


@fused
def most(side, a):
    """As `least`, of a speed that rises and falls again in the first half of the step; 0 if it does not."""
    rises_and_falls = _rise(0.0, a) * side > 0.0 and _rise(0.5, a) * side < 0.0
    return _extreme(0.0, 0.5, a) if rises_and_falls else 0.0
