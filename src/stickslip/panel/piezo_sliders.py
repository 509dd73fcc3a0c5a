"""Two sliders for a piezo: how much of the stroke follows with hysteresis, and how much creeps per decade.

A parameter set's own plays are stretched to what the sliders say, and kept to the last bit where they say
what it has. An actuator without any gets plays that make loops as those of PZT stacks. Hysteresis of another
kind has sliders of its own instead, one for each of its numbers, "piezo_alpha" and so on.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..physics.piezo import Creep, Piezo, PrandtlIshlinskii
from ..quantities.records import Quantity, quantities, sequences
from ..simulation.varied import PIEZO

FIELDS = {
    "hysteresis": Quantity("", "h", "share of the stroke that follows with hysteresis", minimum=0, below=1),
    "creep": Quantity("", "g", "creep per decade of time, over the stroke", minimum=0, maximum=1),
}
THRESHOLDS = (0.0, 5.0, 10.0, 20.0, 40.0)  # V, of an actuator without hysteresis of its own


def shares(piezo: Piezo | None) -> dict[str, float]:
    """The values of both sliders, as a model has them."""
    law, creep = piezo or (None, None)
    found = 0.0
    if isinstance(law, PrandtlIshlinskii):
        found = 1.0 - _at_once(law) / sum(law.weights)
    return {"hysteresis": found, "creep": 0.0 if creep is None else creep.per_decade}


def own_fields(piezo: Piezo | None) -> dict[str, Quantity]:
    """The numbers of hysteresis that is not made of plays, by the name of their slider."""
    law = None if piezo is None else piezo.hysteresis
    if law is None or isinstance(law, PrandtlIshlinskii):
        return {}
    known = quantities(type(law))
    return {f"{PIEZO}{name}": known[name] for name in known if name not in sequences(type(law))}


def values(piezo: Piezo | None) -> dict[str, Any]:
    """Of all sliders, as a model has them."""
    law = None if piezo is None else piezo.hysteresis
    return {**shares(piezo), **{name: getattr(law, name.removeprefix(PIEZO)) for name in own_fields(piezo)}}


def with_values(piezo: Piezo | None, hysteresis: Any, creep: Any, **own: Any) -> Piezo | None:
    """The piezo with these shares and numbers of its own; None if nothing is left.

    Raises:
        QuantityError: one is out of range, or the voltage would turn back before the stroke does.
    """
    if own and piezo is not None:
        fields = {name.removeprefix(PIEZO): value for name, value in own.items()}
        piezo = piezo._replace(hysteresis=piezo.hysteresis._replace(**fields))
    h = FIELDS["hysteresis"].check(hysteresis, "Actuator.hysteresis")
    g = FIELDS["creep"].check(creep, "Actuator.creep")
    now = shares(piezo)
    law, after = piezo or (None, None)
    if not math.isclose(h, now["hysteresis"], rel_tol=1e-9, abs_tol=1e-12):
        law = _stretched(law, h)
    if not math.isclose(g, now["creep"], rel_tol=1e-9, abs_tol=1e-12):
        after = _crept(after, g)
    return None if law is None and after is None else Piezo(law, after)


def _at_once(law: PrandtlIshlinskii) -> float:
    """The weight of what follows without hysteresis."""
    return law.weights[0] if law.thresholds[0] == 0.0 else 0.0


def _crept(creep: Creep | None, per_decade: float) -> Creep | None:
    """Creep of so much per decade; None of 0."""
    if per_decade == 0.0:
        return None
    if creep is None or creep.per_decade == 0.0:
        return Creep.logarithmic(per_decade)
    factor = per_decade / creep.per_decade
    return creep._replace(shares=tuple(factor * share for share in creep.shares))


def _stretched(law: Any, share: float) -> PrandtlIshlinskii | None:
    """Plays whose weights are so much of all."""
    if not isinstance(law, PrandtlIshlinskii) or law.thresholds[0] > 0.0 or sum(law.weights[1:]) == 0.0:
        law = PrandtlIshlinskii(THRESHOLDS, (1.0,) * len(THRESHOLDS))
        if share == 0.0:
            return None
    weights, total = np.array(law.weights), sum(law.weights)
    made = weights * (share * total / (total - weights[0]))
    made[0] = (1.0 - share) * total
    return law._replace(weights=tuple(made.tolist()))
