"""How contacts begin: their sides at an instant, and the first moment of a slip."""

from __future__ import annotations

import math

from .._jit import compiled, fused, overload
from ..friction.static import RESOLVED
from ..plant.generated import (
    breakaways,
    brought,
    contacts,
    no_sides,
    plus,
    replaced,
    slope,
    speeds,
    statics,
    unrest,
)
from ..plant.system import layout_of
from . import channels

# Slower is rounding in the slopes of the drive, and no sliding, m/s.
STILL = 1e-12
# A law whose force falls this many times as steeply up to RESOLVED as up to STEEP [m/s] has no slope at rest.
STEEP, STEEPER = 1e-11, 2.0
# The first moment of a slip, over the time in which a position changes by a local error; and at most, over
# that in which the plant moves.
MOMENT, LONGEST = 0.1, 1e-2
# Its speed is found to this part, in so many iterations at most.
FOUND, ITERATIONS = 1e-5, 200


@fused
def started(plant, q, u, n, share):
    """Sides of the contacts at an instant: each slides as its speed says, or begins to as its acceleration
    says; a set-valued one at rest is held if it can be by this `share` of its breakaway. Returns the sides,
    and a measure of how fast things change [m/s²] with the largest speed [m/s]."""
    v, set_valued, limit = speeds(plant, q, u), statics(plant), breakaways(plant, q, n)
    sides, fastest = no_sides(plant), 0.0
    for e in range(len(v)):
        fastest = max(fastest, abs(v[e]) if contacts(plant)[e] != 0.0 else 0.0)
        if abs(v[e]) > STILL:
            sides = replaced(sides, e, math.copysign(1.0, v[e]))
        elif set_valued[e] == 0.0:
            sides = replaced(sides, e, 1.0)
    dq, forces = slope(plant, sides, q, u, n)
    for _ in range(len(v)):  # one after the other, those lets go that is asked for most
        most, loose = 0.0, -1
        for e in range(len(v)):
            if set_valued[e] != 0.0 and sides[e] == 0.0 and abs(forces[e]) - share * limit[e] > most:
                most, loose = abs(forces[e]) - share * limit[e], e
        if loose < 0:
            break
        sides = replaced(sides, loose, math.copysign(1.0, forces[loose]))
        dq, forces = slope(plant, sides, q, u, n)
    dv = speeds(plant, dq, (u[1], u[2], u[3]))
    for e in range(len(v)):
        if set_valued[e] == 0.0 and not abs(v[e]) > STILL:
            sides = replaced(sides, e, -1.0 if dv[e] < 0.0 else 1.0)
    return sides, unrest(plant, dq, u), fastest


@fused
def letting_go(plant, sides, q, u):
    """The first set-valued contact that slides though it has no speed yet; -1 if none does."""
    v = speeds(plant, q, u)
    for e in range(len(v)):
        if statics(plant)[e] != 0.0 and sides[e] != 0.0 and not abs(v[e]) > STILL:
            return e
    return -1


@compiled
def _pull(plant, sides, e, q, u, n):
    """The slopes, and how contact e accelerates in its direction, m/s²."""
    dq = slope(plant, sides, q, u, n)[0]
    return dq, sides[e] * speeds(plant, dq, (u[1], u[2], u[3]))[e]


@compiled
def _falls_from_rest(plant, sides, e, q, u, n):
    """Whether the force of contact e falls ever more steeply towards rest, and at once."""
    rest = _pull(plant, sides, e, brought(plant, q, u, e, 0.0), u, n)[1]
    gains = (0.0, 0.0)
    for k, v in enumerate((RESOLVED, STEEP)):
        pull = _pull(plant, sides, e, brought(plant, q, u, e, sides[e] * v), u, n)[1]
        gains = replaced(gains, k, (pull - rest) / v)
    return gains[0] > max(STEEPER * gains[1], plant.rate)


def launched(plant, drive, i, load, j, t, sides, e, q, moment, longest):
    r"""The state a moment after contact e lets go, and how long that is, s, at most `longest`; 0 where a step
    can begin at rest.

    It cannot where the slope of the law is infinite there: the contact could as well stay at rest, and the
    linear system of a step has the wrong sign unless that is shorter than what it makes grow. With the pull a
    on the contact, which falls free within the moment t_1, the speed is a power of time,

    .. math:: v = v_1 (t/t_1)^p, \quad v_1 = a(t_1, v_1)\,t_1/p, \quad p = 1 + \log_2 (a(t_1)/a(t_1/2))

    which is exact for each cause alone, friction that falls as a power of the speed and a drive that pulls
    ever more. `moment` is lengthened until that speed is told from rest.
    """
    u, n = channels.at(drive, i, t), channels.at(load, j, t)
    if not _falls_from_rest(plant, sides, e, q, u, n):
        return q, 0.0
    dq = slope(plant, sides, q, u, n)[0]
    moment, v, p = min(moment, longest), 0.0, 2.0
    end = q
    for _ in range(ITERATIONS):
        half, whole = t + 0.5 * moment, t + moment
        u, n = channels.at(drive, i, half), channels.at(load, j, half)
        middle = brought(plant, plus(q, 0.5 * moment, dq), u, e, sides[e] * v * 0.5**p)
        slopes, begins = _pull(plant, sides, e, middle, u, n)
        u, n = channels.at(drive, i, whole), channels.at(load, j, whole)
        end = brought(plant, plus(q, moment, slopes), u, e, sides[e] * v)
        pull = _pull(plant, sides, e, end, u, n)[1]
        if not (begins > 0.0 and pull > 0.0):
            return q, 0.0
        p = max(1.0 + math.log(pull / begins) / math.log(2.0), 0.5)
        before, v = v, moment * pull / p
        if abs(v - before) <= FOUND * v:
            if v >= RESOLVED or 4.0 * moment > longest:
                break
            moment, v = 4.0 * moment, v * 4.0**p
    return end, moment


@overload(launched)
def _chosen(plant, drive, i, load, j, t, sides, e, q, moment, longest):
    """Compiled only into plants with a set-valued contact."""
    if any(shape.static for shape in layout_of(plant).elements):
        return launched
    return lambda plant, drive, i, load, j, t, sides, e, q, moment, longest: (q, 0.0)
