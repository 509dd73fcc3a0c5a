"""From the modes of a frequency response to the stage of an actuator."""

from __future__ import annotations

import numpy as np

from ...physics.actuator import Actuator, StageModes
from ...quantities.units import QuantityError
from .modal import ModalModel

# Largest share of the stroke at rest that a stage of real modes may leave out.
LEFT_OUT = 0.02


def with_modes(actuator: Actuator, modes: ModalModel, output: int = 0, drive: int = 0) -> Actuator:
    """The actuator with the stage of a modal model, as `identify_frequency` fits it.

    The mode with the largest stroke becomes the first, the others `further_modes`. What a force of the
    contact does to each is not in a response to the voltage: the first keeps the actuator's `stage_mass`, and
    the others feel no friction until their `mass` is set.

    Args:
        actuator: what is kept but for the stage.
        modes: with real modes and no remainder: ``identify_frequency(..., complex_modes=False,
            remainder=False)``. Its delay is that of the channel, and is left out.
        output: which of its outputs is the position under the contact.
        drive: which of its inputs is the drive voltage.

    Raises:
        QuantityError: the model has parts that a stage of real modes has not, of more than 2 % of its stroke.
    """
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
