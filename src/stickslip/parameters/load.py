"""Parameter sets: TOML files of published or own values, read into plain data and built into records.

A file has ``title``, ``citations`` (keys of references.bib), ``kind`` and one table per value::

    [gain]
    value = 0.1057
    unit = "um/V"
    symbol = "C"
    source = "eq. 5.10"

A value that the source does not print has ``assumed = true`` and a ``reason``. ``[friction]`` names its law,
``law = "LuGre"``, or one in a file of the user's own beside it, ``law = "my_law.py:MyLaw"``, and has the
law's fields as tables below it. ``[piezo.*]``, ``[further_modes.*]`` and ``[normal_force.*]`` are optional.
``[reported.*]`` contains further numbers of the source, such as a coefficient of determination. Sets of the
package are read by name, a user's own by the path of its file.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from ..gate.errors import GateError, damaged
from ..gate.text import load_toml, parsed
from ..quantities import registry
from ..quantities.records import did_you_mean, quantities
from ..quantities.units import ANGLE, LENGTH, QuantityError, to_si

T = TypeVar("T")

# Largest size, bytes, of a TOML file: a parameter set, a bench, a part. The package's largest has about
# 5,000.
MOST_SET_BYTES = 100_000

_SETS = Path(__file__).parent / "sets"
# Fields of `physics.piezo.Piezo`; a parameter set may have a table ``[piezo.NAME]`` for each.
PIEZO_PARTS = ("hysteresis", "creep")
_KINDS = ("actuator", "pulled_slider", "friction")
_TOP = {"title": str, "citations": list, "kind": str}


class ParameterSetError(QuantityError):
    """Error: a parameter file cannot be found or read, or a value is wrong. The message names file and
    field."""


class SetEntry(NamedTuple):
    """One `value` of a parameter set, in `unit`, as written in its table, with its `symbol` and `source`.

    `assumed` marks a value that no source states, with a `reason`; `note` is a remark. A missing text is "".
    """

    value: float | bool | list[float]
    unit: str = ""
    symbol: str = ""
    source: str = ""
    assumed: bool = False
    reason: str = ""
    note: str = ""

    def to(self, unit: str) -> float:
        """Return the value, one number, in an SI unit. Raises QuantityError for a wrong or missing unit."""
        return to_si(_with_unit(self.value, self.unit, unit), unit)


class PiezoPart(NamedTuple):
    """Hysteresis or creep of a piezo as read from a file: name of the `model`, and its `values` by field."""

    model: str
    values: dict[str, SetEntry]


class ParameterSet(NamedTuple):
    """Content of a parameter file.

    `name` is the name or path by which it was loaded. `values` are the entries of the system by field,
    `friction` those of the law named `law`, and `reported` further numbers of the source. Optional parts are
    `piezo` ("hysteresis", "creep"), `modes` (further modes) and `normal_force`; empty if the file has none.
    """

    name: str
    file: Path
    title: str
    citations: tuple[str, ...]
    kind: str
    values: dict[str, SetEntry]
    law: str
    friction: dict[str, SetEntry]
    reported: dict[str, SetEntry]
    piezo: dict[str, PiezoPart]
    modes: dict[str, SetEntry]
    normal_force: dict[str, SetEntry]

    @property
    def rotary(self) -> bool:
        """Return True for a rotary model, with values in rad, N m and kg m^2."""
        return "rotary" in self.values and self.values["rotary"].value is True

    def entries(self) -> dict[str, SetEntry]:
        """Return all entries except reported numbers by name: "gain", and "friction.sigma_0" for a part."""
        found = self.values | {f"friction.{name}": entry for name, entry in self.friction.items()}
        for name, part in self.piezo.items():
            found |= {f"piezo.{name}.{field}": entry for field, entry in part.values.items()}
        for prefix, table in (("further_modes", self.modes), ("normal_force", self.normal_force)):
            found |= {f"{prefix}.{name}": entry for name, entry in table.items()}
        return found


def available_sets() -> tuple[str, ...]:
    """Return the names of the sets that come with the package."""
    return tuple(sorted(file.stem for file in _SETS.glob("*.toml")))


def load_set(name: str | os.PathLike[str]) -> ParameterSet:
    """Read a parameter set and return its content.

    Args:
        name: the name of a set that comes with the package, or the path of a TOML file.

    Raises:
        ParameterSetError: there is no such set, or the file is not as the module describes.
    """
    text = os.fspath(name)
    file = Path(text)
    if file.suffix != ".toml" and file.name == text:
        if text not in available_sets():
            known = available_sets()
            raise ParameterSetError(
                f"there is no parameter set {text!r}{did_you_mean(text, known)}; available are "
                f"{', '.join(known)}, or give the path of a file that ends in .toml"
            )
        file = _SETS / f"{text}.toml"
    return _read(text, file)


def read_toml(file: Path) -> dict[str, Any]:
    """Return the content of a TOML file; raise ParameterSetError if it cannot be read or is not TOML."""
    try:
        return parsed(load_toml, file, MOST_SET_BYTES)
    except OSError as error:
        raise ParameterSetError(f"{file} cannot be read: {error.strerror}") from error
    except GateError as error:
        raise ParameterSetError(str(error)) from error


def named_file(name: str | os.PathLike[str], folder: Path, noun: str) -> Path:
    """Return the path of a TOML file of the package, or of a user.

    Args:
        name: name of a file in `folder` without its ending; or a path that ends in ".toml", which is
            returned unchecked.
        folder: folder of the package.
        noun: kind of the file, for the message.

    Raises:
        ParameterSetError: the folder has no file with this name.
    """
    file = Path(name)
    if file.suffix == ".toml":
        return file
    text, known = os.fspath(name), sorted(one.stem for one in folder.glob("*.toml"))
    if text not in known:
        raise ParameterSetError(
            f"there is no {noun} {text!r}{did_you_mean(text, known)}; available are {', '.join(known)}, or "
            "give the path of a .toml file"
        )
    return folder / f"{text}.toml"


def _read(name: str, file: Path) -> ParameterSet:
    with damaged(ParameterSetError, str(file)):
        return _checked(name, file, read_toml(file))


def _checked(name: str, file: Path, content: dict[str, Any]) -> ParameterSet:
    for key, kind in _TOP.items():
        if key not in content:
            wrong = next((one for one in content if one not in _TOP and did_you_mean(one, [key])), None)
            said = f"{wrong} is unknown at the top (did you mean {key!r}?)" if wrong else f"{key} is missing"
            raise ParameterSetError(f"{file}: {said}")
        if not isinstance(content[key], kind):
            raise ParameterSetError(f"{file}: {key} = {content[key]!r} must be a {kind.__name__}")
    if not all(isinstance(key, str) for key in content["citations"]):
        raise ParameterSetError(f"{file}: citations must be a list of citation keys")
    if content["kind"] not in _KINDS:
        raise ParameterSetError(f"{file}: kind = {content['kind']!r} must be one of {', '.join(_KINDS)}")

    tables = {key: value for key, value in content.items() if key not in _TOP}
    for key, table in tables.items():
        if not isinstance(table, dict):
            raise ParameterSetError(
                f"{file}: {key} is unknown at the top{did_you_mean(key, _TOP)}; a value is a table"
            )
    friction = tables.pop("friction", None)
    if friction is None:
        raise ParameterSetError(
            f"{file}: [friction] is missing; its law is one of {', '.join(registry.laws.names())}"
        )
    for key in friction if "law" not in friction else ():
        if hint := did_you_mean(key, ["law"]):
            raise ParameterSetError(f"{file}: [friction] {key} is unknown{hint}")
    law = str(friction.pop("law", ""))
    _known(registry.laws, law, file, "[friction] law")
    apart = ("reported", "piezo", "further_modes", "normal_force")
    reported, piezo, modes, along = (tables.pop(key, {}) for key in apart)
    if content["kind"] == "friction" and tables:
        raise ParameterSetError(f"{file}: [{next(iter(tables))}] is unknown in a set of kind 'friction'")
    return ParameterSet(
        name=name,
        file=file,
        title=content["title"],
        citations=tuple(content["citations"]),
        kind=content["kind"],
        values=read_entries(file, "", tables),
        law=law,
        friction=read_entries(file, "friction.", friction),
        reported=read_entries(file, "reported.", reported),
        piezo=_read_piezo(file, piezo),
        modes=read_entries(file, "further_modes.", modes),
        normal_force=read_entries(file, "normal_force.", along),
    )


def read_entries(file: Path, prefix: str, tables: dict[str, Any]) -> dict[str, SetEntry]:
    """Return the values in tables of a file, by key of the table: value, unit, source and so on of each.

    Args:
        file: path of the file, for errors.
        prefix: prefix of the tables' names in errors, such as "friction.".
        tables: content of each table by key.

    Raises:
        ParameterSetError: a table is no table, has unknown or wrong items, or lacks its value.
    """
    return {key: _entry(f"{file}: [{prefix}{key}]", table) for key, table in tables.items()}


def _read_piezo(file: Path, table: dict[str, Any]) -> dict[str, PiezoPart]:
    """Return the parts "hysteresis" and "creep" in a file's table ``[piezo]``. Raises ParameterSetError."""
    parts = {}
    for name, content in table.items():
        if name not in PIEZO_PARTS or not isinstance(content, dict):
            hint, known = did_you_mean(name, PIEZO_PARTS), ", ".join(PIEZO_PARTS)
            raise ParameterSetError(
                f"{file}: [piezo.{name}] is unknown{hint}; known are the tables {known}, each with its model"
            )
        values = dict(content)
        model = str(values.pop("model", ""))
        _known(registry.piezos, model, file, f"[piezo.{name}] model")
        parts[name] = PiezoPart(model, read_entries(file, f"piezo.{name}.", values))
    return parts


def _known(kind: registry.Kind, name: str, file: Path, field: str) -> None:
    """Check that a law or piezo model of this name exists. A user's Python file is not executed.

    `kind` is the registry of laws or piezo models; `file` and `field` are the place of the name, for errors.

    Raises:
        ParameterSetError: the name is unknown, or names a Python file that the set may not use.
    """
    path, _ = registry.own_path(name)
    try:
        if path:
            registry.allowed_file(path, file.parent)
        else:
            kind.find(name)
    except registry.RegistryError as error:
        raise ParameterSetError(f"{file}: {field} = {name!r}: {error}") from error


def _run(kind: registry.Kind, name: str, file: Path, field: str) -> Any:
    """Return the class of a law or piezo model by name; a user's Python file is executed. Arguments and error
    are those of `_known`."""
    try:
        return kind.find(name, file.parent)
    except registry.RegistryError as error:
        raise ParameterSetError(f"{file}: {field} = {name!r}: {error}") from error


def _entry(where: str, table: Any) -> SetEntry:
    if not isinstance(table, dict):
        raise ParameterSetError(f"{where} = {table!r} must be a table with a value, a unit and a source")
    for key, given in table.items():
        if key not in SetEntry._fields:
            known = ", ".join(SetEntry._fields)
            raise ParameterSetError(
                f"{where} has an unknown key {key}{did_you_mean(key, SetEntry._fields)}; known: {known}"
            )
        wanted = bool if key == "assumed" else str
        if key != "value" and not isinstance(given, wanted):
            raise ParameterSetError(f"{where} {key} = {given!r} must be a {wanted.__name__}")
    if "value" not in table:
        raise ParameterSetError(f"{where} has no value")
    numbers = table["value"] if isinstance(table["value"], list) else [table["value"]]
    if not all(isinstance(number, int | float) for number in numbers):
        raise ParameterSetError(
            f"{where} value = {table['value']!r} must be a number; its unit goes into unit"
        )
    entry = SetEntry(**table)
    if entry.assumed and not entry.reason:
        raise ParameterSetError(f"{where} is assumed but gives no reason")
    if entry.reason and not entry.assumed:
        raise ParameterSetError(f"{where} gives a reason but is not marked assumed = true")
    return entry


def _with_unit(value: Any, unit: str, si_unit: str) -> Any:
    """Return a value as the text "VALUE UNIT" for `to_si`, or the bare number if its unit is `si_unit`, which
    needs no slow import of the package pint. A list gives a list, a bool itself. Raises QuantityError if a
    number has no unit but needs one."""
    if isinstance(value, list):
        return [_with_unit(number, unit, si_unit) for number in value]
    if isinstance(value, bool) or unit == si_unit:
        return value
    if not unit:
        raise QuantityError(f"has no unit (expected {si_unit})")
    return f"{value!r} {unit}"


def _numbers(value: Any, unit: str, field: str) -> Any:
    if isinstance(value, list):
        return [_numbers(one, unit, field) for one in value]
    return to_si(value, unit, field)


def build(
    record_type: type[T], entries: dict[str, SetEntry], where: str, turns: bool = False, **given: Any
) -> T:
    """Return a record (actuator, law, ...) with the values of a parameter set, converted to SI.

    Args:
        record_type: class of the record.
        entries: values with their units and sources, by field.
        where: name of the file, for errors.
        turns: True if the values have the units of a rotary model (rad, N m, kg m^2).
        given: values of fields that are not in `entries`, by name.

    Raises:
        ParameterSetError: a field is unknown, missing, of the wrong dimension or out of range.
    """
    specs, values = quantities(record_type), dict(given)
    fields = [field for field in record_type._fields if field not in given]  # type: ignore[attr-defined]
    for field, entry in entries.items():
        if field not in fields:
            hint = did_you_mean(field, fields)
            raise ParameterSetError(f"{where}: [{field}] is unknown{hint}; known are {', '.join(fields)}")
        if field not in specs:
            if entry.unit:
                raise ParameterSetError(f"{where}: [{field}] unit = {entry.unit!r}, but it takes no unit")
            values[field] = entry.value
            continue
        quantity = specs[field].along(ANGLE if turns else LENGTH)
        try:
            value = _with_unit(entry.value, entry.unit, quantity.unit)
            values[field] = _numbers(value, quantity.unit, field) if turns else value
        except QuantityError as error:
            raise ParameterSetError(f"{where}: [{field}] {error}; {quantity.range_text()}") from None
    try:
        return record_type(**values)
    except QuantityError as error:
        raise ParameterSetError(f"{where}: {error}") from None


def friction_of(parameters: ParameterSet) -> Any:
    """Return the friction law of a set as a record, SI; a user's law file is executed. Raises as `build`."""
    law = _run(registry.laws, parameters.law, parameters.file, "[friction] law")
    return build(law, parameters.friction, f"{parameters.file}, [friction]", parameters.rotary)


def piezo_parts(parameters: ParameterSet) -> dict[str, Any]:
    """Return the piezo models of a parameter set as records, by field of `Piezo` ("hysteresis", "creep");
    empty if the set has none. A user's Python file is executed. Raises ParameterSetError, as `build`."""
    return {
        name: build(
            _run(registry.piezos, part.model, parameters.file, f"[piezo.{name}] model"),
            part.values,
            f"{parameters.file}, [piezo.{name}]",
        )
        for name, part in parameters.piezo.items()
    }


def load_friction(name: str | os.PathLike[str]) -> Any:
    """Return the friction law of a parameter set of any kind: ``load_friction("kang2007")`` is its `LuGre`.

    Raises:
        ParameterSetError: there is no such set, or the file is wrong.
    """
    return friction_of(load_set(name))


def load_kind(name: str | os.PathLike[str], kind: str) -> ParameterSet:
    """Return a parameter set as `load_set` does; raise ParameterSetError unless its kind is `kind`, which is
    "actuator", "pulled_slider" or "friction"."""
    parameters = load_set(name)
    if parameters.kind != kind:
        raise ParameterSetError(f"{parameters.file} is of kind {parameters.kind!r}, not {kind!r}")
    return parameters
