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

# Simulations for initial guesses: their error tolerance relative to the stroke (GUESS_TOLERANCE), and their
# largest number of integration steps besides those for the drive's segments (GUESS_STEPS).
GUESS_TOLERANCE, GUESS_STEPS = 1e-3, 5_000
# Number of parts into which the range of forces, and that of deflections, is divided if the fit does not
# explain its recordings; a search starts in each pair of parts.
PARTS = 3


def longest(walks: Walks) -> Displacement:
    """Return the simulation of the walk with the largest measured peak-to-peak motion."""
    return walks.motions[int(np.argmax([np.ptp(position) for position in walks.measured]))]


def initial_guesses(
    walks: Walks, parameters: list[Parameter], bounds: Bounds, samples: int, parts: int = 1
) -> tuple[list[Parameter], list[Values]]:
    """Return parameters with wide bounds, and initial guesses (values by name, SI, the best first) by
    `first_guess`, from the first `samples` samples of the walk with the largest motion.

    Args:
        walks: the recordings.
        parameters: parameters with the user's initial guess.
        bounds: the user's bounds by name, which stay.
        samples: number of samples.
        parts: number of parts into which the ranges of forces and deflections are divided.
    """
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
    """Return parameters with wide bounds, and initial guesses, as `initial_guesses` does, from the simulation
    `short` of one recording's first samples and its `measured` positions, m (rad). `name` is the recording's,
    and `stroke` the stage's [m]."""
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
    """Return the best fit of searches from the values in `parameters` and from guesses by all samples of the
    walk with the largest motion, without hops. `bounds` are the user's bounds by name."""
    wide, found = initial_guesses(walks, parameters, bounds, longest(walks).time.size, PARTS)
    points = [{p.name: p.start for p in parameters}, *found]
    return from_points(walks, wide, points, bounds, max_evaluations)
