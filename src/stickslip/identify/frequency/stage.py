"""Conversion of the modes of a frequency response to the stage of an actuator."""

from __future__ import annotations

import numpy as np

from ...physics.actuator import Actuator, StageModes
from ...quantities.units import QuantityError, unit_for
from .modal import ModalModel

# Largest rate gain or remainder, relative to the sum of the modes' static gains, that is ignored because a
# stage of real modes cannot have it.
LEFT_OUT = 0.02


def with_modes(actuator: Actuator, modes: ModalModel, output: int = 0, drive: int = 0) -> Actuator:
    """Return the actuator with the stage of a modal model that `identify_frequency` has fitted.

    The mode with the largest static gain becomes the main mode, the others `further_modes`. A response to the
    voltage does not show how the contact force acts on each mode. So the main mode keeps the actuator's
    `stage_mass`, and friction does not act on the others until their `mass` is set.

    Args:
        actuator: actuator whose stage is replaced.
        modes: modal model with real modes and no remainder, as the `model` of
            ``identify_frequency(..., complex_modes=False, remainder=False)``. Its delay belongs to the
            channel and is left out.
        output: index, from 0, of the output that is the position under the contact.
        drive: index, from 0, of the input that is the drive voltage.

    Raises:
        QuantityError: the modal model is not in m/V (rad/V for a rotary actuator), or the rate gains or the
            remainder exceed 2 % of the sum of the modes' gains.
    """
    unit = unit_for(actuator, "m/V")
    if modes.unit != unit:
        raise QuantityError(
            f"the modal model is in {modes.unit}, but the actuator's gain in {unit}: fit a response in {unit}"
        )
    gain = np.asarray(modes.gain)[:, output, drive]
    stroke = abs(float(gain.sum()))
    for name, part in (
        ("rate_gain", modes.rate_gain[:, output, drive]),
        ("remainder", modes.remainder[output, drive]),
    ):
        share = float(np.max(np.abs(part))) / stroke if stroke else np.inf
        if share > LEFT_OUT:
            raise QuantityError(
                f"the modal model has a {name} of {100 * share:.3g} % of its stroke, which no stage of real "
                "modes has: fit it by identify_frequency(..., complex_modes=False, remainder=False)"
            )
    order = np.argsort(-np.abs(gain))
    omega, zeta = np.asarray(modes.natural_frequency)[order], np.asarray(modes.damping_ratio)[order]
    first, *further = gain[order].tolist()
    rest = (
        StageModes(tuple(further), tuple(omega[1:].tolist()), tuple(zeta[1:].tolist())) if further else None
    )
    return actuator.replace(
        gain=first, natural_frequency=float(omega[0]), damping_ratio=float(zeta[0]), further_modes=rest
    )
