"""Initial guesses for fits of friction loops, from the size of the loops."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...estimate.parameter import REACH, Parameter, Values

if TYPE_CHECKING:
    import xarray as xr

# Displacements over which the contact yields in the initial guesses, relative to the stroke. The smallest is
# hardly resolved by samples; the largest is the whole stroke.
YIELDS = (1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0)

# FALLS: Stribeck velocities of the initial guesses, relative to the largest speed. RATIO: stiction over
# Coulomb friction in these guesses.
FALLS, RATIO = (0.003, 0.01, 0.03, 0.1, 0.3), 1.2

Array = NDArray[np.float64]


def loop_starts(
    parameters: Sequence[Parameter],
    recordings: Sequence[xr.Dataset],
    measured: Sequence[Array],
    given: Container[str],
) -> tuple[list[Parameter], list[Values]]:
    """Return the parameters with bounds that include all initial guesses, and further initial guesses (values
    by name, SI), one for each of `YIELDS`.

    Coulomb friction starts at half the range of the force. The contact yields over some share of the stroke,
    so there is one initial stiffness for each of `YIELDS`. For a law of several elements, all stiffnesses
    keep their ratios, and so do all strengths. Without a free force or stiffness on a logarithmic scale, or
    if force or position is constant, the parameters are unchanged and there are no further guesses.

    Args:
        parameters: parameters with the user's initial guess.
        recordings: with position [m] (rad).
        measured: measured force of each recording, N (N m).
        given: names of parameters whose bounds the user has given; these bounds stay.
    """
    force = 0.5 * max(float(np.ptp(x)) for x in measured)
    stroke = max(float(np.ptp(r["position"].values)) for r in recordings)
    forces = [p for p in parameters if p.unit in ("N", "N m") and p.log]
    stiff = [p for p in parameters if p.unit in ("N/m", "N m/rad") and p.log]
    if not (forces or stiff) or not (force > 0.0 and stroke > 0.0):
        return list(parameters), []
    total = {id(group): sum(p.start for p in group) for group in (forces, stiff) if group}
    guesses = []
    for share in YIELDS:
        initial = {p.name: p.start for p in parameters}
        initial |= {p.name: force * p.start / total[id(forces)] for p in forces}
        initial |= {p.name: force / (share * stroke) * p.start / total[id(stiff)] for p in stiff}
        guesses.append(initial)
    wide = []
    for p in parameters:
        if p.name not in given and p in (*forces, *stiff):
            values = [initial[p.name] for initial in guesses]
            p = p._replace(lower=min(p.lower, min(values) / REACH), upper=max(p.upper, max(values) * REACH))
        wide.append(p)
    limits = {p.name: (p.lower, p.upper) for p in wide}
    return wide, [{n: float(np.clip(v, *limits[n])) for n, v in initial.items()} for initial in guesses]


def stribeck_starts(
    parameters: Sequence[Parameter], values: Values, recordings: Sequence[xr.Dataset]
) -> list[Values]:
    """Return initial guesses (values by name, SI) with other Stribeck velocities and a stiction of `RATIO`
    times Coulomb friction; an empty list if the Stribeck velocity is not free.

    A search that starts far above the Stribeck range, or without stiction, does not find the range.

    Args:
        parameters: free parameters.
        values: initial guess that is modified, by name, SI.
        recordings: with position [m] (rad).
    """
    limits = {p.name: (p.lower, p.upper) for p in parameters}
    if "stribeck_velocity" not in limits:
        return []
    speed = max(float(np.max(np.abs(np.gradient(r["position"], r["time"])))) for r in recordings)
    ratios = {"stiction_ratio": RATIO, "stiction_force": RATIO * values.get("coulomb_force", np.inf)}
    guesses = []
    for share in FALLS:
        initial = values | {name: x for name, x in ratios.items() if name in limits and np.isfinite(x)}
        initial["stribeck_velocity"] = share * speed
        guesses.append({n: float(np.clip(initial[n], *limits[n])) for n in limits})
    return guesses
