"""Benches: the instruments of a laboratory with their datasheet values, from TOML files.

A file looks like a parameter set (see `stickslip.parameters.load`): one table per number, with its unit and
source, or ``assumed = true`` and a reason. ``[sensor.NAME]`` gives the sensor's `type` (a user's own type is
"my_sensor.py:MySensor", beside the file), the part it is mounted `on` (stage or end_effector), the `adc` that
samples it, and its parameters.

With ``base = "kang2007-bench"`` a file contains only the differences. Each of its top-level tables replaces
the base's whole table: one ``[sensor.NAME]`` replaces all sensors. ``amplifier = "pd200x4"`` and
``stack = "ae0505d16"`` (for its capacitance) use parts of `physics.electronics.parts`, by name or by a file
beside the bench's.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any, TypeVar

from ..gate.errors import GateError, damaged
from ..gate.paths import inside
from ..parameters import ParameterSetError, SetEntry, build, named_file, read_entries, read_toml
from ..physics.electronics import (
    Adc,
    Amplifier,
    Dac,
    Encoder,
    Filter,
    InductiveSensor,
    Interferometer,
    OutputStage,
    PositionSensor,
    StrainGauge,
)
from ..physics.electronics.parts import Part, load_amplifier, load_part, load_stack
from ..quantities import registry
from ..quantities.records import did_you_mean
from ..quantities.units import to_si
from ..recording.chain import Chain

T = TypeVar("T")

MOST_BASES = 10  # greatest number of bench files below one file, each the `base` of the previous one
_BENCHES = Path(__file__).parent / "benches"
Sensor = StrainGauge | InductiveSensor | Interferometer | Encoder | PositionSensor | Chain
_PLACES = ("stage", "end_effector")
_KEYS = (
    *("kind", "title", "citations", "base", "sample_rate", "piezo_capacitance", "stack"),
    *("dac", "adc", "amplifier", "anti_alias", "sensor"),
)
_OF_SENSOR = ("type", "on", "adc")


@dataclass(frozen=True)
class Mounted:
    """A sensor, the part on which it is mounted ("stage" or "end_effector"), and its A/D converter.

    `adc` is None for a sensor that outputs its position as a number (m or rad) instead of a voltage.
    """

    sensor: Sensor
    on: str
    adc: Adc | None


@dataclass(frozen=True)
class Bench:
    """All instruments between a program and an actuator, for one drive channel.

    `sample_rate` applies to all inputs, Hz; `piezo_capacitance` is in F. `dac` and `amplifier` form the
    output; `anti_alias` is the filter before each A/D converter. `sensors` are the inputs by name.
    `assumptions` gives, by field ("dac.bits"), value and reason, as one text, of each number that no source
    states.
    """

    name: str
    title: str
    citations: tuple[str, ...]
    sample_rate: float
    piezo_capacitance: float
    dac: Dac
    amplifier: Amplifier
    anti_alias: Filter
    sensors: dict[str, Mounted]
    assumptions: dict[str, str]

    def __post_init__(self) -> None:
        object.__setattr__(self, "sample_rate", to_si(self.sample_rate, "Hz", "sample_rate"))
        capacitance = to_si(self.piezo_capacitance, "F", "piezo_capacitance")
        object.__setattr__(self, "piezo_capacitance", capacitance)

    def replace(self, **changes: Any) -> Bench:
        """Return a copy of the bench in which the fields given by name have the given values."""
        return replace(self, **changes)

    def output(self, points: float = math.inf) -> OutputStage:
        """Return the output stage (D/A converter, amplifier, piezo) for the design of drives.

        Args:
            points: greatest number of updates in a period of the drive; not limited by default.
        """
        of = OutputStage.of_amplifier(self.amplifier, self.piezo_capacitance)
        step = self.dac.step * self.amplifier.gain
        return of._replace(update_rate=self.dac.update_rate, points=points, step=step)

    def with_chain(self, chain: Chain, name: str = "position") -> Bench:
        """Return the bench with an additional input, the end-effector's position as seen through a chain.

        The input is free of noise and has no A/D converter.

        Args:
            chain: scale, offset and delay of the measurement in an identified signal chain. If its slew rate
                is known, that rate replaces the amplifier's, and the amplifier's current is not limited.
            name: name of the input.
        """
        amplifier = self.amplifier
        if chain.known_slew_rate is not None:
            amplifier = amplifier._replace(slew_rate=chain.slew_rate, max_current=math.inf)
        sensors = {**self.sensors, name: Mounted(chain, "end_effector", None)}
        return replace(self, amplifier=amplifier, sensors=sensors)


def available_benches() -> tuple[str, ...]:
    """Return the names of the benches in the package."""
    return tuple(sorted(file.stem for file in _BENCHES.glob("*.toml")))


def load_bench(name: str | os.PathLike[str]) -> Bench:
    """Load a bench of the package, ``load_bench("kang2007-bench")``, or of a TOML file.

    Args:
        name: name of a bench of the package, or path of a file NAME.toml.

    Raises:
        ParameterSetError: there is no such bench, or the file is wrong; names file and field.
    """
    file = named_file(name, _BENCHES, "bench")
    with damaged(ParameterSetError, str(file)):
        return _Reading(file, _whole(file)).bench(os.fspath(name))


def _whole(file: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return the content of a bench file, tables by name, together with the content of its base.

    A top-level table of the file replaces the base's whole table of the same name; `stack` also replaces the
    base's `piezo_capacitance`, and the reverse.

    Args:
        file: path of the bench file.
        above: files that lead to this one, each as the base of the one before; to detect a cycle.

    Raises:
        ParameterSetError: a file is missing or cannot be read, or the bases form a cycle or too long a chain.
    """
    if file in above or len(above) > MOST_BASES:
        said = f"the bench is its own base, or the last of more than {MOST_BASES}"
        raise ParameterSetError(f"{file}: base: {said}")
    content = read_toml(file)
    base = content.pop("base", None)
    if base is None:
        return content
    if not isinstance(base, str):
        raise ParameterSetError(f"{file}: base = {base!r} must be the name of a bench")
    below = _whole(named_file(_beside(file, base), _BENCHES, "bench"), (*above, file))
    for one, other in (("stack", "piezo_capacitance"), ("piezo_capacitance", "stack")):
        if one in content:
            below.pop(other, None)
    return below | content


def _beside(file: Path, name: str) -> str | Path:
    """Return the path of `name` in the folder of a bench file if it ends in ".toml", else the name itself.

    A name without the ending is the name of a bench or part in the package.

    Raises:
        ParameterSetError: the path leads out of the folder of the bench file.
    """
    if not name.endswith(".toml"):
        return name
    try:
        return inside(file.parent, PurePath(name).as_posix(), "the folder of the bench")
    except GateError as error:
        raise ParameterSetError(f"{file}: {error}") from error


class _Reading:
    """Reader of one bench file's content, which collects the assumed values in `assumptions`.

    The constructor gets the path, for errors, and the content with its bases, as `_whole` returns it. `bench`
    builds the bench, once only: each table is removed from `content` when it is read. The methods that read a
    table raise ParameterSetError, with file and table, if the table is wrong.
    """

    def __init__(self, file: Path, content: dict[str, Any]) -> None:
        self.file, self.content, self.assumptions = file, content, dict[str, str]()

    def bench(self, name: str) -> Bench:
        for key in self.content:
            if key not in _KEYS:
                raise ParameterSetError(
                    f"{self.file}: [{key}] is unknown{did_you_mean(key, _KEYS)}; there are {', '.join(_KEYS)}"
                )
        if self.content.pop("kind", None) != "bench":
            raise ParameterSetError(f"{self.file}: kind must be 'bench'")
        title, citations = self.content.pop("title", ""), self.content.pop("citations", [])
        if not isinstance(title, str) or not isinstance(citations, list):
            raise ParameterSetError(f"{self.file}: title must be a text, citations a list")
        rates = self._entries("", {"sample_rate": self._table("sample_rate")})
        farad = self._capacitance()
        adcs = {key: self._part(Adc, f"adc.{key}", table) for key, table in self._table("adc").items()}
        dac = self._part(Dac, "dac", self._table("dac"))
        amplifier = self._amplifier()
        anti_alias = self._part(Filter, "anti_alias", self._table("anti_alias"))
        sensors = {key: self._sensor(key, table, adcs) for key, table in self._table("sensor").items()}
        bench = Bench(
            name=name,
            title=title,
            citations=tuple(map(str, citations)),
            sample_rate=rates["sample_rate"].to("Hz"),
            piezo_capacitance=farad,
            dac=dac,
            amplifier=amplifier,
            anti_alias=anti_alias,
            sensors=sensors,
            assumptions=self.assumptions,
        )
        for key, adc in adcs.items():
            if adc.max_rate < bench.sample_rate:
                raise ParameterSetError(f"{self.file}: [adc.{key}] cannot sample at {bench.sample_rate:g} Hz")
        return bench

    def _amplifier(self) -> Amplifier:
        """Return the amplifier of the table ``[amplifier]``, or the part that ``amplifier = NAME`` names. The
        entry is removed from `content`; its assumed values go to `assumptions`."""
        if not isinstance(self.content.get("amplifier"), str):
            return self._part(Amplifier, "amplifier", self._table("amplifier"))
        name = _beside(self.file, self.content.pop("amplifier"))
        amplifier = load_amplifier(name)
        self._assume("amplifier", load_part(name))
        return amplifier

    def _capacitance(self) -> float:
        """Return the piezo's capacitance, F, of ``[piezo_capacitance]`` or of the part ``stack = NAME``, and
        remove this entry from `content`. Its assumed values go to `assumptions`. ParameterSetError if both
        are given, or NAME is no text."""
        named = self.content.pop("stack", None)
        if named is None:
            key = "piezo_capacitance"
            return self._entries("", {key: self._table(key)})[key].to("F")
        if not isinstance(named, str) or "piezo_capacitance" in self.content:
            raise ParameterSetError(
                f"{self.file}: stack = {named!r} must be the name of a stack, without [piezo_capacitance]"
            )
        name = _beside(self.file, named)
        stack = load_stack(name)
        used = ("capacitance", "capacitance_factor")
        self._assume("stack", load_part(name), used)
        return stack.load

    def _assume(self, where: str, part: Part, fields: tuple[str, ...] = ()) -> None:
        """Add the assumed values of a part, with their reasons, to `assumptions`.

        Args:
            where: key of the bench file that names the part, "amplifier" or "stack".
            part: content of the part's file.
            fields: names of the part's fields that the bench uses; empty for all.
        """
        for field, said in part.assumptions.items():
            if not fields or field in fields:
                self.assumptions[f"{where}.{field}"] = f"{said} ({part.name})"

    def _table(self, key: str) -> dict[str, Any]:
        table = self.content.pop(key, None)
        if not isinstance(table, dict):
            raise ParameterSetError(f"{self.file}: [{key}] is missing")
        return table

    def _entries(self, prefix: str, tables: dict[str, Any]) -> dict[str, SetEntry]:
        entries = read_entries(self.file, prefix, tables)
        for field, entry in entries.items():
            if entry.assumed:
                value = f"{entry.value:g}" if isinstance(entry.value, float) else str(entry.value)
                self.assumptions[f"{prefix}{field}"] = f"{value} {entry.unit}".rstrip() + f": {entry.reason}"
        return entries

    def _part(self, kind: type[T], where: str, tables: Any) -> T:
        if not isinstance(tables, dict):
            raise ParameterSetError(f"{self.file}: [{where}] must be a table")
        return build(kind, self._entries(f"{where}.", tables), f"{self.file}, [{where}]")

    def _sensor(self, name: str, table: Any, adcs: dict[str, Adc]) -> Mounted:
        where = f"{self.file}: [sensor.{name}]"
        if not isinstance(table, dict):
            raise ParameterSetError(f"{where} must be a table")
        for key, given in table.items():
            if key not in _OF_SENSOR and not isinstance(given, dict):
                raise ParameterSetError(f"{where} {key} is unknown{did_you_mean(key, _OF_SENSOR)}")
        kind, place, adc = (table.pop(key, None) for key in _OF_SENSOR)
        try:
            made = registry.sensors.find(str(kind), self.file.parent)
        except registry.RegistryError as error:
            raise ParameterSetError(f"{where} type = {kind!r}: {error}") from error
        if place not in _PLACES:
            raise ParameterSetError(f"{where} on = {place!r} must be one of {', '.join(_PLACES)}")
        sensor = self._part(made, f"sensor.{name}", table)
        if (sensor.unit == "V") != (adc in adcs):
            known = ", ".join(adcs) if sensor.unit == "V" else "none, it gives out numbers"
            raise ParameterSetError(f"{where} adc = {adc!r} must be one of: {known}")
        return Mounted(sensor, place, adcs.get(adc))
