"""The slope of a static law in its first moment of sliding."""

from __future__ import annotations

from .._jit import fused
from .law import rate

# Sliding slower than this, m/s, is not told from rest: a thousand roundings of a few cm/s.
RESOLVED = 1e-14


@fused
def static_slope(law, v, side):
    """F and dF/dv of a static law that slides to this side, by a difference outwards in v. That is small
    where v is, for the force may fall ever more steeply towards rest: a Stribeck curve of an exponent below
    1."""
    speed = abs(v)
    dv = 1e-5 * speed + (min(1e-11, 1e-2 * speed) if speed > RESOLVED else 1e-11)
    force = rate(law, side * speed, side)[0]
    return force, side * (rate(law, side * (speed + dv), side)[0] - force) / dv
