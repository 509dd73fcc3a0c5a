"""Piezo model between voltage and free stroke: hysteresis, which acts at once, then creep."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...quantities import registry
from ...quantities.records import record
from ...quantities.units import QuantityError
from .creep import Creep
from .maxwell_capacitor import MaxwellCapacitor


@record
class Piezo(NamedTuple):
    """Model of a piezo: hysteresis of the drive, then creep.

    `hysteresis` is a `PrandtlIshlinskii`, `BoucWen`, `MaxwellCapacitor` (without creep) or a user's model,
    `creep` a `Creep`; None leaves it out. The static stroke is the actuator's gain multiplied by the result.
    """

    hysteresis: Any = None
    creep: Any = None

    def _check(self) -> None:
        for field in ("hysteresis", "creep"):
            value = getattr(self, field)
            if value is not None and type(value).__name__ not in registry.piezos.names():
                known = ", ".join(registry.piezos.names())
                raise QuantityError(
                    f"Piezo.{field} = {value!r} must be a piezo model with its values: {known}"
                )
        if isinstance(self.hysteresis, Creep) or not isinstance(self.creep, Creep | None):
            raise QuantityError(
                "Piezo(hysteresis=..., creep=...): hysteresis comes first and creep is a Creep; there are "
                f"{type(self.hysteresis).__name__} and {type(self.creep).__name__}"
            )
        if isinstance(self.hysteresis, MaxwellCapacitor) and self.creep is not None:
            raise QuantityError("Piezo.creep is not part of a MaxwellCapacitor: leave it out")

    def resting_at(self, wanted: float) -> float:
        """Return the voltage [V], reached from 0 V without a reversal, at which the output of hysteresis and
        creep is `wanted` [V] after a long rest, when creep has ended. The hysteresis must have a method
        `inverse`, unlike a `MaxwellCapacitor`."""
        share = 1.0 + (sum(self.creep.shares) if self.creep is not None else 0.0)
        level = wanted / share
        return level if self.hysteresis is None else float(self.hysteresis.inverse([level])[0])
