r"""Backlash, backward rate, ringing and ripple of the end-effector within a period of its steady walk.

Let x be the position of the end-effector along the walk (in the direction of its net step) and C u the static
stroke of the voltage:

.. math:: b = \max_{t_1 \le t_2} \left(x(t_1) - x(t_2)\right), \qquad
          r = \max_{t_2 \le t_3 \le t_4 \le t_5} \left(d(t_3) - d(t_4)\right), \quad d = x - C u

*Backlash* b is the largest backward motion of the end-effector within a period, from t_1 to t_2: by friction
during the slip, and by the elastic recovery of the contact. *Ringing* r is the largest backward motion
relative to the static stroke after that: from the time when u no longer moves back until it does again or the
next backlash starts (t_5 at most t_1 + T). It is the first overshoot of a stage that vibrates, and zero for
one that settles without overshoot. It includes backward motion by a load during stick and, for a smooth
drive, the lag of the stage. If the fast stroke of the drive is along the walk (an actuator that walks
backward by resonance), no slip precedes it: NaN. Both quantities are meaningful for drives that slip once in
a period. They are not goals of a search, which would find drives that vibrate all the time.

The *backward rate* is the backlash over the way forward, :math:`b / (s + b)` with the net step s: 0 for a
walk that never moves back, 1 for a motion without a net step.

*Ripple* is the deviation from uniform motion, peak to peak of :math:`x - t s / T` with the net step s, for
any drive.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engine.binding import DriveTable
from ..engine.members import ComposedMembers, MemberDrives, integrate_members
from ..engine.orbits import Orbits
from ..engine.outcome import DONE
from ..physics.actuator import Actuator
from ..quantities.units import QuantityError, array_si
from ..simulation.members import Columns, Members
from ..waveform.drive import evaluate
from ..waveform.members import member_of

Array = NDArray[np.float64]

# PER_CYCLE: number of samples per period of the fastest vibration, just after the drive has changed its
# slope. GROWTH: spacing of later samples as a fraction of the time since that change.
PER_CYCLE, GROWTH = 32.0, 0.02
# Largest backward change of the static stroke C u (gain times voltage) between two samples, relative to its
# range within the period, that counts as a rounding error and not as a backward motion of the drive.
STILL = 1e-9
# Smallest ratio of the drive's fastest backward to its fastest forward speed at which ringing is computed.
# With a smaller one the fast stroke is along the walk, and no slip precedes a ringing. It is below 1 so that
# rounding does not exclude drives with equal strokes.
EVEN = 0.99
MAX_STEPS = 10_000_000


def within_a_period(
    model: Actuator,
    of: Members,
    columns: Columns,
    found: Orbits,
    fine: NDArray[np.bool_],
    tolerance: float,
    names: Collection[str],
) -> dict[str, Array]:
    """Return quantities of the motion within a period for members (points of a map), by name, arrays
    [members].

    Backlash, ringing and ripple are in m, or rad for a rotary actuator; the backward rate has no unit. They
    are NaN for members without a periodic orbit; see the module for the definitions.

    Args:
        model: the actuator.
        of: the members, with states on their periodic orbits.
        columns: varied fields of model and drive by name, SI, arrays [members].
        found: periodic orbits with the net steps.
        fine: mask [members] of those with a periodic orbit.
        tolerance: tolerance of the simulation, m, or rad for a rotary actuator.
        names: quantities to compute: "backlash", "backward_rate", "ringing", "ripple".
    """
    backlash, backward, ringing, ripple = np.full((4, fine.size), np.nan)
    gains = columns.get("gain", np.full(fine.size, model.gain))
    drives, which = of.drives, of.which
    # Groups of members whose drives have the same period and change slope at the same times. The members of a
    # group have the same sample times, so they are simulated in one call.
    of_same: dict[bytes, list[int]] = {}
    for m in np.flatnonzero(fine).tolist():
        key = drives.start[which[m]].tobytes() + of.ends[m].tobytes()
        of_same.setdefault(key, []).append(m)
    for members in of_same.values():
        rows = np.array(members)
        period, start = float(of.ends[rows[0]]), drives.start[which[rows[0]]]
        times = sample_times(start[np.isfinite(start)], period, float(of.of.plant.rate))
        positions = _followed(of, rows, period, times, tolerance)
        ripple[rows] = np.ptp(positions - times * found.steps[rows, None] / period, axis=1)
        if {"backlash", "backward_rate", "ringing"} & {*names}:
            volts = np.stack([evaluate(member_of(drives, which[m]), times)[0] for m in members])
            way = np.where(found.steps[rows] < 0.0, -1.0, 1.0)[:, None]
            moved = way * positions, way * gains[rows, None] * volts, np.abs(found.steps[rows])
            backlash[rows], ringing[rows] = measured(times, period, *moved)
            backward[rows] = _of_way_forward(backlash[rows], moved[2])
    every = {"backlash": backlash, "backward_rate": backward, "ringing": ringing, "ripple": ripple}
    return {name: every[name] for name in names}


def backward_rate(position: ArrayLike) -> float:
    """Return the backward rate of a steady walk, from 0 to 1; NaN without any motion.

    The backward rate is the largest backward motion b within a period over the forward motion s + b, with the
    net step s.

    Args:
        position: samples of the end-effector's position over one period, both ends included, in m or with
            units.

    Raises:
        QuantityError: there are fewer than two samples, or they have another unit.
    """
    x = array_si(position, "m", "position").ravel()
    if x.size < 2:
        raise QuantityError("position: a period has at least two positions, at both of its ends")
    step = x[-1] - x[0]
    twice = np.append(x, x[1:] + step) * (-1.0 if step < 0.0 else 1.0)
    back = np.max(np.maximum.accumulate(twice) - twice)
    return float(_of_way_forward(back, abs(step)))


def _of_way_forward(back: Any, step: Any) -> Any:
    """Return the backward rate b / (s + b) of a backward motion b (`back`) and a net step s (`step`), both >=
    0 and in the same unit; NaN if both are 0."""
    with np.errstate(invalid="ignore"):
        return np.divide(back, back + step)


def sample_times(breaks: Array, period: float, rate: float) -> Array:
    """Return ascending sample times [s] within one period, from 0; they are denser after each change of
    slope.

    Args:
        breaks: times at which the drive changes its slope, s, ascending from 0.
        period: period of the drive, s.
        rate: fastest angular frequency to resolve, rad/s. `PER_CYCLE` samples resolve its period after a
            break; later the spacing grows in proportion to the time since the break.
    """
    finest = min(2.0 * np.pi / rate / PER_CYCLE, period / 64.0)
    first = np.arange(0.0, finest / GROWTH, finest)
    most = max(period / first[-1], 1.0)
    later = first[-1] * (1.0 + GROWTH) ** np.arange(1.0, np.log(most) / np.log1p(GROWTH) + 1.0)
    since = np.append(first, later)
    ends = np.append(breaks[1:], period)
    parts = [b + since[since < e - b] for b, e in zip(breaks, ends, strict=True)]
    # Add a sample just before each break. The distance is the same for all breaks, because `measured`
    # compares the speeds of jumps, computed as their height over this distance.
    before = ends[ends < period] - 1e-12 * period
    found = np.unique(np.concatenate([*parts, before, [period * (1.0 - 1e-12)]]))
    return found[found < period]


def _followed(of: Members, rows: NDArray[np.int64], period: float, times: Array, tolerance: float) -> Array:
    """Simulate one period of some members; return the end-effector's positions, [members, times], m, or rad
    for a rotary actuator.

    Args:
        of: all members, with states on their periodic orbits.
        rows: indices of the members to simulate.
        period: period of their drives, s.
        times: sample times within the period, s.
        tolerance: tolerance of the simulation, in the unit of the position.
    """
    outcomes, spans = np.full(rows.size, DONE, np.int64), np.tile([0.0, period], (rows.size, 1))
    return integrate_members(
        ComposedMembers(of.of.plant, of.values[rows]),
        MemberDrives(of.drives, of.which[rows]),
        DriveTable(of.load),
        outcomes,
        of.states[rows],
        spans,
        tolerance,
        False,
        MAX_STEPS,
        times,
        of.of.slider,
    ).samples


def measured(times: Array, period: float, position: Array, stroke: Array, step: Array) -> tuple[Array, Array]:
    """Return backlash and ringing of members (see the module), [members] each, in the unit of the positions.

    Ringing is NaN if the fast stroke of the drive is along the walk.

    Args:
        times: sample times of one period, s; the first one is 0.
        period: period of the drives, s.
        position: position x of the end-effector, positive in the direction of the walk, m or rad, [members,
            times].
        stroke: static stroke C u of the voltage in the same direction and unit, [members, times].
        step: net step per period, >= 0, in the same unit, [members].
    """
    n, rows = position.shape[1], np.arange(step.size)
    # The walk is continued over three periods: a backlash that starts in the first period, and the ringing
    # after it, end within the third.
    x = np.tile(position, (1, 3)) + np.repeat(np.arange(3.0), n) * step[:, None]
    fallen = np.maximum.accumulate(x[:, : 2 * n], axis=1) - x[:, : 2 * n]
    trough = np.argmax(fallen, axis=1)
    u, place = np.tile(stroke, (1, 3)), np.arange(3 * n)
    turned = np.argmax(np.where(place <= trough[:, None], x, -np.inf), axis=1)
    back = np.diff(u, append=u[:, -1:]) < -STILL * np.ptp(stroke, axis=1)[:, None]
    begin = _first(~back, trough)
    end = np.minimum(_first(back, begin), turned + n)
    inside = (place >= begin[:, None]) & (place <= end[:, None])
    d = np.where(inside, x - u, -np.inf)
    swing = np.where(inside, np.maximum.accumulate(d, axis=1) - (x - u), 0.0)
    speed = np.diff(u[:, : n + 1], axis=1) / np.diff(times, append=period)
    slips = -speed.min(axis=1) >= EVEN * speed.max(axis=1)
    return fallen[rows, trough], np.where(slips, np.max(swing, axis=1, initial=0.0), np.nan)


def _first(true: NDArray[np.bool_], begin: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return for each row of the mask `true` [rows, columns] the index of its first True from column `begin`
    [rows] on; the index of the last column if there is no True."""
    place = np.arange(true.shape[1])
    later = true & (place >= begin[:, None])
    return np.where(later.any(axis=1), np.argmax(later, axis=1), true.shape[1] - 1)
