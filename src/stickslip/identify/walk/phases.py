r"""Searches at neighbouring stiffnesses at which the contact vibrates with nearly the same phase.

Between jumps of the drive, T apart, the contact vibrates for n cycles and decays:

.. math:: n = \frac{T}{2 \pi} \sqrt{k / m}, \qquad
    \exp(-2 \pi \zeta_c n), \quad \zeta_c = \frac{\sigma_1 + \sigma_2}{2 \sqrt{k m}}

(k the contact's stiffness, m the end-effector's mass). While it still vibrates, a model with one cycle more
or less reaches the next jump with the same phase. So the sum of squares has a local minimum at every 2 / n of
the stiffness, like the lines of a periodogram, and distant searches end in any of them.
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

# Decay exponent above which no vibration remains at the next jump; and number of cycles below which minima
# are so far apart that the searches from several points find them all.
GONE, FEWEST = 3.0, 4.0
# Number of search points on each side, half a minimum apart; their largest distance in the logarithm of the
# stiffness; evaluations of each; and number of repetitions from a lower point.
RUNGS, REACH, LOOK, CLIMBS = 12, 0.5, 5, 4
# Number of results, from the lowest, whose search is completed.
FOLLOWED = 2
STIFFNESS = ("N/m", ANGLE.unit("N/m"))


def cycles(model: Actuator, stiffness: float, motions: Sequence[Displacement]) -> float:
    """Return the number of vibrations of the contact between jumps of the drive; 0 if they decay before the
    next jump."""
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
    """Return the fit, or a better one whose contact vibrates some cycles more or less; its minima include
    those that the noise does not reject.

    Args:
        fit: fit of the walks.
        walks: the recordings.
        max_evaluations: limit for a search to its end.
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
    """Return fits of short searches at other stiffnesses, from half a minimum away to `REACH`."""
    begun = straightened(fit.parameters, fit.values)
    rungs = range(1, min(RUNGS, math.ceil(REACH * n)) + 1)
    found = []
    for factor in (math.exp(sign * k / n) for k in rungs for sign in (1, -1)):
        there = [p.starting_at(p.start * factor) if p.name in stiffnesses else p for p in begun]
        found.append(walks.searched(there, max_evaluations=LOOK))
    return found


def _far(one: Fit, other: Fit, stiffnesses: Sequence[str], least: float) -> bool:
    """Return True if the stiffnesses of two fits differ by more than `least` in the logarithm."""
    sums = [sum(fit.values[name] for name in stiffnesses) for fit in (one, other)]
    return abs(math.log(sums[0] / sums[1])) > least
