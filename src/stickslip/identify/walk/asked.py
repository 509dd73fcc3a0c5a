"""Checks of the arguments of a fit of a walk, before any recording is read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...physics.actuator import Actuator
from ...quantities.units import QuantityError, coordinate_of, unit_for
from ...simulation.varied import free_names
from ..free import Bounds, beside, check_names, check_priors, known_of, parameter
from .position_channel import CHANNEL


def check_asked(
    model: Actuator,
    free: Sequence[str],
    *,
    bounds: Bounds | None = None,
    priors: Bounds | None = None,
    tied: Mapping[str, str] | None = None,
    noise: float | str | None = None,
) -> None:
    """Check names, initial values, bounds, priors and ties of a fit by `identify_friction`, so that an error
    in them is raised before recordings are read. Bounds of delay and offset are not checked.

    Args:
        model: actuator with the initial values.
        free, bounds, priors, tied, noise: as for `identify_friction`.

    Raises:
        QuantityError: a name cannot be free, a parameter needs explicit bounds, or an expression or a prior
            is wrong.
    """
    try:
        _check(model, free, bounds or {}, priors or {}, tied or {}, noise)
    except QuantityError as error:
        raise QuantityError(f"free: {error}") from error


def _check(
    model: Actuator,
    free: Sequence[str],
    bounds: Bounds,
    priors: Bounds,
    tied: Mapping[str, str],
    noise: float | str | None,
) -> None:
    own = {name: limits for name, limits in bounds.items() if name not in CHANNEL}
    check_names(free, [*free_names(model), *CHANNEL], own)
    check_priors(priors, free, None if noise is None else 1.0, "[m], the position's deviation")
    for name in free:
        if name not in CHANNEL:
            parameter(model, name, own, coordinate_of(model))
    channel = {"delay": (0.0, "s"), "offset": (0.0, unit_for(model, "m"))}
    beside(free, tied, known_of(model, channel, coordinate_of(model)))
