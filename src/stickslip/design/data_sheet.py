"""Numbers of an actuator's data sheet, checks for contradictions among them, and the reader of data-sheet
files.

Each number may deviate by the sheet's `tolerance`. A relation between n numbers may then deviate by (1 +
tolerance)^n; beyond that the sheet contradicts itself.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

from ..gate.errors import damaged
from ..parameters import ParameterSetError, build, named_file, read_entries, read_toml
from ..quantities.records import Quantity, quantities, record
from ..quantities.units import QuantityError, with_prefix

_SHEETS = Path(__file__).parent / "sheets"
_HEAD = {"title": str, "citations": list, "kind": str}


@record
class DataSheet(NamedTuple):
    """Numbers of a data sheet for one axis of a linear actuator, in SI or as strings with units; None for a
    number that the sheet does not print.

    `tolerance` is the largest deviation of a number, as a share of its value. A contradiction among the
    numbers (see the module) raises QuantityError with both sides of the relation.
    """

    travel: Annotated[float | None, Quantity("m", "L", "travel of the slider", above=0)] = None
    step: Annotated[
        float | None, Quantity("m", "Δx", "net step at the greatest voltage, without load", above=0)
    ] = None
    speed: Annotated[float | None, Quantity("m/s", "v", "greatest speed, without load", above=0)] = None
    stall_force: Annotated[float | None, Quantity("N", "F_0", "load at which it stops", above=0)] = None
    resonance: Annotated[
        float | None, Quantity("Hz", "f_0", "lowest resonance of the stage with the piezo", above=0)
    ] = None
    capacitance: Annotated[float | None, Quantity("F", "C", "capacitance of the piezo", above=0)] = None
    max_voltage: Annotated[float | None, Quantity("V", "u_max", "greatest voltage")] = None
    mass: Annotated[float | None, Quantity("kg", "m_e", "moved mass, with its load", above=0)] = None
    min_voltage: Annotated[float, Quantity("V", "u_min", "least voltage")] = 0.0
    frequency: Annotated[float | None, Quantity("Hz", "f", "step rate of the greatest speed", above=0)] = None
    step_frequency: Annotated[
        float | None, Quantity("Hz", "f_s", "step rate at which the step was measured", above=0)
    ] = None
    stroke: Annotated[float | None, Quantity("m", "ΔL", "stroke of the piezo at rest", above=0)] = None
    holding_force: Annotated[float | None, Quantity("N", "F_h", "load held at rest", above=0)] = None
    stiffness: Annotated[
        float | None, Quantity("N/m", "k", "stiffness of the stage with the piezo", above=0)
    ] = None
    blocking_force: Annotated[
        float | None, Quantity("N", "F_b", "force of the piezo that is held", above=0)
    ] = None
    current: Annotated[float | None, Quantity("A", "I", "greatest mean current of the drive", above=0)] = None
    tolerance: Annotated[
        float, Quantity("", "", "how far a number may be off, as a share of it", above=0, maximum=1)
    ] = 0.1
    title: str = "data sheet"

    def _check(self) -> None:
        if self.max_voltage is not None and self.max_voltage <= self.min_voltage:
            raise QuantityError(
                f"DataSheet.max_voltage = {self.max_voltage:g} V must be > min_voltage = "
                f"{self.min_voltage:g} V"
            )
        for said, ratio, numbers in self._relations():
            if ratio > (1.0 + self.tolerance) ** numbers:
                raise QuantityError(
                    f"the data sheet contradicts itself: {said}. Correct one of these numbers, or give the "
                    f"sheet a tolerance above {self.tolerance:g}"
                )

    def _relations(self) -> Iterator[tuple[str, float, int]]:
        """Yield a tuple for each relation of physics between numbers of the sheet that are all known.

        The tuple is: the contradiction in words; the factor by which the relation is violated (for an
        inequality, at most 1 if it is satisfied; for an equation, the larger side over the smaller); and the
        count of numbers in the relation. The relations compare step, stroke, travel, speed, forces,
        stiffness, current and energy.
        """
        of = self.numbers

        def known(*names: str) -> bool:
            return all(name in of for name in names)

        def shown(name: str) -> str:
            return f"{name} = {with_prefix(of[name], quantities(DataSheet)[name].unit, 4)}"

        swing = None if self.max_voltage is None else self.max_voltage - self.min_voltage
        for less, more in (
            ("step", "stroke"),
            ("step", "travel"),
            ("stall_force", "holding_force"),
            ("stall_force", "blocking_force"),
        ):
            if known(less, more):
                ratio = of[less] / of[more]
                yield f"{shown(less)} is above {shown(more)}", ratio, 2
        # The speed is at most the step rate times the step. This does not hold if the step was measured at
        # another rate than the speed, because the stage moves farther near a resonance.
        elsewhere = self.step_frequency is not None and self.step_frequency != self.frequency
        if known("speed", "frequency", "step") and not elsewhere:
            most = of["frequency"] * of["step"]
            said = f"{shown('speed')} is above {shown('frequency')} times {shown('step')}"
            yield f"{said}, which is {with_prefix(most, 'm/s', 4)}", of["speed"] / most, 3
        if known("blocking_force", "stiffness", "stroke"):
            product = of["stiffness"] * of["stroke"]
            said = f"{shown('blocking_force')} is not {shown('stiffness')} times {shown('stroke')}"
            off = math.exp(abs(math.log(of["blocking_force"] / product)))
            yield f"{said}, which is {with_prefix(product, 'N', 4)}", off, 3
        if known("current", "capacitance", "frequency") and swing is not None:
            least = of["capacitance"] * swing * of["frequency"]
            said = f"{shown('current')} does not charge {shown('capacitance')} by {swing:g} V at"
            yield (
                f"{said} {shown('frequency')}: that takes {with_prefix(least, 'A', 4)}",
                (least / of["current"]),
                4,
            )
        if known("stall_force", "step", "capacitance") and swing is not None:
            # Charging the piezo in one cycle takes C U^2 with the capacitance C and the voltage U. The step
            # decreases linearly from no load to the stall force F_0, so the work per step is largest at half
            # of F_0: F_0 step / 4.
            put_in, taken = of["capacitance"] * swing**2, 0.25 * of["stall_force"] * of["step"]
            said = f"a step against half of {shown('stall_force')} works {with_prefix(taken, 'J', 3)}"
            yield f"{said}, and the piezo is charged with {with_prefix(put_in, 'J', 3)}", taken / put_in, 4

    @property
    def numbers(self) -> dict[str, float]:
        """Return the numbers that the sheet prints, by field, in SI, without `tolerance`; `min_voltage` is
        always included."""
        given = {name: getattr(self, name) for name in quantities(DataSheet)}
        return {name: value for name, value in given.items() if value is not None and name != "tolerance"}


class SheetSource(NamedTuple):
    """A data `sheet`, the keys of its references (`citations`), and `sources`: for each number by name its
    source in words, or "assumed: " and the reason."""

    sheet: DataSheet
    citations: tuple[str, ...]
    sources: dict[str, str]


def available_data_sheets() -> tuple[str, ...]:
    """Return the names of the data sheets that come with the package."""
    return tuple(sorted(file.stem for file in _SHEETS.glob("*.toml")))


def load_data_sheet(name: str | os.PathLike[str]) -> SheetSource:
    """Read a data sheet: a TOML file with a table for each number (value, unit, source).

    Args:
        name: name of a sheet that comes with the package (`available_data_sheets`), or path of a TOML file.

    Raises:
        ParameterSetError: there is no such sheet, the file is wrong, or the sheet contradicts itself; the
            message names file and field, or both sides of the relation.
    """
    file = named_file(name, _SHEETS, "data sheet")
    with damaged(ParameterSetError, str(file)):
        content = read_toml(file)
        head = {}
        for key, kind in _HEAD.items():
            head[key] = content.pop(key, None)
            if not isinstance(head[key], kind):
                raise ParameterSetError(f"{file}: {key} = {head[key]!r} must be a {kind.__name__}")
        if head["kind"] != "data_sheet":
            raise ParameterSetError(f"{file}: kind = {head['kind']!r} must be 'data_sheet'")
        entries = read_entries(file, "", content)
        sheet = build(DataSheet, entries, str(file), title=head["title"])
    sources = {key: f"assumed: {one.reason}" if one.assumed else one.source for key, one in entries.items()}
    return SheetSource(sheet, tuple(map(str, head["citations"])), sources)
