r"""Searches at the stiffnesses beside that of a fit at which the contact rings on alike.

From one jump of the drive to the next, T later, the contact rings for n cycles, and decays:

.. math:: n = \frac{T}{2 \pi} \sqrt{k / m}, \qquad
    \exp(-2 \pi \zeta_c n), \quad \zeta_c = \frac{\sigma_1 + \sigma_2}{2 \sqrt{k m}}

(k the contact's stiffness, m the end-effector's mass). Where it still rings, a model with one cycle more
or less meets the jump in the same phase: the sum of squares has a local minimum every 2 / n of the stiffness,
as a periodogram has lines, and searches from afar end in any of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...estimate.result import Fit
from ...estimate.several import lowest
from ...physics.actuator import Actuator
from ...quantities.units import turned
from ...waveform.drive import evaluate
from ..free import value_of
from ..recorded.channels import edges
from .displacement import Displacement
from .several import likely, straightened
from .walks import Walks

# A decay by this power of e leaves no phase for the next jump to meet; with fewer cycles, minima are so far
# apart that the searches from several points find them all.
GONE, FEWEST = 3.0, 4.0
# Searches stand half a minimum apart, up to so many on each side and to this logarithm of the stiffness, and
# take few evaluations; anew where one led lower, at most so often.
RUNGS, REACH, LOOK, CLIMBS = 12, 0.5, 5, 4
# Number of results, from the lowest, that are searched to their ends.
FOLLOWED = 2
STIFFNESS = ("N/m", turned("N/m"))


def cycles(model: Actuator, stiffness: float, motions: Sequence[Displacement]) -> float:
    """Return the number of vibrations of the contact between jumps of the drive; 0 if they decay before."""
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
    """The fit, or the one with the lowest sum of squares whose contact rings some cycles more or less; those
    that the noise does not reject are among its minima.

    Args:
        fit: of the walks.
        walks: the recordings.
        max_evaluations: of a search to its end.
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
    """Short searches at other stiffnesses, from half a minimum away to `REACH`."""
    begun = straightened(fit.parameters, fit.values)
    rungs = range(1, min(RUNGS, math.ceil(REACH * n)) + 1)
    found = []
    for factor in (math.exp(sign * k / n) for k in rungs for sign in (1, -1)):
        there = [p.starting_at(p.start * factor) if p.name in stiffnesses else p for p in begun]
        found.append(walks.searched(there, max_evaluations=LOOK))
    return found


def _far(one: Fit, other: Fit, stiffnesses: Sequence[str], least: float) -> bool:
    """Return whether two stiffnesses differ by more than this [logarithm]."""
    sums = [sum(fit.values[name] for name in stiffnesses) for fit in (one, other)]
    return abs(math.log(sums[0] / sums[1])) > least
