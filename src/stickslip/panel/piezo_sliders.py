"""Sliders for a piezo on the Explore page: hysteresis, creep, and parameters of other hysteresis models.

"hysteresis" is the share of the stroke that follows with hysteresis, 0 to 1. "creep" is the creep per decade
of time, over the stroke. The weights of a piezo's play operators are scaled to the sliders' values; at the
piezo's own values they are not changed at all. A piezo without play operators gets default ones, with loops
as of PZT stacks. Another hysteresis model has one slider for each of its parameters, such as "piezo_alpha".
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
# Thresholds of the default play operators, V.
THRESHOLDS = (0.0, 5.0, 10.0, 20.0, 40.0)


def shares(piezo: Piezo | None) -> dict[str, float]:
    """Return the values of "hysteresis" and "creep" for a piezo; 0 for what it lacks, and for None."""
    law, creep = piezo or (None, None)
    found = 0.0
    if isinstance(law, PrandtlIshlinskii):
        found = 1.0 - _at_once(law) / sum(law.weights)
    return {"hysteresis": found, "creep": 0.0 if creep is None else creep.per_decade}


def own_fields(piezo: Piezo | None) -> dict[str, Quantity]:
    """Return the parameters of a hysteresis model other than play operators, by name of the slider.

    The result is {} for a piezo without hysteresis or with play operators, and for None.
    """
    law = None if piezo is None else piezo.hysteresis
    if law is None or isinstance(law, PrandtlIshlinskii):
        return {}
    known = quantities(type(law))
    return {f"{PIEZO}{name}": known[name] for name in known if name not in sequences(type(law))}


def values(piezo: Piezo | None) -> dict[str, Any]:
    """Return the values of all sliders for a piezo, by name: "hysteresis", "creep", and those of
    `own_fields`."""
    law = None if piezo is None else piezo.hysteresis
    return {**shares(piezo), **{name: getattr(law, name.removeprefix(PIEZO)) for name in own_fields(piezo)}}


def with_values(piezo: Piezo | None, hysteresis: Any, creep: Any, **own: Any) -> Piezo | None:
    """Return the piezo with these slider values; None (an ideal piezo) without hysteresis and creep.

    Args:
        piezo: the piezo of the parameter set, None for an ideal one.
        hysteresis, creep: values of the two sliders, numbers from 0 to 1 or texts.
        own: values of the sliders of `own_fields`, by name.

    Raises:
        QuantityError: a value is out of range, or the hysteresis would not be monotonic.
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
    """Return the weight of the play operator with threshold 0, which has no hysteresis; 0 if there is
    none."""
    return law.weights[0] if law.thresholds[0] == 0.0 else 0.0


def _crept(creep: Creep | None, per_decade: float) -> Creep | None:
    """Return creep with the shares of all terms scaled so that it adds `per_decade` of the stroke per decade.

    Without creep to scale it is logarithmic. The result is None if `per_decade` is 0.
    """
    if per_decade == 0.0:
        return None
    if creep is None or creep.per_decade == 0.0:
        return Creep.logarithmic(per_decade)
    factor = per_decade / creep.per_decade
    return creep._replace(shares=tuple(factor * share for share in creep.shares))


def _stretched(law: Any, share: float) -> PrandtlIshlinskii | None:
    """Return play operators of which those with hysteresis have the part `share` of all weights.

    They are the scaled operators of `law`. Default operators are used if `law` is another model or None, or
    has no operator with hysteresis or none with threshold 0; for these and a share of 0 the result is None.
    """
    if not isinstance(law, PrandtlIshlinskii) or law.thresholds[0] > 0.0 or sum(law.weights[1:]) == 0.0:
        law = PrandtlIshlinskii(THRESHOLDS, (1.0,) * len(THRESHOLDS))
        if share == 0.0:
            return None
    weights, total = np.array(law.weights), sum(law.weights)
    made = weights * (share * total / (total - weights[0]))
    made[0] = (1.0 - share) * total
    return law._replace(weights=tuple(made.tolist()))
