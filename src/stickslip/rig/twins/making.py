"""Make a twin (simulated device) from its name and an actuator."""

from __future__ import annotations

from typing import Any

from ...physics.actuator import Actuator
from ...quantities import registry
from ...quantities.units import QuantityError, to_si
from ..irregularity import REGULAR, Irregularity
from ..variation import Variation
from .axis import Clock
from .stage import MEASURED, Stage

MOST_AXES = 4


def make_twin(
    name: str,
    actuator: Actuator,
    *,
    axes: int = 1,
    travel: float | str = 4e-3,
    variation: Variation = MEASURED,
    irregularity: Irregularity = REGULAR,
    seed: int = 0,
    clock: Clock | None = None,
) -> Any:
    """Return a twin (simulated device), which a `TwinServer` can serve.

    The twin "scpi" is a tuple of two, generator and oscilloscope; each needs a server of its own.

    Args:
        name: a name in `registry.twins`, such as "anc300".
        actuator: actuator of each axis; each axis has its own random sequence.
        axes: number of axes, up to 4; some twins use only the first.
        travel: distance from end stop to end stop, m.
        variation: random variation of the contact from piece to piece of the motion.
        irregularity: irregularity of steps and end stops, and the temperature; none by default.
        seed: seed of variation, irregularity, noise and initial positions.
        clock: clock of the motions; by default the computer's.

    Raises:
        QuantityError: the name, the number of axes, the travel or the actuator (see `Stage`) is not possible.
    """
    travel = to_si(travel, "m", "travel")
    make = registry.twins.find(name)
    if not 1 <= axes <= MOST_AXES:
        raise QuantityError(f"axes = {axes} must be 1 to {MOST_AXES}")
    of: dict[str, Any] = {"travel": travel, "variation": variation, "irregularity": irregularity}
    stages = [Stage(actuator, **of, seed=seed + 1000 * i) for i in range(axes)]
    return make(stages, seed, clock)
