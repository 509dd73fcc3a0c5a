"""Prediction of the force channel of a moved contact, from a law, its values and the recorded motion.

The recorded force serves only for the initial force, and its range for the accuracy of the simulation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine.motion import forces_at
from ...estimate.parameter import Values
from ...friction import element, elements, rate
from ...recording.noise import noise_level
from ...simulation import SimulationError
from ...simulation.prescribed import prescribed_once
from ...simulation.varied import with_values
from ..recorded.channels import channel, names_of
from .sampled import between

if TYPE_CHECKING:
    import xarray as xr

OBSERVED = "friction_force"
# Parameters of the force channel and of the contact besides those of the law, with their units for a linear
# motion; see the equation in `fit`.
CHANNEL = {
    "bias": "N",
    "contact_offset": "N",
    "asymmetry": "",
    "curvature": "1/N",
    "drift": "1/s",
    "load_exponent": "",
}
# Smallest initial normal force with friction, relative to the reference. Below it the elements of the contact
# start without deflection.
UNLOADED = 0.02
# Largest deviation of a position at rest from the first sample, in standard deviations of the noise.
SAME = 4.0
# Largest error tolerance of the deflections, relative to the stroke. A larger one distorts the force of short
# strokes by more than the noise.
FINEST = 1e-6
# Largest error of the law's force in a step, relative to the range of the recorded force. A stiff contact
# slips after less than the tolerance; without this limit its force would be simulation error, with minima
# anywhere.
FORCE_ERROR = 1e-6


class LoopPrediction(NamedTuple):
    """Prediction of the force channel by a friction law with fitted values.

    Fields: `law`, whose parameters `values` (by name, SI; also those of `CHANNEL`) replaces; and the settings
    `reference_normal_force` [N] (None: constant), `origin`, the time at which the drift is zero [s], and
    `tolerance` [m] of the deflections, as for `response_of`.
    """

    law: Any
    values: Values
    reference_normal_force: float | None
    origin: float
    tolerance: float

    def predict(self, recording: xr.Dataset) -> NDArray[np.float64]:
        """Return the predicted force, N (N m), shape (n,), simulated from the recording's first sample, where
        the contact carries the recorded force.

        Raises:
            RecordingError: a channel is missing or unsuitable.
            ArithmeticError: the contact cannot be simulated.
        """
        return response_of(recording, names_of([recording])[0], *self[2:])(self.law, self.values)


def own_of(values: Values) -> Values:
    return {name: value for name, value in values.items() if name not in CHANNEL}


def response_of(
    recording: xr.Dataset, name: str, reference: float | None, origin: float, tolerance: float
) -> Callable[[Any, Values], NDArray[np.float64]]:
    """Return a function that takes a friction law and values by name (of the law and of `CHANNEL`, SI), and
    returns the predicted force of the channel, N (N m), shape (n,).

    The function raises ArithmeticError for values at which the contact cannot be simulated.

    Args:
        recording: with position [m] (rad) and friction_force [N] (N m). The prediction starts at the force
            before the motion; the range of the force limits the error of the simulation.
        name: name of the recording in messages.
        reference: normal force [N] for which the law holds; None if the normal force is constant.
        origin: time at which the drift is zero, s.
        tolerance: largest error of the deflections, m.

    Raises:
        RecordingError: a channel is missing or unsuitable.
    """
    time = recording["time"].values
    position = channel(recording, "position", name, varies=True)
    velocity = np.gradient(position, time, edge_order=2)
    fine, path, at = between(time, position, velocity)
    tolerance = min(tolerance, FINEST * float(np.ptp(position)))
    force_shown = channel(recording, OBSERVED, name)
    first = float(np.median(force_shown[: at_rest(position)]))
    most = FORCE_ERROR * float(np.ptp(force_shown))
    load = np.ones(time.size)
    if reference is not None:
        # Noise can make a measured normal force negative, but a contact cannot be pulled.
        load = np.maximum(channel(recording, "normal_force", name) / reference, 0.0)

    def response(model: Any, values: Values) -> NDArray[np.float64]:
        strength = load ** values.get("load_exponent", 1.0) * (
            1.0 + values.get("drift", 0.0) * (time - origin)
        )
        bias, begin = values.get("bias", 0.0), 0.0
        if load[0] > UNLOADED and strength[0] > 0.0:
            begin = _odd_part((first - bias) / strength[0], values)
        law = with_values(model, own_of(values))
        try:
            found = prescribed_once(
                law,
                fine,
                path,
                _within(law, most, tolerance),
                initial_force=begin,
                initial_velocity=float(velocity[0]) if begin else 0.0,
            )
        except SimulationError as error:
            # A search shortens its step after an ArithmeticError.
            raise ArithmeticError(str(error)) from error
        force = found.force[at]
        states = found.states[at] if elements(law) else np.sign(force)[:, None]
        forces_at(law, velocity, np.ascontiguousarray(states), force)
        uneven = values.get("asymmetry", 0.0) * np.abs(force) + values.get("curvature", 0.0) * force**2
        return bias + strength * (values.get("contact_offset", 0.0) + force + uneven)

    return response


def _within(law: Any, error: float, tolerance: float) -> float:
    """Return the tolerance of the deflections of a law's elements, m (rad): `tolerance`, or less if a
    deflection of `tolerance` changes the force of the stiffest element by more than `error` [N]."""
    stiffest = 0.0
    for one in (element(law, e) for e in range(elements(law))):
        stiffest = max(stiffest, (rate(one, 0.0, tolerance)[0] - rate(one, 0.0, 0.0)[0]) / tolerance)
    return min(tolerance, error / stiffest) if stiffest > 0.0 and error > 0.0 else tolerance


def at_rest(position: NDArray[np.float64]) -> int:
    """Return the number of samples before the motion starts: those from the first on whose position [n]
    equals the first one within the noise."""
    gone = np.abs(position - position[0]) > SAME * noise_level(position)
    return int(np.argmax(gone)) if np.any(gone) else position.size


def _odd_part(shown: float, values: Values) -> float:
    """Return the force F of the law, N, for the force `shown` = q + F + a|F| + h F^2 without bias, load and
    drift; q, a and h are contact_offset, asymmetry and curvature in `values`."""
    rest = shown - values.get("contact_offset", 0.0)
    side = 1.0 + math.copysign(values.get("asymmetry", 0.0), rest * values.get("asymmetry", 0.0))
    curvature = values.get("curvature", 0.0)
    return 2.0 * rest / (side + math.sqrt(max(0.0, side**2 + 4.0 * curvature * rest)))
