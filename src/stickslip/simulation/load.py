"""The load that a user gives: the normal force over its reference, not a force."""

from __future__ import annotations

from numbers import Real

from ..units import QuantityError
from ..waveform.signal import Waveform


def load_range(load: Waveform | float) -> tuple[float, float]:
    """The least and the largest load.

    Raises:
        QuantityError: it is neither a number nor a waveform.
    """
    if isinstance(load, Real):
        return float(load), float(load)
    found = getattr(load, "range", None)
    if found is None:
        raise QuantityError(
            f"load = {load!r} is no load: it is the normal force over its reference, a number or a waveform. "
            "An external force is a field of the actuator, external_force"
        )
    return found()
