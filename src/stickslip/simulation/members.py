"""Members of an ensemble: varied fields of model and waveform, refused members, and blocks for the solver."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics.actuator import Actuator
from ..physics.electronics.output import OutputStage
from ..physics.piezo.model import Piezo
from ..quantities.records import did_you_mean, quantities, quantities_within, whole
from ..quantities.units import QuantityError, array_si
from ..waveform.drive import Drive
from ..waveform.members import Drives, stacked
from ..waveform.members import common as common_drive
from ..waveform.signal import Waveform
from .drives import Driven, Scaled, behind, refuse_voltages, table_precision
from .jumps import cannot_jump, refuse_jumps
from .load import refuse_other_periods
from .models import System, contact_load
from .plant.system import Plant, values_of
from .plant.system import with_values as plant_with
from .two_port import driven_by_voltage
from .varied import (
    changed_fields,
    changed_piezo,
    checked_piezo,
    drive_names,
    model_names,
    piezo_names,
    put_in,
    quantity_of,
    record_field,
    record_names,
    refused_table,
    with_normal_force,
    with_values,
)

T = TypeVar("T")
Columns = Mapping[str, NDArray[np.float64]]
# Parameters with which all voltages of a member's waveform, and its relative normal force, are multiplied.
SCALES = ("drive_scale", "load")
BLOCK = 256  # largest number of members in a block on processors
# Largest number of numbers, roughly, in all drive tables of a block, which limits the memory.
LARGEST_TABLES = 4_000_000


class Members(NamedTuple):
    """A block of members in the solver's form.

    Fields: `reasons`, why each member is refused ("": valid); `of`, system of the unvaried model; `values`
    [members, numbers] of the plants; `states` [members, states] at rest; `drives`, drive tables, and `which`,
    index of each member's table; `ends` of runs or periods, s; `load`, normal force of all.
    """

    reasons: list[str]
    of: System
    values: NDArray[np.float64]
    states: NDArray[np.float64]
    drives: Drives
    which: NDArray[np.int64]
    ends: NDArray[np.float64]
    load: Drive

    @property
    def fine(self) -> NDArray[np.bool_]:
        return np.array([not reason for reason in self.reasons])


def checked_columns(
    model: Actuator, waveform: Waveform, parameters: Mapping[str, ArrayLike]
) -> dict[str, NDArray[np.float64]]:
    """Return the varied parameters by name as arrays of one length, in SI.

    Raises:
        QuantityError: an unknown name, one that is a field of both model and waveform, arrays of different
            length, or parameters without names; or the model is not an actuator.
    """
    if not isinstance(model, Actuator):
        raise QuantityError(f"members are of an Actuator, not of a {type(model).__name__}")
    of_model, of_waveform = [*model_names(model), *SCALES], record_names(waveform)
    known, columns = [*of_model, *of_waveform], {}
    for name, values in by_name(parameters).items():
        if name not in known:
            raise QuantityError(
                f"{name!r} cannot vary{did_you_mean(name, known)}: there are {', '.join(known)}"
            )
        if name in of_model and name in of_waveform:
            raise QuantityError(
                f"{name!r} cannot vary: it may be the field of {type(waveform).__name__} or that of the model"
            )
        quantity = quantity_of(model, waveform, name)
        columns[name] = np.atleast_1d(array_si(values, quantity.unit if quantity else "", name))
        if columns[name].ndim != 1 or columns[name].size == 0:
            raise QuantityError(f"{name} must be a list of values, one per member")
    sizes = {name: column.size for name, column in columns.items()}
    if len(set(sizes.values())) != 1:
        raise QuantityError(f"parameters must be arrays of one length; there are {sizes or 'none'}")
    return columns


def by_name(parameters: Any) -> Mapping[str, Any]:
    """Return `parameters` if they are a mapping of names to values; otherwise raise QuantityError."""
    if not (isinstance(parameters, Mapping) and all(isinstance(name, str) for name in parameters)):
        raise QuantityError(f"parameters are values by name, not {parameters!r:.60}")
    return parameters


def labelled(model: Actuator, waveform: Waveform, columns: Columns) -> dict[str, Any]:
    """Return the columns by name as xarray variables over "member", with unit and meaning."""
    made = {}
    for name, column in columns.items():
        quantity = quantity_of(model, waveform, name)
        about = {"units": quantity.unit, "long_name": quantity.meaning} if quantity else {}
        made[name] = ("member", column, about)
    return made


def bends(model: Actuator) -> bool:
    """Return True if the piezo has hysteresis before the stage, which does not scale with the amplitude."""
    return model.piezo is not None and model.piezo.hysteresis is not None and model.two_port is None


def own_tables(model: Actuator, waveform: Waveform, columns: Columns) -> bool:
    """Return True if members need their own drive tables, because a parameter of the drive varies."""
    before = ["drive_scale"] if bends(model) else []
    return bool(waveform_columns(waveform, columns)) or any(n in columns for n in drive_names(model) + before)


def waveform_columns(waveform: Waveform, columns: Columns) -> dict[str, NDArray[np.float64]]:
    names = record_names(waveform)
    return {name: column for name, column in columns.items() if name in names}


def in_blocks(
    work: Callable[[dict[str, NDArray[np.float64]]], T], columns: Columns, size: int, threads: int | None
) -> Iterator[tuple[int, T]]:
    """Yield each block's first member (index) and the result of `work` for its columns, called in threads."""
    count = next(iter(columns.values())).size
    threads = (os.cpu_count() or 1) if threads is None else whole(threads, "threads", 1, 4096)
    # With few members, blocks are smaller than `size`, so that all threads have work.
    size = max(1, min(size, -(-count // threads)))
    starts = range(0, count, size)
    cut = ({name: c[s : s + size] for name, c in columns.items()} for s in starts)
    with ThreadPoolExecutor(threads) as pool:
        waiting: list[Any] = []
        for start, part in zip(starts, cut, strict=True):
            waiting.append((start, pool.submit(work, part)))
            if len(waiting) > 2 * threads:
                first, future = waiting.pop(0)
                yield first, future.result()
        for first, future in waiting:
            yield first, future.result()


def block_size(
    model: Actuator,
    waveform: Waveform,
    columns: Columns,
    end: float,
    most: int = BLOCK,
    output: OutputStage | None = None,
) -> int:
    """Return the number of members, at most `most`, whose tables up to `end` [s] fit (`LARGEST_TABLES`)."""
    varied = waveform_columns(waveform, columns)
    if not varied and not {*columns} & {"drive_scale", *drive_names(model)}:
        return most
    segments = waveform.drive(end).start.size
    with np.errstate(all="ignore"):
        per_period = [c / getattr(waveform, "frequency", 1.0) for n, c in varied.items() if n == "frequency"]
        per_period += [getattr(waveform, "period", 1.0) / c for n, c in varied.items() if n == "period"]
        quicker = max([1.0, *(float(np.nanmax(c[np.isfinite(c)], initial=1.0)) for c in per_period)])
        if output is not None and output.updates:
            slower = [float(np.nanmax(1.0 / c[c > 0.0], initial=1.0)) for c in per_period]
            segments = max(segments, end * max([1.0, *slower]) * output.update_rate)
            quicker = 1.0  # the number of segments is that of the converter's updates, at any frequency
    return int(np.clip(LARGEST_TABLES / (5.0 * segments * quicker), 1, most))


def prepared(
    model: Actuator,
    waveform: Waveform,
    common: Callable[[float], Drive] | None,
    load: Waveform | float,
    columns: Columns,
    end: float | None,
    tolerance: float,
    periodic: bool = False,
    output: OutputStage | None = None,
) -> Members:
    """Return a block of members in the solver's form.

    Args:
        model, waveform, load, columns: model, drive, relative normal force, and varied fields.
        common: function from a tolerance [m] to the table of the unchanged waveform; None if members have
            their own tables.
        end: s; None: the duration of each member's waveform, or with `periodic` its period.
        tolerance: tolerance of the position for the tables, m.
        periodic: True: each drive is one period, in the steady state.
        output: output stage that periodic drives pass; `common` does not include it.
    """
    count = next(iter(columns.values())).size
    model = with_normal_force(model, columns)
    of_model = model_names(model)
    values = {name: c for name, c in columns.items() if name in of_model}
    reasons, scale = _refused(model, columns, values, count), columns.get("drive_scale", np.ones(count))
    fields, own = changed_fields(model, values)
    # Records are made without their checks: `_refused` has found the invalid members.
    law = tuple.__new__(type(model.friction), fields.values())
    members = tuple.__new__(Actuator, (model._asdict() | own | {"friction": law}).values())
    if common is None:
        rows = _waveforms(waveform, waveform_columns(waveform, columns), reasons)
        if output is not None:
            rows = behind(output, rows, reasons)
        refuse_voltages(members, rows, scale, reasons)
        if "drive_scale" in columns and bends(model):  # scale the voltage before the hysteresis
            rows = [Scaled(row, factor) for row, factor in zip(rows, scale, strict=True)]
            scale = np.ones(count)
        precision = table_precision(members, tolerance / _largest(scale))
        driven = [Driven(*of, precision) for of in zip(_piezos(model, columns, count), rows, strict=True)]
        drives, which, ends = _tables(members, driven, waveform, columns, reasons, end, periodic)
    else:
        if "drive_scale" in columns:
            refuse_voltages(members, [waveform] * count, scale, reasons)
        stroke = table_precision(model, 1.0) / table_precision(members, 1.0) * _largest(scale)
        drives, which = common_drive(common(tolerance / stroke)), np.zeros(count, np.int64)
        ends = np.full(count, _end(waveform, periodic) if end is None else end)
    contact = contact_load(load, float(np.nanmax(ends, initial=0.0)))
    if periodic:
        refuse_other_periods(load, ends, reasons)
    own_load = contact._replace(normal=contact.normal * columns.get("load", 1.0))
    of = contact.system(model)
    with np.errstate(all="ignore"):  # refused members may have values such as 0 or NaN
        table, pulled = _values(own_load.system(members), scale, count), np.any(members.axial_force)
    states = np.zeros((count, of.states))
    if np.any(drives.before) or pulled:
        for m in (m for m, reason in enumerate(reasons) if not reason):
            one = of._replace(plant=plant_with(of.plant, table[m]))
            states[m] = contact.rest(one, float(drives.before[which[m]]))
    return Members(reasons, of, table, states, drives, which, ends, contact.drive)


def _largest(scale: NDArray[np.float64]) -> float:
    """Return the largest finite factor of the drive [members], or 1 if all are smaller."""
    return float(np.max(scale[np.isfinite(scale)], initial=1.0))


def _end(waveform: Any, periodic: bool) -> float:
    return waveform.period if periodic else waveform.duration


def _piezos(model: Actuator, columns: Columns, count: int) -> list[Piezo | None]:
    """Return each member's piezo model (hysteresis and creep), with unchecked values; None without one."""
    names = [name for name in drive_names(model) if name in columns]
    if not names:
        return [model.piezo] * count
    return [changed_piezo(model, {name: float(columns[name][m]) for name in names}) for m in range(count)]


def _tables(
    model: Actuator,
    driven: list[Driven],
    waveform: Any,
    columns: Columns,
    reasons: list[str],
    end: float | None,
    periodic: bool,
) -> tuple[Drives, NDArray[np.int64], NDArray[np.float64]]:
    """Return the drive tables of valid members; for each member its table's index (0 if refused), and the
    run's end [s] (NaN if refused). Refusals are put into `reasons`; one for a jump leaves table and end."""
    rows = [of.waveform for of in driven]
    for m, row in enumerate(rows):
        if not reasons[m]:
            reasons[m] = refused_table(row, waveform, end, periodic)
    fine = np.array([m for m, reason in enumerate(reasons) if not reason], dtype=np.int64)
    which, ends = np.zeros(len(rows), np.int64), np.full(len(rows), np.nan)
    which[fine] = np.arange(fine.size)
    if not fine.size:
        return common_drive(waveform.drive(1e-9)), which, ends
    ends[fine] = [end or _end(rows[m], periodic) for m in fine.tolist()]
    if hasattr(rows[fine[0]], "drives") and model.piezo is None:
        varied = waveform_columns(waveform, columns)
        fields = put_in(waveform, {name: c[fine] for name, c in varied.items()})
        drives = tuple.__new__(type(waveform), fields.values()).drives(ends[fine])
    else:
        drives = stacked([driven[m].table(float(ends[m]), periodic) for m in fine.tolist()])
    if cannot_jump(model) or driven_by_voltage(model):
        for m in fine.tolist():
            try:
                refuse_jumps(model, rows[m].drive(ends[m]), float(ends[m]) if periodic else None)
            except QuantityError as error:
                reasons[m] = str(error)
    return drives, which, ends


def _waveforms(waveform: Any, columns: Columns, reasons: list[str]) -> list[Any]:
    """Return the waveform of each member; store in `reasons` the message for values that it refuses."""
    kind, known = type(waveform), quantities(type(waveform))
    made = [tuple.__new__(kind, row) for row in _rows(put_in(waveform, columns), len(reasons))]
    fine = np.ones(len(reasons), dtype=bool)
    for name, column in columns.items():
        fine &= known[record_field(waveform, name)[0]].allows(column)
    check = getattr(kind, "_check", None)
    for m, one in enumerate(made):
        if reasons[m]:
            continue
        try:
            if not fine[m]:
                kind(*one)
            elif check:
                check(one)
        except QuantityError as error:
            reasons[m] = str(error)
    return made


def _values(of: Any, scale: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the numbers of each member's plant, [members, numbers], with the drive multiplied by `scale`
    [members]. In the system `of`, fields that vary are arrays [members]."""
    plant = of.plant
    modes = tuple(mode._replace(drive=mode.drive * scale) for mode in plant.modes)
    contacts = tuple(
        c if c.drive_rate is None else c._replace(drive_rate=c.drive_rate * scale) for c in plant.elements
    )
    return values_of(Plant(modes, contacts, plant.rate), count)


def _rows(fields: Mapping[str, Any], count: int) -> list[tuple[Any, ...]]:
    """Return a tuple of the `fields` for each member; they are arrays [members], constants, or tuples."""

    def column(value: Any) -> list[Any]:
        if isinstance(value, tuple):
            return list(zip(*map(column, value), strict=True))
        return value.tolist() if isinstance(value, np.ndarray) else [value] * count

    return list(zip(*map(column, fields.values()), strict=True))


def _refused(model: Actuator, columns: Columns, values: Columns, count: int) -> list[str]:
    """Return for each member the message with which the model refuses its `values` or factors; "": valid.
    Only members that fail a check of whole columns are built one by one, to get the message."""
    fine = np.ones(count, dtype=bool)
    known = quantities_within(model)
    own = {name: values[name] for name in piezo_names(model) if name in values}
    scales = {name: columns[name] for name in SCALES if name in columns}
    for name, column in ({n: c for n, c in values.items() if n not in own} | scales).items():
        fine &= known[name].allows(column) if name in known else np.isfinite(column) & (column >= 0.0)
    for m in range(count if own else 0):
        try:
            checked_piezo(changed_piezo(model, {name: float(column[m]) for name, column in own.items()}))
        except QuantityError:
            fine[m] = False
    law_type, names = type(model.friction), {*values} - {*quantities(type(model)), *own}
    if hasattr(law_type, "_check") and names:
        fine &= _in_accord(law_type, changed_fields(model, values)[0], count)
    reasons = [""] * count
    for m in np.flatnonzero(~fine).tolist():
        try:
            for name, column in scales.items():
                if not (np.isfinite(column[m]) and column[m] >= 0.0):
                    raise QuantityError(f"{name} = {column[m]:g} must be finite and >= 0")
            with_values(model, {name: float(c[m]) for name, c in values.items()})
        except QuantityError as error:
            reasons[m] = str(error)
    return reasons


class _Column(np.ndarray):
    """Numbers of all members; `if` with a comparison raises ValueError unless all members give the same."""

    def __bool__(self) -> bool:
        answers = np.unique(self.view(np.ndarray).astype(bool))
        if answers.size != 1:
            raise ValueError("true for some members only")
        return bool(answers[0])


def _in_accord(law_type: Any, fields: Mapping[str, Any], count: int) -> NDArray[np.bool_]:
    """Return True [members] where the fields of the law, arrays [members], pass the law's method `_check`.

    The check runs once on arrays if it takes the same path for all members, otherwise once for each member.
    """
    fine = np.ones(count, dtype=bool)
    columns = (v.view(_Column) if isinstance(v, np.ndarray) else v for v in fields.values())
    with contextlib.suppress(QuantityError, TypeError, ValueError), np.errstate(all="ignore"):
        tuple.__new__(law_type, columns)._check()
        return fine
    for m, row in enumerate(_rows(fields, count)):
        try:
            tuple.__new__(law_type, row)._check()
        except QuantityError:
            fine[m] = False
    return fine
