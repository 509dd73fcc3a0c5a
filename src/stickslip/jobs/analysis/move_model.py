"""Target of a move, and alternative models for which its loop must be stable.

The alternatives come from the intervals of a fit, a posterior, or a stated relative uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...control import PiezoInverse
from ...gate.errors import damaged
from ...gate.results import results_numbers
from ...physics.actuator import Actuator
from ...physics.piezo import Creep, PrandtlIshlinskii
from ...quantities.units import QuantityError, with_prefix
from ...simulation.varied import free_names, quantity_of

MOST_DRAWS = 40  # largest number of draws (alternative models) for which the stability margins are checked


class Aim(NamedTuple):
    """Target and tolerances of a move in `unit`: m, or rad for rotary actuators.

    `within` is the half width of the window around the target. `hold_within` is the largest allowed rms error
    during the hold, None for no limit.
    """

    unit: str
    target: float
    within: float
    hold_within: float | None

    def said(self, value: float) -> str:
        """Return a position as text with its unit, such as "10 nm"."""
        return with_prefix(value, self.unit)


def feedforward_of(model: Actuator, rate: float) -> PiezoInverse | None:
    """Return the inverse of the model's piezo, from positions [m, rad] to voltages; None without inverse.

    There is one for play operators (`PrandtlIshlinskii`) without creep or with `Creep`. `rate` is the
    controller's update rate [Hz].
    """
    piezo = model.piezo
    if piezo is None or not isinstance(piezo.hysteresis, PrandtlIshlinskii):
        return None
    return PiezoInverse(model, rate) if isinstance(piezo.creep, Creep | None) else None


def at_ends(model: Actuator, spread: Mapping[str, float]) -> list[Actuator]:
    """Return two alternative models for each field in `spread`, at either end of its uncertainty.

    `spread` has the relative uncertainty by name of a field of the actuator or its friction law: 0.05 gives
    0.95 and 1.05 times the value. Raises QuantityError for an unknown name, or an uncertainty not between 0
    and 1.
    """
    found = []
    for name, share in spread.items():
        if not 0.0 < share < 1.0:
            raise QuantityError(f"spread: {name} = {share:g} must be a share between 0 and 1, such as 5 %")
        for factor in (1.0 - share, 1.0 + share):
            of = model.friction if name in model.friction._fields else model
            if not isinstance(getattr(of, name, None), float):
                raise QuantityError(f"spread: {name} is no number of the model or its friction law")
            found.append(changed_in(model, {name: factor * getattr(of, name)}))
    return found


def at_intervals(model: Actuator, results: Path) -> list[Actuator]:
    """Return two alternative models for each fitted parameter of the model, at either end of its interval.

    `results` is the path of a results.json; parameters in it that the model does not have are ignored. Raises
    QuantityError if it contains no results, or if an interval has no end or an end that the parameter cannot
    have.
    """
    with damaged(QuantityError, f"{results}: no results of an identification"):
        return list(_at_intervals(model, results))


def _at_intervals(model: Actuator, results: Path) -> Iterator[Actuator]:
    known = free_names(model)
    for name, interval in _intervals(results_numbers(results)):
        for end in interval if name in known else ():
            if end is None or not _allowed(model, name, end):
                raise QuantityError(
                    f"{results}: the recordings do not determine {name}, whose interval is open: there is no "
                    "model at its end. Give its spread instead, or identify it from more recordings"
                )
            try:
                found = changed_in(model, {name: float(end)})
            except QuantityError as error:
                raise QuantityError(f"{results}: {error}") from error
            yield found


def _allowed(model: Actuator, name: str, value: float) -> bool:
    """Return True if the parameter `name` of the actuator or its friction law can have the value (in SI)."""
    quantity = quantity_of(model, None, name)
    return quantity is None or bool(quantity.allows(float(value)))


def at_draws(model: Actuator, draws: Mapping[str, ArrayLike]) -> list[Actuator]:
    """Return models with the values of draws: of all draws, or of `MOST_DRAWS` evenly selected ones if there
    are more.

    `draws` has arrays [n] in SI by name of a parameter. Raises QuantityError for a value that is not allowed.
    """
    columns = {name: np.asarray(one, dtype=float) for name, one in draws.items()}
    size = next(iter(columns.values())).size
    chosen = np.unique(np.linspace(0, size - 1, MOST_DRAWS).astype(int))
    return [changed_in(model, {name: float(one[k]) for name, one in columns.items()}) for k in chosen]


def changed_in(model: Actuator, values: Mapping[str, float]) -> Actuator:
    """Return the model with the given values of fields of the actuator or its friction law, in SI by name.

    Raises QuantityError for an unknown name, or a value that is not allowed.
    """
    law = {name: value for name, value in values.items() if name in model.friction._fields}
    own = {name: value for name, value in values.items() if name not in law}
    return model.replace(friction=model.friction._replace(**law), **own)


def _intervals(numbers: Any) -> Iterator[tuple[str, Any]]:
    """Yield name and interval of every parameter in the numbers of a results.json.

    All mappings "parameters" at any depth of `numbers` are searched. An interval is a list of two ends, None
    for an unknown one.
    """
    for key, inner in numbers.items() if isinstance(numbers, dict) else ():
        if key == "parameters" and isinstance(inner, dict):
            for name, one in inner.items():
                if isinstance(one, dict) and isinstance(one.get("interval"), list):
                    yield name, one["interval"]
        else:
            yield from _intervals(inner)
