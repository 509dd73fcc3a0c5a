"""Initial guesses of the search for the friction of a walk, from the walk with the largest motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...estimate.parameter import Parameter, Values
from ...estimate.problem import Residuals
from ...estimate.result import Fit
from ..free import Bounds
from .displacement import Displacement, has_slopes
from .first_guess import first_guess
from .several import from_points
from .walks import Varied, Walks, observed, slopes_of

# Tolerance relative to the stroke, and largest number of integration steps, of simulations for initial
# guesses.
GUESS_TOLERANCE, GUESS_STEPS = 1e-3, 5_000
# Number of parts of the range of forces, and of deflections, in each of which a search starts if the fit does
# not explain its recordings.
PARTS = 3


def longest(walks: Walks) -> Displacement:
    """Return the walk with the largest motion."""
    return walks.motions[int(np.argmax([np.ptp(position) for position in walks.measured]))]


def guesses(
    walks: Walks, parameters: list[Parameter], bounds: Bounds, samples: int, parts: int = 1
) -> tuple[list[Parameter], list[Values]]:
    """Return starting values by `first_guess`, from the walks cut to `samples` of the longest recording."""
    most = walks.motions.index(longest(walks))
    stroke = max(motion.stroke(walks.model) for motion in walks.motions)
    short = walks.motions[most].beginning(samples, GUESS_TOLERANCE * stroke, GUESS_STEPS)
    measured, name = walks.measured[most], walks.names[most]
    return _guessed(short, measured, name, walks, parameters, stroke, bounds, parts)


def _guessed(
    short: Displacement,
    measured: NDArray[np.float64],
    name: str,
    walks: Walks,
    parameters: Sequence[Parameter],
    stroke: float,
    bounds: Bounds,
    parts: int,
) -> tuple[list[Parameter], list[Values]]:
    """Return starting values as `guesses` does, from one recording or its first samples."""
    varied, position = Varied(walks.model, walks.ties), measured[: short.time.size]
    residuals = Residuals(
        lambda v: observed(short, varied, v) - position, position, walks.noise, name, walks.unit
    )
    others = walks.beside(parameters)
    moved = [p.name for p in (*parameters, *others) if not p.fixed]
    jacobian = slopes_of([short], varied, moved) if has_slopes(walks.model) else None
    return first_guess(
        residuals, short.time, jacobian, parameters, walks.model, stroke, bounds, beside=others, parts=parts
    )


def from_guesses(walks: Walks, parameters: list[Parameter], bounds: Bounds, max_evaluations: int) -> Fit:
    """Return the fit of searches from the present values and from guesses by a complete walk, without further
    searches."""
    wide, found = guesses(walks, parameters, bounds, longest(walks).time.size, PARTS)
    begins = [{p.name: p.start for p in parameters}, *found]
    return from_points(walks, wide, begins, bounds, max_evaluations)
