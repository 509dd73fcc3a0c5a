r"""Searches for local minima at stiffnesses at which the contact vibrates some cycles more or less.

Between jumps of the drive, at an interval T, the contact vibrates for n cycles, and its amplitude decays by
the factor on the right:

.. math:: n = \frac{T}{2 \pi} \sqrt{k / m}, \qquad
    \exp(-2 \pi \zeta_c n), \quad \zeta_c = \frac{\sigma_1 + \sigma_2}{2 \sqrt{k m}}

(k the contact's stiffness, m the end-effector's mass). If the vibration lasts to the next jump, a model with
one cycle more or less reaches this jump with the same phase. So the sum of squares has local minima at
relative distances of 2 / n in the stiffness, like the lines of a periodogram, and searches from distant
initial guesses end in any of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...estimate.result import Fit
from ...estimate.several import lowest
from ...physics.actuator import Actuator
from ...quantities.units import ANGLE
from ...waveform.drive import evaluate
from ..free import value_of
from ..recorded.channels import edges
from .displacement import Displacement
from .several import likely, straightened
from .walks import Walks

# GONE: exponent of the decay between jumps above which no vibration remains at the next jump. FEWEST: number
# of cycles between jumps below which minima are so far apart that other searches find them all.
GONE, FEWEST = 3.0, 4.0
# Search points lie half the distance of two minima apart. RUNGS: their largest number on each side of the
# estimate. REACH: their largest distance from the estimate in the natural logarithm of the stiffness. LOOK:
# evaluations of the short search from each point. CLIMBS: largest number of rounds, each from a lower
# minimum.
RUNGS, REACH, LOOK, CLIMBS = 12, 0.5, 5, 4
# Number of short searches, from the lowest sum of squares, that are completed.
FOLLOWED = 2
STIFFNESS = ("N/m", ANGLE.unit("N/m"))


def cycles(model: Actuator, stiffness: float, motions: Sequence[Displacement]) -> float:
    """Return the number of vibration cycles of the contact, not necessarily whole, in the median interval
    between jumps of the drive; 0 if the vibration decays before the next jump, or without two jumps.

    Args:
        model: the actuator, for its mass and damping.
        stiffness: stiffness of the contact, N/m (N m/rad).
        motions: simulations of the walks, for their drives.
    """
    gaps = []
    for motion in motions:
        jumps = np.flatnonzero(np.diff(edges(evaluate(motion.drive, motion.time)[0]).astype(int)) == 1)
        gaps.extend(np.diff(motion.time[jumps]))
    if not gaps:
        return 0.0
    gap, law = float(np.median(gaps)), model.friction
    damping = sum(getattr(law, name, 0.0) for name in ("sigma_1", "sigma_2"))
    rings_down = 0.5 * damping / model.end_effector_mass * gap > GONE
    return 0.0 if rings_down else gap * math.sqrt(stiffness / model.end_effector_mass) / (2.0 * math.pi)


def with_other_phases(fit: Fit, walks: Walks, max_evaluations: int) -> Fit:
    """Return the fit, or a better one whose contact vibrates some cycles more or less between jumps; other
    minima that the noise does not reject are in its `minima`. The fit is unchanged if the vibration does not
    last to the next jump, or for fewer than `FEWEST` cycles.

    Args:
        fit: fit of the walks.
        walks: the recordings.
        max_evaluations: largest number of evaluations of a completed search.
    """
    for _ in range(CLIMBS):
        free = [p.name for p in fit.parameters if p.unit in STIFFNESS]
        model = walks.varied(fit.values)
        n = cycles(model, sum(value_of(model, name)[0] for name in free), walks.motions) if free else 0.0
        if n < FEWEST:
            break
        looks = _looks(fit, walks, free, n)
        apart = [one for one in looks if _far(one, fit, free, 0.5 / n) and likely(one, fit)]
        near = sorted(apart, key=lambda one: one.cost)[:FOLLOWED]
        ends = [
            walks.fit(straightened(fit.parameters, one.values), max_evaluations=max_evaluations)
            for one in near
        ]
        found = lowest([fit, *ends])
        moved = _far(found, fit, free, 0.5 / n)
        fit = found
        if not moved:
            break
    return fit


def _looks(fit: Fit, walks: Walks, stiffnesses: Sequence[str], n: float) -> list[Fit]:
    """Return fits of short searches that start at smaller and larger stiffnesses, up to the distance `REACH`.

    Args:
        fit: fit at whose values the searches start, except for the stiffnesses.
        walks: the recordings.
        stiffnesses: names of the stiffnesses, which are changed by the same factor.
        n: number of vibration cycles between jumps.
    """
    begun = straightened(fit.parameters, fit.values)
    rungs = range(1, min(RUNGS, math.ceil(REACH * n)) + 1)
    found = []
    for factor in (math.exp(sign * k / n) for k in rungs for sign in (1, -1)):
        there = [p.starting_at(p.start * factor) if p.name in stiffnesses else p for p in begun]
        found.append(walks.searched(there, max_evaluations=LOOK))
    return found


def _far(one: Fit, other: Fit, stiffnesses: Sequence[str], least: float) -> bool:
    """Return True if the natural logarithms of the summed stiffnesses (parameters with the given names) of
    the fits `one` and `other` differ by more than `least`."""
    sums = [sum(fit.values[name] for name in stiffnesses) for fit in (one, other)]
    return abs(math.log(sums[0] / sums[1])) > least
