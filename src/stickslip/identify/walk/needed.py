"""Values of the position channel that a fit frees by default: offset and delay."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...actuator import Actuator
from ...estimate.lack import KnownNoise
from ...estimate.result import Fit
from ...estimate.score import ASKED, gain
from ...simulation.varied import ratios_of
from ..free import value_of
from .position_channel import CHANNEL

# Samples at rest that tell a mean, and of how many standard errors it is one.
FEWEST, SURE = 10, 4.0

Array = NDArray[np.float64]


def shown_at_rest(known: Sequence[KnownNoise], measured: Sequence[Array]) -> list[str]:
    """The offset, where a position [n] is not zero on average before anything moves."""
    for noise, position in zip(known, measured, strict=True):
        rest = position[: noise.at_rest]
        if rest.size >= FEWEST:
            least = noise.step / math.sqrt(12.0) + 1e-6 * float(np.ptp(position))
            error = max(float(rest.std(ddof=1)), least) / math.sqrt(rest.size)
            if abs(float(rest.mean())) > SURE * error:
                return ["offset"]
    return []


def asked_for(
    fit: Fit,
    times: Sequence[Array],
    measured: Sequence[Array],
    first: Mapping[str, float],
    free: Container[str],
) -> list[str]:
    """Those of offset and delay that would lower the sum of squares by more than noise does.

    Args:
        fit: without them.
        times, measured: of each recording [n], s and m.
        first: a delay that is known to be there is free in any case.
        free: what is free already.
    """
    moving = [-np.gradient(r + x, t) for r, x, t in zip(fit.residuals, measured, times, strict=True)]
    slopes = {"delay": np.concatenate(moving), "offset": np.ones(sum(x.size for x in measured))}
    return [
        name for name in CHANNEL if name not in free and (name in first or gain(fit, slopes[name]) > ASKED)
    ]


def said_free(fit: Fit, names: Sequence[str]) -> str:
    """A sentence on what is free besides what was asked for."""
    units = {p.name: p for p in fit.parameters}
    listed = " and ".join(f"{name} = {units[name].shown(fit.values[name], 3)}" for name in names)
    verb = "is" if len(names) == 1 else "are"
    return f"{' and '.join(names)} of the position channel {verb} free too, for the recordings show: {listed}"


def said_kept(fit: Fit, model: Actuator) -> tuple[str, ...]:
    """A sentence on stiction that is not free, where it follows Coulomb friction at another ratio than 1."""
    free = {"stiction_force", "stiction_ratio"} & {*fit.values, *fit.tied}
    if free or "coulomb_force" not in fit.values or "stiction_ratio" not in ratios_of(model.friction):
        return ()
    ratio = value_of(model, "stiction_ratio")[0]
    if abs(ratio - 1.0) < 1e-9:
        return ()
    return (
        f"stiction_force was not free: it is {ratio:.4g} times coulomb_force, as in the model that was given",
    )
