"""Twins by name."""

from __future__ import annotations

from typing import Any

from ...physics.actuator import Actuator
from ...quantities.units import QuantityError, to_si
from ..irregularity import REGULAR, Irregularity
from ..variation import Variation
from .anc300 import Anc300
from .axis import Clock
from .kim101 import Kim101
from .mcs2 import Mcs2
from .nv200 import Nv200
from .stage import MEASURED, Stage

TWINS = ("nv200", "mcs2", "anc300", "kim101")
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
) -> Nv200 | Mcs2 | Anc300 | Kim101:
    """Return a twin, for a `TwinServer`.

    Args:
        name: one of `TWINS`.
        actuator: actuator of each axis; its contact varies with a seed of the axis's own.
        axes: number of axes, up to 4; the NV200 has one.
        travel: m, from end stop to end stop.
        variation: variation of the contact from piece to piece of the motion.
        irregularity: irregularity of steps and end stops, and the temperature; none by default.
        seed: seed of variation, irregularity, noise and initial positions.
        clock: the clock; by default the computer's.

    Raises:
        QuantityError: the name, the number of axes or the travel is not possible.
    """
    travel = to_si(travel, "m", "travel")
    if name not in TWINS:
        raise QuantityError(f"{name!r} is no twin; there are {', '.join(TWINS)}")
    if not 1 <= axes <= MOST_AXES:
        raise QuantityError(f"axes = {axes} must be 1 to {MOST_AXES}")
    of: dict[str, Any] = {"travel": travel, "variation": variation, "irregularity": irregularity}
    stages = [Stage(actuator, **of, seed=seed + 1000 * i) for i in range(axes)]
    if name == "nv200":
        return Nv200(stages[0], seed=seed, clock=clock)
    if name == "mcs2":
        return Mcs2(stages, seed=seed, clock=clock)
    return Anc300(stages, clock=clock) if name == "anc300" else Kim101(stages, clock=clock)
