"""Result of a search for an actuator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..estimate.shown import preformatted
from ..physics.actuator import Actuator
from ..quantities.units import unit_for, with_prefix
from ..waveform.periodic import Sawtooth
from .scenarios import ScenarioTable
from .space import DesignSpace, built

Array = NDArray[np.float64]
# Largest distance of a value from an end of its range, relative to the range, that is reported as at the end.
AT_END = 1e-3


class Built(NamedTuple):
    """Best result of `optimise_actuator` for one of the given models.

    Attributes:
        name: name of the model; empty if a single model was given without a name.
        space: free parameters of the model and their ranges.
        found: best values of the free parameters, SI, in the order of `space.names`.
        waveform: best sawtooth with these values.
        conditions: conditions in which candidates were judged.
        values, speeds: goal [SI] and speed [m/s, or rad/s for a rotary actuator] in every condition.
        before: goal [SI] in every condition with the model's own values and the best sawtooth for them.
        evaluations: number of computed periodic motions.
        interrupted: True if Ctrl-C stopped the search; the result is then the best one found so far.
    """

    name: str
    space: DesignSpace
    found: Array
    waveform: Sawtooth
    conditions: ScenarioTable
    values: Array
    speeds: Array
    before: Array
    evaluations: int
    interrupted: bool


@dataclass(frozen=True, eq=False, repr=False)
class OptimisedActuator:
    """Result of `optimise_actuator`: the best actuator with its drive.

    Attributes:
        best: best result of all given models.
        each: best result of each model, in the given order.
        goal: the goal of the search.
    """

    best: Built
    each: tuple[Built, ...]
    goal: Any

    @classmethod
    def of(cls, each: list[Built], goal: Any) -> OptimisedActuator:
        return cls(max(each, key=lambda one: (goal.sign * one.values).min()), tuple(each), goal)

    @property
    def name(self) -> str:
        """Return the name of the best model; empty if a single model was given without a name."""
        return self.best.name

    @property
    def model(self) -> Actuator:
        """Return the best actuator; its friction is that at the reference normal force, without `load`."""
        return built(self.best.space, self.best.found)

    @property
    def unit(self) -> str:
        """Return the SI unit of the goal for the best model (rad instead of m for a rotary actuator)."""
        return unit_for(self.model, self.goal.unit)

    @property
    def load(self) -> float:
        """Return the best normal force relative to the reference, as the normal load of a simulation; 1 if
        "load" is not free."""
        space = self.best.space
        return float(self.best.found[space.names.index("load")]) if "load" in space.names else 1.0

    @property
    def waveform(self) -> Sawtooth:
        """Return the sawtooth of the best actuator."""
        return self.best.waveform

    @property
    def value(self) -> float:
        """Return the goal in the worst condition, SI."""
        return self._worst(self.best.values)

    @property
    def given_value(self) -> float:
        """Return the goal that the best model reaches with its given values and the best sawtooth for them,
        in the worst condition, SI."""
        return self._worst(self.best.before)

    @property
    def table(self) -> Any:
        """Return the free parameters of the best model, as a pandas DataFrame with a row per parameter.

        Columns: given, found, low, high (SI), unit, and `at`: "low" or "high" if the found value is at that
        end of its range, otherwise empty.
        """
        space, found = self.best.space, self.best.found
        columns = {"given": space.given, "found": found, "low": space.low, "high": space.high}
        columns |= {"unit": np.array(space.units), "at": np.array(_ends(space, found))}
        return _frame("free", space.names, columns)

    @property
    def choices(self) -> Any:
        """Return the best result of each model as a pandas DataFrame with a row per model, SI.

        Columns: value (goal in the worst condition), given (the same with the model's own values of the free
        parameters), and a column with the best value of each free parameter.
        """
        columns = {
            "value": np.array([self._worst(one.values) for one in self.each]),
            "given": np.array([self._worst(one.before) for one in self.each]),
        }
        columns |= dict(zip(self.best.space.names, np.array([one.found for one in self.each]).T, strict=True))
        return _frame("model", [one.name for one in self.each], columns)

    def _worst(self, values: Array) -> float:
        return float(self.goal.sign * (self.goal.sign * values).min())

    def report(self) -> str:
        """Return the result as text: goal, sawtooth, free parameters, and the goal of each given model."""
        unit, best = self.unit, self.best
        count = len(best.conditions.names)
        how = f"in the worst of {count} conditions" if count > 1 else "without scenarios"
        said = [
            f"{self.goal.label}: {with_prefix(self.value, unit, 4)} {how}; as given: "
            f"{with_prefix(self.given_value, unit, 4)}, each with its best sawtooth",
            f"sawtooth of {best.waveform.amplitude:.4g} V at {best.waveform.frequency:.4g} Hz, rise over "
            f"{best.waveform.rise_fraction:.3g} of the period; {sum(one.evaluations for one in self.each)} "
            "periodic motions solved for",
        ]
        if any(one.interrupted for one in self.each):
            said.append("stopped before the end of the search: the best until then")
        ends = _ends(best.space, best.found)
        width = max(map(len, best.space.names))
        rows = zip(best.space.names, best.space.units, best.space.given, best.found, ends, strict=True)
        for name, symbol, given, found, end in rows:
            both = f"{with_prefix(found, symbol, 4)}, given {with_prefix(given, symbol, 4)}"
            said.append(f"  {name:{width}}  {both}" + (f"   at the {end} end of its range" if end else ""))
        if len(self.each) > 1:
            said.append(f"best of {len(self.each)}: {best.name}")
            width = max(len(one.name) for one in self.each)
            said += [
                f"  {one.name:{width}}  {with_prefix(self._worst(one.values), unit, 4)}" for one in self.each
            ]
        return "\n".join(said)

    def __repr__(self) -> str:
        return self.report()

    def _repr_html_(self) -> str:
        return preformatted(self)


def _frame(index: str, labels: Sequence[str], columns: dict[str, Array]) -> Any:
    data = {name: (index, column) for name, column in columns.items()}
    return xr.Dataset(data, coords={index: list(labels)}).to_dataframe()


def _ends(space: DesignSpace, found: Array) -> list[str]:
    """Return for each found value [names] "low" or "high" if it is at that end of its range, otherwise ""."""
    shares = space.shares(found)
    return ["low" if s < AT_END else "high" if s > 1.0 - AT_END else "" for s in shares.tolist()]
