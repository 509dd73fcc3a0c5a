"""Free parameters of an actuator with their ranges, and their values in the conditions of a search."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..physics.actuator import Actuator
from ..quantities.records import Quantity, did_you_mean, quantities_within
from ..quantities.units import QuantityError
from ..simulation.members import SCALES
from ..simulation.varied import element_of, free_names, with_values
from .scenarios import ScenarioTable, own

Array = NDArray[np.float64]
STIFFNESS = "stage_stiffness"
FREQUENCY = "natural_frequency"
# Ratio of the upper to the lower end of a range, above which the search uses a logarithmic scale.
WIDE = 3.0


class DesignSpace(NamedTuple):
    """Free parameters of an actuator `model`: their `names` and ranges, `low` to `high` [names], SI.

    "load" is the normal force relative to its reference. If "stage_stiffness" or "stage_mass" is free, the
    natural frequency of the stage follows from stiffness and mass, unless "natural_frequency" is free beside
    the mass or the stage is static. "stage_stiffness" and "natural_frequency" are not free together.
    """

    model: Actuator
    names: tuple[str, ...]
    low: Array
    high: Array

    @property
    def logarithmic(self) -> NDArray[np.bool_]:
        return (self.low > 0.0) & (self.high > WIDE * self.low)

    @property
    def given(self) -> Array:
        """Return the model's own values of the free parameters, SI, [names]."""
        return np.array([self._of_model(name) for name in self.names])

    @property
    def units(self) -> list[str]:
        return [_quantity(self.model, name).unit for name in self.names]

    def values(self, x: Array) -> Array:
        """Return the values of the parameters, SI, [n, names], at positions `x` [n, names] within their
        ranges.

        A position is 0 at the lower and 1 at the upper end; the scale is logarithmic for a wide range
        (`WIDE`).
        """
        log = self.logarithmic
        low, high = np.where(log, self.low, 1.0), np.where(log, self.high, 1.0)
        return np.where(log, low * (high / low) ** x, self.low + x * (self.high - self.low))

    def shares(self, values: Array) -> Array:
        """Return the positions of values [names], SI, within their ranges, from 0 to 1: the inverse of
        `values`. Values beyond a range are clipped."""
        log = self.logarithmic
        low, high = np.where(log, self.low, 1.0), np.where(log, self.high, math.e)
        inside = np.clip(values, self.low, self.high)
        even = (inside - self.low) / (self.high - self.low)
        return np.where(log, np.log(np.where(log, inside, 1.0) / low) / np.log(high / low), even)

    def columns(self, values: Array, conditions: Mapping[str, Array]) -> dict[str, Array]:
        """Return all fields that candidates or conditions vary, by name, SI, arrays [n, conditions].

        A condition changes a candidate's value in the same proportion as the model's own value.

        Args:
            values: values of the free parameters of each candidate, SI, [n, names].
            conditions: values in each condition by name, SI, arrays [conditions].
        """
        count = max([1, *(column.size for column in conditions.values())])
        made = {name: np.tile(column, (len(values), 1)) for name, column in conditions.items()}
        for name, value in self.fields(values).items():
            column = np.repeat(value[:, None], count, axis=1)
            made[name] = column * made[name] / self._of_model(name) if name in made else column
        return made

    def fields(self, values: Array) -> dict[str, Array]:
        """Return the fields of the model (and "load") by name, arrays [n], SI, from values of the free
        parameters [n, names]. A stiffness becomes the natural frequency that follows from it."""
        fields = dict(zip(self.names, values.T, strict=True))
        stiffness = fields.pop(STIFFNESS, self.model.stage_stiffness)
        if FREQUENCY not in fields and {STIFFNESS, "stage_mass"} & {*self.names} and not self.model.static:
            fields[FREQUENCY] = np.sqrt(stiffness / fields.get("stage_mass", self.model.stage_mass))
        return {name: np.asarray(value) for name, value in fields.items()}

    def _of_model(self, name: str) -> float:
        return self.model.stage_stiffness if name == STIFFNESS else own(self.model, name)


def space_of(model: Actuator, free: Mapping[str, Any]) -> DesignSpace:
    """Return the free parameters of a model with their ranges.

    Args:
        model: the actuator.
        free: ranges (low, high) by the name of the parameter, in SI or with units.

    Raises:
        QuantityError: an unknown name, one that this model does not have, a range that is not finite and
            ascending, or "stage_stiffness" where it has no effect.
    """
    if not isinstance(free, Mapping) or not free:
        raise QuantityError(
            "free says what may differ, and within which range: {'stage_mass': ('50 g', '200 g')}"
        )
    ends = [_range(model, name, given) for name, given in free.items()]
    if STIFFNESS in free and (FREQUENCY in free or model.static):
        why = "the stage is static" if model.static else f"{FREQUENCY} [rad/s] is free"
        raise QuantityError(f"free[{STIFFNESS!r}] [N/m] does nothing: {why}")
    low, high = np.array(ends).T
    return DesignSpace(model, tuple(free), low, high)


def built(space: DesignSpace, values: Array) -> Actuator:
    """Return the actuator with values [names], SI, of its free parameters. "load" is ignored: the friction
    stays at the reference normal force."""
    fields = {name: float(value[0]) for name, value in space.fields(values[None]).items() if name != "load"}
    return with_values(space.model, fields)


def _range(model: Actuator, name: str, given: Any) -> tuple[float, float]:
    known = [*free_names(model), SCALES[-1], STIFFNESS]
    if name not in known:
        raise QuantityError(
            f"free[{name!r}] is unknown{did_you_mean(name, known)}; there are {', '.join(known)}"
        )
    quantity = _quantity(model, name)
    try:
        first, last = given
    except (TypeError, ValueError):
        raise QuantityError(f"free[{name!r}] = {given!r:.60} must be (low, high)") from None
    low, high = (quantity.check(end, f"free[{name!r}]") for end in (first, last))
    if not low < high < math.inf:
        raise QuantityError(f"free[{name!r}] = {first}, {last}: the first must be less, and both finite")
    return low, high


def _quantity(model: Actuator, name: str) -> Quantity:
    """Return the unit, meaning and allowed range (`Quantity`) of a free parameter by its name: a field of the
    model or its law, "stage_stiffness", or "load"."""
    if name == STIFFNESS:
        return Quantity("N/m", "k", "stiffness of the stage", above=0)
    element = element_of(model.friction, name)
    known = quantities_within(model)
    return known.get(element[0] if element else name) or Quantity("", "", name, above=0)


def check_conditions(space: DesignSpace, conditions: ScenarioTable) -> None:
    """Raise QuantityError if a condition changes a free parameter whose own value is 0 in the model.

    Conditions change free parameters in proportion to the model's own value, which needs a value other than
    0.
    """
    for name in {*space.fields(space.given[None])} & {*conditions.columns}:
        if own(space.model, name) == 0.0:
            raise QuantityError(
                f"{name!r} is free and in a scenario, but 0 in the model: leave out one of them"
            )
